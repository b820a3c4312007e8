//! Expert of cube stacking: carries the cube above the target with the fingers pointing down,
//! lowers it until the gripper opens, and retreats.

use std::sync::Arc;

use mishandle_rollout::Controller;
use mishandle_world::WorldError;
use mishandle_world::frame::{add, norm, norm_xy, scale, sub};

use crate::expert::{Expert, ExpertInput, ExpertPolicy, approach};
use crate::kinematic::{ResolvedRate, rotation_between};

/// Height above the target's center at which the cube waits before lowering, m: 4 cm above the
/// release, because noise moves the hand by more than 1 cm.
const HOVER: f64 = 0.12;

/// Additional height of the cube per meter of horizontal distance from the target.
const SLOPE: f64 = 1.0;

/// Speed of lowering, m/s: slower than a careful release.
const LOWERING: f64 = 0.08;

/// Speed of the retreat, m/s, and height of the grasp point above the ground at which it ends, m.
const LEAVING: f64 = 0.4;
const CLEAR: f64 = 0.25;

/// Finger position beyond which the cube is released, and finger position at which the finger
/// clears the cube, m.
const LET_GO: f64 = 0.027;
const OPENED: f64 = 0.037;

/// Maximum distance from the base at which the arm can set down a level cube, m, and additional
/// distance per radian of lean.
const LEVEL_REACH: f64 = 0.78;
const REACH_OF_LEAN: f64 = 0.2;

/// Gain of the position and orientation errors, 1/s, and decelerations, m/s² and rad/s².
const RATE: f64 = 6.0;
const DECELERATION: f64 = 2.0;
const TURN_DECELERATION: f64 = 5.0;

/// Horizontal distance (m) and rotation (rad) up to which a cube above the target is being lowered
/// when the expert takes over.
const ALIGNED: f64 = 0.012;
const TURNED: f64 = 0.06;

/// Phases, stored in the memory.
const TRAVEL: f64 = 0.0;
const LOWER: f64 = 1.0;
const OPEN: f64 = 2.0;
const LEAVE: f64 = 3.0;

/// Rotation matrix (row-major) of the hand while it holds the cube level in its initial
/// orientation.
struct Stack {
    rotation: [f64; 9],
}

impl ExpertPolicy for Stack {
    const MEMORY: usize = 1;
    const SITE: &'static str = "grasp";
    const REST: [f64; 7] = [0.0, 0.1, 0.0, -2.0, 0.0, 2.2, 0.785];

    fn velocity(&self, input: &ExpertInput<'_>, arm: &mut ResolvedRate, memory: &mut [f64]) -> [f64; 7] {
        let Goal { off, above, turn, narrowest } = self.goal(input, arm);
        memory[0] = match memory[0] {
            TRAVEL if norm(above) < 0.006 && norm(turn) < 0.03 => LOWER,
            TRAVEL | LOWER if narrowest > LET_GO => OPEN,
            OPEN if narrowest > OPENED => LEAVE,
            phase => phase,
        };
        let grasp = arm.position();
        let linear = match memory[0] {
            TRAVEL => approach(above, RATE, DECELERATION, 0.8),
            LOWER => add(scale(off, RATE), [0.0, 0.0, -LOWERING]),
            LEAVE if grasp[2] > CLEAR - 0.01 => return [0.0; 7],
            LEAVE => [0.0, 0.0, LEAVING.min(RATE * (CLEAR - grasp[2]))],
            _ => [0.0; 3],
        };
        let angular = approach(turn, RATE, TURN_DECELERATION, 2.0);
        arm.twist(&input.q, linear, angular)
    }

    fn begin(&self, input: &ExpertInput<'_>, arm: &mut ResolvedRate, memory: &mut [f64]) {
        let Goal { off, above, turn, narrowest } = self.goal(input, arm);
        // Below the point above the target, on the way down.
        let is_lowering = norm_xy(off) < ALIGNED && above[2] > -ALIGNED && norm(turn) < TURNED;
        memory[0] = match narrowest {
            opening if opening > OPENED => LEAVE,
            opening if opening > LET_GO => OPEN,
            _ if is_lowering => LOWER,
            _ => TRAVEL,
        };
    }
}

/// The way that is left.
struct Goal {
    /// Horizontal vector from the cube to the place where it is lowered, m.
    off: [f64; 3],
    /// Vector from the cube to the point above it from which it is lowered, m.
    above: [f64; 3],
    /// Rotation vector to the orientation in which it is lowered, rad.
    turn: [f64; 3],
    /// Position of the finger that is opened less, m.
    narrowest: f64,
}

impl Stack {
    fn goal(&self, input: &ExpertInput<'_>, arm: &ResolvedRate) -> Goal {
        let from_target = input.point(7);
        let target = sub(input.point(0), from_target);
        let along = scale([target[0], target[1], 0.0], 1.0 / norm_xy(target).max(0.01));
        let lean = ((norm_xy(target) - LEVEL_REACH) / REACH_OF_LEAN).max(0.0);
        let place = scale(along, -topple(lean));
        let off = sub(place, [from_target[0], from_target[1], 0.0]);
        let above = add(off, [0.0, 0.0, HOVER + SLOPE * (norm_xy(off) - 0.01).max(0.0) - from_target[2]]);
        let turn = rotation_between(&arm.rotation(), &self.standing(along, lean));
        Goal { off, above, turn, narrowest: input.fingers[0].min(input.fingers[1]) }
    }

    /// Returns the rotation matrix of a hand whose fingers point down, with an outward lean of the
    /// cube.
    fn standing(&self, along: [f64; 3], lean: f64) -> [f64; 9] {
        // The cube turns forward about y by 90 degrees minus the lean, and then about z towards the
        // target.
        let (sin, cos) = (std::f64::consts::FRAC_PI_2 - lean).sin_cos();
        let [c, s, _] = along;
        let turn = [c * cos, -s, c * sin, s * cos, c, s * sin, -sin, 0.0, cos];
        std::array::from_fn(|i| (0..3).map(|k| turn[3 * (i / 3) + k] * self.rotation[3 * k + i % 3]).sum())
    }
}

/// Returns how far the center of a leaning cube moves outwards while the cube topples over its
/// lower edge, m.
fn topple(lean: f64) -> f64 {
    0.5 * super::EDGE * (1.0 - lean.cos() + lean.sin())
}

pub(super) fn expert() -> Result<Arc<dyn Controller>, WorldError> {
    let definition = const { &super::DEFINITION };
    let model = mishandle_world::Model::from_xml(mishandle_world::PANDA)?;
    let mut arm = mishandle_world::Arm::new(&model, &crate::robot::JOINT_NAMES[..7], Stack::SITE)?;
    arm.set(&definition.start[..7]);
    Expert::controller(Stack { rotation: arm.rotation() }, definition)
}
