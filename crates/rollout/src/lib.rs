//! Environment, controller, initial box, noise, and the episode they make together.
//!
//! A controller acts in an environment from an initial configuration; that gives a [`Trace`](mishandle_stl::Trace);
//! the trace has a [`Verdict`]. This crate knows no physics: an [`Environment`] is anything that can be reset at an
//! initial configuration and stepped, a [`Controller`] anything that turns observations into actions.
//!
//! Both are shared, immutable descriptions that hand out workers: an [`Environment`] gives a [`Worker`] to each
//! thread, a [`Controller`] an [`Actor`]. What belongs to one simulation lives in its state row, so any worker can
//! carry on any simulation, and nothing depends on the number of threads.

mod batch;
mod controller;
mod environment;
mod episode;
mod error;
mod initial_box;
mod noise;
mod seed;
mod specification;
mod system;

pub use batch::Batch;
pub use controller::{Actor, Controller};
pub use environment::{Environment, Sample, Status, Worker};
pub use episode::{End, Episode, Rollout, Stop};
pub use error::RolloutError;
pub use initial_box::{Axis, InitialBox};
pub use noise::Noise;
pub use seed::{Seed, Stream};
pub use specification::{Judge, Specification, Verdict};
pub use system::{Request, System};
