//! Action distributions of [SAC](crate::sac).

use mishandle_network::{Mlp, Scalar, Workspace};

use super::squashed_sample::SquashedSample;
use crate::settings::declare::choice;

choice! {
    /// Action distribution of the policy.
    pub enum Distribution {
        /// Squashed Gaussian: tanh of a Gaussian. The network outputs μ of all action dimensions,
        /// then h, which determines σ.
        Squashed = "squashed",
        /// Gaussian clipped to [-1, 1]. The network outputs μ of all action dimensions; log σ is a
        /// state-independent parameter vector.
        Clipped = "clipped",
    }
}

impl Distribution {
    /// Returns the number of network outputs for the action size `actions`.
    pub fn outputs(self, actions: usize) -> usize {
        match self {
            Distribution::Squashed => 2 * actions,
            Distribution::Clipped => actions,
        }
    }

    /// Returns the number of parameters outside of the network.
    pub fn parameters(self, actions: usize) -> usize {
        match self {
            Distribution::Squashed => 0,
            Distribution::Clipped => actions,
        }
    }
}

/// Stochastic policy π.
#[derive(Clone, Copy, Debug)]
pub struct Actor<'a, T> {
    /// Action distribution.
    pub distribution: Distribution,
    /// Policy network.
    pub network: &'a Mlp<T>,
    /// log σ of each action dimension; empty if the network outputs it.
    pub log_std: &'a [T],
}

impl<T: Scalar> Actor<'_, T> {
    /// Returns the action size.
    pub fn action_size(&self) -> usize {
        match self.distribution {
            Distribution::Squashed => self.network.output_size() / 2,
            Distribution::Clipped => self.network.output_size(),
        }
    }

    /// Returns the samples of one row from the network outputs and z.
    pub(super) fn row_samples<'r>(
        &'r self,
        outputs: &'r [T],
        noise: &'r [f64],
    ) -> impl Iterator<Item = SquashedSample> + 'r {
        let (means, raw) = outputs.split_at(noise.len());
        let (spreads, sample): (_, fn(f64, f64, f64) -> SquashedSample) = match self.distribution {
            Distribution::Squashed => (raw, SquashedSample::tanh),
            Distribution::Clipped => (self.log_std, SquashedSample::clipped),
        };
        let rows = means.iter().zip(spreads).zip(noise);
        rows.map(move |((mean, spread), z)| sample(mean.to_f64(), spread.to_f64(), *z))
    }

    /// Samples the actions of all rows from their observations and z.
    pub(super) fn sample(
        &self,
        observations: &[T],
        noise: &[f64],
        workspace: &mut Workspace<T>,
        samples: &mut Vec<SquashedSample>,
        actions: &mut Vec<T>,
    ) {
        samples.clear();
        actions.clear();
        let outputs = self.network.forward(observations, workspace).chunks_exact(self.network.output_size());
        for (outputs, noise) in outputs.zip(noise.chunks_exact(self.action_size())) {
            for sample in self.row_samples(outputs, noise) {
                actions.push(T::from_f64(sample.action));
                samples.push(sample);
            }
        }
    }
}
