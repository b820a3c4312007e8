//! The probability that a system violates its requirement, under the distribution of a plan.

use std::collections::BTreeMap;
use std::ops::{ControlFlow, RangeInclusive};

use mishandle_risk::{
    Disagreement, Failure, LARGEST_RATIO, Marginal, Method, Refusal, Report, Scenarios, Settings, Source,
};
use mishandle_rollout::{Request, Seed, Space, System};
use serde::{Deserialize, Serialize};

use crate::{Counterexample, MishandleError, ResolvedPlan, decimal, depends_on_seed, plural};

/// Settings of an estimation of the failure probability: the table `[risk]` of a plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct RiskPlan {
    /// Requirement: the name of a formula of the target, or the text of a formula. `None` selects the target's first formula.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub formula: Option<String>,
    /// Number of simulations.
    pub simulations: u64,
    /// Name of the method: `auto`, `monte-carlo`, `importance` or `splitting`.
    pub method: String,
    /// Batch size: number of simulations run at once. Results do not depend on it.
    pub batch: u32,
    /// Distributions of axes by name, such as `normal:1:0.1`. The other axes have the distributions that they declare.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub distributions: BTreeMap<String, String>,
}

impl Default for RiskPlan {
    fn default() -> Self {
        RiskPlan {
            formula: None,
            simulations: 50_000,
            method: Method::default().name().to_string(),
            batch: mishandle_rollout::DEFAULT_BATCH_SIZE as u32,
            distributions: BTreeMap::new(),
        }
    }
}

impl RiskPlan {
    /// Allowed numbers of simulations.
    pub const SIMULATIONS: RangeInclusive<u64> = 100..=1_000_000_000;

    /// Returns the method.
    ///
    /// # Errors
    /// If the name is unknown.
    pub fn method(&self) -> Result<Method, MishandleError> {
        self.method.parse().map_err(|()| MishandleError::UnknownName {
            kind: "method",
            name: self.method.clone(),
            known: Method::ALL.iter().map(|(_, name)| (*name).to_string()).collect(),
        })
    }

    fn marginals(&self) -> Result<BTreeMap<String, Marginal>, MishandleError> {
        self.distributions.iter().map(|(axis, text)| Ok((axis.clone(), text.parse()?))).collect()
    }
}

/// Checks the settings of an estimation against its space.
///
/// # Errors
/// If a number is out of its range, or the method, an axis or a distribution is unknown.
pub fn check_risk(risk: &RiskPlan, space: &Space) -> Result<(), MishandleError> {
    crate::falsify::check_batch(risk.batch)?;
    risk.method()?;
    if !RiskPlan::SIMULATIONS.contains(&risk.simulations) {
        let (what, expected) = ("the number of simulations", "from 100 to 1000000000");
        return Err(MishandleError::InvalidValue { what, value: risk.simulations.to_string(), expected });
    }
    Scenarios::new(space, &risk.marginals()?, true)?;
    Ok(())
}

/// Returns the distribution of the scenarios of a plan.
///
/// # Errors
/// If the plan has no table `[risk]`, or nothing is random.
pub fn risk_scenarios(resolved: &ResolvedPlan) -> Result<Scenarios, MishandleError> {
    let space = &resolved.space;
    let center = space.at(&vec![0.5; space.dimension()]);
    Ok(Scenarios::new(space, &table(resolved)?.marginals()?, depends_on_seed(resolved, &center))?)
}

/// Estimates the probability that a simulation violates the requirement of a plan: see [`mishandle_risk::risk()`](mishandle_risk::risk()).
///
/// `watch` gets the number of simulations after each batch, and can interrupt the estimation.
///
/// # Errors
/// If the plan has no table `[risk]`, nothing is random, or a simulation cannot be run.
pub fn risk(
    resolved: &ResolvedPlan,
    system: &mut dyn System,
    watch: impl FnMut(u64) -> ControlFlow<()>,
) -> Result<Report, MishandleError> {
    let table = table(resolved)?;
    let settings = Settings {
        simulations: table.simulations,
        method: table.method()?,
        seed: Seed(resolved.plan.seed),
        batch: table.batch as usize,
    };
    let scenarios = risk_scenarios(resolved)?;
    Ok(mishandle_risk::risk(system, &scenarios, &settings, watch)?)
}

fn table(resolved: &ResolvedPlan) -> Result<&RiskPlan, MishandleError> {
    resolved.plan.risk.as_ref().ok_or(MishandleError::MissingPlanTable { table: "risk" })
}

/// Simulates a failure of an estimation again and returns it as a counterexample.
///
/// # Errors
/// If the simulation cannot be run, or does not fail again because the target is not deterministic.
pub fn risk_counterexample(
    resolved: &ResolvedPlan,
    scenarios: &Scenarios,
    failure: &Failure,
) -> Result<Counterexample, MishandleError> {
    let request = Request::new(scenarios.scenario(&failure.draw.latent), failure.draw.seed);
    Counterexample::simulate(resolved, request)
}

/// Describes what the interval of an estimate assumes; `None` if nothing.
pub fn risk_assumption(report: &Report) -> Option<&'static str> {
    match report.answer.source? {
        _ if !report.answer.has_assumption => None,
        Source::MonteCarlo => None,
        Source::Importance => Some("the failures outside of the regions found are negligible"),
        Source::Splitting => Some("the chains lost no failure mode"),
    }
}

/// Describes why parts of an estimation have no estimate.
pub fn risk_refusals(report: &Report) -> Vec<String> {
    let chains = report.splitting.as_ref().map_or(0, |splitting| splitting.chains.len());
    let splitting = report.answer.splitting_refusal.as_ref().map(|refusal| match refusal {
        Refusal::Budget { simulations, needed } => format!(
            "multilevel splitting: its part of the budget is {}, too few for an estimate, which needs at least {} in all",
            plural(*simulations, "simulation"),
            plural(*needed, "simulation")
        ),
        Refusal::Chains(Disagreement::Incomplete { complete }) => format!(
            "multilevel splitting: {complete} of {chains} chains reached a failure within the budget; a larger budget lets all of them"
        ),
        Refusal::Chains(Disagreement::Extinct { extinct }) => format!(
            "multilevel splitting: {extinct} of {chains} chains found no failure, because all their particles have the same robustness"
        ),
        Refusal::Chains(Disagreement::Spread { ratio }) => format!(
            "multilevel splitting: the chains disagree by a factor of {ratio:.0}; more than {LARGEST_RATIO} is refused"
        ),
        Refusal::Chains(Disagreement::Small { population }) => format!(
            "multilevel splitting: the chains agree, but have only {}",
            plural(*population, "particle")
        ),
        Refusal::MonteCarlo => {
            "multilevel splitting: the exact interval of Monte Carlo (99 %) contradicts the chains".to_string()
        }
        Refusal::BelowImportance => {
            "multilevel splitting: the failures of importance sampling alone are more probable; the chains lost a failure mode"
                .to_string()
        }
        Refusal::AboveImportance => {
            "importance sampling and multilevel splitting: the chains agree on a larger probability than that of the regions, \
             so a failure mode was missed, or the chains are wrong"
                .to_string()
        }
    });
    let importance =
        report.importance.as_ref().filter(|importance| !importance.is_reliable()).map(|importance| {
            format!(
                "importance sampling: its failures are worth {:.0} equally weighted ones, and {} of the probability is \
                 estimated outside of the regions",
                importance.effective_failures,
                probability_text(importance.outside)
            )
        });
    splitting.into_iter().chain(importance).collect()
}

/// Formats a probability with three digits.
pub fn probability_text(p: f64) -> String {
    match p {
        0.0 => "0".to_string(),
        0.001.. => decimal(p, 5),
        _ => format!("{p:.2e}"),
    }
}
