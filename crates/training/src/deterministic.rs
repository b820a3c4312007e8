//! A deterministic policy a = μ(o), whose network ends in tanh: how it explores, and how it learns from a critic.

use std::ops::Range;

use mishandle_controllers::Policy;
use mishandle_network::{Activation, Mlp, Scalar, Workspace};
use mishandle_rollout::Seed;

use crate::action_value::{Followed, join};
use crate::agent::Explorer;
use crate::batch::Batch;
use crate::{ActorSettings, ExplorationDecay, TrainingError};

/// How a policy explores: by noise on its actions, with another deviation in each row.
///
/// Rows that explore little show the critic what nearly the present policy gives, rows that explore much find what is
/// new; no schedule has to be tuned.
///
/// # Reference
/// Li et al., "Parallel Q-Learning: Scaling Off-policy Reinforcement Learning under Massively Parallel Simulation",
/// ICML 2023.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Exploration {
    /// Deviations of the first row and of the last; rows between them have evenly spaced ones.
    pub std: [f64; 2],
    /// How the noise falls, if it does.
    pub decay: Option<ExplorationDecay>,
    /// Control steps for which a row keeps its noise.
    pub hold: u64,
}

/// The deviation of a policy that explored with none: what it adds to an action is lost in rounding.
const LEAST_STD: f64 = 1e-9;

impl Exploration {
    fn std_of(&self, row: usize, rows: usize) -> f64 {
        let [low, high] = self.std;
        low + (high - low) * row as f64 / (rows.max(2) - 1) as f64
    }
}

/// μ, its target, and how it explores.
#[derive(Debug)]
pub(crate) struct DeterministicActor {
    pub followed: Followed,
    exploration: Exploration,
}

impl DeterministicActor {
    /// An actor with small first actions whatever is seen.
    ///
    /// # Errors
    /// If a layer has no outputs.
    pub fn new(
        (observation_size, action_size): (usize, usize),
        settings: &ActorSettings,
        exploration: Exploration,
        seed: Seed,
    ) -> Result<DeterministicActor, TrainingError> {
        let sizes = [&[observation_size], &settings.hidden[..], &[action_size]].concat();
        let mut network = Mlp::new(&sizes, settings.activation, Activation::Tanh)?;
        settings.initialization.initialize(&mut network, 0.01, seed)?;
        Ok(DeterministicActor { followed: Followed::new(network, settings.learning_rate), exploration })
    }
}

impl Explorer for DeterministicActor {
    fn network(&self) -> &Mlp<f32> {
        &self.followed.network
    }

    fn hold(&self) -> u64 {
        self.exploration.hold
    }

    fn decay(&self) -> Option<ExplorationDecay> {
        self.exploration.decay
    }

    /// clip(μ + σ z, -1, 1)
    fn explore(&self, row: usize, rows: usize, means: &[f32], draws: &[f64], action: &mut [f32]) {
        let std = self.exploration.std_of(row, rows);
        for ((action, mean), z) in action.iter_mut().zip(means).zip(draws) {
            *action = (f64::from(*mean) + std * z).clamp(-1.0, 1.0) as f32;
        }
    }

    /// If it is to draw its actions, it has the noise that the middle row begins with.
    fn policy(&self, mean: Vec<f64>, variance: Vec<f64>) -> Result<Policy, TrainingError> {
        let [low, high] = self.exploration.std;
        let log_std = (0.5 * (low + high)).max(LEAST_STD).ln() as f32;
        let log_stds = vec![log_std; self.network().output_size()];
        Ok(Policy::new(mean, variance, self.network().clone(), log_stds)?)
    }
}

/// The deterministic policy gradient: -mean Q(o, μ(o)).
///
/// # Reference
/// Silver et al., "Deterministic Policy Gradient Algorithms", ICML 2014.
pub struct PolicyLoss<'a, T> {
    /// The rows that are learned from.
    pub batch: &'a Batch<T>,
    /// μ
    pub actor: &'a Mlp<T>,
    /// Q
    pub critic: &'a Mlp<T>,
}

/// What one thread needs for it.
#[derive(Debug, Default)]
pub struct PolicyScratch<T> {
    actor: Workspace<T>,
    critic: Workspace<T>,
    inputs: Vec<T>,
    slopes: Vec<T>,
    by_inputs: Vec<T>,
    by_actions: Vec<T>,
}

impl<T: Scalar> PolicyLoss<'_, T> {
    /// The share of the rows `rows` of the batch; its derivatives by the actor's parameters are added to `gradient`.
    pub fn add_gradient(
        &self,
        rows: Range<usize>,
        scratch: &mut PolicyScratch<T>,
        gradient: &mut [T],
    ) -> f64 {
        let PolicyLoss { batch, actor, critic } = self;
        let share = 1.0 / batch.rows() as f64;
        let (columns, count) = (actor.input_size(), rows.len());
        let observations = batch.part(rows).observations;
        let PolicyScratch { actor: actor_pass, critic: critic_pass, inputs, slopes, by_inputs, by_actions } =
            scratch;
        join(observations, actor.forward(observations, actor_pass), count, inputs);
        let values = critic.forward(inputs, critic_pass);
        let loss = values.iter().map(|value| -share * value.to_f64()).sum();
        slopes.clear();
        slopes.resize(count, T::from_f64(-share));
        by_inputs.resize(inputs.len(), T::ZERO);
        critic.backward(slopes, critic_pass, None, Some(by_inputs));
        by_actions.clear();
        for row in by_inputs.chunks_exact(critic.input_size()) {
            by_actions.extend_from_slice(&row[columns..]);
        }
        actor.backward(by_actions, actor_pass, Some(gradient), None);
        loss
    }
}
