use mishandle_rollout::Seed;

use super::config::DdpgConfig;
use super::loss::{CriticLoss, CriticScratch};
use crate::action_value::Followed;
use crate::agent::{Agent, weights};
use crate::batch::Batch;
use crate::batch_gradient::BatchGradient;
use crate::deterministic::{DeterministicActor, PolicyLoss, PolicyScratch};
use crate::{Checkpoint, TrainingError};

pub(crate) struct Ddpg {
    tau: f64,
    pub actor: DeterministicActor,
    pub critic: Followed,
    pub by_critic: BatchGradient<CriticScratch<f32>>,
    pub by_actor: BatchGradient<PolicyScratch<f32>>,
}

impl Ddpg {
    /// One step of both networks; gives the losses of critic and policy.
    ///
    /// # Errors
    /// What is not finite.
    pub fn learn(&mut self, batch: &Batch<f32>) -> Result<[f32; 2], &'static str> {
        let Ddpg { actor: DeterministicActor { followed: actor, .. }, critic, by_critic, by_actor, .. } =
            self;
        let loss = CriticLoss {
            batch,
            target_actor: &actor.target,
            critic: &critic.network,
            target_critic: &critic.target,
        };
        let (gradient, critic_loss) = by_critic
            .of(batch.rows(), |rows, scratch, gradient| loss.add_gradient(rows, scratch, gradient))?;
        critic.step(gradient);

        let loss = PolicyLoss { batch, actor: &actor.network, critic: &critic.network };
        let (gradient, policy_loss) = by_actor
            .of(batch.rows(), |rows, scratch, gradient| loss.add_gradient(rows, scratch, gradient))?;
        actor.step(gradient);

        critic.follow(self.tau);
        actor.follow(self.tau);
        Ok([critic_loss, policy_loss])
    }
}

impl Agent for Ddpg {
    type Config = DdpgConfig;
    type Explorer = DeterministicActor;

    fn new(sizes: (usize, usize), config: &DdpgConfig, seed: Seed) -> Result<Ddpg, TrainingError> {
        let actor = DeterministicActor::new(sizes, &config.policy, config.exploration(), weights(seed, 0))?;
        let critic = Followed::critic(sizes, &config.critic, weights(seed, 1))?;
        Ok(Ddpg {
            tau: config.tau,
            by_critic: BatchGradient::new("the critic's loss", critic.network.parameter_count()),
            by_actor: BatchGradient::new("the policy's loss", actor.followed.network.parameter_count()),
            actor,
            critic,
        })
    }

    fn explorer(&self) -> &DeterministicActor {
        &self.actor
    }

    fn update(&mut self, batch: &Batch<f32>, _seed: Seed, _index: u64) -> Result<(), &'static str> {
        self.learn(batch).map(|_| ())
    }

    fn save(&self, checkpoint: &mut Checkpoint) {
        self.actor.followed.save("policy", checkpoint);
        self.critic.save("critic", checkpoint);
    }

    fn load(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainingError> {
        self.actor.followed.load("policy", checkpoint)?;
        self.critic.load("critic", checkpoint)
    }
}
