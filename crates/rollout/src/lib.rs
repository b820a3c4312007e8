//! The seam between what is tested and what tests it: target, space, scenario, system, episode.
//!
//! A [`Target`] is anything that can be falsified: it declares the axes that a [`Scenario`] may set, its signals and its
//! formulas, and makes a [`System`] that turns [`Request`]s into [`Episode`]s. A [`Rollout`] is the system made of a
//! [`Controller`] in an [`Environment`]; any other simulator may be one.
//!
//! This crate knows no physics. Environment and controller are shared, immutable descriptions that hand out workers: an
//! [`Environment`] gives a [`EnvironmentWorker`] to each thread, a [`Controller`] an [`ControllerWorker`]. What belongs to one simulation lives
//! in its state row, so any worker can carry on any simulation, and nothing depends on the number of threads.
//!
//! Training acts in an [`EnvironmentBatch`], which a [`BatchFactory`] makes. [`CpuBatch`] is the one on the CPU; others
//! may live on a GPU or in another process.

mod batch;
mod controller;
mod disturbance;
mod environment;
mod environment_batch;
mod error;
mod noise;
mod request;
mod rollout;
mod space;
mod specification;
mod system;
mod target;

pub use mishandle_random::{Seed, Stream};

pub use batch::CpuBatch;
pub use controller::{Controller, ControllerWorker};
pub use disturbance::{Disturbance, Effect, Shape};
pub use environment::{Environment, EnvironmentWorker, Sample, StepStatus};
pub use environment_batch::{BatchFactory, EnvironmentBatch, EnvironmentSpec};
pub use error::RolloutError;
pub use noise::Noise;
pub use request::{Episode, EpisodeEnd, Request};
pub use rollout::{Rollout, StopCondition};
pub use space::{Axis, AxisKind, AxisValues, Distribution, Scenario, Space};
pub use specification::{Specification, SpecificationMonitor, Verdict};
pub use system::{DEFAULT_BATCH_SIZE, System};
pub use target::{Component, Formulas, Identity, NamedFormula, Reachable, Signal, SystemFactory, Target};
