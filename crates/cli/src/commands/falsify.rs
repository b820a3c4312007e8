use anyhow::{Result, bail, ensure};
use clap::Args;
use mishandle::results::{Answer, Falsification};
use mishandle::run::Device;
use mishandle::store::RunKind;
use mishandle::{Plan, ResolvedPlan};
use mishandle_text::plural;

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::run::{self, question};
use crate::show::progress::Bar;
use crate::show::{falsification, mode_survey, output};

/// Search for counterexamples: scenarios in which a target violates a formula
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle falsify ball-balancing --controller ppo --search random
  mishandle falsify ball-balancing --controller ppo --search dual-annealing --formula strict
  mishandle falsify ball-balancing --controller ppo --formula 'always[50:300](ball_speed <= 0.5)'
  mishandle falsify ball-balancing --controller ppo --space events
  mishandle falsify toy/car-following --space events+dynamics
  mishandle falsify toy/needle --search nelder-mead -k falsify.options.xatol=1e-6
  mishandle falsify toy/pits -k falsify.keep-going=true --trials 3 --budget 1000
  mishandle falsify --resume runs/RUN.sqlite

Exit code 1 means that a counterexample was found.")]
pub struct Arguments {
    #[command(flatten)]
    pub subject: flags::Subject,
    #[command(flatten)]
    pub simulator: flags::Simulator,
    /// Search algorithm, a name of `mishandle searches` [default: portfolio]
    #[arg(long, value_name = "S", conflicts_with = "resume")]
    pub search: Option<String>,
    /// Requirement to violate: the name of a formula of the target (such as success or strict), or
    /// the text of a formula [default: the target's first formula, which is success for a task]
    #[arg(long, allow_hyphen_values = true, conflicts_with = "resume")]
    pub formula: Option<String>,
    /// Number of trials: independent searches, each with its own random seed [default: 30]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u32>(Plan::TRIALS))]
    #[arg(conflicts_with = "resume")]
    pub trials: Option<u32>,
    /// Largest number of simulations per trial [default: 300]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u32>(Plan::BUDGET))]
    #[arg(conflicts_with = "resume")]
    pub budget: Option<u32>,
    /// If the target is random: number of simulations of each counterexample with other seeds,
    /// which measure how often it fails; at most as many in total as the run has; 0 skips this
    /// [default: 100]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u32>(0..=10_000_000))]
    pub repeats: Option<u32>,
    #[command(flatten)]
    pub file: flags::OpenRun,
    #[command(flatten)]
    pub run: flags::Run,
}

pub fn run(command: &Arguments, gpu: Option<&Device>) -> Result<ExitStatus> {
    run::set_threads(command.run.threads)?;
    let (mut answer, asked) =
        question::ask(RunKind::Falsify, &command.subject, &command.file, gpu, || plan(command))?;
    add_repeats(&mut answer, &asked.resolved, command.repeats)?;
    let found: Falsification = answer.try_into()?;
    falsification::report_unevaluated(&found);
    if command.run.json {
        output::json(&found)?;
    } else if found.is_complete || (found.screening.is_some() && found.simulations > 0) {
        output::line(&falsification::text(&found))?;
        if let Some(survey) = &found.modes {
            output::line(&mode_survey::text(&found.subject, survey))?;
        }
    }
    if let Some(counts) = &found.screening {
        asked.report_screening(counts);
    }
    if found.is_complete && found.surplus > 0 {
        output::message(&format!(
            "discarded {} that ran in the same batch after the end of a trial or of its search",
            plural(found.surplus, "simulation")
        ));
    }
    if let Some(status) = asked.report_file(found.is_complete) {
        return Ok(status);
    }
    // Exit status 0 would say that the search found no violation.
    // Where one requirement is undefined, another one can be violated.
    let is_violated = found.requirements.iter().flatten().any(|requirement| requirement.violated > 0);
    ensure!(
        is_violated || found.trials.iter().any(|trial| trial.minimum_robustness.is_some()),
        "no simulation has a verdict, so the controller was not tested; the run file contains the end of each simulation"
    );
    if found.falsified_trials == 0 {
        return Ok(if is_violated { ExitStatus::Violated } else { ExitStatus::Done });
    }
    output::message(&format!("Replay the first counterexample: mishandle replay {}", asked.name));
    Ok(ExitStatus::Violated)
}

/// Adds the repeats of the counterexamples to an answer, with a progress bar.
fn add_repeats(answer: &mut Answer, resolved: &ResolvedPlan, repeats: Option<u32>) -> Result<()> {
    let bar = Bar::new(0, "repeats");
    mishandle::inspect::further(resolved, answer, repeats.map(u64::from), |done, all| {
        bar.set_length(all);
        bar.set_position(done);
        run::control_flow()
    })?;
    bar.clear();
    Ok(())
}

fn plan(command: &Arguments) -> Result<Plan> {
    let mut planned =
        flags::planned("falsify", &command.subject, &command.run)?.simulator(&command.simulator)?;
    planned.flag("--search", "falsify.search", command.search.clone())?;
    planned.flag("--formula", "falsify.formula", command.formula.clone())?;
    planned.number("--trials", "falsify.trials", command.trials)?;
    planned.number("--budget", "falsify.budget", command.budget)?;
    let has_batch = planned.has_stated("falsify.batch");
    let sets_rate = planned.has_stated("falsify.new-mode-rate");
    let mut plan = planned.question("falsify")?;
    let Plan { falsify: Some(falsify), screening, .. } = &mut plan else { bail!("the plan has no search") };
    if let (false, Some(screening)) = (has_batch, screening) {
        falsify.batch = screening.rows.min(*Plan::BATCH.end() as u32);
    }
    ensure!(
        falsify.keep_going || !sets_rate,
        "falsify.new-mode-rate has no effect without falsify.keep-going; set both"
    );
    falsify.isolate_by_default();
    Ok(plan)
}
