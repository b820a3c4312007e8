use std::path::PathBuf;

use mishandle_controllers::ControllerError;
use mishandle_network::NetworkError;

/// Why a training cannot start, or cannot go on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TrainingError {
    /// A setting is out of its range.
    #[error("the setting `{name}` must be {wanted}, found {found}")]
    Setting {
        /// Name of the setting.
        name: &'static str,
        /// What it has to be.
        wanted: &'static str,
        /// What it is.
        found: String,
    },
    /// The settings' text is not TOML, or has a key that is not known, or a value of another type.
    #[error("the settings cannot be read: line {line}: {message}")]
    Settings {
        /// Line of the text, counted from 1.
        line: usize,
        /// What the reader says.
        message: String,
    },
    /// A preset that the algorithm does not have.
    #[error("{algorithm} has no preset `{found}`; it has: {}", known.join(", "))]
    Preset {
        /// Name of the algorithm.
        algorithm: &'static str,
        /// Name of the preset.
        found: String,
        /// Names of those it has.
        known: Vec<&'static str>,
    },
    /// Weights or losses are no longer finite.
    #[error(
        "training broke down in iteration {iteration}: {what} is not finite; a smaller learning rate, or rewards \
         of smaller size, may help"
    )]
    NotFinite {
        /// Iteration, counted from 1.
        iteration: u64,
        /// What is NaN or infinite.
        what: &'static str,
    },
    /// A checkpoint's file cannot be read or written.
    #[error("cannot {verb} the checkpoint {}", path.display())]
    File {
        /// `read` or `write`.
        verb: &'static str,
        /// What the system says.
        source: std::io::Error,
        /// The file.
        path: PathBuf,
    },
    /// A file that is no checkpoint, or a damaged one.
    #[error("not a checkpoint that can be resumed: {reason}")]
    Checkpoint {
        /// What shows it.
        reason: String,
    },
    /// A checkpoint of another training.
    #[error("the checkpoint's {what} is {found}, this training's is {wanted}")]
    OtherTraining {
        /// What differs.
        what: &'static str,
        /// What is wanted.
        wanted: String,
        /// What the checkpoint has.
        found: String,
    },
    /// A network, an optimiser or a normaliser cannot be made.
    #[error(transparent)]
    Network(#[from] NetworkError),
    /// A policy cannot be made.
    #[error(transparent)]
    Controller(#[from] ControllerError),
}
