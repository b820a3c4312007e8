//! Critic loss of DDPG. The policy loss is [`PolicyLoss`](crate::deterministic::PolicyLoss).

use std::ops::Range;

use mishandle_network::{Mlp, Scalar, Workspace};

use crate::off_policy::action_value::{concatenate, squared_error};
use crate::off_policy::transitions::TransitionBatch;

/// Critic loss: mean (Q(s, a) - y)²,  y = returns + discounts · Q'(s', μ'(s'))
pub struct CriticLoss<'a, T> {
    /// The transitions.
    pub batch: &'a TransitionBatch<T>,
    /// μ'
    pub target_actor: &'a Mlp<T>,
    /// Q
    pub critic: &'a Mlp<T>,
    /// Q'
    pub target_critic: &'a Mlp<T>,
}

/// Scratch memory of one thread.
#[derive(Debug, Default)]
pub struct CriticScratch<T> {
    actor: Workspace<T>,
    target: Workspace<T>,
    critic: Workspace<T>,
    inputs: Vec<T>,
    targets: Vec<T>,
    output_gradient: Vec<T>,
}

impl<T: Scalar> CriticLoss<'_, T> {
    /// Returns the contribution of the rows `rows` to the loss and adds its gradient with respect
    /// to the critic's parameters to `gradient`.
    pub fn add_gradient(
        &self,
        rows: Range<usize>,
        scratch: &mut CriticScratch<T>,
        gradient: &mut [T],
    ) -> f64 {
        let CriticLoss { batch, target_actor, critic, target_critic } = self;
        let transitions = batch.slice(rows);
        let CriticScratch { actor, target, critic: critic_pass, inputs, targets, output_gradient } = scratch;

        let next_actions = target_actor.forward(transitions.next_observations, actor);
        let parts = [transitions.next_observations, next_actions, transitions.next_privileged];
        concatenate(parts, transitions.rows(), inputs);
        targets.clear();
        targets.extend_from_slice(target_critic.forward(inputs, target));
        transitions.bootstrap(targets);

        let parts = [transitions.observations, transitions.actions, transitions.privileged];
        concatenate(parts, transitions.rows(), inputs);
        let weight = 1.0 / batch.rows() as f64;
        squared_error(critic, inputs, targets, weight, critic_pass, output_gradient, gradient)
    }
}
