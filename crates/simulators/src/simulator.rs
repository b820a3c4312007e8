//! A simulator: its command, its description and its running processes.

use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use crate::process::{Failure, Program};
use mishandle_rollout::RolloutError;
use rayon::prelude::*;

use crate::SimulatorError;
use crate::description::Description;
use crate::hello::Hello;
use crate::program::{command_text, program_hash, word_files};
use crate::worker::{NoStart, SimulatorProcess};

/// A simulator that has described itself. Its processes live as long as it does: they are shared by
/// all systems of its target, and each simulation takes one of them.
pub struct Simulator {
    program: Program,
    hello: Hello,
    description: Description,
    hash: String,
    /// Processes that no simulation uses.
    free: Mutex<Vec<SimulatorProcess>>,
}

/// A simulation without a process.
pub(crate) enum NoProcess {
    /// The simulation fails, and the next one tries again.
    Failed(Failure),
    /// The run ends.
    Ends(RolloutError),
}

impl Simulator {
    /// Starts a program and asks it for its description. `time_limit` replaces the one that it
    /// states.
    ///
    /// # Errors
    /// If the program does not start or answer, its description is wrong, or a file that it names
    /// cannot be read.
    pub fn start(program: Program, time_limit: Option<Duration>) -> Result<Simulator, SimulatorError> {
        let command = command_text(&program);
        let malformed = |problem: String| SimulatorError::Hello { command: command.clone(), problem };
        let (process, hello) = SimulatorProcess::start(&program).map_err(|why| match why {
            NoStart::Failed(source) => SimulatorError::Program { command: command.clone(), source },
            NoStart::Refused(text) => SimulatorError::Refused { command: command.clone(), text },
            NoStart::Malformed(problem) => malformed(problem),
        })?;
        let mut description = Description::new(&hello).map_err(malformed)?;
        description.time_limit = time_limit.unwrap_or(description.time_limit);
        let hash = hash(&program, &hello, &files(&program, &description))?;
        Ok(Simulator { program, hello, description, hash, free: Mutex::new(vec![process]) })
    }

    /// Returns the description.
    pub fn description(&self) -> &Description {
        &self.description
    }

    /// Returns the command as a user would type it.
    pub fn command(&self) -> String {
        command_text(&self.program)
    }

    /// Returns the files whose bytes belong to the hash: words of the command that are files, and
    /// those that the description names.
    pub fn files(&self) -> Vec<PathBuf> {
        files(&self.program, &self.description)
    }

    /// Returns the hash of the command, its files and the description.
    pub fn hash(&self) -> &str {
        &self.hash
    }

    /// Takes a process for one simulation, or starts one.
    pub(crate) fn take(&self) -> Result<SimulatorProcess, NoProcess> {
        let free = self.free.lock().unwrap_or_else(PoisonError::into_inner).pop();
        match free {
            Some(process) => Ok(process),
            None => self.start_another(),
        }
    }

    /// Starts a process, which must say of itself what the first one said.
    pub(crate) fn start_another(&self) -> Result<SimulatorProcess, NoProcess> {
        let malformed = |what| NoProcess::Failed(Failure::Malformed { what, stderr: String::new() });
        match SimulatorProcess::start(&self.program) {
            Ok((process, hello)) if hello == self.hello => Ok(process),
            Ok(_) => Err(NoProcess::Ends(RolloutError::System(format!(
                "`{}` describes itself otherwise than when it was first started; all processes of a command must answer \
                 hello with the same text",
                self.command()
            )))),
            Err(NoStart::Failed(failure)) => Err(NoProcess::Failed(failure)),
            Err(NoStart::Refused(text)) => Err(malformed(format!("the error `{text}` for hello"))),
            Err(NoStart::Malformed(problem)) => Err(malformed(problem)),
        }
    }

    /// Gives a process back that answered its last question.
    pub(crate) fn give_back(&self, process: SimulatorProcess) {
        self.free.lock().unwrap_or_else(PoisonError::into_inner).push(process);
    }
}

impl Drop for Simulator {
    fn drop(&mut self) {
        // Together: each of them may take a moment to end.
        let processes = std::mem::take(self.free.get_mut().unwrap_or_else(PoisonError::into_inner));
        processes.into_par_iter().for_each(drop);
    }
}

impl std::fmt::Debug for Simulator {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Simulator").field("program", &self.program).finish_non_exhaustive()
    }
}

/// Returns the words of the command that are files, and the files that the description names.
fn files(program: &Program, description: &Description) -> Vec<PathBuf> {
    let mut files = word_files(program);
    for path in description.files.iter().map(|name| program.folder.join(name)) {
        if !files.contains(&path) {
            files.push(path);
        }
    }
    files
}

/// Returns the hash of words, files and description. A run records versions of software apart.
fn hash(program: &Program, hello: &Hello, files: &[PathBuf]) -> Result<String, SimulatorError> {
    let hello = Hello { versions: Default::default(), time_limit: None, ..hello.clone() };
    program_hash(program, &serde_json::json!(hello).to_string(), files)
}
