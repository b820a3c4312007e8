//! The answers of questions as results, with the names and units of their plan.

mod evaluation;
mod falsification;
mod margin;
mod metamorphic;
mod risk;
mod simulation;

use std::path::Path;

use mishandle_results as results;

use crate::error::MishandleError;
use crate::resolve::ResolvedPlan;
use crate::run::{Answer, risk_scenarios};

pub use evaluation::{evaluation_result, screened_evaluation_result};
pub use falsification::falsification_result;
pub use margin::margin_result;
pub use metamorphic::metamorphic_result;
pub use risk::{risk_result, screened_risk_result};
pub(crate) use simulation::repeated_result;
pub use simulation::simulation_result;

impl Answer {
    /// Returns the answer as a result. `run` is the path of its run file. A falsification is that
    /// of [`falsification_result`].
    ///
    /// # Errors
    /// If the plan is not that of the answer.
    pub fn result(&self, resolved: &ResolvedPlan, run: &Path) -> Result<results::Answer, MishandleError> {
        Ok(match self {
            Answer::Evaluation(found) => {
                results::Answer::Evaluation(Box::new(evaluation_result(resolved, found, run)))
            }
            Answer::ScreenedEvaluation(found) => {
                results::Answer::Evaluation(Box::new(screened_evaluation_result(resolved, found, run)))
            }
            Answer::Falsification(found, counts) => results::Answer::Falsification(Box::new(
                falsification_result(resolved, found, counts.as_ref(), run),
            )),
            Answer::Margin(found) => results::Answer::Margin(Box::new(margin_result(resolved, found, run))),
            Answer::Metamorphic(found) => {
                results::Answer::Metamorphic(Box::new(metamorphic_result(resolved, found, run)?))
            }
            Answer::Risk(report) => {
                let scenarios = risk_scenarios(resolved)?;
                results::Answer::Risk(Box::new(risk_result(resolved, &scenarios, report, run)))
            }
            Answer::ScreenedRisk(report) => {
                let scenarios = risk_scenarios(resolved)?;
                results::Answer::Risk(Box::new(screened_risk_result(resolved, &scenarios, report, run)))
            }
        })
    }
}
