//! Expert of ball balancing: tilts the tray by state feedback on the position and velocity of a
//! ball that rolls without slipping.

use std::sync::Arc;

use mishandle_rollout::Controller;
use mishandle_world::WorldError;
use mishandle_world::frame::{scale, sub};

use super::TOP;
use crate::expert::{Expert, ExpertInput, ExpertPolicy, approach};
use crate::kinematic::{ResolvedRate, rotation_between};

/// Desired acceleration of the ball per meter of offset, 1/s².
const STIFFNESS: f64 = 5.0;

/// Desired acceleration of the ball per m/s of velocity, 1/s.
const DAMPING: f64 = 4.0;

/// Acceleration of a rolling ball per radian of tilt, m/s²: 5/7 of gravity.
const ROLL: f64 = 9.81 * 5.0 / 7.0;

/// Maximum tilt, rad.
const TILT: f64 = 0.25;

/// Height of the ball's center above the tray below which it has landed, m. Its radius is 2 cm.
const LANDED: f64 = 0.025;

/// Gain of the hand's pose error, 1/s.
const RATE: f64 = 8.0;

/// Position of the hand, m, and its rotation matrix (row-major) while the tray is level.
struct Balance {
    position: [f64; 3],
    rotation: [f64; 9],
}

impl ExpertPolicy for Balance {
    const SITE: &'static str = "grasp";
    /// The servos need torque for the ball besides that for their motion.
    const EFFORT: [f64; 7] = [0.52; 7];
    const REST: [f64; 7] = [0.0, -0.872, 0.0, -2.0, 0.0, 2.618, 0.785];

    fn velocity(&self, input: &ExpertInput<'_>, arm: &mut ResolvedRate, _memory: &mut [f64]) -> [f64; 7] {
        let offset = scale(input.point(3), -1.0);
        let velocity = input.point(6);
        // The hand is at rest when the ball lands: its servos need their torque for the impact.
        let has_landed = offset[2] < TOP + LANDED;
        let tilt = |axis: usize| {
            if !has_landed {
                return 0.0;
            }
            let desired = -STIFFNESS * offset[axis] - DAMPING * velocity[axis];
            (desired / ROLL).clamp(-TILT, TILT)
        };
        // A tilt by +θ about y rolls the ball towards +x. A tilt by -θ about x rolls it towards +y.
        let desired = turned(&self.rotation, -tilt(1), tilt(0));
        let linear = approach(sub(self.position, arm.position()), RATE, 2.0, 0.5);
        let angular = approach(rotation_between(&arm.rotation(), &desired), RATE, 5.0, 2.0);
        arm.twist(&input.q, linear, angular)
    }
}

/// Returns `rotation` turned about the world's x and y axes.
fn turned(rotation: &[f64; 9], x: f64, y: f64) -> [f64; 9] {
    let (sx, cx) = x.sin_cos();
    let (sy, cy) = y.sin_cos();
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
