//! The losses of the critics, the policy and the temperature.

use std::ops::Range;

use mishandle_network::{Mlp, Scalar, Workspace};

use crate::action_value::join;
use crate::batch::{Batch, cut};
use crate::drawn::Drawn;
use crate::sac::{Actor, Distribution};
use crate::twin_critics::TwinScratch;

/// mean ½ (Q₁(s, a) - y)² + mean ½ (Q₂(s, a) - y)²,
/// y = returns + discounts · (min(Q₁'(s', a'), Q₂'(s', a')) - α log π(a'|s'))
pub struct CriticLoss<'a, T> {
    /// The rows that are learned from.
    pub batch: &'a Batch<T>,
    /// z of a', as many for each row as an action has numbers.
    pub draws: &'a [f64],
    /// α
    pub temperature: f64,
    /// π
    pub actor: Actor<'a, T>,
    /// Q₁ and Q₂
    pub critics: [&'a Mlp<T>; 2],
    /// Q₁' and Q₂'
    pub target_critics: [&'a Mlp<T>; 2],
}

/// What one thread needs for it.
#[derive(Debug, Default)]
pub struct CriticScratch<T> {
    actor: Workspace<T>,
    drawn: Vec<Drawn>,
    next_actions: Vec<T>,
    critics: TwinScratch<T>,
}

impl<T: Scalar> CriticLoss<'_, T> {
    /// The share of the rows `rows` of the batch; its derivatives by the parameters of Q₁, then of Q₂, are added to
    /// `gradient`.
    pub fn add_gradient(
        &self,
        rows: Range<usize>,
        scratch: &mut CriticScratch<T>,
        gradient: &mut [T],
    ) -> f64 {
        let CriticLoss { batch, temperature, actor, critics, target_critics, .. } = self;
        let CriticScratch { actor: actor_pass, drawn, next_actions, critics: scratch } = scratch;
        let draws = cut(self.draws, batch.rows(), &rows);
        let part = batch.part(rows);

        actor.draw(part.next_observations, draws, actor_pass, drawn, next_actions);
        scratch.least_values(*target_critics, &part, next_actions);
        for (value, drawn) in scratch.targets.iter_mut().zip(drawn.chunks_exact(actor.actions())) {
            *value = T::from_f64(value.to_f64() - temperature * log_prob(drawn));
        }
        part.bootstrap(&mut scratch.targets);
        scratch.squared_errors(*critics, &part, 0.5 / batch.rows() as f64, gradient)
    }
}

/// mean α log π(a|s) - min(Q₁(s, a), Q₂(s, a)),  a drawn from π(·|s) with z
pub struct PolicyLoss<'a, T> {
    /// The rows that are learned from.
    pub batch: &'a Batch<T>,
    /// z of a, as many for each row as an action has numbers.
    pub draws: &'a [f64],
    /// α
    pub temperature: f64,
    /// π
    pub actor: Actor<'a, T>,
    /// Q₁ and Q₂
    pub critics: [&'a Mlp<T>; 2],
}

/// What one thread needs for it.
#[derive(Debug, Default)]
pub struct PolicyScratch<T> {
    actor: Workspace<T>,
    critics: [Workspace<T>; 2],
    drawn: Vec<Drawn>,
    actions: Vec<T>,
    inputs: Vec<T>,
    slopes: [Vec<T>; 2],
    by_inputs: [Vec<T>; 2],
    by_outputs: Vec<T>,
}

impl<T: Scalar> PolicyLoss<'_, T> {
    /// The share of the rows `rows` of the batch, and of the mean log π(a|s); derivatives of the loss by the parameters of
    /// the actor's network, then by those beside it, are added to `gradient`.
    pub fn add_gradient(
        &self,
        rows: Range<usize>,
        scratch: &mut PolicyScratch<T>,
        gradient: &mut [T],
    ) -> (f64, f64) {
        let PolicyLoss { batch, temperature, actor, critics, .. } = self;
        let share = 1.0 / batch.rows() as f64;
        let (columns, size, count) = (actor.network.input_size(), actor.actions(), rows.len());
        let PolicyScratch {
            actor: actor_pass,
            critics: passes,
            drawn,
            actions,
            inputs,
            slopes,
            by_inputs,
            by_outputs,
        } = scratch;

        let draws = cut(self.draws, batch.rows(), &rows);
        let observations = batch.part(rows).observations;
        actor.draw(observations, draws, actor_pass, drawn, actions);
        join(observations, actions, count, inputs);
        let [first, second] = &mut *passes;
        let values = critics[0].forward(inputs, first).iter().zip(critics[1].forward(inputs, second));
        let (mut loss, mut mean_log_prob) = (0.0, 0.0);
        slopes.iter_mut().for_each(Vec::clear);
        for ((first, second), drawn) in values.zip(drawn.chunks_exact(size)) {
            let log_prob = log_prob(drawn);
            let (least, slope) =
                if second < first { (second, [0.0, -share]) } else { (first, [-share, 0.0]) };
            loss += share * (temperature * log_prob - least.to_f64());
            mean_log_prob += share * log_prob;
            slopes.iter_mut().zip(slope).for_each(|(slopes, slope)| slopes.push(T::from_f64(slope)));
        }
        for (((critic, pass), slopes), by_inputs) in
            critics.iter().zip(passes).zip(slopes).zip(&mut *by_inputs)
        {
            by_inputs.resize(inputs.len(), T::ZERO);
            critic.backward(slopes, pass, None, Some(by_inputs));
        }

        let (by_network, by_log_std) = gradient.split_at_mut(actor.network.parameter_count());
        let outputs = actor.network.output_size();
        by_outputs.resize(outputs * count, T::ZERO);
        let by_inputs =
            by_inputs[0].chunks_exact(columns + size).zip(by_inputs[1].chunks_exact(columns + size));
        for ((by_outputs, (first, second)), drawn) in
            by_outputs.chunks_exact_mut(outputs).zip(by_inputs).zip(drawn.chunks_exact(size))
        {
            let (by_means, by_raw) = by_outputs.split_at_mut(size);
            for (i, drawn) in drawn.iter().enumerate() {
                let by_action = (first[columns + i] + second[columns + i]).to_f64();
                let (by_mean, by_spread) = drawn.gradient(by_action, share * temperature);
                by_means[i] = T::from_f64(by_mean);
                match actor.distribution {
                    Distribution::Squashed => by_raw[i] = T::from_f64(by_spread),
                    Distribution::Clipped => by_log_std[i] += T::from_f64(by_spread),
                }
            }
        }
        actor.network.backward(by_outputs, actor_pass, Some(by_network), None);
        (loss, mean_log_prob)
    }
}

/// -log α (mean log π(a|s) + H̄), and its derivative by log α.
///
/// # Example
/// ```
/// use mishandle_training::sac::temperature_loss;
/// // The policy's entropy, 3, is above the target, 2: log α has to fall, so the derivative is positive.
/// assert_eq!(temperature_loss(0.5, -3.0, 2.0), (0.5, 1.0));
/// ```
pub fn temperature_loss(log_temperature: f64, mean_log_prob: f64, target_entropy: f64) -> (f64, f64) {
    let slope = -(mean_log_prob + target_entropy);
    (log_temperature * slope, slope)
}

/// log π of a row's action.
fn log_prob(drawn: &[Drawn]) -> f64 {
    drawn.iter().map(|drawn| drawn.log_prob).sum()
}
