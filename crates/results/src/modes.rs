use serde::Serialize;

use crate::{Named, Number, PhysicsCheck, Scenario, Seed};

/// Findings of trials that keep going: failure modes, estimates of the unseen ones, coverage of the
/// space.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Modes {
    /// Number of simulations that violate the requirement, over all trials. This key and the next
    /// four exist with `falsify.keep-going` only.
    pub failures: u64,
    /// Number of these that are in no mode: without a recorded trace, or beyond 5,000.
    pub not_grouped: u64,
    /// Failure modes, the one with the most failures first.
    pub modes: Vec<FoundMode>,
    /// Estimates of the modes that no trial found; `null` for fewer than two trials.
    pub unseen_modes: Option<UnseenModes>,
    /// Pairwise coverage of the space by the simulations.
    pub coverage: Coverage,
}

/// A failure mode and the trials that found it.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct FoundMode {
    /// The mode.
    #[serde(flatten)]
    pub mode: FailureMode,
    /// The trials that found it.
    pub found: Vec<FirstInMode>,
}

/// The first simulation of a trial in a mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct FirstInMode {
    /// Number of the trial.
    pub trial: u32,
    /// Number of its first simulation in the mode.
    pub simulation: u32,
}

/// Failures with the same decisive predicate, similar scenarios and similar times.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct FailureMode {
    /// Number of the mode, from 1.
    pub mode: u64,
    /// Number of its failures.
    pub failures: u64,
    /// Their decisive predicate; empty if the formula has none.
    pub predicate: String,
    /// First and last sample at which the violation of a failure is final.
    pub samples: [u64; 2],
    /// Times of these samples, s.
    pub times: [f64; 2],
    /// Names of the axes that matter: those by which failures with this predicate were grouped.
    pub axes: Vec<String>,
    /// Smallest and largest value by axis; `null`: drawn at random.
    pub region: Named<Option<[f64; 2]>>,
    /// Number of the trial of the representative, the failure nearest to the nominal scenario.
    pub trial: u32,
    /// Number of the representative within its trial.
    pub simulation: u32,
    /// Its random seed.
    pub seed: Seed,
    /// Its scenario by axis; a value that is drawn at random is `null`.
    pub scenario: Scenario,
    /// Its robustness.
    pub robustness: Number,
    /// Root mean square of its offsets from nominal over the axes, as fractions of their widths.
    pub distance_from_nominal: f64,
    /// The check of its physics; `null` in the documents of commands that simulate nothing, and for
    /// a target whose physics MuJoCo C does not step.
    pub physics: Option<PhysicsCheck>,
}

/// Estimates of the failure modes that no trial found, from the numbers of trials that found each
/// mode.
///
/// The trials of a run have independent seeds, so these estimates hold for searches that choose
/// their points by earlier results. Those from the number of failures of each mode, as in Good and
/// Turing, would need independent simulations.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct UnseenModes {
    /// Number of trials.
    pub trials: u64,
    /// Number of modes that exactly one trial found.
    pub found_once: u64,
    /// Expected number of new modes of another trial.
    pub expected_new: f64,
    /// Lower estimate of the number of modes that such trials can find (Chao2).
    pub total: f64,
}

/// Pairwise coverage of a space by simulations, with 10 bins for each axis, or its levels if they
/// are fewer.
///
/// The cells are those of every pair of axes (of the axis, if the space has one): pairwise or 2-way
/// coverage, as in Kuhn, Kacker and Lei, "Introduction to combinatorial testing", 2013. Cells of
/// all axes together would be too many to visit.
///
/// A visited cell has at least one simulation. It says nothing about the rest of the cell, and
/// nothing about combinations of three or more axes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Coverage {
    /// Number of pairs of axes with more than one value; 1 for a space with one such axis.
    pub pairs: u64,
    /// Number of cells of all pairs.
    pub cells: u64,
    /// Number of cells with a simulation.
    pub visited: u64,
    /// Number of cells with a failing simulation.
    pub failing: u64,
}

impl Coverage {
    /// Returns the fraction of visited cells; `None` without cells.
    pub fn visited_fraction(&self) -> Option<f64> {
        (self.cells > 0).then(|| self.visited as f64 / self.cells as f64)
    }

    /// Returns the fraction of the visited cells in which a simulation failed; `None` without
    /// visited cells.
    pub fn failing_fraction(&self) -> Option<f64> {
        (self.visited > 0).then(|| self.failing as f64 / self.visited as f64)
    }
}
