use std::sync::Arc;

use mishandle_controllers::Policy;
use mishandle_network::{ChunkPool, Mlp};
use mishandle_rollout::{Environment, Seed};

use super::config::DdpgConfig;
use super::loss::{CriticLoss, CriticScratch};
use crate::action_value::Followed;
use crate::deterministic::{self, Exploration, PolicyLoss, PolicyScratch};
use crate::learner::{Learner, Trainable};
use crate::off_policy::{Agent, LEARNING_ROWS, OffPolicy, Setup, finite, sizes_of, weights};
use crate::replay::Batch;
use crate::{Checkpoint, TrainingError};

impl Trainable for DdpgConfig {
    fn learner(&self, environment: Arc<dyn Environment>, seed: Seed) -> Result<impl Learner, TrainingError> {
        let agent = Ddpg::new(sizes_of(environment.as_ref()), self, seed)?;
        let setup = Setup {
            gamma: self.gamma,
            steps_per_iteration: self.steps_per_iteration,
            episodes: &self.episodes,
            replay: &self.replay,
            policy: &self.policy,
        };
        Ok(OffPolicy::new(environment, setup, seed, agent))
    }
}

pub(crate) struct Ddpg {
    tau: f64,
    exploration: Exploration,
    hold: u64,
    pub actor: Followed,
    pub critic: Followed,
    critic_pool: ChunkPool<f32, CriticScratch<f32>>,
    policy_pool: ChunkPool<f32, PolicyScratch<f32>>,
    /// The gradient of a network, and the loss.
    by_critic: Vec<f32>,
    by_actor: Vec<f32>,
}

impl Ddpg {
    pub fn new(sizes: (usize, usize), config: &DdpgConfig, seed: Seed) -> Result<Ddpg, TrainingError> {
        let actor = deterministic::actor(sizes, &config.policy, weights(seed, 0))?;
        let critic = Followed::critic(sizes, &config.critic, weights(seed, 1))?;
        Ok(Ddpg {
            tau: config.tau,
            exploration: Exploration(config.exploration_std),
            hold: config.exploration_hold,
            critic_pool: ChunkPool::new(LEARNING_ROWS),
            policy_pool: ChunkPool::new(LEARNING_ROWS),
            by_critic: vec![0.0; critic.network.parameter_count() + 1],
            by_actor: vec![0.0; actor.network.parameter_count() + 1],
            actor,
            critic,
        })
    }

    /// One step of both networks; gives the losses of critic and policy.
    ///
    /// # Errors
    /// What is not finite.
    pub fn learn(&mut self, batch: &Batch<f32>) -> Result<[f32; 2], &'static str> {
        let Ddpg { actor, critic, by_critic, by_actor, .. } = self;
        let loss = CriticLoss {
            batch,
            target_actor: &actor.target,
            critic: &critic.network,
            target_critic: &critic.target,
        };
        self.critic_pool.sum(batch.rows(), by_critic, |rows, scratch, sums| {
            let (loss_sum, gradient) = sums.split_last_mut().expect("the loss is the last");
            *loss_sum += loss.add_gradient(rows, scratch, gradient) as f32;
        });
        let (gradient, critic_loss) = finite(by_critic, "the critic's loss")?;
        critic.step(gradient);

        let loss = PolicyLoss { batch, actor: &actor.network, critic: &critic.network };
        self.policy_pool.sum(batch.rows(), by_actor, |rows, scratch, sums| {
            let (loss_sum, gradient) = sums.split_last_mut().expect("the loss is the last");
            *loss_sum += loss.add_gradient(rows, scratch, gradient) as f32;
        });
        let (gradient, policy_loss) = finite(by_actor, "the policy's loss")?;
        actor.step(gradient);

        critic.follow(self.tau);
        actor.follow(self.tau);
        Ok([critic_loss, policy_loss])
    }
}

impl Agent for Ddpg {
    fn actor(&self) -> &Mlp<f32> {
        &self.actor.network
    }

    fn hold(&self) -> u64 {
        self.hold
    }

    fn explore(&self, row: usize, rows: usize, outputs: &[f32], draws: &[f64], action: &mut [f32]) {
        self.exploration.explore(row, rows, outputs, draws, action);
    }

    fn update(&mut self, batch: &Batch<f32>, _seed: Seed, _index: u64) -> Result<(), &'static str> {
        self.learn(batch).map(|_| ())
    }

    fn policy(&self, mean: Vec<f64>, variance: Vec<f64>) -> Result<Policy, TrainingError> {
        self.exploration.policy(&self.actor.network, mean, variance)
    }

    fn save(&self, checkpoint: &mut Checkpoint) {
        self.actor.save("policy", checkpoint);
        self.critic.save("critic", checkpoint);
    }

    fn load(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainingError> {
        self.actor.load("policy", checkpoint)?;
        self.critic.load("critic", checkpoint)
    }
}
