use std::ops::Range;

use mishandle_network::{Adam, CHUNK_ROWS, ChunkPool, clip_norm};

use super::config::{GradNorm, PpoConfig, Reduction, Schedule, Standardized};
use super::loss::{Minibatch, RIDERS, Scratch};
use crate::actor_critic::{ActorCritic, mean_and_scale};
use crate::gaussian::Deviations;
use crate::learner::iterations;
use crate::minibatches::Minibatches;
use crate::on_policy::{Improvement, Improver};
use crate::on_policy_settings::{Setup, setup_of};
use crate::{Checkpoint, Critic, TrainingError};

/// Factor by which the adaptive schedule changes it.
const LEARNING_RATE_FACTOR: f64 = 1.5;

pub(crate) struct Ppo {
    config: PpoConfig,
    network_adam: Adam<f32>,
    log_std_adam: Adam<f32>,
    pool: ChunkPool<f32, Scratch>,
    /// The gradient of the last minibatch: by the policy's parameters, by log σ, by the critic's parameters; then the
    /// [riders](RIDERS).
    pub gradient: Vec<f32>,
    minibatches: Minibatches,
}

impl Ppo {
    fn set_learning_rate(&mut self, learning_rate: f64, critic: &mut Critic) {
        self.network_adam.learning_rate = learning_rate;
        self.log_std_adam.learning_rate = learning_rate;
        if self.config.shared_learning_rate {
            critic.set_learning_rate(learning_rate);
        }
    }

    /// One pass over the minibatches, which a divergence beyond the threshold ends; gives the mean divergence.
    fn learn_epoch(
        &mut self,
        actor_critic: &mut ActorCritic,
        first: bool,
        over_all: Option<(f64, f64)>,
    ) -> Result<f64, &'static str> {
        let all = self.minibatches.order().len() as f64;
        let (mut kl, mut seen) = (0.0, 0);
        for rows in self.minibatches.ranges() {
            if first {
                actor_critic.follow_minibatch(&self.minibatches.order()[rows.clone()]);
            }
            let of_minibatch = self.compute_gradient(actor_critic, rows.clone(), over_all)?;
            kl += of_minibatch * rows.len() as f64 / all;
            seen += rows.len();
            if self.config.kl_threshold.is_some_and(|threshold| of_minibatch > threshold) {
                break;
            }
            self.step(actor_critic);
        }
        Ok(kl * (all / seen as f64))
    }

    /// The gradient of the loss of the minibatch of these rows; gives its mean divergence.
    fn compute_gradient(
        &mut self,
        actor_critic: &ActorCritic,
        rows: Range<usize>,
        over_all: Option<(f64, f64)>,
    ) -> Result<f64, &'static str> {
        let Ppo { config, pool, gradient, minibatches, .. } = self;
        let order = &minibatches.order()[rows];
        let advantages = &actor_critic.buffer.advantages;
        let (advantage_mean, advantage_scale) =
            over_all.unwrap_or_else(|| mean_and_scale(order.iter().map(|place| advantages[*place as usize])));
        let deviations = Deviations::new(&actor_critic.log_std);
        let minibatch = Minibatch {
            buffer: &actor_critic.buffer,
            targets: &actor_critic.targets,
            old_values: &actor_critic.old_values,
            order,
            advantage_mean,
            advantage_scale,
            normalizer: &actor_critic.normalizer(),
            policy: &actor_critic.network,
            deviations: &deviations,
            critic: actor_critic.critic.network(),
            clip_epsilon: config.clip_epsilon,
            entropy_slope: match config.entropy {
                Reduction::Sum => config.entropy_coef,
                Reduction::Mean => config.entropy_coef / actor_critic.log_std.len() as f64,
            },
            value_clip: config.value_clip,
            loss_scale: actor_critic.critic.loss_scale(),
        };
        pool.sum(order.len(), gradient, |rows, scratch, gradient| {
            minibatch.add_gradient(rows, scratch, gradient);
        });
        let riders = &gradient[gradient.len() - RIDERS.len()..];
        match RIDERS.iter().zip(riders).find(|(_, number)| !number.is_finite()) {
            Some((what, _)) => Err(what),
            None => Ok(f64::from(riders[0])),
        }
    }

    /// One step of all optimisers along the gradient.
    fn step(&mut self, actor_critic: &mut ActorCritic) {
        let Ppo { config, gradient, network_adam, log_std_adam, .. } = self;
        let weights = actor_critic.network.parameter_count();
        let policy = weights + actor_critic.log_std.len();
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
        actor_critic.network.update(|parameters| network_adam.step(parameters, &gradient[..weights]));
        log_std_adam.step(&mut actor_critic.log_std, &gradient[weights..policy]);
        actor_critic.limit_log_std();
        actor_critic.critic.step(&gradient[policy..all]);
    }
}

impl Improver for Ppo {
    type Config = PpoConfig;

    fn setup(config: &PpoConfig) -> Setup<'_> {
        setup_of!(config)
    }

    fn new(config: &PpoConfig, actor_critic: &mut ActorCritic, minibatches: Minibatches) -> Ppo {
        if config.shared_learning_rate {
            actor_critic.critic.set_learning_rate(config.learning_rate);
        }
        let (weights, actions) = (actor_critic.network.parameter_count(), actor_critic.log_std.len());
        let gradient = weights + actions + actor_critic.critic.network().parameter_count() + RIDERS.len();
        Ppo {
            config: config.clone(),
            network_adam: Adam::new(weights, config.learning_rate),
            log_std_adam: Adam::new(actions, config.learning_rate),
            pool: ChunkPool::new(CHUNK_ROWS),
            gradient: vec![0.0; gradient],
            minibatches,
        }
    }

    fn improve(
        &mut self,
        actor_critic: &mut ActorCritic,
        iteration: u64,
    ) -> Result<Improvement, &'static str> {
        let (schedule, epochs) = (self.config.learning_rate_schedule, self.config.epochs as u64);
        if schedule == Schedule::Linear {
            let all = iterations(&self.config.run, actor_critic.rollout_size());
            let left = 1.0 - iteration as f64 / all as f64;
            actor_critic.critic.set_learning_rate(left * self.config.critic.learning_rate);
            self.set_learning_rate(left * self.config.learning_rate, &mut actor_critic.critic);
        }
        let advantages = &actor_critic.buffer.advantages;
        let over_all = (self.config.advantages == Standardized::Rollout)
            .then(|| mean_and_scale(advantages.iter().copied()));
        let mut kl = 0.0;
        for epoch in 0..epochs {
            self.minibatches.begin_epoch(iteration * epochs + epoch);
            kl = self.learn_epoch(actor_critic, epoch == 0, over_all)?;
            if schedule == Schedule::Adaptive {
                let learning_rate = adapted(self.network_adam.learning_rate, kl, &self.config);
                self.set_learning_rate(learning_rate, &mut actor_critic.critic);
            }
        }
        Ok(Improvement { kl, learning_rate: self.network_adam.learning_rate })
    }

    fn save(&self, checkpoint: &mut Checkpoint) {
        checkpoint.put_adam("policy.adam", &self.network_adam);
        checkpoint.put_adam("policy.log_std_adam", &self.log_std_adam);
    }

    fn load(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainingError> {
        let (weights, actions) =
            (self.network_adam.first_moments().len(), self.log_std_adam.first_moments().len());
        self.network_adam = checkpoint.adam("policy.adam", weights)?;
        self.log_std_adam = checkpoint.adam("policy.log_std_adam", actions)?;
        Ok(())
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
