//! Trains, evaluates and falsifies AI controllers.
//!
//! A controller acts in a simulated scenario, and the episode gives a trace. A formula in signal temporal logic maps
//! the trace to its robustness. A search proposes scenarios until the robustness is negative: that scenario is a
//! counterexample.
//!
//! This crate connects the parts. A [`Plan`] names target, scenario space, formula and search. [`ResolvedPlan`] looks
//! these names up and checks them. [`evaluate`](evaluate()), [`falsify`](falsify()) and [`train`](train()) execute the
//! plan and write every simulation to a run file as soon as it ends.
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

mod axis_setting;
mod backend;
mod build;
mod campaign;
mod comparison;
mod completion;
mod counterexample;
mod curve;
mod error;
mod evaluate;
mod event;
mod explanation;
mod explanation_text;
mod failure_modes;
mod failure_probability;
mod falsify;
mod film;
mod frames;
mod full_trace;
mod hint;
mod home;
mod import;
mod invisible;
mod margin;
mod masking;
mod minimize;
mod mode_survey;
mod number_text;
mod plan;
mod record;
mod regress;
mod replay;
mod replay_command;
mod search_options;
mod shell_quote;
mod simulate;
mod smooth_region;
mod space_coverage;
mod target;
mod tensorboard;
mod train;
mod training_facts;
mod trajectory;

pub use axis_setting::AxisSetting;
pub use backend::{
    ScreenedEvaluationOutcome, evaluate_on_backend, gpu_backend, install_gpu_backend, risk_on_backend,
    screening,
};
pub use build::{VERSION, VERSION_AND_COMMIT, build};
pub use campaign::{CampaignRun, campaign_runs, create_campaign, free_campaign_folder};
pub use comparison::{
    ComparedPair, ComparedRun, Comparison, PairedMeans, PairedRates, compare, p_value_text,
};
pub use completion::unfinished;
pub use counterexample::{
    AxisValue, Counterexample, CounterexampleReplay, Decisive, Expected, MinimizedFrom,
};
pub use curve::{Curve, CurveProblem, CurveRow, NoTrainingTime};
pub use error::MishandleError;
pub use evaluate::{
    EvaluationOutcome, check_evaluate, evaluate, evaluation_request, evaluation_simulations,
    rejects_scenarios,
};
pub use event::{Event, EventKind, release};
pub use explanation::{
    Conjunct, ExplainedSimulation, Explanation, PredicateHistory, explain, explain_episode, explain_recorded,
    explain_trace,
};
pub use explanation_text::{compared_values, instant};
pub use failure_modes::{Failure, FailureMode, FailureModes, axis as recorded_axis, failure_modes};
pub use failure_probability::{
    RiskPlan, check_risk, probability_text, risk, risk_assumption, risk_counterexample, risk_refusals,
    risk_scenarios,
};
pub use falsify::{
    FalsifyProgress, check_falsify, failure_rate_bound, falsify, falsify_on_backend, search_entry,
};
pub use film::Film;
pub use frames::{FrameCaptions, FrameRenderer};
pub use full_trace::full_trace;
pub use home::{
    ShippedFile, controller_name, find_controller, home, home_description, picture_path, shipped_controller,
    shipped_controllers, shipped_settings,
};
pub use import::{import_controller, is_onnx, onnx_policy, read_normalizer};
pub use invisible::is_invisible;
pub use margin::{Level, Margin, Norms, Witness, check_margin, margin, witness_repeats};
pub use masking::{EvaluatedCount, MaskedConjunct, Masking, masking};
pub use minimize::{Minimized, axes_off_nominal, is_close, minimize};
pub use mode_survey::{ModeSurvey, UnseenModes, mode_survey};
pub use number_text::{decimal, plural};
pub use plan::{EvaluatePlan, FalsifyPlan, GridRun, Plan, StartRegion, read_grid};
pub use record::{create_run, recorded_episode};
pub use regress::{Regression, regress, regress_with};
pub use replay::{ReplayResult, build_differences, recorded_plan, replay, replay_with, select_simulation};
pub use replay_command::replay_command;
pub use search_options::search_option_value;
pub use shell_quote::shell_quote;
pub use simulate::{Noise, depends_on_seed, measure_noise, repeat, repeat_seeds, space_depends_on_seed};
pub use smooth_region::smooth_region_of;
pub use space_coverage::{SpaceCoverage, space_coverage};
pub use target::{ResolvedPlan, preset, target, target_names, task, task_target};
pub use train::{TrainObserver, TrainPlan, TrainReport, default_out, reward, train, uses_default_settings};
pub use training_facts::{TrainingFacts, training_facts};
pub use trajectory::{StateTrajectory, initial_state, replay_states, scene_mjcf, strip_samples};

pub use {
    mishandle_controllers as controllers, mishandle_evaluation as evaluation,
    mishandle_falsification as falsification, mishandle_files as files, mishandle_interchange as interchange,
    mishandle_network as network, mishandle_random as random, mishandle_results as results,
    mishandle_risk as risk, mishandle_rollout as rollout, mishandle_search as search, mishandle_stl as stl,
    mishandle_store as store, mishandle_tasks as tasks, mishandle_toys as toys,
    mishandle_training as training, mishandle_world as world,
};
