//! Searches that need a whole round of values before they know their next points.

use std::mem;

use crate::ledger::Ledger;
use crate::{Observation, Search, SearchEnd, SearchError};

/// A search as a machine that wants points valued round by round.
///
/// It holds the points of the present round; once all their values are there it decides on the next one. No round
/// is empty unless the machine has ended.
pub trait RoundBased: Send {
    /// The name in [`SEARCHES`](crate::SEARCHES), or of the method where it is not listed.
    fn name(&self) -> &'static str;

    /// The points to value next, in order; empty when the machine has ended.
    fn round(&self) -> &[Vec<f64>];

    /// Takes the values of the round, in its order, and moves to the next one.
    ///
    /// `values` has one number, never NaN, for each point of [`round`](RoundBased::round).
    fn receive(&mut self, values: &[f64]);

    /// Why the machine has ended, if it has.
    fn finish(&self) -> Option<SearchEnd>;
}

/// Makes a [`Search`] of a round-based machine: hands its points out and gathers their values.
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
    ledger: Ledger,
}

impl<M: RoundBased> AskTell<M> {
    /// A search that runs `machine`, which has not ended yet.
    pub fn new(machine: M) -> Self {
        let dimension = machine.round().first().map_or(0, Vec::len);
        Self { machine, dimension, n_asked: 0, values: Vec::new(), ledger: Ledger::default() }
    }

    /// The machine inside.
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
        points.iter().for_each(|u| self.ledger.hand_out(u.clone()));
        points
    }

    fn tell(&mut self, u: &[f64], observation: &Observation) -> Result<(), SearchError> {
        self.ledger.take_back(u, observation.robustness)?;
        self.values.push(observation.robustness);
        if self.values.len() == self.machine.round().len() {
            let mut values = mem::take(&mut self.values);
            self.machine.receive(&values);
            values.clear();
            self.values = values;
            self.n_asked = 0;
        }
        Ok(())
    }

    fn finished(&self) -> Option<SearchEnd> {
        self.machine.finish()
    }

    fn best(&self) -> Option<(&[f64], f64)> {
        self.ledger.best()
    }
}
