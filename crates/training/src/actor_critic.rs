//! A Gaussian policy, a critic, and the rollouts that both learn from.

use std::time::Instant;

use mishandle_controllers::Policy;
use mishandle_network::{Mlp, Moments, Normalizer, RunningNormalizer};
use mishandle_rollout::{BatchFactory, RolloutError, Seed};
use rayon::prelude::*;

use crate::acting::{ACTING_ROWS, Acting};
use crate::gaussian::Deviations;
use crate::initialization::initial_network;
use crate::on_policy_settings::Setup;
use crate::{Buffer, Checkpoint, Critic, Episodes, ObservationMoments, TrainingError, gae};

/// Children of the training's seed; its episodes have 0, its minibatches 3.
const POLICY_WEIGHTS: u64 = 1;
const CRITIC_WEIGHTS: u64 = 2;

/// Policy, critic, and the rollouts that they learn from.
pub(crate) struct ActorCritic {
    rollout_steps: usize,
    gamma: f64,
    gae_lambda: f64,
    normalize: bool,
    observation_moments: ObservationMoments,
    pub episodes: Episodes,
    pub buffer: Buffer,
    normalizer: RunningNormalizer,
    pub network: Mlp<f32>,
    pub log_std: Vec<f32>,
    log_std_range: (f32, f32),
    pub critic: Critic,
    /// Targets of the critic's outputs, one for each entry of the buffer.
    pub targets: Vec<f32>,
    /// What its outputs were when the rollout was made, on the same scale.
    pub old_values: Vec<f32>,
    acting: Acting,
    returns: Vec<f64>,
    last_values: Vec<f64>,
    truncated_values: Vec<f64>,
}

/// Where the time of a rollout went, s.
pub(crate) struct RolloutSecs {
    pub physics: f64,
    pub total: f64,
}

impl ActorCritic {
    pub fn new(
        environments: &dyn BatchFactory,
        setup: &Setup<'_>,
        seed: Seed,
    ) -> Result<ActorCritic, TrainingError> {
        let Setup { rollout_steps, gamma, gae_lambda, episodes, policy, critic, .. } = *setup;
        let rows = episodes.environments;
        let episodes = Episodes::of_training(environments, episodes, seed)?;
        let (inputs, outputs) = (episodes.spec().observation_size, episodes.spec().action_size);
        let network = initial_network(
            (inputs, &policy.hidden, outputs),
            policy.activation,
            policy.initialization,
            0.01,
            seed.child(POLICY_WEIGHTS),
        )?;
        let critic = Critic::new(inputs, critic, seed.child(CRITIC_WEIGHTS))?;
        Ok(ActorCritic {
            rollout_steps,
            gamma,
            gae_lambda,
            normalize: policy.normalize_observations,
            observation_moments: policy.observation_moments,
            normalizer: RunningNormalizer::new(inputs),
            log_std: vec![policy.initial_log_std as f32; outputs],
            log_std_range: (policy.min_log_std as f32, policy.max_log_std as f32),
            network,
            critic,
            targets: Vec::new(),
            old_values: Vec::new(),
            acting: Acting::new(rows, outputs, outputs),
            returns: Vec::new(),
            last_values: vec![0.0; rows],
            truncated_values: Vec::new(),
            buffer: Buffer::new(rollout_steps, rows, inputs, outputs),
            episodes,
        })
    }

    /// Environment steps of a rollout.
    pub fn rollout_size(&self) -> u64 {
        self.buffer.count() as u64
    }

    pub fn policy(&self) -> Result<Policy, TrainingError> {
        let (mean, variance) = (self.normalizer.mean().to_vec(), self.normalizer.variance());
        Ok(Policy::new(mean, variance, self.network.clone(), self.log_std.clone())?)
    }

    /// How observations are scaled in this rollout and in what is learned from it.
    pub fn normalizer(&self) -> Normalizer<f32> {
        self.normalizer.freeze()
    }

    /// Fills the buffer.
    ///
    /// # Errors
    /// If the environment batch fails as a whole.
    pub fn roll_out(&mut self, normalizer: &Normalizer<f32>) -> Result<RolloutSecs, RolloutError> {
        let start = Instant::now();
        let deviations = Deviations::new(&self.log_std);
        let mut physics = 0.0;
        self.buffer.clear();
        for _ in 0..self.rollout_steps {
            let (seen, actions, log_probs) = self.buffer.begin_step(&self.episodes);
            self.episodes.policy_draws(&mut self.acting.draws);
            self.acting.infer(&self.network, normalizer, seen);
            draw_actions(&self.acting, &deviations, actions, log_probs);
            let start = Instant::now();
            self.episodes.step(self.buffer.step_actions())?;
            physics += start.elapsed().as_secs_f64();
            self.buffer.end_step(&self.episodes);
        }
        Ok(RolloutSecs { physics, total: start.elapsed().as_secs_f64() })
    }

    /// Values and advantages of the rollout, and the critic's targets.
    pub fn estimate(&mut self, normalizer: &Normalizer<f32>) {
        let ActorCritic { buffer, critic, .. } = self;
        critic.values(normalizer, &buffer.observations, &mut buffer.values);
        critic.values(normalizer, &buffer.last_observations, &mut self.last_values);
        self.truncated_values.resize(buffer.truncated.len(), 0.0);
        critic.values(normalizer, &buffer.truncated_observations, &mut self.truncated_values);
        buffer.set_next_values(&self.last_values, &self.truncated_values);
        gae::advantages(
            self.gamma,
            self.gae_lambda,
            buffer.rows(),
            &buffer.rewards,
            &buffer.values,
            &buffer.next_values,
            &buffer.boundaries,
            &mut buffer.advantages,
        );
        let returns =
            buffer.advantages.iter().zip(&buffer.values).map(|(advantage, value)| advantage + value);
        self.returns.clear();
        self.returns.extend(returns);
        critic.targets(&buffer.values, &self.returns, &mut self.old_values, &mut self.targets);
    }

    /// Lets the scale of observations follow those of the rollout, now that it has been learned from.
    pub fn follow_rollout(&mut self) {
        self.follow(ObservationMoments::Rollout, Buffer::observation_moments);
    }

    /// Lets the scale of observations follow those of the rollout, which is about to be learned from as one batch.
    pub fn follow_batch(&mut self) {
        let moments = |buffer: &Buffer| buffer.observation_moments().with_sample_variance();
        self.follow(ObservationMoments::Minibatches, moments);
    }

    /// Lets the scale of observations follow those at some places of the rollout, which are about to be learned from.
    pub fn follow_minibatch(&mut self, places: &[u32]) {
        let moments = |buffer: &Buffer| buffer.observation_moments_at(places).with_sample_variance();
        self.follow(ObservationMoments::Minibatches, moments);
    }

    fn follow(&mut self, when: ObservationMoments, moments: impl FnOnce(&Buffer) -> Moments) {
        if self.normalize && self.observation_moments == when {
            self.normalizer.merge(&moments(&self.buffer));
        }
    }

    /// Whether the first ratios are exactly 1: observations are scaled as they were when the rollout was made.
    pub fn ratios_begin_at_1(&self) -> bool {
        !self.normalize || self.observation_moments == ObservationMoments::Rollout
    }

    /// Keeps each log σ within its range.
    pub fn limit_log_std(&mut self) {
        let (low, high) = self.log_std_range;
        for log_std in &mut self.log_std {
            *log_std = log_std.clamp(low, high);
        }
    }

    /// The policy that is `fraction` of `step` away: by the network's parameters, then by log σ.
    pub fn moved_policy(&self, step: &[f64], fraction: f64) -> (Mlp<f32>, Vec<f32>) {
        let (by_network, by_log_std) = step.split_at(self.network.parameter_count());
        let moved = |old: f32, by: &f64| (f64::from(old) + fraction * by) as f32;
        let mut network = self.network.clone();
        network.update(|parameters| {
            parameters.iter_mut().zip(by_network).for_each(|(x, by)| *x = moved(*x, by));
        });
        let (low, high) = self.log_std_range;
        let log_std = self.log_std.iter().zip(by_log_std).map(|(x, by)| moved(*x, by).clamp(low, high));
        (network, log_std.collect())
    }

    /// Puts all that its future depends on into a checkpoint.
    ///
    /// # Errors
    /// If the environment batch fails as a whole.
    pub fn save(&mut self, checkpoint: &mut Checkpoint) -> Result<(), RolloutError> {
        checkpoint.put("policy.parameters", self.network.parameters().to_vec());
        checkpoint.put("policy.log_std", self.log_std.clone());
        checkpoint.put_moments("normalizer", self.normalizer.moments());
        self.critic.save(checkpoint);
        self.episodes.save(checkpoint)
    }

    /// Goes on where a checkpoint was taken.
    ///
    /// # Errors
    /// If the checkpoint holds networks or simulations of other sizes.
    pub fn load(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainingError> {
        let own = checkpoint.f32s("policy.parameters", self.network.parameter_count())?;
        self.network.update(|parameters| parameters.copy_from_slice(own));
        self.log_std = checkpoint.f32s("policy.log_std", self.log_std.len())?.to_vec();
        let columns = self.network.input_size();
        self.normalizer = RunningNormalizer::from_moments(checkpoint.moments("normalizer", columns)?)?;
        self.critic.load(checkpoint)?;
        self.episodes.load(checkpoint)
    }
}

/// Draws the action of each row around its mean, and gives the logarithms of their densities.
fn draw_actions(acting: &Acting, deviations: &Deviations, actions: &mut [f32], log_probs: &mut [f64]) {
    let size = deviations.std().len();
    let rows = acting.outputs.par_chunks(size).zip(acting.draws.par_chunks(size));
    let rows = rows.zip(actions.par_chunks_mut(size)).zip(log_probs);
    rows.with_min_len(ACTING_ROWS).for_each(|(((means, draws), actions), log_prob)| {
        let noise = deviations.std().iter().zip(draws).map(|(std, draw)| std * draw);
        for ((action, mean), noise) in actions.iter_mut().zip(means).zip(noise) {
            *action = (f64::from(*mean) + noise) as f32;
        }
        *log_prob = deviations.log_prob(means, actions);
    });
}

/// Mean of some advantages, and one over their standard deviation.
pub(crate) fn mean_and_scale(advantages: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let count = advantages.clone().count() as f64;
    let mean = advantages.clone().sum::<f64>() / count;
    let variance = advantages.map(|a| (a - mean) * (a - mean)).sum::<f64>() / (count - 1.0).max(1.0);
    (mean, 1.0 / (variance.sqrt() + 1e-8))
}
