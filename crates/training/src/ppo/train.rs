use std::sync::Arc;
use std::time::Instant;

use mishandle_controllers::Policy;
use mishandle_network::{Adam, CHUNK_ROWS, ChunkPool, Mlp, Normalizer, clip_norm};
use mishandle_rollout::{Environment, Seed};

use super::config::{PpoConfig, Schedule};
use super::loss::{Minibatch, RIDERS, Scratch};
use crate::gaussian::Deviations;
use crate::learner::{Learner, Trainable, iterations, progress_of};
use crate::on_policy::{OnPolicy, Setup, mean_and_scale};
use crate::{Checkpoint, Progress, Shares, TrainingError, shuffle};

/// The adaptive schedule keeps the step length within these.
const LEARNING_RATES: (f64, f64) = (1e-5, 1e-2);

/// Factor by which the adaptive schedule changes it.
const LEARNING_RATE_FACTOR: f64 = 1.5;

/// The child of the training's seed that shuffles minibatches; the others are those of [`OnPolicy`].
const MINIBATCHES: u64 = 3;

impl Trainable for PpoConfig {
    fn learner(&self, environment: Arc<dyn Environment>, seed: Seed) -> Result<impl Learner, TrainingError> {
        Ppo::new(environment, self, seed)
    }
}

struct Ppo<'a> {
    config: &'a PpoConfig,
    seed: Seed,
    common: OnPolicy,
    network_adam: Adam<f32>,
    log_std_adam: Adam<f32>,
    iteration: u64,
    pool: ChunkPool<f32, Scratch>,
    gradient: Vec<f32>,
    order: Vec<u32>,
}

impl<'a> Ppo<'a> {
    fn new(
        environment: Arc<dyn Environment>,
        config: &'a PpoConfig,
        seed: Seed,
    ) -> Result<Ppo<'a>, TrainingError> {
        let setup = Setup {
            rollout_steps: config.rollout_steps,
            gamma: config.gamma,
            gae_lambda: config.gae_lambda,
            episodes: &config.episodes,
            policy: &config.policy,
            critic: &config.critic,
        };
        let common = OnPolicy::new(environment, &setup, seed)?;
        let (weights, actions) = (common.network.parameter_count(), common.log_std.len());
        let gradient = weights + actions + common.critic.network().parameter_count() + RIDERS;
        Ok(Ppo {
            config,
            seed,
            network_adam: Adam::new(weights, config.learning_rate),
            log_std_adam: Adam::new(actions, config.learning_rate),
            iteration: 0,
            pool: ChunkPool::new(CHUNK_ROWS),
            gradient: vec![0.0; gradient],
            order: vec![0; common.buffer.count()],
            common,
        })
    }

    /// All epochs; gives the mean divergence in the last.
    fn learn(&mut self, normalizer: &Normalizer<f32>) -> Result<f64, TrainingError> {
        let config = self.config;
        if config.learning_rate_schedule == Schedule::Linear {
            let all = iterations(&config.run, self.iteration_steps());
            let left = 1.0 - self.iteration as f64 / all as f64;
            self.set_learning_rate(left * config.learning_rate);
            self.common.critic.set_learning_rate(left * config.critic.learning_rate);
        }
        let mut kl = 0.0;
        for epoch in 0..config.epochs as u64 {
            let index = self.iteration * config.epochs as u64 + epoch;
            shuffle(self.seed.child(MINIBATCHES), index, &mut self.order);
            let rows = self.order.len();
            kl = 0.0;
            for first in (0..rows).step_by(config.minibatch_rows) {
                let end = rows.min(first + config.minibatch_rows);
                kl += self.learn_minibatch(normalizer, first..end)? * (end - first) as f64 / rows as f64;
            }
            if config.learning_rate_schedule == Schedule::Adaptive {
                self.set_learning_rate(adapted(self.network_adam.learning_rate, kl, config.target_kl));
            }
        }
        Ok(kl)
    }

    fn set_learning_rate(&mut self, learning_rate: f64) {
        self.network_adam.learning_rate = learning_rate;
        self.log_std_adam.learning_rate = learning_rate;
    }

    /// One step of both optimisers; gives the mean divergence before it.
    fn learn_minibatch(
        &mut self,
        normalizer: &Normalizer<f32>,
        rows: std::ops::Range<usize>,
    ) -> Result<f64, TrainingError> {
        let Ppo { common, pool, gradient, order, .. } = self;
        let order = &order[rows];
        let (advantage_mean, advantage_scale) = mean_and_scale(&common.buffer.advantages, order);
        let deviations = Deviations::new(&common.log_std);
        let minibatch = Minibatch {
            buffer: &common.buffer,
            targets: &common.targets,
            order,
            advantage_mean,
            advantage_scale,
            normalizer,
            policy: &common.network,
            deviations: &deviations,
            critic: common.critic.network(),
            clip_epsilon: self.config.clip_epsilon,
            entropy_coef: self.config.entropy_coef,
        };
        pool.sum(order.len(), gradient, |rows, scratch, gradient| {
            minibatch.add_gradient(rows, scratch, gradient);
        });
        let (by_policy, rest) =
            gradient.split_at_mut(common.network.parameter_count() + common.log_std.len());
        let (by_critic, riders) = rest.split_at_mut(rest.len() - RIDERS);
        for (what, number) in [("the policy's divergence", riders[0]), ("the critic's loss", riders[1])] {
            if !number.is_finite() {
                return Err(TrainingError::NotFinite { iteration: self.iteration + 1, what });
            }
        }
        clip_norm(by_policy, self.config.max_grad_norm);
        clip_norm(by_critic, self.config.max_grad_norm);
        let (by_network, by_log_std) = by_policy.split_at(common.network.parameter_count());
        let adam = &mut self.network_adam;
        common.network.update(|parameters| adam.step(parameters, by_network));
        self.log_std_adam.step(&mut common.log_std, by_log_std);
        common.limit_log_std();
        common.critic.step(by_critic);
        Ok(f64::from(riders[0]))
    }
}

impl Learner for Ppo<'_> {
    fn iteration(&self) -> u64 {
        self.iteration
    }

    fn iteration_steps(&self) -> u64 {
        self.common.rollout_size()
    }

    fn iterate(&mut self) -> Result<Progress, TrainingError> {
        let start = Instant::now();
        let normalizer = self.common.normalizer();
        let acted = self.common.roll_out(&normalizer);
        self.common.estimate(&normalizer);
        let kl = self.learn(&normalizer)?;
        self.common.follow_observations();
        self.iteration += 1;
        Ok(Progress {
            kl: Some(kl),
            entropy: Some(Deviations::new(&self.common.log_std).entropy()),
            learning_rate: self.network_adam.learning_rate,
            shares: Shares::new(acted.physics, acted.total, start.elapsed().as_secs_f64()),
            ..progress_of(&self.common.episodes.take_statistics())
        })
    }

    fn policy(&self) -> Result<Policy, TrainingError> {
        self.common.policy()
    }

    fn network(&self) -> &Mlp<f32> {
        &self.common.network
    }

    fn identity(&self) -> String {
        self.common.episodes.identity()
    }

    fn save(&self, checkpoint: &mut Checkpoint) {
        checkpoint.put("iteration", vec![self.iteration]);
        checkpoint.put_adam("policy.adam", &self.network_adam);
        checkpoint.put_adam("policy.log_std_adam", &self.log_std_adam);
        self.common.save(checkpoint);
    }

    fn load(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainingError> {
        self.iteration = checkpoint.u64s("iteration", 1)?[0];
        self.network_adam = checkpoint.adam("policy.adam", self.common.network.parameter_count())?;
        self.log_std_adam = checkpoint.adam("policy.log_std_adam", self.common.log_std.len())?;
        self.common.load(checkpoint)
    }
}

/// The step length after an epoch with the divergence `kl`.
fn adapted(learning_rate: f64, kl: f64, target_kl: f64) -> f64 {
    let (low, high) = LEARNING_RATES;
    if kl > 2.0 * target_kl {
        (learning_rate / LEARNING_RATE_FACTOR).max(low)
    } else if kl < 0.5 * target_kl {
        (learning_rate * LEARNING_RATE_FACTOR).min(high)
    } else {
        learning_rate
    }
}
