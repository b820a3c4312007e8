//! The smallest disturbance that makes a system violate its requirement.

use std::ops::ControlFlow;

use mishandle_evaluation::RepeatReport;
use mishandle_random::Sequence;
use mishandle_rollout::{Axis, AxisKind, AxisValues, Episode, Request, Scenario, Seed, Space, System};
use mishandle_search::{Coordinate, SearchOptions, by_name};

use crate::falsify::coordinate;
use crate::{MishandleError, Plan, ResolvedPlan, depends_on_seed, minimize, repeat, repeat_seeds};

/// The bisection of the amplitude ends at an interval of this length.
const RESOLUTION: f64 = 0.01;

/// Largest number of amplitudes that a bisection down to the resolution tries.
const LEVELS: u64 = 8;

/// Fraction of the simulations of an amplitude that try random signs, before CMA-ES.
const SIGNS: f64 = 0.25;

/// Number of simulations per batch.
const BATCH: usize = 64;

/// The smallest disturbance that was found, and what was tried.
#[derive(Clone, Debug)]
pub struct Margin {
    /// The violation with the smallest disturbance; `None` if no simulation violates the requirement.
    pub witness: Option<Witness>,
    /// The amplitudes in the order in which they were tried.
    pub levels: Vec<Level>,
    /// Number of all simulations.
    pub simulations: u64,
    /// Whether it was not interrupted.
    pub is_complete: bool,
}

/// A violation and the size of its disturbance.
#[derive(Clone, Debug)]
pub struct Witness {
    /// The simulation.
    pub episode: Episode,
    /// The norms of its disturbance.
    pub norms: Norms,
    /// Number of disturbed axes.
    pub axes: usize,
}

/// Norms of a disturbance. The offset of an axis from its nominal value is in units of the distance from the nominal value to the
/// bound on the same side, so that 1 is the largest offset.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Norms {
    /// Largest offset (L∞): the amplitude.
    pub largest: f64,
    /// Root of the sum of the squares (L2).
    pub euclidean: f64,
    /// Sum (L1).
    pub sum: f64,
}

/// The simulations with disturbances up to an amplitude.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Level {
    /// Largest offset of an axis.
    pub amplitude: f64,
    /// Number of simulations.
    pub simulations: u64,
    /// Lowest robustness; `None` if no simulation has one.
    pub robustness: Option<f64>,
}

impl Level {
    /// Returns whether a simulation violates the requirement.
    pub fn is_violated(&self) -> bool {
        self.robustness.is_some_and(|rho| rho < 0.0)
    }
}

impl Margin {
    /// Default of the largest number of simulations.
    pub const BUDGET: u64 = 3000;

    /// Space that is searched by default.
    pub const SPACE: &str = "disturbance";

    /// Number of simulations with other seeds of a witness whose target depends on the seed.
    pub const REPEATS: u64 = 100;

    /// Returns whether a simulation has a verdict. Without one, the system was not tested.
    pub fn has_verdict(&self) -> bool {
        self.levels.iter().any(|level| level.robustness.is_some())
    }

    /// Returns the largest amplitude below that of the witness at which no simulation violates the requirement. The number of
    /// its simulations is evidence, not a proof, that smaller disturbances are harmless.
    pub fn largest_without_violation(&self) -> Option<Level> {
        let amplitude = |level: &Level| level.amplitude;
        let below = self.witness.as_ref().map_or(f64::INFINITY, |witness| witness.norms.largest);
        let passed = self.levels.iter().filter(|level| !level.is_violated() && level.amplitude < below);
        passed.copied().max_by(|a, b| amplitude(a).total_cmp(&amplitude(b)))
    }
}

/// Searches for the smallest disturbance that violates the requirement of `system`: an upper bound of its margin, with a witness.
///
/// The disturbed axes are those of the space that have a nominal value and are neither initial state nor categorical. At amplitude a, an axis is at most
/// the fraction a of the way from its nominal value to a bound. Initial states in the space vary within their whole box. Random
/// draws keep their random streams. All simulations have the same seed.
///
/// The amplitude is bisected, beginning with 1. At each amplitude, the last witness is scaled down, then random vectors of signs are
/// tried from random corners of the box of initial states, and then CMA-ES searches jointly with the initial state. Last,
/// [`minimize`] removes as many axes as possible from the witness. Half of `budget` is for that.
///
/// `watch` gets the number of simulations after each batch. It can end the search: the witness is then the one so far.
///
/// # Errors
/// If the space has no disturbed axis, or a simulation cannot be run.
pub fn margin(
    system: &mut dyn System,
    seed: Seed,
    budget: u64,
    mut watch: impl FnMut(u64) -> ControlFlow<()>,
) -> Result<Margin, MishandleError> {
    let space = system.space().clone();
    check_margin(budget, &space)?;
    let per_level = (budget / 2 / LEVELS).max(1);
    let mut attempt = Attempt {
        system,
        space,
        seed,
        random: Sequence::new(seed.0, 0),
        simulations: 0,
        watch: &mut watch,
        is_interrupted: false,
    };
    let mut levels = Vec::new();
    let mut witness: Option<Episode> = None;
    let (mut passes, mut fails) = (0.0, 1.0);
    let mut amplitude = 1.0;
    while levels.len() < LEVELS as usize {
        let (level, found) = attempt.try_amplitude(amplitude, witness.as_ref(), per_level)?;
        levels.push(level);
        match found {
            Some(episode) => {
                fails = attempt.norms(&episode.request.scenario).largest;
                witness = Some(episode);
            }
            None if witness.is_none() => break,
            None => passes = amplitude,
        }
        if fails - passes <= RESOLUTION || attempt.is_interrupted {
            break;
        }
        amplitude = f64::midpoint(passes, fails);
    }
    let Some(found) = witness else {
        let (simulations, is_complete) = (attempt.simulations, !attempt.is_interrupted);
        return Ok(Margin { witness: None, levels, simulations, is_complete });
    };
    let Attempt { system, space, simulations, watch, mut is_interrupted, .. } = attempt;
    if is_interrupted {
        let witness = Some(Witness::new(&space, found));
        return Ok(Margin { witness, levels, simulations, is_complete: false });
    }
    let rest = budget.saturating_sub(simulations).max(1);
    let minimized = minimize(system, &found.request, rest, |done| {
        let flow = watch(simulations + done);
        is_interrupted |= flow.is_break();
        flow
    })?;
    Ok(Margin {
        witness: Some(Witness::new(&space, minimized.episode)),
        levels,
        simulations: simulations + minimized.simulations,
        is_complete: !is_interrupted,
    })
}

/// Checks the budget of a [`margin`] and that its space has a disturbed axis.
///
/// # Errors
/// If not.
pub fn check_margin(budget: u64, space: &Space) -> Result<(), MishandleError> {
    let (what, value, expected) = if !Plan::BUDGET.contains(&budget) {
        ("the budget", budget, "from 1 to 1000000")
    } else if !space.axes().iter().any(is_disturbed) {
        ("the number of disturbed axes", 0, "at least 1: an axis with a nominal value that is no start")
    } else {
        return Ok(());
    };
    Err(MishandleError::InvalidValue { what, value: value.to_string(), expected })
}

/// Simulates a witness with other seeds. Returns `None` if they cannot change the result.
///
/// # Errors
/// If a simulation cannot be run.
pub fn witness_repeats(
    resolved: &ResolvedPlan,
    witness: &Witness,
    watch: impl FnMut(&Episode) -> ControlFlow<()>,
) -> Result<Option<RepeatReport>, MishandleError> {
    let Request { scenario, seed, .. } = &witness.episode.request;
    if !depends_on_seed(resolved, scenario) {
        return Ok(None);
    }
    let mut system = resolved.system()?;
    Ok(Some(repeat(&mut *system, scenario, repeat_seeds(*seed, Margin::REPEATS), watch)?))
}

impl Witness {
    fn new(space: &Space, episode: Episode) -> Witness {
        let scenario = &episode.request.scenario;
        let axes = offsets(space, scenario).filter(|offset| *offset > 0.0).count();
        Witness { norms: norms(space, scenario), axes, episode }
    }
}

/// Returns whether the amplitude limits an axis.
fn is_disturbed(axis: &Axis) -> bool {
    let is_ordered = !matches!(axis.values, AxisValues::Categorical(_));
    !varies_freely(axis) && axis.nominal.is_some() && !axis.is_fixed() && is_ordered
}

/// Returns whether an axis varies in its whole range at any amplitude: the initial state, and times of events, since an event disturbs
/// by its magnitude.
fn varies_freely(axis: &Axis) -> bool {
    axis.kind == AxisKind::Start || is_time(axis)
}

fn is_time(axis: &Axis) -> bool {
    axis.kind == AxisKind::Event && axis.unit == "s"
}

/// Returns the offsets of the disturbed axes, each from 0 to 1.
fn offsets<'a>(space: &'a Space, scenario: &'a Scenario) -> impl Iterator<Item = f64> + 'a {
    let pairs = space.axes().iter().zip(scenario.values()).filter(|(axis, _)| is_disturbed(axis));
    pairs.filter_map(|(axis, value)| {
        let (nominal, value) = (axis.unit_coordinate(axis.nominal?), axis.unit_coordinate((*value)?));
        let room = if value < nominal { nominal - lowest(axis) } else { 1.0 - lowest(axis) - nominal };
        Some(if value == nominal { 0.0 } else { (value - nominal).abs() / room })
    })
}

/// Returns the unit coordinate of the lower bound: half a level for a discrete axis. The upper bound is at 1 minus that.
fn lowest(axis: &Axis) -> f64 {
    axis.unit_coordinate(axis.low)
}

fn norms(space: &Space, scenario: &Scenario) -> Norms {
    offsets(space, scenario).fold(Norms::default(), |norms, offset| Norms {
        largest: norms.largest.max(offset),
        euclidean: norms.euclidean.hypot(offset),
        sum: norms.sum + offset,
    })
}

/// Simulations at one amplitude after the other.
struct Attempt<'a> {
    system: &'a mut dyn System,
    space: Space,
    seed: Seed,
    random: Sequence,
    simulations: u64,
    watch: &'a mut dyn FnMut(u64) -> ControlFlow<()>,
    is_interrupted: bool,
}

impl Attempt<'_> {
    fn norms(&self, scenario: &Scenario) -> Norms {
        norms(&self.space, scenario)
    }

    /// Searches for a violation with disturbances up to `amplitude`. Ends at the first batch with one.
    fn try_amplitude(
        &mut self,
        amplitude: f64,
        witness: Option<&Episode>,
        budget: u64,
    ) -> Result<(Level, Option<Episode>), MishandleError> {
        let mut level = Level { amplitude, simulations: 0, robustness: None };
        let mut first: Vec<Scenario> = Vec::new();
        if let Some(witness) = witness {
            first.push(self.scaled(&witness.request.scenario, amplitude));
        }
        let signs = ((SIGNS * budget as f64) as u64).max(1);
        first.extend((first.len() as u64..signs).map(|_| self.random_signs(amplitude)));
        for batch in first.chunks(BATCH) {
            let found = self.simulate(batch, &mut level)?;
            if found.is_some() || self.is_interrupted {
                return Ok((level, found));
            }
        }
        let coordinates: Vec<Coordinate> = self.space.axes().iter().map(coordinate).collect();
        let seed = self.seed.child(self.simulations).0;
        let mut search = by_name("cma-es", &coordinates, seed, &SearchOptions::default())?;
        while level.simulations < budget && !self.is_interrupted {
            let n = (budget - level.simulations).min(BATCH as u64) as usize;
            let points = search.ask_batch(n);
            if points.is_empty() {
                break;
            }
            let scenarios: Vec<Scenario> = points.iter().map(|u| self.scenario_at(u, amplitude)).collect();
            let values = self.rollout(&scenarios, &mut level)?;
            for (u, episode) in points.iter().zip(&values) {
                search.tell(u, &episode.robustness().unwrap_or(f64::INFINITY).into())?;
            }
            if let Some(found) = violation(values) {
                return Ok((level, Some(found)));
            }
        }
        Ok((level, None))
    }

    fn simulate(
        &mut self,
        scenarios: &[Scenario],
        level: &mut Level,
    ) -> Result<Option<Episode>, MishandleError> {
        Ok(violation(self.rollout(scenarios, level)?))
    }

    fn rollout(&mut self, scenarios: &[Scenario], level: &mut Level) -> Result<Vec<Episode>, MishandleError> {
        let requests: Vec<Request> =
            scenarios.iter().map(|scenario| Request::new(scenario.clone(), self.seed)).collect();
        let episodes = self.system.rollout(&requests)?;
        let least = episodes.iter().filter_map(Episode::robustness).chain(level.robustness);
        level.robustness = least.reduce(f64::min);
        level.simulations += episodes.len() as u64;
        self.simulations += episodes.len() as u64;
        self.is_interrupted = (self.watch)(self.simulations).is_break();
        Ok(episodes)
    }

    /// Returns the scenario at a point of the unit cube: disturbed axes are scaled to the amplitude.
    fn scenario_at(&self, u: &[f64], amplitude: f64) -> Scenario {
        let value = |(axis, u): (&Axis, &f64)| match axis.nominal {
            None => None,
            Some(nominal) if is_disturbed(axis) => Some(at_amplitude(axis, nominal, *u, amplitude)),
            Some(_) if varies_freely(axis) => Some(axis.at(*u)),
            nominal => nominal,
        };
        Scenario::new(self.space.axes().iter().zip(u).map(value).collect())
    }

    /// Returns a scenario with each disturbed axis at one of its ends, each initial state at a bound, and random times of events.
    fn random_signs(&mut self, amplitude: f64) -> Scenario {
        let random = &mut self.random;
        let end = |axis: &Axis| match is_time(axis) {
            true => random.uniform(),
            false => f64::from(u8::from(random.bits() & 1 == 1)),
        };
        let u: Vec<f64> = self.space.axes().iter().map(end).collect();
        self.scenario_at(&u, amplitude)
    }

    /// Moves the disturbed axes of a scenario toward nominal, so that the largest offset is the amplitude.
    fn scaled(&self, scenario: &Scenario, amplitude: f64) -> Scenario {
        let factor = (amplitude / self.norms(scenario).largest).min(1.0);
        let value = |(axis, value): (&Axis, &Option<f64>)| match (*value, axis.nominal) {
            (Some(value), Some(nominal)) if is_disturbed(axis) && value != nominal => {
                let (from, to) = (axis.unit_coordinate(nominal), axis.unit_coordinate(value));
                Some(match axis.levels() {
                    Some(_) => nominal + (factor * (value - nominal)).trunc(),
                    None => axis.at(from + factor * (to - from)),
                })
            }
            (value, _) => value,
        };
        Scenario::new(self.space.axes().iter().zip(scenario.values()).map(value).collect())
    }
}

/// Returns the value of a disturbed axis at `u` of \[0, 1\]: nominal at 0.5, and the fraction `amplitude` of the way to the lower and
/// the upper bound at 0 and 1.
fn at_amplitude(axis: &Axis, nominal: f64, u: f64, amplitude: f64) -> f64 {
    let (center, low) = (axis.unit_coordinate(nominal), lowest(axis));
    let side = amplitude * (2.0 * u - 1.0);
    let room = if side < 0.0 { center - low } else { 1.0 - low - center };
    match axis.levels() {
        _ if side == 0.0 || room == 0.0 => nominal,
        // Rounded toward nominal, so that the offset is not larger than the amplitude.
        Some(levels) => nominal + (levels as f64 * side * room).trunc(),
        None => axis.at(center + side * room),
    }
}

/// Returns the episode with the lowest robustness, if it violates the requirement.
fn violation(episodes: Vec<Episode>) -> Option<Episode> {
    let robustness = |episode: &Episode| episode.robustness().unwrap_or(f64::INFINITY);
    episodes
        .into_iter()
        .min_by(|a, b| robustness(a).total_cmp(&robustness(b)))
        .filter(|episode| robustness(episode) < 0.0)
}

#[cfg(test)]
mod tests {
    use mishandle_toys::{FunctionSystem, SimulatedEnd};

    use super::*;

    const BUDGET: u64 = 4000;

    fn inputs(n: usize) -> Vec<Axis> {
        (0..n).map(|i| Axis::new(AxisKind::Input, &format!("x{i}"), "", [-1.0, 1.0], Some(0.0))).collect()
    }

    fn found(axes: Vec<Axis>, robustness: impl Fn(&[f64]) -> f64 + 'static) -> (Margin, u64) {
        let space = Space::new("disturbance", axes).unwrap();
        let outcome = move |request: &Request| {
            let values: Vec<f64> = request.scenario.values().iter().map(|value| value.unwrap()).collect();
            SimulatedEnd::Robustness(robustness(&values))
        };
        let mut system = FunctionSystem::new(space, outcome);
        let found = margin(&mut system, Seed(1), BUDGET, |_| ControlFlow::Continue(())).unwrap();
        (found, system.simulations() as u64)
    }

    /// The smallest L∞ disturbance with w x >= c is c / |w|₁: 0.3 / (0.5 + 0.3 + 0.2).
    #[test]
    fn the_margin_of_a_half_space_is_that_of_a_hand_calculation() {
        let (margin, simulations) = found(inputs(3), |x| 0.3 - (0.5 * x[0] - 0.3 * x[1] + 0.2 * x[2]));
        let witness = margin.witness.as_ref().unwrap();
        let norms = witness.norms;
        assert!((0.3..0.312).contains(&norms.largest), "{norms:?}");
        assert!(witness.episode.robustness().unwrap() < 0.0 && witness.axes == 3);
        assert!((norms.sum - 3.0 * norms.largest).abs() < 0.02 && norms.euclidean < norms.sum);
        let passed = margin.largest_without_violation().unwrap();
        assert!((0.28..0.3).contains(&passed.amplitude) && passed.simulations > 100, "{passed:?}");
        assert_eq!(margin.simulations, simulations);
        assert!(simulations <= BUDGET);
    }

    /// From the start 0 the disturbance 0.3 is enough, from the nominal start 0.5 it takes 0.8.
    #[test]
    fn the_initial_state_is_searched_with_the_disturbance() {
        let axes = [vec![Axis::start("s", "m", 0.0, 1.0)], inputs(1)].concat();
        let (margin, _) = found(axes, |x| 0.3 + x[0] - x[1]);
        let largest = margin.witness.unwrap().norms.largest;
        assert!((0.3..0.33).contains(&largest), "{largest}");
    }

    #[test]
    fn axes_without_effect_are_not_in_the_witness() {
        let (margin, _) = found(inputs(10), |x| 0.2 - x[4]);
        let witness = margin.witness.unwrap();
        assert_eq!(witness.axes, 1, "{:?}", witness.episode.request.scenario);
        assert!((0.2..0.212).contains(&witness.norms.largest));
    }

    #[test]
    fn integers_keep_their_steps_and_bounds_on_one_side_their_range() {
        let delay = Axis::new(AxisKind::Model, "delay", "control steps", [0.0, 3.0], Some(0.0));
        let (margin, _) = found(vec![delay.with_values(AxisValues::Integer)], |x| 1.5 - x[0]);
        let witness = margin.witness.unwrap();
        assert_eq!(witness.episode.request.scenario.get(0), Some(2.0));
        assert!((witness.norms.largest - 2.0 / 3.0).abs() < 1e-12);
    }

    #[test]
    fn a_requirement_that_is_never_violated_has_no_witness() {
        let (margin, simulations) = found(inputs(2), |x| 3.0 - x[0] - x[1]);
        assert!(margin.witness.is_none());
        assert_eq!((margin.levels.len(), margin.levels[0].amplitude), (1, 1.0));
        assert_eq!(
            (margin.levels[0].simulations, margin.largest_without_violation().unwrap().amplitude),
            (simulations, 1.0)
        );
        assert!(margin.levels[0].robustness.unwrap() < 1.1, "a corner was tried");
    }

    #[test]
    fn a_space_of_initial_states_only_is_an_error() {
        let mut system = FunctionSystem::new(
            Space::new("starts", vec![Axis::start("x", "m", 0.0, 1.0)]).unwrap(),
            |_: &Request| SimulatedEnd::Robustness(1.0),
        );
        let error = margin(&mut system, Seed(0), 10, |_| ControlFlow::Continue(())).unwrap_err().to_string();
        assert!(error.contains("number of disturbed axes"), "{error}");
    }

    #[test]
    fn the_time_of_an_event_is_no_disturbance() {
        let event = |name: &str, unit: &str, high: f64| {
            Axis::new(AxisKind::Event, name, unit, [0.0, high], Some(0.0))
        };
        // A push of 0.3 is enough, but only after 3 s.
        let axes = vec![event("time", "s", 4.0), event("force", "N", 1.0)];
        let (margin, _) = found(axes, |x| if x[0] > 3.0 { 0.3 - x[1] } else { 1.0 });
        let witness = margin.witness.unwrap();
        assert!(witness.norms.largest < 0.32 && witness.axes == 1, "{:?}", witness.norms);
    }

    #[test]
    fn an_interruption_keeps_the_witness_so_far() {
        let outcome = |request: &Request| SimulatedEnd::Robustness(0.3 - request.scenario.get(0).unwrap());
        let system = || FunctionSystem::new(Space::new("disturbance", inputs(4)).unwrap(), outcome);
        let all = margin(&mut system(), Seed(1), BUDGET, |_| ControlFlow::Continue(())).unwrap().simulations;
        let mut largest = f64::INFINITY;
        for stop in [1, all / 8, all / 2, 3 * all / 4] {
            let mut system = system();
            let watch = |done| if done >= stop { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
            let found = margin(&mut system, Seed(1), BUDGET, watch).unwrap();
            assert!(!found.is_complete && found.simulations < stop + 2 * BATCH as u64, "{stop}");
            assert_eq!(system.simulations() as u64, found.simulations);
            let witness = found.witness.unwrap();
            assert!(witness.episode.robustness() < Some(0.0) && witness.norms.largest <= largest);
            largest = witness.norms.largest;
        }
        assert!(largest < 0.32, "{largest}");
    }
}
