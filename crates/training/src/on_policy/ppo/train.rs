use std::ops::Range;

use mishandle_network::{Adam, CHUNK_ROWS, ChunkPool, NetworkDevice, clip_norm};

use super::device::DeviceNetworks;
use super::loss::{METRICS, Minibatch, Scratch};
use super::settings::{
    AdvantageNormalization, EntropyReduction, GradientClipping, LearningRateSchedule, PpoSettings,
};
use crate::gaussian::DiagonalGaussian;
use crate::learner::iterations;
use crate::on_policy::minibatches::Minibatches;
use crate::on_policy::settings::{OnPolicySettings, on_policy_settings};
use crate::on_policy::{ActorCritic, PolicyOptimizer, UpdateError, UpdateStatistics, mean_and_inverse_std};
use crate::{Checkpoint, Critic, TrainingError};

/// Factor of the adaptive learning rate schedule.
const LEARNING_RATE_FACTOR: f64 = 1.5;

pub(crate) struct Ppo {
    settings: PpoSettings,
    network_adam: Adam<f32>,
    log_std_adam: Adam<f32>,
    pool: ChunkPool<f32, Scratch>,
    /// The networks on another device than the CPU, if training uses one.
    device: Option<DeviceNetworks>,
    /// Gradient of the last minibatch with respect to the policy's parameters, log σ and the
    /// critic's parameters, followed by the [metrics](METRICS).
    pub gradient: Vec<f32>,
    minibatches: Minibatches,
}

impl Ppo {
    fn set_learning_rate(&mut self, learning_rate: f64, critic: &mut Critic) {
        self.network_adam.learning_rate = learning_rate;
        self.log_std_adam.learning_rate = learning_rate;
        if self.settings.shared_learning_rate {
            critic.set_learning_rate(learning_rate);
        }
    }

    /// Runs one epoch over the minibatches, or less if the KL divergence exceeds the threshold;
    /// returns the mean KL divergence.
    fn run_epoch(
        &mut self,
        actor_critic: &mut ActorCritic,
        first: bool,
        learns_policy: bool,
        rollout_moments: Option<(f64, f64)>,
    ) -> Result<f64, UpdateError> {
        let all = self.minibatches.order().len() as f64;
        let mut kl = 0.0;
        let mut evaluated = 0;
        for rows in self.minibatches.ranges() {
            if first {
                actor_critic.update_normalizer_from_minibatch(&self.minibatches.order()[rows.clone()]);
            }
            let minibatch_kl = self.compute_gradient(actor_critic, rows.clone(), rollout_moments)?;
            kl += minibatch_kl * rows.len() as f64 / all;
            evaluated += rows.len();
            if self.settings.kl_threshold.is_some_and(|threshold| minibatch_kl > threshold) {
                break;
            }
            self.step(actor_critic, learns_policy);
        }
        Ok(kl * (all / evaluated as f64))
    }

    /// Computes the gradient of the minibatch `rows`; returns its mean KL divergence.
    fn compute_gradient(
        &mut self,
        actor_critic: &ActorCritic,
        rows: Range<usize>,
        rollout_moments: Option<(f64, f64)>,
    ) -> Result<f64, UpdateError> {
        let Ppo { settings, pool, device, gradient, minibatches, .. } = self;
        let order = &minibatches.order()[rows];
        let advantages = &actor_critic.buffer.advantages;
        let (advantage_mean, advantage_inverse_std) = rollout_moments
            .unwrap_or_else(|| mean_and_inverse_std(order.iter().map(|row| advantages[*row as usize])));
        let gaussian = DiagonalGaussian::new(&actor_critic.log_std);
        let minibatch = Minibatch {
            buffer: &actor_critic.buffer,
            targets: &actor_critic.targets,
            old_values: &actor_critic.old_values,
            rows: order,
            advantage_mean,
            advantage_inverse_std,
            normalizer: &actor_critic.normalizer(),
            policy: &actor_critic.network,
            gaussian: &gaussian,
            critic: actor_critic.critic.network(),
            clip_epsilon: settings.clip_epsilon,
            entropy_slope: match settings.entropy_reduction {
                EntropyReduction::Sum => settings.entropy_coef,
                EntropyReduction::Mean => settings.entropy_coef / actor_critic.log_std.len() as f64,
            },
            value_clip: settings.value_clip,
            loss_coef: actor_critic.critic.loss_coef(),
        };
        match device {
            Some(device) => device.gradient(&minibatch, gradient)?,
            None => pool.sum(order.len(), gradient, |rows, scratch, gradient| {
                minibatch.add_gradient(rows, scratch, gradient);
            }),
        }
        let metrics = &gradient[gradient.len() - METRICS.len()..];
        match METRICS.iter().zip(metrics).find(|(_, number)| !number.is_finite()) {
            Some((what, _)) => Err(UpdateError::NotFinite(what)),
            None => Ok(f64::from(metrics[0])),
        }
    }

    /// Applies one step of all optimizers, or of that of the critic only.
    fn step(&mut self, actor_critic: &mut ActorCritic, learns_policy: bool) {
        let Ppo { settings, gradient, network_adam, log_std_adam, .. } = self;
        let weights = actor_critic.network.parameter_count();
        let policy = weights + actor_critic.log_std.len();
        let all = gradient.len() - METRICS.len();
        match settings.grad_clipping {
            GradientClipping::Separate => {
                clip_norm(&mut gradient[..policy], settings.max_grad_norm);
                clip_norm(&mut gradient[policy..all], settings.max_grad_norm);
            }
            GradientClipping::Joint => {
                clip_norm(&mut gradient[..all], settings.max_grad_norm);
            }
        }
        if learns_policy {
            actor_critic.network.update(|parameters| network_adam.step(parameters, &gradient[..weights]));
            log_std_adam.step(&mut actor_critic.log_std, &gradient[weights..policy]);
            actor_critic.clamp_log_std();
        }
        actor_critic.critic.step(&gradient[policy..all]);
    }
}

impl PolicyOptimizer for Ppo {
    type Settings = PpoSettings;

    fn shared(settings: &PpoSettings) -> OnPolicySettings<'_> {
        on_policy_settings!(settings)
    }

    fn new(settings: &PpoSettings, actor_critic: &mut ActorCritic, minibatches: Minibatches) -> Ppo {
        if settings.shared_learning_rate {
            actor_critic.critic.set_learning_rate(settings.learning_rate);
        }
        let weights = actor_critic.network.parameter_count();
        let actions = actor_critic.log_std.len();
        let gradient = weights + actions + actor_critic.critic.network().parameter_count() + METRICS.len();
        Ppo {
            settings: settings.clone(),
            network_adam: Adam::new(weights, settings.learning_rate),
            log_std_adam: Adam::new(actions, settings.learning_rate),
            pool: ChunkPool::new(CHUNK_ROWS),
            device: None,
            gradient: vec![0.0; gradient],
            minibatches,
        }
    }

    fn use_device(
        &mut self,
        device: &dyn NetworkDevice,
        actor_critic: &ActorCritic,
    ) -> Result<(), TrainingError> {
        let rows = self.minibatches.ranges().map(|rows| rows.len()).max().unwrap_or(0);
        let policy = &actor_critic.network;
        let critic = actor_critic.critic.network();
        self.device = Some(DeviceNetworks::new(device, policy, critic, rows)?);
        Ok(())
    }

    fn update(
        &mut self,
        actor_critic: &mut ActorCritic,
        iteration: u64,
    ) -> Result<UpdateStatistics, UpdateError> {
        let schedule = self.settings.learning_rate_schedule;
        let epochs = self.settings.epochs as u64;
        if schedule == LearningRateSchedule::Linear {
            let all = iterations(&self.settings.run, actor_critic.rollout_size());
            let remaining = 1.0 - iteration as f64 / all as f64;
            actor_critic.critic.set_learning_rate(remaining * self.settings.critic.learning_rate);
            self.set_learning_rate(remaining * self.settings.learning_rate, &mut actor_critic.critic);
        }
        let advantages = &actor_critic.buffer.advantages;
        let rollout_moments = (self.settings.advantage_normalization == AdvantageNormalization::Rollout)
            .then(|| mean_and_inverse_std(advantages.iter().copied()));
        let learns_policy = self.settings.run.learns_policy(iteration * actor_critic.rollout_size());
        let mut kl = 0.0;
        for epoch in 0..epochs {
            self.minibatches.start_epoch(iteration * epochs + epoch);
            kl = self.run_epoch(actor_critic, epoch == 0, learns_policy, rollout_moments)?;
            if schedule == LearningRateSchedule::Adaptive && learns_policy {
                let learning_rate =
                    adapted_learning_rate(self.network_adam.learning_rate, kl, &self.settings);
                self.set_learning_rate(learning_rate, &mut actor_critic.critic);
            }
        }
        Ok(UpdateStatistics { kl, learning_rate: self.network_adam.learning_rate })
    }

    fn save(&self, checkpoint: &mut Checkpoint) {
        checkpoint.put_adam("policy.adam", &self.network_adam);
        checkpoint.put_adam("policy.log_std_adam", &self.log_std_adam);
    }

    fn load(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainingError> {
        let weights = self.network_adam.first_moments().len();
        let actions = self.log_std_adam.first_moments().len();
        self.network_adam = checkpoint.adam("policy.adam", weights)?;
        self.log_std_adam = checkpoint.adam("policy.log_std_adam", actions)?;
        Ok(())
    }
}

/// Returns the learning rate after an epoch with KL divergence `kl`.
fn adapted_learning_rate(learning_rate: f64, kl: f64, settings: &PpoSettings) -> f64 {
    let [low, high] = settings.learning_rate_range;
    if kl > 2.0 * settings.target_kl {
        (learning_rate / LEARNING_RATE_FACTOR).max(low)
    } else if kl < 0.5 * settings.target_kl {
        (learning_rate * LEARNING_RATE_FACTOR).min(high)
    } else {
        learning_rate
    }
}
