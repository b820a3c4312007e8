//! The parts that differ between off-policy algorithms.

use mishandle_controllers::Policy;
use mishandle_network::Mlp;
use mishandle_rollout::Seed;

use super::action_value::Sizes;
use super::settings::OffPolicySettings;
use super::transitions::TransitionBatch;
use crate::{Checkpoint, ExplorationDecay, TrainingError};

/// Returns the child seed from which the weights of network `index` are drawn.
pub(crate) fn weight_seed(seed: Seed, index: u64) -> Seed {
    seed.child(16 + index)
}

/// The policy that acts during training, with exploration.
pub(crate) trait BehaviorPolicy: Sync {
    /// Returns the policy network.
    fn network(&self) -> &Mlp<f32>;

    /// Returns the number of control steps for which a row repeats its exploration noise.
    fn noise_hold(&self) -> u64;

    /// Returns the decay of the exploration noise, if any.
    fn noise_decay(&self) -> Option<ExplorationDecay> {
        None
    }

    /// Samples the action of row `row` of `rows` from the network outputs and standard normal
    /// noise.
    fn sample_action(&self, row: usize, rows: usize, outputs: &[f32], noise: &[f64], action: &mut [f32]);

    /// Returns the current policy with a history of `length`, for observations with these moments.
    ///
    /// # Errors
    /// If a weight is NaN or infinite.
    fn policy(&self, length: usize, mean: Vec<f64>, variance: Vec<f64>) -> Result<Policy, TrainingError>;
}

/// The networks of an off-policy algorithm and their update rule.
pub(crate) trait Agent: Sized + 'static {
    /// Settings of the algorithm.
    type Settings: HasOffPolicySettings;

    /// Policy that acts during training.
    type BehaviorPolicy: BehaviorPolicy;

    /// Creates the initial networks.
    ///
    /// # Errors
    /// If networks of these sizes cannot be created.
    fn new(sizes: Sizes, settings: &Self::Settings, seed: Seed) -> Result<Self, TrainingError>;

    /// Returns the current behavior policy.
    fn behavior_policy(&self) -> &Self::BehaviorPolicy;

    /// Replaces the policy by that of a controller with a network of the same form.
    ///
    /// # Errors
    /// If its actions have another distribution.
    fn start_from(&mut self, policy: &Policy) -> Result<(), TrainingError>;

    /// Performs an update from a batch. `seed` and the number `index` of the update determine its
    /// random numbers. If `learns_policy` is false, only the critics learn.
    ///
    /// # Errors
    /// If a loss is NaN or infinite; returns its name.
    fn update(
        &mut self,
        batch: &TransitionBatch<f32>,
        seed: Seed,
        index: u64,
        learns_policy: bool,
    ) -> Result<(), &'static str>;

    /// Returns the entropy of the policy in the last update; `None` for deterministic policies.
    fn entropy(&self) -> Option<f64> {
        None
    }

    /// Saves networks and optimizers to a checkpoint.
    fn save(&self, checkpoint: &mut Checkpoint);

    /// Restores networks and optimizers from a checkpoint.
    ///
    /// # Errors
    /// If the checkpoint contains networks of other sizes.
    fn load(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainingError>;
}

/// Settings of an off-policy algorithm.
pub(crate) trait HasOffPolicySettings {
    /// Returns the settings that all off-policy algorithms share.
    fn shared(&self) -> OffPolicySettings<'_>;
}
