//! The built-in controller of a site's position: resolved-rate inverse kinematics, then torques by
//! the model's inertia and bias forces.
//!
//! ```text
//! Δq = Jᵀ (J Jᵀ + λ I)⁻¹ gain (goal - x(q_ref)),   q_ref += Δq, each joint at most largest_joint_step
//! τ = M(q) (kp (q_ref - q) - kd q̇) + h(q, q̇)
//! ```
//!
//! # References
//! Nakamura and Hanafusa, "Inverse Kinematic Solutions with Singularity Robustness for Robot
//! Manipulator Control", Journal of Dynamic Systems, Measurement, and Control 108(3), 1986: the
//! damped inverse. Luh, Walker and Paul, "On-Line Computational Scheme for Mechanical
//! Manipulators", same journal, 102(2), 1980: the torques.

use std::sync::Arc;

use crate::expression::{Compiler, Place, Program, value};
use mishandle_rollout::{Controller, ControllerWorker, Seed};
use mishandle_world::{Arm, ElementKind, Joint, JointKind, Model, World};

use crate::axes::ObservedPart;
use crate::description::TaskSpace;
use crate::error::Problem;
use crate::library::Library;
use crate::policy::{Observation, PolicyNames};
use crate::quantity::Quantity;

/// Parts of the observation that the controller reads.
const POSITION: &str = "joint_position";
const VELOCITY: &str = "joint_velocity";

pub(crate) struct TaskSpacePolicy {
    settings: TaskSpace,
    model: Model,
    /// Names of the joints of the actuators.
    joints: Vec<String>,
    /// First entries of positions and velocities in the observation.
    first: [usize; 2],
    observation_size: usize,
    goal: Arc<Program<Quantity>>,
    place: Place,
    control_dt: f64,
}

impl TaskSpacePolicy {
    pub(crate) fn new(
        settings: &TaskSpace,
        library: &Library<'_>,
        parts: &[ObservedPart],
        control_dt: f64,
    ) -> Result<TaskSpacePolicy, Problem> {
        let model = library.model;
        let span = &settings.site.span;
        let names = model.names(ElementKind::Joint);
        let joints: Option<Vec<usize>> =
            (0..model.actuators()).map(|index| model.actuator_joint(index)).collect();
        let is_simple =
            |joint: &usize| matches!(model.joint_kind(*joint), JointKind::Hinge | JointKind::Slide);
        let joints = joints.filter(|joints| !joints.is_empty() && joints.iter().all(is_simple));
        let joints = joints.ok_or_else(|| {
            Problem::new(span, "the task-space controller needs actuators that act on hinge or slide joints")
        })?;
        let joints: Vec<String> = joints.into_iter().map(|joint| names[joint].clone()).collect();
        if model.find(ElementKind::Site, &settings.site.text).is_err() {
            let known = model.names(ElementKind::Site);
            return Err(Problem::new(span, crate::pattern::missing("site", &settings.site.text, &known)));
        }
        let part = |name: &str| {
            let found = parts.iter().find(|part| part.name == name && part.size == joints.len());
            found.map(|part| part.first).ok_or_else(|| {
                let message = format!(
                    "the task-space controller reads the part `{name}` of the observation, one number for each of the {} \
                     actuators",
                    joints.len()
                );
                Problem::new(span, message)
            })
        };
        let text = &settings.goal.text;
        let mut compiler = Compiler::new();
        let place = compiler
            .add(&settings.goal.node, &PolicyNames { library, parts })
            .map_err(|error| Problem::of_expression(&text.span, &text.text, &error))?;
        if place.size() != 3 {
            return Err(Problem::new(
                &text.span,
                format!("`goal` is a position of 3 numbers, not {}", place.size()),
            ));
        }
        Ok(TaskSpacePolicy {
            settings: settings.clone(),
            model: model.clone(),
            first: [part(POSITION)?, part(VELOCITY)?],
            observation_size: parts.iter().map(|part| part.size).sum(),
            joints,
            goal: Arc::new(compiler.program()),
            place,
            control_dt,
        })
    }
}

impl Controller for TaskSpacePolicy {
    fn observation_size(&self) -> usize {
        self.observation_size
    }

    fn action_size(&self) -> usize {
        self.joints.len()
    }

    /// The number of control steps, and the reference of each joint.
    fn state_size(&self) -> usize {
        1 + self.joints.len()
    }

    fn worker(&self) -> Box<dyn ControllerWorker> {
        let names: Vec<&str> = self.joints.iter().map(String::as_str).collect();
        // The names were looked up when the policy was made.
        let arm = Arm::new(&self.model, &names, &self.settings.site.text).expect("joints and site exist");
        let count = names.len();
        let size = self.model.qvel_size();
        Box::new(Worker {
            settings: self.settings.clone(),
            joints: arm.joints().to_vec(),
            arm,
            world: self.model.world(),
            first: self.first,
            goal: self.goal.clone(),
            place: self.place.clone(),
            memory: self.goal.memory(),
            control_dt: self.control_dt,
            jacobian: vec![0.0; 6 * count],
            inertia: vec![0.0; size * size],
            acceleration: vec![0.0; count],
        })
    }
}

struct Worker {
    settings: TaskSpace,
    arm: Arm,
    joints: Vec<Joint>,
    /// A copy of the model for inertia and bias forces.
    world: World,
    first: [usize; 2],
    goal: Arc<Program<Quantity>>,
    place: Place,
    memory: Vec<f64>,
    control_dt: f64,
    jacobian: Vec<f64>,
    inertia: Vec<f64>,
    acceleration: Vec<f64>,
}

impl Worker {
    /// Moves the reference of the joints toward the goal.
    fn move_reference(&mut self, goal: [f64; 3], reference: &mut [f64]) {
        let count = self.joints.len();
        self.arm.set(reference);
        let position = self.arm.position();
        self.arm.jacobian(&mut self.jacobian);
        let row = |axis: usize| &self.jacobian[axis * count..][..count];
        let mut square = [[0.0; 3]; 3];
        for (i, line) in square.iter_mut().enumerate() {
            for (j, entry) in line.iter_mut().enumerate() {
                *entry = row(i).iter().zip(row(j)).map(|(a, b)| a * b).sum();
            }
            line[i] += self.settings.damping;
        }
        let error = std::array::from_fn(|axis| self.settings.gain * (goal[axis] - position[axis]));
        let weights = solve(square, error);
        let limit = self.settings.largest_joint_step;
        for (joint, reference) in reference.iter_mut().enumerate() {
            let step: f64 = (0..3).map(|axis| row(axis)[joint] * weights[axis]).sum();
            *reference += step.clamp(-limit, limit);
        }
    }

    /// Writes the torques that drive the joints to their reference.
    fn torques(&mut self, [position, velocity]: [&[f32]; 2], reference: &[f64], torques: &mut [f32]) {
        for (index, joint) in self.joints.iter().enumerate() {
            let q = f64::from(position[index]);
            let v = f64::from(velocity[index]);
            self.world.qpos_mut()[joint.qpos] = q;
            self.world.qvel_mut()[joint.dof] = v;
            self.acceleration[index] = self.settings.kp * (reference[index] - q) - self.settings.kd * v;
        }
        self.world.refresh_sensors();
        self.world.inertia_matrix(&mut self.inertia);
        let size = self.world.qvel().len();
        for (joint, torque) in self.joints.iter().zip(torques) {
            let row = &self.inertia[joint.dof * size..][..size];
            let inertial: f64 =
                self.joints.iter().zip(&self.acceleration).map(|(other, a)| row[other.dof] * a).sum();
            *torque = (inertial + self.world.bias_forces()[joint.dof]) as f32;
        }
    }
}

impl ControllerWorker for Worker {
    fn reset(&mut self, state: &mut [f64], _seed: Seed) {
        state.fill(0.0);
    }

    fn act(&mut self, rows: usize, observations: &[f32], states: &mut [f64], actions: &mut [f32]) {
        let size = observations.len() / rows.max(1);
        let count = self.joints.len();
        for row in 0..rows {
            let numbers = &observations[row * size..][..size];
            let parts = self.first.map(|first| &numbers[first..][..count]);
            let (step, reference) = states[row * (1 + count)..][..1 + count].split_at_mut(1);
            if step[0] == 0.0 {
                // The reference starts where the robot is.
                reference.iter_mut().zip(parts[0]).for_each(|(reference, q)| *reference = f64::from(*q));
            }
            let mut reader = Observation { numbers, time: step[0] * self.control_dt };
            self.goal.run(&mut self.memory, &mut reader);
            let goal = value(&self.memory, &self.place);
            let goal = [goal[0], goal[1], goal[2]];
            self.move_reference(goal, reference);
            self.torques(parts, reference, &mut actions[row * count..][..count]);
            step[0] += 1.0;
        }
    }
}

/// Solves a symmetric positive definite system of three equations by Cholesky factors.
fn solve(a: [[f64; 3]; 3], b: [f64; 3]) -> [f64; 3] {
    let mut l = [[0.0; 3]; 3];
    for i in 0..3 {
        for j in 0..=i {
            let sum: f64 = (0..j).map(|k| l[i][k] * l[j][k]).sum();
            l[i][j] = if i == j { (a[i][i] - sum).sqrt() } else { (a[i][j] - sum) / l[j][j] };
        }
    }
    let mut y = [0.0; 3];
    for i in 0..3 {
        let sum: f64 = (0..i).map(|k| l[i][k] * y[k]).sum();
        y[i] = (b[i] - sum) / l[i][i];
    }
    let mut x = [0.0; 3];
    for i in (0..3).rev() {
        let sum: f64 = (i + 1..3).map(|k| l[k][i] * x[k]).sum();
        x[i] = (y[i] - sum) / l[i][i];
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_equations_are_solved() {
        // A = B Bᵀ of B = [[1, 0, 0], [2, 3, 0], [-1, 4, 2]], x = (1, -2, 3).
        let a = [[1.0, 2.0, -1.0], [2.0, 13.0, 10.0], [-1.0, 10.0, 21.0]];
        let x = [1.0, -2.0, 3.0];
        let b = std::array::from_fn(|i| (0..3).map(|j| a[i][j] * x[j]).sum());
        let found = solve(a, b);
        assert!(found.iter().zip(x).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}");
    }
}
