use std::sync::Arc;
use std::time::Instant;

use mishandle_controllers::Policy;
use mishandle_network::{
    Adam, CHUNK_ROWS, ChunkPool, Mlp, Normalizer, RunningNormalizer, Workspace, clip_norm,
};
use mishandle_rollout::{Environment, Seed};
use rayon::prelude::*;

use super::config::{PpoConfig, Schedule};
use super::loss::{Minibatch, RIDERS, Scratch, mean_and_scale};
use crate::critic::initial_network;
use crate::gaussian::Deviations;
use crate::{
    Buffer, Checkpoint, Critic, Episodes, Flow, Observer, Progress, Selection, Shares, Trained,
    TrainingError, gae, shuffle,
};

/// Name of the algorithm.
pub const ALGORITHM: &str = "ppo";

/// Rows that are inferred by one task: few, so that all threads have some.
const ACTING_ROWS: usize = 64;

/// The adaptive schedule keeps the step length within these.
const LEARNING_RATES: (f64, f64) = (1e-5, 1e-2);

/// Factor by which the adaptive schedule changes it.
const LEARNING_RATE_FACTOR: f64 = 1.5;

/// Trains a policy in `environment`, on the threads of the current rayon pool.
///
/// With a checkpoint of the same settings it goes on from there, to the same bits as if it had not been interrupted.
/// Only `total_steps` may differ.
///
/// # Errors
/// If a setting is out of its range, the checkpoint is another training's, or the weights stop being finite.
pub fn train(
    environment: Arc<dyn Environment>,
    config: &PpoConfig,
    seed: Seed,
    resume: Option<&Checkpoint>,
    observer: &mut dyn Observer,
) -> Result<Trained, TrainingError> {
    config.check()?;
    let mut learner = Learner::new(environment, config, seed)?;
    let mut clock = Clock { start: Instant::now(), secs_before: 0.0, steps_before: 0 };
    let mut selection = Selection::new(config.stop_success, config.stop_strict, config.stop_validations);
    let mut validation = None;
    if let Some(checkpoint) = resume {
        learner.load(checkpoint)?;
        selection.load(checkpoint, &learner.network)?;
        clock.secs_before = checkpoint.f64s("wall_clock_secs", 1)?[0];
        clock.steps_before = learner.environment_steps();
        validation = selection.best().map(|best| best.validation);
    }
    let mut ended = learner.iteration >= config.iterations() || selection.content();
    while !ended {
        let mut progress = learner.iterate()?;
        let is_last = learner.iteration >= config.iterations();
        if is_last || learner.iteration.is_multiple_of(config.validation_every) {
            let policy = learner.policy()?;
            if let Some(found) = observer.validate(&policy, config.validation_episodes) {
                selection.offer(&policy, found, learner.environment_steps());
                validation = Some(found);
                progress.validation_is_fresh = true;
            }
        }
        progress.validation = validation;
        clock.tell(&mut progress);
        let flow = observer.progress(&progress);
        ended = flow == Flow::Stop || is_last || selection.content();
        if ended || flow == Flow::Save || learner.iteration.is_multiple_of(config.checkpoint_every) {
            let mut checkpoint = learner.checkpoint();
            selection.save(&mut checkpoint);
            checkpoint.put("wall_clock_secs", vec![clock.secs()]);
            observer.checkpoint(&checkpoint);
        }
    }
    let last = learner.policy()?;
    let best = selection.best();
    Ok(Trained {
        best: best.map_or_else(|| last.clone(), |best| best.policy.clone()),
        best_validation: best.map(|best| best.validation),
        best_environment_steps: best.map_or(learner.environment_steps(), |best| best.environment_steps),
        last,
        environment_steps: learner.environment_steps(),
        wall_clock_secs: clock.secs(),
        reached: selection.content(),
    })
}

/// The time of this run, and what went before it.
struct Clock {
    start: Instant,
    secs_before: f64,
    steps_before: u64,
}

impl Clock {
    fn secs(&self) -> f64 {
        self.secs_before + self.start.elapsed().as_secs_f64()
    }

    fn tell(&self, progress: &mut Progress) {
        let elapsed = self.start.elapsed().as_secs_f64();
        progress.wall_clock_secs = self.secs_before + elapsed;
        progress.steps_per_second = (progress.environment_steps - self.steps_before) as f64 / elapsed;
    }
}

/// Policy, critic, and the episodes they learn from.
struct Learner<'a> {
    config: &'a PpoConfig,
    seed: Seed,
    episodes: Episodes,
    buffer: Buffer,
    normalizer: RunningNormalizer,
    network: Mlp<f32>,
    log_std: Vec<f32>,
    network_adam: Adam<f32>,
    log_std_adam: Adam<f32>,
    critic: Critic,
    iteration: u64,
    acting: Acting,
    learning: Learning,
}

/// Scratch for choosing actions.
struct Acting {
    pool: ChunkPool<f32, (Vec<f32>, Workspace<f32>)>,
    means: Vec<f32>,
    draws: Vec<f64>,
}

/// Scratch for learning.
struct Learning {
    pool: ChunkPool<f32, Scratch>,
    gradient: Vec<f32>,
    order: Vec<u32>,
    targets: Vec<f32>,
    returns: Vec<f64>,
    last_values: Vec<f64>,
    truncated_values: Vec<f64>,
}

/// Children of the training's seed.
const EPISODES: u64 = 0;
const POLICY_WEIGHTS: u64 = 1;
const CRITIC_WEIGHTS: u64 = 2;
const MINIBATCHES: u64 = 3;

impl<'a> Learner<'a> {
    fn new(
        environment: Arc<dyn Environment>,
        config: &'a PpoConfig,
        seed: Seed,
    ) -> Result<Learner<'a>, TrainingError> {
        let (inputs, outputs) = (environment.observation_size(), environment.action_size());
        let time_limit = config.episode_steps.unwrap_or(environment.episode_steps());
        let rows = config.environments;
        let episodes = Episodes::new(
            environment,
            rows,
            seed.child(EPISODES),
            time_limit,
            config.action_noise,
            config.staggered,
        );
        let activation = config.activation;
        // A small last layer, so that the first actions are near the middle whatever is seen.
        let network = initial_network(
            inputs,
            &config.policy_hidden,
            outputs,
            activation,
            0.01,
            seed.child(POLICY_WEIGHTS),
        )?;
        let critic = Critic::new(
            inputs,
            &config.value_hidden,
            activation,
            config.value_learning_rate,
            config.normalize_values,
            seed.child(CRITIC_WEIGHTS),
        )?;
        let buffer = Buffer::new(config.rollout_steps, rows, inputs, outputs);
        let gradient = network.parameter_count() + outputs + critic.network().parameter_count() + RIDERS;
        Ok(Learner {
            config,
            seed,
            normalizer: RunningNormalizer::new(inputs),
            log_std: vec![config.initial_log_std as f32; outputs],
            network_adam: Adam::new(network.parameter_count(), config.learning_rate),
            log_std_adam: Adam::new(outputs, config.learning_rate),
            network,
            critic,
            iteration: 0,
            acting: Acting {
                pool: ChunkPool::new(ACTING_ROWS),
                means: vec![0.0; rows * outputs],
                draws: vec![0.0; rows * outputs],
            },
            learning: Learning {
                pool: ChunkPool::new(CHUNK_ROWS),
                gradient: vec![0.0; gradient],
                order: vec![0; buffer.count()],
                targets: Vec::new(),
                returns: Vec::new(),
                last_values: vec![0.0; rows],
                truncated_values: Vec::new(),
            },
            buffer,
            episodes,
        })
    }

    fn environment_steps(&self) -> u64 {
        self.iteration * self.config.iteration_steps()
    }

    fn policy(&self) -> Result<Policy, TrainingError> {
        let (mean, variance) = (self.normalizer.mean().to_vec(), self.normalizer.variance());
        Ok(Policy::new(mean, variance, self.network.clone(), self.log_std.clone())?)
    }

    /// A rollout and what is learned from it.
    fn iterate(&mut self) -> Result<Progress, TrainingError> {
        let start = Instant::now();
        let normalizer = self.normalizer.freeze();
        let physics_secs = self.roll_out(&normalizer);
        let acted = start.elapsed().as_secs_f64();
        self.estimate(&normalizer);
        let kl = self.learn(&normalizer)?;
        if self.config.normalize_observations {
            self.normalizer.merge(&self.buffer.observation_moments());
        }
        self.iteration += 1;
        let total = start.elapsed().as_secs_f64();
        let statistics = self.episodes.take_statistics();
        let mean = |sum: f64| (statistics.episodes > 0).then(|| sum / statistics.episodes as f64);
        Ok(Progress {
            iteration: self.iteration,
            environment_steps: self.environment_steps(),
            total_steps: self.config.total_steps,
            steps_per_second: 0.0,
            wall_clock_secs: 0.0,
            mean_return: mean(statistics.total_reward),
            mean_episode_steps: mean(statistics.total_steps as f64),
            terminated_rate: mean(statistics.terminated as f64),
            diverged: statistics.diverged,
            reward_terms: statistics.reward_terms.iter().map(|sum| sum / statistics.steps as f64).collect(),
            validation: None,
            validation_is_fresh: false,
            kl,
            entropy: Deviations::new(&self.log_std).entropy(),
            learning_rate: self.network_adam.learning_rate,
            shares: Shares {
                physics: physics_secs / total,
                inference: (acted - physics_secs) / total,
                learning: (total - acted) / total,
            },
        })
    }

    /// Fills the buffer; gives the time that the environment took, s.
    fn roll_out(&mut self, normalizer: &Normalizer<f32>) -> f64 {
        let deviations = Deviations::new(&self.log_std);
        let mut physics_secs = 0.0;
        self.buffer.clear();
        for _ in 0..self.config.rollout_steps {
            let (seen, actions, log_probs) = self.buffer.begin_step(&self.episodes);
            self.episodes.policy_draws(&mut self.acting.draws);
            self.acting.act(&self.network, normalizer, &deviations, seen, actions, log_probs);
            let start = Instant::now();
            self.episodes.step(self.buffer.step_actions());
            physics_secs += start.elapsed().as_secs_f64();
            self.buffer.end_step(&self.episodes);
        }
        physics_secs
    }

    /// Values and advantages of the rollout, and the critic's targets.
    fn estimate(&mut self, normalizer: &Normalizer<f32>) {
        let Learner { buffer, critic, learning, config, .. } = self;
        critic.values(normalizer, &buffer.observations, &mut buffer.values);
        critic.values(normalizer, self.episodes.observations(), &mut learning.last_values);
        learning.truncated_values.resize(buffer.truncated.len(), 0.0);
        critic.values(normalizer, &buffer.truncated_observations, &mut learning.truncated_values);
        buffer.set_next_values(&learning.last_values, &learning.truncated_values);
        gae::advantages(
            config.gamma,
            config.gae_lambda,
            config.environments,
            &buffer.rewards,
            &buffer.values,
            &buffer.next_values,
            &buffer.boundaries,
            &mut buffer.advantages,
        );
        let returns =
            buffer.advantages.iter().zip(&buffer.values).map(|(advantage, value)| advantage + value);
        critic.targets(returns, &mut learning.targets, &mut learning.returns);
    }

    /// All epochs; gives the mean divergence in the last.
    fn learn(&mut self, normalizer: &Normalizer<f32>) -> Result<f64, TrainingError> {
        let config = self.config;
        if config.learning_rate_schedule == Schedule::Linear {
            let left = 1.0 - self.iteration as f64 / config.iterations() as f64;
            self.set_learning_rate(left * config.learning_rate);
            self.critic.set_learning_rate(left * config.value_learning_rate);
        }
        let mut kl = 0.0;
        for epoch in 0..config.epochs as u64 {
            let index = self.iteration * config.epochs as u64 + epoch;
            shuffle(self.seed.child(MINIBATCHES), index, &mut self.learning.order);
            let rows = self.learning.order.len();
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
        let Learning { pool, gradient, order, targets, .. } = &mut self.learning;
        let order = &order[rows];
        let (advantage_mean, advantage_scale) = mean_and_scale(&self.buffer.advantages, order);
        let deviations = Deviations::new(&self.log_std);
        let minibatch = Minibatch {
            buffer: &self.buffer,
            targets,
            order,
            advantage_mean,
            advantage_scale,
            normalizer,
            policy: &self.network,
            deviations: &deviations,
            critic: self.critic.network(),
            clip_epsilon: self.config.clip_epsilon,
            entropy_coef: self.config.entropy_coef,
        };
        pool.sum(order.len(), gradient, |rows, scratch, gradient| {
            minibatch.add_gradient(rows, scratch, gradient);
        });
        let (by_policy, rest) = gradient.split_at_mut(self.network.parameter_count() + self.log_std.len());
        let (by_critic, riders) = rest.split_at_mut(rest.len() - RIDERS);
        for (what, number) in [("the policy's divergence", riders[0]), ("the critic's loss", riders[1])] {
            if !number.is_finite() {
                return Err(TrainingError::NotFinite { iteration: self.iteration + 1, what });
            }
        }
        clip_norm(by_policy, self.config.max_grad_norm);
        clip_norm(by_critic, self.config.max_grad_norm);
        let (by_network, by_log_std) = by_policy.split_at(self.network.parameter_count());
        let adam = &mut self.network_adam;
        self.network.update(|parameters| adam.step(parameters, by_network));
        self.log_std_adam.step(&mut self.log_std, by_log_std);
        let (low, high) = (self.config.min_log_std as f32, self.config.max_log_std as f32);
        for log_std in &mut self.log_std {
            *log_std = log_std.clamp(low, high);
        }
        self.critic.step(by_critic);
        Ok(f64::from(riders[0]))
    }

    fn checkpoint(&self) -> Checkpoint {
        let settings = self.config.to_toml();
        let mut checkpoint = Checkpoint::new(ALGORITHM, &self.episodes.identity(), self.seed.0, &settings);
        checkpoint.put("iteration", vec![self.iteration]);
        checkpoint.put("policy.parameters", self.network.parameters().to_vec());
        checkpoint.put("policy.log_std", self.log_std.clone());
        checkpoint.put_adam("policy.adam", &self.network_adam);
        checkpoint.put_adam("policy.log_std_adam", &self.log_std_adam);
        checkpoint.put_moments("normalizer", self.normalizer.moments());
        self.critic.save(&mut checkpoint);
        self.episodes.save(&mut checkpoint);
        checkpoint
    }

    fn load(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainingError> {
        checkpoint.check(ALGORITHM, &self.episodes.identity(), self.seed.0)?;
        let began = PpoConfig::from_toml(checkpoint.settings())?;
        if (PpoConfig { total_steps: self.config.total_steps, ..began.clone() }) != *self.config {
            return Err(TrainingError::OtherTraining {
                what: "settings",
                wanted: without(&self.config.to_toml(), &began.to_toml()),
                found: without(&began.to_toml(), &self.config.to_toml()),
            });
        }
        let (parameters, actions) = (self.network.parameter_count(), self.log_std.len());
        self.iteration = checkpoint.u64s("iteration", 1)?[0];
        let own = checkpoint.f32s("policy.parameters", parameters)?;
        self.network.update(|parameters| parameters.copy_from_slice(own));
        self.log_std = checkpoint.f32s("policy.log_std", actions)?.to_vec();
        self.network_adam = checkpoint.adam("policy.adam", parameters)?;
        self.log_std_adam = checkpoint.adam("policy.log_std_adam", actions)?;
        let columns = self.network.input_size();
        self.normalizer = RunningNormalizer::from_moments(checkpoint.moments("normalizer", columns)?)?;
        self.critic.load(checkpoint)?;
        self.episodes.load(checkpoint)
    }
}

impl Acting {
    /// Draws an action for each row of `seen`, and gives the logarithms of their densities.
    fn act(
        &mut self,
        network: &Mlp<f32>,
        normalizer: &Normalizer<f32>,
        deviations: &Deviations,
        seen: &[f32],
        actions: &mut [f32],
        log_probs: &mut [f64],
    ) {
        let (columns, size) = (network.input_size(), network.output_size());
        self.pool.map(log_probs.len(), &mut self.means, |rows, (inputs, workspace), means| {
            inputs.clear();
            inputs.extend_from_slice(&seen[rows.start * columns..rows.end * columns]);
            normalizer.normalize(inputs);
            means.copy_from_slice(network.forward(inputs, workspace));
        });
        let rows = self.means.par_chunks(size).zip(self.draws.par_chunks(size));
        let rows = rows.zip(actions.par_chunks_mut(size)).zip(log_probs);
        rows.with_min_len(ACTING_ROWS).for_each(|(((means, draws), actions), log_prob)| {
            let noise = deviations.std().iter().zip(draws).map(|(std, draw)| std * draw);
            for ((action, mean), noise) in actions.iter_mut().zip(means).zip(noise) {
                *action = (f64::from(*mean) + noise) as f32;
            }
            *log_prob = deviations.log_prob(means, actions);
        });
    }
}

/// The lines of `settings` that `others` lack, but for the number of steps, which may differ.
fn without(settings: &str, others: &str) -> String {
    let differs =
        |line: &&str| !others.lines().any(|other| other == *line) && !line.starts_with("total_steps");
    let lines: Vec<&str> = settings.lines().filter(differs).collect();
    if lines.is_empty() { "the default".to_string() } else { lines.join(", ") }
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
