//! Expert of ball catching: moves the box, tilted towards the ball, to the predicted position of
//! the ball at a fixed height, and then returns to the initial posture. A ball that comes down too
//! far away is caught after its first bounce.

use std::sync::Arc;

use mishandle_rollout::Controller;
use mishandle_world::WorldError;
use mishandle_world::frame::{add, dot, norm, scale, sub};

use super::{DEFINITION, DEPTH, FLOOR, GRAVITY, INSIDE, ORIGIN};
use crate::expert::{Expert, ExpertInput, ExpertPolicy, toward};
use crate::kinematic::{ResolvedRate, rotation_between};
use crate::robot::{COMMANDED_ACCELERATION, CONTROL_DT};

/// How the box meets the ball.
struct Meeting {
    /// Forward tilt of the box, rad.
    tilt: f64,
    /// Distance of the ball from the tool point along the box's axis, m.
    aim: f64,
    /// Posture near the middle of those that meet a ball, rad.
    posture: [f64; 7],
}

/// Meeting of a ball in its first flight, slightly below the mouth of the box. The tilt shortens
/// the motion of joint 6.
const FLIGHT: Meeting = Meeting { tilt: 0.95, aim: 0.07, posture: Catch::REST };

/// Height of the ball in this meeting, m. A larger one leaves the arm too little time, a smaller
/// one is outside the joint limits.
const FLIGHT_HEIGHT: f64 = 0.46;

/// Meeting of a ball after its first bounce, which comes down into the mouth of the box over its
/// upper wall. The box lies on its side, because joint 4 cannot fold the arm farther.
const BOUNCE: Meeting = Meeting { tilt: 1.52, aim: 0.09, posture: [0.0, -0.17, 0.0, -2.85, 0.0, 2.8, 0.785] };

/// Distance of this meeting from the top of the ball's path, m. The ball flies flatter nearer to
/// the top, and comes too late for the success formula farther below.
const BELOW_TOP: f64 = 0.017;

/// Largest distance in x at which the box meets a ball in its first flight, m. The arm comes too
/// late for a farther one.
const FAR: f64 = 0.626;

/// Upward velocity after the first bounce, m/s, and the share of the horizontal velocity that the
/// ball keeps in it. They only start the motion: after the bounce, the expert sees the velocity.
const RISE: f64 = 2.05;
const KEPT: f64 = 0.67;

/// Radius of the ball, m.
const RADIUS: f64 = 0.01;

/// Height that a ball reaches only before its first bounce, m.
const THROWN: f64 = 0.8;

/// Gain of the joint position error in the motion to a ball that bounces, 1/s.
const BOUNCE_RATE: f64 = 7.0;

/// Gain of the joint position error in the return to the initial posture, 1/s.
const HOME_RATE: f64 = 4.0;

/// Maximum joint velocity of the return to the initial posture, rad/s.
const HOME_SPEED: f64 = 0.8;

/// Newton iterations of the inverse kinematics.
const ITERATIONS: usize = 8;

/// Values of the memory.
const IN_FLIGHT: f64 = 0.0;
const BOUNCED: f64 = 1.0;

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
    fn posture(&self, arm: &mut ResolvedRate, meeting: &Meeting, ball: [f64; 3]) -> [f64; 7] {
        let rotation = facing(&self.rotation, meeting.tilt, ball[1].atan2(ball[0]));
        let offset = sub(self.grasp, [0.0, 0.0, meeting.aim]);
        let position = add(ball, self.turned(&rotation, offset));
        let mut q = meeting.posture;
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
    /// Whether it meets the ball in its first flight or after its bounce.
    const MEMORY: usize = 1;
    const SITE: &'static str = "grasp";
    /// As much as the time needs. Joint 4 starts slowly, because it jolts joint 2.
    const EFFORT: [f64; 7] = [1.0, 0.88, 1.0, 1.0, 1.0, 1.0, 1.0];
    const RAMPS: Option<[f64; 7]> = Some([1.0, 1.0, 1.0, 10.0, 1.0, 1.0, 1.0]);
    const REST: [f64; 7] = [0.0, 0.05, 0.0, -2.0, 0.0, 3.0, 0.785];

    fn begin(&self, input: &ExpertInput<'_>, _arm: &mut ResolvedRate, memory: &mut [f64]) {
        let met = Ball::of(input).falls_to(FLIGHT_HEIGHT);
        memory[0] = if met.is_some_and(|(_, position)| position[0] <= FAR) { IN_FLIGHT } else { BOUNCED };
    }

    fn velocity(&self, input: &ExpertInput<'_>, arm: &mut ResolvedRate, memory: &mut [f64]) -> [f64; 7] {
        let from_tool = scale(input.point(3), -1.0);
        if self.holds(&arm.rotation(), from_tool) {
            return toward(&home(), &input.q, HOME_RATE).map(|v| v.clamp(-HOME_SPEED, HOME_SPEED));
        }
        let ball = Ball::of(input);
        if memory[0] == IN_FLIGHT {
            let Some((time, met)) = ball.falls_to(FLIGHT_HEIGHT) else { return [0.0; 7] };
            let goal = self.posture(arm, &FLIGHT, met);
            return std::array::from_fn(|i| speed_to_meet(i, goal[i] - input.q[i], input.commanded[i], time));
        }
        let ball = ball.after_bounce();
        let Some((_, met)) = ball.falls_to(ball.highest() - BELOW_TOP) else { return [0.0; 7] };
        toward(&self.posture(arm, &BOUNCE, met), &input.q, BOUNCE_RATE)
    }
}

/// Position (m) and velocity (m/s) of the ball.
struct Ball {
    position: [f64; 3],
    velocity: [f64; 3],
}

impl Ball {
    fn of(input: &ExpertInput<'_>) -> Ball {
        Ball { position: input.point(0), velocity: input.point(6) }
    }

    /// Returns the height of the top of the path, m.
    fn highest(&self) -> f64 {
        self.position[2] + 0.5 * self.velocity[2] * self.velocity[2] / GRAVITY
    }

    /// Returns the time (s) until the ball falls to `height` (m), or until it is at the top of its
    /// path if that is lower, and its position (m) then; `None` if that is in the past.
    fn falls_to(&self, height: f64) -> Option<(f64, [f64; 3])> {
        let [x, y, z] = self.position;
        let [vx, vy, up] = self.velocity;
        let down = (up * up + 2.0 * GRAVITY * (z - height)).max(0.0).sqrt();
        let time = (up + down) / GRAVITY;
        (time >= 0.0).then_some((time, [x + vx * time, y + vy * time, z + 0.5 * (up - down) * time]))
    }

    /// Returns the ball at the end of its first bounce, or as it is if that is in the past.
    fn after_bounce(self) -> Ball {
        let [vx, vy, _] = self.velocity;
        match self.falls_to(RADIUS) {
            Some((_, position)) if self.highest() > THROWN => {
                Ball { position, velocity: [KEPT * vx, KEPT * vy, RISE] }
            }
            _ => self,
        }
    }
}

/// Returns the velocity (rad/s) that brings joint `i` over `way` (rad) in `time` (s), if it changes
/// from `velocity` with the limit of its acceleration and then stays. If the time is too short, the
/// joint accelerates all the way.
fn speed_to_meet(i: usize, way: f64, velocity: f64, time: f64) -> f64 {
    let time = time.max(CONTROL_DT);
    let gained = COMMANDED_ACCELERATION[i] * time;
    // change * time - change² / (2 acceleration) = way - velocity * time
    let missing = way - velocity * time;
    let root = (gained * gained - 2.0 * COMMANDED_ACCELERATION[i] * missing.abs()).max(0.0).sqrt();
    velocity + (gained - root).copysign(missing)
}

fn home() -> [f64; 7] {
    std::array::from_fn(|i| DEFINITION.start[i])
}

/// Returns `rotation` tilted forward by `tilt` and then turned to the left by `yaw`.
fn facing(rotation: &[f64; 9], tilt: f64, yaw: f64) -> [f64; 9] {
    let (st, ct) = tilt.sin_cos();
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
