//! Trains, evaluates and falsifies AI controllers.
//!
//! A controller acts in a simulated scenario, and the episode gives a trace. A formula in signal
//! temporal logic maps the trace to its robustness. A search proposes scenarios until the
//! robustness is negative: that scenario is a counterexample.
//!
//! This crate connects the parts, and re-exports the crates below it. A [`Plan`] names target,
//! scenario space, formula and search. [`ResolvedPlan`] looks these names up and checks them.
//! [`run::ask`] executes the plan, writes every simulation to a run file as soon as it ends, and
//! returns the answer; [`train`](train::train()) trains a controller.
//!
//! # Example
//! The expert balances the ball from the center of the tray:
//! ```
//! use mishandle::rollout::{Request, Seed};
//! use mishandle::{Plan, ResolvedPlan};
//! let resolved = ResolvedPlan::new(&Plan::new("ball-balancing", "expert")).unwrap();
//! let mut system = resolved.system().unwrap();
//! let episodes = system.rollout(&[Request::new([0.342, 0.0], Seed(0))]).unwrap();
//! assert!(episodes[0].verdict.success.unwrap() > 0.0);
//! ```

pub mod archive;
pub mod bisect;
pub mod build;
pub mod campaign;
pub mod check;
pub mod counterexample;
mod error;
pub mod harden;
pub mod inspect;
pub mod picture;
pub mod plan;
pub mod portable;
pub mod record;
pub mod replay;
pub mod resolve;
pub mod run;
pub mod shipped;
pub mod train;
pub mod tune;
pub mod verdict;

pub use error::{Compared, MishandleError, RunError};
pub use plan::Plan;
pub use resolve::ResolvedPlan;

pub use {
    mishandle_camera as camera, mishandle_camera::sight, mishandle_controllers as controllers,
    mishandle_controllers::guard, mishandle_dataset as dataset, mishandle_evaluation as evaluation,
    mishandle_falsification as falsification, mishandle_files as files, mishandle_interchange as interchange,
    mishandle_network as network, mishandle_random as random, mishandle_requirements as requirements,
    mishandle_results as results, mishandle_risk as risk, mishandle_robots::mjcf,
    mishandle_rollout as rollout, mishandle_search as search, mishandle_stl as stl, mishandle_store as store,
    mishandle_tasks as tasks, mishandle_toys as toys, mishandle_toys::arch, mishandle_training as training,
    mishandle_world as world,
};
