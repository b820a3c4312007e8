//! Critic loss of TD3. The policy loss is [`PolicyLoss`](crate::deterministic::PolicyLoss).

use std::ops::Range;

use mishandle_network::{Mlp, Scalar, Workspace};

use crate::off_policy::transitions::{TransitionBatch, row_slice};
use crate::off_policy::twin_critics::TwinScratch;

/// Target policy smoothing: noise clip(σ z, -c, c) on the target action.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TargetSmoothing {
    /// σ
    pub std: f64,
    /// c
    pub clip: f64,
}

impl TargetSmoothing {
    /// Returns clip(`action` + clip(σ z, -c, c), -1, 1).
    ///
    /// # Example
    /// ```
    /// use mishandle_training::td3::TargetSmoothing;
    /// let smoothing = TargetSmoothing { std: 0.5, clip: 0.25 };
    /// assert_eq!(smoothing.smooth(0.5, -0.25), 0.375);
    /// assert_eq!(smoothing.smooth(0.5, -2.0), 0.25);
    /// assert_eq!(smoothing.smooth(0.875, 2.0), 1.0);
    /// ```
    pub fn smooth(&self, action: f64, z: f64) -> f64 {
        (action + (self.std * z).clamp(-self.clip, self.clip)).clamp(-1.0, 1.0)
    }
}

/// Critic loss: mean (Q₁(s, a) - y)² + mean (Q₂(s, a) - y)²,
/// y = returns + discounts · min(Q₁'(s', a'), Q₂'(s', a'))
pub struct CriticLoss<'a, T> {
    /// The transitions.
    pub batch: &'a TransitionBatch<T>,
    /// z, `[rows, action_size]`.
    pub noise: &'a [f64],
    /// σ and c
    pub smoothing: TargetSmoothing,
    /// μ'
    pub target_actor: &'a Mlp<T>,
    /// Q₁ and Q₂
    pub critics: [&'a Mlp<T>; 2],
    /// Q₁' and Q₂'
    pub target_critics: [&'a Mlp<T>; 2],
}

/// Scratch memory of one thread.
#[derive(Debug, Default)]
pub struct CriticScratch<T> {
    actor: Workspace<T>,
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
        let CriticLoss { batch, smoothing, target_actor, critics, target_critics, .. } = self;
        let CriticScratch { actor, next_actions, critics: scratch } = scratch;
        let noise = row_slice(self.noise, batch.rows(), &rows);
        let transitions = batch.slice(rows);

        next_actions.clear();
        for (action, z) in target_actor.forward(transitions.next_observations, actor).iter().zip(noise) {
            next_actions.push(T::from_f64(smoothing.smooth(action.to_f64(), *z)));
        }
        scratch.compute_minimum(*target_critics, &transitions, next_actions);
        transitions.bootstrap(&mut scratch.targets);
        scratch.squared_errors(*critics, &transitions, 1.0 / batch.rows() as f64, gradient)
    }
}
