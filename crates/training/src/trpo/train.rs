use mishandle_network::{CHUNK_ROWS, ChunkPool};

use super::config::{Distance, Expected, TrpoConfig};
use super::loss::{Batch, Gaussian, Scratch};
use crate::actor_critic::{ActorCritic, mean_and_scale};
use crate::conjugate_gradient::{conjugate_gradient, dot};
use crate::gaussian::Deviations;
use crate::minibatches::Minibatches;
use crate::on_policy::{Improvement, Improver};
use crate::on_policy_settings::{Setup, setup_of};

pub(crate) struct Trpo {
    config: TrpoConfig,
    pool: ChunkPool<f32, Scratch>,
    outcome_pool: ChunkPool<f64, Scratch>,
    old_means: Vec<f32>,
    /// The gradient of the surrogate at the last step: by the network's parameters, then by log σ.
    pub gradient: Vec<f64>,
    minibatches: Minibatches,
}

/// What a step of the policy did.
pub(crate) struct Step {
    /// Mean divergence of the new policy from the old one.
    pub kl: f64,
    /// The share of the longest step that was taken; 0 if none was good enough.
    pub fraction: f64,
}

impl Trpo {
    /// One step of the policy within the trust region.
    pub fn step_policy(&mut self, actor_critic: &mut ActorCritic) -> Result<Step, &'static str> {
        actor_critic.follow_batch();
        let Trpo { config, pool, outcome_pool, old_means, gradient, .. } = self;
        let normalizer = actor_critic.normalizer();
        let (advantage_mean, advantage_scale) =
            mean_and_scale(actor_critic.buffer.advantages.iter().copied());
        let batch =
            Batch { buffer: &actor_critic.buffer, advantage_mean, advantage_scale, normalizer: &normalizer };
        let old_deviations = Deviations::new(&actor_critic.log_std);
        let old = Gaussian { network: &actor_critic.network, deviations: &old_deviations };
        pool.map(batch.rows(), old_means, |rows, scratch, means| batch.means(old, rows, scratch, means));

        *gradient = surrogate_gradient(&batch, old, pool);
        if gradient.iter().any(|x| !x.is_finite()) {
            return Err("the policy's gradient");
        }
        let Some(longest) = longest_step(config, &batch, old, gradient, pool) else {
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
        let before = if actor_critic.ratios_begin_at_1() { 0.0 } else { outcome(old)[0] };
        let mut expected = dot(gradient, &longest);
        let mut fraction = 1.0;
        for _ in 0..config.backtracks {
            let (network, log_std) = actor_critic.moved_policy(&longest, fraction);
            let deviations = Deviations::new(&log_std);
            let [surrogate, kl] = outcome(Gaussian { network: &network, deviations: &deviations });
            let distance = match config.distance {
                Distance::Exact => kl,
                // The entropies differ by Σ log(σ_old / σ).
                Distance::Flipped => kl + 2.0 * (old_deviations.entropy() - deviations.entropy()),
            };
            let improvement = match config.expected_improvement {
                Expected::Proportional => fraction * expected,
                Expected::Compounded => {
                    expected *= fraction;
                    expected
                }
            };
            if distance <= config.max_kl && surrogate - before > config.accept_ratio * improvement {
                actor_critic.network = network;
                actor_critic.log_std = log_std;
                return Ok(Step { kl, fraction });
            }
            fraction *= 0.5;
        }
        Ok(Step { kl: 0.0, fraction: 0.0 })
    }

    /// All epochs of the critic; gives the loss of the last minibatch.
    pub fn learn_values(
        &mut self,
        actor_critic: &mut ActorCritic,
        iteration: u64,
    ) -> Result<f64, &'static str> {
        let mut loss = 0.0;
        let Trpo { config, minibatches, .. } = self;
        for epoch in 0..config.epochs as u64 {
            minibatches.begin_epoch(iteration * config.epochs as u64 + epoch);
            for rows in minibatches.ranges() {
                let places = &minibatches.order()[rows];
                if epoch == 0 {
                    actor_critic.follow_minibatch(places);
                }
                let normalizer = actor_critic.normalizer();
                let ActorCritic { critic, buffer, targets, .. } = actor_critic;
                loss = critic.learn(&normalizer, &buffer.observations, targets, places, config.max_grad_norm);
                if !loss.is_finite() {
                    return Err("the critic's loss");
                }
            }
        }
        Ok(loss)
    }
}

/// The gradient of the surrogate: by the network's parameters, then by log σ.
fn surrogate_gradient(
    batch: &Batch<'_>,
    policy: Gaussian<'_>,
    pool: &mut ChunkPool<f32, Scratch>,
) -> Vec<f64> {
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

impl Improver for Trpo {
    type Config = TrpoConfig;

    fn setup(config: &TrpoConfig) -> Setup<'_> {
        setup_of!(config)
    }

    fn new(config: &TrpoConfig, actor_critic: &mut ActorCritic, minibatches: Minibatches) -> Trpo {
        Trpo {
            config: config.clone(),
            pool: ChunkPool::new(CHUNK_ROWS),
            outcome_pool: ChunkPool::new(CHUNK_ROWS),
            gradient: Vec::new(),
            old_means: vec![0.0; actor_critic.buffer.count() * actor_critic.log_std.len()],
            minibatches,
        }
    }

    fn improve(
        &mut self,
        actor_critic: &mut ActorCritic,
        iteration: u64,
    ) -> Result<Improvement, &'static str> {
        let step = self.step_policy(actor_critic)?;
        self.learn_values(actor_critic, iteration)?;
        Ok(Improvement { kl: step.kl, learning_rate: step.fraction })
    }
}
