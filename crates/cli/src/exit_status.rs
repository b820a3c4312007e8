//! How a command ends.

/// Result of a command that ended without an error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExitStatus {
    /// The command finished, and no formula was violated.
    Done,
    /// The command found a counterexample or a violated formula.
    Violated,
    /// A signal interrupted the command, which has saved its finished work.
    Interrupted,
}
