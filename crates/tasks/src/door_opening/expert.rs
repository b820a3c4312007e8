//! Expert of door opening: grasps the lever between the fingers, one above and one below, and pulls
//! it along the arc of the door.

use std::sync::Arc;

use mishandle_rollout::Controller;
use mishandle_world::WorldError;
use mishandle_world::frame::{add, cross, dot, norm, scale, sub};

use super::{HANDLE, HINGE};
use crate::expert::{Expert, ExpertInput, ExpertPolicy, approach, approach_speed, clamp_norm, toward};
use crate::kinematic::{ResolvedRate, rotation_between};
use crate::robot::{ARM_JOINTS, JOINTS};

/// Grasp point on the lever relative to the handle point, in the panel's frame, m: the front of its
/// bar at half height. The lever of the farthest door is grasped at its free end, which is nearest,
/// and from above, because the upper finger reaches farther. There it must pass just above the
/// lever.
const FRONT: [f64; 3] = [-0.0137, 0.024, -0.0017];
const FRONT_FAR: [f64; 3] = [-0.0137, 0.0018, -0.014];

/// Horizontal distances of the handle point of a closed door from the robot's axis between which
/// the grasp point changes from [`FRONT`] to [`FRONT_FAR`], m.
const FAR: [f64; 2] = [0.75, 0.83];

/// Distance by which the fingers enclose the lever, and distance from the lever at which they align
/// with it, m.
const DEPTH: f64 = 0.02;
const BEFORE: f64 = 0.05;

/// Position of the shoulder, and maximum distance of the grasp point from it, m. The arm reaches
/// 0.9475 m; a larger value makes it stretch fully.
const SHOULDER: [f64; 3] = [0.0, 0.0, 0.333];
const REACH: f64 = 0.97;

/// Desired yaw rate of the door at the start of the pull (rad/s), its growth with the yaw (1/s),
/// its maximum (rad/s), and final yaw (rad). The fingers hold the lever of the farthest door by a
/// few millimeters, until the hand comes closer.
const RATE: f64 = 0.54;
const GROWTH: f64 = 3.0;
const MOST: f64 = 1.1;
const OPEN: f64 = 1.047;

/// Yaw at which the robot stops, rad: 8 degrees more than strict success needs.
const OPENED: f64 = 0.92;

/// Yaw up to which the expert grasps a lever again after losing it, rad. Beyond it the closed
/// fingers pull from behind.
const RETAKE: f64 = 0.26;

/// Sum of the finger positions below which the fingers hold nothing, m. The lever is 33.5 mm high.
const EMPTY: f64 = 0.02;

/// Sum of the finger positions below which the fingers hold the lever, m.
const HELD: f64 = 0.037;

/// Distance from the goal up to which the hand is at the lever when the expert takes over, m.
const AT_LEVER: f64 = 0.02;

/// Distance from the lever's goal at which the hand begins to enter, m, and largest distance of a
/// joint from the posture there, rad.
const BEFORE_GOAL: f64 = 0.06;
const RAISED: f64 = 0.2;

/// Gains of the joint positions on the way there and of the motion towards the lever, 1/s, and
/// maximum speed of the latter, m/s.
const RAISE_RATE: f64 = 8.0;
const FORWARD_RATE: f64 = 6.0;
const FORWARD_SPEED: f64 = 0.3;

/// Distance from the goal at which the fingers close, m, and control steps after which they close
/// anyway: the arm does not reach the goal at the farthest door.
const ARRIVED: f64 = 0.012;
const ENTER_STEPS: f64 = 40.0;

/// Newton iterations of the inverse kinematics of that posture, from the rest posture.
const ITERATIONS: usize = 8;

/// Phases, stored in the first value of the memory. The second value counts the control steps of
/// the phase.
const RAISE: f64 = 0.0;
const ENTER: f64 = 1.0;
const CLOSE: f64 = 2.0;
const PULL: f64 = 3.0;
const HOLD: f64 = 4.0;

struct Pull;

impl ExpertPolicy for Pull {
    const MEMORY: usize = 2;
    const SITE: &'static str = "grasp";
    /// In front of the door with a level hand and the left finger above, far from the wrist
    /// singularity (joint 6 at π). The inverse kinematics starts here.
    const REST: [f64; 7] = [0.6, -0.2, -0.35, -1.75, -1.0, 2.7, 0.2];

    fn velocity(&self, input: &ExpertInput<'_>, arm: &mut ResolvedRate, memory: &mut [f64]) -> [f64; 7] {
        let lever = Lever::from_observation(input);
        let grasp = arm.position();
        let turn = rotation_between(&arm.rotation(), &level(lever.forward));
        let error = sub(lever.goal(), grasp);
        let posture = if memory[0] == RAISE { posture_before(arm, &lever) } else { input.q };
        arm.set(&input.q);
        let holds = input.fingers.iter().sum::<f64>() >= EMPTY;
        memory[1] += 1.0;
        let next = match memory[0] {
            RAISE if posture.iter().zip(&input.q).all(|(goal, q)| (goal - q).abs() < RAISED) => ENTER,
            ENTER if norm(error) < ARRIVED || memory[1] > ENTER_STEPS => CLOSE,
            CLOSE if memory[1] >= 12.0 => PULL,
            PULL if !holds && lever.yaw < RETAKE => RAISE,
            PULL if lever.yaw > OPENED => HOLD,
            phase => phase,
        };
        if next != memory[0] {
            memory.copy_from_slice(&[next, 0.0]);
        }
        let linear = match memory[0] {
            RAISE => return toward(&posture, &input.q, RAISE_RATE),
            ENTER => {
                // First align with the lever, then move forward.
                let ahead = dot(error, lever.forward);
                let aside = sub(error, scale(lever.forward, ahead));
                let is_aligned = norm(aside) + 0.1 * norm(turn) < 0.02;
                let forward = if is_aligned { ahead } else { ahead - BEFORE };
                let speed =
                    approach_speed(forward.abs(), FORWARD_RATE, 2.0).min(FORWARD_SPEED).copysign(forward);
                add(approach(aside, 6.0, 2.0, 0.6), scale(lever.forward, speed))
            }
            CLOSE => approach(error, 6.0, 2.0, 0.4),
            HOLD => return [0.0; 7],
            _ => {
                let part = (memory[1] / 20.0).min((OPEN - lever.yaw) / 0.15).clamp(0.0, 1.0);
                let rate = part * (RATE + GROWTH * lever.yaw).min(MOST);
                let along = [-rate * lever.arm[1], rate * lever.arm[0], 0.0];
                add(along, clamp_norm(scale(error, 5.0), 0.3))
            }
        };
        let angular = approach(turn, 6.0, 5.0, 2.5);
        match memory[0] {
            ENTER | CLOSE => arm.twist_alone(&input.q, linear, angular),
            _ => arm.twist(&input.q, linear, angular),
        }
    }

    fn begin(&self, input: &ExpertInput<'_>, arm: &mut ResolvedRate, memory: &mut [f64]) {
        let lever = Lever::from_observation(input);
        let error = sub(lever.goal(), arm.position());
        let ahead = dot(error, lever.forward);
        let aside = norm(sub(error, scale(lever.forward, ahead)));
        let turn = norm(rotation_between(&arm.rotation(), &level(lever.forward)));
        let opening = input.fingers.iter().sum::<f64>();
        let is_there = aside < AT_LEVER && ahead.abs() < AT_LEVER;
        let is_at_rest = Self::REST.iter().zip(&input.q).all(|(rest, q)| (rest - q).abs() < 0.3);
        // In front of the lever, so that the way to the point before it is free.
        let is_before = ahead > 0.0 && ahead < 3.0 * BEFORE && aside < 0.5 * ahead + AT_LEVER && turn < 0.6;
        memory[0] = match () {
            () if lever.yaw > OPENED => HOLD,
            () if is_there && (EMPTY..HELD).contains(&opening) => PULL,
            () if lever.yaw >= RETAKE && opening < EMPTY => PULL,
            () if is_there => CLOSE,
            () if is_at_rest || is_before => ENTER,
            () => RAISE,
        };
        // Fingers that hold the lever pull at full speed.
        memory[1] = if memory[0] == PULL { 20.0 } else { 0.0 };
    }

    fn fingers(&self, _input: &ExpertInput<'_>, memory: &[f64]) -> [f64; JOINTS - ARM_JOINTS] {
        if memory[0] == RAISE || memory[0] == ENTER { [1.0; 2] } else { [-1.0; 2] }
    }
}

/// Pose of the lever and direction of the grasp.
struct Lever {
    yaw: f64,
    /// Horizontal vector from the hinge to the grasp point, m.
    arm: [f64; 2],
    /// Grasp point, m.
    front: [f64; 3],
    /// Direction of the hand.
    forward: [f64; 3],
}

impl Lever {
    /// Computes the lever from the observed pose of the handle.
    fn from_observation(input: &ExpertInput<'_>) -> Lever {
        let handle = input.point(0);
        let [w, z] = [3, 6].map(|i| f64::from(input.task[i]));
        let yaw = 2.0 * z.atan2(w);
        let (sin, cos) = yaw.sin_cos();
        let turned = |[x, y]: [f64; 2]| [cos * x - sin * y, sin * x + cos * y];
        let from_hinge = [HANDLE[0] - HINGE[0], HANDLE[1] - HINGE[1]];
        let to_handle = turned(from_hinge);
        let closed = [0, 1].map(|i| handle[i] - to_handle[i] + from_hinge[i]);
        let far = ((closed[0].hypot(closed[1]) - FAR[0]) / (FAR[1] - FAR[0])).clamp(0.0, 1.0);
        let [x, y, up] = add(scale(FRONT, 1.0 - far), scale(FRONT_FAR, far));
        let to_front = turned([x, y]);
        let front = [handle[0] + to_front[0], handle[1] + to_front[1], handle[2] + up];
        // The reach is largest when the hand points straight away from the base.
        let away = front[1].atan2(front[0]);
        let (sin, cos) = (far * away * (1.0 - 2.0 * yaw).clamp(0.0, 1.0) - 0.35 * yaw).sin_cos();
        let arm = [to_handle[0] + to_front[0], to_handle[1] + to_front[1]];
        Lever { yaw, arm, front, forward: [cos, sin, 0.0] }
    }

    /// Returns the goal of the grasp point: beyond the lever's front as far as the arm reaches.
    fn goal(&self) -> [f64; 3] {
        let (sin, cos) = self.yaw.sin_cos();
        let inwards = [cos, sin, 0.0];
        let from_shoulder = sub(self.front, SHOULDER);
        let along = dot(from_shoulder, inwards);
        let beyond = along * along + REACH * REACH - dot(from_shoulder, from_shoulder);
        let depth = (beyond.max(0.0).sqrt() - along).min(DEPTH);
        add(self.front, scale(inwards, depth))
    }
}

/// Returns the posture in front of the lever from which the hand enters, rad.
fn posture_before(arm: &mut ResolvedRate, lever: &Lever) -> [f64; ARM_JOINTS] {
    let before = sub(lever.goal(), scale(lever.forward, BEFORE_GOAL));
    let mut q = Pull::REST;
    for _ in 0..ITERATIONS {
        arm.set(&q);
        let turn = rotation_between(&arm.rotation(), &level(lever.forward));
        let step = arm.twist(&q, sub(before, arm.position()), turn);
        q = std::array::from_fn(|i| q[i] + step[i]);
    }
    q
}

/// Returns the rotation matrix (row-major) of a hand that points in a horizontal direction and
/// opens vertically.
fn level(forward: [f64; 3]) -> [f64; 9] {
    let up = [0.0, 0.0, 1.0];
    let x = cross(up, forward);
    [x[0], up[0], forward[0], x[1], up[1], forward[1], x[2], up[2], forward[2]]
}

pub(super) fn expert() -> Result<Arc<dyn Controller>, WorldError> {
    Expert::controller(Pull, const { &super::DEFINITION })
}
