//! The answers of questions as results, with the names and units of their plan.

mod evaluation;
mod falsification;
mod margin;
mod metamorphic;
mod risk;
mod simulation;

pub(super) use evaluation::{evaluation_result, screened_evaluation_result};
pub(super) use falsification::falsification_result;
pub(crate) use margin::margin_result;
pub(crate) use metamorphic::metamorphic_result;
pub(crate) use risk::{risk_result, screened_risk_result};
pub(crate) use simulation::repeated_result;
pub use simulation::simulation_result;
