//! Twin critics: targets use the smaller of two values, because a policy exploits overestimated
//! values.

use mishandle_network::{Mlp, Scalar, Workspace};
use mishandle_rollout::Seed;

use super::agent::weight_seed;
use crate::off_policy::action_value::{NetworkWithTarget, Sizes, concatenate, squared_error};
use crate::off_policy::transitions::TransitionSlice;
use crate::{Checkpoint, QCriticSettings, TrainingError};

/// Q₁ and Q₂ with their target networks.
///
/// # Reference
/// Fujimoto, van Hoof and Meger, "Addressing Function Approximation Error in Actor-Critic Methods",
/// ICML 2018.
#[derive(Debug)]
pub(crate) struct TwinCritics(pub [NetworkWithTarget; 2]);

/// Names in a checkpoint.
const NAMES: [&str; 2] = ["critic_1", "critic_2"];

impl TwinCritics {
    /// Creates two critics; `seed` is that of the training run.
    ///
    /// # Errors
    /// If a layer has size 0.
    pub fn new(sizes: Sizes, settings: &QCriticSettings, seed: Seed) -> Result<TwinCritics, TrainingError> {
        let critic = |index| NetworkWithTarget::critic(sizes, settings, weight_seed(seed, index));
        Ok(TwinCritics([critic(1)?, critic(2)?]))
    }

    /// Returns Q₁ and Q₂.
    pub fn networks(&self) -> [&Mlp<f32>; 2] {
        self.0.each_ref().map(|critic| &critic.network)
    }

    /// Returns Q₁' and Q₂'.
    pub fn targets(&self) -> [&Mlp<f32>; 2] {
        self.0.each_ref().map(|critic| &critic.target)
    }

    /// Returns the number of parameters of both networks.
    pub fn parameter_count(&self) -> usize {
        self.networks().map(Mlp::parameter_count).iter().sum()
    }

    /// Applies one step of both optimizers; `gradient` contains the parameters of Q₁, then of Q₂.
    pub fn step(&mut self, gradient: &[f32]) {
        let parts = gradient.chunks_exact(gradient.len() / 2);
        self.0.iter_mut().zip(parts).for_each(|(critic, gradient)| critic.step(gradient));
    }

    /// Applies the soft update to both target networks.
    pub fn soft_update(&mut self, tau: f64) {
        self.0.iter_mut().for_each(|critic| critic.soft_update(tau));
    }

    /// Saves both critics to a checkpoint.
    pub fn save(&self, checkpoint: &mut Checkpoint) {
        self.0.iter().zip(NAMES).for_each(|(critic, name)| critic.save(name, checkpoint));
    }

    /// Restores both critics from a checkpoint.
    ///
    /// # Errors
    /// If the checkpoint contains networks of other sizes.
    pub fn load(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainingError> {
        self.0.iter_mut().zip(NAMES).try_for_each(|(critic, name)| critic.load(name, checkpoint))
    }
}

/// Scratch memory of one thread for the loss of both critics.
#[derive(Debug, Default)]
pub(crate) struct TwinScratch<T> {
    target_critics: [Workspace<T>; 2],
    critics: [Workspace<T>; 2],
    inputs: Vec<T>,
    /// Targets y.
    pub targets: Vec<T>,
    slopes: Vec<T>,
}

impl<T: Scalar> TwinScratch<T> {
    /// Sets `targets` to min(Q₁'(s', a'), Q₂'(s', a')), where `next_actions` are a'.
    pub fn compute_minimum(
        &mut self,
        critics: [&Mlp<T>; 2],
        transitions: &TransitionSlice<'_, T>,
        next_actions: &[T],
    ) {
        let parts = [transitions.next_observations, next_actions, transitions.next_privileged];
        concatenate(parts, transitions.rows(), &mut self.inputs);
        let [first, second] = &mut self.target_critics;
        let values = critics[0].forward(&self.inputs, first).iter();
        let values = values.zip(critics[1].forward(&self.inputs, second));
        self.targets.clear();
        self.targets.extend(values.map(|(first, second)| if second < first { *second } else { *first }));
    }

    /// Returns `factor` Σ ((Q₁(s, a) - y)² + (Q₂(s, a) - y)²) and adds its gradient with respect to
    /// the parameters of Q₁, then of Q₂, to `gradient`.
    pub fn squared_errors(
        &mut self,
        critics: [&Mlp<T>; 2],
        transitions: &TransitionSlice<'_, T>,
        factor: f64,
        gradient: &mut [T],
    ) -> f64 {
        let TwinScratch { critics: passes, inputs, targets, slopes, .. } = self;
        let parts = [transitions.observations, transitions.actions, transitions.privileged];
        concatenate(parts, transitions.rows(), inputs);
        let (first_gradient, second_gradient) = gradient.split_at_mut(critics[0].parameter_count());
        squared_error(critics[0], inputs, targets, factor, &mut passes[0], slopes, first_gradient)
            + squared_error(critics[1], inputs, targets, factor, &mut passes[1], slopes, second_gradient)
    }
}
