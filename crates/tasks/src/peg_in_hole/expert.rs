//! Folds the arm until the peg is over the block, carries it upright to above the hole, and lowers it until the
//! gripper lets go.

use std::sync::Arc;

use mishandle_rollout::Controller;
use mishandle_world::WorldError;
use mishandle_world::frame::{add, cross, norm, norm_xy, rotate, scale, sub};

use super::{AXIS, DEPTH, SHAFT};
use crate::expert::{Expert, ExpertInput, ExpertPolicy, limited};
use crate::kinematic::ResolvedRate;

/// Joints 2, 4 and 6 that hold the peg upright 0.15 m above the block, at these distances of the hole from the base, m:
/// between them it interpolates.
const FOLDED: [(f64, [f64; 3]); 2] = [(0.3, [-0.725, -2.069, 1.395]), (0.6, [0.235, -1.1, 1.387])];

/// Joint 7 on the way, rad. The hand holds the peg at an angle of 0.07 rad; turned like this, an upright peg has it lean
/// so that the arm reaches 8 mm farther than with the joint at 0.
const WRIST: f64 = 2.4;

/// Height of the peg's tip above the hole's bottom from which it is lowered, m: 8 mm above the surface.
const ABOVE: f64 = 0.058;

/// Leaning of the peg at the farthest holes, rad, and the distances from the base over which it grows, m. An upright
/// peg above the farthest hole is 2 mm beyond the arm's reach; leaning by this much brings the wrist 2 cm closer.
const LEAN: f64 = 0.08;
const LEAN_FROM: f64 = 0.68;
const FARTHEST: f64 = 0.728;

/// How fast joints and pose follow what is wanted, 1/s. It is fast, as is the lowering, because noise on the actions
/// moves the tip by millimetres in every step: it is over the hole for moments.
const RATE: f64 = 12.0;

/// Speed on the way to above the hole, and when lowering, m/s.
const TRAVEL_SPEED: f64 = 0.6;
const LOWER_SPEED: f64 = 0.3;

/// Horizontal offset (m) and tilt (sine) with which the peg may be lowered: less than its play of 4 mm, and half the
/// tilt with which it fits into the hole. It is lifted again at twice that offset.
const OFFSET: f64 = 0.003;
const TILT: f64 = 0.08;

/// Height to which the empty hand rises, m, and its speed, m/s.
const LEAVE_HEIGHT: f64 = 0.6;
const LEAVE_SPEED: f64 = 0.15;

/// What it does next; the value in its memory.
const FOLD: f64 = 0.0;
const TRAVEL: f64 = 1.0;
const LOWER: f64 = 2.0;
const LEAVE: f64 = 3.0;

struct Insert;

impl ExpertPolicy for Insert {
    const MEMORY: usize = 1;
    const SITE: &'static str = "grasp";
    const REST: [f64; 7] = [0.0, 0.4, 0.0, -1.0, 0.0, 1.4, WRIST];

    fn velocity(&self, seen: &ExpertInput<'_>, arm: &mut ResolvedRate, memory: &mut [f64]) -> [f64; 7] {
        let (peg, peg_from_hole) = (seen.point(0), seen.point(7));
        let axis = rotate([3, 4, 5, 6].map(|i| f64::from(seen.task[i])), AXIS);
        let tip = add(peg_from_hole, scale(axis, -SHAFT / 2.0));
        let hole = sub(peg, peg_from_hole);
        let (posture, upright) = (folded(hole), upright(hole));
        let unfolded = posture.iter().zip(&seen.q).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        let (offset, height) = (norm_xy(tip), tip[2]);
        memory[0] = match memory[0] {
            FOLD if unfolded < 0.2 => TRAVEL,
            TRAVEL if offset < OFFSET && norm(sub(axis, upright)) < TILT && height < ABOVE + 0.01 => LOWER,
            // The gripper lets go long before the hand is as low as this.
            LOWER if height < 0.2 * DEPTH => LEAVE,
            LOWER if offset > 2.0 * OFFSET && height > DEPTH => TRAVEL,
            phase => phase,
        };
        let wanted = match memory[0] {
            FOLD => return std::array::from_fn(|i| RATE * (posture[i] - seen.q[i])),
            TRAVEL => limited(scale(sub([0.0, 0.0, ABOVE], tip), RATE), TRAVEL_SPEED),
            LOWER => [-RATE * tip[0], -RATE * tip[1], -LOWER_SPEED],
            _ => {
                let up = (RATE * (LEAVE_HEIGHT - arm.position()[2])).min(LEAVE_SPEED);
                return arm.twist(&seen.q, [0.0, 0.0, up], [0.0; 3]);
            }
        };
        // The hand turns with the peg and moves as the peg's tip has to.
        let turn = limited(scale(cross(axis, upright), RATE), 1.5);
        let from_tip = sub(arm.position(), add(hole, tip));
        arm.twist(&seen.q, add(wanted, cross(turn, from_tip)), turn)
    }
}

/// How the peg stands when it is lowered: upright, but where the arm is at its end leaning towards the base.
fn upright(hole: [f64; 3]) -> [f64; 3] {
    let distance = norm_xy(hole);
    let lean = LEAN * ((distance - LEAN_FROM) / (FARTHEST - LEAN_FROM)).clamp(0.0, 1.0);
    [-lean.sin() * hole[0] / distance, -lean.sin() * hole[1] / distance, lean.cos()]
}

/// The joints that hold the peg above a hole there.
fn folded(hole: [f64; 3]) -> [f64; 7] {
    let [(near, a), (far, b)] = FOLDED;
    let part = ((norm_xy(hole) - near) / (far - near)).clamp(0.0, 1.0);
    let [j2, j4, j6] = [0, 1, 2].map(|i| a[i] + part * (b[i] - a[i]));
    [hole[1].atan2(hole[0]), j2, 0.0, j4, 0.0, j6, WRIST]
}

pub(super) fn expert() -> Result<Arc<dyn Controller>, WorldError> {
    Expert::controller(Insert, const { &super::DEFINITION })
}
