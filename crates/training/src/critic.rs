//! A network that learns the value of observations.

use mishandle_network::{
    Activation, Adam, CHUNK_ROWS, ChunkPool, Mlp, Moments, Normalizer, RunningNormalizer, Workspace,
};
use mishandle_rollout::{Seed, Stream};

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
}

#[derive(Debug, Default)]
struct Scratch {
    inputs: Vec<f32>,
    workspace: Workspace<f32>,
}

impl Critic {
    /// A critic of observations of `observation_size` numbers, orthogonally initialised from `seed`.
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
        let CriticSettings { hidden, activation, learning_rate, normalize_values } = settings;
        let network = initial_network(observation_size, hidden, 1, *activation, 1.0, seed)?;
        Ok(Critic {
            adam: Adam::new(network.parameter_count(), *learning_rate),
            network,
            scale: normalize_values.then(|| RunningNormalizer::new(1)),
            pool: ChunkPool::new(CHUNK_ROWS),
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

    /// The values of plain observations, which `normalizer` scales.
    pub fn values(&self, normalizer: &Normalizer<f32>, observations: &[f32], values: &mut [f64]) {
        let columns = self.network.input_size();
        let (mean, std) = self.mean_and_std();
        self.pool.map(values.len(), values, |rows, Scratch { inputs, workspace }, values| {
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

/// Values stay within ± this many standard deviations of the returns.
const CLIP: f64 = 5.0;

/// A network with orthogonal weights: gain √2 for hidden layers, `last_gain` for the last.
///
/// # Errors
/// If a layer has no outputs.
pub(crate) fn initial_network(
    inputs: usize,
    hidden: &[usize],
    outputs: usize,
    activation: Activation,
    last_gain: f64,
    seed: Seed,
) -> Result<Mlp<f32>, TrainingError> {
    let sizes = [&[inputs], hidden, &[outputs]].concat();
    let mut network = Mlp::new(&sizes, activation, Activation::Identity)?;
    let mut gains = vec![std::f64::consts::SQRT_2; hidden.len()];
    gains.push(last_gain);
    let mut step = 0;
    network.initialize_orthogonal(&gains, || {
        let mut draw = [0.0];
        seed.normals(Stream::Weights, step, &mut draw);
        step += 1;
        draw[0]
    })?;
    Ok(network)
}
