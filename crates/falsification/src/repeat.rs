//! Simulations of chosen scenarios, repeated with other random seeds.

use std::ops::ControlFlow;

use mishandle_evaluation::variance_share;
use mishandle_results::{Noise, Repeats};
use mishandle_rollout::{Episode, Request, Scenario, Seed, System};

use crate::FalsificationError;

/// Number of simulations per batch of repeats, of a minimization and of a margin.
pub(crate) const BATCH: usize = 64;

/// A scenario that is simulated with other random seeds. It decides how often that is done by
/// default, everywhere.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Repeated {
    /// A counterexample of a search, a minimized one, or the witness of a margin.
    Counterexample,
    /// The representative of a failure mode. A report repeats one for each mode.
    Representative,
    /// A random scenario, to measure how much of the variance is noise. Two are the fewest with a
    /// variance: more scenarios find smaller regions of failures than more simulations of each.
    Noise,
}

impl Repeated {
    /// Fewest simulations of a counterexample with other seeds, unless fewer are requested. Fewer
    /// say little: of 20, none fails with a probability of 36 % if 5 % do.
    pub const FEWEST: u64 = 20;

    /// Default number of random scenarios that measure how much of the variance is noise.
    pub const NOISE_SCENARIOS: u64 = 200;

    /// Returns the default number of simulations.
    pub const fn simulations(self) -> u64 {
        match self {
            Repeated::Counterexample => 100,
            Repeated::Representative => 50,
            Repeated::Noise => 2,
        }
    }

    /// Returns the number of simulations of each of several counterexamples of a run: `requested`,
    /// but in total at most as often as the run has simulations, and each at least
    /// [`FEWEST`](Self::FEWEST) times.
    ///
    /// # Example
    /// ```
    /// use mishandle_falsification::Repeated;
    /// assert_eq!(Repeated::each_counterexample(100, 900, 3), 100);
    /// assert_eq!(Repeated::each_counterexample(100, 900, 30), 30);
    /// assert_eq!(Repeated::each_counterexample(100, 900, 90), 20);
    /// assert_eq!(Repeated::each_counterexample(5, 900, 90), 5);
    /// ```
    pub fn each_counterexample(requested: u64, simulations: u64, counterexamples: u64) -> u64 {
        requested.min((simulations / counterexamples.max(1)).max(Repeated::FEWEST))
    }
}

/// Returns `n` seeds for repeated simulations: children of `seed`. `seed` itself is not among them,
/// so the counterexample of a search, whose seed was selected, is not one of its own repeats.
pub fn repeat_seeds(seed: Seed, n: u64) -> impl Iterator<Item = Seed> {
    (0..n).map(move |index| seed.child(index))
}

/// Simulates `scenario` once per seed and calls `watch` with each episode. It can end the repeats:
/// the report then has those of the batches so far.
///
/// # Errors
/// If the scenario is not in the space of the system, or a simulation cannot be run.
pub fn repeat(
    system: &mut dyn System,
    scenario: &Scenario,
    seeds: impl Iterator<Item = Seed>,
    mut watch: impl FnMut(&Episode) -> ControlFlow<()>,
) -> Result<Repeats, FalsificationError> {
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

/// Measures how much of the variance of the robustness comes from the scenario and how much from
/// noise: simulates random scenarios of the space, each of them `repeats` times. Returns `None` if
/// `watch` ends the measurement.
///
/// # Errors
/// If a simulation cannot be run.
pub fn measure_noise(
    system: &mut dyn System,
    seed: Seed,
    scenarios: u64,
    repeats: u64,
    mut watch: impl FnMut(&Episode) -> ControlFlow<()>,
) -> Result<Option<Noise>, FalsificationError> {
    let space = system.space().clone();
    let repeated = |index| {
        let scenario = space.sample(seed, index);
        repeat_seeds(seed.child(index), repeats).map(move |seed| Request::new(scenario.clone(), seed))
    };
    let mut requests =
        (1..).zip((0..scenarios).flat_map(repeated)).map(|(number, request)| Request { number, ..request });
    let mut robustness = Vec::new();
    loop {
        let batch: Vec<Request> = requests.by_ref().take(BATCH).collect();
        if batch.is_empty() {
            break;
        }
        let mut is_interrupted = false;
        for episode in system.rollout(&batch)? {
            robustness.push(episode.robustness());
            is_interrupted |= watch(&episode).is_break();
        }
        if is_interrupted {
            return Ok(None);
        }
    }
    // A scenario with an undecided simulation leaves the analysis.
    let decided = |group: &[Option<f64>]| group.iter().copied().collect::<Option<Vec<f64>>>();
    let groups: Vec<Vec<f64>> = robustness.chunks((repeats as usize).max(1)).filter_map(decided).collect();
    let share = variance_share(&groups);
    let interval = share.low.zip(share.high).map(<[f64; 2]>::from);
    Ok(Some(Noise { scenario_share: share.value, scenario_share_interval: interval, scenarios, repeats }))
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use mishandle_rollout::{Axis, Space};
    use mishandle_toys::{FunctionSystem, SimulatedEnd};

    use super::*;

    #[test]
    fn seeds_are_drawn_as_they_are_needed() {
        let space = Space::new("starts", vec![Axis::start("x", "m", 0.0, 1.0)]).unwrap();
        let scenario = space.nominal();
        // The sign of the robustness depends on the seed.
        let outcome = |request: &Request| SimulatedEnd::Robustness(f64::from(request.seed.0 as u32) - 1e9);
        let mut system = FunctionSystem::new(space, outcome);
        let drawn = Cell::new(0);
        let done = Cell::new(0);
        let seeds = repeat_seeds(Seed(1), 150).inspect(|_| drawn.set(drawn.get() + 1));
        let report = repeat(&mut system, &scenario, seeds, |_| {
            done.set(done.get() + 1);
            assert!(drawn.get() < done.get() + BATCH, "{} drawn, {} done", drawn.get(), done.get());
            ControlFlow::Continue(())
        });
        assert_eq!((report.unwrap().simulations, done.get()), (150, 150));
        // An interruption keeps the batch that was running.
        let report = repeat(&mut system, &scenario, repeat_seeds(Seed(1), 150), |_| ControlFlow::Break(()));
        assert_eq!(report.unwrap().simulations, BATCH as u64);
        let stopped = |_: &Episode| ControlFlow::Break(());
        assert_eq!(measure_noise(&mut system, Seed(1), 5, 5, stopped).unwrap(), None);
    }
}
