//! Commands as a user types them, and their identity.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use crate::process::Program;
use sha2::{Digest, Sha256};

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

/// Returns the command of a program as a user would type it.
pub(crate) fn command_text(program: &Program) -> String {
    shlex::try_join(program.words.iter().map(String::as_str)).unwrap_or_else(|_| program.words.join(" "))
}

/// Returns the words of the command that are files in its folder.
pub(crate) fn word_files(program: &Program) -> Vec<PathBuf> {
    let words = program.words.iter().map(|word| program.folder.join(word));
    words.filter(|path| path.is_file()).collect()
}

/// Returns the hash of the words of a program, of a text about it and of its files.
pub(crate) fn program_hash(
    program: &Program,
    about: &str,
    files: &[PathBuf],
) -> Result<String, SimulatorError> {
    let mut hash = Sha256::new();
    hash.update(format!("{:?}\n{about}\n", program.words));
    for path in files {
        let read = |source| SimulatorError::Read { path: path.clone(), source };
        hash.update(file_hash(path).map_err(read)?);
    }
    Ok(hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect())
}

/// Returns the hash of a file of any length.
fn file_hash(path: &Path) -> std::io::Result<[u8; 32]> {
    if !path.is_file() {
        return Err(std::io::Error::other("it is not a file"));
    }
    let mut file = File::open(path)?;
    let mut buffer = vec![0; 1 << 16];
    let mut hash = Sha256::new();
    loop {
        match file.read(&mut buffer)? {
            0 => return Ok(hash.finalize().into()),
            count => hash.update(&buffer[..count]),
        }
    }
}
