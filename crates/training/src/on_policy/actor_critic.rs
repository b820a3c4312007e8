//! Gaussian policy, critic and rollout collection, shared by PPO and TRPO.

use std::time::Instant;

use mishandle_controllers::{History, Policy};
use mishandle_network::{Mlp, Moments, Normalizer, RunningNormalizer};
use mishandle_rollout::{BatchFactory, RolloutError, Seed};
use rayon::prelude::*;

use super::gae;
use super::settings::OnPolicySettings;
use crate::gaussian::DiagonalGaussian;
use crate::inference::{
    BatchInference, INFERENCE_ROWS, observation_normalizer, policy_history, restore_normalizer,
};
use crate::initialization::initial_network;
use crate::learner::origin::first_policy;
use crate::privileged::PrivilegedNormalizer;
use crate::{Checkpoint, Critic, Episodes, ObservationMoments, RolloutBuffer, TrainingError};

/// Indices of child seeds. Episodes use 0, minibatches 3.
const POLICY_WEIGHTS: u64 = 1;
const CRITIC_WEIGHTS: u64 = 2;

/// Policy, critic, environments and rollout buffer.
pub(crate) struct ActorCritic {
    rollout_steps: usize,
    gamma: f64,
    gae_lambda: f64,
    history: History,
    normalize: bool,
    observation_moments: ObservationMoments,
    pub episodes: Episodes,
    pub buffer: RolloutBuffer,
    normalizer: RunningNormalizer,
    privileged: PrivilegedNormalizer,
    pub network: Mlp<f32>,
    pub log_std: Vec<f32>,
    log_std_range: (f32, f32),
    pub critic: Critic,
    /// Normalized value targets, one per row of the buffer.
    pub targets: Vec<f32>,
    /// Normalized values from the time of the rollout, one per row of the buffer.
    pub old_values: Vec<f32>,
    inference: BatchInference,
    returns: Vec<f64>,
    last_values: Vec<f64>,
    truncated_values: Vec<f64>,
}

/// Wall-clock time of a rollout, s.
pub(crate) struct RolloutSecs {
    pub physics: f64,
    pub total: f64,
}

impl ActorCritic {
    pub fn new(
        environments: &dyn BatchFactory,
        shared: &OnPolicySettings<'_>,
        seed: Seed,
    ) -> Result<ActorCritic, TrainingError> {
        let OnPolicySettings {
            rollout_steps,
            gamma,
            gae_lambda,
            run,
            episodes,
            scenarios,
            policy,
            critic,
            ..
        } = *shared;
        let rows = episodes.environments;
        let mut episodes = Episodes::of_training(environments, episodes, scenarios, seed)?;
        let history = policy_history(episodes.spec(), policy.history, &policy.hidden)?;
        episodes = episodes.with_history(policy.history);
        if critic.sees_scenario {
            episodes = episodes.with_privileged();
        }
        let inputs = history.input_size();
        let outputs = episodes.spec().action_size;
        let network = initial_network(
            inputs,
            &policy.hidden,
            outputs,
            policy.activation,
            policy.initialization,
            0.01,
            seed.child(POLICY_WEIGHTS),
        )?;
        let privileged = episodes.privileged_size();
        let critic = Critic::new(inputs, privileged, critic, seed.child(CRITIC_WEIGHTS))?;
        Ok(ActorCritic {
            rollout_steps,
            gamma,
            gae_lambda,
            history,
            normalize: policy.normalize_observations && run.from.is_none(),
            observation_moments: policy.observation_moments,
            normalizer: observation_normalizer(
                episodes.spec(),
                policy.normalize_observations,
                policy.std_floor,
            ),
            privileged: PrivilegedNormalizer::new(&episodes, policy.normalize_observations, policy.std_floor),
            log_std: vec![policy.initial_log_std as f32; outputs],
            log_std_range: (policy.min_log_std as f32, policy.max_log_std as f32),
            network,
            critic,
            targets: Vec::new(),
            old_values: Vec::new(),
            inference: BatchInference::new(rows, outputs, outputs),
            returns: Vec::new(),
            last_values: vec![0.0; rows],
            truncated_values: Vec::new(),
            buffer: RolloutBuffer::new(rollout_steps, rows, inputs, outputs).with_privileged(privileged),
            episodes,
        })
    }

    /// Returns the number of environment steps of a rollout.
    pub fn rollout_size(&self) -> u64 {
        self.buffer.count() as u64
    }

    /// Replaces policy and normalizer by those of a controller.
    ///
    /// # Errors
    /// If it has another form.
    pub fn start_from(&mut self, policy: &Policy) -> Result<(), TrainingError> {
        let policy = first_policy(policy, &self.network, self.history)?;
        if policy.log_std().len() != self.log_std.len() {
            let what = "distribution";
            let expected = "a Gaussian".to_string();
            return Err(TrainingError::OtherPolicy { what, expected, found: "squashed".to_string() });
        }
        self.network = policy.network().clone();
        self.log_std = policy.log_std().to_vec();
        self.clamp_log_std();
        restore_normalizer(&mut self.normalizer, &policy)
    }

    pub fn policy(&self) -> Result<Policy, TrainingError> {
        let mean = self.normalizer.mean().to_vec();
        let variance = self.normalizer.variance();
        let length = self.history.length();
        let log_std = self.log_std.clone();
        Ok(Policy::with_history(length, mean, variance, self.network.clone(), Some(log_std))?)
    }

    /// Returns a frozen normalizer of the networks' inputs.
    pub fn normalizer(&self) -> Normalizer<f32> {
        self.history.normalizer(self.normalizer.freeze())
    }

    /// Collects a rollout into the buffer.
    ///
    /// # Errors
    /// If the environment batch fails.
    pub fn collect_rollout(&mut self, normalizer: &Normalizer<f32>) -> Result<RolloutSecs, RolloutError> {
        let start = Instant::now();
        let gaussian = DiagonalGaussian::new(&self.log_std);
        let mut physics = 0.0;
        self.buffer.clear();
        for _ in 0..self.rollout_steps {
            let (observations, actions, log_probs) = self.buffer.begin_step(&self.episodes);
            self.episodes.policy_noise(&mut self.inference.noise);
            self.inference.infer(&self.network, normalizer, observations);
            sample_actions(&self.inference, &gaussian, actions, log_probs);
            let start = Instant::now();
            self.episodes.step(self.buffer.step_actions())?;
            physics += start.elapsed().as_secs_f64();
            self.buffer.end_step(&self.episodes);
        }
        Ok(RolloutSecs { physics, total: start.elapsed().as_secs_f64() })
    }

    /// Computes values, advantages and value targets of the rollout, and normalizes its privileged
    /// inputs.
    pub fn compute_advantages(&mut self, normalizer: &Normalizer<f32>) {
        let ActorCritic { buffer, critic, privileged, .. } = self;
        let frozen = privileged.freeze();
        privileged.update(&buffer.privileged);
        for rows in [&mut buffer.privileged, &mut buffer.last_privileged, &mut buffer.truncated_privileged] {
            privileged.normalize(&frozen, rows);
        }
        critic.values(normalizer, &buffer.observations, &buffer.privileged, &mut buffer.values);
        let last = &mut self.last_values;
        critic.values(normalizer, &buffer.last_observations, &buffer.last_privileged, last);
        self.truncated_values.resize(buffer.truncated.len(), 0.0);
        let truncated = &mut self.truncated_values;
        critic.values(normalizer, &buffer.truncated_observations, &buffer.truncated_privileged, truncated);
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
        critic.normalize_targets(&buffer.values, &self.returns, &mut self.old_values, &mut self.targets);
    }

    /// Updates the observation normalizer from the rollout, after the policy update.
    pub fn update_normalizer_from_rollout(&mut self) {
        let columns = self.history.observation_size();
        self.update_normalizer(ObservationMoments::Rollout, |buffer| buffer.observation_moments(columns));
    }

    /// Updates the observation normalizer from the whole rollout, before a policy update in one
    /// batch.
    pub fn update_normalizer_from_batch(&mut self) {
        let columns = self.history.observation_size();
        let moments = |buffer: &RolloutBuffer| buffer.observation_moments(columns).with_sample_variance();
        self.update_normalizer(ObservationMoments::Minibatches, moments);
    }

    /// Updates the observation normalizer from a minibatch, before its gradient step; `rows` are
    /// indices of the buffer.
    pub fn update_normalizer_from_minibatch(&mut self, rows: &[u32]) {
        let columns = self.history.observation_size();
        let moments =
            |buffer: &RolloutBuffer| buffer.observation_moments_at(rows, columns).with_sample_variance();
        self.update_normalizer(ObservationMoments::Minibatches, moments);
    }

    fn update_normalizer(
        &mut self,
        when: ObservationMoments,
        moments: impl FnOnce(&RolloutBuffer) -> Moments,
    ) {
        if self.normalize && self.observation_moments == when {
            self.normalizer.merge(&moments(&self.buffer));
        }
    }

    /// Returns whether the initial probability ratios are exactly 1, because the normalizer did not
    /// change since the rollout.
    pub fn initial_ratios_are_1(&self) -> bool {
        !self.normalize || self.observation_moments == ObservationMoments::Rollout
    }

    /// Clamps each log σ to its bounds.
    pub fn clamp_log_std(&mut self) {
        let (low, high) = self.log_std_range;
        for log_std in &mut self.log_std {
            *log_std = log_std.clamp(low, high);
        }
    }

    /// Returns the policy parameters θ + `fraction` · `step`; `step` contains the network's
    /// parameters, then log σ.
    pub fn policy_at_step(&self, step: &[f64], fraction: f64) -> (Mlp<f32>, Vec<f32>) {
        let (network_step, log_std_step) = step.split_at(self.network.parameter_count());
        let moved = |old: f32, by: &f64| (f64::from(old) + fraction * by) as f32;
        let mut network = self.network.clone();
        network.update(|parameters| {
            parameters.iter_mut().zip(network_step).for_each(|(x, by)| *x = moved(*x, by));
        });
        let (low, high) = self.log_std_range;
        let log_std = self.log_std.iter().zip(log_std_step).map(|(x, by)| moved(*x, by).clamp(low, high));
        (network, log_std.collect())
    }

    /// Saves policy, normalizer, critic and episodes to a checkpoint.
    ///
    /// # Errors
    /// If the environment batch fails.
    pub fn save(&mut self, checkpoint: &mut Checkpoint) -> Result<(), RolloutError> {
        checkpoint.put("policy.parameters", self.network.parameters().to_vec());
        checkpoint.put("policy.log_std", self.log_std.clone());
        checkpoint.put_moments("normalizer", self.normalizer.moments());
        self.privileged.save(checkpoint);
        self.critic.save(checkpoint);
        self.episodes.save(checkpoint)
    }

    /// Restores the state from a checkpoint.
    ///
    /// # Errors
    /// If the checkpoint contains networks or environments of other sizes.
    pub fn load(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainingError> {
        let own = checkpoint.f32s("policy.parameters", self.network.parameter_count())?;
        self.network.update(|parameters| parameters.copy_from_slice(own));
        self.log_std = checkpoint.f32s("policy.log_std", self.log_std.len())?.to_vec();
        let columns = self.history.observation_size();
        self.normalizer.restore(checkpoint.moments("normalizer", columns)?)?;
        self.privileged.load(checkpoint)?;
        self.critic.load(checkpoint)?;
        self.episodes.load(checkpoint)
    }
}

/// Samples an action for each environment and writes the log-probabilities.
fn sample_actions(
    inference: &BatchInference,
    gaussian: &DiagonalGaussian,
    actions: &mut [f32],
    log_probs: &mut [f64],
) {
    let size = gaussian.std().len();
    let rows = inference.outputs.par_chunks(size).zip(inference.noise.par_chunks(size));
    let rows = rows.zip(actions.par_chunks_mut(size)).zip(log_probs);
    rows.with_min_len(INFERENCE_ROWS).for_each(|(((means, noise), actions), log_prob)| {
        let deviations = gaussian.std().iter().zip(noise).map(|(std, z)| std * z);
        for ((action, mean), deviation) in actions.iter_mut().zip(means).zip(deviations) {
            *action = (f64::from(*mean) + deviation) as f32;
        }
        *log_prob = gaussian.log_prob(means, actions);
    });
}

/// Returns the mean of the advantages and the inverse of their sample standard deviation.
pub(crate) fn mean_and_inverse_std(advantages: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let count = advantages.clone().count() as f64;
    let mean = advantages.clone().sum::<f64>() / count;
    let variance = advantages.map(|a| (a - mean) * (a - mean)).sum::<f64>() / (count - 1.0).max(1.0);
    (mean, 1.0 / (variance.sqrt() + 1e-8))
}
