//! What on-policy algorithms share: a rollout, what is learned from it, and the next.

use std::time::Instant;

use mishandle_controllers::Policy;
use mishandle_network::Mlp;
use mishandle_rollout::{BatchFactory, EnvironmentSpec, Seed};

use crate::actor_critic::ActorCritic;
use crate::algorithm::{Common, FromSettings};
use crate::gaussian::Deviations;
use crate::learner::{Learner, progress_of};
use crate::minibatches::Minibatches;
use crate::on_policy_settings::Setup;
use crate::{Checkpoint, MemoryNeed, Progress, Shares, TrainingError};

/// What is particular to an algorithm.
pub(crate) trait Improver: Sized + 'static {
    /// Its settings.
    type Config;

    /// Those of them that it shares with the others.
    fn setup(config: &Self::Config) -> Setup<'_>;

    /// Before anything is learned.
    fn new(config: &Self::Config, actor_critic: &mut ActorCritic, minibatches: Minibatches) -> Self;

    /// Improves policy and critic by their rollout; `iteration` counts these.
    ///
    /// # Errors
    /// What is not finite.
    fn improve(
        &mut self,
        actor_critic: &mut ActorCritic,
        iteration: u64,
    ) -> Result<Improvement, &'static str>;

    /// Puts all that its future depends on into a checkpoint, besides policy and critic; by default there is nothing.
    fn save(&self, _checkpoint: &mut Checkpoint) {}

    /// Goes on where a checkpoint was taken.
    ///
    /// # Errors
    /// If the checkpoint holds numbers of other sizes.
    fn load(&mut self, _checkpoint: &Checkpoint) -> Result<(), TrainingError> {
        Ok(())
    }
}

/// What an iteration did to the policy.
pub(crate) struct Improvement {
    /// Mean divergence of the new policy from the old one.
    pub kl: f64,
    /// Step length of the policy's optimiser, or the share of the longest step that was taken.
    pub learning_rate: f64,
}

/// An on-policy algorithm at work.
pub(crate) struct OnPolicy<A> {
    pub actor_critic: ActorCritic,
    pub improver: A,
    iteration: u64,
}

impl<A: Improver> FromSettings for OnPolicy<A> {
    type Settings = A::Config;

    fn common(config: &A::Config) -> Common<'_> {
        let Setup { run, episodes, policy, critic, .. } = A::setup(config);
        Common { run, episodes, hidden: [&policy.hidden, &critic.hidden] }
    }

    /// A [`Buffer`](crate::Buffer): for each row what was seen and done, six f64 and a place in the order of minibatches.
    fn experience_memory(config: &A::Config, environment: &EnvironmentSpec) -> Vec<MemoryNeed> {
        let Setup { rollout_steps, episodes, .. } = A::setup(config);
        let columns = (environment.observation_size + environment.action_size) as f64;
        let row = 4.0 * columns + 6.0 * 8.0 + 4.0;
        let bytes = rollout_steps as f64 * episodes.environments as f64 * row;
        vec![MemoryNeed { settings: "rollout_steps and episodes.environments", bytes }]
    }

    fn start(
        config: &A::Config,
        environments: &dyn BatchFactory,
        seed: Seed,
    ) -> Result<OnPolicy<A>, TrainingError> {
        let setup = A::setup(config);
        let mut actor_critic = ActorCritic::new(environments, &setup, seed)?;
        let improver = A::new(config, &mut actor_critic, setup.minibatches(seed));
        Ok(OnPolicy { actor_critic, improver, iteration: 0 })
    }
}

impl<A: Improver> Learner for OnPolicy<A> {
    fn iteration(&self) -> u64 {
        self.iteration
    }

    fn iteration_steps(&self) -> u64 {
        self.actor_critic.rollout_size()
    }

    fn iterate(&mut self) -> Result<Progress, TrainingError> {
        let start = Instant::now();
        let OnPolicy { actor_critic, improver, iteration } = self;
        let normalizer = actor_critic.normalizer();
        let acted = actor_critic.roll_out(&normalizer)?;
        actor_critic.estimate(&normalizer);
        let improved = improver.improve(actor_critic, *iteration);
        *iteration += 1;
        let improvement =
            improved.map_err(|what| TrainingError::NotFinite { iteration: *iteration, what })?;
        actor_critic.follow_rollout();
        Ok(Progress {
            kl: Some(improvement.kl),
            entropy: Some(Deviations::new(&actor_critic.log_std).entropy()),
            learning_rate: improvement.learning_rate,
            shares: Shares::new(acted.physics, acted.total, start.elapsed().as_secs_f64()),
            ..progress_of(&actor_critic.episodes.take_statistics())
        })
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
        self.improver.save(checkpoint);
        Ok(self.actor_critic.save(checkpoint)?)
    }

    fn load(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainingError> {
        self.iteration = checkpoint.u64s("iteration", 1)?[0];
        self.improver.load(checkpoint)?;
        self.actor_critic.load(checkpoint)
    }
}
