//! Target files of simulators: a command, a time limit, and a policy.

use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::process::Program;
use serde::Deserialize;
use toml::Spanned;

use crate::SimulatorError;
use crate::description::MAX_LIMIT;
use crate::policy::ProgramSettings;

/// Time limit of an answer of a policy, s.
const POLICY_LIMIT: f64 = 10.0;

/// Largest number of numbers that a policy remembers.
const MAX_STATE: usize = 10_000;

/// A target file of a simulator. Its folder is the working folder of its programs.
#[derive(Clone, Debug, PartialEq)]
pub struct SimulatorFile {
    /// The program.
    pub program: Program,
    /// Time limit of an answer, instead of that of the simulator.
    pub time_limit: Option<Duration>,
    /// The policy.
    pub policy: FilePolicy,
}

/// The policy that a target file of a simulator names.
#[derive(Clone, Debug, PartialEq)]
pub enum FilePolicy {
    /// None: `--controller` gives one, if the simulator has a policy.
    Open,
    /// A file beside the target file: an ONNX model or a controller.
    File {
        /// Its path.
        path: PathBuf,
        /// Names of the input and the output of an ONNX model.
        interface: [Option<String>; 2],
    },
    /// A program that answers each observation.
    Program(ProgramSettings),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    format: Option<Spanned<i64>>,
    process: Spanned<Vec<String>>,
    time_limit: Option<Spanned<f64>>,
    policy: Option<Spanned<PolicyTable>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PolicyTable {
    onnx: Option<String>,
    controller: Option<String>,
    input: Option<String>,
    output: Option<String>,
    process: Option<Spanned<Vec<String>>>,
    time_limit: Option<Spanned<f64>>,
    state: Option<Spanned<usize>>,
}

/// A problem at a byte of the text.
struct Problem(usize, String);

impl SimulatorFile {
    /// Reads the text of a target file; `None` if it has no key `process`, as that of a robot.
    ///
    /// # Errors
    /// [`SimulatorError::Line`], which names the line.
    pub fn parse(path: &Path, text: &str) -> Result<Option<SimulatorFile>, SimulatorError> {
        // A text that is not TOML is a robot's, whose error names the line.
        let Ok(table) = text.parse::<toml::Table>() else { return Ok(None) };
        if !table.contains_key("process") {
            return Ok(None);
        }
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        let folder = folder.unwrap_or(Path::new("."));
        read(text, folder).map(Some).map_err(|Problem(place, message)| {
            let before = text.get(..place.min(text.len())).unwrap_or(text);
            let line = before.matches('\n').count() + 1;
            SimulatorError::Line { path: path.to_path_buf(), line, message }
        })
    }
}

fn read(text: &str, folder: &Path) -> Result<SimulatorFile, Problem> {
    let document: Document = toml::from_str(text)
        .map_err(|error| Problem(error.span().unwrap_or_default().start, error.message().to_string()))?;
    if let Some(format) = document.format.filter(|format| *format.get_ref() != 1) {
        let message = format!("`format` is {}; this program reads 1", format.get_ref());
        return Err(Problem(format.span().start, message));
    }
    let words = words(document.process, "[\"python3\", \"my_simulator.py\"]")?;
    Ok(SimulatorFile {
        program: Program { words, folder: folder.to_path_buf() },
        time_limit: document.time_limit.as_ref().map(seconds).transpose()?,
        policy: document.policy.map_or(Ok(FilePolicy::Open), |table| policy(table, folder))?,
    })
}

fn policy(table: Spanned<PolicyTable>, folder: &Path) -> Result<FilePolicy, Problem> {
    let place = table.span().start;
    let PolicyTable { onnx, controller, input, output, process, time_limit, state } = table.into_inner();
    if process.is_none() && (time_limit.is_some() || state.is_some()) {
        let message = "`time_limit` and `state` of [policy] belong to `process`".to_string();
        return Err(Problem(place, message));
    }
    if onnx.is_none() && (input.is_some() || output.is_some()) {
        return Err(Problem(place, "`input` and `output` belong to `onnx`".to_string()));
    }
    match (onnx, controller, process) {
        (Some(file), None, None) => {
            Ok(FilePolicy::File { path: folder.join(file), interface: [input, output] })
        }
        (None, Some(file), None) => Ok(FilePolicy::File { path: folder.join(file), interface: [None, None] }),
        (None, None, Some(process)) => {
            let state = match state {
                Some(state) if *state.get_ref() > MAX_STATE => {
                    let message = format!("`state` must be at most {MAX_STATE}");
                    return Err(Problem(state.span().start, message));
                }
                state => state.map_or(0, Spanned::into_inner),
            };
            Ok(FilePolicy::Program(ProgramSettings {
                words: words(process, "[\"python3\", \"my_policy.py\"]")?,
                time_limit: time_limit
                    .as_ref()
                    .map_or(Ok(Duration::from_secs_f64(POLICY_LIMIT)), seconds)?,
                state,
            }))
        }
        _ => Err(Problem(
            place,
            "[policy] takes one of `onnx`, `controller` and `process`; leave the table out if each question has a policy \
             of its own"
                .to_string(),
        )),
    }
}

fn words(words: Spanned<Vec<String>>, example: &str) -> Result<Vec<String>, Problem> {
    match words.get_ref().first() {
        Some(first) if !first.is_empty() => Ok(words.into_inner()),
        _ => Err(Problem(words.span().start, format!("`process` needs a program, such as {example}"))),
    }
}

fn seconds(limit: &Spanned<f64>) -> Result<Duration, Problem> {
    match *limit.get_ref() {
        seconds if seconds > 0.0 && seconds <= MAX_LIMIT => Ok(Duration::from_secs_f64(seconds)),
        _ => Err(Problem(
            limit.span().start,
            format!("`time_limit` must be more than 0 and at most {MAX_LIMIT} s"),
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Option<SimulatorFile>, SimulatorError> {
        SimulatorFile::parse(Path::new("sims/tank.toml"), text)
    }

    #[test]
    fn a_file_has_a_command_in_its_folder() {
        let text = "process = [\"python3\", \"tank.py\"]\ntime_limit = 5\n[policy]\nonnx = \"p.onnx\"\n";
        let file = parse(text).expect("a file").expect("a simulator");
        assert_eq!(file.program.words, ["python3", "tank.py"]);
        assert_eq!(file.program.folder, Path::new("sims"));
        assert_eq!(file.time_limit, Some(Duration::from_secs(5)));
        let path = PathBuf::from("sims/p.onnx");
        assert_eq!(file.policy, FilePolicy::File { path, interface: [None, None] });
        assert!(parse("name = \"robot\"\n").expect("another file").is_none());
    }

    #[test]
    fn every_mistake_names_its_line() {
        for (text, line, expected) in [
            ("process = []", 1, "needs a program"),
            ("# a tank\nprocess = 3", 2, "expected"),
            ("process = [\"a\"]\nmodel = \"m.xml\"", 2, "unknown field `model`"),
            ("process = [\"a\"]\n\ntime_limit = 0", 3, "more than 0"),
            ("process = [\"a\"]\nformat = 2", 2, "reads 1"),
            ("process = [\"a\"]\n[policy]\nonnx = \"a\"\nprocess = [\"b\"]", 2, "takes one of"),
            ("process = [\"a\"]\n[policy]\nprocess = [\"b\"]\nstate = 100000", 4, "at most"),
        ] {
            let error = parse(text).expect_err(text).to_string();
            assert!(
                error.contains(&format!("tank.toml, line {line}: ")) && error.contains(expected),
                "{error}"
            );
        }
    }
}
