//! Terms of both rewards of door opening, in the order of the definition.

use std::f64::consts::{FRAC_PI_3, FRAC_PI_4};

use mishandle_world::Rows;
use mishandle_world::frame::{add, dot, norm, rotate, scale, sub};

use super::BoundScene;
use crate::robot::ARM_JOINTS;

/// Best grasp point of the lever in the panel's frame, m: the middle of its bar, towards the free
/// end.
const LEVER: [f64; 3] = [-0.052, 0.215, 0.81075];

/// Half the height of the lever's bar, m.
const LEVER_HALF_HEIGHT: f64 = 0.01675;

/// Distance from a finger's frame to the middle of its pad along the hand's z axis, m.
const PAD: f64 = 0.045;

/// Stroke of a finger, m.
const STROKE: f64 = 0.04;

/// Yaw beyond which a released door keeps swinging, rad. Beyond it the hand need not hold the
/// lever.
const AJAR: f64 = 15.0_f64.to_radians();

/// Yaw rate with the maximum shaped reward, rad/s.
const RATE: f64 = 0.7;

impl BoundScene {
    pub(super) fn original(&self, rows: &Rows<'_>, signals: &[f64], action: &[f64]) -> [f64; 8] {
        let yaw = signals[0].to_radians();
        let d = signals[2];
        let handle = rows.site_position(self.handle);
        let e = (FRAC_PI_3 - yaw).abs();
        let near = 1.0 / (1.0 + d * d).powi(2);
        let [hand, panel] = [self.left_finger, self.panel].map(|body| rows.quaternion(body));
        let forward = dot(rotate(hand, [0.0, 0.0, 1.0]), rotate(panel, [1.0, 0.0, 0.0]));
        let upright = dot(rotate(hand, [0.0, 1.0, 0.0]), rotate(panel, [0.0, 0.0, 1.0]));
        let [left, right] =
            [self.left_finger, self.right_finger].map(|body| rows.position(body)[2] - handle[2]);
        let around = if left > 0.0 && right < 0.0 { 0.5 } else { 0.0 };
        let gap = if around > 0.0 { 2.0 * STROKE - left.abs() - right.abs() } else { 0.0 };
        let closed = if d <= 0.03 { 2.0 * STROKE - self.opening(rows) } else { 0.0 };
        let bonus = |within: f64, value: f64| if e < within { value } else { 0.0 };
        [
            if d <= 0.02 { 4.0 * near } else { 2.0 * near },
            0.25 * (forward * forward.abs() + upright * upright.abs()),
            10.0 * around,
            70.0 * (around / (1.0 + e * e) + yaw),
            100.0 * gap,
            10.0 * closed,
            -0.01 * action.iter().map(|a| a * a).sum::<f64>(),
            bonus(0.7, 0.5) + bonus(0.5, around) + bonus(0.2, 2.0 * around),
        ]
    }

    pub(super) fn shaped(&self, rows: &Rows<'_>, signals: &[f64], action: &[f64]) -> [f64; 7] {
        let yaw = signals[0].to_radians();
        let effort = crate::reward::action_penalty(action);
        // This term is larger than the sum of the others. Otherwise the policy learns to hold the
        // lever without pulling.
        let opened = 0.8 * (yaw / FRAC_PI_4).min(1.0);
        // An open door gives the full reward for any motion, and a door that is ajar gives the full
        // reward for any motion of the hand. A reward for holding on would stop the policy at about
        // 30 degrees, at the limits of the arm joints.
        if yaw >= FRAC_PI_4 {
            return [0.15, 0.1, 0.05, 0.15, opened, 0.3, effort];
        }
        let opening = 0.15 * (signals[1] / RATE).clamp(-1.0, 1.0);
        if yaw >= AJAR {
            return [0.15, 0.1, 0.05, opening, opened, 0.0, effort];
        }
        let lever = add(rows.position(self.panel), rotate(rows.quaternion(self.panel), LEVER));
        let d = norm(sub(rows.site_position(self.panda.grasp), lever));
        let around = self.around(rows, lever[2]) * ((0.1 - d) / 0.05).clamp(0.0, 1.0);
        let slack = (self.opening(rows) - 2.0 * LEVER_HALF_HEIGHT) / (2.0 * (STROKE - LEVER_HALF_HEIGHT));
        [
            0.15 * (1.0 - (4.0 * d).tanh()),
            0.1 * around,
            0.05 * around * (1.0 - slack).clamp(0.0, 1.0),
            opening,
            opened,
            0.0,
            effort,
        ]
    }

    /// Returns the distance between the fingers, m.
    fn opening(&self, rows: &Rows<'_>) -> f64 {
        self.panda.joints()[ARM_JOINTS..].iter().map(|joint| rows.qpos[joint.qpos]).sum()
    }

    /// Returns how far one pad is above the lever and the other one below it, from 0 to 1.
    fn around(&self, rows: &Rows<'_>, height: f64) -> f64 {
        let pad = |body| {
            let along = scale(rotate(rows.quaternion(body), [0.0, 0.0, 1.0]), PAD);
            (add(rows.position(body), along)[2] - height) / LEVER_HALF_HEIGHT
        };
        let left = pad(self.left_finger);
        let right = pad(self.right_finger);
        left.max(right).clamp(0.0, 1.0) * (-left.min(right)).clamp(0.0, 1.0)
    }
}
