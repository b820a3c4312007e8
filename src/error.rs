//! Errors of plans and of the runs that execute them.

mod curve;
mod output;
mod run;

use std::borrow::Cow;
use std::error::Error;
use std::fmt::Display;
use std::io;
use std::iter::successors;
use std::path::{Path, PathBuf};

use mishandle_results::Remedy;

pub use curve::CurveProblem;
pub(crate) use output::{exists, foreign_folder};
pub use run::{Compared, RunError};
pub(crate) use run::{changed, other_request};

/// An error in a plan or its arguments, or in the run that executes it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MishandleError {
    /// The name is unknown.
    #[error("there is no {kind} `{name}`; choose from: {}", names(known))]
    UnknownName {
        /// Kind of the named object, such as `task`.
        kind: &'static str,
        /// Name given by the user.
        name: String,
        /// Known names.
        known: Vec<String>,
    },
    /// The target is a path, but not that of a target file.
    #[error(
        "{}; a target is a name such as ball-balancing, or the path of a target file (.toml)",
        not_a_target(name)
    )]
    NotATarget {
        /// The path.
        name: String,
    },
    /// A file names a program that the user has not allowed.
    #[error(
        "the {role} is the program `{command}`, which a file names; if you trust the file, allow it with {variable}=1 in \
         the environment"
    )]
    ProgramNotAllowed {
        /// Simulator, policy or trainer.
        role: &'static str,
        /// Command of the program.
        command: String,
        /// Variable of the environment that allows programs.
        variable: &'static str,
    },
    /// A simulation that decides something has no verdict.
    #[error("the simulation has no verdict: {why}")]
    NoVerdict {
        /// Why it has none.
        why: String,
    },
    /// The plan is not valid TOML.
    #[error("line {line} of the plan, `{found}`, is not valid TOML: {message}")]
    PlanSyntax {
        /// Line of the plan, counted from 1.
        line: usize,
        /// The line, or the start of a long one.
        found: String,
        /// Message of the TOML parser.
        message: String,
    },
    /// There is no key with this name.
    #[error("{}there is no key `{key}`; known keys are: {}", place(*line), keys_beside(key, known))]
    UnknownKey {
        /// Line of the plan, counted from 1, if a file has the key.
        line: Option<usize>,
        /// Table and key.
        key: String,
        /// All keys.
        known: Vec<&'static str>,
    },
    /// A key has a value of the wrong type.
    #[error("{}the key `{key}` is {found}; it must be {expected}", place(*line))]
    KeyValue {
        /// Line of the plan, counted from 1, if a file has the key.
        line: Option<usize>,
        /// Table and key.
        key: String,
        /// The value as written.
        found: String,
        /// Allowed values.
        expected: String,
    },
    /// The plan lacks the table of the command.
    #[error(
        "cannot {table}: the plan has no table [{table}]; add it, or resume a run with the command that made it"
    )]
    MissingPlanTable {
        /// Name of the missing table.
        table: &'static str,
    },
    /// A value is not allowed.
    #[error("{what} is {value}; it must be {expected}")]
    InvalidValue {
        /// Meaning of the value.
        what: Cow<'static, str>,
        /// Value given by the user.
        value: String,
        /// Allowed values.
        expected: Cow<'static, str>,
        /// Ways to avoid it.
        remedies: Vec<Remedy>,
    },
    /// The question cannot be answered as it is asked.
    #[error("{problem}")]
    Invalid {
        /// The reason.
        problem: String,
        /// Ways to avoid it.
        remedies: Vec<Remedy>,
    },
    /// An error in a part of a question, such as a requirement.
    #[error("{part}")]
    Of {
        /// The part.
        part: String,
        /// Ways to avoid it, beside the remedies of the cause.
        remedies: Vec<Remedy>,
        /// Cause of the error.
        source: Box<MishandleError>,
    },
    /// The program lacks the device of a plan.
    #[error(
        "the device `{device}` needs the Python package with its extra: run pip install '.[gpu]' in a clone of Mishandle, then \
         the package's command `mishandle`"
    )]
    NoDevice {
        /// Name of the device.
        device: String,
    },
    /// A file cannot be read or written.
    #[error("{}", path.display())]
    File {
        /// Path of the file.
        path: PathBuf,
        /// Error of the operating system.
        source: io::Error,
    },
    /// An output cannot be written.
    #[error("cannot write the {what} {}", path.display())]
    Write {
        /// Kind of output.
        what: &'static str,
        /// Path of the output.
        path: PathBuf,
        /// Error of the operating system.
        source: io::Error,
    },
    /// The CSV file of a learning curve is damaged, or belongs to another training run.
    #[error("{}: {problem}", path.display())]
    Curve {
        /// Path of the file.
        path: PathBuf,
        /// Cause of the error.
        problem: CurveProblem,
    },
    /// A run is not what its plan says, or gives no answer.
    #[error(transparent)]
    Run(#[from] RunError),
    /// An answer is that of another question.
    #[error(transparent)]
    OtherQuestion(#[from] mishandle_results::OtherQuestion),
    /// A controller file is damaged, is not a controller, or is for another task.
    #[error(transparent)]
    Controller(#[from] mishandle_controllers::ControllerError),
    /// A policy in the format of another tool cannot be used.
    #[error(transparent)]
    Interchange(#[from] mishandle_interchange::InterchangeError),
    /// A guard cannot be made.
    #[error(transparent)]
    Guard(#[from] mishandle_controllers::guard::GuardError),
    /// The scene of pictures cannot be built or drawn.
    #[error(transparent)]
    World(#[from] mishandle_world::WorldError),
    /// A picture cannot be drawn by ray casting.
    #[error(transparent)]
    Camera(#[from] mishandle_camera::CameraError),
    /// A task cannot be built.
    #[error(transparent)]
    Task(#[from] mishandle_tasks::TaskError),
    /// A target file is wrong.
    #[error(transparent)]
    Robot(Box<mishandle_robots::RobotError>),
    /// A simulator that is a program does not work.
    #[error(transparent)]
    Simulator(#[from] mishandle_simulators::SimulatorError),
    /// Episodes cannot run.
    #[error(transparent)]
    Rollout(#[from] mishandle_rollout::RolloutError),
    /// An evaluation cannot run.
    #[error(transparent)]
    Evaluation(#[from] mishandle_evaluation::EvaluationError),
    /// A failure probability cannot be estimated.
    #[error(transparent)]
    Risk(#[from] mishandle_risk::RiskError),
    /// A falsification cannot run.
    #[error(transparent)]
    Falsification(#[from] mishandle_falsification::FalsificationError),
    /// A training run cannot start or continue.
    #[error(transparent)]
    Training(#[from] mishandle_training::TrainingError),
    /// A search cannot be constructed.
    #[error(transparent)]
    Search(#[from] mishandle_search::SearchError),
    /// A run file cannot be read or written.
    #[error(transparent)]
    Store(#[from] mishandle_store::StoreError),
}

impl From<mishandle_robots::RobotError> for MishandleError {
    fn from(error: mishandle_robots::RobotError) -> MishandleError {
        MishandleError::Robot(Box::new(error))
    }
}

/// Returns the error of a value that is not allowed.
pub(crate) fn invalid(
    what: impl Into<Cow<'static, str>>,
    value: impl Display,
    expected: impl Into<Cow<'static, str>>,
) -> MishandleError {
    let (what, value, expected) = (what.into(), value.to_string(), expected.into());
    MishandleError::InvalidValue { what, value, expected, remedies: Vec::new() }
}

/// Returns the error of a question that cannot be answered for a reason.
pub(crate) fn problem(text: impl Into<String>) -> MishandleError {
    MishandleError::Invalid { problem: text.into(), remedies: Vec::new() }
}

/// Returns the error of an option that only tasks have.
pub(crate) fn unsupported(target: impl Display, option: impl Display) -> MishandleError {
    problem(format!("{target} does not support {option}; only tasks do"))
}

impl MishandleError {
    /// Returns a function that adds the path of a file to an error of the operating system.
    pub fn file(path: &Path) -> impl Fn(io::Error) -> MishandleError + Copy {
        move |source| MishandleError::File { path: path.to_path_buf(), source }
    }

    /// Returns a function that adds kind and path of an output to an error of the operating system.
    pub fn write(what: &'static str, path: &Path) -> impl Fn(io::Error) -> MishandleError + Copy {
        move |source| MishandleError::Write { what, path: path.to_path_buf(), source }
    }

    /// Returns the error that something differs between a run and what continues or repeats it.
    pub fn differs(whose: Compared, differences: Vec<String>) -> MishandleError {
        RunError::Differs { whose, differences }.into()
    }

    /// Returns the error as that of a part of the question.
    #[must_use]
    pub fn of(self, part: impl Into<String>) -> MishandleError {
        MishandleError::Of { part: part.into(), remedies: Vec::new(), source: Box::new(self) }
    }

    /// Adds a remedy to an error that this crate states.
    #[must_use]
    pub(crate) fn with(mut self, remedy: Remedy) -> MishandleError {
        match &mut self {
            MishandleError::InvalidValue { remedies, .. }
            | MishandleError::Invalid { remedies, .. }
            | MishandleError::Of { remedies, .. } => remedies.push(remedy),
            _ => debug_assert!(false, "{self} has its own remedies"),
        }
        self
    }

    /// Returns whether the question of the caller is the reason, not a run, a file or the system.
    pub fn is_of_caller(&self) -> bool {
        !matches!(
            self,
            MishandleError::Store(_)
                | MishandleError::Run(_)
                | MishandleError::File { .. }
                | MishandleError::Write { .. }
        )
    }

    /// Returns the text of the error with those of its causes, the outermost first. A cause that
    /// the text contains already is left out.
    pub fn with_causes(&self) -> String {
        let causes = successors(Some(self as &dyn Error), |error| (*error).source());
        causes.map(ToString::to_string).fold(String::new(), |text, cause| match text.as_str() {
            "" => cause,
            known if known.ends_with(&cause) => text,
            known => format!("{known}: {cause}"),
        })
    }
}

/// Largest number of known names that an error lists.
const LISTED: usize = 12;

/// Names the line of a plan.
fn place(line: Option<usize>) -> String {
    line.map_or_else(String::new, |line| format!("line {line} of the plan: "))
}

/// Says why a path is not a target.
fn not_a_target(name: &str) -> String {
    if Path::new(name).exists() {
        format!("{name} is not a target file")
    } else {
        format!("no such file: {name}")
    }
}

/// Lists known names, the first ones if they are many.
fn names(known: &[String]) -> String {
    match known.len().saturating_sub(LISTED) {
        0 => known.join(", "),
        more => format!("{}, and {more} more", known[..LISTED].join(", ")),
    }
}

/// Lists the known keys in the table of an unknown key. The keys outside of tables include the
/// names of the tables.
fn keys_beside(key: &str, known: &[&'static str]) -> String {
    let table = key.rsplit_once('.').map_or(String::new(), |(table, _)| format!("{table}."));
    let beside = known.iter().filter_map(|known| known.strip_prefix(table.as_str()));
    let mut names: Vec<&str> = beside.map(|key| key.split('.').next().unwrap_or(key)).collect();
    names.dedup();
    names.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The Python package raises an error of the caller as a `ValueError`, too.
    #[test]
    fn errors_of_runs_and_files_are_not_those_of_the_caller() {
        let path = Path::new("a.sqlite");
        let denied = || io::Error::from(io::ErrorKind::PermissionDenied);
        let differs = |whose| MishandleError::differs(whose, vec!["seed".to_string()]);
        let (number, name) = (2, "a".to_string());
        for error in [
            MishandleError::file(path)(denied()),
            MishandleError::write("folder", path)(denied()),
            mishandle_store::StoreError::Write { what: name.clone(), source: denied() }.into(),
            differs(Compared::Settings),
            differs(Compared::Plan),
            differs(Compared::Build),
            differs(Compared::System),
            other_request("simulation", number),
            RunError::Changed { problem: name.clone() }.into(),
            RunError::Components { target: name.clone(), recorded: name.clone(), found: name.clone() }.into(),
            RunError::ForeignTarget { name: name.clone() }.into(),
            RunError::NoEpisode.into(),
            RunError::NothingRuns { count: 1, end: name.clone() }.into(),
        ] {
            assert!(!error.is_of_caller(), "{error}");
        }
        for error in [
            MishandleError::UnknownName { kind: "task", name: name.clone(), known: Vec::new() },
            MishandleError::NotATarget { name: name.clone() },
            MishandleError::MissingPlanTable { table: "evaluate" },
            MishandleError::NoDevice { device: name.clone() },
            MishandleError::busy("check", path, mishandle_results::Key::OUT),
            MishandleError::file(path)(denied()).of("requirement `a`"),
            exists(path, mishandle_results::Key::OUT),
            foreign_folder("check", path, &name),
            invalid("the value", 1, "2"),
            problem("no"),
            unsupported(&name, &name),
            mishandle_rollout::RolloutError::Ended.into(),
        ] {
            assert!(error.is_of_caller(), "{error}");
        }
    }
}
