//! The Franka Panda arm: joints, effect of actions, and velocity limits of the servos.

use mishandle_controllers::{ActionInterface, JointTargets};
use mishandle_world::{Body, Joint, Model, Rows, Servo, Site, World, WorldError};

/// Number of joints: seven of the arm and two of the fingers. Equals the number of actions.
pub const JOINTS: usize = 9;

/// Number of joints of the arm.
pub const ARM_JOINTS: usize = 7;

/// Names of the joints and of their servos.
pub const JOINT_NAMES: [&str; JOINTS] =
    ["joint1", "joint2", "joint3", "joint4", "joint5", "joint6", "joint7", "finger_joint1", "finger_joint2"];

/// Duration of a control step, s.
pub const CONTROL_DT: f64 = 1.0 / 60.0;

/// Control steps in an episode.
pub const EPISODE_STEPS: usize = 300;

/// Change of an arm joint's target per control step under an action of 1, rad.
pub const TARGET_STEP: f64 = 7.5 / 60.0;

/// Change of a finger's target per control step under an action of 1, m, in tasks whose policy
/// moves the fingers.
pub const FINGER_STEP: f64 = 0.1 * TARGET_STEP;

/// Time constant of the servos: damping over stiffness, s.
pub(crate) const SERVO_LAG: [f64; JOINTS] = [0.2, 0.2, 0.2, 0.2, 0.2, 0.2, 0.2, 0.01, 0.01];

/// Velocity limits of the joints, rad/s for the arm, m/s for the fingers, from Franka's data sheet.
pub const VELOCITY_LIMIT: [f64; JOINTS] = [2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61, 0.2, 0.2];

/// Limits of the motion that experts command, rad/s and rad/s²: within Franka's data sheet, the
/// velocities with room for the ripple of the servos.
pub(crate) const COMMANDED_VELOCITY: [f64; ARM_JOINTS] = [1.9, 1.9, 1.9, 1.9, 1.45, 1.45, 1.45];
pub(crate) const COMMANDED_ACCELERATION: [f64; ARM_JOINTS] = [15.0, 7.5, 10.0, 12.5, 6.5, 6.5, 6.5];

/// Largest velocities of the experts' targets, rad/s. A step of a target lets its servo demand
/// 400 N m per radian: 40 N m for the arm, 10 N m for the wrist.
const TARGET_VELOCITY: [f64; ARM_JOINTS] = [6.0, 6.0, 6.0, 6.0, 1.5, 1.5, 1.5];

/// Distance of the experts' targets from the ends of the joints' ranges, rad: the least distance
/// that careful formulas allow.
const TARGET_MARGIN: f64 = 0.05;

/// Effort limits of the joints, N m for the arm, N for the fingers.
pub const EFFORT_LIMIT: [f64; JOINTS] = [87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0, 200.0, 200.0];

/// The robot's elements in a compiled model.
#[derive(Clone, Copy, Debug)]
pub struct Panda {
    joints: [Joint; JOINTS],
    left_finger: Body,
    right_finger: Body,
    /// Site at the midpoint between the fingertips.
    pub grasp: Site,
}

impl Panda {
    /// Finds the robot's elements in `model`.
    ///
    /// # Errors
    /// If an element is missing.
    pub fn new(model: &Model) -> Result<Panda, WorldError> {
        let first = model.joint(JOINT_NAMES[0])?;
        let mut joints = [first; JOINTS];
        for (joint, name) in joints.iter_mut().zip(JOINT_NAMES) {
            *joint = model.joint(name)?;
        }
        Ok(Panda {
            joints,
            left_finger: model.body("left_finger")?,
            right_finger: model.body("right_finger")?,
            grasp: model.site("grasp")?,
        })
    }

    /// Returns the joints, arm first.
    pub fn joints(&self) -> &[Joint; JOINTS] {
        &self.joints
    }

    /// Returns the midpoint of the two finger frames, m.
    pub fn finger_position(&self, rows: &Rows<'_>) -> [f64; 3] {
        let left = rows.position(self.left_finger);
        let right = rows.position(self.right_finger);
        [0, 1, 2].map(|i| 0.5 * (left[i] + right[i]))
    }

    /// Returns the norm of the left finger's six-dimensional twist, which mixes m/s and rad/s.
    pub fn finger_twist(&self, rows: &Rows<'_>) -> f64 {
        let (linear, angular) = rows.twist(self.left_finger);
        linear.iter().chain(&angular).map(|v| v * v).sum::<f64>().sqrt()
    }

    /// Sets the joint positions to `q` and the joint velocities to 0.
    pub fn place(&self, q: &[f64; JOINTS], world: &mut World) {
        for (joint, q) in self.joints.iter().zip(q) {
            world.qpos_mut()[joint.qpos] = *q;
            world.qvel_mut()[joint.dof] = 0.0;
        }
    }

    /// Moves the targets of the arm joints (rad) by an action and clamps them to the joint limits.
    pub fn move_targets(&self, action: &[f64], targets: &mut [f64]) {
        for ((joint, a), target) in self.joints[..ARM_JOINTS].iter().zip(action).zip(targets) {
            *target = (*target + TARGET_STEP * a).clamp(joint.low, joint.high);
        }
    }

    /// Moves the targets of the fingers (m) by the last two entries of an action and clamps them to
    /// the stroke.
    pub fn move_fingers(&self, action: &[f64], fingers: &mut [f64]) {
        for (finger, a) in fingers.iter_mut().zip(&action[ARM_JOINTS..]) {
            *finger += FINGER_STEP * a;
        }
        self.limit_fingers(fingers);
    }

    /// Clamps the targets of the fingers (m) to their stroke.
    pub(crate) fn limit_fingers(&self, fingers: &mut [f64]) {
        for (finger, joint) in fingers.iter_mut().zip(&self.joints[ARM_JOINTS..]) {
            *finger = finger.clamp(joint.low, joint.high);
        }
    }

    /// Returns the servos of the joints, which keep the velocity limits.
    pub fn servos(&self) -> [Servo; JOINTS] {
        std::array::from_fn(|i| Servo {
            qpos: self.joints[i].qpos,
            dof: self.joints[i].dof,
            max_velocity: VELOCITY_LIMIT[i],
            max_effort: EFFORT_LIMIT[i],
        })
    }

    /// Advances the world by one physics step in which the servos move towards `targets`.
    pub fn step(&self, targets: &[f64], world: &mut World) {
        world.step_servos(&self.servos(), targets);
    }

    /// Writes the first 18 numbers of an observation: joint positions mapped from their limits to
    /// [-1, 1], and joint velocities multiplied by `velocity_scale`.
    pub(crate) fn observe(&self, rows: &Rows<'_>, velocity_scale: f64, out: &mut [f64]) {
        let (positions, velocities) = out.split_at_mut(JOINTS);
        self.map_positions(&self.joints.map(|joint| rows.qpos[joint.qpos]), positions);
        for (i, joint) in self.joints.iter().enumerate() {
            velocities[i] = velocity_scale * rows.qvel[joint.dof];
        }
    }

    /// Maps positions of the joints (rad, m) from their limits to [-1, 1].
    pub(crate) fn map_positions(&self, positions: &[f64], out: &mut [f64]) {
        for ((out, position), joint) in out.iter_mut().zip(positions).zip(&self.joints) {
            *out = 2.0 * (position - joint.low) / (joint.high - joint.low) - 1.0;
        }
    }

    /// Returns the action interface of the experts.
    pub(crate) fn action_interface() -> ActionInterface {
        ActionInterface {
            velocity: COMMANDED_VELOCITY.to_vec(),
            acceleration: COMMANDED_ACCELERATION.to_vec(),
            target_velocity: TARGET_VELOCITY.to_vec(),
            margin: TARGET_MARGIN,
            lead: SERVO_LAG[0],
        }
    }

    /// Returns the targets of the arm that an action interface moves. The first target has the
    /// index `targets` in an observation.
    pub(crate) fn joint_targets(&self, targets: usize) -> JointTargets {
        JointTargets {
            positions: 0,
            targets,
            ranges: self.joints[..ARM_JOINTS].iter().map(|joint| [joint.low, joint.high]).collect(),
            step: TARGET_STEP,
            control_dt: CONTROL_DT,
        }
    }
}
