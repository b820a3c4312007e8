//! A program of the user that trains the controller of a round.

use std::fs::{self, File};
use std::io::{self, Read, Seek, SeekFrom};
use std::ops::ControlFlow;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{ExitStatus, Stdio};
use std::time::Duration;

use mishandle_files::refuse_link;
use mishandle_simulators::process::{Job, Program};
use mishandle_text::path_text;

use super::round::Session;
use super::{HardenProgress, HardenUnit, Watch};
use crate::error::{MishandleError, invalid, problem};
use crate::plan::{AxisSetting, HardenPlan, Plan};
use crate::resolve::{ResolvedPlan, check_allowed};

/// File in the folder of a round with all that the trainer printed.
const LOG: &str = "training.log";

/// Time between two looks at the trainer.
const POLL: Duration = Duration::from_millis(100);

/// Time that the trainer has to end by itself after an interruption.
const GRACE: Duration = Duration::from_secs(5);

/// Length of the end of the log that an error shows, bytes.
const END: u64 = 1500;

/// Largest length of the line that the progress shows, characters.
const LINE: usize = 100;

/// A program that trains.
pub(super) struct Trainer {
    command: String,
    program: Program,
}

impl Trainer {
    /// Returns the trainer of a plan; `None` if this program trains.
    ///
    /// # Errors
    /// If the command is not a list of words, or a file names it and the user has not allowed it.
    pub fn of(plan: &Plan, table: &HardenPlan) -> Result<Option<Trainer>, MishandleError> {
        let Some(command) = &table.trainer else { return Ok(None) };
        if !table.is_trainer_typed {
            check_allowed("trainer", command)?;
        }
        let folder = if plan.folder.is_empty() { "." } else { &plan.folder };
        let program = mishandle_simulators::program(command, PathBuf::from(folder))?;
        Ok(Some(Trainer { command: command.clone(), program }))
    }

    /// Checks that its program exists: a round searches for minutes before it starts.
    ///
    /// # Errors
    /// If there is no such program.
    pub fn check(&self) -> Result<(), MishandleError> {
        let Program { words, folder } = &self.program;
        let first = words.first().map_or("", String::as_str);
        let paths = std::env::var_os("PATH").unwrap_or_default();
        let is_found = if first.contains('/') {
            folder.join(first).is_file()
        } else {
            std::env::split_paths(&paths).any(|place| place.join(first).is_file())
        };
        if is_found {
            Ok(())
        } else {
            Err(invalid(
                "the trainer",
                &self.command,
                "a command whose first word is a program: a path, or a name that PATH finds",
            ))
        }
    }

    /// Trains the controller of a round on the failures in `archive`. Breaks if it was interrupted.
    ///
    /// # Errors
    /// If the trainer does not start, fails, or gives no controller of the target.
    pub fn train(
        &self,
        session: &Session<'_>,
        archive: &Path,
        watch: Watch<'_>,
    ) -> Result<ControlFlow<()>, MishandleError> {
        let out = session.folder.candidate(session.round);
        let log = session.folder.of_round(session.round, LOG);
        let write = MishandleError::write("file", &log);
        let file = File::options().create(true).append(true).open(&log).map_err(write)?;
        // An earlier call of the trainer may have written to it.
        let begin = file.metadata().map_err(write)?.len();
        let failed = |failure: String| {
            let end = end(&log, begin, END).unwrap_or_default();
            problem(format!(
                "the trainer `{}` {failure}; what is recorded remains, and a resumed hardening calls it again; the end of {}: {}",
                self.command,
                log.display(),
                if end.trim().is_empty() { "nothing" } else { end.trim() }
            ))
        };
        let streams = [Stdio::null(), Stdio::from(file.try_clone().map_err(write)?), Stdio::from(file)];
        let program = self.program_of(session, archive, &out);
        let job = Job::start(&program, streams).map_err(|error| failed(format!("does not run: {error}")))?;
        while !job.wait(POLL) {
            let progress = HardenProgress {
                phase: match last_line(&log, begin) {
                    Some(line) => format!("{}: {line}", session.phase),
                    None => session.phase.clone(),
                },
                done: 0,
                all: session.table.steps,
                unit: HardenUnit::EnvironmentSteps,
            };
            if watch(&progress).is_break() {
                job.stop(GRACE);
                return Ok(ControlFlow::Break(()));
            }
        }
        let status = job.status().map_err(|error| failed(format!("ended without a status: {error}")))?;
        if !status.success() {
            return Err(failed(status_text(status)));
        }
        check_controller(session, &out).map_err(|problem| failed(format!("ended, but {problem}")))?;
        Ok(ControlFlow::Continue(()))
    }

    /// Returns the program with the arguments of a round.
    fn program_of(&self, session: &Session<'_>, archive: &Path, out: &Path) -> Program {
        let Session { plan, table, controller, seed, .. } = session;
        let mut arguments = vec![
            ("--target", plan.target.clone()),
            ("--controller", path_text(controller)),
            ("--archive", path_text(archive)),
            ("--space", plan.space.clone()),
        ];
        arguments.extend(plan.axes.iter().map(|(name, setting)| ("--axis", axis_text(name, setting))));
        arguments.extend([
            // Every library takes a seed of 31 bits.
            ("--seed", (seed.0 >> 33).to_string()),
            ("--steps", table.steps.to_string()),
            ("--threads", rayon::current_num_threads().to_string()),
            ("--out", path_text(out)),
        ]);
        let mut program = self.program.clone();
        program.words.extend(arguments.into_iter().flat_map(|(name, value)| [name.to_string(), value]));
        program
    }
}

/// Returns the setting of an axis as commands of this program read it.
fn axis_text(name: &str, setting: &AxisSetting) -> String {
    match setting {
        AxisSetting::Range([low, high]) => format!("{name}={low}:{high}"),
        AxisSetting::Value(value) => format!("{name}={value}"),
        AxisSetting::Text(text) => format!("{name}={text}"),
    }
}

/// Checks the controller that a trainer wrote. Returns what is wrong.
fn check_controller(session: &Session<'_>, path: &Path) -> Result<(), String> {
    let name = path_text(path);
    if !path.exists() {
        return Err(format!("there is no file {name}"));
    }
    refuse_link(path).map_err(|error| error.to_string())?;
    let plan = Plan { controller: name.clone(), ..super::evaluation(session.plan) };
    let unusable = |error: MishandleError| format!("{name} cannot be used: {}", error.with_causes());
    ResolvedPlan::new(&plan).map(drop).map_err(unusable)
}

fn status_text(status: ExitStatus) -> String {
    match (status.code(), status.signal()) {
        (Some(code), _) => format!("failed with exit code {code}"),
        (None, Some(signal)) => format!("was ended by signal {signal}"),
        (None, None) => "failed".to_string(),
    }
}

/// Returns the end of a file, at most `length` bytes, and nothing before `begin`.
fn end(path: &Path, begin: u64, length: u64) -> io::Result<String> {
    let mut file = File::open(path)?;
    let size = fs::metadata(path)?.len();
    file.seek(SeekFrom::Start(size.saturating_sub(length).max(begin)))?;
    let mut bytes = Vec::new();
    file.take(length).read_to_end(&mut bytes)?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

/// Returns the last line of a log that is not empty. Progress bars end theirs with a carriage
/// return.
fn last_line(log: &Path, begin: u64) -> Option<String> {
    let text = end(log, begin, 4 * LINE as u64).ok()?;
    let line = text.split(['\n', '\r']).rfind(|line| !line.trim().is_empty())?;
    Some(line.trim().chars().filter(|c| !c.is_control()).take(LINE).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_line_is_that_of_this_call_and_of_progress_bars() {
        let folder = tempfile::tempdir().unwrap();
        let log = folder.path().join("log");
        for (text, begin, expected) in [
            ("", 0, None),
            ("a\nb\n\n", 0, Some("b")),
            ("a\nb\n", 4, None),
            ("1 %\r  2 %\r", 0, Some("2 %")),
            ("\u{1b}[1mbold", 0, Some("[1mbold")),
        ] {
            fs::write(&log, text).unwrap();
            assert_eq!(last_line(&log, begin).as_deref(), expected, "{text:?}");
        }
        fs::write(&log, format!("{}é", "x".repeat(5000))).unwrap();
        assert_eq!(last_line(&log, 0).unwrap().len(), LINE);
        assert_eq!(end(&log, 0, 4).unwrap(), "xxé");
        assert_eq!(last_line(&folder.path().join("none"), 0), None);
    }

    #[test]
    fn axes_are_given_as_they_are_typed() {
        for (setting, text) in [
            (AxisSetting::Range([0.0, 2.5]), "a=0:2.5"),
            (AxisSetting::Value(-1e-7), "a=-0.0000001"),
            (AxisSetting::Text("[0, 1)".to_string()), "a=[0, 1)"),
            (AxisSetting::Text("pause".to_string()), "a=pause"),
        ] {
            assert_eq!(axis_text("a", &setting), text);
        }
    }
}
