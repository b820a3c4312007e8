//! The base of the experts: controllers that compute joint velocities from the observation, and
//! act through the limiter of an action interface.

use std::sync::Arc;

use mishandle_controllers::{ActionLimiter, Fitted, JOINT_TARGETS};
use mishandle_rollout::{Controller, ControllerWorker};
use mishandle_world::{Joint, Model, PANDA, WorldError};

use crate::definition::Definition;
use crate::kinematic::ResolvedRate;
use crate::robot::{
    ARM_JOINTS, COMMANDED_ACCELERATION, COMMANDED_VELOCITY, CONTROL_DT, JOINT_NAMES, JOINTS, Panda,
};

/// The memory of an expert that has not seen a state yet. Phases are not negative.
const NOT_BEGUN: f64 = -1.0;

/// The commanded velocity before the first control step.
const UNKNOWN: f64 = f64::INFINITY;

/// Share of the acceleration limits with which a joint brakes before its goal. The rest is for
/// what it does not know in advance.
const BRAKING_SHARE: f64 = 0.5;

/// Gain with which the commanded motion goes back to a joint that did not follow it, 1/s. So the
/// force on what stops an arm is limited: it is proportional to the desired velocity.
const YIELDING: f64 = 5.0;

/// The observation of an expert, and what its limiter knows.
pub struct ExpertInput<'a> {
    /// Positions of the arm joints, rad.
    pub q: [f64; ARM_JOINTS],
    /// Commanded velocities of the arm joints in the control step before, rad/s.
    pub commanded: [f64; ARM_JOINTS],
    /// Positions of the fingers, m.
    pub fingers: [f64; JOINTS - ARM_JOINTS],
    /// Task's part of the observation.
    pub task: &'a [f32],
}

impl ExpertInput<'_> {
    /// Returns the three numbers of the task's part that start at index `at`.
    pub fn point(&self, at: usize) -> [f64; 3] {
        [0, 1, 2].map(|i| f64::from(self.task[at + i]))
    }
}

/// The policy of one task's expert.
pub trait ExpertPolicy: Send + Sync + 'static {
    /// Length of the memory per simulation.
    const MEMORY: usize = 0;
    /// Site that the policy moves.
    const SITE: &'static str;
    /// Rest posture for the null space of the inverse kinematics, rad.
    const REST: [f64; ARM_JOINTS];

    /// Maximum desired speed of the site, m/s: below the limit of careful formulas, because the
    /// joints reach their desired velocities one after the other.
    const MAX_SPEED: f64 = 1.5;

    /// Accelerations that the expert commands, as shares of their limits. The joints are coupled: a
    /// joint that follows its command accelerates more while another one starts or stops.
    const EFFORT: [f64; ARM_JOINTS] = [0.75; ARM_JOINTS];

    /// Without ramps, all joints change their velocities together, so that the site changes its own
    /// in a straight line. With them, each joint does as it can: the control steps in which its
    /// acceleration grows from 0 to its limit.
    const RAMPS: Option<[f64; ARM_JOINTS]> = None;

    /// Returns the desired joint velocities, rad/s.
    fn velocity(
        &self,
        input: &ExpertInput<'_>,
        arm: &mut ResolvedRate,
        memory: &mut [f64],
    ) -> [f64; ARM_JOINTS];

    /// Writes the memory of an expert that takes over in this state, in which another controller
    /// may have left the robot: its phase. At the start of an episode, that is the first one.
    /// By default, the memory is 0.
    fn begin(&self, _input: &ExpertInput<'_>, _arm: &mut ResolvedRate, memory: &mut [f64]) {
        memory.fill(0.0);
    }

    /// Returns the actions of the fingers, in [-1, 1]. The call follows
    /// [`velocity`](Self::velocity). The actions have an effect only in tasks whose policy moves
    /// the fingers.
    fn fingers(&self, _input: &ExpertInput<'_>, _memory: &[f64]) -> [f64; JOINTS - ARM_JOINTS] {
        [0.0; JOINTS - ARM_JOINTS]
    }
}

/// The expert of a task: an [`ExpertPolicy`] on top of the robot's kinematics.
pub struct Expert<P> {
    policy: Arc<P>,
    definition: &'static Definition,
    limiter: ActionLimiter,
    observation_size: usize,
    model: Model,
}

impl<P: ExpertPolicy> Expert<P> {
    /// Makes the expert of the task with this definition.
    ///
    /// # Errors
    /// If the robot's model does not compile or has no site [`ExpertPolicy::SITE`].
    ///
    /// # Panics
    /// Never: the action interface of the experts fits the arm.
    pub fn controller(policy: P, definition: &'static Definition) -> Result<Arc<dyn Controller>, WorldError> {
        let model = Model::from_xml(PANDA)?;
        // Each worker makes both again and cannot return an error.
        let panda = Panda::new(&model)?;
        arm::<P>(&model)?;
        let further_parts = vec![JOINT_TARGETS.to_string()];
        let observation_size = definition.layout_with(&further_parts).observation_size();
        let targets = panda.joint_targets(definition.layout().observation_size());
        let limiter = ActionLimiter::new(&Panda::action_interface(), targets).expect("it fits the arm");
        let expert = Expert { policy: Arc::new(policy), definition, limiter, observation_size, model };
        Ok(Arc::new(Fitted::new(Arc::new(expert), further_parts, None)))
    }
}

fn arm<P: ExpertPolicy>(model: &Model) -> Result<ResolvedRate, WorldError> {
    let mut names = [""; ARM_JOINTS];
    names.copy_from_slice(&JOINT_NAMES[..ARM_JOINTS]);
    ResolvedRate::new(model, &names, P::SITE, P::REST)
}

impl<P: ExpertPolicy> Controller for Expert<P> {
    fn observation_size(&self) -> usize {
        self.observation_size
    }

    fn action_size(&self) -> usize {
        JOINTS
    }

    /// The memory of the policy, then that of the limiter, then the commanded velocities of the
    /// control step before the last one.
    fn state_size(&self) -> usize {
        P::MEMORY + self.limiter.memory_size() + ARM_JOINTS
    }

    fn worker(&self) -> Box<dyn ControllerWorker> {
        let checked = "`Expert::controller` checked the model";
        let panda = Panda::new(&self.model).expect(checked);
        Box::new(ExpertWorker {
            policy: self.policy.clone(),
            joints: *panda.joints(),
            arm: arm::<P>(&self.model).expect(checked),
            limiter: self.limiter.clone(),
            measured_size: self.definition.layout().observation_size(),
            observation_size: self.observation_size,
        })
    }
}

struct ExpertWorker<P> {
    policy: Arc<P>,
    joints: [Joint; JOINTS],
    arm: ResolvedRate,
    limiter: ActionLimiter,
    /// Length of the observation before the targets.
    measured_size: usize,
    observation_size: usize,
}

impl<P: ExpertPolicy> ControllerWorker for ExpertWorker<P> {
    fn reset(&mut self, state: &mut [f64], _seed: mishandle_rollout::Seed) {
        let (memory, rest) = state.split_at_mut(P::MEMORY);
        let (limits, before) = rest.split_at_mut(self.limiter.memory_size());
        memory.fill(NOT_BEGUN);
        self.limiter.reset(limits);
        before.fill(UNKNOWN);
    }

    fn act(&mut self, _rows: usize, observations: &[f32], states: &mut [f64], actions: &mut [f32]) {
        let rows = observations.chunks(self.observation_size).zip(actions.chunks_mut(JOINTS));
        for (row, (observation, action)) in rows.enumerate() {
            let size = P::MEMORY + self.limiter.memory_size() + ARM_JOINTS;
            let (memory, rest) = states[row * size..][..size].split_at_mut(P::MEMORY);
            let (limits, before) = rest.split_at_mut(self.limiter.memory_size());
            let measured = &observation[..self.measured_size];
            let position = |i: usize| {
                let Joint { low, high, .. } = self.joints[i];
                low + 0.5 * (f64::from(measured[i]) + 1.0) * (high - low)
            };
            let q: [f64; ARM_JOINTS] = std::array::from_fn(position);
            let fingers = std::array::from_fn(|i| position(ARM_JOINTS + i));
            let commanded = std::array::from_fn(|i| self.limiter.commanded_velocity(i, observation, limits));
            let input = ExpertInput { q, commanded, fingers, task: &measured[2 * JOINTS..] };
            self.arm.set(&q);
            if memory.first() == Some(&NOT_BEGUN) {
                self.policy.begin(&input, &mut self.arm, memory);
            }
            let desired = self.policy.velocity(&input, &mut self.arm, memory);
            // A policy may move its copy of the arm.
            self.arm.set(&q);
            let desired = self.arm.limit_speed(desired, P::MAX_SPEED);
            let desired = within_limits(desired);
            let changes: [f64; ARM_JOINTS] = std::array::from_fn(|i| {
                let ahead = self.limiter.commanded_position(i, observation, limits) - q[i];
                desired[i] - YIELDING * ahead - commanded[i]
            });
            let last = std::array::from_fn(|i| {
                if before[i].is_finite() { (commanded[i] - before[i]) / CONTROL_DT } else { 0.0 }
            });
            let accelerations = accelerations::<P>(changes, last);
            for i in 0..ARM_JOINTS {
                let velocity = commanded[i] + CONTROL_DT * accelerations[i];
                action[i] = (velocity / COMMANDED_VELOCITY[i]) as f32;
            }
            before.copy_from_slice(&commanded);
            let fingers = self.policy.fingers(&input, memory);
            action[ARM_JOINTS..].copy_from_slice(&fingers.map(|a| a as f32));
            self.limiter.limit(observation, limits, action);
        }
    }
}

/// Scales joint velocities down until they are within the limits. So the site keeps its direction.
fn within_limits(velocity: [f64; ARM_JOINTS]) -> [f64; ARM_JOINTS] {
    let share = |i: usize| velocity[i].abs() / COMMANDED_VELOCITY[i];
    let largest = (0..ARM_JOINTS).map(share).fold(1.0, f64::max);
    velocity.map(|v| v / largest)
}

/// Returns the accelerations (rad/s²) for changes of the joint velocities, given the last ones.
fn accelerations<P: ExpertPolicy>(changes: [f64; ARM_JOINTS], last: [f64; ARM_JOINTS]) -> [f64; ARM_JOINTS] {
    let limit = |i: usize| P::EFFORT[i] * COMMANDED_ACCELERATION[i];
    let desired = changes.map(|change| change / CONTROL_DT);
    let Some(ramps) = P::RAMPS else {
        let largest = (0..ARM_JOINTS).map(|i| desired[i].abs() / limit(i)).fold(1.0, f64::max);
        return desired.map(|acceleration| acceleration / largest);
    };
    std::array::from_fn(|i| {
        let jerk = limit(i) / (ramps[i] * CONTROL_DT);
        // The acceleration from which it can go back to 0 without a jolt.
        let ending = (2.0 * jerk * changes[i].abs()).sqrt().min(desired[i].abs()).min(limit(i));
        let ending = if ramps[i] > 1.0 { ending } else { desired[i].abs().min(limit(i)) };
        let most = jerk * CONTROL_DT;
        let ramped = ending.copysign(changes[i]).clamp(last[i] - most, last[i] + most);
        if ramps[i] > 1.0 { ramped } else { ending.copysign(changes[i]) }
    })
}

/// Returns the fastest speed towards a point at `distance` from which a motion stops there with a
/// gain (1/s) near it, and a deceleration farther away.
pub fn approach_speed(distance: f64, gain: f64, deceleration: f64) -> f64 {
    // The motion decelerates at `gain` times its speed near the point: both parts meet where that
    // is the deceleration.
    let near = deceleration / (gain * gain);
    if distance < near { gain * distance } else { (deceleration * (2.0 * distance - near)).sqrt() }
}

/// Returns the velocity along `way` to its end: see [`approach_speed`]. It is at most `limit`.
pub fn approach(way: [f64; 3], gain: f64, deceleration: f64, limit: f64) -> [f64; 3] {
    let distance = mishandle_world::frame::norm(way);
    if distance == 0.0 {
        return way;
    }
    let speed = approach_speed(distance, gain, deceleration).min(limit);
    mishandle_world::frame::scale(way, speed / distance)
}

/// Returns joint velocities from `q` towards a posture, each as fast as its joint can still brake.
pub fn toward(posture: &[f64; ARM_JOINTS], q: &[f64; ARM_JOINTS], gain: f64) -> [f64; ARM_JOINTS] {
    std::array::from_fn(|i| {
        let way = posture[i] - q[i];
        approach_speed(way.abs(), gain, BRAKING_SHARE * COMMANDED_ACCELERATION[i]).copysign(way)
    })
}

/// Scales `v` down to a norm of at most `limit`.
pub fn clamp_norm(v: [f64; 3], limit: f64) -> [f64; 3] {
    let length = mishandle_world::frame::norm(v);
    if length > limit { mishandle_world::frame::scale(v, limit / length) } else { v }
}
