use mishandle_controllers::Policy;
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
    /// Updates both networks, or the critic only; returns the losses of critic and policy.
    ///
    /// # Errors
    /// If a loss is NaN or infinite; returns its name.
    pub fn train_batch(
        &mut self,
        batch: &TransitionBatch<f32>,
        learns_policy: bool,
    ) -> Result<(f32, Option<f32>), &'static str> {
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
        if !learns_policy {
            critic.soft_update(self.tau);
            return Ok((critic_loss, None));
        }

        let loss = PolicyLoss { batch, actor: &actor.network, critic: &critic.network };
        let (gradient, policy_loss) = actor_gradient
            .compute(batch.rows(), |rows, scratch, gradient| loss.add_gradient(rows, scratch, gradient))?;
        actor.step(gradient);

        critic.soft_update(self.tau);
        actor.soft_update(self.tau);
        Ok((critic_loss, Some(policy_loss)))
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

    fn start_from(&mut self, policy: &Policy) -> Result<(), TrainingError> {
        self.actor.start_from(policy);
        Ok(())
    }

    fn update(
        &mut self,
        batch: &TransitionBatch<f32>,
        _seed: Seed,
        _index: u64,
        learns_policy: bool,
    ) -> Result<(), &'static str> {
        self.train_batch(batch, learns_policy).map(|_| ())
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
