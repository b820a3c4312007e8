//! Deterministic policy a = μ(o) with tanh output: exploration noise, and the deterministic policy
//! gradient.

use std::ops::Range;

use mishandle_controllers::Policy;
use mishandle_network::{Activation, Mlp, Scalar, Workspace};
use mishandle_rollout::Seed;

use crate::off_policy::action_value::{NetworkWithTarget, Sizes, concatenate};
use crate::off_policy::agent::BehaviorPolicy;
use crate::off_policy::transitions::{TransitionBatch, TransitionSlice};
use crate::{ActorSettings, ExplorationDecay, TrainingError};

/// Gaussian exploration noise with a different standard deviation in each environment.
///
/// Environments with little noise give near-on-policy data to the critic, environments with much
/// noise discover new states. This replaces a tuned noise schedule.
///
/// # Reference
/// Li et al., "Parallel Q-Learning: Scaling Off-policy Reinforcement Learning under Massively
/// Parallel Simulation", ICML 2023.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Exploration {
    /// Standard deviations of the first and of the last environment, interpolated linearly between
    /// them.
    pub std: [f64; 2],
    /// Decay of the noise, if any.
    pub decay: Option<ExplorationDecay>,
    /// Number of control steps for which an environment repeats its noise.
    pub hold: u64,
}

/// Standard deviation that replaces 0, whose logarithm is infinite; its effect on an action is
/// below rounding.
const MIN_STD: f64 = 1e-9;

impl Exploration {
    fn std_of(&self, row: usize, rows: usize) -> f64 {
        let [low, high] = self.std;
        low + (high - low) * row as f64 / (rows.max(2) - 1) as f64
    }
}

/// μ, its target network, and its exploration noise.
#[derive(Debug)]
pub(crate) struct DeterministicActor {
    pub policy: NetworkWithTarget,
    exploration: Exploration,
}

impl DeterministicActor {
    /// Creates an actor whose initial actions are near 0 for all observations.
    ///
    /// # Errors
    /// If a layer has size 0.
    pub fn new(
        sizes: Sizes,
        settings: &ActorSettings,
        exploration: Exploration,
        seed: Seed,
    ) -> Result<DeterministicActor, TrainingError> {
        let sizes = [&[sizes.observation], &settings.hidden[..], &[sizes.action]].concat();
        let mut network = Mlp::new(&sizes, settings.activation, Activation::Tanh)?;
        settings.initialization.initialize(&mut network, 0.01, seed)?;
        Ok(DeterministicActor {
            policy: NetworkWithTarget::new(network, settings.learning_rate),
            exploration,
        })
    }
}

impl DeterministicActor {
    /// Replaces μ and its target network by the network of a policy. Its exploration noise is not
    /// used.
    pub fn start_from(&mut self, policy: &Policy) {
        self.policy.replace(policy.network());
    }
}

impl BehaviorPolicy for DeterministicActor {
    fn network(&self) -> &Mlp<f32> {
        &self.policy.network
    }

    fn noise_hold(&self) -> u64 {
        self.exploration.hold
    }

    fn noise_decay(&self) -> Option<ExplorationDecay> {
        self.exploration.decay
    }

    /// clip(μ + σ z, -1, 1)
    fn sample_action(&self, row: usize, rows: usize, means: &[f32], noise: &[f64], action: &mut [f32]) {
        let std = self.exploration.std_of(row, rows);
        for ((action, mean), z) in action.iter_mut().zip(means).zip(noise) {
            *action = (f64::from(*mean) + std * z).clamp(-1.0, 1.0) as f32;
        }
    }

    /// As a stochastic policy it has the initial exploration noise of the middle environment.
    fn policy(&self, length: usize, mean: Vec<f64>, variance: Vec<f64>) -> Result<Policy, TrainingError> {
        let [low, high] = self.exploration.std;
        let log_std = (0.5 * (low + high)).max(MIN_STD).ln() as f32;
        let log_stds = vec![log_std; self.network().output_size()];
        Ok(Policy::with_history(length, mean, variance, self.network().clone(), Some(log_stds))?)
    }
}

/// Loss of the deterministic policy gradient: -mean Q(o, μ(o)).
///
/// # Reference
/// Silver et al., "Deterministic Policy Gradient Algorithms", ICML 2014.
pub struct PolicyLoss<'a, T> {
    /// The transitions.
    pub batch: &'a TransitionBatch<T>,
    /// μ
    pub actor: &'a Mlp<T>,
    /// Q
    pub critic: &'a Mlp<T>,
}

/// Scratch memory of one thread.
#[derive(Debug, Default)]
pub struct PolicyScratch<T> {
    actor: Workspace<T>,
    critic: Workspace<T>,
    inputs: Vec<T>,
    output_gradient: Vec<T>,
    inputs_gradient: Vec<T>,
    actions_gradient: Vec<T>,
}

impl<T: Scalar> PolicyLoss<'_, T> {
    /// Returns the contribution of the rows `rows` to the loss and adds its gradient with respect
    /// to the actor's parameters to `gradient`.
    pub fn add_gradient(
        &self,
        rows: Range<usize>,
        scratch: &mut PolicyScratch<T>,
        gradient: &mut [T],
    ) -> f64 {
        let PolicyLoss { batch, actor, critic } = self;
        let weight = 1.0 / batch.rows() as f64;
        let columns = actor.input_size();
        let size = actor.output_size();
        let count = rows.len();
        let TransitionSlice { observations, privileged, .. } = batch.slice(rows);
        let PolicyScratch {
            actor: actor_pass,
            critic: critic_pass,
            inputs,
            output_gradient,
            inputs_gradient,
            actions_gradient,
        } = scratch;
        concatenate([observations, actor.forward(observations, actor_pass), privileged], count, inputs);
        let values = critic.forward(inputs, critic_pass);
        let loss = values.iter().map(|value| -weight * value.to_f64()).sum();
        output_gradient.clear();
        output_gradient.resize(count, T::from_f64(-weight));
        inputs_gradient.resize(inputs.len(), T::ZERO);
        critic.backward(output_gradient, critic_pass, None, Some(inputs_gradient));
        actions_gradient.clear();
        for row in inputs_gradient.chunks_exact(critic.input_size()) {
            actions_gradient.extend_from_slice(&row[columns..][..size]);
        }
        actor.backward(actions_gradient, actor_pass, Some(gradient), None);
        loss
    }
}
