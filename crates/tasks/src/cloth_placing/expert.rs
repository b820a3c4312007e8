//! Carries the cloth over the table, lowers it there while it steers the centroid, and lets the gripper open. Where
//! the cloth comes to rest too far from the centre, the finger tips push it there.

use std::sync::Arc;

use mishandle_rollout::Controller;
use mishandle_world::WorldError;
use mishandle_world::frame::{norm, norm_xy, scale, sub};

use crate::definition::Definition;
use crate::expert::{Expert, ExpertInput, ExpertPolicy, limited};
use crate::kinematic::{ResolvedRate, rotation_between};

/// Heights of the grasp point, m: on the way, where it stops lowering the cloth, above the cloth on the table, and while
/// it pushes it.
const TRAVEL_HEIGHT: f64 = 0.74;
const LOW: f64 = 0.46;
const ABOVE: f64 = 0.5;
const PUSH_HEIGHT: f64 = 0.412;

/// Horizontal distance of the centroid from the table's centre at which it begins to lower the cloth, m.
const NEAR: f64 = 0.1;

/// Speed of lowering, m/s. It has to be faster than 0.1 m/s: a slower cloth is let go at once.
const LOWER_SPEED: f64 = 0.3;

/// Openings of the fingers up to which it presses them shut, so that noise does not open them, and from which on the
/// cloth has been let go, m.
const SHUT: f64 = 0.004;
const OPEN: f64 = 0.03;

/// How long it waits for the cloth to come to rest, goes there, down, and pushes at most, control steps.
const SETTLE: f64 = 15.0;
const GO_STEPS: f64 = 30.0;
const DESCEND_STEPS: f64 = 20.0;
const PUSH_STEPS: f64 = 90.0;

/// Horizontal distances of the centroid from the table's centre between which it pushes, m.
const TOO_FAR: f64 = 0.038;
const GOOD: f64 = 0.02;

/// Where the grasp point is when it starts to push: this far beyond the centroid, and no farther from the table's centre
/// than the finger behind it may be inside the rim, m.
const BEYOND: f64 = 0.02;
const INSIDE: f64 = 0.075;

/// Distance from the base up to which the hand can point straight down, m.
const UPRIGHT_REACH: f64 = 0.7;

/// Speed of pushing, m/s.
const PUSH_SPEED: f64 = 0.16;

/// What it does next; the first value in its memory. The second counts control steps.
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

    fn velocity(&self, seen: &ExpertInput<'_>, arm: &mut ResolvedRate, memory: &mut [f64]) -> [f64; 7] {
        let (from_target, target, grasp) = (seen.point(3), seen.point(6), arm.position());
        let distance = norm_xy(from_target);
        let away = scale([from_target[0], from_target[1], 0.0], 1.0 / distance.max(1e-3));
        let beyond = (distance + BEYOND).min(INSIDE);
        let above = [target[0] + beyond * away[0], target[1] + beyond * away[1], ABOVE];
        let next = match memory[0] {
            CARRY | LOWER if seen.fingers[0] > OPEN => LEAVE,
            CARRY if distance < NEAR => LOWER,
            LEAVE if memory[1] > SETTLE && distance > TOO_FAR => GO_BEYOND,
            GO_BEYOND if norm(sub(above, grasp)) < 0.04 || memory[1] > GO_STEPS => DESCEND,
            DESCEND if grasp[2] < PUSH_HEIGHT + 0.005 || memory[1] > DESCEND_STEPS => PUSH,
            PUSH if distance < GOOD || memory[1] > PUSH_STEPS => LEAVE,
            phase => phase,
        };
        memory[1] = if next == memory[0] { memory[1] + 1.0 } else { 0.0 };
        memory[0] = next;
        let [x, y, _] = limited([-3.0 * from_target[0], -3.0 * from_target[1], 0.0], 0.5);
        let rise = |height: f64, gain: f64, limit: f64| (gain * (height - grasp[2])).clamp(-limit, limit);
        let linear = match next {
            CARRY => [x, y, rise(TRAVEL_HEIGHT, 4.0, 0.3)],
            LOWER => [x, y, rise(LOW, 8.0, LOWER_SPEED)],
            GO_BEYOND => limited(scale(sub(above, grasp), 5.0), 0.6),
            DESCEND => [0.0, 0.0, rise(PUSH_HEIGHT, 5.0, 0.3)],
            PUSH => [-PUSH_SPEED * away[0], -PUSH_SPEED * away[1], rise(PUSH_HEIGHT, 5.0, 0.1)],
            _ => [0.0, 0.0, rise(ABOVE, 4.0, 0.3)],
        };
        let pushes = next >= GO_BEYOND && norm_xy(grasp) < UPRIGHT_REACH;
        if !pushes {
            return arm.linear(&seen.q, linear);
        }
        let angular = rotation_between(&arm.rotation(), &across(away, &arm.rotation()));
        arm.twist(&seen.q, linear, limited(scale(angular, 4.0), 2.0))
    }

    fn fingers(&self, seen: &ExpertInput<'_>, memory: &[f64]) -> [f64; 2] {
        let carries = memory[0] < LEAVE && seen.fingers.iter().all(|opening| *opening < SHUT);
        [if carries { -1.0 } else { 1.0 }; 2]
    }
}

/// The hand's axes as columns, row by row: it points down and opens along a horizontal direction, so that one finger is
/// behind what the other leads. Which of them it is takes the smaller turn from `rotation`.
fn across(along: [f64; 3], rotation: &[f64; 9]) -> [f64; 9] {
    let sign = (along[0] * rotation[1] + along[1] * rotation[4]).signum();
    let (x, y) = (sign * along[0], sign * along[1]);
    [-y, x, 0.0, x, y, 0.0, 0.0, 0.0, -1.0]
}

pub(super) fn expert(definition: &'static Definition) -> Result<Arc<dyn Controller>, WorldError> {
    Expert::controller(Place, definition)
}
