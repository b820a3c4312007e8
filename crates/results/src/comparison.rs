use serde::Serialize;

use crate::{AxisFacts, Estimate, GuardFacts, Number, Scenario, Seed, Sequential, WithoutVerdict, optional};

/// Two evaluations on the same scenarios and seeds, A and B, compared pair by pair.
///
/// The rates and means cover the random simulations. The corners and the center of the initial box
/// are not a random sample, so they appear among the new and the fixed failures only.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Comparison {
    /// Name of the target.
    pub target: String,
    /// Kind of the target: `task`, `toy`, `arch`, `robot`, `process` or `python`.
    pub target_kind: String,
    /// Formula of success.
    pub formula: String,
    /// The run A.
    pub first: ComparedRun,
    /// The run B.
    pub second: ComparedRun,
    /// Facts that differ and can cause differences, as text.
    pub differences: Vec<String>,
    /// The rule that ended both evaluations; missing without one. The difference of the success
    /// rates and its p-value then hold at any time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sequential: Option<Sequential>,
    /// Whether results decided how many pairs there are. Then the rates, their differences and all
    /// p-values hold at any time; intervals of means are for a fixed number of pairs, but that of a
    /// robustness that the rule watches.
    pub at_any_time: bool,
    /// Number of pairs of random simulations that count.
    pub pairs: u64,
    /// Number of other pairs: the target cannot start from the scenario in A or in B.
    pub left_out: u64,
    /// Success rate.
    pub success: PairedRates,
    /// Strict success rate; `null` if the target has no such formula.
    pub strict_success: Option<PairedRates>,
    /// Careful success rate; missing if one of the runs did not evaluate such a formula.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub careful_success: Option<PairedRates>,
    /// Robustness, over pairs with two finite values; if a rule watches it, over pairs with two
    /// values, clipped to the bounds of the rule.
    pub robustness: PairedMeans,
    /// Number of dangerous control steps; `null` if the target has no such formula.
    pub dangerous_steps: Option<PairedMeans>,
    /// Control step of completion, over pairs in which both succeed; `null` if the target has no
    /// such formula.
    pub completion_step: Option<PairedMeans>,
    /// Conclusion from the success rates, in a sentence.
    pub verdict: String,
    /// Why no simulation of both runs asks anything of its controller, so that nothing is compared;
    /// `null` otherwise.
    pub asks_nothing: Option<String>,
    /// Simulations in which A succeeds and B does not, at most 10,000; exit code 1 if there are
    /// any.
    pub new_failures: Vec<ComparedPair>,
    /// Number of further ones; missing if there are none.
    #[serde(skip_serializing_if = "is_zero")]
    pub more_new_failures: u64,
    /// Number of all of these in which B violates the requirement. The others have no verdict.
    pub new_violations: u64,
    /// Simulations in which B succeeds and A does not, at most 10,000.
    pub fixed_failures: Vec<ComparedPair>,
    /// Number of further ones; missing if there are none.
    #[serde(skip_serializing_if = "is_zero")]
    pub more_fixed_failures: u64,
    /// The axes of the scenarios.
    pub space_axes: Vec<AxisFacts>,
}

impl Comparison {
    /// Returns whether simulations of both runs have a verdict. Otherwise nothing is compared.
    pub fn has_verdicts(&self) -> bool {
        self.success.first.value.is_some() && self.success.second.value.is_some()
    }

    /// Replaces the largest share without a verdict with which the comparison concludes.
    pub fn set_max_share(&mut self, max_share: f64) {
        for run in [&mut self.first, &mut self.second] {
            run.without_verdict.max_share = max_share;
        }
    }

    /// Returns the numbers of new and of fixed failures.
    pub fn changes(&self) -> [u64; 2] {
        let all = |listed: &[ComparedPair], more: u64| listed.len() as u64 + more;
        [all(&self.new_failures, self.more_new_failures), all(&self.fixed_failures, self.more_fixed_failures)]
    }
}

fn is_zero(count: &u64) -> bool {
    *count == 0
}

/// A run of a comparison.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct ComparedRun {
    /// Path of the run file.
    pub run: String,
    /// Name or path of the controller; `null` without one.
    pub controller: Option<String>,
    /// Hash of what the controller does; `null` without one.
    pub controller_hash: Option<String>,
    /// Guard of the controller; left out without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub guard: Option<GuardFacts>,
    /// Hash of the target.
    pub target_hash: String,
    /// Parts of the target that its hash does not cover, so that an equal hash does not say that
    /// they are the same.
    pub not_covered: Vec<String>,
    /// Git commit of the program that made the run.
    pub commit: String,
    /// Success rate of the control arm: the same starts and seeds, all other axes at nominal;
    /// `null` without one.
    pub nominal: Option<Estimate>,
    /// Random simulations without a verdict on success, of the pairs that count. They do not count
    /// as successes.
    pub without_verdict: WithoutVerdict,
}

/// A rate of both runs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct PairedRates {
    /// Rate of A, with its Wilson interval, or with one that holds at any time; `null` if no
    /// simulation of A has a verdict.
    pub first: Estimate,
    /// Rate of B, likewise.
    pub second: Estimate,
    /// B minus A, with Newcombe's interval for pairs, or with one that holds at any time; `null` if
    /// one of the rates is.
    pub difference: Estimate,
    /// Number of pairs in which only A succeeds.
    pub first_only: u64,
    /// Number of pairs in which only B succeeds.
    pub second_only: u64,
    /// Two-sided p-value of the exact McNemar test, or of its form that holds at any time.
    pub p_value: f64,
}

/// A mean of both runs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct PairedMeans {
    /// Mean of A; `null` without pairs.
    #[serde(serialize_with = "optional::serialize")]
    #[cfg_attr(feature = "schema", schemars(with = "Option<Number>"))]
    pub first: Option<f64>,
    /// Mean of B; `null` without pairs.
    #[serde(serialize_with = "optional::serialize")]
    #[cfg_attr(feature = "schema", schemars(with = "Option<Number>"))]
    pub second: Option<f64>,
    /// B minus A, with its bootstrap interval over the pairs.
    pub difference: Estimate,
    /// Number of pairs in which B's value is smaller.
    pub smaller: u64,
    /// Number of pairs in which B's value is larger.
    pub larger: u64,
    /// Two-sided p-value of the exact sign test, or of its form that holds at any time.
    pub p_value: f64,
}

/// A simulation of both runs.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct ComparedPair {
    /// Number of the trial; trial 2 has the corners and the center of the initial box.
    pub trial: u32,
    /// Number of the simulation within the trial.
    pub simulation: u32,
    /// Random seed of the simulation.
    pub seed: Seed,
    /// Scenario by axis; a value that is drawn at random is `null`.
    pub scenario: Scenario,
    /// Robustness in A; `null` without a verdict.
    pub first_robustness: Option<Number>,
    /// Robustness in B; `null` without a verdict.
    pub second_robustness: Option<Number>,
    /// Command that replays the failure.
    pub replay: String,
}
