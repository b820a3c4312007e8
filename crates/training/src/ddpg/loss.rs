//! The critic's loss; the policy's is [`PolicyLoss`](crate::deterministic::PolicyLoss).

use std::ops::Range;

use mishandle_network::{Mlp, Scalar, Workspace};

use crate::action_value::{join, squared_error};
use crate::batch::Batch;

/// mean (Q(s, a) - y)²,  y = returns + discounts · Q'(s', μ'(s'))
pub struct CriticLoss<'a, T> {
    /// The rows that are learned from.
    pub batch: &'a Batch<T>,
    /// μ'
    pub target_actor: &'a Mlp<T>,
    /// Q
    pub critic: &'a Mlp<T>,
    /// Q'
    pub target_critic: &'a Mlp<T>,
}

/// What one thread needs for it.
#[derive(Debug, Default)]
pub struct CriticScratch<T> {
    actor: Workspace<T>,
    target: Workspace<T>,
    critic: Workspace<T>,
    inputs: Vec<T>,
    targets: Vec<T>,
    slopes: Vec<T>,
}

impl<T: Scalar> CriticLoss<'_, T> {
    /// The share of the rows `rows` of the batch; its derivatives by the critic's parameters are added to `gradient`.
    pub fn add_gradient(
        &self,
        rows: Range<usize>,
        scratch: &mut CriticScratch<T>,
        gradient: &mut [T],
    ) -> f64 {
        let CriticLoss { batch, target_actor, critic, target_critic } = self;
        let part = batch.part(rows);
        let CriticScratch { actor, target, critic: critic_pass, inputs, targets, slopes } = scratch;

        let next_actions = target_actor.forward(part.next_observations, actor);
        join(part.next_observations, next_actions, part.rows(), inputs);
        targets.clear();
        targets.extend_from_slice(target_critic.forward(inputs, target));
        part.bootstrap(targets);

        join(part.observations, part.actions, part.rows(), inputs);
        let share = 1.0 / batch.rows() as f64;
        squared_error(critic, inputs, targets, share, critic_pass, slopes, gradient)
    }
}
