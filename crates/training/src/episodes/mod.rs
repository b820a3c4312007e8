//! Parallel environments that restart automatically.

mod disturbed;
mod draw;
mod privileged;
mod remembered;
mod saved;
mod supervised;

use mishandle_controllers::History;
use mishandle_rollout::{
    ActiveInterface, BatchFactory, EnvironmentBatch, EnvironmentSpec, Noise, RolloutError, Seed, Start,
    StepStatus, Stream,
};
use rayon::prelude::*;

use crate::{EpisodeSettings, ScenarioSettings, TimeoutHandling};
use disturbed::Disturbed;
use privileged::Privileged;
use remembered::Remembered;
use supervised::SupervisedRows;

pub use draw::{ScenarioDraw, ScenarioOrigin};

/// State of an episode after a control step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Boundary {
    /// The episode continues.
    Running,
    /// Termination: the value after this step is 0. The task ended the episode, or the time limit
    /// counts as termination.
    Terminated,
    /// Truncation by the time limit: the return bootstraps with the value of the final observation.
    Truncated,
}

/// Largest number of episodes of a row that are skipped one after the other because they cannot
/// start.
const STARTS: usize = 1000;

/// Index of the child seed of the episodes.
const EPISODES: u64 = 0;

/// A batch of parallel environments. An environment resets to a random initial state when its
/// episode ends.
///
/// Episode k of row r has the seed `seed.child(r).child(k)`, independent of the other rows. The
/// seed also decides the scenario. The policy sees and acts through the disturbances of the
/// scenario, as in a [`Rollout`](mishandle_rollout::Rollout) with the same scenario and seed. An
/// episode ends when the task terminates it, when it diverges (the final observation is then that
/// of the previous step), or at the time limit. With staggered starts, part of the time limit of
/// each first episode has already elapsed, so that the rows are not in phase. An episode that the
/// environment cannot start is skipped and is in no statistics.
pub struct Episodes {
    spec: EnvironmentSpec,
    batch: Box<dyn EnvironmentBatch>,
    seed: Seed,
    time_limit: usize,
    /// Boundary of an episode at the time limit.
    at_time_limit: Boundary,
    noise: Noise,
    scenarios: ScenarioDraw,
    /// Disturbances between environments and policy; `None` if no axis belongs to one.
    disturbed: Option<Disturbed>,
    /// Supervisor of the policy; `None` if it acts alone.
    supervised: Option<SupervisedRows>,
    /// Memory of the policy; `None` without a history.
    remembered: Option<Remembered>,
    /// Inputs of critics that see more than the policy; `None` if there are none.
    privileged: Option<Privileged>,
    row_states: Vec<RowState>,
    actions: Vec<f64>,
    /// Scratch buffer of the draws of the action noise.
    draws: Vec<f64>,
    rewards: Vec<f64>,
    boundaries: Vec<Boundary>,
    final_observations: Vec<f32>,
    /// Starts of the new episodes, with those that were skipped.
    starts: Vec<Start>,
    statistics: EpisodeStatistics,
}

/// Progress of a row.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct RowState {
    /// Index of the episode.
    episode: u64,
    /// Control steps since the reset; index into the random streams.
    step: u64,
    /// Control steps that count against the time limit.
    elapsed: usize,
    /// Sum of the rewards so far.
    total_reward: f64,
}

/// Statistics of all rows since the last call of [`Episodes::take_statistics`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EpisodeStatistics {
    /// Control steps of all rows.
    pub steps: u64,
    /// Sum of each reward term over these steps.
    pub reward_terms: Vec<f64>,
    /// Number of episodes that ended, without staggered first episodes.
    pub episodes: u64,
    /// Sum of the undiscounted returns of these episodes.
    pub total_reward: f64,
    /// Sum of the lengths of these episodes, control steps.
    pub total_steps: u64,
    /// Number of these episodes that the task terminated.
    pub terminated: u64,
    /// Number of episodes that diverged (a state became NaN or infinite).
    pub diverged: u64,
}

impl Episodes {
    /// Creates the environments and resets them. Statistics do not include staggered first
    /// episodes.
    ///
    /// # Errors
    /// If the batch cannot be created or reset, the space of the scenarios does not fit it, or
    /// episode after episode cannot start.
    pub fn new(
        environments: &dyn BatchFactory,
        settings: &EpisodeSettings,
        scenarios: &ScenarioSettings,
        seed: Seed,
    ) -> Result<Episodes, RolloutError> {
        let spec = environments.spec();
        let scenarios = ScenarioDraw::new(environments.scenarios(), scenarios);
        let nominal = scenarios.scenarios().space.nominal();
        let interface = scenarios.scenarios().interface(&spec.space, spec.action_size)?;
        let noise = Noise { action_std: settings.action_noise, observation_std: settings.observation_noise };
        let is_disturbed = interface.has_effects() || noise.observation_std > 0.0;
        let rows = settings.environments;
        let time_limit = settings.time_limit.unwrap_or(spec.episode_steps);
        let mut episodes = Episodes {
            actions: vec![0.0; rows * spec.action_size],
            draws: vec![0.0; rows * spec.action_size],
            rewards: vec![0.0; rows],
            boundaries: vec![Boundary::Running; rows],
            final_observations: vec![0.0; rows * spec.observation_size],
            starts: Vec::with_capacity(rows),
            disturbed: is_disturbed.then(|| Disturbed::new(interface, noise, &nominal, rows, &spec)),
            supervised: environments
                .supervisor()
                .map(|supervisor| SupervisedRows::new(supervisor, rows, spec.action_size)),
            remembered: None,
            privileged: None,
            scenarios,
            statistics: EpisodeStatistics {
                reward_terms: vec![0.0; spec.reward_terms.len()],
                ..EpisodeStatistics::default()
            },
            batch: environments.batch(rows)?,
            spec,
            seed,
            time_limit,
            at_time_limit: match settings.timeouts {
                TimeoutHandling::Bootstrap => Boundary::Truncated,
                TimeoutHandling::Terminal => Boundary::Terminated,
            },
            noise,
            row_states: vec![RowState::default(); rows],
        };
        for (row, row_state) in episodes.row_states.iter_mut().enumerate() {
            if settings.staggered {
                let fraction = seed.child(row as u64).uniform(Stream::Shuffle, 0, 0);
                row_state.elapsed = (fraction * time_limit as f64) as usize;
            }
        }
        episodes.reset_rows(|_| true)?;
        Ok(episodes)
    }

    /// Creates the environments of a training run with the seed `seed`.
    ///
    /// # Errors
    /// As for [`new`](Self::new).
    pub fn of_training(
        environments: &dyn BatchFactory,
        settings: &EpisodeSettings,
        scenarios: &ScenarioSettings,
        seed: Seed,
    ) -> Result<Episodes, RolloutError> {
        Episodes::new(environments, settings, scenarios, seed.child(EPISODES))
    }

    /// Returns the episodes for a policy whose network sees its last `length` observations and
    /// actions, as [`History`] describes. Call it before the first step.
    #[must_use]
    pub fn with_history(mut self, length: usize) -> Episodes {
        let history = History::new(length, self.spec.observation_size, self.spec.action_size);
        self.remembered = (length > 0).then(|| Remembered::new(history, self.observations()));
        self
    }

    /// Returns the episodes with the privileged inputs of a critic: the observation of the
    /// environment, without noise and disturbances, and the values of the scenario.
    #[must_use]
    pub fn with_privileged(mut self) -> Episodes {
        let space = &self.scenarios.scenarios().space;
        let mut privileged = Privileged::new(space, self.rows(), self.spec.observation_size);
        for (row, row_state) in self.row_states.iter().enumerate() {
            let (_, scenario) = self.scenarios.draw(episode_seed(self.seed, row, row_state.episode));
            privileged.start(row, &scenario);
        }
        privileged.show(self.batch.observations());
        self.privileged = Some(privileged);
        self
    }

    /// Lets new episodes draw from a share of the range of each axis around its nominal value; see
    /// [`ScenarioPart`](mishandle_rollout::ScenarioPart).
    pub fn set_scenario_share(&mut self, share: f64) {
        self.scenarios.set_share(share);
    }

    /// Returns the length of a row of privileged inputs; 0 if there are none.
    pub fn privileged_size(&self) -> usize {
        self.privileged.as_ref().map_or(0, Privileged::size)
    }

    /// Returns the privileged inputs that belong to the [observations](Self::observations),
    /// `[rows, privileged_size]`.
    pub fn privileged(&self) -> &[f32] {
        self.privileged.as_ref().map_or(&[], |inputs| &inputs.current)
    }

    /// Returns the privileged inputs before the last step, `[rows, privileged_size]`.
    pub fn privileged_before(&self) -> &[f32] {
        self.privileged.as_ref().map_or(&[], |inputs| &inputs.before)
    }

    /// Returns the privileged inputs after the last step and before any reset,
    /// `[rows, privileged_size]`.
    pub fn final_privileged(&self) -> &[f32] {
        self.privileged.as_ref().map_or(&[], |inputs| &inputs.last)
    }

    /// Returns the number of rows (parallel environments).
    pub fn rows(&self) -> usize {
        self.batch.rows()
    }

    /// Returns the specification of the environment.
    pub fn spec(&self) -> &EnvironmentSpec {
        &self.spec
    }

    /// Returns the current observations with their disturbances, `[rows, observation_size]`; after
    /// a reset, those of the new episode.
    pub fn observations(&self) -> &[f32] {
        self.disturbed.as_ref().map_or_else(|| self.batch.observations(), Disturbed::observations)
    }

    /// Returns the inputs of the policy's network, `[rows, input_size]`: each observation with the
    /// history of its row.
    pub fn inputs(&self) -> &[f32] {
        self.remembered.as_ref().map_or_else(|| self.observations(), Remembered::inputs)
    }

    /// Returns the actions of the last step that the environments got: clipped, with disturbances
    /// and noise, `[rows, action_size]`.
    pub fn applied_actions(&self) -> &[f64] {
        &self.actions
    }

    /// Returns the rewards of the last step, `[rows]`.
    pub fn rewards(&self) -> &[f64] {
        &self.rewards
    }

    /// Returns the boundary of each row after the last step.
    pub fn boundaries(&self) -> &[Boundary] {
        &self.boundaries
    }

    /// Returns the observations after the last step and before any reset, with their disturbances,
    /// `[rows, observation_size]`.
    pub fn final_observations(&self) -> &[f32] {
        &self.final_observations
    }

    /// Returns the inputs after the last step and before any reset, `[rows, input_size]`.
    pub fn final_inputs(&self) -> &[f32] {
        self.remembered.as_ref().map_or(&self.final_observations, Remembered::final_inputs)
    }

    /// Fills `noise`, `[rows, ..]`, with standard normal numbers for sampling the next actions.
    pub fn policy_noise(&self, noise: &mut [f64]) {
        self.held_policy_noise(1, noise);
    }

    /// Fills `noise` like [`policy_noise`](Self::policy_noise), but each row repeats its numbers
    /// for `hold` control steps.
    pub fn held_policy_noise(&self, hold: u64, noise: &mut [f64]) {
        let columns = noise.len() / self.rows();
        let seed = self.seed;
        let row_states = &self.row_states;
        noise.par_chunks_mut(columns).with_min_len(ROWS_PER_TASK).enumerate().for_each(|(row, noise)| {
            let row_state = &row_states[row];
            episode_seed(seed, row, row_state.episode).normals(Stream::Policy, row_state.step / hold, noise);
        });
    }

    /// Steps all rows with `actions`, `[rows, action_size]`. Actions are clipped to [-1, 1] before
    /// action noise is added.
    ///
    /// # Errors
    /// If the batch fails.
    pub fn step(&mut self, actions: &[f32]) -> Result<(), RolloutError> {
        if let Some(mut supervised) = self.supervised.take() {
            let disturbed = &self.disturbed;
            let row_states = &self.row_states;
            let is_paused = |row: usize| {
                disturbed.as_ref().is_some_and(|all| all.is_paused(row, row_states[row].step as usize))
            };
            let actions = supervised.supervise(self.observations(), actions, is_paused);
            self.set_actions(actions);
            self.supervised = Some(supervised);
        } else {
            self.set_actions(actions);
        }
        if let Some(remembered) = &mut self.remembered {
            let disturbed = &self.disturbed;
            let row_states = &self.row_states;
            remembered.push(actions, |row| {
                disturbed.as_ref().is_some_and(|all| all.is_paused(row, row_states[row].step as usize))
            });
        }
        // A diverged row keeps its observation from before the step.
        let before =
            self.disturbed.as_ref().map_or_else(|| self.batch.observations(), Disturbed::observations);
        self.final_observations.copy_from_slice(before);
        self.privileged.iter_mut().for_each(Privileged::begin_step);
        self.batch.step(&self.actions)?;
        if let Some(disturbed) = &mut self.disturbed {
            let statuses = self.batch.statuses();
            let row_states = &self.row_states;
            disturbed.observe(self.batch.observations(), |row| {
                let is_valid = statuses[row] != StepStatus::Diverged;
                is_valid.then(|| row_states[row].step as usize + 1)
            });
        }
        if let Some(privileged) = &mut self.privileged {
            privileged.end_step(self.batch.observations(), self.batch.statuses());
        }
        self.record_step();
        if let Some(remembered) = &mut self.remembered {
            remembered.finish(&self.final_observations);
        }
        self.reset_rows(|boundary| boundary != Boundary::Running)?;
        if let Some(remembered) = &mut self.remembered {
            remembered.reset(self.starts.iter().map(|start| start.row));
            let disturbed = self.disturbed.as_ref().map(Disturbed::observations);
            remembered.observe(disturbed.unwrap_or_else(|| self.batch.observations()));
        }
        Ok(())
    }

    /// Resets the rows whose boundary satisfies the condition. An episode that cannot start is
    /// skipped: the row continues with the next one.
    fn reset_rows(&mut self, resets_at: impl Fn(Boundary) -> bool + Sync) -> Result<(), RolloutError> {
        let ended = self.boundaries.iter().enumerate().filter(|(_, boundary)| resets_at(**boundary));
        let mut starting: Vec<usize> = ended.map(|(row, _)| row).collect();
        self.starts.clear();
        if starting.is_empty() {
            return Ok(());
        }
        for _ in 0..STARTS {
            let first = self.starts.len();
            for row in &starting {
                let start = self.draw_start(*row);
                self.starts.push(start);
            }
            self.batch.reset(&self.starts[first..])?;
            let statuses = self.batch.statuses();
            starting.retain(|row| statuses[*row] != StepStatus::Running);
            starting.iter().for_each(|row| self.row_states[*row].episode += 1);
            if starting.is_empty() {
                break;
            }
        }
        if !starting.is_empty() {
            return Err(RolloutError::NoStart { environment: self.spec.name.clone(), draws: STARTS });
        }
        let Episodes { batch, boundaries, disturbed, privileged, supervised, starts, .. } = self;
        if let Some(supervised) = supervised {
            // The last start of a row is the one that succeeded.
            starts.iter().for_each(|start| supervised.reset(start.row, start.seed));
        }
        if let Some(disturbed) = disturbed {
            disturbed.observe(batch.observations(), |row| resets_at(boundaries[row]).then_some(0));
        }
        if let Some(privileged) = privileged {
            privileged.show(batch.observations());
        }
        Ok(())
    }

    /// Draws the start of the episode of a row.
    fn draw_start(&mut self, row: usize) -> Start {
        let seed = episode_seed(self.seed, row, self.row_states[row].episode);
        let (_, scenario) = self.scenarios.draw(seed);
        if let Some(privileged) = &mut self.privileged {
            privileged.start(row, &scenario);
        }
        let mut start = Start { row, scenario, seed };
        if let Some(disturbed) = &mut self.disturbed {
            disturbed.start(&mut start);
        }
        start
    }

    /// Returns the statistics and sets them to 0.
    pub fn take_statistics(&mut self) -> EpisodeStatistics {
        let empty = EpisodeStatistics {
            reward_terms: vec![0.0; self.statistics.reward_terms.len()],
            ..EpisodeStatistics::default()
        };
        std::mem::replace(&mut self.statistics, empty)
    }

    fn set_actions(&mut self, actions: &[f32]) {
        let Episodes { spec, seed, noise, row_states, disturbed, actions: applied, draws, .. } = self;
        let seed = *seed;
        let noise = *noise;
        let limit = spec.action_limit;
        let row_states = &*row_states;
        let size = actions.len() / row_states.len();
        let seed = |row: usize| episode_seed(seed, row, row_states[row].episode);
        let step = |row: usize| row_states[row].step as usize;
        let rows = actions.par_chunks(size).zip(applied.par_chunks_mut(size)).zip(draws.par_chunks_mut(size));
        let rows = rows.with_min_len(ROWS_PER_TASK);
        match disturbed {
            None => rows.enumerate().for_each(|(row, ((action, applied), draws))| {
                clip(action, limit, applied);
                ActiveInterface::command(None, noise, seed(row), step(row), applied, draws);
            }),
            Some(disturbed) => {
                rows.zip(disturbed.rows_mut()).enumerate().for_each(|(row, (buffers, active))| {
                    let ((action, applied), draws) = buffers;
                    clip(active.answer(step(row), action), limit, applied);
                    ActiveInterface::command(
                        Some(&mut active.interface),
                        noise,
                        seed(row),
                        step(row),
                        applied,
                        draws,
                    );
                });
            }
        }
    }

    /// Returns the identity of the environment: its name, its reward terms, the given
    /// scenarios, and the supervisor.
    pub(crate) fn identity(&self) -> String {
        let given = self.scenarios.identity_of_given();
        let supervisor = self.supervised.as_ref().map_or(String::new(), SupervisedRows::identity);
        format!("{} ({}){given}{supervisor}", self.spec.name, self.spec.reward_terms.join(", "))
    }

    /// Computes rewards, boundaries and statistics of the last step and advances the state of each
    /// row.
    fn record_step(&mut self) {
        let terms = self.statistics.reward_terms.len();
        let observation_size = self.spec.observation_size;
        let seen = self.disturbed.as_ref().map_or_else(|| self.batch.observations(), Disturbed::observations);
        for (row, row_state) in self.row_states.iter_mut().enumerate() {
            let status = self.batch.statuses()[row];
            row_state.step += 1;
            row_state.elapsed += 1;
            self.statistics.steps += 1;
            self.rewards[row] = 0.0;
            if status == StepStatus::Diverged {
                self.statistics.diverged += 1;
            } else {
                let observation = row * observation_size..(row + 1) * observation_size;
                self.final_observations[observation.clone()].copy_from_slice(&seen[observation]);
                let rewards = &self.batch.rewards()[row * terms..][..terms];
                for (sum, reward) in self.statistics.reward_terms.iter_mut().zip(rewards) {
                    *sum += reward;
                }
                self.rewards[row] = rewards.iter().sum();
            }
            row_state.total_reward += self.rewards[row];
            self.boundaries[row] = match status {
                StepStatus::Terminated | StepStatus::Diverged | StepStatus::InvalidStart => {
                    Boundary::Terminated
                }
                StepStatus::Running if row_state.elapsed >= self.time_limit => self.at_time_limit,
                StepStatus::Running => Boundary::Running,
            };
            if self.boundaries[row] == Boundary::Running {
                continue;
            }
            let is_whole_episode = row_state.elapsed as u64 == row_state.step;
            if is_whole_episode {
                self.statistics.episodes += 1;
                self.statistics.total_reward += row_state.total_reward;
                self.statistics.total_steps += row_state.step;
                self.statistics.terminated += u64::from(status != StepStatus::Running);
            }
            *row_state = RowState { episode: row_state.episode + 1, ..RowState::default() };
        }
    }
}

/// Rows per task that draws random numbers: about 50 µs of work.
const ROWS_PER_TASK: usize = 64;

/// Clips an action to the limit of the environment.
fn clip(action: &[f32], limit: f64, clipped: &mut [f64]) {
    for (clipped, action) in clipped.iter_mut().zip(action) {
        *clipped = f64::from(*action).clamp(-limit, limit);
    }
}

fn episode_seed(seed: Seed, row: usize, episode: u64) -> Seed {
    seed.child(row as u64).child(episode)
}
