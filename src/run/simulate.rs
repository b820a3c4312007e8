//! Simulations of chosen scenarios, repeated with other random seeds.

use std::ops::ControlFlow;

use mishandle_evaluation::variance_share;
use mishandle_results::{Noise, Repeats};
use mishandle_rollout::{Episode, Request, Scenario, Seed, System};

use crate::error::MishandleError;
use crate::resolve::ResolvedPlan;

/// Number of simulations per batch.
const BATCH: usize = 64;

/// Returns `n` seeds for repeated simulations: children of `seed`. `seed` itself is not among them, so the counterexample of a
/// search, whose seed was selected, is not one of its own repeats.
pub fn repeat_seeds(seed: Seed, n: u64) -> impl Iterator<Item = Seed> {
    (0..n).map(move |index| seed.child(index))
}

/// Simulates `scenario` once per seed and calls `watch` with each episode. It can end the repeats: the report then has those of the
/// batches so far.
///
/// # Errors
/// If the scenario is not in the space of the system, or a simulation cannot be run.
pub fn repeat(
    system: &mut dyn System,
    scenario: &Scenario,
    seeds: impl Iterator<Item = Seed>,
    mut watch: impl FnMut(&Episode) -> ControlFlow<()>,
) -> Result<Repeats, MishandleError> {
    let mut requests =
        (1..).zip(seeds).map(|(number, seed)| Request { number, ..Request::new(scenario.clone(), seed) });
    let mut robustness = Vec::new();
    loop {
        let batch: Vec<Request> = requests.by_ref().take(BATCH).collect();
        let mut is_last = batch.is_empty();
        for episode in system.rollout(&batch)? {
            robustness.push(episode.robustness());
            is_last |= watch(&episode).is_break();
        }
        if is_last {
            return Ok(mishandle_evaluation::repeats(&robustness));
        }
    }
}

/// Measures how much of the variance of the robustness comes from the scenario and how much from noise: simulates random
/// scenarios of the space, each of them `repeats` times. Returns `None` if `watch` ends the measurement.
///
/// # Errors
/// If a simulation cannot be run.
pub fn measure_noise(
    resolved: &ResolvedPlan,
    system: &mut dyn System,
    seed: Seed,
    scenarios: u64,
    repeats: u64,
    mut watch: impl FnMut(&Episode) -> ControlFlow<()>,
) -> Result<Option<Noise>, MishandleError> {
    let mut groups = Vec::new();
    for index in 0..scenarios {
        let scenario = resolved.space.sample(seed, index);
        let (mut group, mut is_interrupted) = (Vec::new(), false);
        let seeds = repeat_seeds(seed.child(index), repeats);
        repeat(system, &scenario, seeds, |episode| {
            group.extend(episode.robustness());
            let flow = watch(episode);
            is_interrupted |= flow.is_break();
            flow
        })?;
        if is_interrupted {
            return Ok(None);
        }
        groups.push(group);
    }
    // A scenario with an undecided simulation has a smaller group and leaves the analysis.
    groups.retain(|group| group.len() as u64 == repeats);
    let share = variance_share(&groups);
    let interval = share.low.zip(share.high).map(<[f64; 2]>::from);
    Ok(Some(Noise { scenario_share: share.value, scenario_share_interval: interval, scenarios, repeats }))
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;
    use crate::plan::Plan;

    #[test]
    fn seeds_are_drawn_as_they_are_needed() {
        let resolved = ResolvedPlan::new(&Plan::new("toy/noisy", "")).unwrap();
        let mut system = resolved.system().unwrap();
        let (drawn, done) = (Cell::new(0), Cell::new(0));
        let seeds = repeat_seeds(Seed(1), 150).inspect(|_| drawn.set(drawn.get() + 1));
        let scenario = resolved.space.nominal();
        let report = repeat(&mut *system, &scenario, seeds, |_| {
            done.set(done.get() + 1);
            assert!(drawn.get() < done.get() + BATCH, "{} drawn, {} done", drawn.get(), done.get());
            ControlFlow::Continue(())
        });
        assert_eq!((report.unwrap().simulations, done.get()), (150, 150));
        // An interruption keeps the batch that was running.
        let report = repeat(&mut *system, &scenario, repeat_seeds(Seed(1), 150), |_| ControlFlow::Break(()));
        assert_eq!(report.unwrap().simulations, BATCH as u64);
        let stopped = |_: &Episode| ControlFlow::Break(());
        assert_eq!(measure_noise(&resolved, &mut *system, Seed(1), 5, 5, stopped).unwrap(), None);
    }
}
