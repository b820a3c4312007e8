//! Findings about the simulations of a run: why a simulation fails, which failures belong together,
//! what was covered, and how two runs differ.

mod axes_at_nominal;
mod comparison;
mod event;
mod explanation;
mod explanation_text;
mod failure_modes;
mod further;
mod masking;
mod minimal;
mod mode_survey;
mod physics;
mod result;
mod run_difference;
mod sample_size;
mod simulation;
mod smooth_region;
mod space_coverage;
mod traces;

pub use axes_at_nominal::axes_at_nominal;
pub use comparison::{ComparedPair, compare, compared_pairs, judgment, sameness};
pub use event::{Event, EventKind, release};
pub use explanation::{
    Conjunct, ExplainedSimulation, Explanation, PredicateHistory, WholeOperand, common_unit, explain,
    explain_episode, explain_recorded, explain_trace, unit,
};
pub use explanation_text::compared_values;
pub use failure_modes::{Failure, FailureMode, FailureModes, failure_modes};
pub use further::{FurtherPart, further, further_unrecorded};
pub use masking::masking;
pub use minimal::MinimalFailure;
pub use mode_survey::{ModeSurvey, mode_survey, unseen_modes};
pub use result::{counterexamples_result, run_facts};
pub use run_difference::run_difference;
pub use sample_size::{Expected, SizeQuestion, sample_size};
pub use simulation::{Simulated, simulate, simulated};
pub use space_coverage::space_coverage;
pub use traces::{RandomTraces, SimulatedTrace, random_traces};
