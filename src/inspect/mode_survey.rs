//! Findings of the trials of a run: failure modes, when each appeared, how many are unseen, and
//! coverage of the space.

use std::collections::BTreeMap;

use mishandle_results::{Coverage, UnseenModes};
use mishandle_store::RunFile;

use crate::error::MishandleError;
use crate::inspect::{FailureMode, FailureModes, failure_modes, space_coverage};

/// The failure modes of a run and how the trials found them.
#[derive(Clone, Debug, PartialEq)]
pub struct ModeSurvey {
    /// The modes of all trials together.
    pub modes: FailureModes,
    /// For each mode the trials that found it, each with the number of the first simulation in it.
    pub first: Vec<BTreeMap<u32, u32>>,
    /// Estimates of the unseen modes; `None` for fewer than two trials.
    pub unseen: Option<UnseenModes>,
    /// Coverage of the space.
    pub coverage: Coverage,
}

/// Returns the estimates from the number of trials that found each mode; `None` for fewer than two
/// trials.
///
/// The number of new modes of another trial is estimated by the modes that exactly one trial found,
/// over the trials. It is unbiased for the last trial given the others, since the trials are
/// exchangeable. The total is the bias-corrected Chao2 estimate S + (T - 1) / T · Q₁ (Q₁ - 1) / (2
/// (Q₂ + 1)) for S modes, T trials, and Q₁ and Q₂ modes that one and two trials found. Chao,
/// "Estimating the population size for capture-recapture data with unequal catchability",
/// Biometrics 43(4), 1987.
///
/// # Example
/// ```
/// use mishandle::inspect::unseen_modes;
/// // 5 modes in 4 trials: S = 5, Q₁ = 3, Q₂ = 1. 5 + 3/4 · 3 · 2 / (2 · 2) = 6.125
/// let unseen = unseen_modes(&[4, 2, 1, 1, 1], 4).unwrap();
/// assert_eq!((unseen.expected_new, unseen.total), (0.75, 6.125));
/// ```
pub fn unseen_modes(counts: &[usize], trials: usize) -> Option<UnseenModes> {
    let found_by = |n: usize| counts.iter().filter(|count| **count == n).count();
    let once = found_by(1);
    let twice = found_by(2);
    let t = trials as f64;
    let pairs = once as f64 * (once as f64 - 1.0);
    (trials >= 2).then(|| UnseenModes {
        trials: trials as u64,
        found_once: once as u64,
        expected_new: once as f64 / t,
        total: counts.len() as f64 + (t - 1.0) / t * pairs / (2.0 * (twice as f64 + 1.0)),
    })
}

impl ModeSurvey {
    /// Returns the simulations of a trial at which it found a mode that it had not found before, in
    /// order: its curve of modes against simulations.
    pub fn curve(&self, trial: u32) -> Vec<u32> {
        let mut numbers: Vec<u32> =
            self.first.iter().filter_map(|first| first.get(&trial).copied()).collect();
        numbers.sort_unstable();
        numbers
    }
}

/// Surveys the failure modes of a run.
///
/// # Errors
/// If the run cannot be read, or the formula has no finite value on a recorded trace.
pub fn mode_survey(run: &RunFile) -> Result<ModeSurvey, MishandleError> {
    let modes = failure_modes(run)?;
    let first: Vec<BTreeMap<u32, u32>> = modes.modes.iter().map(first_simulations).collect();
    let trials = run.trials()?.iter().filter(|trial| trial.counts.simulations > 0).count();
    let counts: Vec<usize> = first.iter().map(BTreeMap::len).collect();
    Ok(ModeSurvey { modes, first, unseen: unseen_modes(&counts, trials), coverage: space_coverage(run)? })
}

/// Returns the first simulation of each trial in a mode.
fn first_simulations(mode: &FailureMode) -> BTreeMap<u32, u32> {
    let mut first = BTreeMap::new();
    for failure in &mode.failures {
        let number = first.entry(failure.trial).or_insert(failure.number);
        *number = failure.number.min(*number);
    }
    first
}
