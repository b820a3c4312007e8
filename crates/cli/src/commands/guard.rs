//! `mishandle guard`: the threshold of a guard from data.

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use mishandle::Plan;
use mishandle::tune::{TuneProgress, tune};
use mishandle_text::{shell_path, shell_quote};

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::run::{self, control_flow};
use crate::show::progress::Bar;
use crate::show::{guard_tuning, output};

/// Choose the threshold of a guard from data, and measure what the guard is worth
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle guard ball-balancing --tune --controller ppo --guard guard.toml --space starts+delay \\
    --out tuned
  mishandle guard ball-balancing --tune --controller ppo --guard guard.toml --space starts+delay \\
    -k tune.false-alarms=0.01 --episodes 2000 -k tune.held-out=2000 --out strict

The guard first watches without acting, in the training scenarios. The chosen threshold misses the
fewest failures among those with at most the allowed share of false alarms: successes with an alarm.
Then the controller alone, the guarded controller and the fallback alone run the same held-out
scenarios, which decide nothing. The folder contains the runs and guard.toml, the guard with the
threshold. The same command continues an interrupted tuning. Every question about a target takes the
guard: mishandle evaluate TARGET --guard tuned/guard.toml")]
pub struct Arguments {
    #[command(flatten)]
    pub subject: flags::Subject,
    #[command(flatten)]
    pub simulator: flags::Simulator,
    /// Choose the threshold on training scenarios, and measure it on held-out ones
    #[arg(long, required = true)]
    pub tune: bool,
    /// Requirement whose violation is a failure: the name or the text of a formula [default: the
    /// first formula of the target]
    #[arg(long, value_name = "F")]
    pub formula: Option<String>,
    /// Number of training scenarios [default: 500]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u64>(Plan::EPISODES))]
    pub episodes: Option<u64>,
    /// Folder of the runs and of the guard with its threshold
    #[arg(long, value_name = "FOLDER")]
    pub out: PathBuf,
    #[command(flatten)]
    pub run: flags::Run,
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    run::set_threads(command.run.threads)?;
    let bar = Bar::new(0, "simulations");
    run::stop_on_signals(&bar)?;
    let mut watch = |progress: &TuneProgress| {
        bar.set_part(progress.phase, progress.all);
        bar.set_position(progress.done);
        control_flow()
    };
    let mut planned =
        flags::planned("guard", &command.subject, &command.run)?.simulator(&command.simulator)?;
    planned.flag("--formula", "tune.formula", command.formula.clone())?;
    planned.number("--episodes", "tune.episodes", command.episodes)?;
    let (plan, settings) = planned.plan()?;
    let found = tune(&plan, &settings.tune, &command.out, &mut watch);
    bar.clear();
    let Some(found) = found? else {
        output::message("Interrupted. The same command continues the tuning.");
        return Ok(ExitStatus::Interrupted);
    };
    if command.run.json {
        output::json(&found)?;
    } else {
        output::line(&guard_tuning::text(&found))?;
    }
    output::message(&format!("Guard with its threshold: {}", shell_quote(&found.guard_file)));
    output::message(&format!("Folder of all runs: {}", shell_path(&command.out)));
    run::answers::conclude(&found.without_verdict, false)
}
