//! A network that learns the value of observations.

use mishandle_network::{
    Adam, CHUNK_ROWS, ChunkPool, Mlp, Moments, Normalizer, RunningNormalizer, Workspace, clip_norm,
};
use mishandle_rollout::Seed;

use crate::initialization::initial_network;
use crate::{Checkpoint, CriticSettings, TrainingError, ValueMoments};

/// A value network with its optimiser, and the scale that its outputs are in.
///
/// ```text
/// V(x) = std · clamp(network(x), -5, 5) + mean
/// ```
///
/// Mean and standard deviation follow the returns that it is trained on, so that the network's task is the same
/// whatever the size of the rewards.
#[derive(Debug)]
pub struct Critic {
    network: Mlp<f32>,
    adam: Adam<f32>,
    loss_scale: f64,
    scale: Option<RunningNormalizer>,
    value_moments: ValueMoments,
    pool: ChunkPool<f32, Scratch>,
    gradient: Vec<f32>,
}

#[derive(Debug, Default)]
struct Scratch {
    inputs: Vec<f32>,
    workspace: Workspace<f32>,
    by_output: Vec<f32>,
}

impl Critic {
    /// A critic of observations of `observation_size` numbers, initialised from `seed`.
    ///
    /// With `normalize_values` its outputs follow the scale of the returns.
    ///
    /// # Errors
    /// If a layer has no outputs.
    pub fn new(
        observation_size: usize,
        settings: &CriticSettings,
        seed: Seed,
    ) -> Result<Critic, TrainingError> {
        let CriticSettings { hidden, activation, initialization, learning_rate, .. } = settings;
        let sizes = (observation_size, &hidden[..], 1);
        let network = initial_network(sizes, *activation, *initialization, 1.0, seed)?;
        Ok(Critic {
            adam: Adam::new(network.parameter_count(), *learning_rate),
            network,
            loss_scale: settings.loss_scale,
            scale: settings.normalize_values.then(|| RunningNormalizer::new(1)),
            value_moments: settings.value_moments,
            pool: ChunkPool::new(CHUNK_ROWS),
            gradient: Vec::new(),
        })
    }

    /// Factor on the squared error.
    pub fn loss_scale(&self) -> f64 {
        self.loss_scale
    }

    /// The network, whose output is a value on the critic's scale.
    pub fn network(&self) -> &Mlp<f32> {
        &self.network
    }

    /// Sets the length of the coming steps.
    pub fn set_learning_rate(&mut self, learning_rate: f64) {
        self.adam.learning_rate = learning_rate;
    }

    /// One step of the optimiser.
    pub fn step(&mut self, gradient: &[f32]) {
        let Critic { network, adam, .. } = self;
        network.update(|parameters| adam.step(parameters, gradient));
    }

    /// One step of the optimiser on the mean loss of the rows at `places`, whose gradient has at most the norm
    /// `max_grad_norm`; gives the loss.
    pub fn learn(
        &mut self,
        normalizer: &Normalizer<f32>,
        observations: &[f32],
        targets: &[f32],
        places: &[u32],
        max_grad_norm: f64,
    ) -> f64 {
        let Critic { network, adam, pool, gradient, loss_scale, .. } = self;
        let (columns, share) = (network.input_size(), 1.0 / places.len() as f64);
        // The loss rides along behind the gradient.
        gradient.resize(network.parameter_count() + 1, 0.0);
        pool.sum(places.len(), gradient, |rows, scratch, gradient| {
            let Scratch { inputs, workspace, by_output } = scratch;
            let (by_network, loss) = gradient.split_at_mut(network.parameter_count());
            inputs.clear();
            by_output.clear();
            for place in &places[rows.clone()] {
                inputs.extend_from_slice(&observations[*place as usize * columns..][..columns]);
            }
            normalizer.normalize(inputs);
            for (place, output) in places[rows].iter().zip(network.forward(inputs, workspace)) {
                let target = f64::from(targets[*place as usize]);
                let (at_row, slope) = value_loss(f64::from(*output), target, *loss_scale);
                loss[0] += (share * at_row) as f32;
                by_output.push((share * slope) as f32);
            }
            network.backward(by_output, workspace, Some(by_network), None);
        });
        let (by_network, loss) = gradient.split_at_mut(network.parameter_count());
        clip_norm(by_network, max_grad_norm);
        network.update(|parameters| adam.step(parameters, by_network));
        f64::from(loss[0])
    }

    /// The values of plain observations, which `normalizer` scales.
    pub fn values(&self, normalizer: &Normalizer<f32>, observations: &[f32], values: &mut [f64]) {
        let columns = self.network.input_size();
        let (mean, std) = self.mean_and_std();
        self.pool.map(values.len(), values, |rows, Scratch { inputs, workspace, .. }, values| {
            inputs.clear();
            inputs.extend_from_slice(&observations[rows.start * columns..rows.end * columns]);
            normalizer.normalize(inputs);
            for (value, output) in values.iter_mut().zip(self.network.forward(inputs, workspace)) {
                *value = if self.scale.is_some() {
                    std * f64::from(*output).clamp(-CLIP, CLIP) + mean
                } else {
                    f64::from(*output)
                };
            }
        });
    }

    /// Lets the scale follow the values and returns of a rollout, and writes both on it: the values as they were when
    /// the rollout was made, and the targets of the network's outputs.
    pub fn targets(
        &mut self,
        values: &[f64],
        returns: &[f64],
        old_values: &mut Vec<f32>,
        targets: &mut Vec<f32>,
    ) {
        if self.value_moments == ValueMoments::Both {
            self.follow(values);
        }
        self.scale(values, old_values);
        self.follow(returns);
        self.scale(returns, targets);
    }

    fn follow(&mut self, numbers: &[f64]) {
        if let Some(scale) = &mut self.scale {
            let moments = Moments::of_rows(numbers, 1);
            scale.merge(&match self.value_moments {
                ValueMoments::Returns => moments,
                ValueMoments::Both => moments.with_sample_variance(),
            });
        }
    }

    fn scale(&self, numbers: &[f64], scaled: &mut Vec<f32>) {
        scaled.clear();
        if self.scale.is_none() {
            scaled.extend(numbers.iter().map(|value| *value as f32));
            return;
        }
        let (mean, std) = self.mean_and_std();
        scaled.extend(numbers.iter().map(|value| ((value - mean) / (std + 1e-8)).clamp(-CLIP, CLIP) as f32));
    }

    fn mean_and_std(&self) -> (f64, f64) {
        match &self.scale {
            Some(scale) => (scale.mean()[0], scale.variance()[0].sqrt()),
            None => (0.0, 1.0),
        }
    }

    /// Puts all that its future depends on into a checkpoint.
    pub fn save(&self, checkpoint: &mut Checkpoint) {
        checkpoint.put("critic.parameters", self.network.parameters().to_vec());
        checkpoint.put_adam("critic.adam", &self.adam);
        if let Some(scale) = &self.scale {
            checkpoint.put_moments("critic.scale", scale.moments());
        }
    }

    /// Goes on where a checkpoint was taken.
    ///
    /// # Errors
    /// If the checkpoint holds a critic of other sizes.
    pub fn load(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainingError> {
        let count = self.network.parameter_count();
        let parameters = checkpoint.f32s("critic.parameters", count)?;
        self.network.update(|own| own.copy_from_slice(parameters));
        self.adam = checkpoint.adam("critic.adam", count)?;
        if self.scale.is_some() {
            self.scale = Some(RunningNormalizer::from_moments(checkpoint.moments("critic.scale", 1)?)?);
        }
        Ok(())
    }
}

/// `loss_scale` (output - target)², and its derivative by the output.
pub fn value_loss(output: f64, target: f64, loss_scale: f64) -> (f64, f64) {
    let error = output - target;
    (loss_scale * error * error, 2.0 * loss_scale * error)
}

/// Values stay within ± this many standard deviations of the returns.
const CLIP: f64 = 5.0;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_stay_within_five_deviations_of_the_mean_return() {
        let settings = CriticSettings { hidden: vec![], ..CriticSettings::default() };
        let mut critic = Critic::new(1, &settings, Seed(1)).unwrap();
        // The scale begins as if it had seen 0 with the variance 1: mean 6/4, variance (1 + 3/4 · 2²) / 4 = 1.
        critic.targets(&[0.0; 3], &[2.0; 3], &mut vec![], &mut vec![]);
        let plain = Normalizer::new(&[0.0], &[1.0]).unwrap();
        let mut value = |bias: f32| {
            critic.network.update(|parameters| parameters.copy_from_slice(&[0.0, bias]));
            let mut values = [0.0];
            critic.values(&plain, &[0.0], &mut values);
            values[0]
        };
        assert_eq!([3.0, 9.0, -9.0].map(&mut value), [4.5, 6.5, -3.5]);
    }
}
