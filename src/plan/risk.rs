//! Settings of an estimation of the failure probability.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;

use mishandle_risk::{Marginal, Method};

use super::declare::plan_table;
use super::keys;
use crate::error::MishandleError;

plan_table! {
    /// Settings of an estimation of the failure probability: the table `[risk]` of a plan.
    pub struct RiskPlan in "risk" {
        /// Requirement: the name of a formula of the target, or the text of a formula. `None`
        /// selects the target's first formula.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub formula: Option<String> = None, keys::FORMULA;
        /// Number of simulations.
        pub simulations: u64 = 50_000, keys::SIMULATIONS;
        /// Name of the method: `auto`, `monte-carlo`, `importance`, `splitting`, or for tasks
        /// `sequence`.
        pub method: String = Method::default().name().to_string(),
            "\"auto\", \"monte-carlo\", \"importance\", \"splitting\", or for tasks \"sequence\"";
        /// Batch size: number of simulations run at once. Results do not depend on it.
        pub batch: u32 = mishandle_rollout::DEFAULT_BATCH_SIZE as u32, keys::BATCH;
        /// Distributions of axes by name, such as `normal:1:0.1`. The other axes have the
        /// distributions that they declare.
        #[serde(skip_serializing_if = "BTreeMap::is_empty")]
        pub distributions: BTreeMap<String, String> = BTreeMap::new(),
            "a table of distributions of axes, as [risk.distributions], each a string, such as \"normal:1:0.1\"";
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
