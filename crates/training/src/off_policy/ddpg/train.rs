use mishandle_rollout::Seed;

use super::loss::{CriticLoss, CriticScratch};
use super::settings::DdpgSettings;
use crate::off_policy::action_value::{NetworkWithTarget, Sizes};
use crate::off_policy::agent::{Agent, weight_seed};
use crate::off_policy::batch_gradient::BatchGradient;
use crate::off_policy::deterministic::{DeterministicActor, PolicyLoss, PolicyScratch};
use crate::off_policy::transitions::TransitionBatch;
use crate::{Checkpoint, TrainingError};

pub(crate) struct Ddpg {
    tau: f64,
    pub actor: DeterministicActor,
    pub critic: NetworkWithTarget,
    pub critic_gradient: BatchGradient<CriticScratch<f32>>,
    pub actor_gradient: BatchGradient<PolicyScratch<f32>>,
}

impl Ddpg {
    /// Updates both networks; returns the losses of critic and policy.
    ///
    /// # Errors
    /// If a loss is NaN or infinite; returns its name.
    pub fn train_batch(&mut self, batch: &TransitionBatch<f32>) -> Result<[f32; 2], &'static str> {
        let Ddpg {
            actor: DeterministicActor { policy: actor, .. },
            critic,
            critic_gradient,
            actor_gradient,
            ..
        } = self;
        let loss = CriticLoss {
            batch,
            target_actor: &actor.target,
            critic: &critic.network,
            target_critic: &critic.target,
        };
        let (gradient, critic_loss) = critic_gradient
            .compute(batch.rows(), |rows, scratch, gradient| loss.add_gradient(rows, scratch, gradient))?;
        critic.step(gradient);

        let loss = PolicyLoss { batch, actor: &actor.network, critic: &critic.network };
        let (gradient, policy_loss) = actor_gradient
            .compute(batch.rows(), |rows, scratch, gradient| loss.add_gradient(rows, scratch, gradient))?;
        actor.step(gradient);

        critic.soft_update(self.tau);
        actor.soft_update(self.tau);
        Ok([critic_loss, policy_loss])
    }
}

impl Agent for Ddpg {
    type Settings = DdpgSettings;
    type BehaviorPolicy = DeterministicActor;

    fn new(sizes: Sizes, settings: &DdpgSettings, seed: Seed) -> Result<Ddpg, TrainingError> {
        let actor =
            DeterministicActor::new(sizes, &settings.policy, settings.exploration(), weight_seed(seed, 0))?;
        let critic = NetworkWithTarget::critic(sizes, &settings.critic, weight_seed(seed, 1))?;
        Ok(Ddpg {
            tau: settings.tau,
            critic_gradient: BatchGradient::new("the critic's loss", critic.network.parameter_count()),
            actor_gradient: BatchGradient::new("the policy's loss", actor.policy.network.parameter_count()),
            actor,
            critic,
        })
    }

    fn behavior_policy(&self) -> &DeterministicActor {
        &self.actor
    }

    fn update(&mut self, batch: &TransitionBatch<f32>, _seed: Seed, _index: u64) -> Result<(), &'static str> {
        self.train_batch(batch).map(|_| ())
    }

    fn save(&self, checkpoint: &mut Checkpoint) {
        self.actor.policy.save("policy", checkpoint);
        self.critic.save("critic", checkpoint);
    }

    fn load(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainingError> {
        self.actor.policy.load("policy", checkpoint)?;
        self.critic.load("critic", checkpoint)
    }
}
