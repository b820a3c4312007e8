//! The critics' loss; the policy's is [`PolicyLoss`](crate::deterministic::PolicyLoss).

use std::ops::Range;

use mishandle_network::{Mlp, Scalar, Workspace};

use crate::batch::{Batch, cut};
use crate::twin_critics::TwinScratch;

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
        let CriticLoss { batch, smoothing, target_actor, critics, target_critics, .. } = self;
        let CriticScratch { actor, next_actions, critics: scratch } = scratch;
        let draws = cut(self.draws, batch.rows(), &rows);
        let part = batch.part(rows);

        next_actions.clear();
        for (action, z) in target_actor.forward(part.next_observations, actor).iter().zip(draws) {
            next_actions.push(T::from_f64(smoothing.smooth(action.to_f64(), *z)));
        }
        scratch.least_values(*target_critics, &part, next_actions);
        part.bootstrap(&mut scratch.targets);
        scratch.squared_errors(*critics, &part, 1.0 / batch.rows() as f64, gradient)
    }
}
