//! Rows of never-ending episodes: what on-policy and off-policy learners act in.

mod saved;

use mishandle_rollout::{
    BatchFactory, EnvironmentBatch, EnvironmentSpec, RolloutError, Seed, StepStatus, Stream,
};
use rayon::prelude::*;

use crate::{EpisodeSettings, TimeLimits};

/// How a control step left an episode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Boundary {
    /// It goes on.
    Running,
    /// Nothing of value follows: the task ended it, or the clock did and is taken for the task.
    Terminated,
    /// The clock ended it: what would have followed has its value.
    Truncated,
}

/// The child of a training's seed that its episodes are drawn from.
const EPISODES: u64 = 0;

/// A batch of simulations that start anew, at random initial configurations, when they end.
///
/// Episode k of row r is that of seed `seed.child(r).child(k)`, whatever happens in other rows. An episode ends where
/// the task is lost, where it diverges (its last observation is then the one before), or at the time limit. First
/// episodes may begin with part of their time gone by, so that the rows are not in step.
pub struct Episodes {
    spec: EnvironmentSpec,
    batch: Box<dyn EnvironmentBatch>,
    seed: Seed,
    time_limit: usize,
    /// How the clock ends an episode.
    at_time_limit: Boundary,
    action_noise: f64,
    clocks: Vec<Clock>,
    actions: Vec<f64>,
    rewards: Vec<f64>,
    boundaries: Vec<Boundary>,
    final_observations: Vec<f32>,
    /// The rows that are about to start a new episode, with its seed.
    resets: Vec<(usize, Seed)>,
    statistics: EpisodeStatistics,
}

/// Where a row stands.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Clock {
    /// Number of the row's episode.
    episode: u64,
    /// Control steps since its reset: the step of its random streams.
    step: u64,
    /// Control steps that count against the time limit.
    elapsed: usize,
    /// Rewards so far.
    total_reward: f64,
}

/// What happened since the statistics were last taken.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EpisodeStatistics {
    /// Control steps, over all rows.
    pub steps: u64,
    /// Sums of the reward terms over these steps.
    pub reward_terms: Vec<f64>,
    /// Episodes that ended, of those that had their whole time.
    pub episodes: u64,
    /// Sum of their rewards.
    pub total_reward: f64,
    /// Sum of their control steps.
    pub total_steps: u64,
    /// Episodes that the task ended.
    pub terminated: u64,
    /// Episodes whose numbers stopped being finite.
    pub diverged: u64,
}

impl Episodes {
    /// Fresh episodes. A staggered first one, which has only a random part of its time, is not counted.
    ///
    /// # Errors
    /// If the batch cannot be made or reset.
    pub fn new(
        environments: &dyn BatchFactory,
        settings: &EpisodeSettings,
        seed: Seed,
    ) -> Result<Episodes, RolloutError> {
        let spec = environments.spec();
        let rows = settings.environments;
        let time_limit = settings.time_limit.unwrap_or(spec.episode_steps);
        let mut episodes = Episodes {
            actions: vec![0.0; rows * spec.action_size],
            rewards: vec![0.0; rows],
            boundaries: vec![Boundary::Running; rows],
            final_observations: vec![0.0; rows * spec.observation_size],
            resets: Vec::with_capacity(rows),
            statistics: EpisodeStatistics {
                reward_terms: vec![0.0; spec.reward_terms.len()],
                ..EpisodeStatistics::default()
            },
            batch: environments.batch(rows)?,
            spec,
            seed,
            time_limit,
            at_time_limit: match settings.time_limits {
                TimeLimits::Bootstrap => Boundary::Truncated,
                TimeLimits::Terminal => Boundary::Terminated,
            },
            action_noise: settings.action_noise,
            clocks: vec![Clock::default(); rows],
        };
        for (row, clock) in episodes.clocks.iter_mut().enumerate() {
            if settings.staggered {
                let part = seed.child(row as u64).uniform(Stream::Shuffle, 0, 0);
                clock.elapsed = (part * time_limit as f64) as usize;
            }
        }
        episodes.reset_rows(|_| true)?;
        Ok(episodes)
    }

    /// The episodes that a training with the seed `seed` acts in under `settings`.
    ///
    /// # Errors
    /// If the batch cannot be made or reset.
    pub fn of_training(
        environments: &dyn BatchFactory,
        settings: &EpisodeSettings,
        seed: Seed,
    ) -> Result<Episodes, RolloutError> {
        Episodes::new(environments, settings, seed.child(EPISODES))
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.batch.rows()
    }

    /// The facts about the environment.
    pub fn spec(&self) -> &EnvironmentSpec {
        &self.spec
    }

    /// What each row shows now, `[rows, observation_size]`; of a fresh episode where one has just ended.
    pub fn observations(&self) -> &[f32] {
        self.batch.observations()
    }

    /// Rewards of the last step.
    pub fn rewards(&self) -> &[f64] {
        &self.rewards
    }

    /// How the last step left each row's episode.
    pub fn boundaries(&self) -> &[Boundary] {
        &self.boundaries
    }

    /// What each row showed after the last step, before any reset, `[rows, observation_size]`.
    pub fn final_observations(&self) -> &[f32] {
        &self.final_observations
    }

    /// Fills `draws`, as many for each row, with standard normal numbers for a policy's choice of the next action.
    pub fn policy_draws(&self, draws: &mut [f64]) {
        self.held_policy_draws(1, draws);
    }

    /// The same, but each row keeps its numbers for `hold` control steps of its episode.
    pub fn held_policy_draws(&self, hold: u64, draws: &mut [f64]) {
        let (columns, seed, clocks) = (draws.len() / self.rows(), self.seed, &self.clocks);
        draws.par_chunks_mut(columns).with_min_len(ROWS_PER_TASK).enumerate().for_each(|(row, draws)| {
            let clock = &clocks[row];
            episode_seed(seed, row, clock).normals(Stream::Policy, clock.step / hold, draws);
        });
    }

    /// Carries every row on under `actions`, `[rows, action_size]`: clipped to [-1, 1], with noise, not clipped again.
    ///
    /// # Errors
    /// If the batch fails as a whole.
    pub fn step(&mut self, actions: &[f32]) -> Result<(), RolloutError> {
        self.set_actions(actions);
        // What a diverged row showed before is all that is left of it.
        self.final_observations.copy_from_slice(self.batch.observations());
        self.batch.step(&self.actions)?;
        self.judge();
        self.reset_rows(|boundary| boundary != Boundary::Running)
    }

    /// Starts a new episode in each row whose last step left it so.
    fn reset_rows(&mut self, starts_anew: impl Fn(Boundary) -> bool) -> Result<(), RolloutError> {
        let Episodes { batch, clocks, boundaries, resets, seed, .. } = self;
        resets.clear();
        let ended = boundaries.iter().enumerate().filter(|(_, boundary)| starts_anew(**boundary));
        resets.extend(ended.map(|(row, _)| (row, episode_seed(*seed, row, &clocks[row]))));
        if resets.is_empty() { Ok(()) } else { batch.reset(resets) }
    }

    /// What happened since this was last asked.
    pub fn take_statistics(&mut self) -> EpisodeStatistics {
        let fresh = EpisodeStatistics {
            reward_terms: vec![0.0; self.statistics.reward_terms.len()],
            ..EpisodeStatistics::default()
        };
        std::mem::replace(&mut self.statistics, fresh)
    }

    fn set_actions(&mut self, actions: &[f32]) {
        let Episodes { seed, action_noise, clocks, actions: noisy_actions, .. } = self;
        let (seed, action_noise, clocks) = (*seed, *action_noise, &*clocks);
        let size = actions.len() / clocks.len();
        let rows =
            noisy_actions.par_chunks_mut(size).zip(actions.par_chunks(size)).with_min_len(ROWS_PER_TASK);
        rows.enumerate().for_each(|(row, (noisy, actions))| {
            if action_noise > 0.0 {
                let clock = &clocks[row];
                episode_seed(seed, row, clock).normals(Stream::ActionNoise, clock.step, noisy);
            }
            for (noisy, action) in noisy.iter_mut().zip(actions) {
                let noise = if action_noise > 0.0 { action_noise * *noisy } else { 0.0 };
                *noisy = f64::from(*action).clamp(-1.0, 1.0) + noise;
            }
        });
    }

    /// What tells this environment from another: its name and the terms of its reward.
    pub(crate) fn identity(&self) -> String {
        format!("{} ({})", self.spec.name, self.spec.reward_terms.join(", "))
    }

    /// Rewards, boundaries and statistics of the step just made; moves the clocks.
    fn judge(&mut self) {
        let terms = self.statistics.reward_terms.len();
        let observation_size = self.spec.observation_size;
        for (row, clock) in self.clocks.iter_mut().enumerate() {
            let status = self.batch.statuses()[row];
            clock.step += 1;
            clock.elapsed += 1;
            self.statistics.steps += 1;
            self.rewards[row] = 0.0;
            if status == StepStatus::Diverged {
                self.statistics.diverged += 1;
            } else {
                let observation = row * observation_size..(row + 1) * observation_size;
                self.final_observations[observation.clone()]
                    .copy_from_slice(&self.batch.observations()[observation]);
                let rewards = &self.batch.rewards()[row * terms..][..terms];
                for (sum, reward) in self.statistics.reward_terms.iter_mut().zip(rewards) {
                    *sum += reward;
                }
                self.rewards[row] = rewards.iter().sum();
            }
            clock.total_reward += self.rewards[row];
            self.boundaries[row] = match status {
                StepStatus::Terminated | StepStatus::Diverged => Boundary::Terminated,
                StepStatus::Running if clock.elapsed >= self.time_limit => self.at_time_limit,
                StepStatus::Running => Boundary::Running,
            };
            if self.boundaries[row] == Boundary::Running {
                continue;
            }
            let had_its_whole_time = clock.elapsed as u64 == clock.step;
            if had_its_whole_time {
                self.statistics.episodes += 1;
                self.statistics.total_reward += clock.total_reward;
                self.statistics.total_steps += clock.step;
                self.statistics.terminated += u64::from(status != StepStatus::Running);
            }
            *clock = Clock { episode: clock.episode + 1, ..Clock::default() };
        }
    }
}

/// Rows whose random numbers one task draws: about 50 us of work.
const ROWS_PER_TASK: usize = 64;

fn episode_seed(seed: Seed, row: usize, clock: &Clock) -> Seed {
    seed.child(row as u64).child(clock.episode)
}
