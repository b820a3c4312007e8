//! Reward terms for the manner in which the robot does a task. Each has a weight, and exists only
//! if its weight is above 0.
//!
//! Rest and action rate follow from the state after a control step and its action. Contact force
//! and speed are signals of the manner, which an engine computes only where they are requested.

use mishandle_world::Rows;

use crate::definition::{Quantity, scalar};
use crate::manner::{JOINT_SPEED_SHARE, LARGEST_FORCES, MANNER, REST_SPEED, TOOL_SPEED, limit};
use crate::robot::{ARM_JOINTS, JOINTS, Panda};

/// Contact force at which the term is half of its bound, N: the limit of careful success for
/// lasting contact.
#[expect(clippy::unnecessary_cast, reason = "the literal is written without decimals in the formula")]
const HALF_FORCE: f64 = limit!(mean_force) as f64;

/// Limits of careful success: share of the speed limit of a joint, and speed of the tool, m/s.
const SPEED_LIMITS: [f64; 2] = [limit!(joint_speed_share), limit!(tool_speed)];

/// Share of a limit of speed up to which speed costs nothing.
const FREE_SPEED: f64 = 0.8;

/// Number of values that the terms need from the control steps before: the last action, and the
/// number of control steps.
const MEMORY: usize = JOINTS + 1;

/// The terms, before they are multiplied by their weights. Each is between -1 and 0, except that
/// noise may exceed the range of actions.
pub static MANNER_REWARD: &[Quantity] = &[
    scalar(
        "contact_force",
        "",
        concat!(
            "-F / (F + ",
            limit!(mean_force),
            " N), where F is the sum of the largest forces of the control step that `careful` limits"
        ),
    ),
    scalar(
        "action_rate",
        "",
        "minus the mean of ((a - b) / 2)² over the actions; b is the action of the control step before, 0 at first",
    ),
    scalar(
        "speed",
        "",
        concat!(
            "-min(max(s - 0.8, 0), 1), where s is the larger of `joint_speed_share` / ",
            limit!(joint_speed_share),
            " and `tool_speed` / (",
            limit!(tool_speed),
            " m/s)"
        ),
    ),
    scalar(
        "rest",
        "",
        "-v / (v + 0.05 rad/s) with the largest speed v of a joint of the arm; 0 in the first half of the episode",
    ),
];

/// Weights of the terms, in the order of [`MANNER_REWARD`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MannerWeights {
    /// Weight of the contact force.
    pub contact_force: f64,
    /// Weight of the action rate.
    pub action_rate: f64,
    /// Weight of the speed.
    pub speed: f64,
    /// Weight of the motion at the end of an episode.
    pub rest: f64,
}

impl MannerWeights {
    fn array(&self) -> [f64; 4] {
        [self.contact_force, self.action_rate, self.speed, self.rest]
    }
}

/// The terms of an environment.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct MannerReward {
    weights: MannerWeights,
    /// Which of the [`LARGEST_FORCES`] careful success limits.
    limited: [bool; LARGEST_FORCES.len()],
    /// Number of control steps of an episode in which the robot need not rest.
    busy_steps: usize,
}

impl MannerReward {
    /// Makes the terms for training episodes of this length, of a task whose careful success reads
    /// these signals.
    pub fn new(weights: MannerWeights, episode_steps: usize, careful: &[&str]) -> MannerReward {
        let limited = LARGEST_FORCES.map(|force| careful.contains(&MANNER[force].name));
        MannerReward { weights, limited, busy_steps: episode_steps / 2 }
    }

    /// Returns the terms with a weight above 0.
    pub fn terms(&self) -> impl Iterator<Item = &'static Quantity> {
        MANNER_REWARD
            .iter()
            .zip(self.weights.array())
            .filter(|(_, weight)| *weight > 0.0)
            .map(|(term, _)| term)
    }

    /// Returns whether a term needs the signals of the manner.
    pub fn needs_manner(&self) -> bool {
        self.weights.contact_force > 0.0 || self.weights.speed > 0.0
    }

    /// Returns the length of the memory of an episode, which is 0 at its start.
    pub fn memory_size(&self) -> usize {
        if self.terms().next().is_some() { MEMORY } else { 0 }
    }

    /// Writes the terms after a control step and updates the memory of the episode. `manner` are
    /// the signals of the manner, if the environment computes them.
    pub fn write(
        &self,
        rows: &Rows<'_>,
        panda: &Panda,
        manner: &[f64],
        action: &[f64],
        memory: &mut [f64],
        out: &mut [f64],
    ) {
        if memory.is_empty() {
            return;
        }
        let (last_action, steps) = memory.split_at_mut(JOINTS);
        steps[0] += 1.0;
        let forces = LARGEST_FORCES.iter().zip(self.limited).filter(|(_, limited)| *limited);
        let terms: [&dyn Fn() -> f64; 4] = [
            &|| saturated(forces.clone().map(|(force, _)| manner[*force]).sum(), HALF_FORCE),
            &|| mean(action.iter().zip(&*last_action).map(|(now, before)| 0.5 * (now - before))),
            &|| {
                let [joint, tool] = SPEED_LIMITS;
                let share = (manner[JOINT_SPEED_SHARE] / joint).max(manner[TOOL_SPEED] / tool);
                (share - FREE_SPEED).clamp(0.0, 1.0)
            },
            &|| {
                if steps[0] > self.busy_steps as f64 {
                    let speeds = panda.joints()[..ARM_JOINTS].iter().map(|joint| rows.qvel[joint.dof].abs());
                    saturated(speeds.fold(0.0, f64::max), REST_SPEED)
                } else {
                    0.0
                }
            },
        ];
        let used = terms.iter().zip(self.weights.array()).filter(|(_, weight)| *weight > 0.0);
        for (out, (term, weight)) in out.iter_mut().zip(used) {
            *out = -weight * term();
        }
        last_action.copy_from_slice(action);
    }
}

/// Returns x / (x + half), which grows to 1.
fn saturated(x: f64, half: f64) -> f64 {
    x / (x + half)
}

/// Returns the mean of the squares.
fn mean(numbers: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = numbers.len() as f64;
    numbers.map(|x| x * x).sum::<f64>() / count
}
