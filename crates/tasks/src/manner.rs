//! Signals of the manner in which the robot does a task: contact forces, and speed, acceleration
//! and torque of its joints, over all physics steps of a control step.
//!
//! They cost time, so an environment computes them only [on request](crate::TaskEnvironment::with_manner).

use mishandle_world::frame::{add, cross, norm, sub};
use mishandle_world::{Actuator, Body, Equality, Model, Part, PartForces, PartMap, Rows, World, WorldError};

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
        "largest acceleration of a joint of the arm, as a share of its limit",
    ),
    scalar("joint_torque_share", "", "largest torque of a servo of the arm, as a share of its limit"),
    scalar("tool_speed", "m/s", "largest speed of the fingers' grasp point"),
    scalar("joint_limit_distance", "rad", "smallest distance of a joint of the arm to the end of its range"),
    scalar(
        "action_rate",
        "1/s",
        "largest change of an action since the control step before, over its duration",
    ),
    scalar("rest_time", "s", "time for which all joints of the arm have been slower than 0.05 rad/s"),
];

/// Places of the largest forces on fixtures and on the ground among the signals.
pub(crate) const FIXTURE_FORCE: usize = 0;
pub(crate) const GROUND_FORCE: usize = 2;

/// Conditions of careful success for every task.
///
/// The forces are the limits of ISO/TS 15066 for hands and fingers, for quasi-static and transient
/// contact. They are limits for people, and are used for fixtures here. 1.7 m/s is Franka's limit
/// of the speed of the hand. The servos exceed the velocity limit of a joint by up to 5 % in free
/// motion. The robot is at rest if it has been for the last quarter of a second.
pub const CAREFUL: &str = "always[0:300](fixture_force <= 280 and fixture_force_mean <= 140 and ground_force <= 280 \
     and ground_force_mean <= 140 and tool_speed <= 1.7 and joint_speed_share <= 1.05) and always[300:300](rest_time >= 0.25)";

/// Number of forces with a mean.
const FORCES: usize = 4;

/// Number of values that the signals need from the control steps before.
pub(crate) const MEMORY: usize = FORCES * (MEAN_STEPS - 1) + JOINTS + 1;

/// The elements of a model that the signals of the manner depend on.
#[derive(Clone, Debug)]
pub(crate) struct Manner {
    parts: PartMap,
    panda: Panda,
    hand: Body,
    actuators: [Actuator; ARM_JOINTS],
    /// The weld that holds the object in the hand.
    weld: Option<Equality>,
}

impl Manner {
    /// Finds the elements in the model of a task.
    ///
    /// # Errors
    /// If an element is missing.
    pub(crate) fn new(definition: &Definition, model: &Model, panda: Panda) -> Result<Manner, WorldError> {
        let mut actuators = [model.actuator(JOINT_NAMES[0])?; ARM_JOINTS];
        for (actuator, name) in actuators.iter_mut().zip(JOINT_NAMES) {
            *actuator = model.actuator(name)?;
        }
        let welded = definition.held.filter(|held| held.attachment == Attachment::Weld);
        Ok(Manner {
            parts: model.part_map(definition.object)?,
            panda,
            hand: model.body("hand")?,
            actuators,
            weld: welded.map(|held| model.equality(held.name)).transpose()?,
        })
    }

    /// Returns the speed of the grasp point, m/s.
    fn tool_speed(&self, rows: &Rows<'_>) -> f64 {
        let (linear, angular) = rows.twist(self.hand);
        let arm = sub(rows.site_position(self.panda.grasp), rows.position(self.hand));
        norm(add(linear, cross(angular, arm)))
    }

    /// Returns the forces of the robot on fixtures, the ground, itself and the object, and of the
    /// robot without fingers on the object.
    fn forces(&self, forces: &PartForces, holds: bool) -> [f64; FORCES + 1] {
        use Part as P;
        let of_robot = |part| forces.between(P::Fingers, part) + forces.between(P::Arm, part);
        let of_held = |part| if holds { forces.between(P::Object, part) } else { 0.0 };
        [
            of_robot(P::Fixture) + of_held(P::Fixture),
            of_robot(P::Ground) + of_held(P::Ground),
            of_robot(P::Arm) + forces.between(P::Fingers, P::Fingers),
            of_robot(P::Object),
            forces.between(P::Arm, P::Object),
        ]
    }
}

/// The signals of one control step while its physics steps are taken.
#[derive(Clone, Debug)]
pub(crate) struct MannerRecorder {
    manner: Manner,
    /// Velocities before the physics step.
    before: Vec<f64>,
    steps: usize,
    largest: [f64; FORCES + 1],
    sum: [f64; FORCES],
    speeds: [f64; ARM_JOINTS],
    acceleration: f64,
    torque: f64,
    tool_speed: f64,
    limit_distance: f64,
}

impl MannerRecorder {
    pub(crate) fn new(manner: Manner, model: &Model) -> MannerRecorder {
        MannerRecorder {
            manner,
            before: vec![0.0; model.qvel_size()],
            steps: 0,
            largest: [0.0; FORCES + 1],
            sum: [0.0; FORCES],
            speeds: [0.0; ARM_JOINTS],
            acceleration: 0.0,
            torque: 0.0,
            tool_speed: 0.0,
            limit_distance: f64::INFINITY,
        }
    }

    /// Starts a control step.
    pub(crate) fn clear(&mut self) {
        self.steps = 0;
        (self.largest, self.sum) = ([0.0; FORCES + 1], [0.0; FORCES]);
        self.speeds = [0.0; ARM_JOINTS];
        (self.acceleration, self.torque, self.tool_speed) = (0.0, 0.0, 0.0);
        self.limit_distance = f64::INFINITY;
    }

    /// Takes a physics step towards the targets of the joints and reads what happened in it.
    pub(crate) fn step(&mut self, targets: &[f64], world: &mut World) {
        self.before.copy_from_slice(world.qvel());
        self.manner.panda.step(targets, world);
        let (manner, world) = (&self.manner, &*world);
        let timestep = world.model().timestep();
        let holds = manner.weld.is_some_and(|weld| world.rows().is_active(weld));
        let forces = manner.forces(&world.part_forces(&manner.parts), holds);
        for (largest, force) in self.largest.iter_mut().zip(forces) {
            *largest = largest.max(force);
        }
        for (sum, force) in self.sum.iter_mut().zip(forces) {
            *sum += force;
        }
        let (qpos, qvel) = (world.qpos(), world.qvel());
        for (i, joint) in manner.panda.joints()[..ARM_JOINTS].iter().enumerate() {
            let velocity = qvel[joint.dof];
            // MuJoCo's own acceleration is that before the implicit integration.
            let acceleration = (velocity - self.before[joint.dof]) / timestep;
            let torque = world.actuator_force(manner.actuators[i]);
            self.speeds[i] = self.speeds[i].max(velocity.abs());
            self.acceleration = self.acceleration.max(acceleration.abs() / ACCELERATION_LIMIT[i]);
            self.torque = self.torque.max(torque.abs() / TORQUE_LIMIT[i]);
            let q = qpos[joint.qpos];
            self.limit_distance = self.limit_distance.min((q - joint.low).min(joint.high - q));
        }
        if self.steps > 0 {
            // Poses after a step are those of its start, where the velocities were these.
            let mut rows = world.rows();
            rows.qvel = &self.before;
            self.tool_speed = self.tool_speed.max(manner.tool_speed(&rows));
        }
        self.steps += 1;
    }

    /// Writes the signals of the initial state and sets the memory of the episode.
    pub(crate) fn start(&mut self, rows: &Rows<'_>, memory: &mut [f64], out: &mut [f64]) {
        memory.fill(0.0);
        self.clear();
        for joint in &self.manner.panda.joints()[..ARM_JOINTS] {
            let q = rows.qpos[joint.qpos];
            self.limit_distance = self.limit_distance.min((q - joint.low).min(joint.high - q));
        }
        self.write(&[0.0; FORCES], 0.0, 0.0, out);
    }

    /// Writes the signals of the control step that ends in the state `rows`, under an action, and
    /// updates the memory of the episode.
    pub(crate) fn finish(&mut self, rows: &Rows<'_>, action: &[f64], memory: &mut [f64], out: &mut [f64]) {
        self.tool_speed = self.tool_speed.max(self.manner.tool_speed(rows));
        let (means, rest) = memory.split_at_mut(FORCES * (MEAN_STEPS - 1));
        let (last_action, rest_steps) = rest.split_at_mut(JOINTS);
        let now = self.sum.map(|sum| sum / self.steps.max(1) as f64);
        let mut mean = now;
        for before in means.chunks(FORCES) {
            mean.iter_mut().zip(before).for_each(|(mean, before)| *mean += before);
        }
        let mean = mean.map(|sum| sum / MEAN_STEPS as f64);
        means.copy_within(..FORCES * (MEAN_STEPS - 2), FORCES);
        means[..FORCES].copy_from_slice(&now);
        let changes = action.iter().zip(&*last_action).map(|(action, last)| (action - last).abs());
        let rate = changes.fold(0.0, f64::max) / CONTROL_DT;
        last_action.copy_from_slice(action);
        let is_at_rest = self.speeds.iter().all(|speed| *speed < REST_SPEED);
        rest_steps[0] = if is_at_rest { rest_steps[0] + 1.0 } else { 0.0 };
        self.write(&mean, rate, rest_steps[0] * CONTROL_DT, out);
    }

    /// Writes the signals in the order of [`MANNER`].
    fn write(&self, mean: &[f64; FORCES], action_rate: f64, rest_time: f64, out: &mut [f64]) {
        for (force, out) in out.chunks_mut(2).take(FORCES).enumerate() {
            out.copy_from_slice(&[self.largest[force], mean[force]]);
        }
        let speeds = self.speeds.iter().zip(VELOCITY_LIMIT);
        out[2 * FORCES..].copy_from_slice(&[
            self.largest[FORCES],
            speeds.map(|(speed, limit)| speed / limit).fold(0.0, f64::max),
            self.acceleration,
            self.torque,
            self.tool_speed,
            self.limit_distance,
            action_rate,
            rest_time,
        ]);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::document::compose;
    use crate::task;

    #[test]
    fn what_the_hand_holds_belongs_to_the_robot() {
        let task = task("peg-in-hole").unwrap();
        let model = Model::from_xml(&compose(task).unwrap()).unwrap();
        let manner = Manner::new(task.definition(), &model, Panda::new(&model).unwrap()).unwrap();
        assert!(manner.weld.is_some());
        let mut forces = PartForces::default();
        for (a, b, force) in [
            (Part::Object, Part::Fixture, 1.0),
            (Part::Fingers, Part::Fixture, 2.0),
            (Part::Arm, Part::Fixture, 4.0),
            (Part::Ground, Part::Object, 8.0),
            (Part::Arm, Part::Ground, 16.0),
            (Part::Arm, Part::Arm, 32.0),
            (Part::Fingers, Part::Arm, 64.0),
            (Part::Fingers, Part::Fingers, 128.0),
            (Part::Object, Part::Fingers, 256.0),
            (Part::Object, Part::Arm, 512.0),
        ] {
            forces.add(a, b, force);
        }
        assert_eq!(manner.forces(&forces, true), [7.0, 24.0, 224.0, 768.0, 512.0]);
        assert_eq!(manner.forces(&forces, false), [6.0, 16.0, 224.0, 768.0, 512.0]);
    }
}
