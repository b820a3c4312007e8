//! Expert of ball catching: moves the box, tilted towards the ball, to the predicted position of
//! the ball at a fixed height, and then returns to the initial posture.

use std::sync::Arc;

use mishandle_rollout::Controller;
use mishandle_world::WorldError;
use mishandle_world::frame::{add, dot, norm, scale, sub};

use super::{DEFINITION, DEPTH, FLOOR, INSIDE, ORIGIN, fall_time};
use crate::expert::{Expert, ExpertInput, ExpertPolicy};
use crate::kinematic::{ResolvedRate, rotation_between};

/// Height at which the box meets the ball, m. A larger height leaves the arm too little time, a
/// smaller one is outside the joint limits.
const HEIGHT: f64 = 0.507;

/// Forward tilt of the box when it meets the ball, rad. It shortens the motion of joint 6.
const TILT: f64 = 0.5;

/// Distance of the ball from the tool point along the box's axis when the box meets it, m: slightly
/// below the mouth.
const AIM: f64 = 0.085;

/// Gains of the joint position error, 1/s: to meet the ball, and to return to the initial posture.
const MEET_RATE: f64 = 20.0;
const HOME_RATE: f64 = 4.0;

/// Time before the ball at which the box should arrive, s.
const EARLY: f64 = 0.01;

/// Maximum joint velocity of the return to the initial posture, rad/s.
const HOME_SPEED: f64 = 0.8;

/// Newton iterations of the inverse kinematics, starting from the middle of the postures that meet
/// a ball.
const ITERATIONS: usize = 8;

struct Catch {
    /// Grasp point minus tool point, m, and the hand's rotation matrix (row-major), while the box
    /// is level.
    grasp: [f64; 3],
    rotation: [f64; 9],
}

impl Catch {
    /// Returns a vector of the level box, m, in the world frame for the hand's rotation matrix
    /// `rotation`.
    fn turned(&self, rotation: &[f64; 9], v: [f64; 3]) -> [f64; 3] {
        let own: [f64; 3] = std::array::from_fn(|i| dot([0, 1, 2].map(|k| self.rotation[3 * k + i]), v));
        std::array::from_fn(|i| dot([0, 1, 2].map(|k| rotation[3 * i + k]), own))
    }

    /// Returns whether the ball is in the box. `ball` is relative to the tool point.
    fn holds(&self, rotation: &[f64; 9], ball: [f64; 3]) -> bool {
        let axis = self.turned(rotation, [0.0, 0.0, 1.0]);
        let height = dot(ball, axis);
        let aside = norm(sub(ball, scale(axis, height)));
        (0.0..FLOOR + DEPTH).contains(&height) && aside <= INSIDE
    }

    /// Returns the posture with the box under a ball at `ball`.
    fn posture(&self, arm: &mut ResolvedRate, ball: [f64; 3]) -> [f64; 7] {
        let rotation = facing(&self.rotation, ball[1].atan2(ball[0]));
        let offset = sub(self.grasp, [0.0, 0.0, AIM]);
        let position = add(ball, self.turned(&rotation, offset));
        let mut q = Self::REST;
        for _ in 0..ITERATIONS {
            arm.set(&q);
            let linear = sub(position, arm.position());
            let step = arm.twist(&q, linear, rotation_between(&arm.rotation(), &rotation));
            q = std::array::from_fn(|i| q[i] + step[i]);
        }
        q
    }
}

impl ExpertPolicy for Catch {
    const SITE: &'static str = "grasp";
    const REST: [f64; 7] = [0.0, 0.05, 0.0, -2.0, 0.0, 3.0, 0.785];

    fn velocity(&self, input: &ExpertInput<'_>, arm: &mut ResolvedRate, _memory: &mut [f64]) -> [f64; 7] {
        let ball = input.point(0);
        let from_tool = scale(input.point(3), -1.0);
        let velocity = input.point(6);
        let (goal, rate, speed) = match fall_time(ball[2] - HEIGHT, velocity[2]) {
            _ if self.holds(&arm.rotation(), from_tool) => (home(), HOME_RATE, HOME_SPEED),
            Some(time) => {
                let met = [ball[0] + velocity[0] * time, ball[1] + velocity[1] * time, HEIGHT];
                // As slow as the time allows.
                let rate = MEET_RATE.min(1.0 / (time - EARLY).max(1e-3));
                (self.posture(arm, met), rate, f64::INFINITY)
            }
            None => return [0.0; 7],
        };
        std::array::from_fn(|i| (rate * (goal[i] - input.q[i])).clamp(-speed, speed))
    }
}

fn home() -> [f64; 7] {
    std::array::from_fn(|i| DEFINITION.start[i])
}

/// Returns `rotation` tilted forward by [`TILT`] and then turned to the left by `yaw`.
fn facing(rotation: &[f64; 9], yaw: f64) -> [f64; 9] {
    let (st, ct) = TILT.sin_cos();
    let (sy, cy) = yaw.sin_cos();
    let turn = [cy * ct, -sy, cy * st, sy * ct, cy, sy * st, -st, 0.0, ct];
    std::array::from_fn(|i| (0..3).map(|k| turn[3 * (i / 3) + k] * rotation[3 * k + i % 3]).sum())
}

pub(super) fn expert() -> Result<Arc<dyn Controller>, WorldError> {
    let definition = const { &DEFINITION };
    let model = mishandle_world::Model::from_xml(mishandle_world::PANDA)?;
    let mut arm = mishandle_world::Arm::new(&model, &crate::robot::JOINT_NAMES[..7], Catch::SITE)?;
    arm.set(&home());
    let tool = add(ORIGIN, [0.0, 0.0, FLOOR]);
    Expert::controller(Catch { grasp: sub(arm.position(), tool), rotation: arm.rotation() }, definition)
}
