//! Models that predict several actions ahead: which of them are played.

use serde::{Deserialize, Serialize};

use crate::OnnxProblem;

/// Use of the actions that a model predicts for the present and the next control steps.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Chunk {
    /// The model runs once in this number of control steps, and the first actions of its chunk are
    /// played.
    Execute(usize),
    /// The model runs in each control step. All predictions for a step are averaged with the
    /// weights exp(-m i), where i = 0 is the oldest one and m is this number (temporal ensembling
    /// of ACT, Zhao et al., RSS 2023).
    Ensemble(f64),
}

/// The actions of a model that predicts several ahead.
///
/// Its memory has the number of control steps so far, then for each of the next steps the sum of
/// the weighted predictions.
#[derive(Debug)]
pub(super) struct Plan {
    /// Number of actions that the model predicts.
    length: usize,
    /// Number of them that are used.
    horizon: usize,
    /// Number of control steps from one run of the model to the next: 1 or the horizon.
    period: usize,
    /// Length of an action.
    size: usize,
    /// Weights of the predictions for a step, the oldest first, and the sums of the first of them.
    weights: Vec<[f64; 2]>,
}

impl Plan {
    /// Makes the plan for chunks of `length` actions of `size` numbers, in the output `name`.
    pub(super) fn new(chunk: Chunk, name: &str, [length, size]: [usize; 2]) -> Result<Plan, OnnxProblem> {
        let invalid = |reason| OnnxProblem::Interface { place: "its chunk".to_string(), reason };
        let (horizon, period, decay) = match chunk {
            Chunk::Execute(steps) if (1..=length).contains(&steps) => (steps, steps, 0.0),
            Chunk::Execute(steps) => {
                let range = if length == 1 { "1".to_string() } else { format!("1 to {length}") };
                return Err(invalid(format!(
                    "`execute` is {steps}, but the output `{name}` has {length} actions; expected {range}"
                )));
            }
            Chunk::Ensemble(decay) => (length, 1, decay),
        };
        let mut sum = 0.0;
        let weight = |age: usize| {
            let weight = (-decay * age as f64).exp();
            sum += weight;
            [weight, sum]
        };
        let weights: Vec<[f64; 2]> = (0..horizon.div_ceil(period)).map(weight).collect();
        if !sum.is_finite() {
            return Err(invalid(format!(
                "the weights exp(-m i) of {length} predictions are not finite for m = {decay}, `ensemble`"
            )));
        }
        Ok(Plan { length, horizon, period, size, weights })
    }

    /// Returns the number of numbers that the model predicts.
    pub(super) fn chunk_size(&self) -> usize {
        self.length * self.size
    }

    /// Returns the length of the memory; the largest integer if it is more.
    pub(super) fn memory_size(&self) -> usize {
        (self.horizon - 1).saturating_mul(self.size).saturating_add(1)
    }

    /// Returns after how many control steps the model runs; 0 if it does in the next one.
    pub(super) fn steps_to_chunk(&self, memory: &[f64]) -> usize {
        let played = memory[0] as usize % self.period;
        if played == 0 { 0 } else { self.period - played }
    }

    /// Writes the action of the next control step. `chunk` has the predictions of the model, if it
    /// ran.
    pub(super) fn play(
        &self,
        memory: &mut [f64],
        chunk: Option<impl Iterator<Item = f32>>,
        action: &mut [f32],
    ) {
        let Some((step, pending)) = memory.split_first_mut() else { return };
        let size = self.size;
        let Some(chunk) = chunk else {
            action.iter_mut().zip(&*pending).for_each(|(action, planned)| *action = *planned as f32);
            pending.copy_within(size.., 0);
            let last = pending.len() - size;
            pending[last..].fill(0.0);
            *step += 1.0;
            return;
        };
        for (index, predicted) in chunk.take(self.horizon * size).enumerate() {
            let ahead = index / size;
            // Runs of the model that predicted an action of this step before.
            let earlier = (*step as usize).min(self.horizon - 1 - ahead) / self.period;
            let [weight, total] = self.weights[earlier];
            let sum = pending.get(index).copied().unwrap_or(0.0) + weight * f64::from(predicted);
            match index.checked_sub(size) {
                None => action[index] = (sum / total) as f32,
                Some(place) => pending[place] = sum,
            }
        }
        *step += 1.0;
    }
}
