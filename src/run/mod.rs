//! Runs: questions that simulations answer.
//!
//! [`ask`] asks the question of a plan: it evaluates, falsifies, searches for the smallest
//! disturbance, compares pairs of scenarios, or estimates the failure probability. It writes every
//! simulation to a run file as soon as it ends, and continues a run that was interrupted. With
//! [`Engine::Screening`], another physics engine proposes thousands of simulations; MuJoCo C gives
//! every verdict.

mod again;
mod answer;
mod ask;
mod axis_rates;
mod builds;
mod cause;
mod completion;
mod control;
mod end_text;
pub(crate) mod evaluate;
mod evaluating;
mod facts;
pub(crate) mod falsify;
mod first_simulations;
pub(crate) mod header;
pub(crate) mod journal;
mod margin;
mod metamorphic;
mod opening;
mod outcomes;
mod paired;
mod preflight;
mod random_rows;
mod rate_rule;
mod reason;
pub(crate) mod record;
mod recorded;
mod repeats;
mod requirements;
mod result;
mod risk;
pub(crate) mod screening;
pub(crate) mod violation;

pub use again::{run_simulations, run_trial};
pub(crate) use ask::asked;
pub use ask::{Engine, OpenRun, Progress, Watch, ask, recorded_answer};
pub(crate) use builds::differences_of_builds;
pub use builds::{admit_build, build_differences, continued_builds};
pub use cause::FailureCause;
pub(crate) use cause::{Isolation, isolation};
pub use completion::{missing, unfinished};
pub(crate) use control::{ControlArm, shares_arm};
pub use control::{TRIAL as CONTROL_TRIAL, system_of};
pub use end_text::end_text;
pub use evaluate::{evaluation_request, evaluation_simulations, rejects_scenarios};
pub use evaluating::{metric_counter, stops_by_itself};
pub use opening::Opening;
pub(crate) use paired::PairRule;
pub use paired::evaluate_pairs;
pub(crate) use preflight::preflight;
pub use random_rows::has_random_rows;
pub(crate) use reason::given;
pub(crate) use record::{axis_records, continue_run};
pub use record::{create_run, recorded_axis, recorded_episode};
pub(crate) use recorded::recorded_named;
pub use recorded::{box_point, recorded_axes, recorded_scenario};
pub use repeats::{RepeatedScenario, counterexample_repeats, failure_text, repeat_scenario};
pub use requirements::requirements;
pub use result::simulation_result;
pub(crate) use risk::check_risk_method;
pub use risk::{risk_assumption, risk_refusals, risk_scenarios};
pub use screening::{Device, screening};
