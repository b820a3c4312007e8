//! Expert of ball pushing: moves above the table to a point behind the ball, descends, and pushes
//! the ball towards the hole.

use std::sync::Arc;

use mishandle_rollout::Controller;
use mishandle_world::WorldError;
use mishandle_world::frame::{add, cross, norm, norm_xy, scale, sub};

use crate::expert::{Expert, ExpertInput, ExpertPolicy, approach, toward};
use crate::kinematic::{ResolvedRate, rotation_between};

/// Distance from the ball's center before the push, m.
const BEHIND: f64 = 0.071;

/// Heights of the grasp point during the approach and during the push, m.
const TRAVEL_HEIGHT: f64 = 0.56;
const PUSH_HEIGHT: f64 = 0.424;

/// Speed of the push, m/s.
const PUSH_SPEED: f64 = 0.5;

/// Forward speed of the ball at which the push ends, m/s.
const STRUCK: f64 = 0.3;

/// Forward speed below which a ball on the way is pushed again, m/s, and its distance from the hole
/// while it is on the way, m. A ball that hops off the finger loses most of its speed.
const SLOW: f64 = 0.2;
const ON_THE_WAY: f64 = 0.25;

/// Forward lean of the fingers from straight down, rad. With friction coefficients of 1 an upright
/// finger and the table jam the ball. A leaning finger touches the ball below its equator and lets
/// it roll.
const LEAN: f64 = 0.47;

/// Height of the grasp point at which the robot stops after the push, m.
const CLEAR: f64 = 0.5;

/// Distance from a point (m) and rotation (rad) up to which the hand is there when the expert takes
/// over.
const BESIDE: f64 = 0.03;
const TURNED: f64 = 0.15;

/// Position of joint 6 below which another controller has folded the hand back, rad. The shortest
/// rotation to the orientation of the push would lead to the end of the joint's range, so the arm
/// returns to the posture in which episodes start. In episodes of the expert alone, the joint stays
/// above.
const FOLDED: f64 = 0.7;

/// Gain of this return, 1/s, and the largest distance of a joint from the posture at which it ends,
/// rad.
const UNFOLD_GAIN: f64 = 5.0;
const UNFOLDED: f64 = 0.5;

/// Phases, stored in the memory.
const TRAVEL: f64 = 0.0;
const DESCEND: f64 = 1.0;
const PUSH: f64 = 2.0;
const DONE: f64 = 3.0;
const UNFOLD: f64 = 4.0;

struct Push;

impl ExpertPolicy for Push {
    const MEMORY: usize = 1;
    const SITE: &'static str = "grasp";
    const REST: [f64; 7] = [0.0, 0.1, 0.0, -2.3, 0.0, 2.4, 0.785];

    fn velocity(&self, input: &ExpertInput<'_>, arm: &mut ResolvedRate, memory: &mut [f64]) -> [f64; 7] {
        let Line { to_hole, along, behind, above, turn } = Line::from_observation(input, arm);
        let grasp = arm.position();
        let start: [f64; 7] = std::array::from_fn(|i| super::DEFINITION.start[i]);
        let away = (0..7).map(|i| (start[i] - input.q[i]).abs()).fold(0.0, f64::max);
        memory[0] = match memory[0] {
            TRAVEL if input.q[5] < FOLDED => UNFOLD,
            UNFOLD if away < UNFOLDED => TRAVEL,
            TRAVEL if norm_xy(sub(above, grasp)) < 0.02 => DESCEND,
            DESCEND if norm(sub(behind, grasp)) < 0.01 && norm(turn) < 0.05 => PUSH,
            PUSH if input.point(0)[0] > STRUCK => DONE,
            DONE if input.point(0)[0] < SLOW && norm_xy(to_hole) > ON_THE_WAY => PUSH,
            phase => phase,
        };
        let linear = match memory[0] {
            UNFOLD => return toward(&start, &input.q, UNFOLD_GAIN),
            TRAVEL => approach(sub(above, grasp), 5.0, 2.0, 0.8),
            DESCEND => approach(sub(behind, grasp), 5.0, 2.0, 0.5),
            PUSH => {
                // Moves forward and corrects the offset from the line through ball and hole.
                let error = sub(behind, grasp);
                let ahead = error[0] * along[0] + error[1] * along[1];
                add(scale(along, PUSH_SPEED), scale(sub(error, scale(along, ahead)), 8.0))
            }
            _ if grasp[2] > CLEAR => return [0.0; 7],
            _ => add(scale(along, -0.2), [0.0, 0.0, 0.2]),
        };
        let angular = approach(turn, 5.0, 5.0, 2.0);
        arm.twist(&input.q, linear, angular)
    }

    fn begin(&self, input: &ExpertInput<'_>, arm: &mut ResolvedRate, memory: &mut [f64]) {
        let Line { to_hole, along, behind, above, turn } = Line::from_observation(input, arm);
        let error = sub(behind, arm.position());
        let ahead = error[0] * along[0] + error[1] * along[1];
        let aside = norm_xy(sub(error, scale(along, ahead)));
        let is_behind = (-BEHIND..BESIDE).contains(&ahead) && aside < BESIDE && norm(turn) < TURNED;
        let is_low = error[2].abs() < BESIDE;
        let speed = input.point(0)[0];
        let is_near = norm_xy(to_hole) <= ON_THE_WAY;
        memory[0] = match speed > SLOW {
            true if speed > STRUCK || is_near => DONE,
            _ if is_behind && is_low => PUSH,
            _ if norm_xy(sub(above, arm.position())) < BESIDE => DESCEND,
            _ => TRAVEL,
        };
    }
}

/// The line from the ball to the hole, and where the hand is beside it.
struct Line {
    /// Vector from the ball to the hole, m, and its horizontal direction.
    to_hole: [f64; 3],
    along: [f64; 3],
    /// Points behind the ball at which the push and the descent begin, m.
    behind: [f64; 3],
    above: [f64; 3],
    /// Rotation vector to the orientation of the push, rad.
    turn: [f64; 3],
}

impl Line {
    fn from_observation(input: &ExpertInput<'_>, arm: &ResolvedRate) -> Line {
        let to_hole = input.point(6);
        let ball = input.point(9);
        let along = scale([to_hole[0], to_hole[1], 0.0], 1.0 / norm_xy(to_hole).max(0.01));
        let behind = sub([ball[0], ball[1], PUSH_HEIGHT], scale(along, BEHIND));
        let turn = rotation_between(&arm.rotation(), &leaning(along));
        Line { to_hole, along, behind, above: [behind[0], behind[1], TRAVEL_HEIGHT], turn }
    }
}

/// Returns the rotation matrix (row-major) of a hand that leans forward along a horizontal
/// direction and opens across it.
fn leaning(along: [f64; 3]) -> [f64; 9] {
    let (sin, cos) = LEAN.sin_cos();
    let y = [along[1], -along[0], 0.0];
    let z = [sin * along[0], sin * along[1], -cos];
    let x = cross(y, z);
    [x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2]]
}

pub(super) fn expert() -> Result<Arc<dyn Controller>, WorldError> {
    Expert::controller(Push, const { &super::DEFINITION })
}
