use std::path::PathBuf;

use mishandle_controllers::ControllerError;
use mishandle_network::NetworkError;
use mishandle_rollout::RolloutError;

/// Reason why training cannot start or continue.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TrainingError {
    /// A setting has a value that is not allowed.
    #[error("{}the setting `{name}` must be {expected}, found {found}", at(*line))]
    Setting {
        /// Line of the settings file, counted from 1; `None` if the file does not state the
        /// setting.
        line: Option<usize>,
        /// Table and key.
        name: String,
        /// Allowed values.
        expected: String,
        /// Value found.
        found: String,
        /// Allowed names, if the setting is an enumeration.
        known: Vec<&'static str>,
    },
    /// The algorithm has no setting of this name.
    #[error("line {line}: {algorithm} has no setting `{name}`; {}", settings_of_table(name, known))]
    UnknownSetting {
        /// Name of the algorithm.
        algorithm: &'static str,
        /// Line of the settings file, counted from 1.
        line: usize,
        /// Table and key.
        name: String,
        /// Names of all settings.
        known: Vec<&'static str>,
    },
    /// The environments draw other scenarios than the settings name.
    #[error(
        "the setting `scenarios.{setting}` is {expected}, but the environments have {found}; wrap them in \
         `ScenarioBatches`"
    )]
    OtherScenarios {
        /// Key of the table `[scenarios]`.
        setting: &'static str,
        /// Its value.
        expected: String,
        /// Scenarios of the environments.
        found: String,
    },
    /// Training does not start from the controller that the settings name.
    #[error("the setting `run.from` names {expected}, but training starts from {found}")]
    OtherStart {
        /// The controller of the settings, or none.
        expected: String,
        /// The start that the caller passes.
        found: &'static str,
    },
    /// The policy of a controller cannot continue with these settings.
    #[error(
        "this training cannot start from the controller: its {what} is {found}, that of the settings {expected}"
    )]
    OtherPolicy {
        /// The property that differs.
        what: &'static str,
        /// Its value in the settings.
        expected: String,
        /// Its value in the controller.
        found: String,
    },
    /// The settings are not valid TOML.
    #[error("line {line}: invalid TOML: {message}")]
    NotToml {
        /// Line of the text, counted from 1.
        line: usize,
        /// Message of the TOML parser.
        message: String,
    },
    /// A weight or a loss is NaN or infinite.
    #[error(
        "training diverged in iteration {iteration}: {what} is not finite; try a smaller learning rate or smaller rewards"
    )]
    NotFinite {
        /// Iteration, counted from 1.
        iteration: u64,
        /// The quantity that is NaN or infinite.
        what: &'static str,
    },
    /// The environments lack a reward term that the settings ask for.
    #[error(
        "the setting `rewards.{term}` is {weight}, but the environments have no reward term `{term}`; set it to 0, or \
         train in environments that have this term"
    )]
    MissingRewardTerm {
        /// Name of the term.
        term: &'static str,
        /// Its weight.
        weight: f64,
    },
    /// A checkpoint file cannot be read or written.
    #[error("cannot {verb} the checkpoint {}", path.display())]
    File {
        /// `read` or `write`.
        verb: &'static str,
        /// Error of the operating system.
        source: std::io::Error,
        /// Path of the checkpoint.
        path: PathBuf,
    },
    /// The file is not a checkpoint, or it is damaged.
    #[error("cannot resume from this checkpoint: {reason}; delete the checkpoint to start again")]
    Checkpoint {
        /// Reason.
        reason: String,
    },
    /// The checkpoint belongs to another training run.
    #[error("the checkpoint's {what} is {found}, this training's is {expected}")]
    CheckpointMismatch {
        /// The property that differs.
        what: &'static str,
        /// Its value in this training run.
        expected: String,
        /// Its value in the checkpoint.
        found: String,
    },
    /// The checkpoint belongs to a training run with other settings.
    #[error("the training started with other settings: {}", listed(differing))]
    SettingsMismatch {
        /// For each setting that differs: its name, its value in the checkpoint, and the requested
        /// value, as TOML.
        differing: Vec<[String; 3]>,
    },
    /// The checkpoint belongs to a training run of another length, and the learning depends on the
    /// length.
    #[error(
        "a training that started with `run.total_steps` = {original} cannot resume with {requested}: {reason}, so \
         {requested} steps from scratch would give another controller; resume with {original}, or start again"
    )]
    TotalStepsMismatch {
        /// Total environment steps of the checkpoint.
        original: u64,
        /// Total environment steps requested.
        requested: u64,
        /// Reason why the learning depends on the length.
        reason: &'static str,
    },
    /// The checkpoint already ran more steps than requested.
    #[error("the training already ran {done} environment steps; `run.total_steps` = {requested} is fewer")]
    PastTotalSteps {
        /// Environment steps of the checkpoint.
        done: u64,
        /// Total environment steps requested.
        requested: u64,
    },
    /// A network, an optimizer or a normalizer cannot be created.
    #[error(transparent)]
    Network(#[from] NetworkError),
    /// A policy cannot be created.
    #[error(transparent)]
    Controller(#[from] ControllerError),
    /// The environment batch cannot be created or stepped.
    #[error(transparent)]
    Environment(#[from] RolloutError),
}

fn at(line: Option<usize>) -> String {
    line.map_or_else(String::new, |line| format!("line {line}: "))
}

/// "`gamma` was 0.9, now 0.99; ..."
fn listed(differing: &[[String; 3]]) -> String {
    let parts: Vec<String> =
        differing.iter().map(|[name, old, new]| format!("`{name}` was {old}, now {new}")).collect();
    parts.join("; ")
}

/// Lists the settings in the table of an unknown setting.
fn settings_of_table(name: &str, known: &[&str]) -> String {
    let table = |name: &str| name.rsplit_once('.').map_or(String::new(), |(table, _)| table.to_string());
    let own = table(name);
    let keys: Vec<&str> = known
        .iter()
        .filter(|known| table(known) == own)
        .filter_map(|known| known.rsplit('.').next())
        .collect();
    match (keys.is_empty(), own.is_empty()) {
        (true, _) => format!("there is no table `{own}` either"),
        (false, true) => format!("settings outside of tables: {}", keys.join(", ")),
        (false, false) => format!("settings of [{own}]: {}", keys.join(", ")),
    }
}
