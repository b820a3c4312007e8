use anyhow::{Result, bail, ensure};
use clap::Args;
use mishandle::Plan;
use mishandle::plan::{ScreeningPlan, Settings};
use mishandle::run::Device;
use mishandle::store::RunKind;

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::run::{self, answers, question};

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
    /// Search algorithm, a name of `mishandle list searches` [default: portfolio]
    #[arg(long, value_name = "S", conflicts_with = "resume")]
    pub search: Option<String>,
    /// Requirement to violate: the name of a formula of the target (such as success or strict), or
    /// the text of a formula [default: the target's first formula, which is success for a task]
    #[arg(long, allow_hyphen_values = true, conflicts_with = "resume")]
    pub formula: Option<String>,
    /// Number of trials: independent searches, each with its own random seed [default: 3]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u32>(Plan::TRIALS))]
    #[arg(conflicts_with = "resume")]
    pub trials: Option<u32>,
    /// Largest number of simulations per trial [default: 300]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u32>(Plan::BUDGET))]
    #[arg(conflicts_with = "resume")]
    pub budget: Option<u32>,
    #[command(flatten)]
    pub file: flags::OpenRun,
    #[command(flatten)]
    pub run: flags::Run,
    #[command(flatten)]
    pub verbose: flags::Verbose,
}

pub fn run(command: &Arguments, gpu: Option<&Device>) -> Result<ExitStatus> {
    run::set_threads(command.run.threads)?;
    let asked =
        question::ask(RunKind::Falsify, &command.subject.keys.keys, &command.file, gpu, || plan(command))?;
    answers::show(asked, command.run.json, command.verbose.verbose)
}

fn plan(command: &Arguments) -> Result<(Plan, Settings)> {
    let mut planned =
        flags::planned("falsify", &command.subject, &command.run)?.simulator(&command.simulator)?;
    planned.flag("--search", "falsify.search", command.search.clone())?;
    planned.flag("--formula", "falsify.formula", command.formula.clone())?;
    planned.number("--trials", "falsify.trials", command.trials)?;
    planned.number("--budget", "falsify.budget", command.budget)?;
    let has_batch = planned.has_stated("falsify.batch");
    let sets_rate = planned.has_stated("falsify.new-mode-rate");
    let (mut plan, settings) = planned.question("falsify")?;
    let measured = settings.engine.screening.map(|_| ScreeningPlan::default());
    let Plan { falsify: Some(falsify), screening, .. } = &mut plan else { bail!("the plan has no search") };
    if let (false, Some(screening)) = (has_batch, screening.as_ref().or(measured.as_ref())) {
        falsify.batch = screening.batch();
    }
    ensure!(
        falsify.keep_going || !sets_rate,
        "falsify.new-mode-rate has no effect without falsify.keep-going; set both"
    );
    falsify.isolate_by_default();
    Ok((plan, settings))
}
