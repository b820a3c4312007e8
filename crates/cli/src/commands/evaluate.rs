use anyhow::Result;
use clap::Args;
use mishandle::Plan;
use mishandle::plan::{Settings, Until};
use mishandle::run::Device;
use mishandle::store::RunKind;

use crate::exit_status::ExitStatus;
use crate::flags::{self, Planned, numbers};
use crate::run::sample_size::{self, Expectation};
use crate::run::{self, answers, question};

/// Evaluate a controller: success rate, dangerous behavior rate and completion time, with 95 %
/// intervals
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle evaluate point-reaching --controller ppo --episodes 1000
  mishandle evaluate point-reaching --controller ppo --episodes 1000 --action-noise 0.5
  mishandle evaluate point-reaching --controller ppo --episodes 5000 --until width=0.04
  mishandle evaluate point-reaching --controller ppo --episodes 5000 --until decided --rate 0.95
  mishandle evaluate point-reaching --controller my_controller.safetensors --json
  mishandle evaluate --expect 0.97 --until width=0.04       how many simulations will it take?

In a space with other axes than initial states, the same starts and seeds are simulated with every
other axis at nominal, too (the control arm): -k evaluate.control=false does without.")]
pub struct Arguments {
    #[command(flatten)]
    pub subject: flags::Subject,
    #[command(flatten)]
    pub simulator: flags::Simulator,
    /// Number of random initial states; the corners and the center of the initial box are simulated
    /// as well. With --until, the largest number [default: 100]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u64>(Plan::EPISODES))]
    #[arg(conflicts_with = "resume")]
    pub episodes: Option<u64>,
    /// Stop by itself, looking after each batch: decided (the interval of the success rate lies on
    /// one side of --rate), or width=W (it is at most W wide, such as width=0.04). The interval
    /// holds at any time
    #[arg(long, value_name = "RULE", conflicts_with = "resume")]
    pub until: Option<Until>,
    /// The success rate that --until decided decides about, such as 0.95
    #[arg(long, value_name = "R", conflicts_with = "resume", value_parser = numbers::number("a number above 0 and below 1", |rate| rate > 0.0 && rate < 1.0))]
    pub rate: Option<f64>,
    /// Simulate nothing: show how many simulations it takes if the success rate is RATE, or that of
    /// the run file RUN
    #[arg(long, value_name = "RATE|RUN", value_parser = sample_size::expected, conflicts_with_all = SIMULATED)]
    pub expect: Option<Expectation>,
    #[command(flatten)]
    pub file: flags::OpenRun,
    #[command(flatten)]
    pub run: flags::Run,
    #[command(flatten)]
    pub verbose: flags::Verbose,
}

/// Arguments that mean nothing without simulations.
const SIMULATED: [&str; 10] = [
    "target",
    "command",
    "controller",
    "guard",
    "space",
    "axis",
    "requirement",
    "action_noise",
    "out",
    "resume",
];

pub fn run(command: &Arguments, gpu: Option<&Device>) -> Result<ExitStatus> {
    run::set_threads(command.run.threads)?;
    if let Some(expected) = &command.expect {
        return sample_size::show(std::slice::from_ref(expected), planned(command)?, command.run.json);
    }
    let asked =
        question::ask(RunKind::Evaluate, &command.subject.keys.keys, &command.file, gpu, || plan(command))?;
    answers::show(asked, command.run.json, command.verbose.verbose)
}

fn plan(command: &Arguments) -> Result<(Plan, Settings)> {
    planned(command)?.question("evaluate")
}

fn planned(command: &Arguments) -> Result<Planned> {
    let planned = flags::planned("evaluate", &command.subject, &command.run)?;
    let mut planned = planned.simulator(&command.simulator)?;
    planned.number("--episodes", "evaluate.episodes", command.episodes)?;
    planned.flag("--until", "evaluate.until", command.until.map(String::from))?;
    planned.flag("--rate", "evaluate.rate", command.rate)?;
    Ok(planned)
}
