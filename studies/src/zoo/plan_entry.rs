//! The state of each training run of the plan, and why it is not done.

use std::fmt;
use std::path::Path;

use mishandle::MishandleError;
use mishandle::files::{limits, read_text_bounded};
use mishandle::train::Curve;
use mishandle::training::AlgorithmSettings;
use serde_json::json;

use crate::zoo::folder::{ZooFolder, read};
use crate::zoo::provenance::file_hash;
use crate::zoo::{BenchmarkTask, Conditions, Record, Training, TrainingInputs, TrainingSummary, ZooError};

/// The state of a training run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum TrainingState {
    /// Trained and measured.
    Done,
    /// Trained and evaluated; the falsification is missing.
    NeedsFalsification,
    /// Trained, but not measured under the present conditions.
    NeedsMeasurement {
        /// Why.
        reason: String,
    },
    /// Not trained as it would be now.
    NeedsTraining {
        /// Why.
        reason: String,
    },
    /// The same, and a checkpoint exists.
    Interrupted {
        /// Why the training run is needed.
        reason: String,
        /// Environment steps that the curve has.
        steps: Option<u64>,
    },
    /// The repository has no settings file for it.
    NoSettings,
}

impl TrainingState {
    /// Returns the state as one word, for programs.
    pub fn name(&self) -> &'static str {
        match self {
            TrainingState::Done => "done",
            TrainingState::NeedsFalsification => "needs-falsification",
            TrainingState::NeedsMeasurement { .. } => "needs-measurement",
            TrainingState::NeedsTraining { .. } => "needs-training",
            TrainingState::Interrupted { .. } => "interrupted",
            TrainingState::NoSettings => "no-settings",
        }
    }

    /// Returns why the training run is not done; `None` if it is.
    pub fn reason(&self) -> Option<&str> {
        match self {
            TrainingState::Done => None,
            TrainingState::NeedsFalsification => Some("no falsification"),
            TrainingState::NoSettings => Some("no settings file"),
            TrainingState::NeedsMeasurement { reason }
            | TrainingState::NeedsTraining { reason }
            | TrainingState::Interrupted { reason, .. } => Some(reason),
        }
    }

    /// Returns whether a controller exists that was trained as it would be now.
    pub fn is_trained(&self) -> bool {
        self.is_measured() || matches!(self, TrainingState::NeedsMeasurement { .. })
    }

    /// Returns whether the controller is also evaluated under the present conditions.
    pub(crate) fn is_measured(&self) -> bool {
        matches!(self, TrainingState::Done | TrainingState::NeedsFalsification)
    }
}

impl fmt::Display for TrainingState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            TrainingState::Done => write!(f, "done"),
            TrainingState::NeedsFalsification => write!(f, "needs falsification"),
            TrainingState::NeedsMeasurement { reason } => write!(f, "needs measurement: {reason}"),
            TrainingState::NeedsTraining { reason } => write!(f, "needs training: {reason}"),
            TrainingState::Interrupted { reason, steps: Some(steps) } => {
                write!(
                    f,
                    "needs training: {reason}; checkpoint exists, curve up to {steps} environment steps"
                )
            }
            TrainingState::Interrupted { reason, steps: None } => {
                write!(f, "needs training: {reason}; checkpoint exists")
            }
            TrainingState::NoSettings => write!(f, "no settings file"),
        }
    }
}

/// A training run of the plan with its state.
#[derive(Clone, Debug)]
pub struct PlanEntry {
    /// The training run.
    pub training: Training,
    /// Present versions of everything that it depends on.
    pub expected: TrainingInputs,
    /// Its state.
    pub state: TrainingState,
    /// How its controller was trained, if it exists.
    pub summary: Option<TrainingSummary>,
    /// Its record, if it exists.
    pub record: Option<Record>,
    /// Whether the record on disk lacks something that `record` has: an adoption, or defaults of
    /// new settings.
    pub record_is_stale: bool,
}

impl PlanEntry {
    /// Returns how long its last training run took, s; infinite if unknown.
    pub(crate) fn wall_clock_secs(&self) -> f64 {
        self.summary.as_ref().map_or(f64::INFINITY, |summary| summary.record.wall_clock_secs)
    }
}

/// The reason for a training run without a controller.
const NO_CONTROLLER: &str = "no controller";

/// Returns what a training run depends on now.
///
/// # Errors
/// If the settings file cannot be read or has an unknown setting.
pub(crate) fn expected(
    folder: &ZooFolder,
    task: &BenchmarkTask,
    training: &Training,
) -> Result<TrainingInputs, ZooError> {
    let path = folder.settings(training);
    let settings = if path.is_file() { Some(full_settings(&path, training)?) } else { None };
    Ok(TrainingInputs { settings, ..TrainingInputs::without_settings(task) })
}

impl TrainingInputs {
    /// Returns what a training run on `task` depends on besides its settings.
    pub(crate) fn without_settings(task: &BenchmarkTask) -> TrainingInputs {
        let task_hash = task.task_hash.clone();
        let layout_hash = task.layout_hash.clone();
        TrainingInputs { settings: None, task_hash, layout_hash }
    }
}

/// Reads a settings file and adds the defaults.
fn full_settings(path: &Path, training: &Training) -> Result<String, ZooError> {
    let text = String::from_utf8_lossy(&read(path)?).into_owned();
    let unknown = || MishandleError::UnknownName {
        kind: "training algorithm",
        name: training.algorithm.clone(),
        known: crate::zoo::algorithms().map(String::from).collect(),
    };
    let config = AlgorithmSettings::from_toml(&training.algorithm, &text).ok_or_else(unknown)?;
    let config = config.and_then(|config| config.check().map(|()| config));
    let config = config.map_err(|error| MishandleError::from(error).of(path.display().to_string()))?;
    Ok(config.to_toml())
}

/// Finds the state of a training run. With `adopt`, a controller that differs in its task alone
/// counts as trained.
///
/// # Errors
/// If a file cannot be read.
pub(crate) fn entry(
    folder: &ZooFolder,
    task: &BenchmarkTask,
    training: &Training,
    expected: TrainingInputs,
    adopt: bool,
) -> Result<PlanEntry, ZooError> {
    let mut record = Record::load(folder, &training.task, &training.algorithm)?;
    let path = folder.controller(training);
    let hash = if path.is_file() { Some(file_hash(&path)?) } else { None };
    let is_recorded = hash.is_some() && record.as_ref().is_some_and(|record| record.file_hash == hash);
    let mut summary = match &record {
        Some(record) if is_recorded => record.training.clone(),
        _ => None,
    };
    let mut reasons = vec![NO_CONTROLLER.to_string()];
    if summary.is_none() && hash.is_some() {
        match TrainingSummary::load(&path) {
            Ok(found) => summary = Some(found),
            // A damaged controller is replaced by a new training run.
            Err(error) => reasons = vec![error.to_string()],
        }
    }
    if let (Some(summary), Some(_)) = (&mut summary, &expected.settings) {
        let found = summary.reconcile(training, &expected, adopt);
        reasons = found.iter().map(ToString::to_string).collect();
    }
    let conditions = Conditions::new(task, &expected.task_hash);
    let state = match &record {
        _ if expected.settings.is_none() => TrainingState::NoSettings,
        _ if !reasons.is_empty() => unfinished(folder, training, &expected, reasons.join("; ")),
        Some(record) if is_recorded && record.conditions == conditions => {
            if record.falsification.is_none() && training.is_falsified() {
                TrainingState::NeedsFalsification
            } else {
                TrainingState::Done
            }
        }
        Some(record) if is_recorded => {
            let reason = record.differences(&conditions).join("; ");
            TrainingState::NeedsMeasurement { reason }
        }
        found => {
            let reason = if found.is_some() { "controller changed" } else { "not measured" };
            TrainingState::NeedsMeasurement { reason: reason.to_string() }
        }
    };
    let mut record_is_stale = false;
    if let (true, Some(record)) = (state.is_measured(), &mut record)
        && record.training != summary
    {
        record.training.clone_from(&summary);
        record_is_stale = true;
    }
    let training = training.clone();
    Ok(PlanEntry { training, expected, state, summary, record, record_is_stale })
}

/// Returns the state of a training run that is needed: it continues if it was started with the same
/// dependencies.
fn unfinished(
    folder: &ZooFolder,
    training: &Training,
    expected: &TrainingInputs,
    reason: String,
) -> TrainingState {
    let started = read_text_bounded(&folder.work(training, STARTED), limits::CONTROLLER);
    let has_started = started.is_ok_and(|text| text == started_mark(expected));
    if !(has_started && folder.work(training, CHECKPOINT).is_file()) {
        return TrainingState::NeedsTraining { reason };
    }
    let curve = Curve::load(&folder.work(training, CURVE)).ok();
    let steps = curve.and_then(|curve| curve.rows.last().map(|row| row.environment_steps));
    TrainingState::Interrupted { reason, steps }
}

/// File name endings of a training run in progress.
pub(crate) const STARTED: &str = ".started.json";
pub(crate) const CONTROLLER: &str = ".safetensors";
pub(crate) const CHECKPOINT: &str = ".safetensors.checkpoint";
pub(crate) const CURVE: &str = ".csv";

/// Returns what a training run depends on, as the file beside its checkpoint has it. A checkpoint
/// of anything else is of no use.
pub(crate) fn started_mark(expected: &TrainingInputs) -> String {
    let TrainingInputs { settings, task_hash, layout_hash } = expected;
    json!({ "settings": settings, "task_hash": task_hash, "layout_hash": layout_hash }).to_string()
}
