use std::time::Duration;

use crate::process::Program;

/// Why a program did not answer.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Failure {
    /// The program cannot be started.
    #[error("cannot start `{program}`: {source}")]
    Start {
        /// First word of the command.
        program: String,
        /// Reason.
        source: std::io::Error,
    },
    /// The program ended, or closed its input or output.
    #[error("the program ended before its answer{}", said(stderr))]
    Ended {
        /// Last lines of its standard error.
        stderr: String,
    },
    /// The program took too long.
    #[error("the program did not answer within {} s{}", limit.as_secs_f64(), said(stderr))]
    TimedOut {
        /// Time limit.
        limit: Duration,
        /// Last lines of its standard error.
        stderr: String,
    },
    /// The caller stopped the wait.
    #[error("the wait for the program was interrupted")]
    Interrupted,
    /// The program wrote something else than one line of text.
    #[error("the program wrote {what}{}", said(stderr))]
    Malformed {
        /// Description of what it wrote.
        what: String,
        /// Last lines of its standard error.
        stderr: String,
    },
}

impl Failure {
    pub(crate) fn start(program: &Program, source: std::io::Error) -> Failure {
        Failure::Start { program: program.words.first().cloned().unwrap_or_default(), source }
    }
}

/// Returns the end of a sentence with the standard error of the program.
fn said(stderr: &str) -> String {
    match stderr.trim_end() {
        "" => String::new(),
        text => format!("; its standard error: {text}"),
    }
}
