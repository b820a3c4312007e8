//! Mishandle finds out what makes a robot's controller fail.
//!
//! A controller acts in a world from an initial configuration, which gives a trace, which has a robustness, which a
//! search tries to push below zero. This crate puts the parts together: a [`Plan`] says what to do, the functions here
//! do it and write every simulation to a run file as it ends.
//!
//! # Example
//! The expert balances the ball from the middle of the tray:
//! ```
//! use mishandle::{Plan, Subject};
//! let plan = Plan::new("ball-balancing", "expert");
//! let mut system = Subject::new(&plan).unwrap().system().unwrap();
//! let start = mishandle_rollout::Request { x0: vec![0.342, 0.0], seed: mishandle_rollout::Seed(0) };
//! let episodes = mishandle_rollout::System::rollout(&mut system, &[start]).unwrap();
//! assert!(episodes[0].verdict.success.unwrap() > 0.0);
//! ```

mod build;
mod curve;
mod error;
mod evaluate;
mod falsify;
mod film;
mod growing_file;
mod hint;
mod home;
mod lock;
mod memory;
mod new_folders;
mod plan;
mod record;
mod replay;
mod shell;
mod subject;
mod tensorboard;
mod train;
mod training_facts;

pub use build::{VERSION, VERSION_AND_COMMIT, build};
pub use curve::{Curve, CurveProblem, CurveRow, NoTrainingTime};
pub use error::MishandleError;
pub use evaluate::{evaluate, leaves_out_starts};
pub use falsify::{Progress, falsify};
pub use film::{Film, film, scene, start};
pub use home::{
    controller_name, controller_path, find_controller, home, picture_path, settings_path, shipped_controllers,
};
pub use plan::{EvaluatePlan, FalsifyPlan, Plan, Starts};
pub use record::create_run;
pub use replay::{Replayed, choose, other_build, recorded_subject, replay};
pub use shell::shell_word;
pub use subject::{Subject, preset, task};
pub use train::{TrainPlan, TrainReport, TrainWatch, default_out, reward, train};
pub use training_facts::{TrainingFacts, training_facts};

pub use {
    mishandle_controllers as controllers, mishandle_evaluation as evaluation,
    mishandle_falsification as falsification, mishandle_rollout as rollout, mishandle_search as search,
    mishandle_stl as stl, mishandle_store as store, mishandle_tasks as tasks, mishandle_training as training,
    mishandle_world as world,
};
