//! Expert of cloth placing: carries the cloth over the table, lowers it while steering its
//! centroid, and waits until the gripper opens. If the cloth comes to rest too far from the center,
//! the fingertips push it there.

use std::sync::Arc;

use mishandle_rollout::Controller;
use mishandle_world::WorldError;
use mishandle_world::frame::{norm, norm_xy, scale, sub};

use crate::definition::Definition;
use crate::expert::{Expert, ExpertInput, ExpertPolicy, approach, clamp_norm};
use crate::kinematic::{ResolvedRate, rotation_between};

/// Heights of the grasp point, m: during the approach, at the end of lowering, above the cloth on
/// the table, and during the push.
const TRAVEL_HEIGHT: f64 = 0.74;
const LOW: f64 = 0.46;
const ABOVE: f64 = 0.5;
const PUSH_HEIGHT: f64 = 0.42;

/// Horizontal distance between the centroid and the table's center at which lowering starts, m.
const NEAR: f64 = 0.1;

/// Speed of lowering, m/s. It must exceed 0.1 m/s, because the gripper releases a slower cloth
/// immediately.
const LOWER_SPEED: f64 = 0.3;

/// Finger position up to which the expert closes the fingers, so that noise does not open them, and
/// finger position beyond which the cloth is released, m.
const SHUT: f64 = 0.004;
const OPEN: f64 = 0.03;

/// Maximum durations of waiting for the cloth to come to rest, approaching, descending and pushing,
/// control steps.
const SETTLE: f64 = 15.0;
const GO_STEPS: f64 = 30.0;
const DESCEND_STEPS: f64 = 20.0;
const PUSH_STEPS: f64 = 90.0;

/// Horizontal distances between the centroid and the table's center at which a push starts and
/// ends, m. Strict success allows 0.05 m. A push that continues jams the cloth at the opposite rim,
/// and then the servos demand more torque than they may.
const TOO_FAR: f64 = 0.045;
const GOOD: f64 = 0.035;

/// Position of the grasp point at the start of a push, m: distance beyond the centroid, and maximum
/// distance from the table's center at which the rear finger is inside the rim.
const BEYOND: f64 = 0.02;
const INSIDE: f64 = 0.075;

/// Maximum distance from the base at which the hand can point straight down, m.
const UPRIGHT_REACH: f64 = 0.7;

/// Speed of the push, m/s.
const PUSH_SPEED: f64 = 0.16;

/// Phases, stored in the first value of the memory. The second value counts the control steps of
/// the phase.
const CARRY: f64 = 0.0;
const LOWER: f64 = 1.0;
const LEAVE: f64 = 2.0;
const GO_BEYOND: f64 = 3.0;
const DESCEND: f64 = 4.0;
const PUSH: f64 = 5.0;

struct Place;

impl ExpertPolicy for Place {
    const MEMORY: usize = 2;
    const SITE: &'static str = "grasp";
    const REST: [f64; 7] = [0.0, 0.1, 0.0, -1.9, 0.0, 2.0, 0.5];

    fn velocity(&self, input: &ExpertInput<'_>, arm: &mut ResolvedRate, memory: &mut [f64]) -> [f64; 7] {
        let Sheet { from_target, distance, away, above } = Sheet::from_observation(input);
        let grasp = arm.position();
        let next = match memory[0] {
            CARRY | LOWER if input.fingers[0] > OPEN => LEAVE,
            CARRY if distance < NEAR => LOWER,
            LEAVE if memory[1] > SETTLE && distance > TOO_FAR => GO_BEYOND,
            GO_BEYOND if norm(sub(above, grasp)) < 0.04 || memory[1] > GO_STEPS => DESCEND,
            DESCEND if grasp[2] < PUSH_HEIGHT + 0.005 || memory[1] > DESCEND_STEPS => PUSH,
            PUSH if distance < GOOD || memory[1] > PUSH_STEPS => LEAVE,
            phase => phase,
        };
        memory[1] = if next == memory[0] { memory[1] + 1.0 } else { 0.0 };
        memory[0] = next;
        let [x, y, _] = clamp_norm([-3.0 * from_target[0], -3.0 * from_target[1], 0.0], 0.5);
        let rise = |height: f64, gain: f64, limit: f64| (gain * (height - grasp[2])).clamp(-limit, limit);
        let linear = match next {
            CARRY => [x, y, rise(TRAVEL_HEIGHT, 4.0, 0.3)],
            LOWER => [x, y, rise(LOW, 8.0, LOWER_SPEED)],
            GO_BEYOND => approach(sub(above, grasp), 5.0, 2.0, 0.6),
            DESCEND => [0.0, 0.0, rise(PUSH_HEIGHT, 5.0, 0.3)],
            LEAVE if grasp[2] > ABOVE - 0.01 => return [0.0; 7],
            PUSH => [-PUSH_SPEED * away[0], -PUSH_SPEED * away[1], rise(PUSH_HEIGHT, 5.0, 0.1)],
            _ => [0.0, 0.0, rise(ABOVE, 4.0, 0.3)],
        };
        let pushes = next >= GO_BEYOND && norm_xy(grasp) < UPRIGHT_REACH;
        if !pushes {
            return arm.linear(&input.q, linear);
        }
        let angular = rotation_between(&arm.rotation(), &across(away, &arm.rotation()));
        arm.twist(&input.q, linear, approach(angular, 4.0, 5.0, 2.0))
    }

    fn begin(&self, input: &ExpertInput<'_>, arm: &mut ResolvedRate, memory: &mut [f64]) {
        let Sheet { distance, above, .. } = Sheet::from_observation(input);
        let grasp = arm.position();
        let is_open = input.fingers[0] > OPEN;
        memory[0] = if !is_open && distance < NEAR {
            LOWER
        } else if !is_open {
            CARRY
        } else if distance <= GOOD {
            LEAVE
        } else if grasp[2] < PUSH_HEIGHT + 0.01 {
            PUSH
        } else if norm_xy(sub(above, grasp)) < 0.04 {
            DESCEND
        } else if distance > TOO_FAR && grasp[2] > ABOVE - 0.02 {
            GO_BEYOND
        } else {
            LEAVE
        };
        memory[1] = 0.0;
    }

    fn fingers(&self, input: &ExpertInput<'_>, memory: &[f64]) -> [f64; 2] {
        let carries = memory[0] < LEAVE && input.fingers.iter().all(|opening| *opening < SHUT);
        [if carries { -1.0 } else { 1.0 }; 2]
    }
}

/// The cloth relative to the table's center, from the observation.
struct Sheet {
    /// Vector from the center to the cloth's centroid, m, its horizontal length and direction.
    from_target: [f64; 3],
    distance: f64,
    away: [f64; 3],
    /// Point from which the hand descends to push the cloth, m.
    above: [f64; 3],
}

impl Sheet {
    fn from_observation(input: &ExpertInput<'_>) -> Sheet {
        let from_target = input.point(3);
        let target = input.point(6);
        let distance = norm_xy(from_target);
        let away = scale([from_target[0], from_target[1], 0.0], 1.0 / distance.max(1e-3));
        let beyond = (distance + BEYOND).min(INSIDE);
        let above = [target[0] + beyond * away[0], target[1] + beyond * away[1], ABOVE];
        Sheet { from_target, distance, away, above }
    }
}

/// Returns the rotation matrix (row-major) of a hand that points down and opens along a horizontal
/// direction, so that one finger is behind the other. Of the two such rotations it returns the
/// closer one to `rotation`.
fn across(along: [f64; 3], rotation: &[f64; 9]) -> [f64; 9] {
    let sign = (along[0] * rotation[1] + along[1] * rotation[4]).signum();
    let x = sign * along[0];
    let y = sign * along[1];
    [-y, x, 0.0, x, y, 0.0, 0.0, 0.0, -1.0]
}

pub(super) fn expert(definition: &'static Definition) -> Result<Arc<dyn Controller>, WorldError> {
    Expert::controller(Place, definition)
}
