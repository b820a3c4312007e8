//! The controller zoo: the trained controllers that come with the repository, and how they are kept
//! up to date.
//!
//! - [`plan`](plan()) lists the training runs: a task and an algorithm.
//! - A [`PlanEntry`] says whether a training run is done, and why not, from its settings, its
//!   record and its file.
//! - A [`Zoo`] trains, measures, imports and writes the Markdown tables and the learning curves.
//! - A [`Record`] holds everything known about one controller:
//!   `controllers/figures/TASK/CONTROLLER.json`.
//!
//! The command `zoo` is a thin layer above.

mod curve_charts;
mod error;
mod folder;
mod import;
mod jobs;
mod measure;
mod pages;
mod plan;
mod plan_entry;
mod provenance;
mod record;
mod runner;
mod selection;
mod stored_curve;
mod tables;
mod thresholds;
mod train;
mod work;

pub use error::{CurveFileProblem, PageProblem, ZooError};
pub use folder::ZooFolder;
pub use jobs::JobOutcome;
pub use measure::{
    CAMPAIGN_TRIALS, EVALUATION_EPISODES, EVALUATION_SEED, FEWER_EPISODES, NOISE_LEVELS, evaluation_episodes,
};
pub use plan::{Training, algorithms, plan};
pub use plan_entry::{PlanEntry, TrainingState};
pub use provenance::{Difference, TrainingInputs, TrainingSummary, TrainingTime};
pub use record::{
    Conditions, CornersRecord, EvaluationRecord, FailingPoint, FalsificationRecord, Measurement, PlanRecord,
    Record, TrialMeasurement,
};
pub use runner::{BenchmarkTask, ControllerUnderTest, LocalRunner, Runner};
pub use selection::Selection;
pub use stored_curve::{StoredCurve, StoredCurveRow};
pub use thresholds::{Rates, missed_thresholds, success_threshold};
pub use work::{Zoo, ZooObserver};
