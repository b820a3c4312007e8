//! Terms of both rewards of peg-in-hole.

use std::f64::consts::FRAC_PI_2;

use mishandle_world::frame::norm;

use crate::definition::{Quantity, scalar};
use crate::reward::action_penalty;
use crate::robot::ARM_JOINTS;

pub(super) const ORIGINAL: &[Quantity] = &[
    scalar(
        "near",
        "",
        "3.5 (1 - tanh(5 d)), d the horizontal distance of the peg's origin from the hole's axis",
    ),
    scalar(
        "upright",
        "",
        "1.48 (1 - tanh(2 e_r)) + 1.48 (1 - tanh(2 e_p)), e_r the distance of the peg's roll from a quarter turn, e_p that of its pitch from 0 (rad): both 0 when upright",
    ),
    scalar("down", "", "2 (1 - tanh(6 h)), h the vertical distance of the peg from its inserted place"),
    scalar("effort", "", "-0.001 (1 - 1 / (1 + s)), s the sum of the arm's squared actions"),
    scalar("angle", "", "0.5 where e_r + e_p < 0.08, -1 where it is above 0.2, else 0"),
    scalar("height", "", "0.1 where h < 0.05, -1 where it is above 0.15, else 0"),
    scalar("distance", "", "0.5 where d < 0.05, -10 where it is above 0.1, else 0"),
    scalar("fast", "", "-1 where the mean velocity of the fingers is above 0.15 m/s, else 0"),
    scalar(
        "inserted",
        "",
        "100 where the peg is nearer than 0.01 m to the point 0.01 m above its inserted place (it ends just at that distance), else 0",
    ),
];

pub(super) const SHAPED: &[Quantity] = &[
    scalar(
        "near",
        "",
        "0.3 (1 - tanh(3 d)), d the horizontal distance of the peg's origin from the hole's axis",
    ),
    scalar("centred", "", "0.1 (1 - tanh(50 d))"),
    scalar("upright", "", "0.1 (1 - tanh(3 t)), t the peg's tilt"),
    scalar(
        "down",
        "",
        "0.4 (1 - tanh(5 d)) (1 - h / 0.45 m), h the height of the peg above its inserted place, between 0 and 0.45 m",
    ),
    scalar("elbow", "", "0.3 of its horizontal distance from the hole's axis over 0.4 m, at most 0.3"),
    scalar("in", "", "0.2 of the insertion depth's share of 0.05 m, between 0 and 1"),
    scalar("inserted", "", "0.3 where d <= 0.005 and the insertion depth is at least 0.045, else 0"),
    scalar("calm", "", "-0.01 times the mean of the arm's squared actions"),
];

/// Writes the terms of the original reward.
///
/// `d` is the horizontal distance of the peg from the hole's axis, m; `height` is its height above
/// the inserted position, m; `speed` is the speed of the fingers, m/s.
pub(super) fn original(
    d: f64,
    height: f64,
    quaternion: [f64; 4],
    speed: f64,
    action: &[f64],
    out: &mut [f64],
) {
    let [w, x, y, z] = quaternion;
    let roll = (2.0 * (w * x + y * z)).atan2(1.0 - 2.0 * (x * x + y * y));
    let pitch = (2.0 * (w * y - x * z)).clamp(-1.0, 1.0).asin();
    let e_roll = (roll - FRAC_PI_2).abs();
    let e_pitch = pitch.abs();
    let h = height.abs();
    let squares: f64 = action[..ARM_JOINTS].iter().map(|a| a * a).sum();
    out[0] = 3.5 * (1.0 - (5.0 * d).tanh());
    out[1] = 1.48 * (2.0 - (2.0 * e_roll).tanh() - (2.0 * e_pitch).tanh());
    out[2] = 2.0 * (1.0 - (6.0 * h).tanh());
    out[3] = -0.001 * (1.0 - 1.0 / (1.0 + squares));
    out[4] = step(e_roll + e_pitch, [0.08, 0.2], [0.5, -1.0]);
    out[5] = step(h, [0.05, 0.15], [0.1, -1.0]);
    out[6] = step(d, [0.05, 0.1], [0.5, -10.0]);
    out[7] = if speed > 0.15 { -1.0 } else { 0.0 };
    out[8] = if norm([d, 0.0, height - 0.01]) < 0.01 { 100.0 } else { 0.0 };
}

/// Returns `below` for x < `low`, `above` for x > `high`, and 0 in between.
fn step(x: f64, [low, high]: [f64; 2], [below, above]: [f64; 2]) -> f64 {
    if x < low {
        below
    } else if x > high {
        above
    } else {
        0.0
    }
}

/// Writes the terms of the shaped reward.
///
/// `height` is the height of the peg above its inserted position, m; `elbow` is the horizontal
/// distance of the elbow from the hole's axis, m.
pub(super) fn shaped(signals: &[f64], height: f64, elbow: f64, action: &[f64], out: &mut [f64]) {
    let d = signals[0];
    let depth = signals[1];
    let tilt = signals[2];
    out[0] = 0.3 * (1.0 - (3.0 * d).tanh());
    out[1] = 0.1 * (1.0 - (50.0 * d).tanh());
    out[2] = 0.1 * (1.0 - (3.0 * tilt).tanh());
    // This term is linear in the height, so that a peg high above the hole, as in the initial
    // state, has a gradient.
    out[3] = 0.4 * (1.0 - (5.0 * d).tanh()) * (1.0 - (height / 0.45).clamp(0.0, 1.0));
    // The arm reaches a near hole by folding the elbow behind it. An arm that leans forward moves
    // the peg there sooner, but then the elbow blocks the insertion.
    out[4] = 0.3 * (elbow / 0.4).min(1.0);
    out[5] = 0.2 * (depth / super::DEPTH).clamp(0.0, 1.0);
    out[6] = if d <= 0.005 && depth >= 0.045 { 0.3 } else { 0.0 };
    out[7] = action_penalty(action);
}

#[cfg(test)]
mod tests {
    use super::*;

    const UPRIGHT: [f64; 4] = [0.5, 0.5, 0.5, 0.5];

    #[track_caller]
    fn check(d: f64, height: f64, quaternion: [f64; 4], expected: [f64; 9]) {
        let mut terms = [0.0; 9];
        original(d, height, quaternion, 0.0, &[0.0; 9], &mut terms);
        for (found, expected_term) in terms.iter().zip(&expected) {
            assert!((found - expected_term).abs() < 1e-4, "{terms:?} instead of {expected:?}");
        }
    }

    #[test]
    fn original_terms_match_a_hand_calculation() {
        check(0.0, 0.0, UPRIGHT, [3.5, 2.96, 2.0, 0.0, 0.5, 0.1, 0.5, 0.0, 0.0]);
        check(0.0, 0.01, UPRIGHT, [3.5, 2.96, 1.88014, 0.0, 0.5, 0.1, 0.5, 0.0, 100.0]);
        // tanh(1) = 0.76159, tanh(1.2) = 0.83365
        check(0.2, 0.2, UPRIGHT, [0.83442, 2.96, 0.33269, 0.0, 0.5, -1.0, -10.0, 0.0, 0.0]);
    }

    #[test]
    fn a_rotation_about_the_peg_s_axis_does_not_change_the_terms() {
        // The upright orientation, then 90 degrees about the vertical: (cos 45°, 0, 0, sin 45°)
        // times its quaternion.
        let half = std::f64::consts::FRAC_1_SQRT_2;
        check(0.0, 0.0, [0.0, 0.0, half, half], [3.5, 2.96, 2.0, 0.0, 0.5, 0.1, 0.5, 0.0, 0.0]);
    }

    #[test]
    fn a_leaning_peg_has_a_lower_reward() {
        // The upright orientation, then 0.3 rad about the world's y axis, which is the peg's x
        // axis: only the roll changes.
        let (sin, cos) = 0.15_f64.sin_cos();
        let q = [0.5 * (cos - sin), 0.5 * (cos + sin), 0.5 * (cos + sin), 0.5 * (cos - sin)];
        let mut terms = [0.0; 9];
        original(0.0, 0.0, q, 0.0, &[0.0; 9], &mut terms);
        assert!((terms[1] - (2.96 - 1.48 * 0.6_f64.tanh())).abs() < 1e-4, "{terms:?}");
        assert_eq!(terms[4], -1.0);
    }
}
