//! Runs the simulations of an evaluation from random scenarios.

use std::ops::ControlFlow;

use mishandle_rollout::{DEFAULT_BATCH_SIZE, Episode, Request, Scenario, Seed, Space, System};

use crate::{EvaluationError, MetricCounter, Metrics};

/// Number of random scenarios per simulation after which an evaluation fails because the filter
/// rejects all of them.
const DRAWS: u64 = 100_000;

/// Returns whether an evaluation may use a scenario.
pub type ScenarioFilter<'a> = dyn Fn(&Scenario) -> bool + 'a;

/// Settings of an evaluation: number of simulations, seed, batch size and scenario filter.
///
/// Simulation i, counted from 1, has the seed `seed.child(i - 1)` and the scenario
/// `space.sample(seed, i - 1)`. If the filter rejects the scenario, it has the first accepted one
/// of `space.sample(seed.child(i - 1), 1)`, `(…, 2)`, …. So a simulation does not depend on the
/// system, the number of simulations or the batches.
#[derive(Clone, Copy)]
pub struct Evaluation<'a> {
    /// Number of simulations.
    pub episodes: u64,
    /// Random seed of scenarios and simulations.
    pub seed: Seed,
    /// Number of simulations per batch. 0 counts as 1.
    pub batch: usize,
    /// Filter of scenarios; `None` accepts the whole space.
    pub filter: Option<&'a ScenarioFilter<'a>>,
}

impl Evaluation<'_> {
    /// Makes an evaluation over the whole space with the default batch size.
    pub fn new(episodes: u64, seed: Seed) -> Self {
        Evaluation { episodes, seed, batch: DEFAULT_BATCH_SIZE, filter: None }
    }

    /// Returns the request for simulation `number`, counted from 1. All requests have trial
    /// number 1.
    ///
    /// # Errors
    /// [`EvaluationError::NoAcceptedScenario`] if the filter rejects 100,000 random scenarios.
    pub fn request(&self, space: &Space, number: u32) -> Result<Request, EvaluationError> {
        let index = u64::from(number) - 1;
        let seed = self.seed.child(index);
        let first = space.sample(self.seed, index);
        let further = (1..DRAWS).map(|draw| space.sample(seed, draw));
        let is_accepted = |scenario: &Scenario| self.filter.is_none_or(|filter| filter(scenario));
        match std::iter::once(first).chain(further).find(is_accepted) {
            Some(scenario) => Ok(Request { number, ..Request::new(scenario, seed) }),
            None => Err(EvaluationError::NoAcceptedScenario { simulation: number, draws: DRAWS }),
        }
    }
}

/// Runs the simulations of `evaluation` that `metrics` does not contain, and returns a report on
/// all simulations.
///
/// The first simulation has the number `metrics.simulations() + 1`. To resume an interrupted
/// evaluation, add its recorded episodes to `metrics` first. `on_batch` receives the episodes of
/// each batch, in order, before the next batch starts. If it breaks, the evaluation ends, and the
/// report covers the simulations so far.
///
/// # Errors
/// - [`EvaluationError::Rollout`] if the system fails.
/// - [`EvaluationError::EpisodeCount`] if the system returns a wrong number of episodes.
/// - [`EvaluationError::NoAcceptedScenario`] if the filter rejects 100,000 random scenarios.
/// - An error of `on_batch`.
///
/// # Example
/// `tests/run.rs` contains a system in closed form. With the system of a target:
/// ```
/// # use std::ops::ControlFlow;
/// # use mishandle_evaluation::{EvaluationError, Evaluation, MetricCounter, Metrics, evaluate};
/// # use mishandle_rollout::{Seed, System};
/// fn report(system: &mut dyn System) -> Result<Metrics, EvaluationError> {
///     let mut done = 0;
///     evaluate(system, &Evaluation::new(100, Seed(7)), &mut MetricCounter::default(), |episodes| {
///         done += episodes.len();
///         Ok(ControlFlow::Continue(()))
///     })
/// }
/// ```
pub fn evaluate<E: From<EvaluationError>>(
    system: &mut dyn System,
    evaluation: &Evaluation<'_>,
    metrics: &mut MetricCounter,
    mut on_batch: impl FnMut(&[Episode]) -> Result<ControlFlow<()>, E>,
) -> Result<Metrics, E> {
    let batch = evaluation.batch.max(1) as u64;
    while metrics.simulations() < evaluation.episodes {
        let first = metrics.simulations() + 1;
        let last = evaluation.episodes.min(metrics.simulations() + batch);
        let requests = (first..=last)
            .map(|number| evaluation.request(system.space(), number as u32))
            .collect::<Result<Vec<Request>, EvaluationError>>()?;
        let episodes = simulate(system, &requests)?;
        episodes.iter().for_each(|episode| metrics.add(episode));
        if on_batch(&episodes)?.is_break() {
            break;
        }
    }
    Ok(metrics.report(evaluation.seed))
}

/// Runs a batch of simulations.
pub(crate) fn simulate(
    system: &mut dyn System,
    requests: &[Request],
) -> Result<Vec<Episode>, EvaluationError> {
    let episodes = system.rollout(requests)?;
    if episodes.len() != requests.len() {
        let requested = requests.len();
        let returned = episodes.len();
        return Err(EvaluationError::EpisodeCount { requested, returned });
    }
    Ok(episodes)
}
