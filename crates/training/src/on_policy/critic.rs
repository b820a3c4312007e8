//! State-value network.

use mishandle_network::{
    Adam, CHUNK_ROWS, ChunkPool, Mlp, Moments, Normalizer, RunningNormalizer, Workspace, clip_norm,
};
use mishandle_rollout::Seed;

use crate::initialization::initial_network;
use crate::privileged::join;
use crate::{Checkpoint, CriticSettings, TrainingError, ValueMoments};

/// A value network with its optimizer and the running moments that denormalize its output.
///
/// ```text
/// V(x) = std · clamp(network(x), -5, 5) + mean
/// ```
///
/// Mean and standard deviation are running moments of the returns, so the regression targets of the
/// network do not depend on the magnitude of the rewards.
#[derive(Debug)]
pub struct Critic {
    network: Mlp<f32>,
    /// Number of privileged inputs, which follow the observation.
    privileged_size: usize,
    adam: Adam<f32>,
    loss_coef: f64,
    moments: Option<RunningNormalizer>,
    value_moments: ValueMoments,
    pool: ChunkPool<f32, Scratch>,
    gradient: Vec<f32>,
}

#[derive(Debug, Default)]
struct Scratch {
    observations: Vec<f32>,
    inputs: Vec<f32>,
    workspace: Workspace<f32>,
    output_gradient: Vec<f32>,
}

impl Scratch {
    /// Fills `inputs` with the normalized observations of some rows, each with its privileged
    /// inputs; `columns` and `size` are the lengths of both.
    fn fill_inputs(
        &mut self,
        normalizer: &Normalizer<f32>,
        observations: &[f32],
        columns: usize,
        privileged: &[f32],
        size: usize,
        rows: impl Iterator<Item = usize> + Clone,
    ) {
        let Scratch { observations: seen, inputs, .. } = self;
        seen.clear();
        for row in rows.clone() {
            seen.extend_from_slice(&observations[row * columns..][..columns]);
        }
        normalizer.normalize(seen);
        if size == 0 {
            std::mem::swap(seen, inputs);
            return;
        }
        inputs.resize(seen.len() / columns * (columns + size), 0.0);
        join(seen, columns, privileged, size, rows, inputs);
    }
}

impl Critic {
    /// Creates a critic for observations and privileged inputs of these sizes and initializes it
    /// from `seed`.
    ///
    /// # Errors
    /// If a layer has size 0.
    pub fn new(
        observation_size: usize,
        privileged_size: usize,
        settings: &CriticSettings,
        seed: Seed,
    ) -> Result<Critic, TrainingError> {
        let CriticSettings { hidden, activation, initialization, learning_rate, .. } = settings;
        let inputs = observation_size + privileged_size;
        let network = initial_network(inputs, hidden, 1, *activation, *initialization, 1.0, seed)?;
        Ok(Critic {
            adam: Adam::new(network.parameter_count(), *learning_rate),
            network,
            privileged_size,
            loss_coef: settings.loss_coef,
            moments: settings.normalize_values.then(|| RunningNormalizer::new(1)),
            value_moments: settings.value_moments,
            pool: ChunkPool::new(CHUNK_ROWS),
            gradient: Vec::new(),
        })
    }

    /// Returns the coefficient of the squared error.
    pub fn loss_coef(&self) -> f64 {
        self.loss_coef
    }

    /// Returns the network, whose output is a normalized value.
    pub fn network(&self) -> &Mlp<f32> {
        &self.network
    }

    /// Sets the learning rate.
    pub fn set_learning_rate(&mut self, learning_rate: f64) {
        self.adam.learning_rate = learning_rate;
    }

    /// Applies one optimizer step.
    pub fn step(&mut self, gradient: &[f32]) {
        let Critic { network, adam, .. } = self;
        network.update(|parameters| adam.step(parameters, gradient));
    }

    /// Applies one optimizer step on the mean loss of the rows `indices`, with the gradient norm
    /// clipped to `max_grad_norm`; returns the loss.
    pub fn train_minibatch(
        &mut self,
        normalizer: &Normalizer<f32>,
        observations: &[f32],
        privileged: &[f32],
        targets: &[f32],
        indices: &[u32],
        max_grad_norm: f64,
    ) -> f64 {
        let Critic { network, privileged_size, adam, pool, gradient, loss_coef, .. } = self;
        let share = 1.0 / indices.len() as f64;
        let size = *privileged_size;
        let columns = network.input_size() - size;
        // The last element of the sum is the loss.
        gradient.resize(network.parameter_count() + 1, 0.0);
        pool.sum(indices.len(), gradient, |rows, scratch, gradient| {
            let chunk = indices[rows.clone()].iter().map(|index| *index as usize);
            scratch.fill_inputs(normalizer, observations, columns, privileged, size, chunk);
            let Scratch { inputs, workspace, output_gradient, .. } = scratch;
            let (network_gradient, loss) = gradient.split_at_mut(network.parameter_count());
            output_gradient.clear();
            for (index, output) in indices[rows].iter().zip(network.forward(inputs, workspace)) {
                let target = f64::from(targets[*index as usize]);
                let (row_loss, slope) = value_loss(f64::from(*output), target, *loss_coef);
                loss[0] += (share * row_loss) as f32;
                output_gradient.push((share * slope) as f32);
            }
            network.backward(output_gradient, workspace, Some(network_gradient), None);
        });
        let (network_gradient, loss) = gradient.split_at_mut(network.parameter_count());
        clip_norm(network_gradient, max_grad_norm);
        network.update(|parameters| adam.step(parameters, network_gradient));
        f64::from(loss[0])
    }

    /// Computes the values of observations, which `normalizer` normalizes, and of normalized
    /// privileged inputs.
    pub fn values(
        &self,
        normalizer: &Normalizer<f32>,
        observations: &[f32],
        privileged: &[f32],
        values: &mut [f64],
    ) {
        let size = self.privileged_size;
        let columns = self.network.input_size() - size;
        let (mean, std) = self.mean_and_std();
        self.pool.map(values.len(), values, |rows, scratch, values| {
            scratch.fill_inputs(normalizer, observations, columns, privileged, size, rows);
            let Scratch { inputs, workspace, .. } = scratch;
            for (value, output) in values.iter_mut().zip(self.network.forward(inputs, workspace)) {
                *value = if self.moments.is_some() {
                    std * f64::from(*output).clamp(-CLIP, CLIP) + mean
                } else {
                    f64::from(*output)
                };
            }
        });
    }

    /// Updates the running moments from the values and returns of a rollout and normalizes both:
    /// values to `old_values`, returns to `targets`.
    pub fn normalize_targets(
        &mut self,
        values: &[f64],
        returns: &[f64],
        old_values: &mut Vec<f32>,
        targets: &mut Vec<f32>,
    ) {
        if self.value_moments == ValueMoments::Both {
            self.update_moments(values);
        }
        self.normalize(values, old_values);
        self.update_moments(returns);
        self.normalize(returns, targets);
    }

    fn update_moments(&mut self, numbers: &[f64]) {
        if let Some(moments) = &mut self.moments {
            let batch = Moments::of_rows(numbers, 1);
            moments.merge(&match self.value_moments {
                ValueMoments::Returns => batch,
                ValueMoments::Both => batch.with_sample_variance(),
            });
        }
    }

    fn normalize(&self, numbers: &[f64], normalized: &mut Vec<f32>) {
        normalized.clear();
        if self.moments.is_none() {
            normalized.extend(numbers.iter().map(|value| *value as f32));
            return;
        }
        let (mean, std) = self.mean_and_std();
        normalized
            .extend(numbers.iter().map(|value| ((value - mean) / (std + 1e-8)).clamp(-CLIP, CLIP) as f32));
    }

    fn mean_and_std(&self) -> (f64, f64) {
        match &self.moments {
            Some(moments) => (moments.mean()[0], moments.variance()[0].sqrt()),
            None => (0.0, 1.0),
        }
    }

    /// Saves network, optimizer and moments to a checkpoint.
    pub fn save(&self, checkpoint: &mut Checkpoint) {
        checkpoint.put("critic.parameters", self.network.parameters().to_vec());
        checkpoint.put_adam("critic.adam", &self.adam);
        if let Some(moments) = &self.moments {
            checkpoint.put_moments("critic.scale", moments.moments());
        }
    }

    /// Restores the critic from a checkpoint.
    ///
    /// # Errors
    /// If the checkpoint contains a critic of other sizes.
    pub fn load(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainingError> {
        let count = self.network.parameter_count();
        let parameters = checkpoint.f32s("critic.parameters", count)?;
        self.network.update(|own| own.copy_from_slice(parameters));
        self.adam = checkpoint.adam("critic.adam", count)?;
        if self.moments.is_some() {
            self.moments = Some(RunningNormalizer::from_moments(checkpoint.moments("critic.scale", 1)?)?);
        }
        Ok(())
    }
}

/// Returns `loss_coef` (output - target)² and its derivative by the output.
pub fn value_loss(output: f64, target: f64, loss_coef: f64) -> (f64, f64) {
    let error = output - target;
    (loss_coef * error * error, 2.0 * loss_coef * error)
}

/// Largest normalized value, in standard deviations of the returns.
const CLIP: f64 = 5.0;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_stay_within_five_standard_deviations_of_the_mean_return() {
        let settings = CriticSettings { hidden: vec![], ..CriticSettings::default() };
        let mut critic = Critic::new(1, 0, &settings, Seed(1)).unwrap();
        // The moments start with one sample of mean 0 and variance 1: mean 6/4, variance (1 + 3/4 ·
        // 2²) / 4 = 1.
        critic.normalize_targets(&[0.0; 3], &[2.0; 3], &mut vec![], &mut vec![]);
        let plain = Normalizer::new(&[0.0], &[1.0]).unwrap();
        let mut value = |bias: f32| {
            critic.network.update(|parameters| parameters.copy_from_slice(&[0.0, bias]));
            let mut values = [0.0];
            critic.values(&plain, &[0.0], &[], &mut values);
            values[0]
        };
        assert_eq!([3.0, 9.0, -9.0].map(&mut value), [4.5, 6.5, -3.5]);
    }
}
