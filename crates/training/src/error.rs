use std::path::PathBuf;

use mishandle_controllers::ControllerError;
use mishandle_network::NetworkError;
use mishandle_rollout::RolloutError;

/// Why a training cannot start, or cannot go on.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TrainingError {
    /// A setting has a value that it cannot have.
    #[error("{}the setting `{name}` must be {wanted}, found {found}", at(*line))]
    Setting {
        /// Line of the text that states it, counted from 1, if one does.
        line: Option<usize>,
        /// Its table, if it is in one, and its key.
        name: String,
        /// What it has to be.
        wanted: String,
        /// What it is.
        found: String,
        /// The names that it may be, if it is a choice of some.
        known: Vec<&'static str>,
    },
    /// A setting that the algorithm does not have.
    #[error("line {line}: {algorithm} has no setting `{name}`; {}", beside(name, known))]
    UnknownSetting {
        /// Name of the algorithm.
        algorithm: &'static str,
        /// Line of the text, counted from 1.
        line: usize,
        /// Its table, if it is in one, and its key.
        name: String,
        /// The settings there are.
        known: Vec<&'static str>,
    },
    /// The settings' text is not TOML.
    #[error("line {line}: this is not TOML: {message}")]
    NotToml {
        /// Line of the text, counted from 1.
        line: usize,
        /// What the reader says.
        message: String,
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
    /// A checkpoint of a training with other settings.
    #[error(
        "the training began with other settings: {}; go on with those, or begin again",
        listed(differing)
    )]
    OtherSettings {
        /// Of each setting that differs: its table and key, what the training began with, and what is wanted, as TOML.
        differing: Vec<[String; 3]>,
    },
    /// A checkpoint of a training of another length, where what is learned hangs on it.
    #[error(
        "a training that began with `run.total_steps` = {began} cannot go on with {wanted}: {why}, so that from scratch \
         {wanted} steps would give another controller; go on with {began}, or begin again"
    )]
    OtherTotal {
        /// Environment steps that it began with.
        began: u64,
        /// Environment steps that are wanted.
        wanted: u64,
        /// What hangs on them.
        why: &'static str,
    },
    /// A checkpoint of a training that has gone farther than is wanted.
    #[error("the training has {done} environment steps behind it, and cannot end at {wanted}")]
    Done {
        /// Environment steps that it has done.
        done: u64,
        /// Environment steps that are wanted.
        wanted: u64,
    },
    /// A network, an optimiser or a normaliser cannot be made.
    #[error(transparent)]
    Network(#[from] NetworkError),
    /// A policy cannot be made.
    #[error(transparent)]
    Controller(#[from] ControllerError),
    /// The environment batch cannot be made or stepped.
    #[error(transparent)]
    Environment(#[from] RolloutError),
}

fn at(line: Option<usize>) -> String {
    line.map_or_else(String::new, |line| format!("line {line}: "))
}

/// `gamma` = 0.9, now 0.99, ...
fn listed(differing: &[[String; 3]]) -> String {
    let told: Vec<String> =
        differing.iter().map(|[name, began, wanted]| format!("`{name}` {began}, now {wanted}")).collect();
    told.join("; ")
}

/// The settings that there are in the table of one that there is not.
fn beside(name: &str, known: &[&str]) -> String {
    let table = |name: &str| name.rsplit_once('.').map_or(String::new(), |(table, _)| table.to_string());
    let own = table(name);
    let keys: Vec<&str> = known
        .iter()
        .filter(|known| table(known) == own)
        .filter_map(|known| known.rsplit('.').next())
        .collect();
    match (keys.is_empty(), own.is_empty()) {
        (true, _) => format!("there is no table `{own}` either"),
        (false, true) => format!("outside of tables there are: {}", keys.join(", ")),
        (false, false) => format!("[{own}] has: {}", keys.join(", ")),
    }
}
