//! What the experts share: they see what a controller may see, and command joint velocities.

use std::sync::Arc;

use mishandle_rollout::{Controller, ControllerWorker};
use mishandle_world::{Joint, Model, PANDA, WorldError};

use crate::definition::Definition;
use crate::kinematic::ResolvedRate;
use crate::robot::{ARM_JOINTS, JOINT_NAMES, JOINTS, Panda, SERVO_LAG, TARGET_STEP, VELOCITY_LIMIT};

/// What an expert sees in one sample.
pub struct ExpertInput<'a> {
    /// Positions of the arm's joints, rad.
    pub q: [f64; ARM_JOINTS],
    /// Positions of the fingers, m.
    pub fingers: [f64; JOINTS - ARM_JOINTS],
    /// The task's part of the observation.
    pub task: &'a [f32],
}

impl ExpertInput<'_> {
    /// Three numbers of the task's part, from `at` on.
    pub fn point(&self, at: usize) -> [f64; 3] {
        [0, 1, 2].map(|i| f64::from(self.task[at + i]))
    }
}

/// How one task's expert moves.
pub trait ExpertPolicy: Send + Sync + 'static {
    /// Length of its memory.
    const MEMORY: usize = 0;
    /// Site whose motion it thinks in.
    const SITE: &'static str;
    /// Posture it is drawn to, rad.
    const REST: [f64; ARM_JOINTS];

    /// The joint velocities it wants, rad/s.
    fn velocity(
        &self,
        seen: &ExpertInput<'_>,
        arm: &mut ResolvedRate,
        memory: &mut [f64],
    ) -> [f64; ARM_JOINTS];

    /// The actions for the fingers, in [-1, 1]; called after [`velocity`](Self::velocity). They count where the policy
    /// moves the fingers.
    fn fingers(&self, _seen: &ExpertInput<'_>, _memory: &[f64]) -> [f64; JOINTS - ARM_JOINTS] {
        [0.0; JOINTS - ARM_JOINTS]
    }
}

/// An expert of a task: a [`ExpertPolicy`] on top of the robot's kinematics.
pub struct Expert<B> {
    behavior: Arc<B>,
    definition: &'static Definition,
    model: Model,
}

impl<B: ExpertPolicy> Expert<B> {
    /// The expert of the task that `definition` describes.
    pub fn controller(
        behavior: B,
        definition: &'static Definition,
    ) -> Result<Arc<dyn Controller>, WorldError> {
        let model = Model::from_xml(PANDA)?;
        // Both are made for every thread later; that they can be made is found out here.
        Panda::new(&model)?;
        arm::<B>(&model)?;
        Ok(Arc::new(Expert { behavior: Arc::new(behavior), definition, model }))
    }
}

fn arm<B: ExpertPolicy>(model: &Model) -> Result<ResolvedRate, WorldError> {
    let mut names = [""; ARM_JOINTS];
    names.copy_from_slice(&JOINT_NAMES[..ARM_JOINTS]);
    ResolvedRate::new(model, &names, B::SITE, B::REST)
}

impl<B: ExpertPolicy> Controller for Expert<B> {
    fn observation_size(&self) -> usize {
        self.definition.layout().observation_size()
    }

    fn action_size(&self) -> usize {
        JOINTS
    }

    fn state_size(&self) -> usize {
        B::MEMORY
    }

    fn worker(&self) -> Box<dyn ControllerWorker> {
        // Both were made once from the same model in `controller`.
        let made = "the expert's model was checked when the expert was made";
        let panda = Panda::new(&self.model).expect(made);
        Box::new(ExpertActor {
            behavior: self.behavior.clone(),
            joints: *panda.joints(),
            arm: arm::<B>(&self.model).expect(made),
            velocity_scale: self.definition.velocity_scale,
            observation_size: self.observation_size(),
        })
    }
}

struct ExpertActor<B> {
    behavior: Arc<B>,
    joints: [Joint; JOINTS],
    arm: ResolvedRate,
    velocity_scale: f64,
    observation_size: usize,
}

impl<B: ExpertPolicy> ControllerWorker for ExpertActor<B> {
    fn reset(&mut self, state: &mut [f64], _seed: mishandle_rollout::Seed) {
        state.fill(0.0);
    }

    fn act(&mut self, _rows: usize, observations: &[f32], states: &mut [f64], actions: &mut [f32]) {
        let rows = observations.chunks(self.observation_size).zip(actions.chunks_mut(JOINTS));
        for (row, (observation, action)) in rows.enumerate() {
            let memory = &mut states[row * B::MEMORY..][..B::MEMORY];
            let position = |i: usize| {
                let Joint { low, high, .. } = self.joints[i];
                low + 0.5 * (f64::from(observation[i]) + 1.0) * (high - low)
            };
            let q: [f64; ARM_JOINTS] = std::array::from_fn(position);
            let fingers = std::array::from_fn(|i| position(ARM_JOINTS + i));
            let seen = ExpertInput { q, fingers, task: &observation[2 * JOINTS..] };
            self.arm.set(&q);
            let wanted = self.behavior.velocity(&seen, &mut self.arm, memory);
            // A servo that is not held up moves at (target - q) / lag, so the velocity seen tells where the target
            // is; the action moves the target by the difference to where it should be.
            for i in 0..ARM_JOINTS {
                let velocity = f64::from(observation[JOINTS + i]) / self.velocity_scale;
                let wanted = wanted[i].clamp(-VELOCITY_LIMIT[i], VELOCITY_LIMIT[i]);
                action[i] = (SERVO_LAG[i] * (wanted - velocity) / TARGET_STEP).clamp(-1.0, 1.0) as f32;
            }
            let fingers = self.behavior.fingers(&seen, memory);
            action[ARM_JOINTS..].copy_from_slice(&fingers.map(|a| a as f32));
        }
    }
}

/// `v` shortened to at most `limit`.
pub fn limited(v: [f64; 3], limit: f64) -> [f64; 3] {
    let length = mishandle_world::frame::norm(v);
    if length > limit { mishandle_world::frame::scale(v, limit / length) } else { v }
}
