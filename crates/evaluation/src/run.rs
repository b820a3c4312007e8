//! Many simulations of one system, from starts that are drawn and not searched.

use std::ops::ControlFlow;

use mishandle_rollout::{Episode, InitialBox, Request, Seed, System};

use crate::{EvaluationError, Metrics, Report};

/// How many starts are drawn for one simulation before the accepted part of the box is taken to be empty.
const DRAWS: u64 = 100_000;

/// Says which initial configurations count.
pub type Accepts<'a> = dyn Fn(&[f64]) -> bool + 'a;

/// What to run: how many simulations, keyed by which seed, from which part of the box.
///
/// Simulation i, counted from 0, has the seed `seed.child(i)` and starts at `initial_box.sample(seed, i)` if that is
/// accepted, else at the first of `initial_box.sample(seed.child(i), 1)`, `(…, 2)`, … that is. So neither depends on
/// the system, on the number of simulations or on the batches they are run in.
#[derive(Clone, Copy)]
pub struct Evaluation<'a> {
    /// Number of simulations.
    pub episodes: u64,
    /// Key of starts and simulations.
    pub seed: Seed,
    /// Which initial configurations count; `None` for the whole box.
    pub accepted: Option<&'a Accepts<'a>>,
}

impl Evaluation<'_> {
    /// An evaluation over the whole box.
    pub fn new(episodes: u64, seed: Seed) -> Self {
        Evaluation { episodes, seed, accepted: None }
    }

    /// Simulation `index`, counted from 0.
    ///
    /// # Errors
    /// [`EvaluationError::NoStart`] if no start was accepted among 100,000.
    pub fn request(&self, initial_box: &InitialBox, index: u64) -> Result<Request, EvaluationError> {
        let seed = self.seed.child(index);
        let first = initial_box.sample(self.seed, index);
        let further = (1..DRAWS).map(|draw| initial_box.sample(seed, draw));
        let accepted = |x0: &Vec<f64>| self.accepted.is_none_or(|accepted| accepted(x0));
        match std::iter::once(first).chain(further).find(accepted) {
            Some(x0) => Ok(Request { x0, seed }),
            None => Err(EvaluationError::NoStart { simulation: index, draws: DRAWS }),
        }
    }
}

/// Runs the simulations of `evaluation` that `metrics` does not hold yet, and reports on all of them.
///
/// The first of them has the number `metrics.simulations()`: an interrupted evaluation goes on from recorded episodes
/// that were added again. `on_batch` is given each batch before the next one starts: the number of its first
/// simulation and the episodes in order. If it breaks, the evaluation ends there, and the report is on fewer
/// simulations than were asked for.
///
/// # Errors
/// What the system or `on_batch` cannot do, or [`EvaluationError::NoStart`].
///
/// # Example
/// See `tests/run.rs` for a system in closed form; with a task's system:
/// ```
/// # use std::ops::ControlFlow;
/// # use mishandle_evaluation::{EvaluationError, Evaluation, Metrics, Report, evaluate};
/// # use mishandle_rollout::{Seed, System};
/// fn report(system: &mut dyn System) -> Result<Report, EvaluationError> {
///     let mut done = 0;
///     evaluate(system, &Evaluation::new(100, Seed(7)), &mut Metrics::new(), |_, episodes| {
///         done += episodes.len();
///         Ok(ControlFlow::Continue(()))
///     })
/// }
/// ```
pub fn evaluate<E: From<EvaluationError>>(
    system: &mut dyn System,
    evaluation: &Evaluation<'_>,
    metrics: &mut Metrics,
    mut on_batch: impl FnMut(u64, &[Episode]) -> Result<ControlFlow<()>, E>,
) -> Result<Report, E> {
    let batch_size = system.batch_size().max(1) as u64;
    while metrics.simulations() < evaluation.episodes {
        let first = metrics.simulations();
        let last = evaluation.episodes.min(first + batch_size);
        let requests = (first..last)
            .map(|index| evaluation.request(system.initial_box(), index))
            .collect::<Result<Vec<Request>, EvaluationError>>()?;
        let episodes = system.rollout(&requests).map_err(EvaluationError::from)?;
        if episodes.len() != requests.len() {
            return Err(EvaluationError::Episodes { asked: requests.len(), given: episodes.len() }.into());
        }
        episodes.iter().for_each(|episode| metrics.add(episode));
        if on_batch(first, &episodes)?.is_break() {
            break;
        }
    }
    Ok(metrics.report(evaluation.seed))
}
