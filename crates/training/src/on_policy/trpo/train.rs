use mishandle_network::{CHUNK_ROWS, ChunkPool};

use super::conjugate_gradient::{conjugate_gradient, dot};
use super::loss::{GaussianPolicy, RolloutBatch, Scratch};
use super::settings::{ExpectedImprovement, LineSearchKl, TrpoSettings};
use crate::gaussian::DiagonalGaussian;
use crate::on_policy::minibatches::Minibatches;
use crate::on_policy::settings::{OnPolicySettings, on_policy_settings};
use crate::on_policy::{ActorCritic, PolicyOptimizer, UpdateError, UpdateStatistics, mean_and_inverse_std};

pub(crate) struct Trpo {
    settings: TrpoSettings,
    pool: ChunkPool<f32, Scratch>,
    line_search_pool: ChunkPool<f64, Scratch>,
    old_means: Vec<f32>,
    /// Gradient of the surrogate at the last step with respect to the network's parameters, then
    /// log σ.
    pub gradient: Vec<f64>,
    minibatches: Minibatches,
}

/// A policy step.
pub(crate) struct Step {
    /// Mean KL divergence of the new policy from the old one.
    pub kl: f64,
    /// Fraction of the full step that the line search accepted; 0 if it failed.
    pub fraction: f64,
}

impl Trpo {
    /// Applies one policy step within the trust region.
    pub fn step_policy(&mut self, actor_critic: &mut ActorCritic) -> Result<Step, &'static str> {
        actor_critic.update_normalizer_from_batch();
        let Trpo { settings, pool, line_search_pool, old_means, gradient, .. } = self;
        let normalizer = actor_critic.normalizer();
        let (advantage_mean, advantage_inverse_std) =
            mean_and_inverse_std(actor_critic.buffer.advantages.iter().copied());
        let batch = RolloutBatch {
            buffer: &actor_critic.buffer,
            advantage_mean,
            advantage_inverse_std,
            normalizer: &normalizer,
        };
        let old_gaussian = DiagonalGaussian::new(&actor_critic.log_std);
        let old = GaussianPolicy { network: &actor_critic.network, gaussian: &old_gaussian };
        pool.map(batch.rows(), old_means, |rows, scratch, means| batch.means(old, rows, scratch, means));

        *gradient = surrogate_gradient(&batch, old, pool);
        if gradient.iter().any(|x| !x.is_finite()) {
            return Err("the policy's gradient");
        }
        let Some(full_step) = full_step(settings, &batch, old, gradient, pool) else {
            return Ok(Step { kl: 0.0, fraction: 0.0 });
        };

        let mut surrogate_and_kl = |policy: GaussianPolicy<'_>| {
            let mut sums = [0.0; 2];
            line_search_pool.sum(batch.rows(), &mut sums, |rows, scratch, sums| {
                batch.add_surrogate_and_kl(policy, &old_gaussian, old_means, rows, scratch, sums);
            });
            sums
        };
        // Normalized advantages have mean 0, so mean r A is 0 where r = 1.
        let before = if actor_critic.initial_ratios_are_1() { 0.0 } else { surrogate_and_kl(old)[0] };
        let mut expected = dot(gradient, &full_step);
        let mut fraction = 1.0;
        for _ in 0..settings.line_search_steps {
            let (network, log_std) = actor_critic.policy_at_step(&full_step, fraction);
            let gaussian = DiagonalGaussian::new(&log_std);
            let [surrogate, kl] = surrogate_and_kl(GaussianPolicy { network: &network, gaussian: &gaussian });
            let line_search_kl = match settings.line_search_kl {
                LineSearchKl::Exact => kl,
                // The entropies differ by Σ log(σ_old / σ).
                LineSearchKl::Flipped => kl + 2.0 * (old_gaussian.entropy() - gaussian.entropy()),
            };
            let improvement = match settings.expected_improvement {
                ExpectedImprovement::Proportional => fraction * expected,
                ExpectedImprovement::Compounded => {
                    expected *= fraction;
                    expected
                }
            };
            if line_search_kl <= settings.max_kl && surrogate - before > settings.accept_ratio * improvement {
                actor_critic.network = network;
                actor_critic.log_std = log_std;
                return Ok(Step { kl, fraction });
            }
            fraction *= 0.5;
        }
        Ok(Step { kl: 0.0, fraction: 0.0 })
    }

    /// Trains the critic for all epochs; returns the loss of the last minibatch.
    pub fn train_critic(
        &mut self,
        actor_critic: &mut ActorCritic,
        iteration: u64,
    ) -> Result<f64, &'static str> {
        let mut loss = 0.0;
        let Trpo { settings, minibatches, .. } = self;
        for epoch in 0..settings.epochs as u64 {
            minibatches.start_epoch(iteration * settings.epochs as u64 + epoch);
            for rows in minibatches.ranges() {
                let indices = &minibatches.order()[rows];
                if epoch == 0 {
                    actor_critic.update_normalizer_from_minibatch(indices);
                }
                let normalizer = actor_critic.normalizer();
                let ActorCritic { critic, buffer, targets, .. } = actor_critic;
                loss = critic.train_minibatch(
                    &normalizer,
                    &buffer.observations,
                    &buffer.privileged,
                    targets,
                    indices,
                    settings.max_grad_norm,
                );
                if !loss.is_finite() {
                    return Err("the critic's loss");
                }
            }
        }
        Ok(loss)
    }
}

/// Returns the gradient of the surrogate with respect to the network's parameters, then log σ.
fn surrogate_gradient(
    batch: &RolloutBatch<'_>,
    policy: GaussianPolicy<'_>,
    pool: &mut ChunkPool<f32, Scratch>,
) -> Vec<f64> {
    let mut sum = vec![0.0; policy.network.parameter_count() + policy.gaussian.std().len()];
    pool.sum(batch.rows(), &mut sum, |rows, scratch, sum| batch.add_gradient(policy, rows, scratch, sum));
    sum.into_iter().map(f64::from).collect()
}

/// Returns the step along the natural gradient to the boundary of the trust region, for a quadratic
/// KL divergence; `None` if the curvature is not positive.
fn full_step(
    settings: &TrpoSettings,
    batch: &RolloutBatch<'_>,
    policy: GaussianPolicy<'_>,
    gradient: &[f64],
    pool: &mut ChunkPool<f32, Scratch>,
) -> Option<Vec<f64>> {
    let every = settings.fisher_subsampling;
    let mut direction = vec![0.0_f32; gradient.len()];
    let mut sum = vec![0.0_f32; gradient.len()];
    let mut fisher = |v: &[f64], out: &mut [f64]| {
        direction.iter_mut().zip(v).for_each(|(to, from)| *to = *from as f32);
        pool.sum(batch.rows().div_ceil(every), &mut sum, |rows, scratch, sum| {
            batch.add_fisher_vector_product(policy, every, &direction, rows, scratch, sum);
        });
        for ((out, product), v) in out.iter_mut().zip(&sum).zip(v) {
            *out = f64::from(*product) + settings.cg_damping * v;
        }
    };
    let mut x = conjugate_gradient(&mut fisher, gradient, settings.cg_iterations, settings.cg_tolerance);
    let mut along = vec![0.0; x.len()];
    fisher(&x, &mut along);
    let curvature = dot(&x, &along);
    let length = (2.0 * settings.max_kl / curvature).sqrt();
    x.iter_mut().for_each(|x| *x *= length);
    (curvature > 0.0).then_some(x)
}

impl PolicyOptimizer for Trpo {
    type Settings = TrpoSettings;

    fn shared(settings: &TrpoSettings) -> OnPolicySettings<'_> {
        on_policy_settings!(settings)
    }

    fn new(settings: &TrpoSettings, actor_critic: &mut ActorCritic, minibatches: Minibatches) -> Trpo {
        Trpo {
            settings: settings.clone(),
            pool: ChunkPool::new(CHUNK_ROWS),
            line_search_pool: ChunkPool::new(CHUNK_ROWS),
            gradient: Vec::new(),
            old_means: vec![0.0; actor_critic.buffer.count() * actor_critic.log_std.len()],
            minibatches,
        }
    }

    fn update(
        &mut self,
        actor_critic: &mut ActorCritic,
        iteration: u64,
    ) -> Result<UpdateStatistics, UpdateError> {
        let step = if self.settings.run.learns_policy(iteration * actor_critic.rollout_size()) {
            self.step_policy(actor_critic)?
        } else {
            Step { kl: 0.0, fraction: 0.0 }
        };
        self.train_critic(actor_critic, iteration)?;
        Ok(UpdateStatistics { kl: step.kl, learning_rate: step.fraction })
    }
}
