//! The surrogate objective, the divergence, and the product with the Fisher information, over chunks of rows.

use std::ops::Range;

use mishandle_network::{Mlp, Normalizer, Workspace};

use crate::Buffer;
use crate::gaussian::Deviations;

/// What a step of the policy is computed from: one rollout as a whole.
pub(super) struct Batch<'a> {
    pub buffer: &'a Buffer,
    /// Mean of the advantages, and one over their standard deviation.
    pub advantage_mean: f64,
    pub advantage_scale: f64,
    pub normalizer: &'a Normalizer<f32>,
}

/// A Gaussian policy.
#[derive(Clone, Copy)]
pub(super) struct Gaussian<'a> {
    pub network: &'a Mlp<f32>,
    pub deviations: &'a Deviations,
}

/// What one thread needs for it.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    inputs: Vec<f32>,
    workspace: Workspace<f32>,
    by_mean: Vec<f32>,
}

impl Batch<'_> {
    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.buffer.count()
    }

    fn advantage(&self, place: usize) -> f64 {
        (self.buffer.advantages[place] - self.advantage_mean) * self.advantage_scale
    }

    /// The means that `policy` gives for every `every`-th row of the batch, the chunk's share of them.
    fn forward<'w>(
        &self,
        policy: Gaussian<'_>,
        places: impl Iterator<Item = usize>,
        inputs: &mut Vec<f32>,
        workspace: &'w mut Workspace<f32>,
    ) -> &'w [f32] {
        let columns = policy.network.input_size();
        inputs.clear();
        for place in places {
            inputs.extend_from_slice(&self.buffer.observations[place * columns..][..columns]);
        }
        self.normalizer.normalize(inputs);
        policy.network.forward(inputs, workspace)
    }

    /// Writes the means for `rows`.
    pub fn means(&self, policy: Gaussian<'_>, rows: Range<usize>, scratch: &mut Scratch, means: &mut [f32]) {
        let Scratch { inputs, workspace, .. } = scratch;
        means.copy_from_slice(self.forward(policy, rows, inputs, workspace));
    }

    /// Adds the share of `rows` to the gradient of mean r A by the network's parameters, then by log σ.
    pub fn add_gradient(
        &self,
        policy: Gaussian<'_>,
        rows: Range<usize>,
        scratch: &mut Scratch,
        gradient: &mut [f32],
    ) {
        let share = 1.0 / self.rows() as f64;
        let actions = policy.network.output_size();
        let (by_network, by_log_std) = gradient.split_at_mut(policy.network.parameter_count());
        let Scratch { inputs, workspace, by_mean } = scratch;
        by_mean.resize(rows.len() * actions, 0.0);
        let means = self.forward(policy, rows.clone(), inputs, workspace);
        for ((place, mean), by_mean) in
            rows.zip(means.chunks_exact(actions)).zip(by_mean.chunks_exact_mut(actions))
        {
            let action = &self.buffer.actions[place * actions..][..actions];
            let log_prob = policy.deviations.log_prob(mean, action);
            let ratio = (log_prob - self.buffer.log_probs[place]).exp();
            let slope = share * ratio * self.advantage(place);
            policy.deviations.log_prob_gradient(mean, action, slope, by_mean, by_log_std);
        }
        policy.network.backward(by_mean, workspace, Some(by_network), None);
    }

    /// Adds the share of `rows`, each standing for the `every`-th row of the batch of that number, to the product of
    /// the Fisher information with `direction`: by the network's parameters, then by log σ.
    pub fn add_fisher_product(
        &self,
        policy: Gaussian<'_>,
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
        let (by_network, by_log_std) = product.split_at_mut(count);
        let Scratch { inputs, workspace, by_mean } = scratch;
        self.forward(policy, rows.map(|row| row * every), inputs, workspace);
        let tangents = policy.network.tangent(Some(along), None, workspace);
        by_mean.clear();
        let precisions = policy.deviations.std().iter().map(|std| (1.0 / (std * std)) as f32).cycle();
        by_mean.extend(tangents.iter().zip(precisions).map(|(t, precision)| row_share * t * precision));
        policy.network.backward(by_mean, workspace, Some(by_network), None);
        for (product, v) in by_log_std.iter_mut().zip(along_log_std) {
            *product += (2.0 * share) as f32 * v;
        }
    }

    /// Adds the share of `rows` to mean r A and to mean KL(old ‖ policy); `old` gave `old_means`.
    pub fn add_outcome(
        &self,
        policy: Gaussian<'_>,
        old: &Deviations,
        old_means: &[f32],
        rows: Range<usize>,
        scratch: &mut Scratch,
        outcome: &mut [f64],
    ) {
        let share = 1.0 / self.rows() as f64;
        let actions = policy.network.output_size();
        let Scratch { inputs, workspace, .. } = scratch;
        let means = self.forward(policy, rows.clone(), inputs, workspace);
        for (place, mean) in rows.zip(means.chunks_exact(actions)) {
            let action = &self.buffer.actions[place * actions..][..actions];
            let log_prob = policy.deviations.log_prob(mean, action);
            outcome[0] += share * (log_prob - self.buffer.log_probs[place]).exp() * self.advantage(place);
            outcome[1] +=
                share * old.divergence(&old_means[place * actions..][..actions], policy.deviations, mean);
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
    fn buffer() -> Buffer {
        let mut buffer = Buffer::new(7, 1, 2, 2);
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

    /// Parameters of the network, then log σ, moved by `by` times `direction`.
    fn moved(direction: &[f32], by: f32) -> (Mlp<f32>, Deviations) {
        let mut network = network();
        let count = network.parameter_count();
        network.update(|parameters| {
            parameters.iter_mut().zip(direction).for_each(|(p, d)| *p += by * d);
        });
        let log_std: Vec<f32> = LOG_STD.iter().zip(&direction[count..]).map(|(x, d)| x + by * d).collect();
        (network, Deviations::new(&log_std))
    }

    fn direction(which: f32) -> Vec<f32> {
        (0..network().parameter_count() + 2).map(|i| (which + 0.9 * i as f32).cos()).collect()
    }

    /// Mean r A and mean divergence from the unmoved policy.
    fn outcome(buffer: &Buffer, batch: &Batch<'_>, direction: &[f32], by: f32) -> [f64; 2] {
        let (old_network, old) = moved(direction, 0.0);
        let mut means = vec![0.0; 14];
        let gaussian = Gaussian { network: &old_network, deviations: &old };
        batch.means(gaussian, 0..buffer.count(), &mut Scratch::default(), &mut means);
        let (network, deviations) = moved(direction, by);
        let mut outcome = [0.0; 2];
        let gaussian = Gaussian { network: &network, deviations: &deviations };
        let mut scratch = Scratch::default();
        batch.add_outcome(gaussian, &old, &means, 0..4, &mut scratch, &mut outcome);
        batch.add_outcome(gaussian, &old, &means, 4..7, &mut scratch, &mut outcome);
        outcome
    }

    fn check(run: impl Fn(&Buffer, &Batch<'_>, Gaussian<'_>)) {
        let (network, deviations) = moved(&direction(0.0), 0.0);
        let mut buffer = buffer();
        for (place, log_prob) in buffer.log_probs.iter_mut().enumerate() {
            let mut workspace = Workspace::default();
            let mean = network.forward(&buffer.observations[2 * place..][..2], &mut workspace);
            *log_prob = deviations.log_prob(mean, &buffer.actions[2 * place..][..2]);
        }
        let normalizer = Normalizer::new(&[0.0; 2], &[1.0; 2]).unwrap();
        let batch =
            Batch { buffer: &buffer, advantage_mean: 0.125, advantage_scale: 1.5, normalizer: &normalizer };
        run(&buffer, &batch, Gaussian { network: &network, deviations: &deviations });
    }

    #[test]
    fn the_gradient_is_the_slope_of_the_surrogate() {
        check(|buffer, batch, policy| {
            let mut gradient = vec![0.0; policy.network.parameter_count() + 2];
            let mut scratch = Scratch::default();
            batch.add_gradient(policy, 0..3, &mut scratch, &mut gradient);
            batch.add_gradient(policy, 3..7, &mut scratch, &mut gradient);
            for which in 0..4 {
                let along = direction(which as f32);
                let h = 1.0 / 512.0;
                let slope = (outcome(buffer, batch, &along, h)[0] - outcome(buffer, batch, &along, -h)[0])
                    / f64::from(2.0 * h);
                let found: f64 = gradient.iter().zip(&along).map(|(g, d)| f64::from(g * d)).sum();
                assert!((slope - found).abs() < 1e-3 * (1.0 + slope.abs()), "{slope} {found}");
            }
        });
    }

    #[test]
    fn the_fisher_product_is_the_curvature_of_the_divergence() {
        check(|buffer, batch, policy| {
            let count = policy.network.parameter_count() + 2;
            for which in 0..4 {
                let along = direction(which as f32);
                let mut product = vec![0.0; count];
                let mut scratch = Scratch::default();
                batch.add_fisher_product(policy, 1, &along, 0..5, &mut scratch, &mut product);
                batch.add_fisher_product(policy, 1, &along, 5..7, &mut scratch, &mut product);
                let found: f64 = product.iter().zip(&along).map(|(p, d)| f64::from(p * d)).sum();
                // KL(h v) = h²/2 vᵀHv + O(h³), whose odd part falls out of the sum of both sides.
                let h = 1.0 / 64.0;
                let both = outcome(buffer, batch, &along, h)[1] + outcome(buffer, batch, &along, -h)[1];
                let curvature = both / f64::from(h * h);
                assert!((curvature - found).abs() < 2e-2 * found, "{curvature} {found}");
            }
        });
    }

    #[test]
    fn a_sampled_fisher_product_is_that_of_its_rows() {
        check(|_, batch, policy| {
            let along = direction(1.0);
            let (mut sampled, mut rows) = (vec![0.0; along.len()], vec![0.0; along.len()]);
            let mut scratch = Scratch::default();
            // Rows 0, 3 and 6 of seven.
            batch.add_fisher_product(policy, 3, &along, 0..3, &mut scratch, &mut sampled);
            for row in [0, 3, 6] {
                batch.add_fisher_product(policy, 1, &along, row..row + 1, &mut scratch, &mut rows);
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
