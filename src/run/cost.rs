//! The costs of a question: its probes, its largest number of simulations, and about how long it
//! takes.

use mishandle_falsification::{Repeated, each_category, each_fault, isolation_budget};
use mishandle_store::RunKind;

use crate::error::MishandleError;
use crate::resolve::{ResolvedPlan, metamorphic_cases, space_depends_on_seed};
use crate::run::evaluation_simulations;

/// The simulations before the first one that counts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Probes {
    /// Number of them.
    pub simulations: u64,
    /// Seconds that each of them took, but for the first one, which may start a program.
    pub seconds: f64,
}

impl Probes {
    /// Returns about how many seconds a number of simulations takes; `None` without a probe.
    pub fn estimate(&self, simulations: u64) -> Option<f64> {
        (self.simulations > 0).then_some(self.seconds * simulations as f64)
    }
}

/// The largest numbers of simulations of a question.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cost {
    /// Those that the plan asks for.
    pub simulations: u64,
    /// Further ones for each counterexample, but for a few on bounds: those that find its cause, or
    /// repeat it with other seeds.
    pub of_counterexample: u64,
}

/// Returns the largest numbers of simulations of the question of a plan.
///
/// # Errors
/// If the plan has no table of its question, or its axes make no space.
pub fn cost(resolved: &ResolvedPlan) -> Result<Cost, MishandleError> {
    let plan = &resolved.plan;
    let missing = |table| MishandleError::MissingPlanTable { table };
    Ok(match plan.kind() {
        RunKind::Evaluate => Cost { simulations: evaluation_simulations(resolved)?, of_counterexample: 0 },
        RunKind::Falsify => {
            let falsify = plan.falsify.as_ref().ok_or(missing("falsify"))?;
            let is_isolated = falsify.isolate == Some(true);
            Cost {
                simulations: u64::from(falsify.trials) * u64::from(falsify.budget),
                of_counterexample: if is_isolated { isolation_budget(falsify.budget) } else { 0 },
            }
        }
        RunKind::Margin => {
            let margin = plan.margin.as_ref().ok_or(missing("margin"))?;
            let parts = if margin.each_category { each_category } else { each_fault };
            let is_random = space_depends_on_seed(resolved);
            Cost {
                simulations: margin.budget.saturating_mul(parts(&resolved.space)?.len() as u64),
                of_counterexample: if is_random { Repeated::Counterexample.simulations() } else { 0 },
            }
        }
        RunKind::Metamorphic => {
            let cases = metamorphic_cases(resolved)?;
            let simulations = cases.settings.max_simulations(cases.relations.len());
            Cost { simulations, of_counterexample: 0 }
        }
        RunKind::Risk => {
            let risk = plan.risk.as_ref().ok_or(missing("risk"))?;
            Cost { simulations: risk.simulations, of_counterexample: 0 }
        }
    })
}
