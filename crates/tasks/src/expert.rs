//! The base of the experts: controllers that compute joint velocities from the observation.

use std::sync::Arc;

use mishandle_rollout::{Controller, ControllerWorker};
use mishandle_world::{Joint, Model, PANDA, WorldError};

use crate::definition::Definition;
use crate::kinematic::ResolvedRate;
use crate::robot::{ARM_JOINTS, JOINT_NAMES, JOINTS, Panda, SERVO_LAG, TARGET_STEP, VELOCITY_LIMIT};

/// The memory of an expert that has not seen a state yet. Phases are not negative.
const NOT_BEGUN: f64 = -1.0;

/// The observation of an expert.
pub struct ExpertInput<'a> {
    /// Positions of the arm joints, rad.
    pub q: [f64; ARM_JOINTS],
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
    model: Model,
}

impl<P: ExpertPolicy> Expert<P> {
    /// Makes the expert of the task with this definition.
    ///
    /// # Errors
    /// If the robot's model does not compile or has no site [`ExpertPolicy::SITE`].
    pub fn controller(policy: P, definition: &'static Definition) -> Result<Arc<dyn Controller>, WorldError> {
        let model = Model::from_xml(PANDA)?;
        // Each worker makes both again and cannot return an error.
        Panda::new(&model)?;
        arm::<P>(&model)?;
        Ok(Arc::new(Expert { policy: Arc::new(policy), definition, model }))
    }
}

fn arm<P: ExpertPolicy>(model: &Model) -> Result<ResolvedRate, WorldError> {
    let mut names = [""; ARM_JOINTS];
    names.copy_from_slice(&JOINT_NAMES[..ARM_JOINTS]);
    ResolvedRate::new(model, &names, P::SITE, P::REST)
}

impl<P: ExpertPolicy> Controller for Expert<P> {
    fn observation_size(&self) -> usize {
        self.definition.layout().observation_size()
    }

    fn action_size(&self) -> usize {
        JOINTS
    }

    fn state_size(&self) -> usize {
        P::MEMORY
    }

    fn worker(&self) -> Box<dyn ControllerWorker> {
        let checked = "`Expert::controller` checked the model";
        let panda = Panda::new(&self.model).expect(checked);
        Box::new(ExpertWorker {
            policy: self.policy.clone(),
            joints: *panda.joints(),
            arm: arm::<P>(&self.model).expect(checked),
            velocity_scale: self.definition.velocity_scale,
            observation_size: self.observation_size(),
        })
    }
}

struct ExpertWorker<P> {
    policy: Arc<P>,
    joints: [Joint; JOINTS],
    arm: ResolvedRate,
    velocity_scale: f64,
    observation_size: usize,
}

impl<P: ExpertPolicy> ControllerWorker for ExpertWorker<P> {
    fn reset(&mut self, state: &mut [f64], _seed: mishandle_rollout::Seed) {
        state.fill(NOT_BEGUN);
    }

    fn act(&mut self, _rows: usize, observations: &[f32], states: &mut [f64], actions: &mut [f32]) {
        let rows = observations.chunks(self.observation_size).zip(actions.chunks_mut(JOINTS));
        for (row, (observation, action)) in rows.enumerate() {
            let memory = &mut states[row * P::MEMORY..][..P::MEMORY];
            let position = |i: usize| {
                let Joint { low, high, .. } = self.joints[i];
                low + 0.5 * (f64::from(observation[i]) + 1.0) * (high - low)
            };
            let q: [f64; ARM_JOINTS] = std::array::from_fn(position);
            let fingers = std::array::from_fn(|i| position(ARM_JOINTS + i));
            let input = ExpertInput { q, fingers, task: &observation[2 * JOINTS..] };
            self.arm.set(&q);
            if memory.first() == Some(&NOT_BEGUN) {
                self.policy.begin(&input, &mut self.arm, memory);
            }
            let desired = self.policy.velocity(&input, &mut self.arm, memory);
            // A policy may move its copy of the arm.
            self.arm.set(&q);
            let desired = self.arm.limit_speed(desired, P::MAX_SPEED);
            // A servo without obstacles moves at (target - q) / lag, so the observed velocity
            // determines its target. The action moves the target by the difference to the desired
            // target.
            for i in 0..ARM_JOINTS {
                let velocity = f64::from(observation[JOINTS + i]) / self.velocity_scale;
                let desired = desired[i].clamp(-VELOCITY_LIMIT[i], VELOCITY_LIMIT[i]);
                action[i] = (SERVO_LAG[i] * (desired - velocity) / TARGET_STEP).clamp(-1.0, 1.0) as f32;
            }
            let fingers = self.policy.fingers(&input, memory);
            action[ARM_JOINTS..].copy_from_slice(&fingers.map(|a| a as f32));
        }
    }
}

/// Scales `v` down to a norm of at most `limit`.
pub fn clamp_norm(v: [f64; 3], limit: f64) -> [f64; 3] {
    let length = mishandle_world::frame::norm(v);
    if length > limit { mishandle_world::frame::scale(v, limit / length) } else { v }
}
