//! Runs a controller in an environment and evaluates the resulting episodes.
//!
//! This crate defines the interface between the system under test and the searches, evaluations and
//! training algorithms that use it:
//!
//! - A [`Target`] is anything that can be falsified. It declares the axes that a [`Scenario`] may
//!   set, its signals and its formulas, and makes a [`System`].
//! - A [`System`] simulates [`Request`]s and returns [`Episode`]s with their robustness. A
//!   [`Rollout`] is the system of a [`Controller`] in an [`Environment`]. Any other simulator can
//!   implement [`System`] directly.
//! - A [`Space`] maps a point of \[0,1\]^d to a [`Scenario`] in SI units.
//! - A [`Specification`] contains the formulas, and a [`SpecificationMonitor`] evaluates them on a
//!   trace.
//!
//! An [`Environment`] and a [`Controller`] are shared and immutable. Each thread makes its own
//! [`EnvironmentWorker`] and [`ControllerWorker`]. The state of a simulation is a row of numbers,
//! so any worker can step any simulation, and the results do not depend on the number of threads.
//! This crate contains no physics.
//!
//! A controller that sees gets [`Image`]s in each control step, besides its observation. [`Eyes`]
//! of the environment render them.
//!
//! A [`Steering`] chooses disturbances of the actions while a simulation runs. The episode is that
//! of the scenario with the chosen values, so it can be repeated without the steering.
//!
//! A [`Screening`] runs simulations on a [`ScenarioBatch`], which another physics engine steps. Its
//! outcomes propose scenarios; they are neither [`Episode`]s nor evidence.
//!
//! A target whose physics this program steps has [`SolverVariant`]s: the same target under a
//! [`SolverChange`], which checks that a failure does not depend on the solver.
//!
//! Training steps an [`EnvironmentBatch`], which a [`BatchFactory`] makes. [`CpuBatch`] runs on the
//! CPU. Other implementations may run on a GPU or in another process.

mod batch;
mod condition;
mod control_loop;
mod controller;
mod delay;
mod disturbance;
mod early_stop;
mod environment;
mod environment_batch;
mod error;
pub mod fault;
mod interface;
mod interval;
mod lane;
mod memory;
mod noise;
mod per_thread;
mod real;
mod request;
mod rollout;
mod scenario_part;
mod screening;
mod sight;
mod solver_variant;
mod space;
mod specification;
mod steering;
mod supervisor;
mod system;
mod target;
mod training_scenarios;

pub use mishandle_random::{Seed, Stream};

pub use batch::{CpuBatch, Samples};
pub use condition::{Condition, Holds};
pub use control_loop::{ControlLoop, LoopPart, LoopSpaces, distinct};
pub use controller::{Controller, ControllerFailure, ControllerWorker};
pub use delay::delays;
pub use disturbance::{Disturbance, Effect, TimeProfile};
pub use early_stop::EarlyStop;
pub use environment::{Environment, EnvironmentFacts, EnvironmentWorker, Sample, StepStatus};
pub use environment_batch::{BatchFactory, EnvironmentBatch, EnvironmentSpec, Start};
pub use error::RolloutError;
pub use interface::{ActiveInterface, Interface};
pub use interval::{Interval, IntervalError};
pub use noise::Noise;
pub use per_thread::PerThread;
pub use real::Real;
pub use request::{Episode, EpisodeEnd, Request};
pub use rollout::Rollout;
pub use scenario_part::ScenarioPart;
pub use screening::{
    BatchStatus, GROUP_ROWS, ScenarioBatch, ScenarioRows, Screen, ScreenedEpisode, Screening,
};
pub use sight::{Eyes, EyesWorker, Image};
pub use solver_variant::{START_OFFSET, SolverChange, SolverSystem, SolverVariant};
pub use space::{Axis, AxisKind, AxisValues, Distribution, Scenario, Space};
pub use specification::{Specification, SpecificationMonitor, Verdict};
pub use steering::{Seen, Steerable, SteeredAxis, SteeredEpisode, Steering};
pub use supervisor::{Supervised, Supervisor, SupervisorWorker};
pub use system::{DEFAULT_BATCH_SIZE, System};
pub use target::{
    Component, Identity, NamedFormula, ReachabilityCheck, Signal, SystemFactory, Target, named_space,
};
pub use training_scenarios::{AxisSet, ScenarioBatches, TrainingScenarios};
