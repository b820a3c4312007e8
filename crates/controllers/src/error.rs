use std::path::PathBuf;

use mishandle_network::NetworkError;

/// Why a controller could not be made, read or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ControllerError {
    /// A file is not a controller that can be used.
    #[error("{problem}: {}", path.display())]
    File {
        /// What is wrong with it.
        problem: FileProblem,
        /// The file.
        path: PathBuf,
    },
    /// The file cannot be read.
    #[error("cannot read the controller {}", path.display())]
    Read {
        /// What the system says.
        source: std::io::Error,
        /// The file.
        path: PathBuf,
    },
    /// The file cannot be written.
    #[error("cannot write the controller {}", path.display())]
    Write {
        /// What the system says.
        source: std::io::Error,
        /// The file.
        path: PathBuf,
    },
    /// A controller that was made for another task.
    #[error("the controller was made for {found}, not for {wanted}")]
    Task {
        /// The task it is to do.
        wanted: String,
        /// The task it was made for.
        found: String,
    },
    /// A controller that takes other observations, or gives other actions, than the environment's.
    #[error("the controller does not fit {task}: {}", differences.join("; "))]
    Layout {
        /// The task it is to do.
        task: String,
        /// Where they differ.
        differences: Vec<String>,
    },
    /// The parts of a policy do not fit each other.
    #[error("the policy's {what} has {found} numbers, its network {wanted}")]
    Size {
        /// Which part.
        what: &'static str,
        /// What the network has.
        wanted: usize,
        /// What the part has.
        found: usize,
    },
    /// A logarithm of a standard deviation is NaN or infinite.
    #[error("the policy's `log_std` must be finite; number {index} is {found}")]
    LogStd {
        /// Its place, counted from 0.
        index: usize,
        /// The number found.
        found: f32,
    },
    /// The network or the normaliser cannot be made.
    #[error(transparent)]
    Network(#[from] NetworkError),
}

/// What is wrong with a controller's file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FileProblem {
    /// It is something else.
    #[error("not a controller ({reason}); wanted is a .safetensors file that `mishandle train` wrote")]
    Foreign {
        /// What shows it.
        reason: String,
    },
    /// Bytes are missing, or there are too many.
    #[error("the controller is damaged: its {found} bytes are not as many as its header says")]
    Length {
        /// Length of the file.
        found: usize,
    },
    /// Its hash is not that of its bytes.
    #[error("the controller is damaged: its bytes are not those that were written; restore it from a copy")]
    Changed,
    /// A header that this program's version should understand, and does not.
    #[error("the controller's header is damaged: {reason}")]
    Header {
        /// What is wrong with it.
        reason: String,
    },
    /// It was written by a later version of the program.
    #[error(
        "the controller has format version {found}, this program reads up to {known}; use a newer program"
    )]
    Newer {
        /// Version of the file.
        found: u64,
        /// Newest version that can be read.
        known: u64,
    },
    /// Its tensors do not make a policy.
    #[error("the controller is damaged: {source}")]
    Policy {
        /// What is wrong with them.
        source: Box<ControllerError>,
    },
}
