//! Position servos that keep velocity limits.

use crate::{Model, World};

/// A position servo that keeps a velocity limit, which MuJoCo does not have. Servo i drives the
/// model's actuator i, whose gains kp and kv are those of the model, also if they were changed.
///
/// Two rules set the control of a physics step.
///
/// 1. The setpoint is at most `max_velocity` kv / kp ahead of the joint, so that the velocity limit
///    is the speed at which stiffness and damping are in balance.
/// 2. A joint can still exceed its limit, because the other joints accelerate it. If the velocity
///    after the step would exceed the limits of some joints, their servos brake within their
///    efforts, as much as the limits demand and together, because each of them moves the others.
///
/// The predicted velocity is v + h a, where M a = τ - h D a: h is the physics step, M the mass
/// matrix, τ all torques but those of contacts, and D the damping that MuJoCo treats implicitly:
/// that of servos below their effort limits when the rule begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Servo {
    /// Index of the joint's generalized position.
    pub qpos: usize,
    /// Index of the joint's generalized velocity. The servos of a robot have consecutive ones.
    pub dof: usize,
    /// Velocity limit, rad/s or m/s.
    pub max_velocity: f64,
    /// Effort limit, N m or N.
    pub max_effort: f64,
}

/// Share of the effort limit with which a servo brakes. MuJoCo treats the damping of a servo whose
/// force is clamped explicitly, so a braking servo must stay below its limit.
pub const BRAKING_SHARE: f64 = 0.98;

/// Sweeps of the projected Gauss-Seidel method that finds the braking efforts.
const SWEEPS: usize = 4;

/// Most servos of a robot.
const MAX_SERVOS: usize = 16;

type Vector = [f64; MAX_SERVOS];

impl Servo {
    /// Largest number of servos of a robot.
    pub const MOST: usize = MAX_SERVOS;
}

impl World {
    /// Advances the state by one physics step in which the servos of the first actuators move
    /// towards `targets`, rad or m. Without servos, it is a plain [`step`](Self::step).
    ///
    /// # Panics
    /// If there are more than 16 servos or their velocities are not consecutive.
    pub fn step_servos(&mut self, servos: &[Servo], targets: &[f64]) {
        if servos.is_empty() {
            return self.step();
        }
        self.data.step1();
        self.set_servos(servos, targets);
        self.data.step2();
    }

    /// Sets the controls of the first actuators. The mass matrix and the bias torques must be those
    /// of the state, as after `mj_step1`.
    fn set_servos(&mut self, servos: &[Servo], targets: &[f64]) {
        let mut motion = Motion::default();
        let mut setpoints = [0.0; MAX_SERVOS];
        let qpos = self.data.qpos();
        let qvel = self.data.qvel();
        let model = self.model();
        for ((i, servo), target) in servos.iter().enumerate().zip(targets) {
            let (kp, kv) = model.servo_gains(i);
            let q = qpos[servo.qpos];
            let limit = servo.max_velocity * kv / kp;
            let lead = (target - q).clamp(-limit, limit);
            setpoints[i] = q + lead;
            motion.velocity[i] = qvel[servo.dof];
            motion.damping[i] = kv;
            motion.required[i] = kp * lead - kv * qvel[servo.dof];
        }
        self.read_inertia(servos, &mut motion);
        let braking = motion.braking(servos);
        for (i, effort) in braking.into_iter().enumerate().take(servos.len()) {
            if let Some(effort) = effort {
                let Servo { qpos: q, dof, .. } = servos[i];
                let (kp, kv) = model.servo_gains(i);
                setpoints[i] = qpos[q] + (effort + kv * qvel[dof]) / kp;
            }
        }
        self.data.ctrl_mut()[..servos.len()].copy_from_slice(&setpoints[..servos.len()]);
    }

    /// Reads the mass matrix, the torques besides those of the servos, and the damping.
    fn read_inertia(&self, servos: &[Servo], motion: &mut Motion) {
        let Some(Servo { dof: first, .. }) = servos.first() else { return };
        assert!(servos.len() <= MAX_SERVOS, "{} servos; the limit is {MAX_SERVOS}", servos.len());
        let are_consecutive = servos.iter().zip(*first..).all(|(servo, dof)| servo.dof == dof);
        assert!(are_consecutive, "the velocities of the servos are not consecutive");
        let model = &*self.model().inner;
        let rows = model.m_rowadr();
        let counts = model.m_rownnz();
        let columns = model.m_colind();
        let mass = self.data.m();
        let passive = self.data.qfrc_passive();
        let bias = self.data.qfrc_bias();
        motion.h = model.opt().timestep;
        for (i, Servo { dof, .. }) in servos.iter().enumerate() {
            let start = rows[*dof] as usize;
            for entry in start..start + counts[*dof] as usize {
                if let Some(j) = (columns[entry] as usize).checked_sub(*first) {
                    motion.mass[i][j] = mass[entry];
                    motion.mass[j][i] = mass[entry];
                }
            }
            motion.mass[i][i] += motion.h * model.dof_damping()[*dof];
            motion.other[i] = passive[*dof] - bias[*dof];
        }
    }
}

impl Model {
    /// Returns stiffness kp (N m/rad or N/m) and damping kv (N m s/rad or N s/m) of actuator
    /// `index`, a position servo.
    pub(crate) fn servo_gains(&self, index: usize) -> (f64, f64) {
        (self.inner.actuator_gainprm()[index][0], -self.inner.actuator_biasprm()[index][2])
    }
}

/// The joints of the servos at the start of a physics step.
#[derive(Default)]
struct Motion {
    h: f64,
    /// Mass matrix, with the damping of the joints.
    mass: [Vector; MAX_SERVOS],
    velocity: Vector,
    /// Damping of the servos, N m s/rad or N s/m.
    damping: Vector,
    /// Efforts that the servos require, without their limits.
    required: Vector,
    /// All other torques but those of contacts.
    other: Vector,
}

impl Motion {
    /// Returns the efforts of the servos that brake.
    fn braking(&self, servos: &[Servo]) -> [Option<f64>; MAX_SERVOS] {
        let n = servos.len();
        let mut braking = [None; MAX_SERVOS];
        let mut effort: Vector = std::array::from_fn(|i| match servos.get(i) {
            Some(servo) => self.required[i].clamp(-servo.max_effort, servo.max_effort),
            None => 0.0,
        });
        let mut is_implicit: [bool; MAX_SERVOS] = std::array::from_fn(|i| {
            servos.get(i).is_some_and(|servo| self.required[i].abs() < servo.max_effort)
        });
        let torque = |effort: &Vector| -> Vector { std::array::from_fn(|i| effort[i] + self.other[i]) };
        let accelerations = solve(n, &self.factor(n, &is_implicit), torque(&effort));
        let is_too_fast = |i: usize, acceleration: f64| {
            (self.velocity[i] + self.h * acceleration).abs() > servos[i].max_velocity
        };
        let mut brakes = [false; MAX_SERVOS];
        for i in 0..n {
            brakes[i] = is_too_fast(i, accelerations[i]);
        }
        if !brakes.contains(&true) {
            return braking;
        }
        let most: Vector =
            std::array::from_fn(|i| servos.get(i).map_or(0.0, |s| BRAKING_SHARE * s.max_effort));
        for i in 0..n {
            if brakes[i] {
                is_implicit[i] = true;
                effort[i] = effort[i].clamp(-most[i], most[i]);
            }
        }
        let factor = self.factor(n, &is_implicit);
        let inverse: [Vector; MAX_SERVOS] = std::array::from_fn(|i| {
            if i < n {
                solve(n, &factor, std::array::from_fn(|j| if i == j { 1.0 } else { 0.0 }))
            } else {
                [0.0; MAX_SERVOS]
            }
        });
        let mut accelerations = solve(n, &factor, torque(&effort));
        let start = effort;
        for _ in 0..SWEEPS {
            for i in 0..n {
                let velocity = self.velocity[i] + self.h * accelerations[i];
                let limit = servos[i].max_velocity;
                // A servo that brakes moves its joint at the limit, as long as that is braking.
                let bound = match effort[i] - start[i] {
                    0.0 => velocity.clamp(-limit, limit),
                    change => -limit.copysign(change),
                };
                if velocity == bound {
                    continue;
                }
                let change = (bound - velocity) / (self.h * inverse[i][i]);
                let mut next = (effort[i] + change).clamp(-most[i], most[i]);
                if (effort[i] - start[i]) * (next - start[i]) < 0.0 {
                    next = start[i];
                }
                for j in 0..n {
                    accelerations[j] += inverse[i][j] * (next - effort[i]);
                }
                effort[i] = next;
            }
        }
        for i in 0..n {
            if effort[i] != start[i] || brakes[i] {
                braking[i] = Some(effort[i]);
            }
        }
        braking
    }

    /// Returns the Cholesky factor of the mass matrix with the damping of the servos that MuJoCo
    /// treats implicitly.
    fn factor(&self, n: usize, is_implicit: &[bool; MAX_SERVOS]) -> [Vector; MAX_SERVOS] {
        let mut a = self.mass;
        for i in 0..n {
            if is_implicit[i] {
                a[i][i] += self.h * self.damping[i];
            }
        }
        for i in 0..n {
            for k in 0..=i {
                let sum: f64 = (0..k).map(|m| a[i][m] * a[k][m]).sum();
                a[i][k] = if i == k { (a[i][i] - sum).sqrt() } else { (a[i][k] - sum) / a[k][k] };
            }
        }
        a
    }
}

/// Solves L Lᵀ x = b for the lower triangle L of the first n rows of `factor`.
fn solve(n: usize, factor: &[Vector; MAX_SERVOS], mut b: Vector) -> Vector {
    for i in 0..n {
        let sum: f64 = (0..i).map(|k| factor[i][k] * b[k]).sum();
        b[i] = (b[i] - sum) / factor[i][i];
    }
    for i in (0..n).rev() {
        let sum: f64 = (i + 1..n).map(|k| factor[k][i] * b[k]).sum();
        b[i] = (b[i] - sum) / factor[i][i];
    }
    b
}
