//! Two critics, of which the smaller value counts, since a policy seeks out values that are too large.

use mishandle_network::{Mlp, Scalar, Workspace};
use mishandle_rollout::Seed;

use crate::action_value::{Followed, join, squared_error};
use crate::agent::weights;
use crate::batch::Part;
use crate::{ActionValueSettings, Checkpoint, TrainingError};

/// Q₁ and Q₂ with their targets.
///
/// # Reference
/// Fujimoto, van Hoof and Meger, "Addressing Function Approximation Error in Actor-Critic Methods", ICML 2018.
#[derive(Debug)]
pub(crate) struct TwinCritics(pub [Followed; 2]);

/// Their names in a checkpoint.
const NAMES: [&str; 2] = ["critic_1", "critic_2"];

impl TwinCritics {
    /// Critics of observations and actions of these sizes; their first weights are drawn from the training's `seed`.
    ///
    /// # Errors
    /// If a layer has no outputs.
    pub fn new(
        sizes: (usize, usize),
        settings: &ActionValueSettings,
        seed: Seed,
    ) -> Result<TwinCritics, TrainingError> {
        let critic = |index| Followed::critic(sizes, settings, weights(seed, index));
        Ok(TwinCritics([critic(1)?, critic(2)?]))
    }

    /// Q₁ and Q₂.
    pub fn networks(&self) -> [&Mlp<f32>; 2] {
        self.0.each_ref().map(|critic| &critic.network)
    }

    /// Q₁' and Q₂'.
    pub fn targets(&self) -> [&Mlp<f32>; 2] {
        self.0.each_ref().map(|critic| &critic.target)
    }

    /// Parameters of both.
    pub fn parameter_count(&self) -> usize {
        self.networks().map(Mlp::parameter_count).iter().sum()
    }

    /// One step of both optimisers, along the gradient by the parameters of Q₁, then of Q₂.
    pub fn step(&mut self, gradient: &[f32]) {
        let parts = gradient.chunks_exact(gradient.len() / 2);
        self.0.iter_mut().zip(parts).for_each(|(critic, gradient)| critic.step(gradient));
    }

    /// One step of both targets.
    pub fn follow(&mut self, tau: f64) {
        self.0.iter_mut().for_each(|critic| critic.follow(tau));
    }

    /// Puts all that their future depends on into a checkpoint.
    pub fn save(&self, checkpoint: &mut Checkpoint) {
        self.0.iter().zip(NAMES).for_each(|(critic, name)| critic.save(name, checkpoint));
    }

    /// Goes on where a checkpoint was taken.
    ///
    /// # Errors
    /// If the checkpoint holds networks of other sizes.
    pub fn load(&mut self, checkpoint: &Checkpoint) -> Result<(), TrainingError> {
        self.0.iter_mut().zip(NAMES).try_for_each(|(critic, name)| critic.load(name, checkpoint))
    }
}

/// What one thread needs for the loss of two critics.
#[derive(Debug, Default)]
pub(crate) struct TwinScratch<T> {
    target_critics: [Workspace<T>; 2],
    critics: [Workspace<T>; 2],
    inputs: Vec<T>,
    /// y of each row, in the making.
    pub targets: Vec<T>,
    slopes: Vec<T>,
}

impl<T: Scalar> TwinScratch<T> {
    /// Makes the targets min(Q₁'(s', a'), Q₂'(s', a')), where `next_actions` are a'.
    pub fn least_values(&mut self, critics: [&Mlp<T>; 2], part: &Part<'_, T>, next_actions: &[T]) {
        join(part.next_observations, next_actions, part.rows(), &mut self.inputs);
        let [first, second] = &mut self.target_critics;
        let values = critics[0].forward(&self.inputs, first).iter();
        let values = values.zip(critics[1].forward(&self.inputs, second));
        self.targets.clear();
        self.targets.extend(values.map(|(first, second)| if second < first { *second } else { *first }));
    }

    /// `factor` Σ ((Q₁(s, a) - y)² + (Q₂(s, a) - y)²); its derivatives by the parameters of Q₁, then of Q₂, are added to
    /// `gradient`.
    pub fn squared_errors(
        &mut self,
        critics: [&Mlp<T>; 2],
        part: &Part<'_, T>,
        factor: f64,
        gradient: &mut [T],
    ) -> f64 {
        let TwinScratch { critics: passes, inputs, targets, slopes, .. } = self;
        join(part.observations, part.actions, part.rows(), inputs);
        let (by_first, by_second) = gradient.split_at_mut(critics[0].parameter_count());
        squared_error(critics[0], inputs, targets, factor, &mut passes[0], slopes, by_first)
            + squared_error(critics[1], inputs, targets, factor, &mut passes[1], slopes, by_second)
    }
}
