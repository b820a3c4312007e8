use serde::Serialize;

use crate::{EndReasons, Estimate, Named, Number, Scenario, Seed, Subject, WithoutVerdict, optional};

/// Relations between the results of pairs of scenarios: metamorphic relations.
///
/// A source case is a random scenario. A relation changes some of its axes, which gives the
/// follow-up case, and says what must hold between the two results. Both cases have the same seed.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Metamorphic {
    /// Path of the run file; missing if none is written.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub run: Option<String>,
    /// Target, controller, noise and the space of both cases.
    #[serde(flatten)]
    pub subject: Subject,
    /// The requirement.
    pub formula: String,
    /// The values of source cases, in the order of the axes.
    pub sources: Vec<SourceRange>,
    /// Requested number of source cases.
    pub pairs: u64,
    /// Number of all simulations.
    pub simulations: u64,
    /// The simulations without a verdict.
    pub without_verdict: WithoutVerdict,
    /// Why no simulation asks anything of the controller, so that none is evidence; `null`
    /// otherwise.
    pub asks_nothing: Option<String>,
    /// Whether the seed has an effect. If so, each pair has its own seed.
    pub is_random: bool,
    /// Whether the test was not interrupted; otherwise the counts are those of the finished pairs.
    pub is_complete: bool,
    /// The relations.
    pub relations: Vec<MetamorphicRelation>,
    /// Reasons that the target gave for the ends of simulations, by end; missing without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reasons: Option<Vec<EndReasons>>,
}

impl Metamorphic {
    /// Returns whether a pair has two verdicts. Without one, nothing was tested.
    pub fn has_verdict(&self) -> bool {
        self.relations.iter().any(|relation| relation.broken_rate.n > 0)
    }

    /// Returns why a relation has no conclusion: too few of its pairs have two verdicts, also where
    /// all pairs together have enough. `None` if each relation has one.
    pub fn open_relation(&self) -> Option<String> {
        let is_open = |relation: &&MetamorphicRelation| {
            let share = relation.without_verdict as f64 / relation.pairs as f64;
            relation.broken == 0 && relation.pairs > 0 && share > self.without_verdict.max_share
        };
        self.relations.iter().find(is_open).map(|MetamorphicRelation { name, pairs, without_verdict, .. }| {
            format!(
                "no conclusion about the relation {name}: {without_verdict} of its {pairs} pairs have no verdict \
                 (max-without-verdict)"
            )
        })
    }

    /// Returns whether a relation is broken.
    pub fn is_broken(&self) -> bool {
        self.relations.iter().any(|relation| relation.broken > 0)
    }
}

/// The range from which an axis of source cases is drawn.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct SourceRange {
    /// Name of the axis.
    pub axis: String,
    /// Lowest value.
    pub low: f64,
    /// Highest value.
    pub high: f64,
}

/// The pairs of a metamorphic relation.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct MetamorphicRelation {
    /// Name of the relation.
    pub name: String,
    /// The change of each changed axis: an offset such as `+0.02`, a factor such as `*0.8`, or a
    /// value such as `=0.3`.
    pub change: Named<String>,
    /// The relation of the results: `same-verdict`, `not-better`, `not-worse`, the last two also
    /// with a tolerance of the robustness as in `not-worse:0.05`, or `robustness-within:DISTANCE`.
    pub holds: String,
    /// Number of pairs that were simulated.
    pub pairs: u64,
    /// Number of source cases whose follow-up case is outside of the bounds of an axis. They were
    /// not simulated for this relation.
    pub out_of_bounds: u64,
    /// Number of pairs in which a simulation has no verdict.
    pub without_verdict: u64,
    /// The verdicts of the other pairs.
    pub verdicts: VerdictCounts,
    /// Number of pairs that break the relation.
    pub broken: u64,
    /// The rate of broken pairs among those with two verdicts.
    pub broken_rate: Estimate,
    /// Up to 100 broken pairs, the largest difference of the robustness first.
    pub worst: Vec<BrokenPair>,
    /// The smallest share of the change that still breaks the relation from the source case of the
    /// first of them; `null` without one, or if an axis is changed to a category.
    pub smallest_change: Option<SmallestChange>,
}

/// Pairs by the verdicts of source case and follow-up case.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct VerdictCounts {
    /// Both satisfy the requirement.
    pub both_satisfied: u64,
    /// Both violate it.
    pub both_violated: u64,
    /// The source case satisfies it, the follow-up case violates it.
    pub worse: u64,
    /// The source case violates it, the follow-up case satisfies it.
    pub better: u64,
}

/// A pair that breaks a relation.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct BrokenPair {
    /// Number of the pair, from 1.
    pub pair: u32,
    /// Random seed of both cases.
    pub seed: Seed,
    /// The source case.
    pub source: PairCase,
    /// The follow-up case.
    pub follow_up: PairCase,
    /// Robustness of the follow-up case minus that of the source case.
    pub difference: Number,
}

/// A simulation of a pair.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct PairCase {
    /// Its trial in the run.
    pub trial: u32,
    /// Its number in the trial.
    pub simulation: u32,
    /// Scenario by axis.
    pub scenario: Scenario,
    /// Robustness; `null` without a verdict.
    #[serde(serialize_with = "optional::serialize")]
    #[cfg_attr(feature = "schema", schemars(with = "Option<Number>"))]
    pub robustness: Option<f64>,
    /// Whether it violates the requirement; `null` without a verdict.
    pub is_violated: Option<bool>,
}

/// The smallest change that was found to break a relation, by bisection: an upper bound.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct SmallestChange {
    /// Number of the pair.
    pub pair: u32,
    /// Share of the change, up to 1.
    pub share: f64,
    /// Largest smaller share that was tried and does not break the relation; 0 is the source case
    /// itself.
    pub holds_at: f64,
    /// Difference from the source case on each changed axis, in the unit of the axis.
    pub change: Named<f64>,
    /// The follow-up case with this change.
    pub follow_up: PairCase,
    /// Number of simulations of the bisection.
    pub simulations: u64,
}
