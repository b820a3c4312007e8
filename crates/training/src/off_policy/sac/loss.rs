//! Critic, policy and temperature losses of SAC.

use std::ops::Range;

use mishandle_network::{Mlp, Scalar, Workspace};

use crate::off_policy::action_value::concatenate;
use crate::off_policy::sac::squashed_sample::SquashedSample;
use crate::off_policy::transitions::{TransitionBatch, TransitionSlice, row_slice};
use crate::off_policy::twin_critics::TwinScratch;
use crate::sac::{Actor, Distribution};

/// Critic loss: mean ½ (Q₁(s, a) - y)² + mean ½ (Q₂(s, a) - y)²,
/// y = returns + discounts · (min(Q₁'(s', a'), Q₂'(s', a')) - α log π(a'|s'))
pub struct CriticLoss<'a, T> {
    /// The transitions.
    pub batch: &'a TransitionBatch<T>,
    /// z of a', `[rows, action_size]`.
    pub noise: &'a [f64],
    /// Temperature α.
    pub temperature: f64,
    /// π
    pub actor: Actor<'a, T>,
    /// Q₁ and Q₂
    pub critics: [&'a Mlp<T>; 2],
    /// Q₁' and Q₂'
    pub target_critics: [&'a Mlp<T>; 2],
}

/// Scratch memory of one thread.
#[derive(Debug, Default)]
pub struct CriticScratch<T> {
    actor: Workspace<T>,
    samples: Vec<SquashedSample>,
    next_actions: Vec<T>,
    critics: TwinScratch<T>,
}

impl<T: Scalar> CriticLoss<'_, T> {
    /// Returns the contribution of the rows `rows` to the loss and adds its gradient with respect
    /// to the parameters of Q₁, then of Q₂, to `gradient`.
    pub fn add_gradient(
        &self,
        rows: Range<usize>,
        scratch: &mut CriticScratch<T>,
        gradient: &mut [T],
    ) -> f64 {
        let CriticLoss { batch, temperature, actor, critics, target_critics, .. } = self;
        let CriticScratch { actor: actor_pass, samples, next_actions, critics: scratch } = scratch;
        let noise = row_slice(self.noise, batch.rows(), &rows);
        let transitions = batch.slice(rows);

        actor.sample(transitions.next_observations, noise, actor_pass, samples, next_actions);
        scratch.compute_minimum(*target_critics, &transitions, next_actions);
        for (value, samples) in scratch.targets.iter_mut().zip(samples.chunks_exact(actor.action_size())) {
            *value = T::from_f64(value.to_f64() - temperature * log_prob(samples));
        }
        transitions.bootstrap(&mut scratch.targets);
        scratch.squared_errors(*critics, &transitions, 0.5 / batch.rows() as f64, gradient)
    }
}

/// Policy loss: mean α log π(a|s) - min(Q₁(s, a), Q₂(s, a)), with a sampled from π(·|s) by
/// reparameterization with z.
pub struct PolicyLoss<'a, T> {
    /// The transitions.
    pub batch: &'a TransitionBatch<T>,
    /// z of a, `[rows, action_size]`.
    pub noise: &'a [f64],
    /// Temperature α.
    pub temperature: f64,
    /// π
    pub actor: Actor<'a, T>,
    /// Q₁ and Q₂
    pub critics: [&'a Mlp<T>; 2],
}

/// Scratch memory of one thread.
#[derive(Debug, Default)]
pub struct PolicyScratch<T> {
    actor: Workspace<T>,
    critics: [Workspace<T>; 2],
    samples: Vec<SquashedSample>,
    actions: Vec<T>,
    inputs: Vec<T>,
    value_gradients: [Vec<T>; 2],
    inputs_gradient: [Vec<T>; 2],
    outputs_gradient: Vec<T>,
}

impl<T: Scalar> PolicyLoss<'_, T> {
    /// Returns the contribution of the rows `rows` to the loss and to mean log π, and adds the
    /// gradient with respect to the parameters of the actor's network, then log σ, to `gradient`.
    pub fn add_gradient(
        &self,
        rows: Range<usize>,
        scratch: &mut PolicyScratch<T>,
        gradient: &mut [T],
    ) -> (f64, f64) {
        let PolicyLoss { batch, temperature, actor, critics, .. } = self;
        let weight = 1.0 / batch.rows() as f64;
        let columns = actor.network.input_size();
        let size = actor.action_size();
        let count = rows.len();
        let PolicyScratch {
            actor: actor_pass,
            critics: passes,
            samples,
            actions,
            inputs,
            value_gradients,
            inputs_gradient,
            outputs_gradient,
        } = scratch;

        let noise = row_slice(self.noise, batch.rows(), &rows);
        let TransitionSlice { observations, privileged, .. } = batch.slice(rows);
        actor.sample(observations, noise, actor_pass, samples, actions);
        concatenate([observations, actions, privileged], count, inputs);
        let [first, second] = &mut *passes;
        let values = critics[0].forward(inputs, first).iter().zip(critics[1].forward(inputs, second));
        let mut loss = 0.0;
        let mut mean_log_prob = 0.0;
        value_gradients.iter_mut().for_each(Vec::clear);
        for ((first, second), samples) in values.zip(samples.chunks_exact(size)) {
            let log_prob = log_prob(samples);
            let (minimum, value_gradient) =
                if second < first { (second, [0.0, -weight]) } else { (first, [-weight, 0.0]) };
            loss += weight * (temperature * log_prob - minimum.to_f64());
            mean_log_prob += weight * log_prob;
            value_gradients
                .iter_mut()
                .zip(value_gradient)
                .for_each(|(gradients, gradient)| gradients.push(T::from_f64(gradient)));
        }
        for (((critic, pass), value_gradients), inputs_gradient) in
            critics.iter().zip(passes).zip(value_gradients).zip(&mut *inputs_gradient)
        {
            inputs_gradient.resize(inputs.len(), T::ZERO);
            critic.backward(value_gradients, pass, None, Some(inputs_gradient));
        }

        let (network_gradient, log_std_gradient) = gradient.split_at_mut(actor.network.parameter_count());
        let outputs = actor.network.output_size();
        outputs_gradient.resize(outputs * count, T::ZERO);
        let input_size = critics[0].input_size();
        let inputs_gradient =
            inputs_gradient[0].chunks_exact(input_size).zip(inputs_gradient[1].chunks_exact(input_size));
        for ((outputs_gradient, (first, second)), samples) in
            outputs_gradient.chunks_exact_mut(outputs).zip(inputs_gradient).zip(samples.chunks_exact(size))
        {
            let (means_gradient, raw_gradient) = outputs_gradient.split_at_mut(size);
            for (i, sample) in samples.iter().enumerate() {
                let action_gradient = (first[columns + i] + second[columns + i]).to_f64();
                let (mean_gradient, spread_gradient) = sample.gradient(action_gradient, weight * temperature);
                means_gradient[i] = T::from_f64(mean_gradient);
                match actor.distribution {
                    Distribution::Squashed => raw_gradient[i] = T::from_f64(spread_gradient),
                    Distribution::Clipped => log_std_gradient[i] += T::from_f64(spread_gradient),
                }
            }
        }
        actor.network.backward(outputs_gradient, actor_pass, Some(network_gradient), None);
        (loss, mean_log_prob)
    }
}

/// Returns the temperature loss -log α (mean log π(a|s) + H̄) and its derivative with respect to
/// log α.
///
/// # Example
/// ```
/// use mishandle_training::sac::temperature_loss;
/// // The entropy 3 is above the target 2, so log α must decrease and the derivative is positive.
/// assert_eq!(temperature_loss(0.5, -3.0, 2.0), (0.5, 1.0));
/// ```
pub fn temperature_loss(log_temperature: f64, mean_log_prob: f64, target_entropy: f64) -> (f64, f64) {
    let slope = -(mean_log_prob + target_entropy);
    (log_temperature * slope, slope)
}

/// Returns log π of the action of one row.
fn log_prob(samples: &[SquashedSample]) -> f64 {
    samples.iter().map(|sample| sample.log_prob).sum()
}
