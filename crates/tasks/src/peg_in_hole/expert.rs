//! Expert of peg-in-hole: folds the arm until the peg is over the block, carries the peg upright
//! above the hole, and lowers it until the gripper releases it.

use std::sync::Arc;

use mishandle_rollout::Controller;
use mishandle_world::WorldError;
use mishandle_world::frame::{add, cross, norm, norm_xy, rotate, scale, sub};

use super::{AXIS, DEPTH, RADIUS, SHAFT};
use crate::expert::{Expert, ExpertInput, ExpertPolicy, approach, toward};
use crate::kinematic::ResolvedRate;

/// Positions of joints 2, 4 and 6 (rad) that hold the peg upright 0.15 m above the block, for two
/// distances of the hole from the base, m. The expert interpolates between them.
const FOLDED: [(f64, [f64; 3]); 2] = [(0.3, [-0.725, -2.069, 1.395]), (0.6, [0.235, -1.1, 1.387])];

/// Position of joint 7 during the approach, rad. The peg has an angle of 0.07 rad to the hand. In
/// this posture the hand leans such that the arm reaches 8 mm farther than with the joint at 0.
const WRIST: f64 = 2.4;

/// Height of the peg's tip above the hole's bottom at which lowering starts, m: 8 mm above the
/// surface.
const ABOVE: f64 = 0.058;

/// Lean of the peg at the farthest hole, rad, and distances from the base between which it
/// increases, m. An upright peg above the farthest hole is 2 mm beyond the arm's reach. This lean
/// moves the wrist 2 cm closer.
const LEAN: f64 = 0.08;
const LEAN_FROM: f64 = 0.68;
const FARTHEST: f64 = 0.728;

/// Gain of the joint and pose errors, 1/s. It is high because action noise moves the tip by
/// millimeters per step, so the tip is above the hole only briefly.
const RATE: f64 = 6.0;

/// Speeds of the approach and of lowering, m/s. Lowering is slower than a careful release.
const TRAVEL_SPEED: f64 = 0.6;
const LOWER_SPEED: f64 = 0.08;

/// Maximum horizontal offset (m) and tilt (sine) at which lowering starts: less than the clearance
/// of 4 mm, and half the tilt with which the peg fits into the hole. At twice this offset the
/// expert lifts the peg again.
const OFFSET: f64 = 0.003;
const TILT: f64 = 0.08;

/// Height to which the empty hand retreats, m, and its speed, m/s.
const LEAVE_HEIGHT: f64 = 0.6;
const LEAVE_SPEED: f64 = 0.3;

/// Horizontal distance of the tip from the hole within which the arm is folded when the expert
/// takes over, m.
const NEAR: f64 = 0.15;

/// Phases, stored in the memory.
const FOLD: f64 = 0.0;
const TRAVEL: f64 = 1.0;
const LOWER: f64 = 2.0;
const LEAVE: f64 = 3.0;

struct Insert;

impl ExpertPolicy for Insert {
    const MEMORY: usize = 1;
    const SITE: &'static str = "grasp";
    const REST: [f64; 7] = [0.0, 0.4, 0.0, -1.0, 0.0, 1.4, WRIST];

    fn velocity(&self, input: &ExpertInput<'_>, arm: &mut ResolvedRate, memory: &mut [f64]) -> [f64; 7] {
        let Peg { hole, tip, axis, upright, posture } = Peg::from_observation(input);
        let unfolded = posture.iter().zip(&input.q).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        let offset = norm_xy(tip);
        let height = tip[2];
        memory[0] = match memory[0] {
            FOLD if unfolded < 0.2 => TRAVEL,
            TRAVEL if offset < OFFSET && norm(sub(axis, upright)) < TILT && height < ABOVE + 0.01 => LOWER,
            // The gripper releases the peg well above this height.
            LOWER if height < 0.2 * DEPTH => LEAVE,
            LOWER if offset > 2.0 * OFFSET && height > DEPTH => TRAVEL,
            phase => phase,
        };
        let desired = match memory[0] {
            FOLD => return toward(&posture, &input.q, RATE),
            TRAVEL => approach(sub([0.0, 0.0, ABOVE], tip), RATE, 2.0, TRAVEL_SPEED),
            LOWER => [-RATE * tip[0], -RATE * tip[1], -LOWER_SPEED],
            _ if arm.position()[2] > LEAVE_HEIGHT - 0.01 => return [0.0; 7],
            _ => {
                let up = (RATE * (LEAVE_HEIGHT - arm.position()[2])).min(LEAVE_SPEED);
                return arm.twist(&input.q, [0.0, 0.0, up], [0.0; 3]);
            }
        };
        // The hand rotates about the peg's tip, which moves at the desired velocity.
        let turn = approach(cross(axis, upright), RATE, 5.0, 1.5);
        let from_tip = sub(arm.position(), add(hole, tip));
        arm.twist(&input.q, add(desired, cross(turn, from_tip)), turn)
    }

    fn begin(&self, input: &ExpertInput<'_>, _arm: &mut ResolvedRate, memory: &mut [f64]) {
        let Peg { tip, axis, upright, .. } = Peg::from_observation(input);
        let offset = norm_xy(tip);
        let height = tip[2];
        let tilt = norm(sub(axis, upright));
        memory[0] = match height {
            low if low < 0.2 * DEPTH && offset < RADIUS => LEAVE,
            low if low < DEPTH && offset < RADIUS => LOWER,
            low if low < ABOVE + 0.01 && offset < 2.0 * OFFSET && tilt < 2.0 * TILT => LOWER,
            above if above > DEPTH && offset < NEAR => TRAVEL,
            _ => FOLD,
        };
    }
}

/// The peg above the block, from the observation.
struct Peg {
    /// Center of the hole's floor, m.
    hole: [f64; 3],
    /// The peg's tip relative to it, m.
    tip: [f64; 3],
    /// Direction of the peg's axis, and that during lowering.
    axis: [f64; 3],
    upright: [f64; 3],
    /// Joint positions that hold the peg above the hole, rad.
    posture: [f64; 7],
}

impl Peg {
    fn from_observation(input: &ExpertInput<'_>) -> Peg {
        let peg = input.point(0);
        let peg_from_hole = input.point(7);
        let axis = rotate([3, 4, 5, 6].map(|i| f64::from(input.task[i])), AXIS);
        let tip = add(peg_from_hole, scale(axis, -SHAFT / 2.0));
        let hole = sub(peg, peg_from_hole);
        Peg { hole, tip, axis, upright: upright(hole), posture: folded(hole) }
    }
}

/// Returns the direction of the peg's axis during lowering: upright, with a lean towards the base
/// for far holes.
fn upright(hole: [f64; 3]) -> [f64; 3] {
    let distance = norm_xy(hole);
    let lean = LEAN * ((distance - LEAN_FROM) / (FARTHEST - LEAN_FROM)).clamp(0.0, 1.0);
    [-lean.sin() * hole[0] / distance, -lean.sin() * hole[1] / distance, lean.cos()]
}

/// Returns the joint positions that hold the peg above `hole`, rad.
fn folded(hole: [f64; 3]) -> [f64; 7] {
    let [(near, a), (far, b)] = FOLDED;
    let part = ((norm_xy(hole) - near) / (far - near)).clamp(0.0, 1.0);
    let [j2, j4, j6] = [0, 1, 2].map(|i| a[i] + part * (b[i] - a[i]));
    [hole[1].atan2(hole[0]), j2, 0.0, j4, 0.0, j6, WRIST]
}

pub(super) fn expert() -> Result<Arc<dyn Controller>, WorldError> {
    Expert::controller(Insert, const { &super::DEFINITION })
}
