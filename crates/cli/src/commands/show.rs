mod controller;
mod explain;
mod modes;
mod table;

use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};
use clap::Args;
use mishandle::results::Answer;
use mishandle_text::path_text;

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::run::path_kind::{self, PathKind};
use crate::show::{answer, bisection, check, output};

/// Show a run, its failures or one simulation, a folder of runs, or a controller
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle show                                        the run files in the folder runs
  mishandle show runs/RUN.sqlite                        its answer and its failure modes
  mishandle show runs/RUN.sqlite --simulation first     when, where and why it fails
  mishandle show runs/RUN.sqlite --trial 2 --simulation 17
  mishandle show runs/RUN.sqlite --masking              which conjuncts hide others
  mishandle show failure.json                           an exported counterexample, explained
  mishandle show a.sqlite b.sqlite                      a table
  mishandle show checked                                a check, a bisection, a hardening
  mishandle show point-reaching/ppo                     how a controller was trained

A failure mode is a group of failures with the same decisive predicate, similar scenarios and
similar times. Its representative is the failure nearest to the nominal scenario.

A counterexample of any target is explained from its recorded trace. Other simulations have none and
are replayed. A failure is simulated again with each axis alone at its nominal value, to say which
one removes it.

The page of a controller is a valid settings file: `mishandle train --settings FILE` trains with the
same settings. Success rates are from validation during training.

Exit code 1 means that an explained simulation violates the formula.")]
pub struct Arguments {
    /// Run files; folders of run files, of a check, of a bisection or of a hardening; a
    /// counterexample (.json); or a controller: a file, or TASK/NAME for a shipped one
    #[arg(value_name = "PATH", default_value = "runs")]
    pub paths: Vec<PathBuf>,
    /// Number of the trial of --simulation, from 1 [default: 1, with `first` any]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u32>(flags::NUMBERS))]
    #[arg(requires = "simulation")]
    pub trial: Option<u32>,
    /// Explain a simulation of a run: its number within its trial, from 1; or `first`, the first
    /// counterexample, of a margin that with the smallest disturbance, otherwise the simulation
    /// with the minimum robustness
    #[arg(long, value_name = "N|first", allow_negative_numbers = true, value_parser = place)]
    pub simulation: Option<Place>,
    /// Explain the whole run: how often each conjunct sets the robustness, and how often each one
    /// fails, over at most N simulations, which are simulated again; violated ones first [default
    /// of N: 500]
    #[arg(long, value_name = "N", num_args = 0..=1, default_missing_value = "500", require_equals = true)]
    #[arg(allow_negative_numbers = true, value_parser = numbers::integer::<u64>(1..=u64::MAX))]
    #[arg(conflicts_with = "simulation")]
    pub masking: Option<u64>,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub keys: flags::SettingKeys,
    #[command(flatten)]
    pub verbose: flags::Verbose,
}

/// A simulation of a run.
#[derive(Clone, Copy, Debug)]
pub enum Place {
    /// The first counterexample.
    First,
    Number(u32),
}

fn place(text: &str) -> std::result::Result<Place, String> {
    match text {
        "first" => Ok(Place::First),
        _ => numbers::integer::<u32>(flags::NUMBERS)(text).map(Place::Number),
    }
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    let settings = command.keys.settings("show")?;
    let [path] = &command.paths[..] else {
        check_flags(command, "several files")?;
        return table::show(&command.paths, command.json);
    };
    match path_kind::of(path)? {
        PathKind::Run => {}
        PathKind::Other => ensure!(
            path.exists(),
            "there is no run file or folder {}; a shipped controller is named TASK/NAME, such as point-reaching/ppo",
            path.display()
        ),
        PathKind::Counterexample => {
            ensure!(
                command.simulation.is_none() && command.masking.is_none(),
                "the file is one counterexample: --trial, --simulation and --masking are about a run file"
            );
            return explain::counterexample(path, &settings, command.json);
        }
        PathKind::Controller => {
            check_flags(command, "a controller")?;
            return controller::show(&path_text(path), command.json);
        }
        // The reader of run files names the command that reads this file.
        PathKind::Curve | PathKind::Log | PathKind::Target | PathKind::Requirements | PathKind::Plan => {}
        folder => {
            check_flags(command, "a folder")?;
            return show_folder(path, &folder, command.json, command.verbose.verbose);
        }
    }
    let file = crate::run::read(path, settings.engine.skip_check)?;
    match (command.masking, command.simulation) {
        (Some(limit), _) => explain::masking(&file, &settings.engine, limit, command.json),
        (None, Some(place)) => explain::simulation(&file, command.trial, place, &settings, command.json),
        (None, None) => modes::show(&file, &settings.engine, command.json, command.verbose.verbose),
    }
}

/// Checks that no flag asks for the simulations of one run.
fn check_flags(command: &Arguments, what: &str) -> Result<()> {
    ensure!(
        command.simulation.is_none() && command.masking.is_none(),
        "--simulation and --masking are about one run file, not about {what}"
    );
    Ok(())
}

/// Shows the answer in a folder, or the run files there.
fn show_folder(path: &Path, kind: &PathKind, json: bool, verbose: bool) -> Result<ExitStatus> {
    match kind {
        PathKind::Check(found) if json => output::json(found)?,
        PathKind::Check(found) => check::print(found, verbose)?,
        PathKind::Bisection(found) if json => output::json(found)?,
        PathKind::Bisection(found) => output::line(&bisection::text(found))?,
        PathKind::Hardening => {
            let found = path_kind::hardening(path)?;
            if json {
                output::json(&found)?;
            } else {
                answer::print(&Answer::Hardening(Box::new(found)), verbose)?;
            }
        }
        _ => return table::show(&[path.to_path_buf()], json),
    }
    Ok(ExitStatus::Done)
}
