use std::path::PathBuf;

use crate::process::Failure;

/// Errors of a simulator before its first simulation.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SimulatorError {
    /// The command is not a list of words.
    #[error("the command `{command}` {problem}")]
    Command {
        /// The command.
        command: String,
        /// Problem, and a way out.
        problem: &'static str,
    },
    /// The program does not start, or does not answer.
    #[error("the simulator `{command}`")]
    Program {
        /// The command.
        command: String,
        /// Reason.
        source: Failure,
    },
    /// The program refused to describe itself.
    #[error("the simulator `{command}` answers the question hello with the error: {text}")]
    Refused {
        /// The command.
        command: String,
        /// Its text.
        text: String,
    },
    /// The description is wrong.
    #[error("the simulator `{command}` answers the question hello with {problem}")]
    Hello {
        /// The command.
        command: String,
        /// Problem, and a way out.
        problem: String,
    },
    /// A target file is wrong at a line.
    #[error("{}, line {line}: {message}", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// Number of the line, from 1.
        line: usize,
        /// Problem, and a way out where there is one.
        message: String,
    },
    /// A policy that is a program does not answer as it should.
    #[error("the policy `{command}`: {problem}")]
    Policy {
        /// The command.
        command: String,
        /// Problem, and a way out.
        problem: String,
    },
    /// A file of a program cannot be read.
    #[error("cannot read {} of the program", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Reason.
        source: std::io::Error,
    },
    /// The target is inconsistent.
    #[error(transparent)]
    Target(#[from] mishandle_rollout::RolloutError),
}
