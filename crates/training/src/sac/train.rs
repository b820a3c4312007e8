use std::sync::Arc;

use mishandle_controllers::Policy;
use mishandle_network::{Adam, ChunkPool, Mlp};
use mishandle_rollout::{Environment, Seed};

use super::config::SacConfig;
use super::loss::{CriticLoss, CriticScratch, PolicyLoss, PolicyScratch, temperature_loss};
use crate::action_value::Followed;
use crate::gaussian::Deviations;
use crate::initialization::initial_network;
use crate::learner::{Learner, Trainable};
use crate::off_policy::{Agent, LEARNING_ROWS, OffPolicy, Setup, draw_rows, finite, sizes_of, weights};
use crate::replay::Batch;
use crate::squashed::Drawn;
use crate::{Checkpoint, Initialization, TrainingError};

impl Trainable for SacConfig {
    fn learner(&self, environment: Arc<dyn Environment>, seed: Seed) -> Result<impl Learner, TrainingError> {
        let agent = Sac::new(sizes_of(environment.as_ref()), self, seed)?;
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

pub(crate) struct Sac {
    tau: f64,
    hold: u64,
    /// H̄
    pub target_entropy: f64,
    pub actor: Mlp<f32>,
    actor_adam: Adam<f32>,
    pub critics: [Followed; 2],
    /// log α, alone in a vector for its optimiser.
    pub log_temperature: [f64; 1],
    temperature_adam: Adam<f64>,
    /// Of the last update.
    entropy: f64,
    /// z of the actions behind the returns, and of those that the policy learns from.
    draws: [Vec<f64>; 2],
    critic_pool: ChunkPool<f32, CriticScratch<f32>>,
    policy_pool: ChunkPool<f32, PolicyScratch<f32>>,
    /// The gradient of both critics, and the loss.
    by_critics: Vec<f32>,
    /// The gradient of the actor, the mean of log π, and the loss.
    by_actor: Vec<f32>,
}

impl Sac {
    pub fn new(sizes: (usize, usize), config: &SacConfig, seed: Seed) -> Result<Sac, TrainingError> {
        let policy = &config.policy;
        // A small last layer: the first actions are near the middle, with h near 0, whatever is seen.
        let actor = initial_network(
            (sizes.0, &policy.hidden, 2 * sizes.1),
            policy.activation,
            Initialization::Orthogonal,
            0.01,
            weights(seed, 0),
        )?;
        let critics = [
            Followed::critic(sizes, &config.critic, weights(seed, 1))?,
            Followed::critic(sizes, &config.critic, weights(seed, 2))?,
        ];
        Ok(Sac {
            tau: config.tau,
            hold: config.exploration_hold,
            target_entropy: Deviations::new(&vec![config.target_std.ln() as f32; sizes.1]).entropy(),
            actor_adam: Adam::new(actor.parameter_count(), policy.learning_rate),
            log_temperature: [config.initial_temperature.ln()],
            temperature_adam: Adam::new(1, config.temperature_learning_rate),
            entropy: 0.0,
            draws: [0, 1].map(|_| vec![0.0; config.replay.batch_rows * sizes.1]),
            critic_pool: ChunkPool::new(LEARNING_ROWS),
            policy_pool: ChunkPool::new(LEARNING_ROWS),
            by_critics: vec![0.0; 2 * critics[0].network.parameter_count() + 1],
            by_actor: vec![0.0; actor.parameter_count() + 2],
            actor,
            critics,
        })
    }

    /// One step of all networks and of the temperature, with z of both kinds; gives the losses of critics and policy.
    ///
    /// # Errors
    /// What is not finite.
    pub fn learn(&mut self, batch: &Batch<f32>, draws: &[Vec<f64>; 2]) -> Result<[f32; 2], &'static str> {
        let Sac { actor, critics, by_critics, by_actor, .. } = self;
        let temperature = self.log_temperature[0].exp();
        let loss = CriticLoss {
            batch,
            draws: &draws[0],
            temperature,
            actor,
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

        let loss = PolicyLoss {
            batch,
            draws: &draws[1],
            temperature,
            actor,
            critics: [&critics[0].network, &critics[1].network],
        };
        self.policy_pool.sum(batch.rows(), by_actor, |rows, scratch, sums| {
            let (gradient, riders) = sums.split_at_mut(actor.parameter_count());
            let (loss, mean_log_prob) = loss.add_gradient(rows, scratch, gradient);
            riders[0] += mean_log_prob as f32;
            riders[1] += loss as f32;
        });
        let (numbers, policy_loss) = finite(by_actor, "the policy's loss")?;
        let (mean_log_prob, gradient) = numbers.split_last().expect("the mean of log π is there");
        actor.update(|parameters| self.actor_adam.step(parameters, gradient));

        let mean_log_prob = f64::from(*mean_log_prob);
        let (_, slope) = temperature_loss(self.log_temperature[0], mean_log_prob, self.target_entropy);
        self.temperature_adam.step(&mut self.log_temperature, &[slope]);
        self.entropy = -mean_log_prob;
        critics.iter_mut().for_each(|critic| critic.follow(self.tau));
        Ok([critic_loss, policy_loss])
    }
}

impl Agent for Sac {
    fn actor(&self) -> &Mlp<f32> {
        &self.actor
    }

    fn hold(&self) -> u64 {
        self.hold
    }

    fn explore(&self, _row: usize, _rows: usize, outputs: &[f32], draws: &[f64], action: &mut [f32]) {
        let (means, raw) = outputs.split_at(action.len());
        for (((action, mean), raw), z) in action.iter_mut().zip(means).zip(raw).zip(draws) {
            *action = Drawn::new(f64::from(*mean), f64::from(*raw), *z).action as f32;
        }
    }

    fn update(&mut self, batch: &Batch<f32>, seed: Seed, index: u64) -> Result<(), &'static str> {
        let mut draws = std::mem::take(&mut self.draws);
        for (draws, child) in draws.iter_mut().zip(0..) {
            draw_rows(seed.child(child), index, batch.rows(), draws);
        }
        let told = self.learn(batch, &draws);
        self.draws = draws;
        told.map(|_| ())
    }

    fn policy(&self, mean: Vec<f64>, variance: Vec<f64>) -> Result<Policy, TrainingError> {
        Ok(Policy::squashed(mean, variance, self.actor.clone())?)
    }

    fn entropy(&self) -> Option<f64> {
        Some(self.entropy)
    }

    fn save(&self, checkpoint: &mut Checkpoint) {
        checkpoint.put("policy.parameters", self.actor.parameters().to_vec());
        checkpoint.put_adam("policy.adam", &self.actor_adam);
        self.critics[0].save("critic_1", checkpoint);
        self.critics[1].save("critic_2", checkpoint);
        let adam = &self.temperature_adam;
        let (first, second) = (adam.first_moments()[0], adam.second_moments()[0]);
        checkpoint.put("temperature", vec![self.log_temperature[0], first, second, self.entropy]);
        checkpoint.put("temperature.steps", vec![adam.steps()]);
    }

    fn load(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainingError> {
        let count = self.actor.parameter_count();
        let own = checkpoint.f32s("policy.parameters", count)?;
        self.actor.update(|parameters| parameters.copy_from_slice(own));
        self.actor_adam = checkpoint.adam("policy.adam", count)?;
        self.critics[0].load("critic_1", checkpoint)?;
        self.critics[1].load("critic_2", checkpoint)?;
        let temperature = checkpoint.f64s("temperature", 4)?;
        let steps = checkpoint.u64s("temperature.steps", 1)?[0];
        let (rate, first, second) =
            (self.temperature_adam.learning_rate, vec![temperature[1]], vec![temperature[2]]);
        self.temperature_adam = Adam::resume(rate, first, second, steps)?;
        self.log_temperature = [temperature[0]];
        self.entropy = temperature[3];
        Ok(())
    }
}
