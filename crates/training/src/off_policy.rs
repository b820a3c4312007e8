//! What off-policy algorithms share: acting, remembering, and updates in proportion to the steps made.

use std::time::Instant;

use mishandle_controllers::Policy;
use mishandle_network::{Mlp, Normalizer, RunningNormalizer};
use mishandle_rollout::{BatchFactory, EnvironmentSpec, Seed, Stream};
use rayon::prelude::*;

use crate::acting::{ACTING_ROWS, Acting};
use crate::agent::{Agent, Explorer, Setup, Shared};
use crate::algorithm::{Common, FromSettings};
use crate::batch::Batch;
use crate::batch_gradient::LEARNING_ROWS;
use crate::learner::{Learner, progress_of};
use crate::replay::{Replay, Sampling};
use crate::{Checkpoint, Episodes, MemoryNeed, Progress, ReplaySettings, Shares, TrainingError};

/// Children of the training's seed; its episodes have 0.
const BATCHES: u64 = 3;
const UPDATES: u64 = 4;
const WARMUP: u64 = 5;

/// An off-policy algorithm at work.
pub(crate) struct OffPolicy<A> {
    agent: A,
    seed: Seed,
    steps_per_iteration: usize,
    replay_settings: ReplaySettings,
    sampling: Sampling,
    normalize: bool,
    learning_rate: f64,
    episodes: Episodes,
    replay: Replay,
    normalizer: RunningNormalizer,
    iteration: u64,
    updates: u64,
    batch: Batch<f32>,
    acting: Acting,
    /// What was seen before the last control step, and what was done, within [-1, 1].
    seen: Vec<f32>,
    actions: Vec<f32>,
}

impl<A: Agent> FromSettings for OffPolicy<A> {
    type Settings = A::Config;

    fn common(config: &A::Config) -> Common<'_> {
        let Setup { run, episodes, policy, critic, .. } = config.setup();
        Common { run, episodes, hidden: [&policy.hidden, &critic.hidden] }
    }

    /// A [`Replay`], and what is filled of it thrice while a checkpoint is written: as numbers, as the bytes of each, and
    /// as those of the file; and a batch of it: what was seen before and after, and what was done.
    fn experience_memory(config: &A::Config, environment: &EnvironmentSpec) -> Vec<MemoryNeed> {
        let Setup { run, replay, .. } = config.setup();
        let (seen, done) = (environment.observation_size as f64, environment.action_size as f64);
        let capacity = replay.capacity as f64;
        let filled = capacity.min(run.total_steps as f64);
        let entry = 4.0 * (seen + done + 1.0) + 1.0;
        let batch = replay.batch_rows as f64 * 4.0 * (2.0 * seen + done);
        vec![
            MemoryNeed { settings: "replay.capacity", bytes: (capacity + 3.0 * filled) * entry },
            MemoryNeed { settings: "replay.batch_rows", bytes: batch },
        ]
    }

    fn start(
        config: &A::Config,
        environments: &dyn BatchFactory,
        seed: Seed,
    ) -> Result<OffPolicy<A>, TrainingError> {
        let Setup { gamma, steps_per_iteration, episodes, replay, policy, .. } = config.setup();
        let rows = episodes.environments;
        let episodes = Episodes::of_training(environments, episodes, seed)?;
        let (inputs, size) = (episodes.spec().observation_size, episodes.spec().action_size);
        let agent = A::new((inputs, size), config, seed)?;
        Ok(OffPolicy {
            seed,
            steps_per_iteration,
            sampling: Sampling {
                n_steps: replay.n_steps,
                gamma,
                reward_scale: replay.reward_scale,
                replacement: replay.replacement,
            },
            replay: Replay::new(replay.capacity, rows, inputs, size),
            replay_settings: replay.clone(),
            normalize: policy.normalize_observations,
            learning_rate: policy.learning_rate,
            normalizer: RunningNormalizer::new(inputs),
            iteration: 0,
            updates: 0,
            batch: Batch::default(),
            acting: Acting::new(rows, agent.explorer().network().output_size(), size),
            seen: vec![0.0; rows * inputs],
            actions: vec![0.0; rows * size],
            episodes,
            agent,
        })
    }
}

impl<A: Agent> OffPolicy<A> {
    /// Environment steps before the control step numbered `step`.
    fn steps_before(&self, step: u64) -> u64 {
        step * self.episodes.rows() as u64
    }

    /// Chooses the actions of the control step numbered `step`, from what is seen.
    fn act(&mut self, step: u64, normalizer: &Normalizer<f32>) {
        let steps = self.steps_before(step);
        let OffPolicy { agent, episodes, acting, seen, actions, .. } = self;
        let explorer = agent.explorer();
        seen.copy_from_slice(episodes.observations());
        if steps < self.replay_settings.warmup_steps {
            act_randomly(self.seed.child(WARMUP), step / explorer.hold(), actions);
            return;
        }
        acting.infer(explorer.network(), normalizer, seen);
        episodes.held_policy_draws(explorer.hold(), &mut acting.draws);
        if let Some(decay) = explorer.decay() {
            let share = decay.share_after(steps);
            acting.draws.iter_mut().for_each(|z| *z *= share);
        }
        let rows = episodes.rows();
        let (outputs, size) = (explorer.network().output_size(), actions.len() / rows);
        let each = acting.outputs.par_chunks(outputs).zip(acting.draws.par_chunks(size));
        let each = each.zip(actions.par_chunks_mut(size)).enumerate().with_min_len(ACTING_ROWS);
        each.for_each(|(row, ((outputs, draws), action))| {
            explorer.explore(row, rows, outputs, draws, action);
        });
    }

    fn update(&mut self, normalizer: &Normalizer<f32>) -> Result<(), TrainingError> {
        let batches = (self.seed.child(BATCHES), self.updates);
        let rows = self.replay_settings.batch_rows;
        self.replay.sample(&self.sampling, batches, rows, normalizer, &mut self.batch);
        let updated = self.agent.update(&self.batch, self.seed.child(UPDATES), self.updates);
        self.updates += 1;
        updated.map_err(|what| TrainingError::NotFinite { iteration: self.iteration + 1, what })
    }
}

impl<A: Agent> Learner for OffPolicy<A> {
    fn iteration(&self) -> u64 {
        self.iteration
    }

    fn iteration_steps(&self) -> u64 {
        self.steps_before(self.steps_per_iteration as u64)
    }

    fn iterate(&mut self) -> Result<Progress, TrainingError> {
        let start = Instant::now();
        let (mut physics, mut learning) = (0.0, 0.0);
        let first = self.iteration * self.steps_per_iteration as u64;
        let rows = self.episodes.rows() as u64;
        for step in first..first + self.steps_per_iteration as u64 {
            let normalizer = self.normalizer.freeze();
            self.act(step, &normalizer);
            let before = Instant::now();
            self.episodes.step(&self.actions)?;
            physics += before.elapsed().as_secs_f64();
            self.replay.push(&self.seen, &self.actions, &self.episodes);
            if self.normalize {
                self.normalizer.update(&self.seen);
            }
            let before = Instant::now();
            while self.updates < self.replay_settings.updates_due(step + 1, rows) {
                self.update(&normalizer)?;
            }
            learning += before.elapsed().as_secs_f64();
        }
        self.iteration += 1;
        let total = start.elapsed().as_secs_f64();
        Ok(Progress {
            entropy: self.agent.entropy().filter(|_| self.updates > 0),
            learning_rate: self.learning_rate,
            shares: Shares::new(physics, total - learning, total),
            ..progress_of(&self.episodes.take_statistics())
        })
    }

    fn policy(&self) -> Result<Policy, TrainingError> {
        self.agent.explorer().policy(self.normalizer.mean().to_vec(), self.normalizer.variance())
    }

    fn network(&self) -> &Mlp<f32> {
        self.agent.explorer().network()
    }

    fn identity(&self) -> String {
        self.episodes.identity()
    }

    fn save(&mut self, checkpoint: &mut Checkpoint) -> Result<(), TrainingError> {
        checkpoint.put("iteration", vec![self.iteration]);
        checkpoint.put("updates", vec![self.updates]);
        checkpoint.put_moments("normalizer", self.normalizer.moments());
        self.agent.save(checkpoint);
        self.episodes.save(checkpoint)?;
        self.replay.save(checkpoint);
        Ok(())
    }

    fn load(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainingError> {
        self.iteration = checkpoint.u64s("iteration", 1)?[0];
        self.updates = checkpoint.u64s("updates", 1)?[0];
        let columns = self.agent.explorer().network().input_size();
        self.normalizer = RunningNormalizer::from_moments(checkpoint.moments("normalizer", columns)?)?;
        self.agent.load(checkpoint)?;
        self.episodes.load(checkpoint)?;
        self.replay.load(checkpoint)
    }
}

/// Fills `actions` with numbers drawn uniformly from [-1, 1], for warming up.
fn act_randomly(seed: Seed, step: u64, actions: &mut [f32]) {
    for (action, index) in actions.iter_mut().zip(0..) {
        *action = (2.0 * seed.uniform(Stream::Policy, step, index) - 1.0) as f32;
    }
}

/// Fills `draws` with standard normal numbers, as many for each of `rows` rows: those of the update numbered `index`.
pub(crate) fn draw_rows(seed: Seed, index: u64, rows: usize, draws: &mut [f64]) {
    let columns = draws.len() / rows;
    draws.par_chunks_mut(columns).with_min_len(LEARNING_ROWS).enumerate().for_each(|(row, draws)| {
        seed.normals(Stream::Policy, index * rows as u64 + row as u64, draws);
    });
}
