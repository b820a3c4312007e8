use std::path::Path;

use anyhow::{Result, bail};
use clap::Args;
use mishandle::counterexample::CounterexampleReplay;
use mishandle::plan::EngineSettings;

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::run::{self, counterexample};
use crate::show::{output, reasons, replay, simulation};

/// Replay a recorded simulation and check that the result is bit-identical
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle replay runs/RUN.sqlite                      the first counterexample
  mishandle replay runs/RUN.sqlite --trial 2 --simulation 17 --trace trace.csv
  mishandle replay runs/RUN.sqlite --trace trace.csv --record full
  mishandle replay failure.json                         an exported counterexample

Exit code 0 means that everything recorded of the simulation agrees with the plan of the run and
with the replay, bit for bit; 2 that something differs.")]
pub struct Arguments {
    #[command(flatten)]
    pub recorded: flags::Recorded,
    #[command(flatten)]
    pub trace: flags::TraceFile,
    /// Number of threads; does not affect the result [default: number of cores]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<usize>(flags::THREADS))]
    pub threads: Option<usize>,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    run::set_threads(command.threads)?;
    let engine = command.recorded.engine("replay")?;
    if flags::is_file(&command.recorded.file) {
        return counterexample(command, &engine);
    }
    let file = run::read(&command.recorded.file, engine.skip_check)?;
    let Some((trial, simulation)) =
        mishandle::replay::select_simulation(&file, command.recorded.trial, command.recorded.simulation)?
    else {
        let in_trial = command.recorded.trial.map_or(String::new(), |trial| format!(" in trial {trial}"));
        bail!(
            "{} has no decided simulation{in_trial}; choose one with --simulation",
            command.recorded.file.display()
        );
    };
    let replayed = mishandle::replay::replay(&file, trial, simulation, engine.moved())?;
    run::report_build_differences("made", &replayed.build_differences);
    let header = file.header();
    if let Some(path) = &command.trace.trace {
        let more = if command.trace.is_full() {
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
fn counterexample(command: &Arguments, engine: &EngineSettings) -> Result<ExitStatus> {
    flags::check_flags(command.recorded.trial, command.recorded.simulation)?;
    let (recorded, replayed) = counterexample::replay(&command.recorded.file, engine.moved())?;
    let CounterexampleReplay { header, episode, differences, .. } = &replayed;
    if let Some(path) = &command.trace.trace {
        let folder = command.recorded.file.parent().unwrap_or(Path::new(""));
        let more = if command.trace.is_full() {
            let moved = engine.moved();
            mishandle::picture::full_trace(&recorded.resolve(folder, moved)?, episode)?
        } else {
            Vec::new()
        };
        simulation::write_trace(path, header, &episode.trace, &more)?;
    }
    let found = replayed.result(&recorded, &command.recorded.file);
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
