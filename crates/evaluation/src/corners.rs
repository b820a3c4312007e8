//! The corners and the center of the initial box: a deterministic supplement to random initial
//! states.

use std::ops::ControlFlow;

use mishandle_results as results;
use mishandle_results::{BoxPoint, CornerPoint};
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
    names: Vec<String>,
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
        Some(Corners {
            names: space.axes().iter().map(|axis| axis.name.clone()).collect(),
            points: (0..count).map(corner).chain([point(&|_| 0.5)]).collect(),
            seeds: if depends_on_seed { SEEDS } else { 1 },
            seed: seed.child(CHILD),
        })
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

    /// Counts no simulation yet, for the formulas in `roles`. `is_reachable` returns whether
    /// success is possible from a point, `None` if this is unknown.
    pub fn counter(
        &self,
        roles: FormulaRoles,
        excludes_unreachable: bool,
        is_reachable: impl Fn(&Scenario) -> Option<bool>,
    ) -> CornerCounter {
        let last = self.points.len().saturating_sub(1);
        let point = |(index, scenario): (usize, &Scenario)| CornerPoint {
            kind: if index == last { BoxPoint::Center } else { BoxPoint::Corner },
            scenario: self.names.iter().zip(scenario.values().iter().copied()).collect(),
            reachable: is_reachable(scenario),
            strict_successes: roles.strict.then_some(0),
            careful_successes: roles.careful.then_some(0),
            ..CornerPoint::default()
        };
        let counter = |point| PointCounter { point, verdicts: [0; 3] };
        let points = self.points.iter().enumerate().map(point).map(counter).collect();
        CornerCounter { points, seeds: self.seeds, excludes_unreachable }
    }
}

/// Runs the simulations of `corners` that `counter` does not contain, in batches of `batch`, and
/// adds them to `counter`.
///
/// `on_batch` receives the episodes of each batch, in order. If it breaks, `counter` has the
/// simulations so far.
///
/// # Errors
/// As [`evaluate`](crate::evaluate).
pub fn evaluate_corners<E: From<EvaluationError>>(
    system: &mut dyn System,
    corners: &Corners,
    batch: usize,
    counter: &mut CornerCounter,
    mut on_batch: impl FnMut(&[Episode]) -> Result<ControlFlow<()>, E>,
) -> Result<(), E> {
    loop {
        let first = counter.simulations() + 1;
        let requests: Vec<Request> =
            (first..).map_while(|number| corners.request(number)).take(batch.max(1)).collect();
        if requests.is_empty() {
            return Ok(());
        }
        let episodes = simulate(system, &requests)?;
        episodes.iter().for_each(|episode| counter.add(episode));
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

/// Counts the simulations of a point.
#[derive(Clone, Debug, PartialEq)]
struct PointCounter {
    point: CornerPoint,
    /// Numbers of simulations with a verdict on success, strict success and careful success.
    verdicts: [u32; 3],
}

impl PointCounter {
    /// Returns whether all simulations that started succeed, strictly (kind 1) or carefully
    /// (kind 2); `None` if none has a verdict, and without the formula.
    fn succeeds(&self, kind: usize) -> Option<bool> {
        let CornerPoint { successes, strict_successes, careful_successes, .. } = self.point;
        let successes = [Some(successes), strict_successes, careful_successes][kind]?;
        (self.verdicts[kind] > 0).then_some(successes == self.point.started())
    }
}

/// Counts the simulations of the corners and the center.
#[derive(Clone, Debug, PartialEq)]
pub struct CornerCounter {
    /// The corners and, as the last point, the center.
    points: Vec<PointCounter>,
    seeds: u32,
    excludes_unreachable: bool,
}

impl CornerCounter {
    /// Returns the results of the simulations so far.
    pub fn report(&self) -> results::Corners {
        let (corners, center) = self.points.split_at(self.points.len().saturating_sub(1));
        let corners: Vec<&PointCounter> = corners.iter().filter(|found| self.counts(found)).collect();
        let center = center.iter().find(|found| self.counts(found));
        let count = |holds: &dyn Fn(&PointCounter) -> bool| {
            corners.iter().filter(|found| holds(found)).count() as u64
        };
        let all = |kind| count(&|found| found.succeeds(kind) == Some(true));
        let at_center = |kind| center.and_then(|found| found.succeeds(kind));
        let has_strict = self.points.iter().any(|found| found.point.strict_successes.is_some());
        let has_careful = self.points.iter().any(|found| found.point.careful_successes.is_some());
        let point = |found: &PointCounter| CornerPoint { counts: self.counts(found), ..found.point.clone() };
        results::Corners {
            seeds: self.seeds,
            n: corners.len() as u64,
            without_verdict: count(&|found| found.succeeds(0).is_none()),
            succeeding: all(0),
            strictly_succeeding: has_strict.then(|| all(1)),
            carefully_succeeding: has_careful.then(|| all(2)),
            center_succeeds: at_center(0),
            center_strictly_succeeds: at_center(1),
            center_carefully_succeeds: at_center(2),
            points: self.points.iter().map(point).collect(),
        }
    }

    /// Returns whether a point counts: not if it is excluded as unreachable, or the target cannot
    /// start from it.
    fn counts(&self, found: &PointCounter) -> bool {
        let CornerPoint { reachable, n, .. } = found.point;
        let is_excluded = self.excludes_unreachable && reachable == Some(false);
        !is_excluded && (n == 0 || found.point.started() > 0)
    }

    /// Returns the number of simulations so far.
    pub fn simulations(&self) -> u32 {
        self.points.iter().map(|found| found.point.n).sum()
    }

    /// Adds the next simulation. It may come from a record.
    pub fn add(&mut self, episode: &Episode) {
        let index = self.simulations() / self.seeds.max(1);
        let Some(PointCounter { point, verdicts }) = self.points.get_mut(index as usize) else { return };
        point.n += 1;
        point.invalid_starts += u32::from(!episode.end.counts_in_rates());
        let decided = [
            decides_success(episode),
            point.strict_successes.is_some() && decides_strict_success(episode),
            point.careful_successes.is_some() && decides_careful_success(episode),
        ];
        verdicts.iter_mut().zip(decided).for_each(|(count, decided)| *count += u32::from(decided));
        match episode.end {
            EpisodeEnd::Diverged { .. } => point.diverged += 1,
            end if end.is_invalid() => point.invalid += 1,
            end if end.is_failed() => point.failed += 1,
            _ => point.undecided += u32::from(episode.verdict.success.is_none()),
        }
        point.successes += u32::from(episode.is_success());
        let strict = u32::from(episode.is_strict_success());
        point.strict_successes = point.strict_successes.map(|successes| successes + strict);
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
        let mut counter =
            corners.counter(FormulaRoles { strict: true, ..FormulaRoles::default() }, false, |_| None);
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
            counter.add(&episode(end, success));
        }
        let point = &counter.report().points[0];
        assert_eq!((point.n, point.successes, point.strict_successes), (8, 1, Some(1)));
        assert_eq!((point.diverged, point.invalid, point.undecided), (1, 3, 2));
    }

    #[test]
    fn a_point_without_a_verdict_neither_succeeds_nor_fails_and_an_invalid_start_counts_nowhere() {
        let corners = Corners::new(&space(1), false, Seed(0)).unwrap();
        let roles = FormulaRoles { strict: true, careful: true, ..FormulaRoles::default() };
        let found = |seeds: u32, ends: &[(EpisodeEnd, Option<f64>)]| {
            let mut counter = CornerCounter { seeds, ..corners.counter(roles, false, |_| None) };
            for (end, rho) in ends {
                let verdict = Verdict {
                    robustness: *rho,
                    success: *rho,
                    strict: *rho,
                    careful: *rho,
                    ..Verdict::default()
                };
                counter.add(&Episode {
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
            let found = [0, 1, 2].map(|kind| counter.points[0].succeeds(kind));
            assert!(found.iter().all(|other| *other == found[0]), "{found:?}");
            (counter.report().points[0].counts, found[0])
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
