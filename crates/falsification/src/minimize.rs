//! Moves a counterexample toward the nominal scenario while it still fails.

use std::ops::ControlFlow;

use mishandle_rollout::{Axis, AxisValues, Episode, Request, Scenario, Space, System};

use crate::FalsificationError;
use crate::repeat::BATCH;

/// A minimized scenario passes if one of its axes moves toward nominal by this fraction of its
/// width.
const RESOLUTION: f64 = 0.01;

/// Returns whether the second failure, nearer to nominal, may replace the first one.
pub type Keeps<'a> = dyn Fn(&Episode, &Episode) -> bool + 'a;

/// A [`Keeps`] for which any violation counts, also of another predicate.
pub fn any_violation(_: &Episode, _: &Episode) -> bool {
    true
}

/// A counterexample that was moved toward the nominal scenario.
#[derive(Clone, Debug)]
pub struct Minimized {
    /// The simulation of the minimized scenario; it fails.
    pub episode: Episode,
    /// The failing simulations on the way to it: the original scenario first, each further one
    /// nearer to nominal, without the result.
    pub path: Vec<Episode>,
    /// Number of simulations.
    pub simulations: u64,
    /// Whether the minimization came to its end: no axis can go to nominal alone, and none can move
    /// by more than 1 % of its width.
    pub is_complete: bool,
    /// Whether all smaller sets of axes were tried: with the other axes at nominal and these at
    /// their original values, every simulation passes.
    pub has_fewest_axes: bool,
}

/// Moves the scenario of a failing request toward the nominal scenario while the simulation still
/// fails. The seed stays.
///
/// First it sets as many axes as possible to nominal: it tries all sets of axes by increasing size
/// while half of the budget allows that, and otherwise removes groups of axes, the ones with the
/// smallest offsets first. Then it moves the remaining axes toward nominal by bisection, jointly
/// and one at a time, until none can move by more than 1 % of its width (an integer axis: by one).
/// Random draws, which have no nominal value, stay.
///
/// A violation counts only if `keeps` accepts it: it gets the failure so far and the violation, and
/// says whether both are of one failure mode. `watch` gets the number of simulations after each
/// batch. It can end the minimization, which then returns the failure so far.
///
/// # Errors
/// If the request does not fail, or a simulation cannot be run.
pub fn minimize(
    system: &mut dyn System,
    request: &Request,
    budget: u64,
    keeps: &Keeps<'_>,
    watch: impl FnMut(u64) -> ControlFlow<()>,
) -> Result<Minimized, FalsificationError> {
    let mut episodes = system.rollout(std::slice::from_ref(request))?;
    let original = episodes.pop().ok_or(FalsificationError::EpisodeCount { requested: 1, returned: 0 })?;
    if !original.is_violated() {
        let robustness = original.robustness().map_or("undecided".to_string(), |rho| rho.to_string());
        return Err(FalsificationError::NotACounterexample { robustness });
    }
    let mut search = Search::new(system, original, budget, keeps, watch);
    search.simulations = 1;
    let is_complete = match search.run() {
        Ok(()) => true,
        Err(Stop::Budget | Stop::Interrupted) => false,
        Err(Stop::Error(error)) => return Err(*error),
    };
    let Search { best, path, simulations, has_fewest_axes, .. } = search;
    Ok(Minimized { episode: best, path, simulations, is_complete, has_fewest_axes })
}

impl Minimized {
    /// Returns the simulation of the original scenario.
    pub fn original(&self) -> &Episode {
        self.path.first().unwrap_or(&self.episode)
    }
}

/// Returns the number of axes with another value than the nominal one. Random draws do not count.
pub fn axes_off_nominal(space: &Space, scenario: &Scenario) -> usize {
    off_nominal(space, scenario).len()
}

/// Returns the indices of the axes with another value than the nominal one.
pub fn off_nominal(space: &Space, scenario: &Scenario) -> Vec<usize> {
    let is_off = |(axis, value): (&Axis, &Option<f64>)| match (axis.nominal, *value) {
        (Some(nominal), Some(value)) => value != nominal,
        _ => false,
    };
    let named = space.axes().iter().zip(scenario.values()).enumerate();
    named.filter(|(_, pair)| is_off(*pair)).map(|(index, _)| index).collect()
}

/// Returns whether two scenarios of a space differ on no axis by more than the resolution of a
/// minimization, 1 % of its width.
pub fn is_close(space: &Space, a: &Scenario, b: &Scenario) -> bool {
    let is_close = |(axis, (a, b)): (&Axis, (&Option<f64>, &Option<f64>))| match (*a, *b) {
        (Some(a), Some(b)) => (axis.unit_coordinate(a) - axis.unit_coordinate(b)).abs() <= RESOLUTION,
        (a, b) => a.is_none() && b.is_none(),
    };
    space.axes().iter().zip(a.values().iter().zip(b.values())).all(is_close)
}

/// Why a search ends early.
pub(crate) enum Stop {
    Budget,
    Interrupted,
    Error(Box<FalsificationError>),
}

impl<E: Into<FalsificationError>> From<E> for Stop {
    fn from(error: E) -> Stop {
        Stop::Error(Box::new(error.into()))
    }
}

pub(crate) struct Search<'a, W> {
    system: &'a mut dyn System,
    space: Space,
    /// The failing simulation nearest to nominal so far.
    pub(crate) best: Episode,
    /// Those before it.
    path: Vec<Episode>,
    budget: u64,
    keeps: &'a Keeps<'a>,
    pub(crate) simulations: u64,
    watch: W,
    has_fewest_axes: bool,
}

impl<'a, W: FnMut(u64) -> ControlFlow<()>> Search<'a, W> {
    /// Starts at a failure.
    pub(crate) fn new(
        system: &'a mut dyn System,
        failure: Episode,
        budget: u64,
        keeps: &'a Keeps<'a>,
        watch: W,
    ) -> Search<'a, W> {
        let space = system.space().clone();
        let path = Vec::new();
        let (simulations, has_fewest_axes) = (0, false);
        Search { system, space, best: failure, path, budget, keeps, simulations, watch, has_fewest_axes }
    }

    fn run(&mut self) -> Result<(), Stop> {
        let smallest = self.smallest_set()?;
        if self.off_axes().len() > smallest {
            self.remove_groups()?;
        }
        self.has_fewest_axes = self.off_axes().len() <= smallest;
        self.move_all()
    }

    /// Moves the axes that are off nominal toward it, until none can move.
    pub(crate) fn move_all(&mut self) -> Result<(), Stop> {
        loop {
            let mut has_moved = self.move_jointly()?;
            for index in self.off_axes() {
                has_moved |= self.move_axis(index)?;
            }
            if !has_moved {
                return Ok(());
            }
        }
    }

    /// Returns an axis and those that it needs for an effect.
    pub(crate) fn with_needed(&self, index: usize) -> Vec<usize> {
        self.space.with_needed(index)
    }

    pub(crate) fn off_axes(&self) -> Vec<usize> {
        off_nominal(&self.space, &self.best.request.scenario)
    }

    /// Returns the present scenario with other values on some axes. Axes that have no effect with
    /// them are nominal.
    fn with(&self, values: impl IntoIterator<Item = (usize, f64)>) -> Scenario {
        let mut scenario = self.best.request.scenario.values().to_vec();
        values.into_iter().for_each(|(index, value)| scenario[index] = Some(value));
        self.space.canonical(Scenario::new(scenario))
    }

    fn nominal(&self, index: usize) -> f64 {
        self.space.axes()[index].nominal.unwrap_or_default()
    }

    pub(crate) fn at_nominal(&self, indices: &[usize]) -> Scenario {
        self.with(indices.iter().map(|index| (*index, self.nominal(*index))))
    }

    /// Simulates the scenarios. If any fails, the one with the lowest robustness becomes the
    /// present one.
    fn try_any(&mut self, scenarios: &[Scenario]) -> Result<bool, Stop> {
        let mut episodes = self.simulate(scenarios)?;
        episodes.retain(|episode| episode.is_violated() && (self.keeps)(&self.best, episode));
        let Some(least) = lowest_violation(episodes) else { return Ok(false) };
        self.path.push(std::mem::replace(&mut self.best, least));
        Ok(true)
    }

    /// Simulates the scenarios with the seed of the failure.
    pub(crate) fn simulate(&mut self, scenarios: &[Scenario]) -> Result<Vec<Episode>, Stop> {
        if self.simulations + scenarios.len() as u64 > self.budget {
            return Err(Stop::Budget);
        }
        let mut episodes = Vec::with_capacity(scenarios.len());
        for batch in scenarios.chunks(BATCH) {
            let request = |scenario: &Scenario| Request {
                scenario: scenario.clone(),
                unit_point: Vec::new(),
                ..self.best.request.clone()
            };
            let requests: Vec<Request> = batch.iter().map(request).collect();
            episodes.extend(self.system.rollout(&requests)?);
            self.simulations += batch.len() as u64;
            if (self.watch)(self.simulations).is_break() {
                return Err(Stop::Interrupted);
            }
        }
        Ok(episodes)
    }

    fn try_one(&mut self, scenario: Scenario) -> Result<bool, Stop> {
        self.try_any(&[scenario])
    }

    /// Tries all sets of axes by increasing size, the others at nominal, while half of the budget
    /// allows that. Returns the size up to which all smaller sets pass.
    fn smallest_set(&mut self) -> Result<usize, Stop> {
        let off = self.off_axes();
        for size in 0..off.len() {
            if self.simulations.saturating_add(binomial(off.len(), size)) > self.budget / 2 {
                return Ok(size);
            }
            let others = |kept: &Vec<usize>| {
                let others: Vec<usize> = off.iter().copied().filter(|index| !kept.contains(index)).collect();
                self.at_nominal(&others)
            };
            let scenarios: Vec<Scenario> = subsets(&off, size).iter().map(others).collect();
            if self.try_any(&scenarios)? {
                return Ok(size);
            }
        }
        Ok(off.len())
    }

    /// Sets groups of axes to nominal, first halves, last single axes, until no single axis can go
    /// to nominal.
    pub(crate) fn remove_groups(&mut self) -> Result<(), Stop> {
        let mut off = self.off_axes();
        off.sort_by(|a, b| self.offset(*a).total_cmp(&self.offset(*b)));
        let mut size = off.len().div_ceil(2);
        loop {
            let mut start = 0;
            let mut has_removed = false;
            while start < off.len() {
                let end = (start + size).min(off.len());
                if self.try_one(self.at_nominal(&off[start..end]))? {
                    off.drain(start..end);
                    has_removed = true;
                } else {
                    start = end;
                }
            }
            match size {
                0 | 1 if !has_removed => return Ok(()),
                0 | 1 => {}
                _ => size = size.div_ceil(2),
            }
        }
    }

    /// Returns the distance of an axis from nominal, as a fraction of its width.
    fn offset(&self, index: usize) -> f64 {
        let axis = &self.space.axes()[index];
        let value = self.best.request.scenario.get(index).unwrap_or_default();
        (axis.unit_coordinate(value) - axis.unit_coordinate(self.nominal(index))).abs()
    }

    /// Moves all continuous axes by the same fraction of their offsets. Returns whether they moved.
    fn move_jointly(&mut self) -> Result<bool, Stop> {
        let mut off = self.off_axes();
        off.retain(|index| self.space.axes()[*index].levels().is_none());
        let largest = off.iter().map(|index| self.offset(*index)).fold(0.0, f64::max);
        if off.len() < 2 {
            return Ok(false);
        }
        let from = self.best.request.scenario.clone();
        let at = |search: &Self, fraction: f64| {
            search.with(off.iter().map(|index| (*index, search.between(*index, &from, fraction))))
        };
        if !self.try_one(at(self, (1.0 - RESOLUTION / largest).max(0.0)))? {
            return Ok(false);
        }
        self.bisect(RESOLUTION / 2.0 / largest, at)?;
        Ok(true)
    }

    /// Moves an axis toward nominal as far as the simulation fails. Returns whether it moved.
    fn move_axis(&mut self, index: usize) -> Result<bool, Stop> {
        let axis = self.space.axes()[index].clone();
        let value = self.best.request.scenario.get(index).unwrap_or_default();
        let nominal = self.nominal(index);
        match axis.values {
            AxisValues::Categorical(_) => self.try_one(self.with([(index, nominal)])),
            AxisValues::Integer => {
                if !self.try_one(self.with([(index, value - (value - nominal).signum())]))? {
                    return Ok(false);
                }
                let steps = (value - nominal).abs();
                let at = |search: &Self, fraction: f64| {
                    search.with([(index, nominal + ((value - nominal) * fraction).round())])
                };
                self.bisect(1.0 / steps, at)?;
                Ok(true)
            }
            AxisValues::Continuous | AxisValues::Logarithmic => {
                let offset = self.offset(index);
                let from = self.best.request.scenario.clone();
                let at = |search: &Self, fraction: f64| {
                    search.with([(index, search.between(index, &from, fraction))])
                };
                if !self.try_one(at(self, (1.0 - RESOLUTION / offset).max(0.0)))? {
                    return Ok(false);
                }
                self.bisect(RESOLUTION / 2.0 / offset, at)?;
                Ok(true)
            }
        }
    }

    /// Returns the value between nominal (fraction 0) and that of `from` (fraction 1); both ends
    /// are exact.
    fn between(&self, index: usize, from: &Scenario, fraction: f64) -> f64 {
        let value = from.get(index).unwrap_or_default();
        let nominal = self.nominal(index);
        match self.space.axes()[index].values {
            _ if fraction <= 0.0 => nominal,
            _ if fraction >= 1.0 => value,
            AxisValues::Logarithmic => {
                let between = nominal * (value / nominal).powf(fraction);
                between.clamp(nominal.min(value), nominal.max(value))
            }
            _ => nominal + (value - nominal) * fraction,
        }
    }

    /// Bisects between nominal (fraction 0) and the present scenario (fraction 1) down to fractions
    /// that differ by `resolution`.
    fn bisect(&mut self, resolution: f64, at: impl Fn(&Self, f64) -> Scenario) -> Result<(), Stop> {
        if self.try_one(at(self, 0.0))? {
            return Ok(());
        }
        let mut passes = 0.0;
        let mut fails = 1.0;
        while fails - passes > resolution {
            let middle = 0.5 * (passes + fails);
            if self.try_one(at(self, middle))? { fails = middle } else { passes = middle }
        }
        Ok(())
    }
}

/// Returns the violation with the lowest robustness; `None` without one.
pub(crate) fn lowest_violation(episodes: Vec<Episode>) -> Option<Episode> {
    let robustness = |episode: &Episode| episode.robustness().unwrap_or(f64::INFINITY);
    let violations = episodes.into_iter().filter(Episode::is_violated);
    violations.min_by(|a, b| robustness(a).total_cmp(&robustness(b)))
}

/// Returns the number of subsets with `size` of `n` elements; `u64::MAX` if a product on the way is
/// larger.
fn binomial(n: usize, size: usize) -> u64 {
    let product = |product: u64, i: u64| Some(product.checked_mul(n as u64 - i)? / (i + 1));
    (0..size as u64).try_fold(1, product).unwrap_or(u64::MAX)
}

/// Returns all subsets with `size` elements.
fn subsets(items: &[usize], size: usize) -> Vec<Vec<usize>> {
    if size == 0 {
        return vec![Vec::new()];
    }
    let with_first = |(index, first): (usize, &usize)| {
        let rest = subsets(&items[index + 1..], size - 1);
        rest.into_iter().map(|rest| std::iter::once(*first).chain(rest).collect()).collect::<Vec<_>>()
    };
    items.iter().enumerate().flat_map(with_first).collect()
}

#[cfg(test)]
mod tests {
    use mishandle_rollout::{AxisKind, Seed};
    use mishandle_toys::{FunctionSystem, SimulatedEnd};

    use super::*;

    /// Minimizes a scenario that fails where `robustness` is negative.
    fn minimized(
        axes: Vec<Axis>,
        scenario: &[f64],
        budget: u64,
        robustness: impl Fn(&[f64]) -> f64 + 'static,
    ) -> (Vec<f64>, Minimized) {
        let space = Space::new("starts", axes).unwrap();
        let outcome = move |request: &Request| {
            let values: Vec<f64> = request.scenario.values().iter().map(|value| value.unwrap()).collect();
            SimulatedEnd::Robustness(robustness(&values))
        };
        let mut system = FunctionSystem::new(space, outcome);
        let request = Request::new(scenario, Seed(3));
        let minimized =
            minimize(&mut system, &request, budget, &any_violation, |_| ControlFlow::Continue(())).unwrap();
        assert_eq!(system.simulations() as u64, minimized.simulations);
        assert!(minimized.simulations <= budget);
        assert_eq!(minimized.episode.request.seed, Seed(3));
        let values = minimized.episode.request.scenario.values().iter().map(|value| value.unwrap()).collect();
        (values, minimized)
    }

    /// Axes from -1 to 1 with the nominal value 0.
    fn axes(n: usize) -> Vec<Axis> {
        (0..n).map(|i| Axis::start(&format!("x{i}"), "m", -1.0, 1.0)).collect()
    }

    /// Checks that a value is between a threshold and 1 % of the width of [`axes`] beyond it.
    fn check_at(value: f64, threshold: f64) {
        assert!((threshold..threshold + 0.02).contains(&value), "{value} is not at {threshold}");
    }

    #[test]
    fn a_box_is_left_at_its_corner_and_the_axes_without_influence_go_to_nominal() {
        // Fails where x0 > 0.4 and x2 < -0.25.
        let robustness = |x: &[f64]| (0.4 - x[0]).max(x[2] + 0.25);
        let (found, minimized) = minimized(axes(4), &[0.9, 0.3, -0.5, -0.8], 300, robustness);
        check_at(found[0], 0.4);
        check_at(-found[2], 0.25);
        assert_eq!((found[1], found[3]), (0.0, 0.0));
        assert!(minimized.is_complete && minimized.has_fewest_axes);
        assert!(minimized.episode.is_violated());
        assert_eq!(minimized.original().request.scenario, [0.9, 0.3, -0.5, -0.8].into());
    }

    #[test]
    fn one_axis_that_fails_alone_is_kept_rather_than_two_with_smaller_offsets() {
        // Fails where x0 > 0.6, or x1 > 0.1 and x2 > 0.1.
        let robustness = |x: &[f64]| (0.6 - x[0]).min((0.1 - x[1]).max(0.1 - x[2]));
        let (found, minimized) = minimized(axes(3), &[0.8, 0.2, 0.2], 300, robustness);
        check_at(found[0], 0.6);
        assert_eq!((found[1], found[2]), (0.0, 0.0));
        assert!(minimized.has_fewest_axes);
    }

    #[test]
    fn no_axis_of_a_ball_can_move_by_one_percent_of_its_width() {
        // Fails within 0.3 of (0.5, 0.5, 0.5).
        let robustness = |x: &[f64]| x.iter().map(|x| (x - 0.5).powi(2)).sum::<f64>().sqrt() - 0.3;
        let (found, minimized) = minimized(axes(3), &[0.6, 0.45, 0.7], 300, robustness);
        assert!(minimized.is_complete);
        for axis in 0..3 {
            let mut moved = found.clone();
            moved[axis] -= 0.02;
            assert!(robustness(&found) < 0.0 && robustness(&moved) >= 0.0, "{found:?}");
        }
    }

    #[test]
    fn groups_of_many_axes_are_removed_if_their_sets_are_too_many() {
        // Fails where x7 > 0.3, x19 > 0.3 and x30 > 0.3; the 780 sets of two axes are too many to
        // exclude all of them.
        let robustness = |x: &[f64]| (0.3 - x[7]).max(0.3 - x[19]).max(0.3 - x[30]);
        let (found, minimized) = minimized(axes(40), &[0.9; 40], 300, robustness);
        assert!(minimized.is_complete && !minimized.has_fewest_axes);
        for (index, value) in found.iter().enumerate() {
            match index {
                7 | 19 | 30 => check_at(*value, 0.3),
                _ => assert_eq!(*value, 0.0),
            }
        }
    }

    #[test]
    fn integer_axes_move_by_units_and_categories_go_to_nominal_or_stay() {
        let axis = |name: &str, high: f64, values| {
            Axis::new(AxisKind::Model, name, "", [0.0, high], Some(0.0)).with_values(values)
        };
        let names = AxisValues::Categorical(["a", "b", "c"].map(String::from).into());
        let gain = Axis::new(AxisKind::Model, "gain", "", [0.25, 4.0], Some(1.0));
        let axes = vec![
            axis("delay", 9.0, AxisValues::Integer),
            axis("kept", 2.0, names.clone()),
            axis("free", 2.0, names),
            gain.with_values(AxisValues::Logarithmic),
        ];
        // Fails where delay >= 3, kept is c and gain > 2.
        let robustness = |x: &[f64]| (2.5 - x[0]).max(1.5 - x[1]).max(2.0 - x[3]);
        let (found, minimized) = minimized(axes, &[8.0, 2.0, 1.0, 3.5], 300, robustness);
        assert_eq!(found[..3], [3.0, 2.0, 0.0]);
        // 1 % of the width of the logarithmic axis is a factor of 16^0.01.
        assert!(found[3] > 2.0 && found[3] < 2.0 * 16.0_f64.powf(0.01), "{found:?}");
        assert!(minimized.is_complete);
    }

    #[test]
    fn a_failing_nominal_scenario_is_the_result() {
        let (found, minimized) = minimized(axes(2), &[0.9, 0.9], 300, |_| -1.0);
        assert_eq!(found, [0.0, 0.0]);
        assert_eq!(minimized.simulations, 2);
    }

    #[test]
    fn a_spent_budget_gives_a_failing_scenario_that_is_not_complete() {
        let robustness = |x: &[f64]| (0.4 - x[0]).max(0.4 - x[1]);
        for budget in 1..20 {
            let (found, minimized) = minimized(axes(2), &[0.9, 0.8], budget, robustness);
            assert!(robustness(&found) < 0.0);
            assert!(!minimized.is_complete, "{budget}");
        }
    }

    /// Failures in two bands, the second one nearer to nominal: the sides of a gap are two modes.
    #[test]
    fn a_failure_stays_on_its_side_of_a_gap_whatever_fails_nearer_to_nominal() {
        let space = Space::new("starts", axes(1)).unwrap();
        let x = |request: &Request| request.scenario.get(0).unwrap();
        let outcome = move |request: &Request| {
            let fails = (0.4..0.5).contains(&x(request)) || x(request) >= 0.6;
            SimulatedEnd::Robustness(if fails { -1.0 } else { 1.0 })
        };
        let found = |keeps: &Keeps<'_>| {
            let mut system = FunctionSystem::new(space.clone(), outcome);
            let request = Request::new([0.9], Seed(0));
            x(&minimize(&mut system, &request, 300, keeps, |_| ControlFlow::Continue(()))
                .unwrap()
                .episode
                .request)
        };
        check_at(found(&|failure, other| x(&failure.request) > 0.5 && x(&other.request) > 0.5), 0.6);
        assert!(found(&any_violation) < 0.5);
    }

    #[test]
    fn random_draws_stay_and_a_passing_scenario_is_an_error() {
        let draw = Axis::new(AxisKind::Noise, "draw", "", [-4.0, 4.0], None);
        let space = Space::new("s", vec![draw, Axis::start("x", "m", -1.0, 1.0)]).unwrap();
        let outcome = |request: &Request| match request.scenario.get(0) {
            None => SimulatedEnd::Robustness(1.0),
            Some(draw) => SimulatedEnd::Robustness(draw - request.scenario.get(1).unwrap()),
        };
        let mut system = FunctionSystem::new(space.clone(), outcome);
        let mut of = |values: Vec<Option<f64>>| {
            minimize(&mut system, &Request::new(Scenario::new(values), Seed(0)), 100, &any_violation, |_| {
                ControlFlow::Continue(())
            })
        };
        let found = of(vec![Some(0.25), Some(0.9)]).unwrap();
        assert_eq!(found.episode.request.scenario.get(0), Some(0.25));
        check_at(found.episode.request.scenario.get(1).unwrap(), 0.25);
        let error = of(vec![None, Some(0.9)]).unwrap_err().to_string();
        assert!(error.contains("robustness of the simulation is 1"), "{error}");
    }

    #[test]
    fn a_set_is_the_smallest_if_all_smaller_ones_were_tried() {
        // Fails where three of twelve axes are above 0.3; there are 79 smaller sets, and 220 of
        // this size.
        let robustness = |x: &[f64]| (0.3 - x[2]).max(0.3 - x[5]).max(0.3 - x[11]);
        let (found, minimized) = minimized(axes(12), &[0.9; 12], 300, robustness);
        assert_eq!(found.iter().filter(|value| **value != 0.0).count(), 3);
        assert!(minimized.is_complete && minimized.has_fewest_axes);
        assert!(minimized.simulations > 79);
    }

    #[test]
    fn close_scenarios_differ_by_at_most_one_percent_of_each_width() {
        let draw = Axis::new(AxisKind::Noise, "draw", "", [-4.0, 4.0], None);
        let space = Space::new("s", vec![Axis::start("x", "m", -1.0, 1.0), draw]).unwrap();
        let at = |x, draw| Scenario::new(vec![Some(x), draw]);
        assert!(is_close(&space, &at(0.5, None), &at(0.519, None)));
        assert!(!is_close(&space, &at(0.5, None), &at(0.521, None)));
        assert!(!is_close(&space, &at(0.5, None), &at(0.5, Some(0.0))));
    }

    #[test]
    fn subsets_are_complete_and_their_number_does_not_overflow() {
        assert_eq!(subsets(&[4, 5, 6], 2), [[4, 5], [4, 6], [5, 6]]);
        assert_eq!((binomial(40, 0), binomial(40, 2), binomial(6, 3)), (1, 780, 20));
        assert_eq!(binomial(500, 250), u64::MAX);
    }
}
