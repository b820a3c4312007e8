//! The corners and the center of the initial box: a deterministic supplement to random initial
//! states.

use std::ops::ControlFlow;

use mishandle_rollout::{
    Axis, AxisKind, AxisValues, Episode, EpisodeEnd, Request, Scenario, Seed, Space, System,
};

use crate::run::simulate;
use crate::{
    EvaluationError, FormulaRoles, decides_careful_success, decides_strict_success, decides_success,
};

/// Largest number of axes of which all corners are evaluated.
const ALL_CORNERS: usize = 4;

/// Number of corners of a box with more axes.
const CHOSEN_CORNERS: u32 = 16;

/// Seeds per point if an episode depends on its seed.
const SEEDS: u32 = 20;

/// Digits of the Sobol sequence that choose corners. Point i is in the upper half of a coordinate
/// if an odd number of the selected digits of the Gray code of i is 1. The first 16 points have
/// only eight such patterns: those of the dimensions 1, 2, 3, 4, 5, 8, 10 and 13. Axes beyond the
/// eighth repeat them.
///
/// # Reference
/// Joe and Kuo, "Constructing Sobol sequences with better two-dimensional projections", SIAM
/// Journal on Scientific Computing 30, 2008.
const SOBOL_DIGITS: [u32; 8] = [0b0001, 0b1111, 0b1011, 0b0011, 0b1001, 0b0101, 0b1101, 0b0111];

/// Index of the child seed of the corners. No random simulation of an evaluation has it.
const CHILD: u64 = u64::MAX;

/// The corner simulations of an evaluation.
///
/// The points are all corners of the numeric axes of kind `start` and the center, in this order;
/// other axes have their nominal values. If there are more than four such axes, 16 corners are
/// chosen by the Sobol sequence: point i of the sequence is rounded to the nearest corner.
/// Simulation i, counted from 1, runs point (i - 1) / `seeds`.
#[derive(Clone, Debug, PartialEq)]
pub struct Corners {
    points: Vec<Scenario>,
    seeds: u32,
    seed: Seed,
}

impl Corners {
    /// Number of the trial in which run files hold the corner simulations; trial 1 holds the random
    /// ones.
    pub const TRIAL: u32 = 2;

    /// Returns the corner simulations of `space`; `None` if it has no numeric axis of kind `start`.
    ///
    /// Each point is simulated with 20 seeds if an episode depends on its seed, otherwise once.
    pub fn new(space: &Space, depends_on_seed: bool, seed: Seed) -> Option<Corners> {
        let is_varied = |axis: &Axis| {
            axis.kind == AxisKind::Start
                && !axis.is_fixed()
                && !matches!(axis.values, AxisValues::Categorical(_))
        };
        let varied = space.axes().iter().filter(|axis| is_varied(axis)).count();
        if varied == 0 {
            return None;
        }
        let point = |coordinate: &dyn Fn(usize) -> f64| {
            let mut place = 0..;
            let value = |axis: &Axis| {
                if is_varied(axis) {
                    place.next().map(|place| axis.at(coordinate(place)))
                } else {
                    axis.nominal
                }
            };
            Scenario::new(space.axes().iter().map(value).collect())
        };
        let count = if varied <= ALL_CORNERS { 1 << varied } else { CHOSEN_CORNERS };
        let corner = |index: u32| {
            point(&|place| {
                let is_high = if varied <= ALL_CORNERS {
                    // The last axis changes fastest.
                    index >> (varied - 1 - place) & 1 == 1
                } else {
                    sobol_is_upper_half(index, place)
                };
                f64::from(u8::from(is_high))
            })
        };
        let points = (0..count).map(corner).chain([point(&|_| 0.5)]).collect();
        Some(Corners { points, seeds: if depends_on_seed { SEEDS } else { 1 }, seed: seed.child(CHILD) })
    }

    /// Returns the number of simulations.
    pub fn simulations(&self) -> u32 {
        self.points.len() as u32 * self.seeds
    }

    /// Returns the request of simulation `number`, counted from 1; `None` if there is no such
    /// simulation.
    pub fn request(&self, number: u32) -> Option<Request> {
        let index = number.checked_sub(1)?;
        let scenario = self.points.get((index / self.seeds) as usize)?.clone();
        let seed = self.seed.child(u64::from(index));
        Some(Request { trial: Corners::TRIAL, number, ..Request::new(scenario, seed) })
    }

    /// Returns the report before the first simulation, of the formulas in `roles`. `is_reachable`
    /// returns whether success is possible from a point, `None` if this is unknown.
    pub fn report(
        &self,
        roles: FormulaRoles,
        excludes_unreachable: bool,
        is_reachable: impl Fn(&Scenario) -> Option<bool>,
    ) -> CornerReport {
        let result = |scenario: &Scenario| CornerResult {
            scenario: scenario.clone(),
            is_reachable: is_reachable(scenario),
            n: 0,
            invalid_starts: 0,
            verdicts: [0; 3],
            successes: 0,
            strict_successes: roles.strict.then_some(0),
            careful_successes: roles.careful.then_some(0),
            diverged: 0,
            invalid: 0,
            failed: 0,
            undecided: 0,
        };
        let points = self.points.iter().map(result).collect();
        CornerReport { points, seeds: self.seeds, excludes_unreachable }
    }
}

/// Runs the simulations of `corners` that `report` does not contain, in batches of `batch`, and
/// adds them to `report`.
///
/// `on_batch` receives the episodes of each batch, in order. If it breaks, the report covers the
/// simulations so far.
///
/// # Errors
/// As [`evaluate`](crate::evaluate).
pub fn evaluate_corners<E: From<EvaluationError>>(
    system: &mut dyn System,
    corners: &Corners,
    batch: usize,
    report: &mut CornerReport,
    mut on_batch: impl FnMut(&[Episode]) -> Result<ControlFlow<()>, E>,
) -> Result<(), E> {
    loop {
        let first = report.simulations() + 1;
        let requests: Vec<Request> =
            (first..).map_while(|number| corners.request(number)).take(batch.max(1)).collect();
        if requests.is_empty() {
            return Ok(());
        }
        let episodes = simulate(system, &requests)?;
        episodes.iter().for_each(|episode| report.add(episode));
        if on_batch(&episodes)?.is_break() {
            return Ok(());
        }
    }
}

/// Returns whether coordinate `dimension` of point `index` of the Sobol sequence is at least 1/2.
fn sobol_is_upper_half(index: u32, dimension: usize) -> bool {
    let gray = index ^ index >> 1;
    (gray & SOBOL_DIGITS[dimension % SOBOL_DIGITS.len()]).count_ones() % 2 == 1
}

/// Results of the simulations of one point.
#[derive(Clone, Debug, PartialEq)]
pub struct CornerResult {
    /// The scenario.
    pub scenario: Scenario,
    /// Whether success is possible from this initial state; `None` if the target does not know.
    pub is_reachable: Option<bool>,
    /// Number of simulations.
    pub n: u32,
    /// Number of simulations that cannot start. They decide nothing.
    pub invalid_starts: u32,
    /// Numbers of simulations with a verdict on success, strict success and careful success; 0
    /// without the formula.
    pub verdicts: [u32; 3],
    /// Number of simulations with success.
    pub successes: u32,
    /// Number of simulations with success and strict success; `None` without a strict formula.
    pub strict_successes: Option<u32>,
    /// Number of simulations with success and careful success; `None` without a careful formula.
    pub careful_successes: Option<u32>,
    /// Number of simulations that diverged. Like the next two, they are not successes.
    pub diverged: u32,
    /// Number of simulations that ended because the controller or the environment returned a value
    /// that is not finite.
    pub invalid: u32,
    /// Number of simulations that could not start, crashed or took too long.
    pub failed: u32,
    /// Number of other simulations that left success undecided.
    pub undecided: u32,
}

impl CornerResult {
    /// Returns whether all simulations that started succeed; `None` if none has a verdict.
    pub fn succeeds(&self) -> Option<bool> {
        self.all(self.successes, 0)
    }

    /// Returns whether all simulations that started succeed strictly; `None` if none has a verdict,
    /// and without a strict formula.
    pub fn succeeds_strictly(&self) -> Option<bool> {
        self.all(self.strict_successes?, 1)
    }

    /// Returns whether all simulations that started succeed carefully; `None` if none has a
    /// verdict, and without a careful formula.
    pub fn succeeds_carefully(&self) -> Option<bool> {
        self.all(self.careful_successes?, 2)
    }

    fn all(&self, successes: u32, kind: usize) -> Option<bool> {
        (self.verdicts[kind] > 0).then_some(successes == self.n - self.invalid_starts)
    }
}

/// Results of the corners and the center. They are counts of chosen points, not estimates, so they
/// have no intervals.
#[derive(Clone, Debug, PartialEq)]
pub struct CornerReport {
    /// The corners and, as the last point, the center.
    pub points: Vec<CornerResult>,
    /// Number of simulations per point.
    pub seeds: u32,
    /// Whether unreachable points do not count.
    pub excludes_unreachable: bool,
}

impl CornerReport {
    /// Returns the corners that count.
    pub fn corners(&self) -> impl Iterator<Item = &CornerResult> {
        let corners = &self.points[..self.points.len().saturating_sub(1)];
        corners.iter().filter(|point| self.counts(point))
    }

    /// Returns the center if it counts.
    pub fn center(&self) -> Option<&CornerResult> {
        self.points.last().filter(|point| self.counts(point))
    }

    /// Returns whether a point counts: not if it is excluded as unreachable, or the target cannot
    /// start from it.
    pub fn counts(&self, point: &CornerResult) -> bool {
        let is_excluded = self.excludes_unreachable && point.is_reachable == Some(false);
        !is_excluded && (point.n == 0 || point.invalid_starts < point.n)
    }

    /// Returns the number of simulations so far.
    pub fn simulations(&self) -> u32 {
        self.points.iter().map(|point| point.n).sum()
    }

    /// Adds the next simulation. It may come from a record.
    pub fn add(&mut self, episode: &Episode) {
        let index = self.simulations() / self.seeds.max(1);
        let Some(point) = self.points.get_mut(index as usize) else { return };
        let success = episode.is_success();
        let strict = episode.is_strict_success();
        point.n += 1;
        point.invalid_starts += u32::from(!episode.end.counts_in_rates());
        let decided = [
            decides_success(episode),
            point.strict_successes.is_some() && decides_strict_success(episode),
            point.careful_successes.is_some() && decides_careful_success(episode),
        ];
        point.verdicts.iter_mut().zip(decided).for_each(|(count, decided)| *count += u32::from(decided));
        match episode.end {
            EpisodeEnd::Diverged { .. } => point.diverged += 1,
            end if end.is_invalid() => point.invalid += 1,
            end if end.is_failed() => point.failed += 1,
            _ => point.undecided += u32::from(episode.verdict.success.is_none()),
        }
        point.successes += u32::from(success);
        point.strict_successes = point.strict_successes.map(|successes| successes + u32::from(strict));
        let careful = u32::from(episode.is_careful_success());
        point.careful_successes = point.careful_successes.map(|successes| successes + careful);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use mishandle_rollout::Verdict;
    use mishandle_stl::Trace;

    use super::*;

    fn space(axes: usize) -> Space {
        let axis = |i: usize| Axis::start(&format!("x{i}"), "m", i as f64, i as f64 + 0.5);
        Space::new("starts", (0..axes).map(axis).collect()).unwrap()
    }

    /// Returns the scenario of each simulation.
    fn scenarios(corners: &Corners) -> Vec<Vec<f64>> {
        let request = |number| corners.request(number).unwrap();
        let numbers = 1..=corners.simulations();
        numbers.map(|number| request(number).scenario.values().iter().flatten().copied().collect()).collect()
    }

    #[test]
    fn a_box_of_two_axes_has_four_exact_corners_and_a_center() {
        let corners = Corners::new(&space(2), false, Seed(0)).unwrap();
        let expected = [[0.0, 1.0], [0.0, 1.5], [0.5, 1.0], [0.5, 1.5], [0.25, 1.25]];
        assert_eq!(scenarios(&corners), expected);
        assert_eq!(corners.request(0), None);
        assert_eq!(corners.request(6), None);
        assert_eq!(Corners::new(&space(4), false, Seed(0)).unwrap().simulations(), 17);
    }

    /// The patterns are those of `scipy.stats.qmc.Sobol(13, scramble=False).random(16) >= 0.5`
    /// (SciPy 1.17.1), columns 0, 1, 2, 3, 4, 7, 9 and 12.
    #[test]
    fn more_than_four_axes_have_the_16_corners_of_the_sobol_sequence() {
        let expected = [
            "0110011001100110",
            "0101010101010101",
            "0101101010100101",
            "0101101001011010",
            "0110011010011001",
            "0110100110010110",
            "0110100101101001",
            "0101010110101010",
        ];
        let points = scenarios(&Corners::new(&space(8), false, Seed(0)).unwrap());
        assert_eq!(points.len(), 17);
        for (axis, pattern) in expected.iter().enumerate() {
            let found: String =
                points[..16].iter().map(|point| if point[axis] > axis as f64 { '1' } else { '0' }).collect();
            assert_eq!(found, *pattern, "axis {axis}");
        }
        for axes in 5..9 {
            let mut points = scenarios(&Corners::new(&space(axes), false, Seed(0)).unwrap());
            points.sort_by(|a, b| a.partial_cmp(b).unwrap());
            points.dedup();
            assert_eq!(points.len(), 17, "{axes} axes: the corners differ");
        }
    }

    #[test]
    fn simulations_without_a_verdict_are_counted_by_reason() {
        let corners = Corners::new(&space(2), true, Seed(0)).unwrap();
        let mut report =
            corners.report(FormulaRoles { strict: true, ..FormulaRoles::default() }, false, |_| None);
        let episode = |end, success: Option<f64>| Episode {
            request: corners.request(1).unwrap(),
            trace: Trace::new(Arc::from([])),
            trace_digest: None,
            steps: 1,
            verdict: Verdict { robustness: success, success, strict: success, ..Verdict::default() },
            reason: String::new(),
            total_reward: 0.0,
            end,
        };
        for (end, success) in [
            (EpisodeEnd::Completed, Some(0.5)),
            (EpisodeEnd::Completed, Some(-0.5)),
            (EpisodeEnd::Completed, None),
            (EpisodeEnd::Undefined { step: 1 }, None),
            (EpisodeEnd::Diverged { step: 1 }, None),
            (EpisodeEnd::InvalidAction { step: 1, index: 0 }, None),
            (EpisodeEnd::InvalidSignal { step: 1, index: 0 }, None),
            (EpisodeEnd::InvalidReward { step: 1, index: 0 }, None),
        ] {
            report.add(&episode(end, success));
        }
        let point = &report.points[0];
        assert_eq!((point.n, point.successes, point.strict_successes), (8, 1, Some(1)));
        assert_eq!((point.diverged, point.invalid, point.undecided), (1, 3, 2));
    }

    #[test]
    fn a_point_without_a_verdict_neither_succeeds_nor_fails_and_an_invalid_start_counts_nowhere() {
        let corners = Corners::new(&space(1), false, Seed(0)).unwrap();
        let roles = FormulaRoles { strict: true, careful: true, ..FormulaRoles::default() };
        let found = |seeds: u32, ends: &[(EpisodeEnd, Option<f64>)]| {
            let mut report = CornerReport { seeds, ..corners.report(roles, false, |_| None) };
            for (end, rho) in ends {
                let verdict = Verdict {
                    robustness: *rho,
                    success: *rho,
                    strict: *rho,
                    careful: *rho,
                    ..Verdict::default()
                };
                report.add(&Episode {
                    request: corners.request(1).unwrap(),
                    trace: Trace::new(Arc::from([])),
                    trace_digest: None,
                    steps: 1,
                    verdict,
                    reason: String::new(),
                    total_reward: 0.0,
                    end: *end,
                });
            }
            let point = &report.points[0];
            let succeeds = [point.succeeds(), point.succeeds_strictly(), point.succeeds_carefully()];
            assert!(succeeds.iter().all(|other| *other == succeeds[0]), "{succeeds:?}");
            (report.counts(point), succeeds[0])
        };
        let passed = (EpisodeEnd::Completed, Some(1.0));
        for end in crate::ends::WITHOUT_VERDICT {
            let starts = end != EpisodeEnd::InvalidScenario;
            assert_eq!(found(1, &[(end, None)]), (starts, None), "{end:?}");
            assert_eq!(found(2, &[passed, (end, None)]), (true, Some(!starts)), "{end:?}");
            assert_eq!(found(2, &[(EpisodeEnd::Completed, Some(-1.0)), (end, None)]), (true, Some(false)));
        }
    }

    #[test]
    fn other_axes_have_their_nominal_values() {
        let kind = Axis::start("kind", "", 0.0, 1.0)
            .with_values(AxisValues::Categorical(["a", "b"].map(String::from).to_vec().into()));
        let axes = vec![
            Axis::new(AxisKind::Noise, "draw", "", [-4.0, 4.0], None),
            Axis::start("x", "m", 1.0, 2.0),
            Axis { nominal: Some(1.0), ..kind.clone() },
            Axis::new(AxisKind::Model, "friction", "", [0.5, 3.0], Some(1.0)),
        ];
        let corners = Corners::new(&Space::new("all", axes).unwrap(), false, Seed(0)).unwrap();
        assert_eq!(corners.simulations(), 3);
        let first = corners.request(1).unwrap().scenario;
        assert_eq!(first.values(), [None, Some(1.0), Some(1.0), Some(1.0)]);
        assert_eq!(Corners::new(&Space::new("kinds", vec![kind]).unwrap(), false, Seed(0)), None);
    }

    #[test]
    fn each_point_has_20_different_seeds_if_an_episode_depends_on_them() {
        let corners = Corners::new(&space(2), true, Seed(7)).unwrap();
        assert_eq!(corners.simulations(), 100);
        let mut seeds: Vec<Seed> = (1..=100).map(|number| corners.request(number).unwrap().seed).collect();
        let points = scenarios(&corners);
        assert!(points[..20].iter().all(|point| *point == points[0]) && points[20] != points[0]);
        seeds.extend((0..1000).map(|index| Seed(7).child(index)));
        seeds.sort();
        seeds.dedup();
        assert_eq!(seeds.len(), 1100, "the random simulations have other seeds");
    }
}
