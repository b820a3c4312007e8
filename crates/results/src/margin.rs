use serde::Serialize;

use crate::{
    AxisFacts, EndReasons, Named, Number, Repeats, Scenario, Seed, Subject, WithoutVerdict, optional,
};

/// The smallest disturbance that violates a requirement.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Margin {
    /// Path of the run file; missing if none is written.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub run: Option<String>,
    /// Target, controller, noise and space of the disturbances.
    #[serde(flatten)]
    pub subject: Subject,
    /// The requirement.
    pub formula: String,
    /// Names of the axes of the target that the space lacks: they stay nominal.
    pub at_nominal: Vec<String>,
    /// Number of simulations, without the repeats of the witness.
    pub simulations: u64,
    /// Whether the seed has an effect. If so, the simulations of the search have different seeds.
    pub is_random: bool,
    /// Whether the search and the repeats of the witness were not interrupted.
    pub is_complete: bool,
    /// The simulations of the search without a verdict.
    pub without_verdict: WithoutVerdict,
    /// Why no simulation asks anything of the controller, so that none is evidence; `null`
    /// otherwise.
    pub asks_nothing: Option<String>,
    /// Smallest amplitude of a simulation without a verdict in all searches, from which on nothing
    /// is claimed; `null` without one.
    pub smallest_without_verdict: Option<f64>,
    /// Names of the categorical axes and the category at which each of them stays. A margin varies
    /// numbers only.
    pub categories: Named<String>,
    /// The search for each combination of categories, if that was requested; otherwise empty.
    /// `categories`, `levels` and `witness` are of the search with the smallest disturbance.
    pub each_category: Vec<CategoryMargin>,
    /// The amplitudes in the order in which they were tried.
    pub levels: Vec<Level>,
    /// Largest amplitude below that of the witness at which a finished search found no violation,
    /// and below `smallest_without_verdict`; with several searches, the smallest of theirs. `null`
    /// without one, and if `asks_nothing`.
    pub no_violation_up_to: Option<f64>,
    /// Number of simulations with a verdict on which `no_violation_up_to` rests; `null` without
    /// one.
    pub no_violation_simulations: Option<u64>,
    /// Number of different seeds of these; `null` without one.
    pub no_violation_seeds: Option<u64>,
    /// Whether all scenarios up to `no_violation_up_to` were simulated; `null` without one.
    pub no_violation_is_exhaustive: Option<bool>,
    /// The violation with the smallest disturbance; `null` without one.
    pub witness: Option<Witness>,
    /// Reasons that the target gave for the ends of simulations, by end; missing without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reasons: Option<Vec<EndReasons>>,
}

impl Margin {
    /// Returns whether a simulation has a verdict. Without one, the system was not tested.
    pub fn has_verdict(&self) -> bool {
        self.without_verdict.ends.total() < self.without_verdict.ends.simulations
    }

    /// Returns the disturbed axes whose nominal value may follow from the range that the plan sets:
    /// amplitudes are measured from there.
    pub fn measured_axes(&self) -> impl Iterator<Item = &AxisFacts> {
        self.subject.moved_axes().filter(|axis| axis.kind != "start" && !axis.is_fixed())
    }

    /// Returns the axes that stay nominal, in words; empty without one.
    pub fn at_nominal_text(&self) -> String {
        match self.at_nominal.as_slice() {
            [] => String::new(),
            [first, second, third, more @ ..] if more.len() > 1 => {
                format!("at nominal: {first}, {second}, {third} and {} more", more.len())
            }
            few => format!("at nominal: {}", few.join(", ")),
        }
    }
}

/// The smallest disturbance at one combination of categories.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct CategoryMargin {
    /// The category of each categorical axis.
    pub categories: Named<String>,
    /// Number of simulations.
    pub simulations: u64,
    /// Whether the search was not interrupted.
    pub is_complete: bool,
    /// Amplitude of the smallest violation that was found; `null` without one.
    pub amplitude: Option<f64>,
    /// Number of its simulation in the run; `null` without one.
    pub simulation: Option<u32>,
    /// As in the whole document.
    pub no_violation_up_to: Option<f64>,
    /// As in the whole document.
    pub no_violation_simulations: Option<u64>,
}

impl CategoryMargin {
    /// Returns the largest amplitude without a violation and the number of simulations with a
    /// verdict on which it rests, in words.
    pub fn no_violation_text(&self, amplitude: impl Fn(f64) -> String) -> Option<String> {
        let verdicts = self.no_violation_simulations.unwrap_or(0);
        self.no_violation_up_to.map(|largest| format!("{} ({verdicts} with a verdict)", amplitude(largest)))
    }
}

/// The simulations with disturbances up to an amplitude.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Level {
    /// Largest offset of a disturbed axis, as a fraction of the distance from its nominal value to
    /// its bound.
    pub amplitude: f64,
    /// Number of simulations.
    pub simulations: u64,
    /// Number of different seeds of these; 1 if the seed has no effect.
    pub seeds: u64,
    /// Number of simulations without a verdict, also those from whose scenario the target cannot
    /// start.
    pub without_verdict: u64,
    /// Number of these from whose scenario the target cannot start.
    pub invalid_starts: u64,
    /// Minimum robustness; `null` if no simulation has one.
    #[serde(serialize_with = "optional::serialize")]
    #[cfg_attr(feature = "schema", schemars(with = "Option<Number>"))]
    pub minimum_robustness: Option<f64>,
    /// Whether a simulation violates the requirement.
    pub is_violated: bool,
    /// Whether the search at this amplitude was not interrupted.
    pub is_complete: bool,
    /// Whether all scenarios up to the amplitude were simulated, and those from which the target
    /// can start have a verdict. It is possible if all axes are discrete.
    pub is_exhaustive: bool,
}

impl Level {
    /// Makes the level of an amplitude without simulations.
    pub fn new(amplitude: f64) -> Level {
        Level {
            amplitude,
            simulations: 0,
            seeds: 0,
            without_verdict: 0,
            invalid_starts: 0,
            minimum_robustness: None,
            is_violated: false,
            is_complete: false,
            is_exhaustive: false,
        }
    }

    /// Returns the number of simulations with a verdict.
    pub fn verdicts(&self) -> u64 {
        self.simulations - self.without_verdict
    }
}

/// A violation and the size of its disturbance.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Witness {
    /// The norms of its disturbance.
    #[serde(flatten)]
    pub norms: Norms,
    /// Number of disturbed axes.
    pub axes: u64,
    /// Number of its simulation in the run.
    pub simulation: u32,
    /// Scenario by axis; a value that is drawn at random is `null`.
    pub scenario: Scenario,
    /// Random seed.
    pub seed: Seed,
    /// Robustness.
    pub robustness: Option<Number>,
    /// Repeats of the witness with other seeds; `null` if the seed has no effect.
    pub repeats: Option<Repeats>,
    /// Whether more than half of the repeats violate the requirement; `null` without repeats.
    pub fails_in_most_repeats: Option<bool>,
}

/// Norms of a disturbance. The offset of an axis from its nominal value is in units of the distance
/// from the nominal value to the bound on the same side, so that 1 is the largest offset.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Norms {
    /// Largest offset (L∞): the amplitude.
    pub amplitude: f64,
    /// Root of the sum of the squares of the offsets (L2).
    pub l2: f64,
    /// Sum of the offsets (L1).
    pub l1: f64,
}
