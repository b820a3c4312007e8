//! Action-value networks, and networks with target networks.

use mishandle_network::{Activation, Adam, Mlp, Scalar, Workspace};
use mishandle_rollout::Seed;

use crate::{Checkpoint, QCriticSettings, TrainingError};

/// Sizes of the inputs and outputs of an agent's networks.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sizes {
    pub observation: usize,
    pub action: usize,
    /// Number of privileged inputs of the critics.
    pub privileged: usize,
}

/// A network with its optimizer and its target network.
///
/// ```text
/// θ' ← (1 - τ) θ' + τ θ
/// ```
#[derive(Debug)]
pub(crate) struct NetworkWithTarget {
    pub network: Mlp<f32>,
    pub target: Mlp<f32>,
    adam: Adam<f32>,
}

impl NetworkWithTarget {
    /// Creates the target network as a copy of the network.
    pub fn new(network: Mlp<f32>, learning_rate: f64) -> NetworkWithTarget {
        let adam = Adam::new(network.parameter_count(), learning_rate);
        NetworkWithTarget { target: network.clone(), network, adam }
    }

    /// Creates a critic Q(o, a), with privileged inputs after the action, initialized from `seed`.
    ///
    /// # Errors
    /// If a layer has size 0.
    pub fn critic(
        Sizes { observation, action, privileged }: Sizes,
        settings: &QCriticSettings,
        seed: Seed,
    ) -> Result<NetworkWithTarget, TrainingError> {
        let sizes = [&[observation + action + privileged], &settings.hidden[..], &[1]].concat();
        let mut network = Mlp::new(&sizes, settings.activation, Activation::Identity)?;
        if settings.layer_norm {
            network = network.with_layer_norm();
        }
        settings.initialization.initialize(&mut network, 0.1, seed)?;
        Ok(NetworkWithTarget::new(network, settings.learning_rate))
    }

    /// Replaces network and target network by a network of the same sizes.
    pub fn replace(&mut self, network: &Mlp<f32>) {
        self.network = network.clone();
        self.target = network.clone();
    }

    /// Applies one optimizer step.
    pub fn step(&mut self, gradient: &[f32]) {
        let NetworkWithTarget { network, adam, .. } = self;
        network.update(|parameters| adam.step(parameters, gradient));
    }

    /// Moves the target network toward the network: θ' ← (1 - τ) θ' + τ θ.
    pub fn soft_update(&mut self, tau: f64) {
        let NetworkWithTarget { network, target, .. } = self;
        let tau = tau as f32;
        target.update(|target| {
            for (target, parameter) in target.iter_mut().zip(network.parameters()) {
                *target += tau * (parameter - *target);
            }
        });
    }

    /// Saves network, target network and optimizer to a checkpoint.
    pub fn save(&self, name: &str, checkpoint: &mut Checkpoint) {
        checkpoint.put(&format!("{name}.parameters"), self.network.parameters().to_vec());
        checkpoint.put(&format!("{name}.target"), self.target.parameters().to_vec());
        checkpoint.put_adam(&format!("{name}.adam"), &self.adam);
    }

    /// Restores the state from a checkpoint.
    ///
    /// # Errors
    /// If the checkpoint contains a network of other sizes.
    pub fn load(&mut self, name: &str, checkpoint: &Checkpoint) -> Result<(), TrainingError> {
        let count = self.network.parameter_count();
        let parameters = checkpoint.f32s(&format!("{name}.parameters"), count)?;
        self.network.update(|own| own.copy_from_slice(parameters));
        let target = checkpoint.f32s(&format!("{name}.target"), count)?;
        self.target.update(|own| own.copy_from_slice(target));
        self.adam = checkpoint.adam(&format!("{name}.adam"), count)?;
        Ok(())
    }
}

/// Fills `inputs` with the rows of all parts, concatenated: observation, action and privileged
/// inputs. A part may have no columns.
pub fn concatenate<T: Scalar>(parts: [&[T]; 3], rows: usize, inputs: &mut Vec<T>) {
    inputs.clear();
    for row in 0..rows {
        for part in parts {
            let columns = part.len() / rows;
            inputs.extend_from_slice(&part[row * columns..][..columns]);
        }
    }
}

/// Returns `factor` Σ (Q(inputs) - targets)² and adds its gradient with respect to the critic's
/// parameters to `gradient`.
pub fn squared_error<T: Scalar>(
    critic: &Mlp<T>,
    inputs: &[T],
    targets: &[T],
    factor: f64,
    workspace: &mut Workspace<T>,
    slopes: &mut Vec<T>,
    gradient: &mut [T],
) -> f64 {
    let mut loss = 0.0;
    slopes.clear();
    for (value, target) in critic.forward(inputs, workspace).iter().zip(targets) {
        let error = value.to_f64() - target.to_f64();
        loss += factor * error * error;
        slopes.push(T::from_f64(2.0 * factor * error));
    }
    critic.backward(slopes, workspace, Some(gradient), None);
    loss
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(weight: f32) -> Mlp<f32> {
        let mut network = Mlp::new(&[2, 1], Activation::Elu, Activation::Identity).unwrap();
        network.update(|parameters| parameters.copy_from_slice(&[weight, 1.0, 0.5]));
        network
    }

    #[test]
    fn the_squared_error_matches_a_calculation_by_hand() {
        let mut inputs = vec![];
        concatenate([&[1.0, 2.0], &[3.0, -1.0], &[7.0, 8.0]], 2, &mut inputs);
        assert_eq!(inputs, [1.0, 3.0, 7.0, 2.0, -1.0, 8.0]);
        concatenate([&[1.0, 2.0], &[3.0, -1.0], &[]], 2, &mut inputs);
        assert_eq!(inputs, [1.0, 3.0, 2.0, -1.0]);
        // Q = 2 o + a + 0.5: 5.5 and 3.5. Errors 0.5 and -0.5: ¼ (0.25 + 0.25), slopes 2 · ¼ ·
        // ±0.5.
        let mut slopes = vec![];
        let mut gradient = [0.0; 3];
        let loss = squared_error(
            &line(2.0),
            &inputs,
            &[5.0, 4.0],
            0.25,
            &mut Workspace::default(),
            &mut slopes,
            &mut gradient,
        );
        assert_eq!((loss, slopes), (0.125, vec![0.25, -0.25]));
        // Σ slope · (o, a, 1)
        assert_eq!(gradient, [-0.25, 1.0, 0.0]);
    }

    #[test]
    fn a_soft_update_moves_the_target_by_tau() {
        let mut network = NetworkWithTarget::new(line(2.0), 0.1);
        network.network.update(|parameters| parameters.copy_from_slice(&[4.0, 1.0, -0.5]));
        network.soft_update(0.25);
        assert_eq!(network.target.parameters(), [2.5, 1.0, 0.25]);
    }
}
