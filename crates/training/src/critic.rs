//! A network that learns the value of observations.

use mishandle_network::{
    Adam, CHUNK_ROWS, ChunkPool, Mlp, Moments, Normalizer, RunningNormalizer, Workspace, clip_norm,
};
use mishandle_rollout::Seed;

use crate::initialization::initial_network;
use crate::{Checkpoint, CriticSettings, TrainingError};

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
    scale: Option<RunningNormalizer>,
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
        let CriticSettings { hidden, activation, initialization, learning_rate, normalize_values } = settings;
        let sizes = (observation_size, &hidden[..], 1);
        let network = initial_network(sizes, *activation, *initialization, 1.0, seed)?;
        Ok(Critic {
            adam: Adam::new(network.parameter_count(), *learning_rate),
            network,
            scale: normalize_values.then(|| RunningNormalizer::new(1)),
            pool: ChunkPool::new(CHUNK_ROWS),
            gradient: Vec::new(),
        })
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
        let Critic { network, adam, pool, gradient, .. } = self;
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
                let (at_row, slope) = value_loss(f64::from(*output), f64::from(targets[*place as usize]));
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

    /// Lets the scale follow `returns`, and writes them on it: the targets of the network's outputs.
    pub fn targets(
        &mut self,
        returns: impl Iterator<Item = f64>,
        targets: &mut Vec<f32>,
        scratch: &mut Vec<f64>,
    ) {
        scratch.clear();
        scratch.extend(returns);
        if let Some(scale) = &mut self.scale {
            scale.merge(&Moments::of_rows(scratch, 1));
        }
        let (mean, std) = self.mean_and_std();
        targets.clear();
        targets.extend(scratch.iter().map(|value| ((value - mean) / (std + 1e-8)).clamp(-CLIP, CLIP) as f32));
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

/// ½ (output - target)², and its derivative by the output.
pub fn value_loss(output: f64, target: f64) -> (f64, f64) {
    let error = output - target;
    (0.5 * error * error, error)
}

/// Values stay within ± this many standard deviations of the returns.
const CLIP: f64 = 5.0;
