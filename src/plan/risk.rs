//! Settings of an estimation of the failure probability.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;

use mishandle_risk::{Marginal, Method};
use serde::{Deserialize, Serialize};

use crate::error::MishandleError;

/// Settings of an estimation of the failure probability: the table `[risk]` of a plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct RiskPlan {
    /// Requirement: the name of a formula of the target, or the text of a formula. `None` selects
    /// the target's first formula.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub formula: Option<String>,
    /// Number of simulations.
    pub simulations: u64,
    /// Name of the method: `auto`, `monte-carlo`, `importance`, `splitting` or `sequence`.
    pub method: String,
    /// Batch size: number of simulations run at once. Results do not depend on it.
    pub batch: u32,
    /// Distributions of axes by name, such as `normal:1:0.1`. The other axes have the distributions
    /// that they declare.
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

    /// Returns the distributions of the axes that the plan sets.
    ///
    /// # Errors
    /// If the text of a distribution is invalid.
    pub(crate) fn marginals(&self, hours: f64) -> Result<BTreeMap<String, Marginal>, MishandleError> {
        let named = |(axis, text): (&String, &String)| {
            let marginal: Marginal = text.parse()?;
            Ok((axis.clone(), marginal.lasting(hours)))
        };
        self.distributions.iter().map(named).collect()
    }
}
