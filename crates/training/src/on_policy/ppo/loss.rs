//! PPO's losses for one row, and their gradient over a chunk of rows.

use mishandle_network::{Mlp, Normalizer, Workspace};

use crate::RolloutBuffer;
use crate::gaussian::DiagonalGaussian;
use crate::on_policy::critic::value_loss;
use crate::privileged::join;

/// Clipped surrogate loss of one row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surrogate {
    /// -min(r A, clip(r, 1-ε, 1+ε) A)
    pub loss: f64,
    /// Derivative with respect to log π(a|s): -r A where the unclipped product is smaller,
    /// otherwise 0.
    pub slope: f64,
    /// (r - 1) - log r, an unbiased, non-negative estimate of the KL divergence of the new policy
    /// from the old one.
    pub kl: f64,
}

/// Returns the clipped surrogate loss of an action with the log-probabilities `old_log_prob` and
/// `log_prob` under the old and the new policy.
///
/// ```text
/// r = e^(log_prob - old_log_prob),   loss = -min(r A, clip(r, 1-ε, 1+ε) A)
/// ```
///
/// # Example
/// ```
/// use mishandle_training::ppo::surrogate;
/// // r = 2 and A > 0: clipped at 1.2, gradient 0.
/// let s = surrogate(2.0_f64.ln(), 0.0, 3.0, 0.2);
/// assert!((s.loss + 3.6).abs() < 1e-12 && s.slope == 0.0);
/// // r = 2 and A < 0: not clipped.
/// let s = surrogate(2.0_f64.ln(), 0.0, -3.0, 0.2);
/// assert!((s.loss - 6.0).abs() < 1e-12 && (s.slope - 6.0).abs() < 1e-12);
/// ```
pub fn surrogate(log_prob: f64, old_log_prob: f64, advantage: f64, clip_epsilon: f64) -> Surrogate {
    let log_ratio = log_prob - old_log_prob;
    let ratio = log_ratio.exp();
    let plain = ratio * advantage;
    let clipped = ratio.clamp(1.0 - clip_epsilon, 1.0 + clip_epsilon) * advantage;
    let slope = if plain <= clipped { -plain } else { 0.0 };
    Surrogate { loss: -plain.min(clipped), slope, kl: (ratio - 1.0) - log_ratio }
}

/// Returns the critic's loss of one row and its derivative with respect to the output. The output
/// is clipped to `old` ± `clip`; outside of this range the derivative is 0.
///
/// # Example
/// ```
/// use mishandle_training::ppo::clipped_value_loss;
/// // The output 2 is clipped to 1.25: the loss is 0.5 (1.25 - 3)².
/// assert_eq!(clipped_value_loss(2.0, 1.0, 3.0, Some(0.25), 0.5), (1.53125, 0.0));
/// assert_eq!(clipped_value_loss(2.0, 1.0, 3.0, None, 0.5), (0.5, -1.0));
/// ```
pub fn clipped_value_loss(
    output: f64,
    old: f64,
    target: f64,
    clip: Option<f64>,
    loss_coef: f64,
) -> (f64, f64) {
    let prediction = clip.map_or(output, |clip| old + (output - old).clamp(-clip, clip));
    let (loss, slope) = value_loss(prediction, target, loss_coef);
    let is_clipped = clip.is_some_and(|clip| (output - old).abs() > clip);
    (loss, if is_clipped { 0.0 } else { slope })
}

/// Inputs of the gradient of a minibatch.
pub(super) struct Minibatch<'a> {
    pub buffer: &'a RolloutBuffer,
    /// Normalized value targets, one per row of the buffer.
    pub targets: &'a [f32],
    /// Normalized values from the time of the rollout.
    pub old_values: &'a [f32],
    /// Row indices of the buffer.
    pub rows: &'a [u32],
    /// Mean of the advantages.
    pub advantage_mean: f64,
    /// Inverse standard deviation of the advantages.
    pub advantage_inverse_std: f64,
    pub normalizer: &'a Normalizer<f32>,
    pub policy: &'a Mlp<f32>,
    pub gaussian: &'a DiagonalGaussian,
    pub critic: &'a Mlp<f32>,
    pub clip_epsilon: f64,
    /// Derivative of the weighted entropy with respect to each log σ.
    pub entropy_slope: f64,
    pub value_clip: Option<f64>,
    pub loss_coef: f64,
}

/// Scratch memory of one thread.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    inputs: Vec<f32>,
    critic_inputs: Vec<f32>,
    policy: Workspace<f32>,
    critic: Workspace<f32>,
    mean_gradient: Vec<f32>,
    value_gradient: Vec<f32>,
}

/// Names of the metrics at the end of the gradient vector; each is a mean over the minibatch.
pub(super) const METRICS: [&str; 3] = ["the KL divergence", "the policy's loss", "the critic's loss"];

impl Minibatch<'_> {
    /// Adds the contribution of the chunk `chunk` to the gradient of the mean loss with respect to
    /// the policy's parameters, log σ and the critic's parameters, followed by the
    /// [metrics](METRICS).
    pub fn add_gradient(&self, chunk: std::ops::Range<usize>, scratch: &mut Scratch, gradient: &mut [f32]) {
        let rows = &self.rows[chunk];
        let actions = self.policy.output_size();
        let (policy_gradient, rest) = gradient.split_at_mut(self.policy.parameter_count());
        let (log_std_gradient, rest) = rest.split_at_mut(actions);
        let (critic_gradient, metrics) = rest.split_at_mut(self.critic.parameter_count());
        let columns = self.policy.input_size();
        let Scratch { inputs, critic_inputs, policy, critic, mean_gradient, value_gradient } = scratch;
        inputs.resize(rows.len() * columns, 0.0);
        self.fill_inputs(rows, inputs);

        mean_gradient.resize(rows.len() * actions, 0.0);
        let means = self.policy.forward(inputs, policy);
        self.add_policy_loss(rows, means, mean_gradient, log_std_gradient, metrics);
        self.policy.backward(mean_gradient, policy, Some(policy_gradient), None);

        value_gradient.resize(rows.len(), 0.0);
        let inputs = match self.buffer.privileged_size() {
            0 => inputs,
            _ => {
                critic_inputs.resize(rows.len() * self.critic.input_size(), 0.0);
                self.fill_critic_inputs(rows, inputs, critic_inputs);
                critic_inputs
            }
        };
        let values = self.critic.forward(inputs, critic);
        self.add_critic_loss(rows, values, value_gradient, metrics);
        self.critic.backward(value_gradient, critic, Some(critic_gradient), None);
    }

    /// Fills `inputs`, `[rows, observation_size]`, with the normalized observations of some rows of
    /// the buffer.
    pub fn fill_inputs(&self, rows: &[u32], inputs: &mut [f32]) {
        let columns = self.policy.input_size();
        for (row, inputs) in rows.iter().zip(inputs.chunks_exact_mut(columns)) {
            inputs.copy_from_slice(&self.buffer.observations[*row as usize * columns..][..columns]);
        }
        self.normalizer.normalize(inputs);
    }

    /// Fills `inputs` with the normalized observations of some rows, each with its privileged
    /// inputs.
    pub fn fill_critic_inputs(&self, rows: &[u32], observations: &[f32], inputs: &mut [f32]) {
        let columns = self.policy.input_size();
        let size = self.buffer.privileged_size();
        let rows = rows.iter().map(|row| *row as usize);
        join(observations, columns, &self.buffer.privileged, size, rows, inputs);
    }

    /// Writes the derivatives of the mean loss with respect to the `means` of some rows,
    /// `[rows, actions]`. Adds those with respect to log σ, and the metrics.
    pub fn add_policy_loss(
        &self,
        rows: &[u32],
        means: &[f32],
        mean_gradient: &mut [f32],
        log_std_gradient: &mut [f32],
        metrics: &mut [f32],
    ) {
        let actions = self.policy.output_size();
        let share = 1.0 / self.rows.len() as f64;
        let mut kl = 0.0;
        let mut policy_loss = 0.0;
        for ((row, mean), mean_gradient) in
            rows.iter().zip(means.chunks_exact(actions)).zip(mean_gradient.chunks_exact_mut(actions))
        {
            let row = *row as usize;
            let action = &self.buffer.actions[row * actions..][..actions];
            let advantage = (self.buffer.advantages[row] - self.advantage_mean) * self.advantage_inverse_std;
            let log_prob = self.gaussian.log_prob(mean, action);
            let surrogate = surrogate(log_prob, self.buffer.log_probs[row], advantage, self.clip_epsilon);
            kl += surrogate.kl;
            policy_loss += surrogate.loss;
            self.gaussian.log_prob_gradient(
                mean,
                action,
                share * surrogate.slope,
                mean_gradient,
                log_std_gradient,
            );
        }
        for log_std_gradient in log_std_gradient {
            *log_std_gradient -= (self.entropy_slope * share * rows.len() as f64) as f32;
        }
        metrics[0] += (share * kl) as f32;
        metrics[1] += (share * policy_loss) as f32;
    }

    /// Writes the derivatives of the mean loss with respect to the critic's outputs for some rows,
    /// and adds the metric.
    pub fn add_critic_loss(
        &self,
        rows: &[u32],
        outputs: &[f32],
        value_gradient: &mut [f32],
        metrics: &mut [f32],
    ) {
        let share = 1.0 / self.rows.len() as f64;
        let mut critic_loss = 0.0;
        for ((row, output), slope_of_row) in rows.iter().zip(outputs).zip(value_gradient) {
            let row = *row as usize;
            let old = f64::from(self.old_values[row]);
            let target = f64::from(self.targets[row]);
            let (loss, slope) =
                clipped_value_loss(f64::from(*output), old, target, self.value_clip, self.loss_coef);
            critic_loss += loss;
            *slope_of_row = (share * slope) as f32;
        }
        metrics[2] += (share * critic_loss) as f32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::on_policy::mean_and_inverse_std;
    use mishandle_network::Activation;
    use mishandle_rollout::{Seed, Stream};

    #[test]
    fn the_surrogate_matches_a_calculation_by_hand() {
        // r = 1: -A, slope -A.
        assert_eq!(surrogate(-1.0, -1.0, 2.0, 0.2), Surrogate { loss: -2.0, slope: -2.0, kl: 0.0 });
        // r = ½, A = 2: min(1, 0.8 · 2) = 1, not clipped.
        let s = surrogate(0.5_f64.ln(), 0.0, 2.0, 0.2);
        assert!((s.loss + 1.0).abs() < 1e-15 && (s.slope + 1.0).abs() < 1e-15);
        // (½ - 1) - log ½ = log 2 - ½
        assert!((s.kl - (2.0_f64.ln() - 0.5)).abs() < 1e-15);
        // r = ½, A = -2: min(-1, -0.8 · 2) = -1.6, clipped.
        let s = surrogate(0.5_f64.ln(), 0.0, -2.0, 0.2);
        assert!((s.loss - 1.6).abs() < 1e-15 && s.slope == 0.0);
    }

    #[test]
    fn slopes_match_finite_differences_of_the_losses() {
        let h = 1e-6;
        for log_prob in [-0.5, -0.15, 0.0, 0.1, 0.4] {
            for advantage in [-1.5, 0.7] {
                let at = |log_prob: f64| surrogate(log_prob, 0.0, advantage, 0.2);
                let slope = (at(log_prob + h).loss - at(log_prob - h).loss) / (2.0 * h);
                assert!((slope - at(log_prob).slope).abs() < 1e-8, "{log_prob} {advantage}: {slope}");
            }
        }
        let (loss, slope) = value_loss(1.5, 1.0, 0.5);
        assert_eq!((loss, slope), (0.125, 0.5));
    }

    /// Two observations, a privileged input, two actions, five rows; the minibatch contains four of
    /// them, one of which is clipped.
    struct Example {
        buffer: RolloutBuffer,
        targets: Vec<f32>,
        policy: Mlp<f64>,
        critic: Mlp<f64>,
        log_std: Vec<f64>,
    }

    const ROWS: [u32; 4] = [4, 0, 3, 1];
    const ENTROPY_COEF: f64 = 0.1;

    fn network(inputs: usize, outputs: usize, seed: u64) -> Mlp<f64> {
        let mut network = Mlp::new(&[inputs, 5, outputs], Activation::Tanh, Activation::Identity).unwrap();
        let mut index = 0;
        network.initialize_uniform(|| {
            index += 1;
            // Weights that f32 represents exactly, so the network is the same in both precisions.
            f64::from(Seed(seed).uniform(Stream::Weights, 0, index) as f32)
        });
        network.update(|parameters| parameters.iter_mut().for_each(|p| *p = f64::from(*p as f32)));
        network
    }

    fn example() -> Example {
        let mut buffer = RolloutBuffer::new(5, 1, 2, 2).with_privileged(1);
        let numbers = |count: usize, shift: f64| (0..count).map(move |i| (i as f64 * 1.7 + shift).sin());
        buffer.observations = numbers(10, 0.0).map(|x| x as f32).collect();
        buffer.privileged = numbers(5, 4.0).map(|x| x as f32).collect();
        buffer.actions = numbers(10, 1.0).map(|x| x as f32).collect();
        buffer.advantages = numbers(5, 2.0).collect();
        // The ratios are near 1, except for the last row, which is clipped.
        buffer.log_probs = vec![-2.0, -1.9, -2.1, -2.2, 3.0];
        let targets = numbers(5, 3.0).map(|x| x as f32).collect();
        Example {
            buffer,
            targets,
            policy: network(2, 2, 1),
            critic: network(3, 1, 2),
            log_std: vec![-0.25, 0.125],
        }
    }

    fn standardization(buffer: &RolloutBuffer) -> (f64, f64) {
        mean_and_inverse_std(ROWS.iter().map(|row| buffer.advantages[*row as usize]))
    }

    /// The mean loss from its definition, in f64.
    fn loss(example: &Example) -> f64 {
        let Example { buffer, targets, policy, critic, log_std } = example;
        let (mean, scale) = standardization(buffer);
        let mut sum = 0.0;
        for index in ROWS.map(|row| row as usize) {
            let row = [0, 1].map(|i| f64::from(buffer.observations[2 * index + i]));
            let means = policy.forward(&row, &mut Workspace::default()).to_vec();
            let log_prob: f64 = (0..2)
                .map(|i| {
                    let z = (f64::from(buffer.actions[2 * index + i]) - means[i]) / log_std[i].exp();
                    -0.5 * z * z - log_std[i] - 0.5 * std::f64::consts::TAU.ln()
                })
                .sum();
            let ratio = (log_prob - buffer.log_probs[index]).exp();
            let advantage = (buffer.advantages[index] - mean) * scale;
            sum -= (ratio * advantage).min(ratio.clamp(0.8, 1.2) * advantage);
            let seen = [row[0], row[1], f64::from(buffer.privileged[index])];
            let value = critic.forward(&seen, &mut Workspace::default())[0];
            sum += 0.5 * (value - f64::from(targets[index])).powi(2);
        }
        // The entropy without its constant.
        sum / ROWS.len() as f64 - ENTROPY_COEF * log_std.iter().sum::<f64>()
    }

    fn single(network: &Mlp<f64>) -> Mlp<f32> {
        let mut copy = Mlp::new(network.sizes(), Activation::Tanh, Activation::Identity).unwrap();
        copy.update(|own| {
            for (own, parameter) in own.iter_mut().zip(network.parameters()) {
                *own = *parameter as f32;
            }
        });
        copy
    }

    #[test]
    fn the_gradient_of_a_minibatch_matches_finite_differences() {
        let mut example = example();
        let policy = single(&example.policy);
        let critic = single(&example.critic);
        let policy_size = policy.parameter_count();
        let critic_size = critic.parameter_count();
        let mut gradient = vec![0.0; policy_size + 2 + critic_size + METRICS.len()];
        let (advantage_mean, advantage_inverse_std) = standardization(&example.buffer);
        let log_std: Vec<f32> = example.log_std.iter().map(|x| *x as f32).collect();
        let minibatch = Minibatch {
            buffer: &example.buffer,
            targets: &example.targets,
            old_values: &example.targets,
            rows: &ROWS,
            advantage_mean,
            advantage_inverse_std,
            normalizer: &Normalizer::new(&[0.0; 2], &[1.0; 2]).unwrap(),
            policy: &policy,
            gaussian: &DiagonalGaussian::new(&log_std),
            critic: &critic,
            clip_epsilon: 0.2,
            entropy_slope: ENTROPY_COEF,
            value_clip: None,
            loss_coef: 0.5,
        };
        // Two chunks, as on two threads.
        let mut scratch = Scratch::default();
        minibatch.add_gradient(0..3, &mut scratch, &mut gradient);
        minibatch.add_gradient(3..4, &mut scratch, &mut gradient);
        let h = 1e-6;
        for (i, found) in gradient[..policy_size + 2 + critic_size].iter().enumerate() {
            let mut moved = |by: f64| {
                if i < policy_size {
                    example.policy.update(|parameters| parameters[i] += by);
                } else if i < policy_size + 2 {
                    example.log_std[i - policy_size] += by;
                } else {
                    example.critic.update(|parameters| parameters[i - policy_size - 2] += by);
                }
                loss(&example)
            };
            let above = moved(h);
            let below = moved(-2.0 * h);
            moved(h);
            let slope = (above - below) / (2.0 * h);
            assert!((slope - f64::from(*found)).abs() < 2e-6 * (1.0 + slope.abs()), "{i}: {slope} {found}");
        }
    }
}
