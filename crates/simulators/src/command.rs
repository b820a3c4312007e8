//! Commands as a user types them.

use std::path::PathBuf;

use mishandle_process::Program;

use crate::SimulatorError;

/// Returns the program of a command in a folder. Quotes and backslashes split it into words as in a
/// shell; nothing else of a shell has a meaning.
///
/// # Errors
/// If a quote is open, or there is no word.
///
/// # Example
/// ```
/// let program = mishandle_simulators::program("python3 'my sim.py' --fast", ".".into()).unwrap();
/// assert_eq!(program.words, ["python3", "my sim.py", "--fast"]);
/// ```
pub fn program(command: &str, folder: PathBuf) -> Result<Program, SimulatorError> {
    let error = |problem| SimulatorError::Command { command: command.to_string(), problem };
    let words = shlex::split(command).ok_or_else(|| error("has a quote that is not closed"))?;
    match words.first() {
        Some(first) if !first.is_empty() => Ok(Program { words, folder }),
        _ => Err(error("names no program; give one, such as python3 my_simulator.py")),
    }
}
