//! Off-policy algorithms: act, store transitions in a replay buffer, and update in proportion to
//! the number of steps.

pub(crate) mod action_value;
pub(crate) mod agent;
mod batch_gradient;
pub mod ddpg;
pub(crate) mod declare;
pub mod deterministic;
pub mod replay_buffer;
pub mod sac;
pub(crate) mod settings;
pub mod td3;
pub(crate) mod transitions;
mod twin_critics;

use std::time::Instant;

use mishandle_controllers::{History, Policy};
use mishandle_network::{Mlp, Normalizer, RunningNormalizer};
use mishandle_rollout::{BatchFactory, Seed, Stream};
use rayon::prelude::*;

use crate::algorithm::{BuildLearner, CommonSettings};
use crate::inference::{
    BatchInference, INFERENCE_ROWS, first_columns, observation_normalizer, policy_history, restore_normalizer,
};
use crate::learner::origin::first_policy;
use crate::learner::{Learner, progress_of};
use crate::privileged::PrivilegedNormalizer;
use crate::{
    Checkpoint, Episodes, ReplayBufferSettings, RunSettings, TimeShares, TrainingError, TrainingProgress,
};
use action_value::Sizes;
use agent::{Agent, BehaviorPolicy, HasOffPolicySettings};
use batch_gradient::LEARNING_ROWS;
use replay_buffer::{ReplayBuffer, Sampling};
use settings::OffPolicySettings;
use transitions::TransitionBatch;

/// Indices of child seeds. Episodes use 0.
const BATCHES: u64 = 3;
const UPDATES: u64 = 4;
const WARMUP: u64 = 5;

/// An off-policy algorithm with the state of a training run.
pub(crate) struct OffPolicy<A> {
    agent: A,
    seed: Seed,
    steps_per_iteration: usize,
    run: RunSettings,
    replay_settings: ReplayBufferSettings,
    sampling: Sampling,
    history: History,
    normalize: bool,
    learning_rate: f64,
    episodes: Episodes,
    replay_buffer: ReplayBuffer,
    normalizer: RunningNormalizer,
    privileged: PrivilegedNormalizer,
    iteration: u64,
    updates: u64,
    batch: TransitionBatch<f32>,
    inference: BatchInference,
    /// Inputs of the policy before the last control step, `[rows, input_size]`.
    observations: Vec<f32>,
    /// Actions of the last control step, `[rows, action_size]`, within [-1, 1].
    actions: Vec<f32>,
}

impl<A: Agent> BuildLearner for OffPolicy<A> {
    type Settings = A::Settings;

    fn common(settings: &A::Settings) -> CommonSettings<'_> {
        let OffPolicySettings { run, episodes, scenarios, rewards, .. } = settings.shared();
        CommonSettings { run, episodes, scenarios, rewards }
    }

    fn build(
        settings: &A::Settings,
        environments: &dyn BatchFactory,
        seed: Seed,
    ) -> Result<OffPolicy<A>, TrainingError> {
        let OffPolicySettings {
            gamma,
            steps_per_iteration,
            run,
            episodes,
            scenarios,
            replay,
            policy,
            critic,
            ..
        } = settings.shared();
        let rows = episodes.environments;
        let mut episodes = Episodes::of_training(environments, episodes, scenarios, seed)?;
        let history = policy_history(episodes.spec(), policy.history, &policy.hidden)?;
        episodes = episodes.with_history(policy.history);
        if critic.sees_scenario {
            episodes = episodes.with_privileged();
        }
        let privileged = episodes.privileged_size();
        let input_size = history.input_size();
        let action_size = episodes.spec().action_size;
        let sizes = Sizes { observation: input_size, action: action_size, privileged };
        let agent = A::new(sizes, settings, seed)?;
        let outputs = agent.behavior_policy().network().output_size();
        Ok(OffPolicy {
            seed,
            steps_per_iteration,
            sampling: Sampling {
                n_steps: replay.n_steps,
                gamma,
                reward_scale: replay.reward_scale,
                replacement: replay.replacement,
            },
            replay_buffer: ReplayBuffer::new(replay.capacity, rows, input_size, action_size)
                .with_privileged(privileged),
            replay_settings: replay.clone(),
            history,
            normalize: policy.normalize_observations && run.from.is_none(),
            run: run.clone(),
            learning_rate: policy.learning_rate,
            normalizer: observation_normalizer(
                episodes.spec(),
                policy.normalize_observations,
                policy.std_floor,
            ),
            privileged: PrivilegedNormalizer::new(&episodes, policy.normalize_observations, policy.std_floor),
            iteration: 0,
            updates: 0,
            batch: TransitionBatch::default(),
            inference: BatchInference::new(rows, outputs, action_size),
            observations: vec![0.0; rows * input_size],
            actions: vec![0.0; rows * action_size],
            episodes,
            agent,
        })
    }
}

impl<A: Agent> OffPolicy<A> {
    /// Returns the number of environment steps before control step `step`.
    fn steps_before(&self, step: u64) -> u64 {
        step * self.episodes.rows() as u64
    }

    /// Samples the actions of control step `step`.
    fn act(&mut self, step: u64, normalizer: &Normalizer<f32>) {
        let steps = self.steps_before(step);
        let OffPolicy { agent, episodes, inference, observations, actions, .. } = self;
        let policy = agent.behavior_policy();
        observations.copy_from_slice(episodes.inputs());
        // A controller explores around what it does already.
        if steps < self.replay_settings.warmup_steps && self.run.from.is_none() {
            sample_uniform_actions(self.seed.child(WARMUP), step / policy.noise_hold(), actions);
            return;
        }
        inference.infer(policy.network(), normalizer, observations);
        episodes.held_policy_noise(policy.noise_hold(), &mut inference.noise);
        if let Some(decay) = policy.noise_decay() {
            let factor = decay.noise_factor(steps);
            inference.noise.iter_mut().for_each(|z| *z *= factor);
        }
        let rows = episodes.rows();
        let outputs = policy.network().output_size();
        let size = actions.len() / rows;
        let each = inference.outputs.par_chunks(outputs).zip(inference.noise.par_chunks(size));
        let each = each.zip(actions.par_chunks_mut(size)).enumerate().with_min_len(INFERENCE_ROWS);
        each.for_each(|(row, ((outputs, noise), action))| {
            policy.sample_action(row, rows, outputs, noise, action);
        });
    }

    fn update(&mut self, step: u64, normalizer: &Normalizer<f32>) -> Result<(), TrainingError> {
        let learns_policy = self.run.learns_policy(self.steps_before(step));
        let index = self.updates;
        let seed = self.seed.child(BATCHES);
        let rows = self.replay_settings.batch_size;
        self.replay_buffer.sample(&self.sampling, seed, index, rows, normalizer, &mut self.batch);
        let frozen = self.privileged.freeze();
        self.privileged.normalize(&frozen, &mut self.batch.privileged);
        self.privileged.normalize(&frozen, &mut self.batch.next_privileged);
        let updated = self.agent.update(&self.batch, self.seed.child(UPDATES), index, learns_policy);
        self.updates += 1;
        updated.map_err(|what| TrainingError::NotFinite { iteration: self.iteration + 1, what })
    }
}

impl<A: Agent> Learner for OffPolicy<A> {
    fn start_from(&mut self, policy: &Policy) -> Result<(), TrainingError> {
        let policy = first_policy(policy, self.agent.behavior_policy().network(), self.history)?;
        self.agent.start_from(&policy)?;
        restore_normalizer(&mut self.normalizer, &policy)
    }

    fn iteration(&self) -> u64 {
        self.iteration
    }

    fn iteration_steps(&self) -> u64 {
        self.steps_before(self.steps_per_iteration as u64)
    }

    fn iterate(&mut self) -> Result<TrainingProgress, TrainingError> {
        let start = Instant::now();
        let mut physics = 0.0;
        let mut learning = 0.0;
        let first = self.iteration * self.steps_per_iteration as u64;
        let rows = self.episodes.rows() as u64;
        for step in first..first + self.steps_per_iteration as u64 {
            let normalizer = self.history.normalizer(self.normalizer.freeze());
            self.act(step, &normalizer);
            let before = Instant::now();
            self.episodes.step(&self.actions)?;
            physics += before.elapsed().as_secs_f64();
            self.replay_buffer.push(&self.observations, &self.actions, &self.episodes);
            if self.normalize {
                let inputs = self.history.input_size();
                let columns = self.history.observation_size();
                self.normalizer.update(&first_columns(&self.observations, inputs, columns));
            }
            self.privileged.update(self.episodes.privileged_before());
            let before = Instant::now();
            while self.updates < self.replay_settings.updates_due(step + 1, rows) {
                self.update(step, &normalizer)?;
            }
            learning += before.elapsed().as_secs_f64();
        }
        self.iteration += 1;
        let total = start.elapsed().as_secs_f64();
        Ok(TrainingProgress {
            entropy: self.agent.entropy().filter(|_| self.updates > 0),
            learning_rate: self.learning_rate,
            time_shares: TimeShares::new(physics, total - learning, total),
            ..progress_of(&self.episodes.take_statistics())
        })
    }

    fn set_scenario_share(&mut self, share: f64) {
        self.episodes.set_scenario_share(share);
    }

    fn policy(&self) -> Result<Policy, TrainingError> {
        let mean = self.normalizer.mean().to_vec();
        let variance = self.normalizer.variance();
        self.agent.behavior_policy().policy(self.history.length(), mean, variance)
    }

    fn network(&self) -> &Mlp<f32> {
        self.agent.behavior_policy().network()
    }

    fn identity(&self) -> String {
        self.episodes.identity()
    }

    fn save(&mut self, checkpoint: &mut Checkpoint) -> Result<(), TrainingError> {
        checkpoint.put("iteration", vec![self.iteration]);
        checkpoint.put("updates", vec![self.updates]);
        checkpoint.put_moments("normalizer", self.normalizer.moments());
        self.privileged.save(checkpoint);
        self.agent.save(checkpoint);
        self.episodes.save(checkpoint)?;
        self.replay_buffer.save(checkpoint);
        Ok(())
    }

    fn load(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainingError> {
        self.iteration = checkpoint.u64s("iteration", 1)?[0];
        self.updates = checkpoint.u64s("updates", 1)?[0];
        let columns = self.history.observation_size();
        self.normalizer.restore(checkpoint.moments("normalizer", columns)?)?;
        self.privileged.load(checkpoint)?;
        self.agent.load(checkpoint)?;
        self.episodes.load(checkpoint)?;
        self.replay_buffer.load(checkpoint)
    }
}

/// Fills `actions` with uniform random numbers from [-1, 1], for the warm-up.
fn sample_uniform_actions(seed: Seed, step: u64, actions: &mut [f32]) {
    for (action, index) in actions.iter_mut().zip(0..) {
        *action = (2.0 * seed.uniform(Stream::Policy, step, index) - 1.0) as f32;
    }
}

/// Fills `noise`, `[rows, ..]`, with the standard normal numbers of update `index`.
pub(crate) fn sample_noise(seed: Seed, index: u64, rows: usize, noise: &mut [f64]) {
    let columns = noise.len() / rows;
    noise.par_chunks_mut(columns).with_min_len(LEARNING_ROWS).enumerate().for_each(|(row, noise)| {
        seed.normals(Stream::Policy, index * rows as u64 + row as u64, noise);
    });
}
