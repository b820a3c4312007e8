//! Tilts the tray against the ball's offset and velocity: a state feedback on a ball that rolls without slipping.

use std::sync::Arc;

use mishandle_rollout::Controller;
use mishandle_world::WorldError;
use mishandle_world::frame::{scale, sub};

use crate::expert::{Expert, ExpertInput, ExpertPolicy, limited};
use crate::kinematic::{ResolvedRate, rotation_between};

/// Wanted acceleration of the ball for each metre of offset, 1/s².
const STIFFNESS: f64 = 5.0;

/// Wanted acceleration of the ball for each m/s, 1/s.
const DAMPING: f64 = 4.0;

/// Acceleration of a rolling ball for each radian of tilt, m/s²: 5/7 of gravity.
const ROLL: f64 = 9.81 * 5.0 / 7.0;

/// Largest tilt, rad.
const TILT: f64 = 0.25;

/// How fast the hand follows its wanted pose, 1/s.
const RATE: f64 = 8.0;

/// Where the hand stays, m, and how it stands while the tray is level (its own axes as columns, row by row).
struct Balance {
    position: [f64; 3],
    rotation: [f64; 9],
}

impl ExpertPolicy for Balance {
    const SITE: &'static str = "grasp";
    const REST: [f64; 7] = [0.0, -0.872, 0.0, -2.0, 0.0, 2.618, 0.785];

    fn velocity(&self, seen: &ExpertInput<'_>, arm: &mut ResolvedRate, _memory: &mut [f64]) -> [f64; 7] {
        let (offset, velocity) = (scale(seen.point(3), -1.0), seen.point(6));
        let tilt = |axis: usize| {
            let wanted = -STIFFNESS * offset[axis] - DAMPING * velocity[axis];
            (wanted / ROLL).clamp(-TILT, TILT)
        };
        // A tilt about y by +θ lowers the side of +x and rolls the ball there; about x by -θ, to +y.
        let wanted = turned(&self.rotation, -tilt(1), tilt(0));
        let linear = limited(scale(sub(self.position, arm.position()), RATE), 0.5);
        let angular = limited(scale(rotation_between(&arm.rotation(), &wanted), RATE), 2.0);
        arm.twist(&seen.q, linear, angular)
    }
}

/// `rotation` turned by small angles about the world's x and y.
fn turned(rotation: &[f64; 9], x: f64, y: f64) -> [f64; 9] {
    let ((sx, cx), (sy, cy)) = (x.sin_cos(), y.sin_cos());
    let turn = [cy, sy * sx, sy * cx, 0.0, cx, -sx, -sy, cy * sx, cy * cx];
    std::array::from_fn(|i| (0..3).map(|k| turn[3 * (i / 3) + k] * rotation[3 * k + i % 3]).sum())
}

pub(super) fn expert() -> Result<Arc<dyn Controller>, WorldError> {
    let definition = const { &super::DEFINITION };
    let model = mishandle_world::Model::from_xml(mishandle_world::PANDA)?;
    let mut arm = mishandle_world::Arm::new(&model, &crate::robot::JOINT_NAMES[..7], Balance::SITE)?;
    arm.set(&definition.start[..7]);
    Expert::controller(Balance { position: arm.position(), rotation: arm.rotation() }, definition)
}
