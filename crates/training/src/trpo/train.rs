use std::sync::Arc;
use std::time::Instant;

use mishandle_controllers::Policy;
use mishandle_network::{CHUNK_ROWS, ChunkPool, Mlp};
use mishandle_rollout::{Environment, Seed};

use super::config::{Expected, TrpoConfig};
use super::loss::{Batch, Gaussian, Scratch};
use crate::conjugate_gradient::{conjugate_gradient, dot};
use crate::gaussian::Deviations;
use crate::learner::{Learner, Trainable, progress_of};
use crate::minibatches::Minibatches;
use crate::on_policy::{OnPolicy, Setup, mean_and_scale};
use crate::{Checkpoint, Progress, Shares, TrainingError};

/// The child of the training's seed that shuffles the critic's minibatches; the others are those of [`OnPolicy`].
const MINIBATCHES: u64 = 3;

impl Trainable for TrpoConfig {
    fn learner(&self, environment: Arc<dyn Environment>, seed: Seed) -> Result<impl Learner, TrainingError> {
        Trpo::new(environment, self, seed)
    }
}

struct Trpo<'a> {
    config: &'a TrpoConfig,
    common: OnPolicy,
    iteration: u64,
    pool: ChunkPool<f32, Scratch>,
    outcome_pool: ChunkPool<f64, Scratch>,
    old_means: Vec<f32>,
    minibatches: Minibatches,
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
            iteration: 0,
            pool: ChunkPool::new(CHUNK_ROWS),
            outcome_pool: ChunkPool::new(CHUNK_ROWS),
            old_means: vec![0.0; common.buffer.count() * common.log_std.len()],
            minibatches: Minibatches::new(
                config.minibatches,
                common.buffer.count(),
                config.minibatch_rows,
                config.slices,
                seed.child(MINIBATCHES),
            ),
            common,
        })
    }

    /// One step of the policy within the trust region.
    fn step_policy(&mut self) -> Result<Step, TrainingError> {
        self.common.follow_batch();
        let Trpo { config, common, pool, outcome_pool, old_means, .. } = self;
        let normalizer = common.normalizer();
        let (advantage_mean, advantage_scale) = mean_and_scale(common.buffer.advantages.iter().copied());
        let batch =
            Batch { buffer: &common.buffer, advantage_mean, advantage_scale, normalizer: &normalizer };
        let old_deviations = Deviations::new(&common.log_std);
        let old = Gaussian { network: &common.network, deviations: &old_deviations };
        pool.map(batch.rows(), old_means, |rows, scratch, means| batch.means(old, rows, scratch, means));

        let gradient = gradient(&batch, old, pool);
        if gradient.iter().any(|x| !x.is_finite()) {
            let what = "the policy's gradient";
            return Err(TrainingError::NotFinite { iteration: self.iteration + 1, what });
        }
        let Some(longest) = longest_step(config, &batch, old, &gradient, pool) else {
            return Ok(Step { kl: 0.0, fraction: 0.0 });
        };

        let mut outcome = |policy: Gaussian<'_>| {
            let mut outcome = [0.0; 2];
            outcome_pool.sum(batch.rows(), &mut outcome, |rows, scratch, outcome| {
                batch.add_outcome(policy, &old_deviations, old_means, rows, scratch, outcome);
            });
            outcome
        };
        // Normalised advantages have the mean 0, and so has r A where r is 1.
        let before = if common.ratios_begin_at_1() { 0.0 } else { outcome(old)[0] };
        let mut expected = dot(&gradient, &longest);
        let mut fraction = 1.0;
        for _ in 0..config.backtracks {
            let (network, log_std) = common.moved_policy(&longest, fraction);
            let [surrogate, kl] =
                outcome(Gaussian { network: &network, deviations: &Deviations::new(&log_std) });
            let improvement = match config.expected_improvement {
                Expected::Proportional => fraction * expected,
                Expected::Compounded => {
                    expected *= fraction;
                    expected
                }
            };
            if kl <= config.max_kl && surrogate - before > config.accept_ratio * improvement {
                common.network = network;
                common.log_std = log_std;
                return Ok(Step { kl, fraction });
            }
            fraction *= 0.5;
        }
        Ok(Step { kl: 0.0, fraction: 0.0 })
    }

    fn learn_values(&mut self) -> Result<(), TrainingError> {
        let Trpo { config, common, minibatches, .. } = self;
        for epoch in 0..config.epochs as u64 {
            minibatches.begin_epoch(self.iteration * config.epochs as u64 + epoch);
            for rows in minibatches.ranges() {
                let places = &minibatches.order()[rows];
                if epoch == 0 {
                    common.follow_minibatch(places);
                }
                let normalizer = common.normalizer();
                let OnPolicy { critic, buffer, targets, .. } = common;
                let loss =
                    critic.learn(&normalizer, &buffer.observations, targets, places, config.max_grad_norm);
                if !loss.is_finite() {
                    let what = "the critic's loss";
                    return Err(TrainingError::NotFinite { iteration: self.iteration + 1, what });
                }
            }
        }
        Ok(())
    }
}

/// The gradient of the surrogate: by the network's parameters, then by log σ.
fn gradient(batch: &Batch<'_>, policy: Gaussian<'_>, pool: &mut ChunkPool<f32, Scratch>) -> Vec<f64> {
    let mut sum = vec![0.0; policy.network.parameter_count() + policy.deviations.std().len()];
    pool.sum(batch.rows(), &mut sum, |rows, scratch, sum| batch.add_gradient(policy, rows, scratch, sum));
    sum.into_iter().map(f64::from).collect()
}

/// The step along the natural gradient that reaches the border of the trust region, if divergence were quadratic;
/// `None` if it has no curvature there.
fn longest_step(
    config: &TrpoConfig,
    batch: &Batch<'_>,
    policy: Gaussian<'_>,
    gradient: &[f64],
    pool: &mut ChunkPool<f32, Scratch>,
) -> Option<Vec<f64>> {
    let every = config.fisher_every;
    let (mut direction, mut sum) = (vec![0.0_f32; gradient.len()], vec![0.0_f32; gradient.len()]);
    let mut fisher = |v: &[f64], out: &mut [f64]| {
        direction.iter_mut().zip(v).for_each(|(to, from)| *to = *from as f32);
        pool.sum(batch.rows().div_ceil(every), &mut sum, |rows, scratch, sum| {
            batch.add_fisher_product(policy, every, &direction, rows, scratch, sum);
        });
        for ((out, product), v) in out.iter_mut().zip(&sum).zip(v) {
            *out = f64::from(*product) + config.damping * v;
        }
    };
    let mut x = conjugate_gradient(&mut fisher, gradient, config.cg_iterations, config.cg_tolerance);
    let mut along = vec![0.0; x.len()];
    fisher(&x, &mut along);
    let curvature = dot(&x, &along);
    let length = (2.0 * config.max_kl / curvature).sqrt();
    x.iter_mut().for_each(|x| *x *= length);
    (curvature > 0.0).then_some(x)
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
        let step = self.step_policy()?;
        self.learn_values()?;
        self.common.follow_rollout();
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
