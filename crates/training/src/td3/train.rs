use std::sync::Arc;

use mishandle_controllers::Policy;
use mishandle_network::{ChunkPool, Mlp};
use mishandle_rollout::{Environment, Seed};

use super::config::Td3Config;
use super::loss::{CriticLoss, CriticScratch, Smoothing};
use crate::action_value::Followed;
use crate::deterministic::{self, Exploration, PolicyLoss, PolicyScratch};
use crate::learner::{Learner, Trainable};
use crate::off_policy::{Agent, LEARNING_ROWS, OffPolicy, Setup, draw_rows, finite, sizes_of, weights};
use crate::replay::Batch;
use crate::{Checkpoint, TrainingError};

impl Trainable for Td3Config {
    fn learner(&self, environment: Arc<dyn Environment>, seed: Seed) -> Result<impl Learner, TrainingError> {
        let agent = Td3::new(sizes_of(environment.as_ref()), self, seed)?;
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

pub(crate) struct Td3 {
    tau: f64,
    exploration: Exploration,
    hold: u64,
    pub actor: Followed,
    pub critics: [Followed; 2],
    smoothing: Smoothing,
    policy_delay: u64,
    draws: Vec<f64>,
    critic_pool: ChunkPool<f32, CriticScratch<f32>>,
    policy_pool: ChunkPool<f32, PolicyScratch<f32>>,
    /// The gradient of all networks with one loss, and the loss.
    by_critics: Vec<f32>,
    by_actor: Vec<f32>,
}

impl Td3 {
    pub fn new(sizes: (usize, usize), config: &Td3Config, seed: Seed) -> Result<Td3, TrainingError> {
        let actor = deterministic::actor(sizes, &config.policy, weights(seed, 0))?;
        let critics = [
            Followed::critic(sizes, &config.critic, weights(seed, 1))?,
            Followed::critic(sizes, &config.critic, weights(seed, 2))?,
        ];
        Ok(Td3 {
            tau: config.tau,
            exploration: Exploration(config.exploration_std),
            hold: config.exploration_hold,
            smoothing: Smoothing { std: config.smoothing_std, clip: config.smoothing_clip },
            policy_delay: config.policy_delay,
            draws: vec![0.0; config.replay.batch_rows * sizes.1],
            critic_pool: ChunkPool::new(LEARNING_ROWS),
            policy_pool: ChunkPool::new(LEARNING_ROWS),
            by_critics: vec![0.0; 2 * critics[0].network.parameter_count() + 1],
            by_actor: vec![0.0; actor.network.parameter_count() + 1],
            actor,
            critics,
        })
    }

    /// The update numbered `index`, with z of the smoothing; gives the losses of critics and policy, if it had its turn.
    ///
    /// # Errors
    /// What is not finite.
    pub fn learn(
        &mut self,
        batch: &Batch<f32>,
        draws: &[f64],
        index: u64,
    ) -> Result<(f32, Option<f32>), &'static str> {
        let Td3 { actor, critics, by_critics, by_actor, .. } = self;
        let loss = CriticLoss {
            batch,
            draws,
            smoothing: self.smoothing,
            target_actor: &actor.target,
            critics: [&critics[0].network, &critics[1].network],
            target_critics: [&critics[0].target, &critics[1].target],
        };
        self.critic_pool.sum(batch.rows(), by_critics, |rows, scratch, sums| {
            let (loss_sum, gradient) = sums.split_last_mut().expect("the loss is the last");
            *loss_sum += loss.add_gradient(rows, scratch, gradient) as f32;
        });
        let (gradient, critic_loss) = finite(by_critics, "the critics' loss")?;
        let parts = gradient.chunks_exact(critics[0].network.parameter_count());
        critics.iter_mut().zip(parts).for_each(|(critic, gradient)| critic.step(gradient));
        if !(index + 1).is_multiple_of(self.policy_delay) {
            return Ok((critic_loss, None));
        }

        let loss = PolicyLoss { batch, actor: &actor.network, critic: &critics[0].network };
        self.policy_pool.sum(batch.rows(), by_actor, |rows, scratch, sums| {
            let (loss_sum, gradient) = sums.split_last_mut().expect("the loss is the last");
            *loss_sum += loss.add_gradient(rows, scratch, gradient) as f32;
        });
        let (gradient, policy_loss) = finite(by_actor, "the policy's loss")?;
        actor.step(gradient);

        critics.iter_mut().for_each(|critic| critic.follow(self.tau));
        actor.follow(self.tau);
        Ok((critic_loss, Some(policy_loss)))
    }
}

impl Agent for Td3 {
    fn actor(&self) -> &Mlp<f32> {
        &self.actor.network
    }

    fn hold(&self) -> u64 {
        self.hold
    }

    fn explore(&self, row: usize, rows: usize, outputs: &[f32], draws: &[f64], action: &mut [f32]) {
        self.exploration.explore(row, rows, outputs, draws, action);
    }

    fn update(&mut self, batch: &Batch<f32>, seed: Seed, index: u64) -> Result<(), &'static str> {
        let mut draws = std::mem::take(&mut self.draws);
        draw_rows(seed, index, batch.rows(), &mut draws);
        let told = self.learn(batch, &draws, index);
        self.draws = draws;
        told.map(|_| ())
    }

    fn policy(&self, mean: Vec<f64>, variance: Vec<f64>) -> Result<Policy, TrainingError> {
        self.exploration.policy(&self.actor.network, mean, variance)
    }

    fn save(&self, checkpoint: &mut Checkpoint) {
        self.actor.save("policy", checkpoint);
        self.critics[0].save("critic_1", checkpoint);
        self.critics[1].save("critic_2", checkpoint);
    }

    fn load(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainingError> {
        self.actor.load("policy", checkpoint)?;
        self.critics[0].load("critic_1", checkpoint)?;
        self.critics[1].load("critic_2", checkpoint)
    }
}
