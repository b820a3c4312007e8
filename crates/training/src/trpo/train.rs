use std::sync::Arc;
use std::time::Instant;

use mishandle_controllers::Policy;
use mishandle_network::{CHUNK_ROWS, ChunkPool, Mlp, Normalizer};
use mishandle_rollout::{Environment, Seed};

use super::config::TrpoConfig;
use super::loss::{Batch, Gaussian, Scratch};
use crate::conjugate_gradient::{conjugate_gradient, dot};
use crate::gaussian::Deviations;
use crate::learner::{Learner, Trainable, progress_of};
use crate::on_policy::{OnPolicy, Setup, mean_and_scale};
use crate::{Checkpoint, Progress, Shares, TrainingError, shuffle};

/// The child of the training's seed that shuffles the critic's minibatches; the others are those of [`OnPolicy`].
const MINIBATCHES: u64 = 3;

impl Trainable for TrpoConfig {
    fn learner(&self, environment: Arc<dyn Environment>, seed: Seed) -> Result<impl Learner, TrainingError> {
        Trpo::new(environment, self, seed)
    }
}

struct Trpo<'a> {
    config: &'a TrpoConfig,
    seed: Seed,
    common: OnPolicy,
    iteration: u64,
    pool: ChunkPool<f32, Scratch>,
    outcome_pool: ChunkPool<f64, Scratch>,
    old_means: Vec<f32>,
    order: Vec<u32>,
}

/// What a step of the policy did.
struct Step {
    kl: f64,
    /// The share of the longest step that was taken; 0 if none was good enough.
    fraction: f64,
}

impl<'a> Trpo<'a> {
    fn new(
        environment: Arc<dyn Environment>,
        config: &'a TrpoConfig,
        seed: Seed,
    ) -> Result<Trpo<'a>, TrainingError> {
        let setup = Setup {
            rollout_steps: config.rollout_steps,
            gamma: config.gamma,
            gae_lambda: config.gae_lambda,
            episodes: &config.episodes,
            policy: &config.policy,
            critic: &config.critic,
        };
        let common = OnPolicy::new(environment, &setup, seed)?;
        Ok(Trpo {
            config,
            seed,
            iteration: 0,
            pool: ChunkPool::new(CHUNK_ROWS),
            outcome_pool: ChunkPool::new(CHUNK_ROWS),
            old_means: vec![0.0; common.buffer.count() * common.log_std.len()],
            order: vec![0; common.buffer.count()],
            common,
        })
    }

    /// One step of the policy within the trust region.
    fn step_policy(&mut self, normalizer: &Normalizer<f32>) -> Result<Step, TrainingError> {
        let Trpo { config, common, pool, outcome_pool, old_means, order, .. } = self;
        let old_network = common.network.clone();
        let old_log_std = common.log_std.clone();
        let old = Deviations::new(&old_log_std);
        for (place, number) in order.iter_mut().zip(0..) {
            *place = number;
        }
        let (advantage_mean, advantage_scale) = mean_and_scale(&common.buffer.advantages, order);
        let batch = Batch { buffer: &common.buffer, advantage_mean, advantage_scale, normalizer };
        let policy = Gaussian { network: &old_network, deviations: &old };
        let rows = batch.rows();
        pool.map(rows, old_means, |rows, scratch, means| batch.means(policy, rows, scratch, means));

        let mut sum = vec![0.0_f32; old_network.parameter_count() + old_log_std.len()];
        pool.sum(rows, &mut sum, |rows, scratch, sum| batch.add_gradient(policy, rows, scratch, sum));
        let gradient: Vec<f64> = sum.iter().map(|x| f64::from(*x)).collect();
        if gradient.iter().any(|x| !x.is_finite()) {
            let what = "the policy's gradient";
            return Err(TrainingError::NotFinite { iteration: self.iteration + 1, what });
        }
        let (every, damping) = (config.fisher_every, config.damping);
        let mut direction = vec![0.0_f32; sum.len()];
        let mut fisher = |v: &[f64], out: &mut [f64]| {
            direction.iter_mut().zip(v).for_each(|(to, from)| *to = *from as f32);
            pool.sum(rows.div_ceil(every), &mut sum, |rows, scratch, sum| {
                batch.add_fisher_product(policy, every, &direction, rows, scratch, sum);
            });
            for ((out, product), v) in out.iter_mut().zip(&sum).zip(v) {
                *out = f64::from(*product) + damping * v;
            }
        };
        let mut x = conjugate_gradient(&mut fisher, &gradient, config.cg_iterations, config.cg_tolerance);
        let mut along = vec![0.0; x.len()];
        fisher(&x, &mut along);
        let curvature = dot(&x, &along);
        if curvature <= 0.0 {
            return Ok(Step { kl: 0.0, fraction: 0.0 });
        }
        let length = (2.0 * config.max_kl / curvature).sqrt();
        x.iter_mut().for_each(|x| *x *= length);
        let expected = dot(&gradient, &x);

        let (by_network, by_log_std) = x.split_at(old_network.parameter_count());
        let mut fraction = 1.0;
        for _ in 0..config.backtracks {
            let moved = |old: &f32, by: &f64| (f64::from(*old) + fraction * by) as f32;
            common.network.update(|parameters| {
                let old = old_network.parameters().iter().zip(by_network);
                parameters.iter_mut().zip(old).for_each(|(to, (old, by))| *to = moved(old, by));
            });
            common.log_std = old_log_std.iter().zip(by_log_std).map(|(old, by)| moved(old, by)).collect();
            common.limit_log_std();
            let deviations = Deviations::new(&common.log_std);
            let candidate = Gaussian { network: &common.network, deviations: &deviations };
            let mut outcome = [0.0; 2];
            let batch = Batch { buffer: &common.buffer, advantage_mean, advantage_scale, normalizer };
            outcome_pool.sum(rows, &mut outcome, |rows, scratch, outcome| {
                batch.add_outcome(candidate, &old, old_means, rows, scratch, outcome);
            });
            // Normalised advantages have the mean 0, and so has r A before the step.
            let [improvement, kl] = outcome;
            if kl <= config.max_kl && improvement > config.accept_ratio * fraction * expected {
                return Ok(Step { kl, fraction });
            }
            fraction *= 0.5;
        }
        common.network = old_network;
        common.log_std = old_log_std;
        Ok(Step { kl: 0.0, fraction: 0.0 })
    }

    fn learn_values(&mut self, normalizer: &Normalizer<f32>) -> Result<(), TrainingError> {
        let Trpo { config, common, order, .. } = self;
        for epoch in 0..config.epochs as u64 {
            shuffle(self.seed.child(MINIBATCHES), self.iteration * config.epochs as u64 + epoch, order);
            for places in order.chunks(config.minibatch_rows) {
                let OnPolicy { critic, buffer, targets, .. } = common;
                let loss =
                    critic.learn(normalizer, &buffer.observations, targets, places, config.max_grad_norm);
                if !loss.is_finite() {
                    let what = "the critic's loss";
                    return Err(TrainingError::NotFinite { iteration: self.iteration + 1, what });
                }
            }
        }
        Ok(())
    }
}

impl Learner for Trpo<'_> {
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
        let step = self.step_policy(&normalizer)?;
        self.learn_values(&normalizer)?;
        self.common.follow_observations();
        self.iteration += 1;
        Ok(Progress {
            kl: Some(step.kl),
            entropy: Some(Deviations::new(&self.common.log_std).entropy()),
            learning_rate: step.fraction,
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
        self.common.save(checkpoint);
    }

    fn load(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainingError> {
        self.iteration = checkpoint.u64s("iteration", 1)?[0];
        self.common.load(checkpoint)
    }
}
