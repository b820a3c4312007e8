//! Trials that continue after their first violation and collect failure modes.
//!
//! Such a trial is a sequence of searches. A local search ends at a failure, as in a plain trial,
//! and is steered away from the failures of those before it, so that the trial does not stay in the
//! first failing patch. It works for every search, because only the reported values change:
//!
//! - Near a known failure a search observes at least m (2 - d / r), with the median m of |ρ| in the
//!   trial so far, the distance d to the failure and the radius r. The known wells of the landscape
//!   are filled, with a slope away from them.
//! - A search without a failure is replaced after 50 simulations times the next number of Luby's
//!   sequence 1, 1, 2, 1, 1, 2, 4, ..., which starts again at each failure at a new place.
//! - A search that keeps exploring the whole box, such as `random` or `portfolio`, is not replaced,
//!   neither after a failure nor later. It keeps what it knows.
//!
//! This is the sequential niche technique of Beasley, Bull and Martin, "A sequential niche
//! technique for multimodal function optimization", Evolutionary Computation 1(2), 1993, with the
//! restarts of Luby, Sinclair and Zuckerman, "Optimal speedup of Las Vegas algorithms", Information
//! Processing Letters 47(4), 1993. The failures at new places are an unstructured archive as in
//! quality-diversity search: Lehman and Stanley, "Abandoning objectives", Evolutionary Computation
//! 19(2), 2011; Cully and Demiris, "Quality and diversity optimization: a unifying modular
//! framework", IEEE Transactions on Evolutionary Computation 22(2), 2018. The grid of MAP-Elites
//! (Mouret and Clune, "Illuminating search spaces by mapping elites", 2015) would cut a failing
//! patch into cells and count each of them.
//!
//! The values before the first violation are the true ones. So the simulations up to it are those
//! of a trial that ends there.

use std::collections::BTreeMap;
use std::rc::Rc;

use mishandle_rollout::{Episode, RolloutError, Space};
use mishandle_search::Observation;
use mishandle_stl::{Trace, is_satisfied, is_violated};

use crate::modes::{axes_that_matter, distance, is_same_time};
use crate::trial::observation;
use crate::{
    FailurePoint, FalsificationError, MAX_FAILURES, MAX_OTHERS, Signature, UnitScenario, group_failures,
    unit_scenario,
};

/// Root mean square distance r from a known failure within which values are raised: half of the
/// distance within which two failures belong to one mode, so that a patch is covered before the
/// search leaves it.
const RADIUS: f64 = 0.075;

/// Number of simulations of a search without a failure at a new place, times a number of Luby's
/// sequence.
const RESTART_AFTER: u32 = 50;

/// Number of values that count for the median; later ones do not.
const MAX_VALUES: usize = 1000;

/// Probability that the stopping rule stops too early: see [`simulations_without_mode`].
const ERROR: f64 = 0.05;

/// Returns predicate and time of a violating trace.
pub type SignatureOf<'a> = dyn Fn(&Trace) -> Result<Signature, RolloutError> + 'a;

/// Settings of trials that continue after their first violation.
#[derive(Clone)]
pub struct KeepGoing<'a> {
    /// Returns predicate and time of a violation.
    pub signature: Rc<SignatureOf<'a>>,
    /// Number of control steps of an episode.
    pub episode_steps: usize,
    /// A trial ends when less than this fraction of its simulations finds a new mode: see
    /// [`simulations_without_mode`]. With 0, it spends its budget.
    pub new_mode_rate: f64,
}

/// Returns the number of simulations without a new mode after which a trial with `modes` modes
/// ends: the smallest m with (1 - p)^m ≤ 0.05 / (k (k + 1)), for the rate p and k modes; `None` if
/// p is 0.
///
/// If each simulation finds a new mode with a probability of at least p, whatever happened before,
/// then m simulations without one have a probability of at most 0.05 / (k (k + 1)). These sum to
/// 0.05 over all k. So a trial stops while new modes are that frequent with a probability of at
/// most 5 %. The search may choose its points in any way. Estimates of Good and Turing, which
/// fuzzers use (Böhme, "STADS: software testing as species discovery", ACM TOSEM 27(2), 2018), need
/// independent samples.
///
/// # Example
/// ```
/// use mishandle_falsification::simulations_without_mode;
/// // ln(0.05 / 2) / ln(0.99) = 367.04
/// assert_eq!(simulations_without_mode(1, 0.01), Some(368));
/// assert_eq!(simulations_without_mode(1, 0.0), None);
/// ```
pub fn simulations_without_mode(modes: usize, rate: f64) -> Option<u32> {
    let k = modes.max(1) as f64;
    (rate > 0.0).then(|| ((ERROR / (k * (k + 1.0))).ln() / (-rate).ln_1p()).ceil() as u32)
}

/// The failures of the target that a trial knows.
pub(crate) struct Archive<'a> {
    settings: KeepGoing<'a>,
    space: Space,
    simulations: u32,
    failures: Vec<FailurePoint>,
    /// Numbers of the simulations of `failures`.
    numbers: Vec<u32>,
    /// Scenarios that do not fail.
    others: Vec<UnitScenario>,
    /// Known failures, by predicate.
    wells: BTreeMap<String, Well>,
    /// Absolute values of the robustness, sorted.
    magnitudes: Vec<f64>,
    /// Number of searches since the last failure at a new place.
    searches: u32,
    /// Whether the last simulation failed, and whether at a new place.
    has_failed: bool,
    has_discovered: bool,
    /// Number of the simulation before which the trial cannot end for lack of new modes.
    next_check: u32,
}

/// The known failures of one predicate, at a distance of more than [`RADIUS`] from each other or at
/// different times.
#[derive(Default)]
struct Well {
    known: Vec<(UnitScenario, usize)>,
    /// Axes of the distance.
    axes: Vec<usize>,
}

impl<'a> Archive<'a> {
    pub(crate) fn new(settings: KeepGoing<'a>, space: Space) -> Archive<'a> {
        Archive {
            settings,
            space,
            simulations: 0,
            failures: Vec::new(),
            numbers: Vec::new(),
            others: Vec::new(),
            wells: BTreeMap::new(),
            magnitudes: Vec::new(),
            searches: 1,
            has_failed: false,
            has_discovered: false,
            next_check: 0,
        }
    }

    /// Adds an episode and returns what the search observes.
    pub(crate) fn observe(&mut self, episode: &Episode) -> Result<Observation, FalsificationError> {
        self.simulations += 1;
        (self.has_failed, self.has_discovered) = (false, false);
        let Some(robustness) = episode.robustness() else {
            return Ok(observation(None, &episode.verdict));
        };
        self.add_magnitude(robustness.abs());
        let point = unit_scenario(self.space.axes(), episode.request.scenario.values());
        if is_violated(robustness) {
            self.add_failure(&point, episode)?;
        }
        let level = self.level(&point);
        if is_satisfied(robustness) && self.others.len() < MAX_OTHERS {
            self.others.push(point);
        }
        Ok(raised(observation(Some(robustness), &episode.verdict), level))
    }

    /// Returns whether new modes have become rarer than the settings require.
    pub(crate) fn is_dry(&mut self) -> bool {
        let rate = self.settings.new_mode_rate;
        if self.failures.is_empty() || self.simulations < self.next_check {
            return false;
        }
        let axes = self.space.axes();
        let modes = group_failures(&self.failures, &self.others, axes, self.settings.episode_steps);
        let first = |members: &[usize]| members.iter().map(|index| self.numbers[*index]).min();
        let newest = modes.iter().filter_map(|mode| first(&mode.failures)).max().unwrap_or(0);
        let wait = simulations_without_mode(modes.len(), rate).unwrap_or(u32::MAX);
        self.next_check = newest.saturating_add(wait);
        self.simulations >= self.next_check
    }

    /// Returns whether the trial has found a violation. Before it has, its search is not replaced.
    pub(crate) fn has_failures(&self) -> bool {
        !self.failures.is_empty()
    }

    /// Returns whether the last simulation failed, so that another search must continue.
    pub(crate) fn has_failed(&self) -> bool {
        self.has_failed
    }

    /// Returns the number of simulations after which another search must continue; `None` before
    /// the first violation.
    pub(crate) fn search_limit(&self) -> Option<u32> {
        self.has_failures().then(|| RESTART_AFTER.saturating_mul(luby(self.searches)))
    }

    /// Notes that a new search starts.
    pub(crate) fn restart(&mut self) {
        self.searches = if self.has_discovered { 1 } else { self.searches + 1 };
    }

    fn add_failure(&mut self, point: &UnitScenario, episode: &Episode) -> Result<(), FalsificationError> {
        let trial = episode.request.trial;
        let number = episode.request.number;
        if episode.trace.is_empty() {
            return Err(FalsificationError::NoTrace { trial, number });
        }
        let signature = (self.settings.signature)(&episode.trace)?;
        let Signature { predicate, sample } = signature.clone();
        self.has_failed = true;
        if self.failures.len() < MAX_FAILURES {
            self.failures.push(FailurePoint { point: point.clone(), signature });
            self.numbers.push(number);
        }
        let axes = self.space.axes();
        let steps = self.settings.episode_steps;
        let well = self.wells.entry(predicate.clone()).or_default();
        let is_known = |(known, at): &(UnitScenario, usize)| {
            is_same_time(*at, sample, steps) && distance(axes, &well.axes, known, point) <= RADIUS
        };
        if well.known.iter().any(is_known) {
            return Ok(());
        }
        well.known.push((point.clone(), sample));
        self.has_discovered = true;
        let own = self.failures.iter().filter(|failure| failure.signature.predicate == predicate);
        let points: Vec<&UnitScenario> = own.map(|failure| &failure.point).collect();
        well.axes = axes_that_matter(&points, &self.others, axes.len());
        if well.axes.is_empty() {
            // Nothing is known about them.
            well.axes = (0..axes.len()).collect();
        }
        Ok(())
    }

    /// Returns the least value that a search observes at a scenario; -∞ far from all known
    /// failures.
    fn level(&self, point: &UnitScenario) -> f64 {
        let axes = self.space.axes();
        let to = |well: &Well, known: &UnitScenario| distance(axes, &well.axes, known, point);
        let distances =
            self.wells.values().flat_map(|well| well.known.iter().map(|(known, _)| to(well, known)));
        let nearest = distances.fold(f64::INFINITY, f64::min);
        let median = self.magnitudes.get(self.magnitudes.len() / 2);
        match median.filter(|_| nearest <= RADIUS) {
            Some(median) => median * (2.0 - nearest / RADIUS),
            None => f64::NEG_INFINITY,
        }
    }

    fn add_magnitude(&mut self, value: f64) {
        if value.is_finite() && self.magnitudes.len() < MAX_VALUES {
            let index = self.magnitudes.partition_point(|other| *other < value);
            self.magnitudes.insert(index, value);
        }
    }
}

/// Returns an observation that is at least `level`. Minima and maxima of raised parts compose the
/// raised robustness.
fn raised(observation: Observation, level: f64) -> Observation {
    let Observation { robustness, parts } = observation;
    Observation {
        robustness: robustness.max(level),
        parts: parts.iter().map(|part| part.max(level)).collect(),
    }
}

/// Returns number `i` of Luby's sequence 1, 1, 2, 1, 1, 2, 4, ..., counted from 1.
fn luby(i: u32) -> u32 {
    // The sequence up to 2^k - 1 is twice the one up to 2^(k-1) - 1, and then 2^(k-1).
    let k = u32::BITS - i.leading_zeros();
    if i.count_ones() == k { 1 << (k - 1) } else { luby(i + 1 - (1 << (k - 1))) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn luby_numbers_are_those_of_the_paper() {
        let expected = [1, 1, 2, 1, 1, 2, 4, 1, 1, 2, 1, 1, 2, 4, 8];
        assert_eq!((1..=15).map(luby).collect::<Vec<_>>(), expected);
    }

    #[test]
    fn raised_parts_compose_the_raised_robustness() {
        use mishandle_search::Composition::{Max, Min, Part};
        let composition = Max(vec![Min(vec![Part(0), Part(1)]), Part(2)]);
        for parts in [[-1.0, 2.0, -3.0], [0.5, 4.0, 0.1], [f64::NEG_INFINITY, 1.0, f64::INFINITY]] {
            let robustness = composition.value(&parts);
            for level in [f64::NEG_INFINITY, -2.0, 0.2, 3.0] {
                let found = raised(Observation { robustness, parts: parts.to_vec() }, level);
                assert_eq!(composition.value(&found.parts), found.robustness);
                assert_eq!(found.robustness, robustness.max(level));
            }
        }
    }

    #[test]
    fn the_wait_for_a_new_mode_bounds_the_probability_of_stopping_early() {
        for (k, p) in [(1, 0.01), (2, 0.01), (6, 0.01), (6, 0.2), (50, 0.001)] {
            let m = simulations_without_mode(k, p).unwrap();
            let bound = 0.05 / (k * (k + 1)) as f64;
            assert!((1.0 - p).powi(m as i32) <= bound && (1.0 - p).powi(m as i32 - 1) > bound, "{k} {p}");
        }
        assert_eq!(simulations_without_mode(3, 0.0), None);
    }
}
