//! `mishandle harden`: makes a controller fail less often in a space, with evidence.

use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::Args;
use mishandle::harden::{HardenProgress, harden, harden_folder, largest_cost, resume};
use mishandle::plan::HardenPlan;
use mishandle::results::Answer;
use mishandle::run::{Device, Opening};
use mishandle::{MishandleError, Plan};
use mishandle_text::shell_path;

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::run::{self, control_flow};
use crate::show::progress::Bar;
use crate::show::{answer, escape, output};

/// Train a controller on its failures until it fails less often, and prove it
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle harden ball-balancing --controller ppo --space starts+delay --out better.safetensors
  mishandle harden ball-balancing --controller ppo --space delay+sensing --axis action_delay=0:2 \\
    --rounds 2 --steps 1e6 --out better.safetensors
  mishandle harden ball-balancing --controller ./seeing.onnx --space starts+light-3 \\
    --trainer 'python train.py' --out better.onnx
  mishandle harden --resume better.harden

A round searches for failures in the space, trains the controller on them, and is accepted if the
upper bound of the failure rate falls and no other measure gets worse (-k harden.allow names
exceptions). The final comparison uses scenarios and seeds that no search, training or decision
used. Everything is in the folder beside --out: better.harden for better.safetensors. Exit code 0: a
controller was accepted and written. 1: none was. 2: also if too many simulations have no verdict
(max-without-verdict).

A trainer is a program of yours for controllers that this program cannot train, such as ONNX models:
docs/guide/harden.md lists its arguments. A command that a file names, also that of --resume, needs
MISHANDLE_ALLOW_PROGRAMS=1 in the environment.")]
pub struct Arguments {
    #[command(flatten)]
    pub subject: flags::Subject,
    /// File of the accepted controller, in the format of the one before
    #[arg(long, value_name = "FILE", required_unless_present = "resume", conflicts_with = "resume")]
    pub out: Option<PathBuf>,
    /// Largest number of rounds [default: 3]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u32>(HardenPlan::ROUNDS))]
    pub rounds: Option<u32>,
    /// Environment steps of the training of a round, such as 1e6 [default: 2e6]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u64>(HardenPlan::STEPS))]
    pub steps: Option<u64>,
    /// Simulations of each search in a round, and in the final comparison [default: 300]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u32>(Plan::BUDGET))]
    pub budget: Option<u32>,
    /// Simulations of each measure of the final comparison; a validation takes half of it
    /// [default: 1000]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u64>(Plan::EPISODES))]
    pub episodes: Option<u64>,
    /// Training settings (TOML) [default: those by which the controller was trained]
    #[arg(long, value_name = "FILE")]
    pub settings: Option<String>,
    /// Command that trains the controller of a round, such as 'python train.py'
    #[arg(long, value_name = "COMMAND", conflicts_with = "settings")]
    pub trainer: Option<String>,
    /// Continue the hardening of this folder
    #[arg(long, value_name = "FOLDER", conflicts_with_all = PLANNED)]
    pub resume: Option<PathBuf>,
    #[command(flatten)]
    pub run: flags::Run,
    #[command(flatten)]
    pub verbose: flags::Verbose,
}

/// Arguments that a resumed hardening takes from its plan.
const PLANNED: [&str; 15] = [
    "target",
    "controller",
    "space",
    "axis",
    "action_noise",
    "guard",
    "keys",
    "plan",
    "rounds",
    "steps",
    "budget",
    "episodes",
    "settings",
    "trainer",
    "seed",
];

pub fn run(command: &Arguments, gpu: Option<&Device>) -> Result<ExitStatus> {
    run::set_threads(command.run.threads)?;
    let bar = Bar::new(0, "");
    run::stop_on_signals(&bar)?;
    let mut watch = |progress: &HardenProgress| {
        bar.set_length(progress.all);
        bar.set_position(progress.done);
        bar.set_note(format!("{}, {}", progress.unit, escape::name(&progress.phase)));
        control_flow()
    };
    let (folder, found) = match (&command.resume, &command.out) {
        (Some(folder), _) => (folder.clone(), resume(folder, Opening::default(), gpu, &mut watch)),
        (None, Some(out)) => {
            let plan = plan(command)?;
            if let Some(table) = &plan.harden {
                let [simulations, steps] = largest_cost(table);
                output::message(&format!(
                    "at most about {simulations} simulations and {steps} environment steps of training"
                ));
            }
            (harden_folder(out), harden(&plan, out, gpu, &mut watch))
        }
        (None, None) => {
            return Err(MishandleError::MissingPlanTable { table: "harden" }).context("--out is missing");
        }
    };
    bar.clear();
    let quoted = shell_path(&folder);
    let Some(found) = found? else {
        let allowed = if command.trainer.is_some() { "MISHANDLE_ALLOW_PROGRAMS=1 " } else { "" };
        output::message(&format!("Resume with: {allowed}mishandle harden --resume {quoted}"));
        return Ok(ExitStatus::Interrupted);
    };
    if command.run.json {
        output::json(&found)?;
    } else {
        answer::print(&Answer::Hardening(Box::new(found.clone())), command.verbose.verbose)?;
    }
    output::message(&format!("Folder of all runs: {quoted}"));
    if found.without_verdict.is_too_large() {
        let has_failure = found.searches.last().is_some_and(|search| search.failures > 0);
        return run::answers::conclude(&found.without_verdict, has_failure);
    }
    Ok(if found.after.is_some() { ExitStatus::Done } else { ExitStatus::Violated })
}

fn plan(command: &Arguments) -> Result<Plan> {
    let mut planned = flags::planned("harden", &command.subject, &command.run)?;
    planned.number("--rounds", "harden.rounds", command.rounds)?;
    planned.number("--steps", "harden.steps", command.steps)?;
    planned.number("--budget", "harden.budget", command.budget)?;
    planned.number("--episodes", "harden.episodes", command.episodes)?;
    if !planned.has_stated("harden.validation") {
        let half = command.episodes.map(|episodes| episodes.div_ceil(2));
        planned.number("--episodes", "harden.validation", half)?;
    }
    planned.flag("--settings", "harden.settings", command.settings.clone())?;
    planned.flag("--trainer", "harden.trainer", command.trainer.clone())?;
    Ok(planned.question("harden")?.0)
}
