//! Expert of point reaching: moves the fingers straight to the target with a speed proportional to
//! the distance.

use std::sync::Arc;

use mishandle_rollout::Controller;
use mishandle_world::WorldError;
use mishandle_world::frame::scale;

use crate::expert::{Expert, ExpertInput, ExpertPolicy, approach};
use crate::kinematic::ResolvedRate;

/// Gain of the position error, 1/s, deceleration, m/s², and maximum speed, m/s.
const RATE: f64 = 5.0;
const DECELERATION: f64 = 3.0;
const SPEED: f64 = 1.5;

struct Reach;

impl ExpertPolicy for Reach {
    const SITE: &'static str = "fingers";
    const REST: [f64; 7] = [0.0, -0.4, 0.0, -2.2, 0.0, 2.2, 0.785];

    fn velocity(&self, input: &ExpertInput<'_>, arm: &mut ResolvedRate, _memory: &mut [f64]) -> [f64; 7] {
        let finger_from_target = input.point(6);
        arm.linear(&input.q, approach(scale(finger_from_target, -1.0), RATE, DECELERATION, SPEED))
    }
}

pub(super) fn expert() -> Result<Arc<dyn Controller>, WorldError> {
    Expert::controller(Reach, const { &super::DEFINITION })
}
