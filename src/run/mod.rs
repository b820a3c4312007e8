//! Runs: questions that simulations answer.
//!
//! [`ask`] asks the question of a plan: it evaluates, falsifies, searches for the smallest
//! disturbance, compares pairs of scenarios, or estimates the failure probability. It writes every
//! simulation to a run file as soon as it ends, and continues a run that was interrupted. With
//! [`Engine::Screening`], another physics engine proposes thousands of simulations; MuJoCo C gives
//! every verdict.

mod answer;
mod ask;
mod axis_rates;
mod builds;
mod cause;
mod cost;
mod device;
mod end_text;
mod engine_speeds;
pub(crate) mod evaluation;
mod facts;
pub(crate) mod falsification;
mod file_target;
mod findings;
mod first_simulations;
pub(crate) mod header;
pub(crate) mod journal;
mod kept;
mod margin;
mod metamorphic;
mod missing;
mod opening;
mod preflight;
mod random_rows;
mod repeats;
mod requirements;
mod result;
mod risk;
pub(crate) mod rows;
pub(crate) mod same_plan;
mod screened_columns;
mod units;
mod vacuity;
pub(crate) mod violation;
mod warnings;
mod without_verdict;

pub(crate) use answer::asks_nothing_in;
pub(crate) use ask::asked;
pub use ask::{Engine, OpenRun, Progress, Watch, answer_of_run, ask, needs_target, recorded_answer};
pub use builds::{admit_build, build_differences, continued_builds};
pub(crate) use builds::{differences_of_builds, of_folder};
pub use cause::FailureCause;
pub(crate) use cause::{Isolation, isolation, isolation_of};
pub use cost::{Cost, Probes, cost};
pub use device::{Device, screening};
pub use end_text::end_text;
pub(crate) use end_text::{given, open_text, without_verdict_error};
pub use engine_speeds::{EngineSpeeds, measure_engines, with_faster_engine};
pub(crate) use evaluation::arm::{ControlArm, shares_arm};
pub use evaluation::arm::{TRIAL as CONTROL_TRIAL, system_of};
pub(crate) use evaluation::pairs::PairRule;
pub use evaluation::pairs::evaluate_pairs;
pub use evaluation::progress::{metric_counter, stops_by_itself};
pub use evaluation::{evaluation_request, evaluation_simulations, rejects_scenarios};
pub(crate) use facts::recorded_named;
pub use facts::{box_point, recorded_axes, recorded_scenario};
pub(crate) use findings::{physics_finding, recorded_physics, repeats_finding};
pub(crate) use header::axis_records;
pub use header::recorded_axis;
pub use kept::KeptSimulations;
pub use missing::{missing, unfinished};
pub use opening::Opening;
pub(crate) use opening::continue_run;
pub use opening::{create_probed_run, create_run};
pub(crate) use preflight::{Probed, preflight};
pub use random_rows::has_random_rows;
pub use repeats::{RepeatedScenario, counterexample_repeats, failure_text, repeat_scenario};
pub use requirements::requirements;
pub use result::simulation_result;
pub(crate) use risk::check_risk_method;
pub use risk::{risk_assumption, risk_refusals, risk_scenarios};
pub use rows::recorded_episode;
pub use units::{run_simulations, run_trial};
pub(crate) use vacuity::{OneTrace, asks_nothing};
pub(crate) use warnings::idle_axes;
pub use warnings::warnings;
pub use without_verdict::{compared_without_verdict, inconclusive_text, without_verdict_text};
