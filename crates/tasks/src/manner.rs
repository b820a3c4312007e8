//! Signals of the manner in which the robot does a task: contact forces, and speed and torque of
//! its joints over all physics steps of a control step, and their acceleration over the whole.
//!
//! They cost time, so an environment computes them only [on request](crate::TaskEnvironment::with_manner).

use mishandle_world::{FORCES, Model, Probe, ProbedJoint, Readings, Rows, WorldError};

use crate::definition::{Attachment, Definition, Quantity, scalar};
use crate::robot::{ARM_JOINTS, CONTROL_DT, JOINT_NAMES, JOINTS, Panda, VELOCITY_LIMIT};

/// Acceleration limits of the arm's joints in Franka's data sheet, rad/s².
pub const ACCELERATION_LIMIT: [f64; ARM_JOINTS] = [15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0];

/// Torque limits of the arm's joints in Franka's data sheet, N m.
pub const TORQUE_LIMIT: [f64; ARM_JOINTS] = [87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0];

/// Speed below which a joint of the arm is at rest, rad/s. At full reach (0.855 m) it moves the
/// hand by 43 mm/s.
pub(crate) const REST_SPEED: f64 = 0.05;

/// Control steps of 50 ms.
const MEAN_STEPS: usize = 3;

/// The signals, which follow those of a task.
pub static MANNER: &[Quantity] = &[
    scalar(
        "fixture_force",
        "N",
        "largest contact force of the robot on fixtures: all but the ground and the object; what the hand holds \
         belongs to the robot",
    ),
    scalar("fixture_force_mean", "N", "contact force of the robot on fixtures, mean over 50 ms"),
    scalar(
        "ground_force",
        "N",
        "largest contact force of the robot, with what the hand holds, on the ground",
    ),
    scalar("ground_force_mean", "N", "contact force of the robot on the ground, mean over 50 ms"),
    scalar("self_force", "N", "largest contact force of the robot on itself"),
    scalar("self_force_mean", "N", "contact force of the robot on itself, mean over 50 ms"),
    scalar("object_force", "N", "largest contact force of the robot on the object that it manipulates"),
    scalar("object_force_mean", "N", "contact force of the robot on the object, mean over 50 ms"),
    scalar(
        "arm_object_force",
        "N",
        "largest contact force of the robot without its fingers on the object that it manipulates",
    ),
    scalar("joint_speed_share", "", "largest speed of a joint of the arm, as a share of its limit"),
    scalar(
        "joint_acceleration_share",
        "",
        "largest change of a joint's velocity over the control step, divided by its duration, as a share of the \
         limit of its acceleration; 0 in control steps in which the robot touches anything but an object that it \
         carries",
    ),
    scalar(
        "joint_torque_share",
        "",
        "largest torque that a servo of the arm demands, before it is limited, as a share of its limit",
    ),
    scalar("tool_speed", "m/s", "largest speed of the fingers' grasp point"),
    scalar("joint_limit_distance", "rad", "smallest distance of a joint of the arm to the end of its range"),
    scalar(
        "action_rate",
        "1/s",
        "largest change of an action since the control step before, over its duration",
    ),
    scalar("rest_time", "s", "time for which all joints of the arm have been slower than 0.05 rad/s"),
];

/// Number of forces with signals: all but the last one, which says whether the robot touches
/// anything.
const FORCE_SIGNALS: usize = FORCES - 1;

/// Places of the largest forces among the signals.
pub(crate) const LARGEST_FORCES: [usize; FORCE_SIGNALS] = [0, 2, 4, 6, 8];

/// Places of the speeds among the signals.
pub(crate) const JOINT_SPEED_SHARE: usize = 9;
pub(crate) const TOOL_SPEED: usize = 12;

/// Limits of careful success, as literals: formulas and descriptions are made of them.
///
/// The forces, N, are the limits of ISO/TS 15066 for hands and fingers, for transient and
/// quasi-static contact. They are limits for people, and are used for fixtures and objects here.
/// 1.7 m/s is Franka's limit of the speed of the hand. The servos exceed the velocity limit of a
/// joint by up to 5 % in free motion. The limit of the acceleration is that of the command; the
/// joint that follows it may exceed it by a fifth. The distance to the ends of the joints, rad, is
/// our choice; it holds after 60 control steps, because peg-in-hole starts at the end of joint 4.
macro_rules! limit {
    (force) => {
        280
    };
    (mean_force) => {
        140
    };
    (tool_speed) => {
        1.7
    };
    (joint_speed_share) => {
        1.05
    };
    (joint_acceleration_share) => {
        1.2
    };
    (joint_torque_share) => {
        1
    };
    (joint_limit_distance) => {
        0.05
    };
}
pub(crate) use limit;

/// Returns the condition that the force on a group of bodies, and its mean, stay below the limits.
macro_rules! limited_force {
    ($name:literal) => {
        concat!(
            $name,
            "_force <= ",
            $crate::manner::limit!(force),
            " and ",
            $name,
            "_force_mean <= ",
            $crate::manner::limit!(mean_force)
        )
    };
}

/// Conditions of careful success for every task. The robot is at rest if it has been for the last
/// quarter of a second.
pub const CAREFUL: &str = concat!(
    "always[0:300](",
    limited_force!("fixture"),
    " and ",
    limited_force!("ground"),
    " and ",
    limited_force!("object"),
    " and tool_speed <= ",
    limit!(tool_speed),
    " and joint_speed_share <= ",
    limit!(joint_speed_share),
    " and joint_acceleration_share <= ",
    limit!(joint_acceleration_share),
    " and joint_torque_share <= ",
    limit!(joint_torque_share),
    ") and always[60:300](joint_limit_distance >= ",
    limit!(joint_limit_distance),
    ") and always[300:300](rest_time >= 0.25)"
);

/// Number of forces with a mean: all signals of forces but the last one.
const MEANS: usize = FORCE_SIGNALS - 1;

/// Number of values that the signals need from the control steps before.
pub(crate) const MEMORY: usize = MEANS * (MEAN_STEPS - 1) + JOINTS + 1;

/// Returns the elements of the model of a task that the signals depend on.
///
/// # Errors
/// If an element is missing.
pub(crate) fn probe(definition: &Definition, model: &Model, panda: &Panda) -> Result<Probe, WorldError> {
    let joint = |i: usize| {
        Ok(ProbedJoint {
            joint: panda.joints()[i],
            actuator: model.actuator(JOINT_NAMES[i])?,
            max_velocity: VELOCITY_LIMIT[i],
            max_acceleration: ACCELERATION_LIMIT[i],
            max_torque: TORQUE_LIMIT[i],
        })
    };
    let welded = definition.held.filter(|held| held.attachment == Attachment::Weld);
    Ok(Probe {
        parts: model.part_map(definition.object)?,
        weld: welded.map(|held| model.equality(held.name)).transpose()?,
        carries: definition.held.is_some_and(|held| held.attachment == Attachment::Fixed),
        joints: (0..ARM_JOINTS).map(joint).collect::<Result<_, WorldError>>()?,
        hand: model.body("hand")?,
        tool: panda.grasp,
    })
}

/// The signals of the manner of a task. Every engine that measures the [`Probe`] gives them.
#[derive(Clone, Debug)]
pub(crate) struct Manner {
    probe: Probe,
    /// Number of physics steps per control step.
    substeps: usize,
}

impl Manner {
    pub(crate) fn new(probe: Probe, substeps: usize) -> Manner {
        Manner { probe, substeps }
    }

    /// Returns the elements that an engine measures.
    pub(crate) fn probe(&self) -> &Probe {
        &self.probe
    }

    /// Writes the signals of the initial state and sets the memory of the episode.
    pub(crate) fn start(&self, rows: &Rows<'_>, memory: &mut [f64], out: &mut [f64]) {
        memory.fill(0.0);
        let limit_distance = self.probe.limit_distance(rows.qpos);
        write(&Readings { limit_distance, ..Readings::default() }, &[0.0; MEANS], [0.0; 2], out);
    }

    /// Writes the signals of the control step with these readings that ends in the state `rows`,
    /// under an action, and updates the memory of the episode.
    pub(crate) fn finish(
        &self,
        rows: &Rows<'_>,
        readings: &Readings,
        action: &[f64],
        memory: &mut [f64],
        out: &mut [f64],
    ) {
        let tool_speed = readings.tool_speed.max(self.probe.tool_speed(rows));
        let (means, rest) = memory.split_at_mut(MEANS * (MEAN_STEPS - 1));
        let (last_action, rest_steps) = rest.split_at_mut(JOINTS);
        let now: [f64; MEANS] = std::array::from_fn(|force| readings.sums[force] / self.substeps as f64);
        let mut mean = now;
        for before in means.chunks(MEANS) {
            mean.iter_mut().zip(before).for_each(|(mean, before)| *mean += before);
        }
        let mean = mean.map(|sum| sum / MEAN_STEPS as f64);
        means.copy_within(..MEANS * (MEAN_STEPS - 2), MEANS);
        means[..MEANS].copy_from_slice(&now);
        let changes = action.iter().zip(&*last_action).map(|(action, last)| (action - last).abs());
        let rate = changes.fold(0.0, f64::max) / CONTROL_DT;
        last_action.copy_from_slice(action);
        rest_steps[0] = if readings.speed < REST_SPEED { rest_steps[0] + 1.0 } else { 0.0 };
        let rest_time = rest_steps[0] * CONTROL_DT;
        write(&Readings { tool_speed, ..*readings }, &mean, [rate, rest_time], out);
    }
}

/// Writes the signals in the order of [`MANNER`]. The last ones are action rate and rest time.
fn write(readings: &Readings, mean: &[f64; MEANS], last: [f64; 2], out: &mut [f64]) {
    let (forces, rest) = out.split_at_mut(2 * MEANS);
    for (force, out) in forces.chunks_mut(2).enumerate() {
        out.copy_from_slice(&[readings.largest[force], mean[force]]);
    }
    let Readings { speed_share, torque_share, tool_speed, limit_distance, .. } = *readings;
    let touches = readings.largest[FORCE_SIGNALS] > 0.0;
    let acceleration_share = if touches { 0.0 } else { readings.acceleration_share };
    let motion = [speed_share, acceleration_share, torque_share, tool_speed, limit_distance];
    rest[0] = readings.largest[MEANS];
    rest[1..][..motion.len()].copy_from_slice(&motion);
    rest[1 + motion.len()..].copy_from_slice(&last);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_places_of_signals_have_their_names() {
        let names = ["fixture_force", "ground_force", "self_force", "object_force", "arm_object_force"];
        assert_eq!(LARGEST_FORCES.map(|place| MANNER[place].name), names);
        assert_eq!(MANNER[JOINT_SPEED_SHARE].name, "joint_speed_share");
        assert_eq!(MANNER[TOOL_SPEED].name, "tool_speed");
    }
}
