//! The answers of questions as results, with the names and units of their plan.

mod evaluation;
mod falsification;
mod margin;
mod risk;
mod simulation;

pub use evaluation::{evaluation_result, screened_evaluation_result};
pub use falsification::falsification_result;
pub use margin::margin_result;
pub use risk::{risk_result, screened_risk_result};
pub use simulation::{repeated_result, simulation_result};
