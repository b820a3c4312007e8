//! The critics' loss; the policy's is [`PolicyLoss`](crate::deterministic::PolicyLoss).

use std::ops::Range;

use mishandle_network::{Mlp, Scalar, Workspace};

use crate::action_value::{join, squared_error};
use crate::replay::Batch;

/// The noise on the target's action: clip(σ z, -c, c).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Smoothing {
    /// σ
    pub std: f64,
    /// c
    pub clip: f64,
}

impl Smoothing {
    /// clip(`action` + clip(σ z, -c, c), -1, 1)
    ///
    /// # Example
    /// ```
    /// use mishandle_training::td3::Smoothing;
    /// let smoothing = Smoothing { std: 0.5, clip: 0.25 };
    /// assert_eq!(smoothing.smooth(0.5, -0.25), 0.375);
    /// assert_eq!(smoothing.smooth(0.5, -2.0), 0.25);
    /// assert_eq!(smoothing.smooth(0.875, 2.0), 1.0);
    /// ```
    pub fn smooth(&self, action: f64, z: f64) -> f64 {
        (action + (self.std * z).clamp(-self.clip, self.clip)).clamp(-1.0, 1.0)
    }
}

/// mean (Q₁(s, a) - y)² + mean (Q₂(s, a) - y)²,  y = returns + discounts · min(Q₁'(s', a'), Q₂'(s', a'))
pub struct CriticLoss<'a, T> {
    /// The rows that are learned from.
    pub batch: &'a Batch<T>,
    /// z, as many for each row as an action has numbers.
    pub draws: &'a [f64],
    /// σ and c
    pub smoothing: Smoothing,
    /// μ'
    pub target_actor: &'a Mlp<T>,
    /// Q₁ and Q₂
    pub critics: [&'a Mlp<T>; 2],
    /// Q₁' and Q₂'
    pub target_critics: [&'a Mlp<T>; 2],
}

/// What one thread needs for it.
#[derive(Debug, Default)]
pub struct CriticScratch<T> {
    actor: Workspace<T>,
    targets_of: [Workspace<T>; 2],
    critics: [Workspace<T>; 2],
    next_actions: Vec<T>,
    inputs: Vec<T>,
    targets: Vec<T>,
    slopes: Vec<T>,
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
        let CriticLoss { batch, smoothing, target_actor, critics, target_critics, .. } = self;
        let (columns, size, count) = (target_actor.input_size(), target_actor.output_size(), rows.len());
        let CriticScratch { actor, targets_of, critics: passes, next_actions, inputs, targets, slopes } =
            scratch;

        let next = &batch.next_observations[rows.start * columns..rows.end * columns];
        let draws = &self.draws[rows.start * size..rows.end * size];
        next_actions.clear();
        for (action, z) in target_actor.forward(next, actor).iter().zip(draws) {
            next_actions.push(T::from_f64(smoothing.smooth(action.to_f64(), *z)));
        }
        join(next, next_actions, count, inputs);
        let [first, second] = targets_of;
        let values = target_critics[0].forward(inputs, first).iter();
        let values = values.zip(target_critics[1].forward(inputs, second));
        let behind = batch.returns[rows.clone()].iter().zip(&batch.discounts[rows.clone()]);
        targets.clear();
        for ((first, second), (returns, discount)) in values.zip(behind) {
            let least = if second < first { second } else { first };
            targets.push(discount.mul_add(*least, *returns));
        }

        let observations = &batch.observations[rows.start * columns..rows.end * columns];
        join(observations, &batch.actions[rows.start * size..rows.end * size], count, inputs);
        let share = 1.0 / batch.rows() as f64;
        let (by_first, by_second) = gradient.split_at_mut(critics[0].parameter_count());
        squared_error(critics[0], inputs, targets, share, &mut passes[0], slopes, by_first)
            + squared_error(critics[1], inputs, targets, share, &mut passes[1], slopes, by_second)
    }
}
