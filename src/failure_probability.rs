//! The probability that a system violates its requirement, under the distribution of a plan.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;

use mishandle_risk::{Marginal, Method, Report, Scenarios, Settings};
use mishandle_rollout::{Seed, Space};
use serde::{Deserialize, Serialize};

use crate::{MishandleError, ResolvedPlan, depends_on_seed};

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
pub(crate) fn check(risk: &RiskPlan, space: &Space) -> Result<(), MishandleError> {
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
/// `watch` gets the number of simulations after each batch.
///
/// # Errors
/// If the plan has no table `[risk]`, nothing is random, or a simulation cannot be run.
pub fn risk(resolved: &ResolvedPlan, watch: impl FnMut(u64)) -> Result<Report, MishandleError> {
    let table = table(resolved)?;
    let settings = Settings {
        simulations: table.simulations,
        method: table.method()?,
        seed: Seed(resolved.plan.seed),
        batch: table.batch as usize,
    };
    let scenarios = risk_scenarios(resolved)?;
    Ok(mishandle_risk::risk(&mut *resolved.system()?, &scenarios, &settings, watch)?)
}

fn table(resolved: &ResolvedPlan) -> Result<&RiskPlan, MishandleError> {
    resolved.plan.risk.as_ref().ok_or(MishandleError::MissingPlanTable { table: "risk" })
}
