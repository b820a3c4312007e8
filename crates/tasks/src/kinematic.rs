//! Differential inverse kinematics: joint velocities for a desired motion of a site.

use mishandle_world::{Arm, Model, WorldError};

/// Joints of an arm.
const JOINTS: usize = 7;

/// Computes joint velocities for a desired twist by damped least squares, with a pull towards a
/// rest posture in the null space.
///
/// ```text
/// q̇ = Jᵀ (J Jᵀ + λ² I)⁻¹ v + (I - J⁺ J) k (q_rest - q),   λ = 0.03
/// ```
///
/// # Reference
/// Nakamura and Hanafusa, "Inverse Kinematic Solutions with Singularity Robustness for Robot
/// Manipulator Control", Journal of Dynamic Systems, Measurement, and Control 108(3), 1986.
#[derive(Debug)]
pub struct ResolvedRate {
    arm: Arm,
    rest: [f64; JOINTS],
    jacobian: [f64; 6 * JOINTS],
}

/// Damping λ of the inverse, in units of the Jacobian.
const DAMPING: f64 = 0.03;

/// Gain k of the pull towards the rest posture, 1/s.
const REST_GAIN: f64 = 1.0;

impl ResolvedRate {
    /// Makes the kinematics of `site` at the end of the chain `joints`, with the rest posture
    /// `rest` (rad).
    ///
    /// # Errors
    /// If the model has no joint or site with a given name.
    pub fn new(
        model: &Model,
        joints: &[&str; JOINTS],
        site: &str,
        rest: [f64; JOINTS],
    ) -> Result<Self, WorldError> {
        Ok(ResolvedRate { arm: Arm::new(model, joints, site)?, rest, jacobian: [0.0; 6 * JOINTS] })
    }

    /// Sets the joint positions to `q`, rad.
    pub fn set(&mut self, q: &[f64; JOINTS]) {
        self.arm.set(q);
    }

    /// Returns the position of the site at the current joint positions, m.
    pub fn position(&self) -> [f64; 3] {
        self.arm.position()
    }

    /// Returns the rotation matrix of the site at the current joint positions, row-major.
    pub fn rotation(&self) -> [f64; 9] {
        self.arm.rotation()
    }

    /// Returns joint velocities (rad/s) for a desired linear velocity (m/s). `q` must be the
    /// current joint positions.
    pub fn linear(&mut self, q: &[f64; JOINTS], velocity: [f64; 3]) -> [f64; JOINTS] {
        self.solve(q, velocity)
    }

    /// Returns joint velocities (rad/s) for a desired linear (m/s) and angular (rad/s) velocity.
    /// `q` must be the current joint positions.
    pub fn twist(&mut self, q: &[f64; JOINTS], linear: [f64; 3], angular: [f64; 3]) -> [f64; JOINTS] {
        let [a, b, c] = linear;
        let [d, e, f] = angular;
        self.solve(q, [a, b, c, d, e, f])
    }

    /// As [`twist`](Self::twist), without the pull towards the rest posture. Near the end of the
    /// reach, the damping would let the pull hold the site back.
    pub fn twist_alone(&mut self, q: &[f64; JOINTS], linear: [f64; 3], angular: [f64; 3]) -> [f64; JOINTS] {
        let rest = std::mem::replace(&mut self.rest, *q);
        let velocity = self.twist(q, linear, angular);
        self.rest = rest;
        velocity
    }

    /// Scales joint velocities (rad/s) down until the speed of the site is at most `limit`, m/s.
    pub fn limit_speed(&mut self, velocity: [f64; JOINTS], limit: f64) -> [f64; JOINTS] {
        self.arm.jacobian(&mut self.jacobian);
        let component =
            |r: usize| -> f64 { (0..JOINTS).map(|i| self.jacobian[r * JOINTS + i] * velocity[i]).sum() };
        let speed = mishandle_world::frame::norm([component(0), component(1), component(2)]);
        if speed > limit { velocity.map(|v| v * limit / speed) } else { velocity }
    }

    fn solve<const ROWS: usize>(&mut self, q: &[f64; JOINTS], desired: [f64; ROWS]) -> [f64; JOINTS] {
        self.arm.jacobian(&mut self.jacobian);
        let j = &self.jacobian;
        let rest: [f64; JOINTS] = std::array::from_fn(|i| REST_GAIN * (self.rest[i] - q[i]));
        // The motion of the site by the pull is subtracted from the desired twist, so that one
        // solve gives both parts: q̇ = pull + Jᵀ (J Jᵀ + λ² I)⁻¹ (v - J pull).
        let residual: [f64; ROWS] = std::array::from_fn(|r| {
            desired[r] - (0..JOINTS).map(|i| j[r * JOINTS + i] * rest[i]).sum::<f64>()
        });
        let gram: [[f64; ROWS]; ROWS] = std::array::from_fn(|r| {
            std::array::from_fn(|c| {
                let product: f64 = (0..JOINTS).map(|i| j[r * JOINTS + i] * j[c * JOINTS + i]).sum();
                if r == c { product + DAMPING * DAMPING } else { product }
            })
        });
        let y = solve_positive(gram, residual);
        std::array::from_fn(|i| rest[i] + (0..ROWS).map(|r| j[r * JOINTS + i] * y[r]).sum::<f64>())
    }
}

/// Solves `a x = b` for a symmetric positive definite `a` by Cholesky decomposition.
fn solve_positive<const N: usize>(mut a: [[f64; N]; N], mut b: [f64; N]) -> [f64; N] {
    for i in 0..N {
        for k in 0..=i {
            let s: f64 = (0..k).map(|m| a[i][m] * a[k][m]).sum();
            a[i][k] = if i == k { (a[i][i] - s).sqrt() } else { (a[i][k] - s) / a[k][k] };
        }
        b[i] = (b[i] - (0..i).map(|m| a[i][m] * b[m]).sum::<f64>()) / a[i][i];
    }
    for i in (0..N).rev() {
        b[i] = (b[i] - (i + 1..N).map(|m| a[m][i] * b[m]).sum::<f64>()) / a[i][i];
    }
    b
}

/// Returns the rotation vector (axis times angle, rad, world frame) from `from` to `to`, both
/// row-major rotation matrices.
///
/// # Example
/// ```
/// use mishandle_tasks::kinematic::rotation_between;
/// let level = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
/// let turned = [0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]; // 90 degrees about z
/// let [x, y, z] = rotation_between(&level, &turned);
/// assert!(x.abs() < 1e-12 && y.abs() < 1e-12 && (z - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
/// ```
pub fn rotation_between(from: &[f64; 9], to: &[f64; 9]) -> [f64; 3] {
    let entry = |r: usize, c: usize| -> f64 { (0..3).map(|k| to[3 * r + k] * from[3 * c + k]).sum() };
    let axis = [entry(2, 1) - entry(1, 2), entry(0, 2) - entry(2, 0), entry(1, 0) - entry(0, 1)];
    let sin = 0.5 * mishandle_world::frame::norm(axis);
    let cos = 0.5 * (entry(0, 0) + entry(1, 1) + entry(2, 2) - 1.0);
    // For a vanishing sine the computed axis vanishes too. The limit of angle / (2 sin) at angle 0
    // is one half.
    let factor = if sin > 1e-9 { sin.atan2(cos) / (2.0 * sin) } else { 0.5 };
    axis.map(|a| factor * a)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_linear_system_matches_a_hand_calculation() {
        // 4x + 2y = 10, 2x + 3y = 9: x = 1.5, y = 2.
        let [x, y] = solve_positive([[4.0, 2.0], [2.0, 3.0]], [10.0, 9.0]);
        assert!((x - 1.5).abs() < 1e-12 && (y - 2.0).abs() < 1e-12, "{x} {y}");
    }
}
