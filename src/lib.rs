//! Mishandle finds out what makes an AI controller fail.
//!
//! A controller acts in a world under a scenario, which gives a trace, which has a robustness, which a search tries to
//! push below zero. This crate puts the parts together: a [`Plan`] says what to do, [`ResolvedPlan`] looks up what it names,
//! and the functions here do it and write every simulation to a run file as it ends.
//!
//! # Example
//! The expert balances the ball from the middle of the tray:
//! ```
//! use mishandle::rollout::{Request, Seed};
//! use mishandle::{Plan, ResolvedPlan};
//! let resolved = ResolvedPlan::new(&Plan::new("ball-balancing", "expert")).unwrap();
//! let mut system = resolved.system().unwrap();
//! let episodes = system.rollout(&[Request::new([0.342, 0.0], Seed(0))]).unwrap();
//! assert!(episodes[0].verdict.success.unwrap() > 0.0);
//! ```

mod build;
mod curve;
mod error;
mod evaluate;
mod falsify;
mod film;
mod hint;
mod home;
mod memory;
mod plan;
mod record;
mod replay;
mod search_options;
mod shell;
mod target;
mod tensorboard;
mod train;
mod training_facts;

pub use build::{VERSION, VERSION_AND_COMMIT, build};
pub use curve::{Curve, CurveProblem, CurveRow, NoTrainingTime};
pub use error::MishandleError;
pub use evaluate::{evaluate, leaves_out_starts};
pub use falsify::{FalsifyProgress, falsify, search_entry};
pub use film::{Film, film, scene, start};
pub use home::{
    ShippedFile, controller_name, find_controller, home, home_in_words, picture_path, shipped_controller,
    shipped_controllers, shipped_settings,
};
pub use plan::{EvaluatePlan, FalsifyPlan, Plan, StartRegion};
pub use record::create_run;
pub use replay::{ReplayResult, choose, other_build, recorded_plan, replay};
pub use search_options::search_option_value;
pub use shell::shell_word;
pub use target::{ResolvedPlan, preset, target, target_names, task, task_target};
pub use train::{TrainObserver, TrainPlan, TrainReport, default_out, reward, train, uses_default_settings};
pub use training_facts::{TrainingFacts, training_facts};

pub use {
    mishandle_controllers as controllers, mishandle_evaluation as evaluation,
    mishandle_falsification as falsification, mishandle_files as files, mishandle_random as random,
    mishandle_rollout as rollout, mishandle_search as search, mishandle_stl as stl, mishandle_store as store,
    mishandle_tasks as tasks, mishandle_toys as toys, mishandle_training as training,
    mishandle_world as world,
};
