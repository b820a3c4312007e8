//! PPO's losses at one row, and their gradient over a chunk of rows.

use mishandle_network::{Mlp, Normalizer, Workspace};

use crate::Buffer;
use crate::critic::value_loss;
use crate::gaussian::Deviations;

/// The clipped surrogate loss at one row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surrogate {
    /// -min(r A, clip(r, 1-ε, 1+ε) A)
    pub loss: f64,
    /// Its derivative by log π(a|s): -r A where the unclipped product is the smaller, else 0.
    pub slope: f64,
    /// (r - 1) - log r, whose mean estimates the divergence of the new policy from the old one, and is never negative.
    pub kl: f64,
}

/// The clipped surrogate loss of an action whose density had the logarithm `old_log_prob` and has `log_prob` now.
///
/// ```text
/// r = e^(log_prob - old_log_prob),   loss = -min(r A, clip(r, 1-ε, 1+ε) A)
/// ```
///
/// # Example
/// ```
/// use mishandle_training::ppo::surrogate;
/// // Twice as likely, and good: nothing is gained beyond 1.2.
/// let s = surrogate(2.0_f64.ln(), 0.0, 3.0, 0.2);
/// assert!((s.loss + 3.6).abs() < 1e-12 && s.slope == 0.0);
/// // Twice as likely, and bad: the full price.
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

/// The critic's loss at one row, and its derivative by the output: the output counts as no farther from `old` than
/// `clip` allows, and beyond it changes nothing.
///
/// # Example
/// ```
/// use mishandle_training::ppo::clipped_value_loss;
/// // From 1, an output of 2 counts as 1.25: the loss is 0.5 (1.25 - 3)².
/// assert_eq!(clipped_value_loss(2.0, 1.0, 3.0, Some(0.25), 0.5), (1.53125, 0.0));
/// assert_eq!(clipped_value_loss(2.0, 1.0, 3.0, None, 0.5), (0.5, -1.0));
/// ```
pub fn clipped_value_loss(
    output: f64,
    old: f64,
    target: f64,
    clip: Option<f64>,
    loss_scale: f64,
) -> (f64, f64) {
    let prediction = clip.map_or(output, |clip| old + (output - old).clamp(-clip, clip));
    let (loss, slope) = value_loss(prediction, target, loss_scale);
    let is_held = clip.is_some_and(|clip| (output - old).abs() > clip);
    (loss, if is_held { 0.0 } else { slope })
}

/// What the gradient of a minibatch is computed from.
pub(super) struct Minibatch<'a> {
    pub buffer: &'a Buffer,
    /// Targets of the critic's outputs, one for each entry of the buffer.
    pub targets: &'a [f32],
    /// What the critic's outputs were, on the same scale.
    pub old_values: &'a [f32],
    /// Places in the buffer.
    pub order: &'a [u32],
    /// What advantages are standardised with: a mean, and one over a standard deviation.
    pub advantage_mean: f64,
    pub advantage_scale: f64,
    pub normalizer: &'a Normalizer<f32>,
    pub policy: &'a Mlp<f32>,
    pub deviations: &'a Deviations,
    pub critic: &'a Mlp<f32>,
    pub clip_epsilon: f64,
    /// Derivative of the weighted entropy by each log σ.
    pub entropy_slope: f64,
    pub value_clip: Option<f64>,
    pub loss_scale: f64,
}

/// What one thread needs for it.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    inputs: Vec<f32>,
    policy: Workspace<f32>,
    critic: Workspace<f32>,
    mean_gradient: Vec<f32>,
    value_gradient: Vec<f32>,
}

/// Numbers behind the gradients: the means of what these name.
pub(super) const RIDERS: [&str; 3] = ["the policy's divergence", "the policy's loss", "the critic's loss"];

impl Minibatch<'_> {
    /// Adds the share of the rows `rows` of the minibatch to the gradient of the mean loss: by the policy's parameters,
    /// by log σ, by the critic's parameters, then the [riders](RIDERS).
    pub fn add_gradient(&self, rows: std::ops::Range<usize>, scratch: &mut Scratch, gradient: &mut [f32]) {
        let share = 1.0 / self.order.len() as f64;
        let places = &self.order[rows];
        let actions = self.policy.output_size();
        let (by_policy, rest) = gradient.split_at_mut(self.policy.parameter_count());
        let (by_log_std, rest) = rest.split_at_mut(actions);
        let (by_critic, riders) = rest.split_at_mut(self.critic.parameter_count());
        let columns = self.policy.input_size();
        let Scratch { inputs, policy, critic, mean_gradient, value_gradient } = scratch;

        inputs.clear();
        for place in places {
            inputs.extend_from_slice(&self.buffer.observations[*place as usize * columns..][..columns]);
        }
        self.normalizer.normalize(inputs);

        let (mut kl, mut policy_loss, mut critic_loss) = (0.0, 0.0, 0.0);
        mean_gradient.resize(places.len() * actions, 0.0);
        let means = self.policy.forward(inputs, policy);
        for ((place, mean), mean_gradient) in
            places.iter().zip(means.chunks_exact(actions)).zip(mean_gradient.chunks_exact_mut(actions))
        {
            let place = *place as usize;
            let action = &self.buffer.actions[place * actions..][..actions];
            let advantage = (self.buffer.advantages[place] - self.advantage_mean) * self.advantage_scale;
            let log_prob = self.deviations.log_prob(mean, action);
            let at_row = surrogate(log_prob, self.buffer.log_probs[place], advantage, self.clip_epsilon);
            kl += at_row.kl;
            policy_loss += at_row.loss;
            self.deviations.log_prob_gradient(mean, action, share * at_row.slope, mean_gradient, by_log_std);
        }
        for by_log_std in by_log_std {
            *by_log_std -= (self.entropy_slope * share * places.len() as f64) as f32;
        }
        self.policy.backward(mean_gradient, policy, Some(by_policy), None);

        value_gradient.clear();
        for (place, output) in places.iter().zip(self.critic.forward(inputs, critic)) {
            let place = *place as usize;
            let (old, target) = (f64::from(self.old_values[place]), f64::from(self.targets[place]));
            let (at_row, slope) =
                clipped_value_loss(f64::from(*output), old, target, self.value_clip, self.loss_scale);
            critic_loss += at_row;
            value_gradient.push((share * slope) as f32);
        }
        self.critic.backward(value_gradient, critic, Some(by_critic), None);
        for (rider, sum) in riders.iter_mut().zip([kl, policy_loss, critic_loss]) {
            *rider += (share * sum) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::actor_critic::mean_and_scale;
    use mishandle_network::Activation;
    use mishandle_rollout::{Seed, Stream};

    #[test]
    fn the_surrogate_worked_out_by_hand() {
        // r = 1: -A, slope -A.
        assert_eq!(surrogate(-1.0, -1.0, 2.0, 0.2), Surrogate { loss: -2.0, slope: -2.0, kl: 0.0 });
        // r = ½, A = 2: min(1, 0.8 · 2) = 1, the slope is live.
        let s = surrogate(0.5_f64.ln(), 0.0, 2.0, 0.2);
        assert!((s.loss + 1.0).abs() < 1e-15 && (s.slope + 1.0).abs() < 1e-15);
        // (½ - 1) - log ½ = log 2 - ½
        assert!((s.kl - (2.0_f64.ln() - 0.5)).abs() < 1e-15);
        // r = ½, A = -2: min(-1, -0.8 · 2) = -1.6, clipped.
        let s = surrogate(0.5_f64.ln(), 0.0, -2.0, 0.2);
        assert!((s.loss - 1.6).abs() < 1e-15 && s.slope == 0.0);
    }

    #[test]
    fn slopes_are_those_of_the_losses() {
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

    /// Two observations, two actions, five rows of which the minibatch takes four, one of them clipped.
    struct Example {
        buffer: Buffer,
        targets: Vec<f32>,
        policy: Mlp<f64>,
        critic: Mlp<f64>,
        log_std: Vec<f64>,
    }

    const PLACES: [u32; 4] = [4, 0, 3, 1];
    const ENTROPY_COEF: f64 = 0.1;

    fn network(outputs: usize, seed: u64) -> Mlp<f64> {
        let mut network = Mlp::new(&[2, 5, outputs], Activation::Tanh, Activation::Identity).unwrap();
        let mut index = 0;
        network.initialize_uniform(|| {
            index += 1;
            // Weights that f32 holds exactly, so that both precisions speak of the same network.
            f64::from(Seed(seed).uniform(Stream::Weights, 0, index) as f32)
        });
        network.update(|parameters| parameters.iter_mut().for_each(|p| *p = f64::from(*p as f32)));
        network
    }

    fn example() -> Example {
        let mut buffer = Buffer::new(5, 1, 2, 2);
        let numbers = |count: usize, shift: f64| (0..count).map(move |i| (i as f64 * 1.7 + shift).sin());
        buffer.observations = numbers(10, 0.0).map(|x| x as f32).collect();
        buffer.actions = numbers(10, 1.0).map(|x| x as f32).collect();
        buffer.advantages = numbers(5, 2.0).collect();
        // The actions were about as likely as they are, but for the last, which has become far less so.
        buffer.log_probs = vec![-2.0, -1.9, -2.1, -2.2, 3.0];
        let targets = numbers(5, 3.0).map(|x| x as f32).collect();
        Example { buffer, targets, policy: network(2, 1), critic: network(1, 2), log_std: vec![-0.25, 0.125] }
    }

    fn standardization(buffer: &Buffer) -> (f64, f64) {
        mean_and_scale(PLACES.iter().map(|place| buffer.advantages[*place as usize]))
    }

    /// The mean loss, written down from its definition in f64.
    fn loss(example: &Example) -> f64 {
        let Example { buffer, targets, policy, critic, log_std } = example;
        let (mean, scale) = standardization(buffer);
        let mut sum = 0.0;
        for place in PLACES.map(|place| place as usize) {
            let row = [0, 1].map(|i| f64::from(buffer.observations[2 * place + i]));
            let means = policy.forward(&row, &mut Workspace::default()).to_vec();
            let log_prob: f64 = (0..2)
                .map(|i| {
                    let z = (f64::from(buffer.actions[2 * place + i]) - means[i]) / log_std[i].exp();
                    -0.5 * z * z - log_std[i] - 0.5 * std::f64::consts::TAU.ln()
                })
                .sum();
            let ratio = (log_prob - buffer.log_probs[place]).exp();
            let advantage = (buffer.advantages[place] - mean) * scale;
            sum -= (ratio * advantage).min(ratio.clamp(0.8, 1.2) * advantage);
            let value = critic.forward(&row, &mut Workspace::default())[0];
            sum += 0.5 * (value - f64::from(targets[place])).powi(2);
        }
        // The entropy but for its constant.
        sum / PLACES.len() as f64 - ENTROPY_COEF * log_std.iter().sum::<f64>()
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
    fn the_gradient_of_a_minibatch_is_the_slope_of_its_loss() {
        let mut example = example();
        let (policy, critic) = (single(&example.policy), single(&example.critic));
        let (policy_size, critic_size) = (policy.parameter_count(), critic.parameter_count());
        let mut gradient = vec![0.0; policy_size + 2 + critic_size + RIDERS.len()];
        let (advantage_mean, advantage_scale) = standardization(&example.buffer);
        let log_std: Vec<f32> = example.log_std.iter().map(|x| *x as f32).collect();
        let minibatch = Minibatch {
            buffer: &example.buffer,
            targets: &example.targets,
            old_values: &example.targets,
            order: &PLACES,
            advantage_mean,
            advantage_scale,
            normalizer: &Normalizer::new(&[0.0; 2], &[1.0; 2]).unwrap(),
            policy: &policy,
            deviations: &Deviations::new(&log_std),
            critic: &critic,
            clip_epsilon: 0.2,
            entropy_slope: ENTROPY_COEF,
            value_clip: None,
            loss_scale: 0.5,
        };
        // In two chunks, as threads would.
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
            let (above, below) = (moved(h), moved(-2.0 * h));
            moved(h);
            let slope = (above - below) / (2.0 * h);
            assert!((slope - f64::from(*found)).abs() < 2e-6 * (1.0 + slope.abs()), "{i}: {slope} {found}");
        }
    }
}
