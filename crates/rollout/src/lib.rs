//! The seam between what is tested and what tests it: target, space, scenario, system, episode.
//!
//! A [`Target`] is anything that can be falsified: it declares the axes that a [`Scenario`] may set, its signals and its
//! formulas, and makes a [`System`] that turns [`Request`]s into [`Episode`]s. A [`Rollout`] is the system made of a
//! [`Controller`] in an [`Environment`]; any other simulator may be one.
//!
//! This crate knows no physics. Environment and controller are shared, immutable descriptions that hand out workers: an
//! [`Environment`] gives a [`Worker`] to each thread, a [`Controller`] an [`Actor`]. What belongs to one simulation lives
//! in its state row, so any worker can carry on any simulation, and nothing depends on the number of threads.
//!
//! Training acts in an [`EnvironmentBatch`], which a [`BatchFactory`] makes. [`Batch`] is the one on the CPU; others
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
mod seed;
mod space;
mod specification;
mod system;
mod target;

pub use batch::Batch;
pub use controller::{Actor, Controller};
pub use disturbance::{Disturbance, Effect, Shape};
pub use environment::{Environment, Sample, Status, Worker};
pub use environment_batch::{BatchFactory, EnvironmentBatch, EnvironmentSpec};
pub use error::RolloutError;
pub use noise::Noise;
pub use request::{End, Episode, Request};
pub use rollout::{Rollout, Stop};
pub use seed::{Seed, Stream};
pub use space::{Axis, AxisKind, Distribution, Scenario, Space, Values};
pub use specification::{Judge, Specification, Verdict};
pub use system::{BATCH, System};
pub use target::{Component, Factory, Formulas, Identity, NamedFormula, Reachable, Signal, Target};
