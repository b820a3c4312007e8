//! The smallest disturbance that makes a system violate its requirement.

mod amplitude;
#[cfg(test)]
mod tests;

use mishandle_stl::{is_satisfied, is_violated};
use std::ops::{ControlFlow, RangeInclusive};

use mishandle_random::Sequence;
use mishandle_results::{Level, Norms};
use mishandle_rollout::{Axis, Episode, Request, Scenario, Seed, Space, System};
use mishandle_search::{Coordinate, OptionValue, SearchOptions, by_name};

use crate::repeat::BATCH;
use crate::{FalsificationError, coordinate, minimize};
pub use amplitude::norms;
use amplitude::{all_scenarios, between, is_disturbed, is_time, offsets, scaled, scenario_at};

/// Largest number of amplitudes that a bisection down to the resolution tries.
const LEVELS: u64 = 8;

/// Fraction of the simulations of an amplitude that try random signs, before CMA-ES.
const SIGNS: f64 = 0.25;

/// The smallest disturbance that was found, and what was tried.
#[derive(Clone, Debug)]
pub struct Margin {
    /// The violation with the smallest disturbance; `None` if no simulation violates the
    /// requirement.
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

impl Margin {
    /// Allowed numbers of simulations.
    pub const BUDGETS: RangeInclusive<u64> = 1..=1_000_000;

    /// Default of the largest number of simulations.
    pub const BUDGET: u64 = 3000;

    /// Space that is searched by default.
    pub const SPACE: &str = "disturbance";

    /// Returns whether a simulation has a verdict. Without one, the system was not tested.
    pub fn has_verdict(&self) -> bool {
        self.levels.iter().any(|level| level.minimum_robustness.is_some())
    }

    /// Returns the largest amplitude below that of the witness at which a finished search found no
    /// violation, and at which most simulations have a verdict. Their number is evidence, not a
    /// proof, that smaller disturbances are harmless.
    pub fn largest_without_violation(&self) -> Option<Level> {
        let amplitude = |level: &Level| level.amplitude;
        let below = self.witness.as_ref().map_or(f64::INFINITY, |witness| witness.norms.amplitude);
        let has_passed = |level: &&Level| {
            let has_evidence = level.minimum_robustness.is_some_and(is_satisfied)
                && level.verdicts() > level.without_verdict;
            level.is_complete && has_evidence && level.amplitude < below
        };
        let passed = self.levels.iter().filter(has_passed);
        passed.copied().max_by(|a, b| amplitude(a).total_cmp(&amplitude(b)))
    }
}

/// Searches for the smallest disturbance that violates the requirement of `system`: an upper bound
/// of its margin, with a witness.
///
/// The disturbed axes are those of the space that have a nominal value and are neither initial
/// state nor categorical. At amplitude a, an axis is at most the fraction a of the way from its
/// nominal value to a bound. Initial states in the space vary within their whole box. Random draws
/// keep their random streams. All simulations have the same seed.
///
/// The amplitude is bisected, beginning with 1. At each amplitude, the last witness is scaled down,
/// then random vectors of signs are tried from random corners of the box of initial states, and
/// then CMA-ES searches jointly with the initial state. If all axes are discrete and the scenarios
/// are few, all of them are tried instead, and only amplitudes with other scenarios. Last,
/// [`minimize`] removes as many axes as possible from the witness.
///
/// A sixteenth of `budget` is for each of eight amplitudes, half of it for the last part. If there
/// is no violation at amplitude 1, the rest of the budget is spent there. If there is one later,
/// the next amplitudes share half of what is left.
///
/// `watch` gets the number of simulations after each batch. It can end the search: the witness is
/// then the one so far.
///
/// # Errors
/// If the space has no disturbed axis, or a simulation cannot be run.
pub fn margin(
    system: &mut dyn System,
    seed: Seed,
    budget: u64,
    mut watch: impl FnMut(u64) -> ControlFlow<()>,
) -> Result<Margin, FalsificationError> {
    let space = system.space().clone();
    check_margin(budget, &space)?;
    let mut attempt = Attempt {
        system,
        space,
        seed,
        random: Sequence::new(seed.0, 0),
        budget,
        simulations: 0,
        watch: &mut watch,
        is_interrupted: false,
    };
    let (levels, witness) = attempt.bisect()?;
    let Attempt { system, space, simulations, watch, mut is_interrupted, .. } = attempt;
    let ended = |witness: Option<Episode>, simulations, is_interrupted: bool| Margin {
        witness: witness.map(|found| Witness::new(&space, found)),
        levels,
        simulations,
        is_complete: !is_interrupted,
    };
    let rest = budget.saturating_sub(simulations);
    match witness {
        // The first simulation of a minimization repeats the witness.
        Some(found) if rest > 1 && !is_interrupted => {
            let minimized = minimize(system, &found.request, rest, |done| {
                let flow = watch(simulations + done);
                is_interrupted |= flow.is_break();
                flow
            })?;
            Ok(ended(Some(minimized.episode), simulations + minimized.simulations, is_interrupted))
        }
        witness => Ok(ended(witness, simulations, is_interrupted)),
    }
}

/// Checks the budget of a [`margin`] and that its space has a disturbed axis.
///
/// # Errors
/// If not.
pub fn check_margin(budget: u64, space: &Space) -> Result<(), FalsificationError> {
    let (what, value, expected) = if !Margin::BUDGETS.contains(&budget) {
        ("the budget", budget, "from 1 to 1000000")
    } else if !space.axes().iter().any(is_disturbed) {
        ("the number of disturbed axes", 0, "at least 1: an axis with a nominal value that is no start")
    } else {
        return Ok(());
    };
    Err(FalsificationError::InvalidValue { what, value: value.to_string(), expected })
}

impl Witness {
    fn new(space: &Space, episode: Episode) -> Witness {
        let scenario = &episode.request.scenario;
        let axes = offsets(space, scenario).filter(|offset| *offset > 0.0).count();
        Witness { norms: norms(space, scenario), axes, episode }
    }
}

/// Simulations at one amplitude after the other.
struct Attempt<'a> {
    system: &'a mut dyn System,
    space: Space,
    seed: Seed,
    random: Sequence,
    budget: u64,
    simulations: u64,
    watch: &'a mut dyn FnMut(u64) -> ControlFlow<()>,
    is_interrupted: bool,
}

impl Attempt<'_> {
    /// Bisects the amplitude. Returns the amplitudes that were tried, and the violation at the
    /// smallest one.
    fn bisect(&mut self) -> Result<(Vec<Level>, Option<Episode>), FalsificationError> {
        let share = (self.budget / 2 / LEVELS).max(1);
        let (level, mut witness) = self.try_largest(share)?;
        let mut levels = vec![level];
        let (mut passes, mut fails) = (0.0, 1.0);
        while let Some(found) = &witness {
            if levels.last().is_some_and(|level| level.is_violated) {
                fails = norms(&self.space, &found.request.scenario).amplitude;
            }
            let Some(amplitude) = between(&self.space, passes, fails) else { break };
            let left = LEVELS - levels.len() as u64;
            let share = share.min(self.budget.saturating_sub(self.simulations) / 2 / left.max(1));
            if left == 0 || share == 0 || self.is_interrupted {
                break;
            }
            let mut level = Level::new(amplitude);
            let smaller = self.search(&mut level, Some(found), share)?;
            level.is_complete = smaller.is_some() || level.is_exhaustive || level.simulations >= share;
            levels.push(level);
            match smaller {
                Some(smaller) => witness = Some(smaller),
                None => passes = amplitude,
            }
        }
        Ok((levels, witness))
    }

    /// Searches at the largest amplitude until a violation or the end of the budget, in rounds:
    /// each has new starts and is twice as long as the one before.
    fn try_largest(&mut self, first: u64) -> Result<(Level, Option<Episode>), FalsificationError> {
        let mut level = Level::new(1.0);
        let mut share = first;
        loop {
            let round = share.min(self.budget - self.simulations);
            let found = self.search(&mut level, None, round)?;
            level.is_complete = found.is_some() || level.is_exhaustive || self.simulations >= self.budget;
            if level.is_complete || self.is_interrupted {
                return Ok((level, found));
            }
            share *= 2;
        }
    }

    /// Searches for a violation at the amplitude of `level` with `share` simulations. Ends at the
    /// first batch with one.
    fn search(
        &mut self,
        level: &mut Level,
        witness: Option<&Episode>,
        share: u64,
    ) -> Result<Option<Episode>, FalsificationError> {
        let before = level.simulations;
        if let Some(all) = all_scenarios(&self.space, level.amplitude, share) {
            let found = self.simulate(&all, level)?;
            level.is_exhaustive =
                level.simulations - before == all.len() as u64 && level.without_verdict == 0;
            return Ok(found);
        }
        let known = witness.map(|witness| scaled(&self.space, &witness.request.scenario, level.amplitude));
        let mut scenarios: Vec<Scenario> = known.into_iter().collect();
        let signs = ((SIGNS * share as f64) as u64).max(1);
        scenarios.extend((scenarios.len() as u64..signs).map(|_| self.random_signs(level.amplitude)));
        let found = self.simulate(&scenarios, level)?;
        if found.is_some() || self.is_interrupted {
            return Ok(found);
        }
        let is_first_round = before == 0;
        let start = (!is_first_round).then(|| {
            let random = self.space.axes().iter().map(|_| self.random.uniform());
            random.collect()
        });
        self.evolve(level, before + share, start)
    }

    /// Searches by CMA-ES up to `end` simulations of the level, from `start` or else from the
    /// center of the cube.
    fn evolve(
        &mut self,
        level: &mut Level,
        end: u64,
        start: Option<Vec<f64>>,
    ) -> Result<Option<Episode>, FalsificationError> {
        let coordinates: Vec<Coordinate> = self.space.axes().iter().map(coordinate).collect();
        let mut options = SearchOptions::default();
        if let Some(start) = start {
            options.set("start", OptionValue::Point(start));
        }
        let mut search = by_name("cma-es", &coordinates, self.seed.child(self.simulations).0, &options)?;
        while level.simulations < end && !self.is_interrupted {
            let points = search.ask_batch((end - level.simulations).min(BATCH as u64) as usize);
            if points.is_empty() {
                break;
            }
            let scenarios: Vec<Scenario> =
                points.iter().map(|u| scenario_at(&self.space, u, level.amplitude)).collect();
            let values = self.rollout(&scenarios, level)?;
            for (u, episode) in points.iter().zip(&values) {
                search.tell(u, &episode.robustness().unwrap_or(f64::INFINITY).into())?;
            }
            let found = violation(values);
            if found.is_some() {
                return Ok(found);
            }
        }
        Ok(None)
    }

    /// Simulates in batches, up to the first one with a violation.
    fn simulate(
        &mut self,
        scenarios: &[Scenario],
        level: &mut Level,
    ) -> Result<Option<Episode>, FalsificationError> {
        for batch in scenarios.chunks(BATCH) {
            let found = violation(self.rollout(batch, level)?);
            if found.is_some() || self.is_interrupted {
                return Ok(found);
            }
        }
        Ok(None)
    }

    fn rollout(
        &mut self,
        scenarios: &[Scenario],
        level: &mut Level,
    ) -> Result<Vec<Episode>, FalsificationError> {
        let requests: Vec<Request> =
            scenarios.iter().map(|scenario| Request::new(scenario.clone(), self.seed)).collect();
        let episodes = self.system.rollout(&requests)?;
        let least = episodes.iter().filter_map(Episode::robustness).chain(level.minimum_robustness);
        level.minimum_robustness = least.min_by(f64::total_cmp);
        level.is_violated = level.minimum_robustness.is_some_and(is_violated);
        level.simulations += episodes.len() as u64;
        level.without_verdict +=
            episodes.iter().filter(|episode| episode.robustness().is_none()).count() as u64;
        self.simulations += episodes.len() as u64;
        self.is_interrupted = (self.watch)(self.simulations).is_break();
        Ok(episodes)
    }

    /// Returns a scenario with each disturbed axis at one of its ends, each initial state at a
    /// bound, and random times of events.
    fn random_signs(&mut self, amplitude: f64) -> Scenario {
        let random = &mut self.random;
        let end = |axis: &Axis| match is_time(axis) {
            true => random.uniform(),
            false => f64::from(u8::from(random.bits() & 1 == 1)),
        };
        let u: Vec<f64> = self.space.axes().iter().map(end).collect();
        scenario_at(&self.space, &u, amplitude)
    }
}

/// Returns the episode with the lowest robustness, if it violates the requirement.
fn violation(episodes: Vec<Episode>) -> Option<Episode> {
    let robustness = |episode: &Episode| episode.robustness().unwrap_or(f64::INFINITY);
    episodes.into_iter().min_by(|a, b| robustness(a).total_cmp(&robustness(b))).filter(Episode::is_violated)
}
