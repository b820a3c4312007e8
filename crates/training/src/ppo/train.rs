use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

use mishandle_controllers::Policy;
use mishandle_network::{Adam, CHUNK_ROWS, ChunkPool, Mlp, clip_norm};
use mishandle_rollout::{Environment, Seed};

use super::config::{GradNorm, PpoConfig, Reduction, Schedule, Standardized};
use super::loss::{Minibatch, RIDERS, Scratch};
use crate::gaussian::Deviations;
use crate::learner::{Learner, Trainable, iterations, progress_of};
use crate::minibatches::Minibatches;
use crate::on_policy::{OnPolicy, Setup, mean_and_scale};
use crate::{Checkpoint, Progress, Shares, TrainingError};

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
    common: OnPolicy,
    network_adam: Adam<f32>,
    log_std_adam: Adam<f32>,
    iteration: u64,
    pool: ChunkPool<f32, Scratch>,
    gradient: Vec<f32>,
    minibatches: Minibatches,
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
        let mut common = OnPolicy::new(environment, &setup, seed)?;
        if config.shared_learning_rate {
            common.critic.set_learning_rate(config.learning_rate);
        }
        let (weights, actions) = (common.network.parameter_count(), common.log_std.len());
        let gradient = weights + actions + common.critic.network().parameter_count() + RIDERS.len();
        Ok(Ppo {
            config,
            network_adam: Adam::new(weights, config.learning_rate),
            log_std_adam: Adam::new(actions, config.learning_rate),
            iteration: 0,
            pool: ChunkPool::new(CHUNK_ROWS),
            gradient: vec![0.0; gradient],
            minibatches: Minibatches::new(
                config.minibatches,
                common.buffer.count(),
                config.minibatch_rows,
                config.slices,
                seed.child(MINIBATCHES),
            ),
            common,
        })
    }

    /// All epochs; gives the mean divergence in the last.
    fn learn(&mut self) -> Result<f64, TrainingError> {
        let config = self.config;
        if config.learning_rate_schedule == Schedule::Linear {
            let all = iterations(&config.run, self.iteration_steps());
            let left = 1.0 - self.iteration as f64 / all as f64;
            self.common.critic.set_learning_rate(left * config.critic.learning_rate);
            self.set_learning_rate(left * config.learning_rate);
        }
        let advantages = &self.common.buffer.advantages;
        let over_all =
            (config.advantages == Standardized::Rollout).then(|| mean_and_scale(advantages.iter().copied()));
        let mut kl = 0.0;
        for epoch in 0..config.epochs as u64 {
            self.minibatches.begin_epoch(self.iteration * config.epochs as u64 + epoch);
            kl = self.learn_epoch(epoch == 0, over_all)?;
            if config.learning_rate_schedule == Schedule::Adaptive {
                self.set_learning_rate(adapted(self.network_adam.learning_rate, kl, config));
            }
        }
        Ok(kl)
    }

    fn set_learning_rate(&mut self, learning_rate: f64) {
        self.network_adam.learning_rate = learning_rate;
        self.log_std_adam.learning_rate = learning_rate;
        if self.config.shared_learning_rate {
            self.common.critic.set_learning_rate(learning_rate);
        }
    }

    /// One pass over the minibatches, which a divergence beyond the threshold ends; gives the mean divergence.
    fn learn_epoch(&mut self, first: bool, over_all: Option<(f64, f64)>) -> Result<f64, TrainingError> {
        let all = self.minibatches.order().len() as f64;
        let (mut kl, mut seen) = (0.0, 0);
        for rows in self.minibatches.ranges() {
            if first {
                self.common.follow_minibatch(&self.minibatches.order()[rows.clone()]);
            }
            let of_minibatch = self.compute_gradient(rows.clone(), over_all)?;
            kl += of_minibatch * rows.len() as f64 / all;
            seen += rows.len();
            if self.config.kl_threshold.is_some_and(|threshold| of_minibatch > threshold) {
                break;
            }
            self.step();
        }
        Ok(kl * (all / seen as f64))
    }

    /// The gradient of the loss of the minibatch of these rows; gives its mean divergence.
    fn compute_gradient(
        &mut self,
        rows: Range<usize>,
        over_all: Option<(f64, f64)>,
    ) -> Result<f64, TrainingError> {
        let Ppo { config, common, pool, gradient, minibatches, .. } = self;
        let order = &minibatches.order()[rows];
        let advantages = &common.buffer.advantages;
        let (advantage_mean, advantage_scale) =
            over_all.unwrap_or_else(|| mean_and_scale(order.iter().map(|place| advantages[*place as usize])));
        let deviations = Deviations::new(&common.log_std);
        let minibatch = Minibatch {
            buffer: &common.buffer,
            targets: &common.targets,
            old_values: &common.old_values,
            order,
            advantage_mean,
            advantage_scale,
            normalizer: &common.normalizer(),
            policy: &common.network,
            deviations: &deviations,
            critic: common.critic.network(),
            clip_epsilon: config.clip_epsilon,
            entropy_slope: match config.entropy {
                Reduction::Sum => config.entropy_coef,
                Reduction::Mean => config.entropy_coef / common.log_std.len() as f64,
            },
            value_clip: config.value_clip,
            loss_scale: common.critic.loss_scale(),
        };
        pool.sum(order.len(), gradient, |rows, scratch, gradient| {
            minibatch.add_gradient(rows, scratch, gradient);
        });
        let riders = &gradient[gradient.len() - RIDERS.len()..];
        match RIDERS.iter().zip(riders).find(|(_, number)| !number.is_finite()) {
            Some((what, _)) => Err(TrainingError::NotFinite { iteration: self.iteration + 1, what }),
            None => Ok(f64::from(riders[0])),
        }
    }

    /// One step of all optimisers along the gradient.
    fn step(&mut self) {
        let Ppo { config, common, gradient, network_adam, log_std_adam, .. } = self;
        let weights = common.network.parameter_count();
        let policy = weights + common.log_std.len();
        let all = gradient.len() - RIDERS.len();
        match config.grad_norm {
            GradNorm::Separate => {
                clip_norm(&mut gradient[..policy], config.max_grad_norm);
                clip_norm(&mut gradient[policy..all], config.max_grad_norm);
            }
            GradNorm::Joint => {
                clip_norm(&mut gradient[..all], config.max_grad_norm);
            }
        }
        common.network.update(|parameters| network_adam.step(parameters, &gradient[..weights]));
        log_std_adam.step(&mut common.log_std, &gradient[weights..policy]);
        common.limit_log_std();
        common.critic.step(&gradient[policy..all]);
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
        let kl = self.learn()?;
        self.common.follow_rollout();
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
fn adapted(learning_rate: f64, kl: f64, config: &PpoConfig) -> f64 {
    let [low, high] = config.learning_rate_range;
    if kl > 2.0 * config.target_kl {
        (learning_rate / LEARNING_RATE_FACTOR).max(low)
    } else if kl < 0.5 * config.target_kl {
        (learning_rate * LEARNING_RATE_FACTOR).min(high)
    } else {
        learning_rate
    }
}
