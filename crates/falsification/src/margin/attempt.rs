//! Simulations of a search for the smallest disturbance, one amplitude after the other.

use std::collections::BTreeSet;
use std::ops::ControlFlow;

use mishandle_random::Sequence;
use mishandle_results::{Level, Norms};
use mishandle_rollout::{Axis, Episode, Request, Scenario, Seed, Space, System};
use mishandle_search::{Coordinate, OptionValue, SearchOptions, by_name};
use mishandle_stl::is_violated;

use super::amplitude::{all_scenarios, between, is_time, norms, scaled, scenario_at, steps_only};
use super::{MarginSettings, minimize};
use crate::repeat::BATCH;
use crate::{FalsificationError, any_violation, coordinate};

/// Largest number of amplitudes that a bisection down to the resolution tries.
const LEVELS: u64 = 8;

/// The bisection of the witness toward nominal ends at an interval of this length, as a fraction of
/// its amplitude.
const RAY: f64 = 1e-4;

/// Fraction of the simulations of an amplitude that try random signs, before CMA-ES.
const SIGNS: f64 = 0.25;

/// Fraction of the budget that repeats the lowest scenarios of a random system before a claim that
/// nothing fails, and their number.
const CONFIRMED: f64 = 0.25;
const LOWEST: usize = 8;

/// Seeds of simulations.
#[derive(Clone, Copy)]
pub(super) enum Seeds {
    /// That of a violation, from which a step leads.
    Of(Seed),
    /// A new one for each simulation of a random system.
    New,
}

/// A search at one amplitude after the other.
pub(super) struct Attempt<'a> {
    system: &'a mut dyn System,
    pub(super) space: Space,
    pub(super) settings: MarginSettings,
    pub(super) random: Sequence,
    watch: &'a mut dyn FnMut(u64) -> ControlFlow<()>,
    pub(super) simulations: u64,
    pub(super) is_interrupted: bool,
    /// The amplitudes in the order in which they were tried.
    pub(super) levels: Vec<Level>,
    /// The violation with the smallest disturbance.
    pub(super) witness: Option<Episode>,
    /// Smallest amplitude of a simulation that started and has no verdict; infinite without one.
    pub(super) smallest_without_verdict: f64,
    /// The amplitude of the largest disturbance with a verdict.
    pub(super) largest_with_verdict: f64,
    /// Seeds of the last amplitude.
    seeds: BTreeSet<u64>,
    /// The scenarios with the lowest robustness at amplitude 1.
    lowest: Vec<(f64, Scenario)>,
}

impl<'a> Attempt<'a> {
    pub(super) fn new(
        system: &'a mut dyn System,
        settings: MarginSettings,
        watch: &'a mut dyn FnMut(u64) -> ControlFlow<()>,
    ) -> Attempt<'a> {
        Attempt {
            space: system.space().clone(),
            system,
            settings,
            random: Sequence::new(settings.seed.0, 0),
            watch,
            simulations: 0,
            is_interrupted: false,
            levels: Vec::new(),
            witness: None,
            smallest_without_verdict: f64::INFINITY,
            largest_with_verdict: 0.0,
            seeds: BTreeSet::new(),
            lowest: Vec::new(),
        }
    }

    /// Returns the amplitude of the witness; infinite without one.
    pub(super) fn smallest(&self) -> f64 {
        let amplitude = |found: &Episode| norms(&self.space, &found.request.scenario).amplitude;
        self.witness.as_ref().map_or(f64::INFINITY, amplitude)
    }

    /// Searches at amplitude 1. If all disturbed axes are discrete, bisects the amplitude.
    pub(super) fn begin(&mut self) -> Result<(), FalsificationError> {
        let share = (self.settings.budget / 2 / LEVELS).max(1);
        self.try_largest(share)?;
        if self.witness.is_some() && steps_only(&self.space) {
            self.bisect(share)?;
        }
        Ok(())
    }

    /// Bisects from the witness toward nominal within the budget, so that the witness is the
    /// smallest violation on this ray. As in a minimization, the simulations belong to no
    /// amplitude. Whole steps are bisected before.
    pub(super) fn bisect_ray(&mut self) -> Result<(), FalsificationError> {
        let Some(from) = self.witness.as_ref().map(|found| found.request.clone()) else { return Ok(()) };
        let mut passes = 0.0;
        let mut fails = if steps_only(&self.space) { 0.0 } else { self.smallest() };
        while fails - passes > RAY * fails && self.simulations < self.settings.budget && !self.is_interrupted
        {
            let middle = f64::midpoint(passes, fails);
            let scenario = scaled(&self.space, &from.scenario, middle);
            let mut episodes = self.system.rollout(&[Request::new(scenario, from.seed)])?;
            self.count(&episodes);
            match episodes.pop().filter(Episode::is_violated) {
                Some(episode) => {
                    self.keep(episode);
                    fails = middle;
                }
                None => passes = middle,
            }
        }
        Ok(())
    }

    /// Removes as many axes as possible from the witness, up to `end` simulations.
    pub(super) fn minimize(&mut self, end: u64) -> Result<(), FalsificationError> {
        let rest = end.saturating_sub(self.simulations);
        let Some(found) = self.witness.as_ref().map(|found| found.request.clone()) else {
            return Ok(());
        };
        // The first simulation of a minimization repeats the witness.
        if rest < 2 || self.is_interrupted {
            return Ok(());
        }
        let before = self.simulations;
        let watch = &mut *self.watch;
        let mut is_interrupted = false;
        let minimized = minimize(self.system, &found, rest, &any_violation, |done| {
            let flow = watch(before + done);
            is_interrupted |= flow.is_break();
            flow
        })?;
        self.is_interrupted |= is_interrupted;
        self.simulations += minimized.simulations;
        self.witness = Some(minimized.episode);
        Ok(())
    }

    /// Searches at the largest amplitude until a violation or the end of the budget, in rounds:
    /// each has new starts and is twice as long as the one before.
    fn try_largest(&mut self, first: u64) -> Result<(), FalsificationError> {
        let budget = self.settings.budget;
        let confirmed = if self.settings.is_random { (CONFIRMED * budget as f64) as u64 } else { 0 };
        let mut share = first;
        self.enter(1.0);
        loop {
            let round = share.min(budget - confirmed - self.simulations);
            let is_last = self.simulations + round >= budget - confirmed;
            let has_found = self.search(round)?
                || (is_last && !self.is_interrupted && self.repeat_the_lowest(confirmed)?);
            let is_complete = has_found || self.level().is_exhaustive || self.simulations >= budget;
            self.level_mut().is_complete = is_complete;
            if is_complete || self.is_interrupted {
                return Ok(());
            }
            share *= 2;
        }
    }

    /// Repeats the scenarios with the lowest robustness with new seeds. Returns whether one fails.
    fn repeat_the_lowest(&mut self, simulations: u64) -> Result<bool, FalsificationError> {
        let lowest: Vec<Scenario> = self.lowest.iter().map(|(_, scenario)| scenario.clone()).collect();
        let repeats: Vec<Scenario> = lowest.iter().cycle().take(simulations as usize).cloned().collect();
        // Without a verdict there is nothing to repeat.
        if repeats.is_empty() && simulations > 0 {
            return self.search(simulations);
        }
        self.simulate(&repeats, Seeds::New)
    }

    /// Bisects the amplitude between 0 and that of the witness.
    fn bisect(&mut self, share: u64) -> Result<(), FalsificationError> {
        let mut passes = 0.0;
        while let Some(amplitude) = between(&self.space, passes, self.smallest()) {
            let left = LEVELS.saturating_sub(self.levels.len() as u64);
            let share = share.min(self.settings.budget.saturating_sub(self.simulations) / 2 / left.max(1));
            if left == 0 || share == 0 || self.is_interrupted {
                break;
            }
            self.enter(amplitude);
            let has_found = self.search(share)?;
            let level = self.level_mut();
            level.is_complete = has_found || level.is_exhaustive || level.simulations >= share;
            if !has_found {
                passes = amplitude;
            }
        }
        Ok(())
    }

    /// Searches for a violation at the present amplitude with `share` simulations, up to the first
    /// batch with one. Returns whether there is one.
    pub(super) fn search(&mut self, share: u64) -> Result<bool, FalsificationError> {
        let amplitude = self.level().amplitude;
        let before = self.level().simulations;
        if let Some(all) = all_scenarios(&self.space, amplitude, share) {
            return self.simulate_all(&all, share);
        }
        let known = self.witness.as_ref().map(|found| {
            let Request { scenario, seed, .. } = &found.request;
            (scaled(&self.space, scenario, amplitude), *seed)
        });
        let end = before + share;
        if let Some((scenario, seed)) = known
            && (self.simulate(&[scenario], Seeds::Of(seed))? || self.is_interrupted)
        {
            return Ok(self.level().is_violated);
        }
        let signs = ((SIGNS * share as f64) as u64).max(1).min(end - self.level().simulations);
        let scenarios: Vec<Scenario> = (0..signs).map(|_| self.random_signs(amplitude)).collect();
        if self.simulate(&scenarios, Seeds::New)? || self.is_interrupted {
            return Ok(self.level().is_violated);
        }
        let start = (before > 0).then(|| self.space.axes().iter().map(|_| self.random.uniform()).collect());
        self.evolve(start, None, end)?;
        Ok(self.level().is_violated)
    }

    /// Simulates all scenarios of the present amplitude. A random system gets them again and again,
    /// up to `share` simulations.
    fn simulate_all(&mut self, all: &[Scenario], share: u64) -> Result<bool, FalsificationError> {
        let before = self.level().simulations;
        let count = if self.settings.is_random { share as usize } else { all.len() };
        let repeated: Vec<Scenario> = all.iter().cycle().take(count).cloned().collect();
        let has_found = self.simulate(&repeated, Seeds::New)?;
        let is_random = self.settings.is_random;
        let level = self.level_mut();
        let is_whole = level.simulations - before == all.len() as u64;
        level.is_exhaustive = !is_random && is_whole && level.without_verdict == level.invalid_starts;
        Ok(has_found)
    }

    /// Searches by CMA-ES from a point of the unit cube, or else from its center, up to `end`
    /// simulations of the present amplitude or the first batch with a violation.
    pub(super) fn evolve(
        &mut self,
        start: Option<Vec<f64>>,
        deviation: Option<f64>,
        end: u64,
    ) -> Result<(), FalsificationError> {
        let amplitude = self.level().amplitude;
        let coordinates: Vec<Coordinate> = self.space.axes().iter().map(coordinate).collect();
        let mut options = SearchOptions::default();
        if let Some(start) = start {
            options.set("start", OptionValue::Point(start));
        }
        if let Some(deviation) = deviation {
            options.set("initial_deviation", OptionValue::Float(deviation));
        }
        let seed = self.settings.seed.child(self.simulations);
        let mut search = by_name("cma-es", &coordinates, seed.0, &options)?;
        while self.level().simulations < end && !self.is_interrupted && !self.level().is_violated {
            let points = search.ask_batch((end - self.level().simulations).min(BATCH as u64) as usize);
            if points.is_empty() {
                break;
            }
            let scenarios: Vec<Scenario> =
                points.iter().map(|u| scenario_at(&self.space, u, amplitude)).collect();
            let values = self.rollout(&scenarios, Seeds::New)?;
            for (u, value) in points.iter().zip(&values) {
                search.tell(u, &value.unwrap_or(f64::INFINITY).into())?;
            }
        }
        Ok(())
    }

    /// Begins with another amplitude; the same one continues.
    pub(super) fn enter(&mut self, amplitude: f64) {
        if self.levels.last().is_none_or(|level| level.is_violated || level.amplitude != amplitude) {
            self.levels.push(Level::new(amplitude));
            self.seeds.clear();
        }
    }

    /// Returns the present amplitude.
    pub(super) fn level(&self) -> Level {
        self.levels.last().copied().unwrap_or_else(|| Level::new(1.0))
    }

    pub(super) fn level_mut(&mut self) -> &mut Level {
        if self.levels.is_empty() {
            self.enter(1.0);
        }
        let last = self.levels.len() - 1;
        &mut self.levels[last]
    }

    /// Simulates in batches, up to the first one with a violation. Returns whether there is one.
    pub(super) fn simulate(
        &mut self,
        scenarios: &[Scenario],
        seeds: Seeds,
    ) -> Result<bool, FalsificationError> {
        for batch in scenarios.chunks(BATCH) {
            self.rollout(batch, seeds)?;
            if self.level().is_violated || self.is_interrupted {
                break;
            }
        }
        Ok(self.level().is_violated)
    }

    /// Simulates a batch at the present amplitude. Returns the robustness of each simulation. A
    /// violation with a smaller disturbance than that of the witness becomes the witness.
    pub(super) fn rollout(
        &mut self,
        scenarios: &[Scenario],
        seeds: Seeds,
    ) -> Result<Vec<Option<f64>>, FalsificationError> {
        let MarginSettings { seed, is_random, .. } = self.settings;
        let seed_of = |number: u64| match seeds {
            _ if !is_random => seed,
            Seeds::Of(seed) => seed,
            Seeds::New => seed.child(number),
        };
        let numbered = scenarios.iter().zip(self.simulations..);
        let requests: Vec<Request> =
            numbered.map(|(scenario, number)| Request::new(scenario.clone(), seed_of(number))).collect();
        let episodes = self.system.rollout(&requests)?;
        self.seeds.extend(episodes.iter().map(|episode| episode.request.seed.0));
        let seeds = self.seeds.len() as u64;
        let level = self.level_mut();
        let least = episodes.iter().filter_map(Episode::robustness).chain(level.minimum_robustness);
        level.minimum_robustness = least.min_by(f64::total_cmp);
        level.is_violated = level.minimum_robustness.is_some_and(is_violated);
        level.simulations += episodes.len() as u64;
        level.seeds = seeds;
        let is_undecided = |episode: &&Episode| episode.robustness().is_none();
        let is_unstartable = |episode: &&Episode| !episode.end.counts_in_rates();
        level.without_verdict += episodes.iter().filter(is_undecided).count() as u64;
        level.invalid_starts += episodes.iter().filter(is_unstartable).count() as u64;
        self.count(&episodes);
        let values = episodes.iter().map(Episode::robustness).collect();
        if is_random && self.levels.len() == 1 {
            let found = episodes
                .iter()
                .filter_map(|episode| Some((episode.robustness()?, episode.request.scenario.clone())));
            self.lowest.extend(found);
            self.lowest.sort_by(|a, b| a.0.total_cmp(&b.0));
            self.lowest.truncate(LOWEST);
        }
        for episode in episodes.into_iter().filter(Episode::is_violated) {
            self.keep(episode);
        }
        Ok(values)
    }

    /// Counts simulations, and reports them to the caller.
    fn count(&mut self, episodes: &[Episode]) {
        let undecided =
            episodes.iter().filter(|episode| episode.robustness().is_none() && episode.end.counts_in_rates());
        let amplitude = |episode: &Episode| norms(&self.space, &episode.request.scenario).amplitude;
        self.smallest_without_verdict =
            undecided.map(amplitude).fold(self.smallest_without_verdict, f64::min);
        let decided = episodes.iter().filter(|episode| episode.robustness().is_some());
        self.largest_with_verdict = decided.map(amplitude).fold(self.largest_with_verdict, f64::max);
        self.simulations += episodes.len() as u64;
        self.is_interrupted |= (self.watch)(self.simulations).is_break();
    }

    /// Keeps a violation if its disturbance is not larger than that of the witness.
    fn keep(&mut self, episode: Episode) {
        let size = |episode: &Episode| {
            let Norms { amplitude, l1, .. } = norms(&self.space, &episode.request.scenario);
            (amplitude, l1)
        };
        if self.witness.as_ref().is_none_or(|known| size(&episode) <= size(known)) {
            self.witness = Some(episode);
        }
    }

    /// Returns a scenario with each disturbed axis at one of its ends, each initial state at a
    /// bound, and random times of events.
    pub(super) fn random_signs(&mut self, amplitude: f64) -> Scenario {
        let u = self.random_corner();
        scenario_at(&self.space, &u, amplitude)
    }

    /// Returns a random corner of the unit cube, with random times of events.
    pub(super) fn random_corner(&mut self) -> Vec<f64> {
        let random = &mut self.random;
        let end = |axis: &Axis| {
            if is_time(axis) { random.uniform() } else { f64::from(u8::from(random.bits() & 1 == 1)) }
        };
        self.space.axes().iter().map(end).collect()
    }
}
