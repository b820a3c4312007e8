//! On-policy algorithms: each iteration collects a rollout and updates policy and critic from it.

mod actor_critic;
pub(crate) mod critic;
pub mod gae;
pub(crate) mod minibatches;
pub mod ppo;
pub(crate) mod rollout_buffer;
pub(crate) mod settings;
pub mod trpo;

use std::time::Instant;

use mishandle_controllers::Policy;
use mishandle_network::{Mlp, NetworkDevice, NetworkError};
use mishandle_rollout::{BatchFactory, Seed};

use crate::algorithm::{BuildLearner, CommonSettings};
use crate::gaussian::DiagonalGaussian;
use crate::learner::{Learner, progress_of};
use crate::{Checkpoint, TimeShares, TrainingError, TrainingProgress};
pub(crate) use actor_critic::{ActorCritic, mean_and_inverse_std};
use minibatches::Minibatches;
use settings::OnPolicySettings;

/// The update rule of an algorithm.
pub(crate) trait PolicyOptimizer: Sized + 'static {
    /// Settings of the algorithm.
    type Settings;

    /// Returns the settings that all on-policy algorithms share.
    fn shared(settings: &Self::Settings) -> OnPolicySettings<'_>;

    /// Creates the optimizer in its state before the first update.
    fn new(settings: &Self::Settings, actor_critic: &mut ActorCritic, minibatches: Minibatches) -> Self;

    /// Computes the networks' passes of the following updates on another device than the CPU. By
    /// default, it is not used.
    ///
    /// # Errors
    /// If the device is not available, or it cannot compute these networks.
    fn use_device(
        &mut self,
        _device: &dyn NetworkDevice,
        _actor_critic: &ActorCritic,
    ) -> Result<(), TrainingError> {
        Ok(())
    }

    /// Updates policy and critic from the collected rollout; `iteration` counts from 0.
    ///
    /// # Errors
    /// If a loss or gradient is NaN or infinite, or a device fails.
    fn update(
        &mut self,
        actor_critic: &mut ActorCritic,
        iteration: u64,
    ) -> Result<UpdateStatistics, UpdateError>;

    /// Saves the state besides policy and critic to a checkpoint; by default no state.
    fn save(&self, _checkpoint: &mut Checkpoint) {}

    /// Restores the state from a checkpoint.
    ///
    /// # Errors
    /// If the checkpoint contains arrays of other sizes.
    fn load(&mut self, _checkpoint: &Checkpoint) -> Result<(), TrainingError> {
        Ok(())
    }
}

/// Reason why a policy update fails.
#[derive(Debug)]
pub(crate) enum UpdateError {
    /// Name of a loss or gradient that is NaN or infinite.
    NotFinite(&'static str),
    /// Failure of a device that computes networks.
    Device(NetworkError),
}

impl From<&'static str> for UpdateError {
    fn from(what: &'static str) -> UpdateError {
        UpdateError::NotFinite(what)
    }
}

impl From<NetworkError> for UpdateError {
    fn from(error: NetworkError) -> UpdateError {
        UpdateError::Device(error)
    }
}

/// Statistics of one policy update.
pub(crate) struct UpdateStatistics {
    /// Mean KL divergence of the new policy from the old one.
    pub kl: f64,
    /// Learning rate of the policy, or the fraction of the full TRPO step that was accepted.
    pub learning_rate: f64,
}

/// An on-policy algorithm with the state of a training run.
pub(crate) struct OnPolicy<A> {
    pub actor_critic: ActorCritic,
    pub optimizer: A,
    iteration: u64,
}

impl<A: PolicyOptimizer> BuildLearner for OnPolicy<A> {
    type Settings = A::Settings;

    fn common(settings: &A::Settings) -> CommonSettings<'_> {
        let OnPolicySettings { run, episodes, scenarios, rewards, .. } = A::shared(settings);
        CommonSettings { run, episodes, scenarios, rewards }
    }

    fn build(
        settings: &A::Settings,
        environments: &dyn BatchFactory,
        seed: Seed,
    ) -> Result<OnPolicy<A>, TrainingError> {
        let shared = A::shared(settings);
        let mut actor_critic = ActorCritic::new(environments, &shared, seed)?;
        let optimizer = A::new(settings, &mut actor_critic, shared.minibatches(seed));
        Ok(OnPolicy { actor_critic, optimizer, iteration: 0 })
    }
}

impl<A: PolicyOptimizer> Learner for OnPolicy<A> {
    fn use_device(&mut self, device: &dyn NetworkDevice) -> Result<(), TrainingError> {
        self.optimizer.use_device(device, &self.actor_critic)
    }

    fn start_from(&mut self, policy: &Policy) -> Result<(), TrainingError> {
        self.actor_critic.start_from(policy)
    }

    fn iteration(&self) -> u64 {
        self.iteration
    }

    fn iteration_steps(&self) -> u64 {
        self.actor_critic.rollout_size()
    }

    fn iterate(&mut self) -> Result<TrainingProgress, TrainingError> {
        let start = Instant::now();
        let OnPolicy { actor_critic, optimizer, iteration } = self;
        let normalizer = actor_critic.normalizer();
        let rollout_secs = actor_critic.collect_rollout(&normalizer)?;
        actor_critic.compute_advantages(&normalizer);
        let updated = optimizer.update(actor_critic, *iteration);
        *iteration += 1;
        let statistics = updated.map_err(|error| match error {
            UpdateError::NotFinite(what) => TrainingError::NotFinite { iteration: *iteration, what },
            UpdateError::Device(error) => TrainingError::Network(error),
        })?;
        actor_critic.update_normalizer_from_rollout();
        Ok(TrainingProgress {
            kl: Some(statistics.kl),
            entropy: Some(DiagonalGaussian::new(&actor_critic.log_std).entropy()),
            learning_rate: statistics.learning_rate,
            time_shares: TimeShares::new(
                rollout_secs.physics,
                rollout_secs.total,
                start.elapsed().as_secs_f64(),
            ),
            ..progress_of(&actor_critic.episodes.take_statistics())
        })
    }

    fn set_scenario_share(&mut self, share: f64) {
        self.actor_critic.episodes.set_scenario_share(share);
    }

    fn policy(&self) -> Result<Policy, TrainingError> {
        self.actor_critic.policy()
    }

    fn network(&self) -> &Mlp<f32> {
        &self.actor_critic.network
    }

    fn identity(&self) -> String {
        self.actor_critic.episodes.identity()
    }

    fn save(&mut self, checkpoint: &mut Checkpoint) -> Result<(), TrainingError> {
        checkpoint.put("iteration", vec![self.iteration]);
        self.optimizer.save(checkpoint);
        Ok(self.actor_critic.save(checkpoint)?)
    }

    fn load(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainingError> {
        self.iteration = checkpoint.u64s("iteration", 1)?[0];
        self.optimizer.load(checkpoint)?;
        self.actor_critic.load(checkpoint)
    }
}
