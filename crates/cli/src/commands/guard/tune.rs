//! `mishandle guard tune`: the threshold of a guard from data.

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use mishandle::Plan;
use mishandle::tune::{TuneProgress, TuneSettings, tune};
use mishandle_text::{path_text, shell_quote};

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::run::{self, control_flow};
use crate::show::progress::Bar;
use crate::show::{guard_tuning, output};

#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle guard tune ball-balancing --controller ppo --guard guard.toml --space starts+delay \\
    --out tuned
  mishandle guard tune ball-balancing --controller ppo --guard guard.toml --space starts+delay \\
    --false-alarms 0.01 --episodes 2000 --held-out 2000 --out strict

The guard first watches without acting, in the training scenarios. The chosen threshold misses the
fewest failures among those with at most the allowed share of false alarms: successes with an alarm.
Then the controller alone, the guarded controller and the fallback alone run the same held-out
scenarios, which decide nothing. The folder contains the runs and guard.toml, the guard with the
threshold. The same command continues an interrupted tuning.")]
pub struct Arguments {
    #[command(flatten)]
    pub subject: flags::Subject,
    #[command(flatten)]
    pub simulator: flags::Simulator,
    /// Requirement whose violation is a failure: the name or the text of a formula [default: the
    /// first formula of the target]
    #[arg(long, value_name = "F")]
    pub formula: Option<String>,
    /// Number of training scenarios [default: 500]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u64>(Plan::EPISODES))]
    pub episodes: Option<u64>,
    /// Number of held-out scenarios [default: 500]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u64>(Plan::EPISODES))]
    pub held_out: Option<u64>,
    /// Largest share of successful training scenarios with an alarm [default: 0.05]
    #[arg(long, value_name = "SHARE", allow_negative_numbers = true)]
    #[arg(value_parser = numbers::number("a share from 0 to less than 1", |share| (0.0..1.0).contains(&share)))]
    pub false_alarms: Option<f64>,
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
        bar.set_length(progress.all);
        bar.set_position(progress.done);
        bar.set_note(progress.phase.to_string());
        control_flow()
    };
    let (plan, _) =
        flags::planned("guard", &command.subject, &command.run)?.simulator(&command.simulator)?.plan()?;
    let defaults = TuneSettings::default();
    let settings = TuneSettings {
        episodes: command.episodes.unwrap_or(defaults.episodes),
        held_out: command.held_out.unwrap_or(defaults.held_out),
        false_alarms: command.false_alarms.unwrap_or(defaults.false_alarms),
        formula: command.formula.clone(),
    };
    let found = tune(&plan, &settings, &command.out, &mut watch);
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
    output::message(&format!("Folder of all runs: {}", shell_quote(&path_text(&command.out))));
    Ok(ExitStatus::Done)
}
