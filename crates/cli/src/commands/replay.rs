use std::path::{Path, PathBuf};

use anyhow::{Result, bail, ensure};
use clap::Args;
use mishandle::counterexample::CounterexampleReplay;
use mishandle::plan::EngineSettings;
use mishandle::resolve::Moved;
use mishandle::store::RunFile;
use mishandle_report::{Recording, RunReport, replay_page};

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::run::{self, browser, counterexample, path_kind};
use crate::show::{output, reasons, replay, simulation};
use crate::words::shell_command;

/// Replay a recorded simulation and check that the result is bit-identical
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle replay runs/RUN.sqlite                      the first counterexample
  mishandle replay runs/RUN.sqlite --trial 2 --simulation 17 --trace trace.csv
  mishandle replay runs/RUN.sqlite --trace trace.csv -k trace.columns=full
  mishandle replay runs/RUN.sqlite --open               in 3-D, in the browser
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
    /// Write a page with a 3-D replay of the simulation, beside the run file, and open it in the
    /// browser
    #[arg(long)]
    pub open: bool,
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
    if command.open {
        open(command, &file, (trial, simulation), engine.moved())?;
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

/// Opens a page with a 3-D replay of a simulation.
fn open(command: &Arguments, file: &RunFile, place: (u32, u32), moved: Moved<'_>) -> Result<()> {
    let mut report = RunReport::load(file, &command.file.to_string_lossy(), None, shell_command)?;
    let status =
        report.record_replay(file, moved, Some(place), |_| String::new(), |_, _| run::control_flow())?;
    ensure!(
        status == Recording::Done,
        "{} has no 3-D replay: its target has no scene",
        command.file.display()
    );
    let page = browser::page_beside(&command.file, &format!("-t{}-s{}", place.0, place.1));
    output::write_atomically(&page, true, replay_page(&report).as_bytes())?;
    output::message(&format!("wrote {}", page.display()));
    browser::open(&page)
}

/// Replays an exported counterexample.
fn counterexample(command: &Arguments, engine: &EngineSettings, is_full: bool) -> Result<ExitStatus> {
    flags::check_flags(command.trial, command.simulation)?;
    ensure!(
        !command.open,
        "--open shows a simulation of a run file, and {} is a counterexample",
        command.file.display()
    );
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
