//! Carries the cloth over the table, lowers it there while it steers the centroid, and lets the gripper open.

use std::sync::Arc;

use mishandle_controllers::kinematic::ResolvedRate;
use mishandle_rollout::Controller;
use mishandle_world::WorldError;
use mishandle_world::frame::norm_xy;

use crate::definition::Definition;
use crate::expert::{Behavior, Expert, Seen, limited};

/// Height of the grasp point on the way, and where it stops lowering the cloth, m.
const TRAVEL_HEIGHT: f64 = 0.74;
const LOW: f64 = 0.49;

/// Horizontal distance of the centroid from the table's centre at which it begins to lower the cloth, m.
const NEAR: f64 = 0.1;

/// Speed of lowering and of going away, m/s. Lowering has to be faster than 0.1 m/s: a slower cloth is let go at once.
const LOWER_SPEED: f64 = 0.3;
const LEAVE_SPEED: f64 = 0.3;

/// Opening of the fingers at which the cloth has been let go, m.
const OPEN: f64 = 0.03;

/// What it does next; the value in its memory.
const CARRY: f64 = 0.0;
const LOWER: f64 = 1.0;
const LEAVE: f64 = 2.0;

struct Place;

impl Behavior for Place {
    const MEMORY: usize = 1;
    const SITE: &'static str = "grasp";
    const REST: [f64; 7] = [0.0, 0.1, 0.0, -1.9, 0.0, 2.0, 0.5];

    fn velocity(&self, seen: &Seen<'_>, arm: &mut ResolvedRate, memory: &mut [f64]) -> [f64; 7] {
        let (from_target, height) = (seen.point(3), arm.position()[2]);
        memory[0] = match memory[0] {
            _ if seen.fingers[0] > OPEN => LEAVE,
            CARRY if norm_xy(from_target) < NEAR => LOWER,
            phase => phase,
        };
        let [x, y, _] = limited([-3.0 * from_target[0], -3.0 * from_target[1], 0.0], 0.5);
        let linear = match memory[0] {
            CARRY => [x, y, (4.0 * (TRAVEL_HEIGHT - height)).clamp(-0.3, 0.3)],
            LOWER => [x, y, (8.0 * (LOW - height)).max(-LOWER_SPEED)],
            _ => [0.0, 0.0, (4.0 * (TRAVEL_HEIGHT - height)).min(LEAVE_SPEED)],
        };
        arm.linear(&seen.q, linear)
    }
}

pub(super) fn expert(definition: &'static Definition) -> Result<Arc<dyn Controller>, WorldError> {
    Expert::controller(Place, definition)
}
