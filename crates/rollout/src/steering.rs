use crate::disturbance::{AxisRouting, Effect};
use crate::{Episode, RolloutError, Seed};

/// An axis of the space whose value a [`Steering`] can choose during the simulation, because it
/// disturbs actions and nothing before a control step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SteeredAxis {
    /// Index of the axis in the space.
    pub axis: usize,
    /// First control step in which the axis acts, from 0. Its value is chosen in this step.
    pub step: usize,
    /// Number of what it disturbs: axes of one kind and one entry of the action have the same
    /// channel.
    pub channel: usize,
}

/// The axes that can be steered in the simulations of a [`System`](crate::System).
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Steerable {
    /// The axes, in the order of their control steps.
    pub axes: Vec<SteeredAxis>,
    /// Length of an observation.
    pub observation_size: usize,
    /// Number of signals.
    pub signals: usize,
    /// Number of control steps of an episode.
    pub episode_steps: usize,
}

impl Steerable {
    /// Returns the axes that begin to act in a control step.
    pub fn beginning(&self, step: usize) -> &[SteeredAxis] {
        let first = self.axes.partition_point(|axis| axis.step < step);
        let after = self.axes.partition_point(|axis| axis.step <= step);
        &self.axes[first..after]
    }
}

/// The sight of a [`Steering`] when it chooses.
#[derive(Clone, Copy, Debug)]
pub struct Seen<'a> {
    /// Seed of the simulation.
    pub seed: Seed,
    /// The control step whose disturbances are chosen, from 0.
    pub step: usize,
    /// The input of the controller in this step.
    pub observation: &'a [f32],
    /// The signals before this step.
    pub signals: &'a [f64],
    /// The largest robustness that the requirement can still have, whatever follows.
    pub bound: f64,
}

/// Chooses values of a scenario while its simulation runs, from what it sees.
///
/// The simulation is that of the scenario with the chosen values, to the bit: it can be repeated
/// without the steering. What a steering remembers of a simulation is a row of numbers. Its choices
/// must depend on nothing but its arguments.
pub trait Steering: Sync {
    /// Returns the length of its memory per simulation, which begins with zeros.
    fn memory_size(&self) -> usize;

    /// Replaces the values of `axes`, which begin to act in this control step. `values` has one
    /// value for each; before, those of the request.
    fn steer(&self, seen: Seen<'_>, axes: &[SteeredAxis], memory: &mut [f64], values: &mut [f64]);
}

/// A simulation that was steered.
#[derive(Clone, Debug, PartialEq)]
pub struct SteeredEpisode {
    /// The episode. Its request has the scenario with the chosen values.
    pub episode: Episode,
    /// The memory of the steering.
    pub memory: Vec<f64>,
}

impl Effect {
    /// Returns the channel of a disturbance of the action; `None` if it disturbs something else, or
    /// delays.
    fn action_channel(&self) -> Option<(bool, usize)> {
        match self {
            Effect::ActionDraw { entry, .. } => Some((true, *entry)),
            Effect::Action { entry, .. } => Some((false, *entry)),
            _ => None,
        }
    }
}

impl AxisRouting {
    /// Returns the axes that can be steered, in the order of their control steps. An axis with more
    /// than one effect is steered only if all of them disturb actions.
    pub(crate) fn steered(&self, episode_steps: usize) -> Vec<SteeredAxis> {
        let mut channels: Vec<(bool, usize)> = Vec::new();
        let mut found: Vec<SteeredAxis> = Vec::new();
        for &(axis, ref effect) in self.effects() {
            let Some(key) = effect.action_channel() else { continue };
            let step = effect.first_step();
            let is_only = self.effects().iter().filter(|(other, _)| *other == axis).count() == 1;
            if !is_only || self.is_of_environment(axis) || step >= episode_steps {
                continue;
            }
            let channel = channels.iter().position(|known| *known == key).unwrap_or_else(|| {
                channels.push(key);
                channels.len() - 1
            });
            found.push(SteeredAxis { axis, step, channel });
        }
        found.sort_by_key(|axis| (axis.step, axis.axis));
        found
    }
}

/// Returns the error of a system that cannot be steered.
pub(crate) fn not_steerable() -> RolloutError {
    RolloutError::System("the simulations of this target cannot be steered".to_string())
}
