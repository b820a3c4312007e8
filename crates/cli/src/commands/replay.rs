use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use clap::Args;
use mishandle::counterexample::CounterexampleReplay;
use mishandle::plan::EngineSettings;

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::run::{self, counterexample, path_kind};
use crate::show::{output, reasons, replay, simulation};

/// Replay a recorded simulation and check that the result is bit-identical
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle replay runs/RUN.sqlite                      the first counterexample
  mishandle replay runs/RUN.sqlite --trial 2 --simulation 17 --trace trace.csv
  mishandle replay runs/RUN.sqlite --trace trace.csv -k trace.columns=full
  mishandle replay failure.json                         an exported counterexample

Exit code 0 means that everything recorded of the simulation agrees with the plan of the run and
with the replay, bit for bit; 2 that something differs.")]
pub struct Arguments {
    /// Run file, or a .json file of `mishandle regress --add`
    #[arg(value_name = "RUN|FILE.json")]
    pub file: PathBuf,
    /// Number of the trial, from 1 [default: 1 with --simulation, otherwise any]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u32>(flags::NUMBERS))]
    pub trial: Option<u32>,
    /// Number of the simulation within its trial, from 1 [default: the first counterexample,
    /// of a margin that with the smallest disturbance, otherwise the simulation with the minimum
    /// robustness]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u32>(flags::NUMBERS))]
    pub simulation: Option<u32>,
    /// Write the trace to this CSV file; `-k trace.columns=full` adds joint positions and
    /// velocities, actions and contact forces
    #[arg(long, value_name = "FILE")]
    pub trace: Option<PathBuf>,
    /// Number of threads; does not affect the result [default: number of cores]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<usize>(flags::THREADS))]
    pub threads: Option<usize>,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub keys: flags::SettingKeys,
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    run::set_threads(command.threads)?;
    let settings = command.keys.settings("replay")?;
    let is_full = flags::is_full_trace(&settings.trace, command.trace.as_deref())?;
    let engine = settings.engine;
    if path_kind::is_counterexample(&command.file) {
        return counterexample(command, &engine, is_full);
    }
    let file = run::read(&command.file, engine.skip_check)?;
    let Some((trial, simulation)) =
        mishandle::replay::select_simulation(&file, command.trial, command.simulation)?
    else {
        let in_trial = command.trial.map_or(String::new(), |trial| format!(" in trial {trial}"));
        bail!("{} has no decided simulation{in_trial}; choose one with --simulation", command.file.display());
    };
    let replayed = mishandle::replay::replay(&file, trial, simulation, engine.moved())?;
    run::report_build_differences("made", &replayed.build_differences);
    let header = file.header();
    if let Some(path) = &command.trace {
        let more = if is_full {
            let moved = engine.moved();
            mishandle::picture::full_trace(
                &mishandle::resolve::recorded_plan(header, moved)?,
                &replayed.episode,
            )?
        } else {
            Vec::new()
        };
        simulation::write_trace(path, header, &replayed.episode.trace, &more)?;
    }
    let found = replayed.result(&file);
    if command.json {
        output::json(&found)?;
    } else {
        output::line(&replay::text(&found))?;
        if !found.has_verdict || found.reason.is_some() {
            output::line(&format!("{}{}", found.end, reasons::of_one(found.reason.as_deref())))?;
        }
    }
    if !replayed.differences.is_empty() {
        bail!("{}", run::differences_text(&replayed.differences));
    }
    output::message("the replay is bit-identical to the record, which agrees with the plan of the run");
    Ok(ExitStatus::Done)
}

/// Replays an exported counterexample.
fn counterexample(command: &Arguments, engine: &EngineSettings, is_full: bool) -> Result<ExitStatus> {
    flags::check_flags(command.trial, command.simulation)?;
    let (recorded, replayed) = counterexample::replay(&command.file, engine.moved())?;
    let CounterexampleReplay { header, episode, differences, .. } = &replayed;
    if let Some(path) = &command.trace {
        let folder = command.file.parent().unwrap_or(Path::new(""));
        let more = if is_full {
            let moved = engine.moved();
            mishandle::picture::full_trace(&recorded.resolve(folder, moved)?, episode)?
        } else {
            Vec::new()
        };
        simulation::write_trace(path, header, &episode.trace, &more)?;
    }
    let found = replayed.result(&recorded, &command.file);
    if command.json {
        output::json(&found)?;
    } else {
        output::line(&replay::counterexample_text(&found))?;
    }
    if !differences.is_empty() {
        bail!("the counterexample differs from the replay:\n  {}", differences.join("\n  "));
    }
    output::message("the replay is bit-identical to the counterexample");
    Ok(ExitStatus::Done)
}
