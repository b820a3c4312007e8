//! Many simulations of one system, from starts that are drawn and not searched.

use std::ops::ControlFlow;

use mishandle_rollout::{DEFAULT_BATCH_SIZE, Episode, Request, Scenario, Seed, Space, System};

use crate::{EvaluationError, Metrics, Report};

/// How many starts are drawn for one simulation before the accepted part of the box is taken to be empty.
const DRAWS: u64 = 100_000;

/// Says which scenarios count.
pub type Accepts<'a> = dyn Fn(&Scenario) -> bool + 'a;

/// What to run: how many simulations, keyed by which seed, from which part of the space.
///
/// Simulation i, counted from 1, has the seed `seed.child(i - 1)` and the scenario `space.sample(seed, i - 1)` if that is
/// accepted, else the first of `space.sample(seed.child(i - 1), 1)`, `(…, 2)`, … that is. So neither depends on the
/// system, on the number of simulations or on the batches they are run in.
#[derive(Clone, Copy)]
pub struct Evaluation<'a> {
    /// Number of simulations.
    pub episodes: u64,
    /// Key of scenarios and simulations.
    pub seed: Seed,
    /// Simulations that are asked for at once, at least 1.
    pub batch: usize,
    /// Which scenarios count; `None` for the whole space.
    pub accepted: Option<&'a Accepts<'a>>,
}

impl Evaluation<'_> {
    /// An evaluation over the whole space.
    pub fn new(episodes: u64, seed: Seed) -> Self {
        Evaluation { episodes, seed, batch: DEFAULT_BATCH_SIZE, accepted: None }
    }

    /// Simulation `number`, counted from 1; all are of trial 1.
    ///
    /// # Errors
    /// [`EvaluationError::NoStart`] if no scenario was accepted among 100,000.
    pub fn request(&self, space: &Space, number: u32) -> Result<Request, EvaluationError> {
        let index = u64::from(number) - 1;
        let seed = self.seed.child(index);
        let first = space.sample(self.seed, index);
        let further = (1..DRAWS).map(|draw| space.sample(seed, draw));
        let accepted = |scenario: &Scenario| self.accepted.is_none_or(|accepted| accepted(scenario));
        match std::iter::once(first).chain(further).find(accepted) {
            Some(scenario) => Ok(Request { number, ..Request::new(scenario, seed) }),
            None => Err(EvaluationError::NoStart { simulation: number, draws: DRAWS }),
        }
    }
}

/// Runs the simulations of `evaluation` that `metrics` does not hold yet, and reports on all of them.
///
/// The first of them has the number `metrics.simulations() + 1`: an interrupted evaluation goes on from recorded episodes
/// that were added again. `on_batch` is given the episodes of each batch, in order, before the next one starts. If it
/// breaks, the evaluation ends there, and the report is on fewer simulations than were asked for.
///
/// # Errors
/// What the system or `on_batch` cannot do, or [`EvaluationError::NoStart`].
///
/// # Example
/// See `tests/run.rs` for a system in closed form; with the system of a target:
/// ```
/// # use std::ops::ControlFlow;
/// # use mishandle_evaluation::{EvaluationError, Evaluation, Metrics, Report, evaluate};
/// # use mishandle_rollout::{Seed, System};
/// fn report(system: &mut dyn System) -> Result<Report, EvaluationError> {
///     let mut done = 0;
///     evaluate(system, &Evaluation::new(100, Seed(7)), &mut Metrics::default(), |episodes| {
///         done += episodes.len();
///         Ok(ControlFlow::Continue(()))
///     })
/// }
/// ```
pub fn evaluate<E: From<EvaluationError>>(
    system: &mut dyn System,
    evaluation: &Evaluation<'_>,
    metrics: &mut Metrics,
    mut on_batch: impl FnMut(&[Episode]) -> Result<ControlFlow<()>, E>,
) -> Result<Report, E> {
    let batch = evaluation.batch.max(1) as u64;
    while metrics.simulations() < evaluation.episodes {
        let first = metrics.simulations() + 1;
        let last = evaluation.episodes.min(metrics.simulations() + batch);
        let requests = (first..=last)
            .map(|number| evaluation.request(system.space(), number as u32))
            .collect::<Result<Vec<Request>, EvaluationError>>()?;
        let episodes = system.rollout(&requests).map_err(EvaluationError::from)?;
        if episodes.len() != requests.len() {
            return Err(EvaluationError::Episodes { asked: requests.len(), given: episodes.len() }.into());
        }
        episodes.iter().for_each(|episode| metrics.add(episode));
        if on_batch(&episodes)?.is_break() {
            break;
        }
    }
    Ok(metrics.report(evaluation.seed))
}
