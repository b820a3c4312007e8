//! The ask-and-tell interface for searches that evaluate points in rounds.

use std::mem;

use crate::pending::PendingPoints;
use crate::{Observation, Search, SearchEnd, SearchError};

/// A search that evaluates points in rounds.
///
/// The points of the next round depend on all values of the current one. A round is empty only
/// after the search has ended.
pub trait RoundBased: Send {
    /// Returns the name in [`SEARCHES`](crate::SEARCHES), or the name of the method if it is not
    /// listed.
    fn name(&self) -> &'static str;

    /// Returns the points of the current round; empty after the search has ended.
    fn round(&self) -> &[Vec<f64>];

    /// Takes the values of the current round and starts the next one.
    ///
    /// `values` has one number, not NaN, for each point of [`round`](RoundBased::round), in the
    /// same order.
    fn receive(&mut self, values: &[f64]);

    /// Returns whether the search takes [parts](crate::Parts).
    fn needs_parts(&self) -> bool {
        false
    }

    /// Takes the parts of the current round, before its values. A point whose parts are unknown has
    /// an empty list.
    fn receive_parts(&mut self, _parts: Vec<Vec<f64>>) {}

    /// Returns the [stop threshold](Search::stop_threshold) of point `i` of the round.
    fn stop_threshold(&self, _i: usize) -> f64 {
        f64::INFINITY
    }

    /// Returns why the search has ended; `None` if it has not.
    fn finished(&self) -> Option<SearchEnd>;

    /// Returns whether the search explores the whole box as long as it runs: see
    /// [`Search::keeps_exploring`].
    fn keeps_exploring(&self) -> bool {
        false
    }
}

/// Adapts a round-based search to the [`Search`] interface.
///
/// # Example
/// ```
/// use mishandle_search::{AskTell, NelderMead, NelderMeadOptions, Search};
///
/// let options = NelderMeadOptions { start: Some(vec![0.5, 0.5]), ..Default::default() };
/// let mut search = AskTell::new(NelderMead::new(2, 0, &options)?);
/// let simplex = search.ask_batch(8);
/// assert_eq!(simplex, [[0.5, 0.5], [0.525, 0.5], [0.5, 0.525]]);
/// assert!(search.ask().is_none() && search.finished().is_none(), "the next point depends on these three");
/// # Ok::<(), mishandle_search::SearchError>(())
/// ```
#[derive(Debug, Clone)]
pub struct AskTell<M> {
    machine: M,
    dimension: usize,
    n_asked: usize,
    values: Vec<f64>,
    parts: Vec<Vec<f64>>,
    pending: PendingPoints,
}

impl<M: RoundBased> AskTell<M> {
    /// Creates the adapter. `machine` must not have ended.
    pub fn new(machine: M) -> Self {
        let dimension = machine.round().first().map_or(0, Vec::len);
        Self {
            machine,
            dimension,
            n_asked: 0,
            values: Vec::new(),
            parts: Vec::new(),
            pending: PendingPoints::default(),
        }
    }

    /// Returns the round-based search.
    pub fn machine(&self) -> &M {
        &self.machine
    }
}

impl<M: RoundBased> Search for AskTell<M> {
    fn name(&self) -> &'static str {
        self.machine.name()
    }

    fn dimension(&self) -> usize {
        self.dimension
    }

    fn ask_batch(&mut self, n: usize) -> Vec<Vec<f64>> {
        let open = &self.machine.round()[self.n_asked..];
        let points: Vec<Vec<f64>> = open.iter().take(n).cloned().collect();
        self.n_asked += points.len();
        points.iter().for_each(|u| self.pending.push(u.clone()));
        points
    }

    fn needs_parts(&self) -> bool {
        self.machine.needs_parts()
    }

    fn stop_threshold(&self, u: &[f64]) -> f64 {
        // Equal points have different thresholds if their rank in the round matters.
        let thresholds = self.machine.round().iter().enumerate().filter(|(_, point)| *point == u);
        thresholds.map(|(i, _)| self.machine.stop_threshold(i)).fold(0.0, f64::max)
    }

    fn tell(&mut self, u: &[f64], observation: &Observation) -> Result<(), SearchError> {
        self.pending.resolve(u, observation.robustness)?;
        self.values.push(observation.robustness);
        let needs_parts = self.machine.needs_parts();
        if needs_parts {
            self.parts.push(observation.parts.clone());
        }
        if self.values.len() == self.machine.round().len() {
            let mut values = mem::take(&mut self.values);
            if needs_parts {
                self.machine.receive_parts(mem::take(&mut self.parts));
            }
            self.machine.receive(&values);
            values.clear();
            self.values = values;
            self.n_asked = 0;
        }
        Ok(())
    }

    fn finished(&self) -> Option<SearchEnd> {
        self.machine.finished()
    }

    fn keeps_exploring(&self) -> bool {
        self.machine.keeps_exploring()
    }

    fn best(&self) -> Option<(&[f64], f64)> {
        self.pending.best()
    }
}
