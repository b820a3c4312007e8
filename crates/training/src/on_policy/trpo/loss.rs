//! Surrogate objective, KL divergence and Fisher-vector product, over chunks of rows.

use std::ops::Range;

use mishandle_network::{Mlp, Normalizer, Workspace};

use crate::RolloutBuffer;
use crate::gaussian::DiagonalGaussian;

/// A whole rollout as one batch.
pub(super) struct RolloutBatch<'a> {
    pub buffer: &'a RolloutBuffer,
    /// Mean of the advantages.
    pub advantage_mean: f64,
    /// Inverse standard deviation of the advantages.
    pub advantage_inverse_std: f64,
    pub normalizer: &'a Normalizer<f32>,
}

/// A Gaussian policy; the network outputs the mean.
#[derive(Clone, Copy)]
pub(super) struct GaussianPolicy<'a> {
    pub network: &'a Mlp<f32>,
    pub gaussian: &'a DiagonalGaussian,
}

/// Scratch memory of one thread.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    inputs: Vec<f32>,
    workspace: Workspace<f32>,
    mean_gradient: Vec<f32>,
}

impl RolloutBatch<'_> {
    /// Returns the number of rows.
    pub fn rows(&self) -> usize {
        self.buffer.count()
    }

    fn advantage(&self, row: usize) -> f64 {
        (self.buffer.advantages[row] - self.advantage_mean) * self.advantage_inverse_std
    }

    /// Returns the means of `policy` for these rows.
    fn forward<'w>(
        &self,
        policy: GaussianPolicy<'_>,
        rows: impl Iterator<Item = usize>,
        inputs: &mut Vec<f32>,
        workspace: &'w mut Workspace<f32>,
    ) -> &'w [f32] {
        let columns = policy.network.input_size();
        inputs.clear();
        for row in rows {
            inputs.extend_from_slice(&self.buffer.observations[row * columns..][..columns]);
        }
        self.normalizer.normalize(inputs);
        policy.network.forward(inputs, workspace)
    }

    /// Writes the means of `policy` for these rows.
    pub fn means(
        &self,
        policy: GaussianPolicy<'_>,
        rows: Range<usize>,
        scratch: &mut Scratch,
        means: &mut [f32],
    ) {
        let Scratch { inputs, workspace, .. } = scratch;
        means.copy_from_slice(self.forward(policy, rows, inputs, workspace));
    }

    /// Adds the contribution of these rows to the gradient of mean r A with respect to the
    /// network's parameters, then log σ.
    pub fn add_gradient(
        &self,
        policy: GaussianPolicy<'_>,
        rows: Range<usize>,
        scratch: &mut Scratch,
        gradient: &mut [f32],
    ) {
        let share = 1.0 / self.rows() as f64;
        let actions = policy.network.output_size();
        let (network_gradient, log_std_gradient) = gradient.split_at_mut(policy.network.parameter_count());
        let Scratch { inputs, workspace, mean_gradient } = scratch;
        mean_gradient.resize(rows.len() * actions, 0.0);
        let means = self.forward(policy, rows.clone(), inputs, workspace);
        for ((row, mean), mean_gradient) in
            rows.zip(means.chunks_exact(actions)).zip(mean_gradient.chunks_exact_mut(actions))
        {
            let action = &self.buffer.actions[row * actions..][..actions];
            let log_prob = policy.gaussian.log_prob(mean, action);
            let ratio = (log_prob - self.buffer.log_probs[row]).exp();
            let slope = share * ratio * self.advantage(row);
            policy.gaussian.log_prob_gradient(mean, action, slope, mean_gradient, log_std_gradient);
        }
        policy.network.backward(mean_gradient, workspace, Some(network_gradient), None);
    }

    /// Adds the contribution of the subsampled rows `rows` (row i of the sample is row i · `every`
    /// of the batch) to the product of the Fisher information matrix with `direction`; both contain
    /// the network's parameters, then log σ.
    pub fn add_fisher_vector_product(
        &self,
        policy: GaussianPolicy<'_>,
        every: usize,
        direction: &[f32],
        rows: Range<usize>,
        scratch: &mut Scratch,
        product: &mut [f32],
    ) {
        let share = rows.len() as f64 / self.rows().div_ceil(every) as f64;
        let row_share = (1.0 / self.rows().div_ceil(every) as f64) as f32;
        let count = policy.network.parameter_count();
        let (along, along_log_std) = direction.split_at(count);
        let (network_gradient, log_std_gradient) = product.split_at_mut(count);
        let Scratch { inputs, workspace, mean_gradient } = scratch;
        self.forward(policy, rows.map(|row| row * every), inputs, workspace);
        let tangents = policy.network.tangent(Some(along), None, workspace);
        mean_gradient.clear();
        let precisions = policy.gaussian.std().iter().map(|std| (1.0 / (std * std)) as f32).cycle();
        mean_gradient.extend(tangents.iter().zip(precisions).map(|(t, precision)| row_share * t * precision));
        policy.network.backward(mean_gradient, workspace, Some(network_gradient), None);
        for (product, v) in log_std_gradient.iter_mut().zip(along_log_std) {
            *product += (2.0 * share) as f32 * v;
        }
    }

    /// Adds the contribution of these rows to the surrogate mean r A and to mean KL(old ‖ policy).
    /// The old policy has the means `old_means`.
    pub fn add_surrogate_and_kl(
        &self,
        policy: GaussianPolicy<'_>,
        old: &DiagonalGaussian,
        old_means: &[f32],
        rows: Range<usize>,
        scratch: &mut Scratch,
        sums: &mut [f64],
    ) {
        let share = 1.0 / self.rows() as f64;
        let actions = policy.network.output_size();
        let Scratch { inputs, workspace, .. } = scratch;
        let means = self.forward(policy, rows.clone(), inputs, workspace);
        for (row, mean) in rows.zip(means.chunks_exact(actions)) {
            let action = &self.buffer.actions[row * actions..][..actions];
            let log_prob = policy.gaussian.log_prob(mean, action);
            sums[0] += share * (log_prob - self.buffer.log_probs[row]).exp() * self.advantage(row);
            sums[1] +=
                share * old.kl_divergence(&old_means[row * actions..][..actions], policy.gaussian, mean);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mishandle_network::Activation;
    use mishandle_rollout::{Seed, Stream};

    const LOG_STD: [f32; 2] = [-0.25, 0.125];

    /// Seven rows of two observations and two actions under a network of 27 parameters.
    fn buffer() -> RolloutBuffer {
        let mut buffer = RolloutBuffer::new(7, 1, 2, 2);
        let numbers = |count: usize, shift: f64| (0..count).map(move |i| (i as f64 * 1.7 + shift).sin());
        buffer.observations = numbers(14, 0.0).map(|x| x as f32).collect();
        buffer.actions = numbers(14, 1.0).map(|x| x as f32).collect();
        buffer.advantages = numbers(7, 2.0).collect();
        buffer
    }

    fn network() -> Mlp<f32> {
        let mut network = Mlp::new(&[2, 5, 2], Activation::Tanh, Activation::Identity).unwrap();
        let mut index = 0;
        network.initialize_uniform(|| {
            index += 1;
            Seed(4).uniform(Stream::Weights, 0, index)
        });
        network
    }

    /// Returns the policy with `by` · `direction` added to the network's parameters and log σ.
    fn moved(direction: &[f32], by: f32) -> (Mlp<f32>, DiagonalGaussian) {
        let mut network = network();
        let count = network.parameter_count();
        network.update(|parameters| {
            parameters.iter_mut().zip(direction).for_each(|(p, d)| *p += by * d);
        });
        let log_std: Vec<f32> = LOG_STD.iter().zip(&direction[count..]).map(|(x, d)| x + by * d).collect();
        (network, DiagonalGaussian::new(&log_std))
    }

    fn direction(which: f32) -> Vec<f32> {
        (0..network().parameter_count() + 2).map(|i| (which + 0.9 * i as f32).cos()).collect()
    }

    /// Returns mean r A and the mean KL divergence from the unchanged policy.
    fn surrogate_and_kl(
        buffer: &RolloutBuffer,
        batch: &RolloutBatch<'_>,
        direction: &[f32],
        by: f32,
    ) -> [f64; 2] {
        let (old_network, old) = moved(direction, 0.0);
        let mut means = vec![0.0; 14];
        let gaussian = GaussianPolicy { network: &old_network, gaussian: &old };
        batch.means(gaussian, 0..buffer.count(), &mut Scratch::default(), &mut means);
        let (network, gaussian) = moved(direction, by);
        let mut sums = [0.0; 2];
        let gaussian = GaussianPolicy { network: &network, gaussian: &gaussian };
        let mut scratch = Scratch::default();
        batch.add_surrogate_and_kl(gaussian, &old, &means, 0..4, &mut scratch, &mut sums);
        batch.add_surrogate_and_kl(gaussian, &old, &means, 4..7, &mut scratch, &mut sums);
        sums
    }

    fn check(run: impl Fn(&RolloutBuffer, &RolloutBatch<'_>, GaussianPolicy<'_>)) {
        let (network, gaussian) = moved(&direction(0.0), 0.0);
        let mut buffer = buffer();
        for (row, log_prob) in buffer.log_probs.iter_mut().enumerate() {
            let mut workspace = Workspace::default();
            let mean = network.forward(&buffer.observations[2 * row..][..2], &mut workspace);
            *log_prob = gaussian.log_prob(mean, &buffer.actions[2 * row..][..2]);
        }
        let normalizer = Normalizer::new(&[0.0; 2], &[1.0; 2]).unwrap();
        let batch = RolloutBatch {
            buffer: &buffer,
            advantage_mean: 0.125,
            advantage_inverse_std: 1.5,
            normalizer: &normalizer,
        };
        run(&buffer, &batch, GaussianPolicy { network: &network, gaussian: &gaussian });
    }

    #[test]
    fn the_gradient_matches_finite_differences_of_the_surrogate() {
        check(|buffer, batch, policy| {
            let mut gradient = vec![0.0; policy.network.parameter_count() + 2];
            let mut scratch = Scratch::default();
            batch.add_gradient(policy, 0..3, &mut scratch, &mut gradient);
            batch.add_gradient(policy, 3..7, &mut scratch, &mut gradient);
            for which in 0..4 {
                let along = direction(which as f32);
                let h = 1.0 / 512.0;
                let slope = (surrogate_and_kl(buffer, batch, &along, h)[0]
                    - surrogate_and_kl(buffer, batch, &along, -h)[0])
                    / f64::from(2.0 * h);
                let found: f64 = gradient.iter().zip(&along).map(|(g, d)| f64::from(g * d)).sum();
                assert!((slope - found).abs() < 1e-3 * (1.0 + slope.abs()), "{slope} {found}");
            }
        });
    }

    #[test]
    fn the_fisher_vector_product_matches_the_curvature_of_the_kl_divergence() {
        check(|buffer, batch, policy| {
            let count = policy.network.parameter_count() + 2;
            for which in 0..4 {
                let along = direction(which as f32);
                let mut product = vec![0.0; count];
                let mut scratch = Scratch::default();
                batch.add_fisher_vector_product(policy, 1, &along, 0..5, &mut scratch, &mut product);
                batch.add_fisher_vector_product(policy, 1, &along, 5..7, &mut scratch, &mut product);
                let found: f64 = product.iter().zip(&along).map(|(p, d)| f64::from(p * d)).sum();
                // KL(h v) = h²/2 vᵀHv + O(h³), whose odd part cancels in the sum of both sides.
                let h = 1.0 / 64.0;
                let both = surrogate_and_kl(buffer, batch, &along, h)[1]
                    + surrogate_and_kl(buffer, batch, &along, -h)[1];
                let curvature = both / f64::from(h * h);
                assert!((curvature - found).abs() < 2e-2 * found, "{curvature} {found}");
            }
        });
    }

    #[test]
    fn a_subsampled_fisher_vector_product_uses_every_nth_row() {
        check(|_, batch, policy| {
            let along = direction(1.0);
            let mut sampled = vec![0.0; along.len()];
            let mut rows = vec![0.0; along.len()];
            let mut scratch = Scratch::default();
            // Rows 0, 3 and 6 of seven.
            batch.add_fisher_vector_product(policy, 3, &along, 0..3, &mut scratch, &mut sampled);
            for row in [0, 3, 6] {
                batch.add_fisher_vector_product(policy, 1, &along, row..row + 1, &mut scratch, &mut rows);
            }
            for (sampled, rows) in sampled.iter().zip(&rows) {
                assert!(
                    (sampled - rows * 7.0 / 3.0).abs() < 1e-4 * (1.0 + sampled.abs()),
                    "{sampled} {rows}"
                );
            }
        });
    }
}
