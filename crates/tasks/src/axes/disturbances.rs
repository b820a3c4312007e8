//! Axes of disturbances between environment and controller: delays, errors of sensors, disturbed
//! actions and draws of noise.

use std::ops::Range;

use mishandle_rollout::{Axis, AxisKind, Distribution, Disturbance, Effect, TimeProfile, delays};

use super::XYZ;
use crate::definition::Definition;
use crate::robot::{ARM_JOINTS, EPISODE_STEPS, JOINT_NAMES, Panda};

/// Length of a segment of a piecewise-constant disturbance, control steps: 1 s.
const SEGMENT: usize = 60;

/// Control steps of the knots of a piecewise-linear drift of an observation.
const DRIFT_KNOTS: [usize; 3] = [0, 150, 300];

/// Maximum bias or drift of an observed position, m.
const MAX_BIAS: f64 = 0.02;

/// Maximum bias of an observed joint angle, rad.
const MAX_JOINT_BIAS: f64 = 0.01;

/// Maximum disturbance of an action, which has the range \[-1, 1\].
const MAX_DISTURBANCE: f64 = 0.5;

/// Bound of explicit standard normal draws. The probability of a larger draw is 1 in 16,000.
const MAX_DRAW: f64 = 4.0;

/// Returns the disturbances of observations and actions. Explicit draws of the action noise exist
/// only if there is noise.
pub(crate) fn disturbances(definition: &Definition, panda: &Panda, action_noise: bool) -> Vec<Disturbance> {
    let mut all = delays();
    all.extend(biases(definition, panda));
    all.extend(sensor_noise(definition, panda));
    for (name, unit, entry) in positions(definition) {
        for (knot, at) in DRIFT_KNOTS.into_iter().enumerate() {
            let before = DRIFT_KNOTS[knot.saturating_sub(1)];
            let after = DRIFT_KNOTS[(knot + 1).min(DRIFT_KNOTS.len() - 1)];
            all.push(Disturbance {
                axis: offset(AxisKind::Input, &format!("drift_{name}_{}", knot + 1), unit, MAX_BIAS).meaning(
                    &format!("bias of the observed {name} at control step {at}, linear between the knots"),
                ),
                effect: Effect::Observation {
                    entry,
                    factor: 1.0,
                    profile: TimeProfile::Linear { before, at, after },
                },
            });
        }
    }
    for (joint, segment, steps) in segments() {
        let name = format!("disturbance_{}_{segment}", JOINT_NAMES[joint]);
        all.push(Disturbance {
            axis: offset(AxisKind::Input, &name, "", MAX_DISTURBANCE).meaning(&format!(
                "offset of the action of {}, which has the range [-1, 1], in control steps {}",
                JOINT_NAMES[joint],
                first_to_last(&steps)
            )),
            effect: Effect::Action { entry: joint, profile: TimeProfile::Constant(steps) },
        });
    }
    all.extend(super::faults::faults(definition));
    if action_noise {
        for (joint, segment, steps) in segments() {
            let name = format!("draw_{}_{segment}", JOINT_NAMES[joint]);
            let mut axis =
                Axis::new(AxisKind::Noise, &name, "", [-MAX_DRAW, MAX_DRAW], None).meaning(&format!(
                    "mean of the action noise of {} in control steps {}, in units of its standard deviation",
                    JOINT_NAMES[joint],
                    first_to_last(&steps)
                ));
            axis.distribution = Distribution::Normal;
            all.push(Disturbance { axis, effect: Effect::ActionDraw { entry: joint, steps } });
        }
    }
    for Disturbance { axis, effect } in &mut all {
        *axis = axis.clone().acting_from(effect.first_step(), EPISODE_STEPS);
    }
    all
}

/// Returns constant biases of the observed positions and of the observed angles of the arm joints.
fn biases(definition: &Definition, panda: &Panda) -> Vec<Disturbance> {
    let of_position = |(name, unit, entry): (String, &'static str, usize)| (name, unit, entry, MAX_BIAS, 1.0);
    let joints = joint_factors(panda).into_iter().enumerate();
    let of_joint = |(joint, factor): (usize, f64)| {
        (JOINT_NAMES[joint].to_string(), "rad", joint, MAX_JOINT_BIAS, factor)
    };
    positions(definition)
        .into_iter()
        .map(of_position)
        .chain(joints.map(of_joint))
        .map(|(name, unit, entry, bound, factor)| Disturbance {
            axis: offset(AxisKind::Model, &format!("bias_{name}"), unit, bound)
                .meaning(&format!("constant bias of the observed {name}")),
            effect: Effect::Observation { entry, factor, profile: TimeProfile::Constant(0..EPISODE_STEPS) },
        })
        .collect()
}

/// Returns the white noise of each observed quantity. The fingers are not disturbed.
fn sensor_noise(definition: &Definition, panda: &Panda) -> Vec<Disturbance> {
    let mut first = 0;
    let mut all = Vec::new();
    for quantity in definition.whole_observation() {
        let of_joints = |factors: [f64; ARM_JOINTS]| (first..).zip(factors).collect::<Vec<_>>();
        let (unit, entries) = match quantity.name {
            "joint_positions" => ("rad", of_joints(joint_factors(panda))),
            "joint_velocities" => ("rad/s", of_joints([definition.velocity_scale; ARM_JOINTS])),
            _ => (quantity.unit, (first..first + quantity.size).map(|entry| (entry, 1.0)).collect()),
        };
        first += quantity.size;
        let name = quantity.name;
        let axis =
            Axis::new(AxisKind::Model, &format!("noise_{name}"), unit, [0.0, max_noise(unit)], Some(0.0))
                .meaning(&format!("standard deviation of white noise on the observed {name}"));
        all.push(Disturbance { axis, effect: Effect::ObservationNoise { entries } });
    }
    all
}

/// Returns the largest standard deviation of the noise of a quantity with this unit.
fn max_noise(unit: &str) -> f64 {
    match unit {
        "m" => 0.01,
        "rad" => 0.005,
        "rad/s" | "m/s" => 0.1,
        _ => 0.02,
    }
}

/// Returns the factor from an angle in rad to the observation of each arm joint, which maps its
/// limits to \[-1, 1\].
fn joint_factors(panda: &Panda) -> [f64; ARM_JOINTS] {
    std::array::from_fn(|i| 2.0 / (panda.joints()[i].high - panda.joints()[i].low))
}

/// Returns the names of the axes that add randomness.
pub(crate) fn random_axes(disturbances: &[Disturbance]) -> Vec<String> {
    disturbances.iter().filter(|d| d.effect.is_random()).map(|d| d.axis.name.clone()).collect()
}

/// Makes an axis with bounds symmetric about 0.
fn offset(kind: AxisKind, name: &str, unit: &str, bound: f64) -> Axis {
    Axis::new(kind, name, unit, [-bound, bound], Some(0.0))
}

/// Formats a range of control steps, including the last one.
fn first_to_last(steps: &Range<usize>) -> String {
    format!("{} to {}", steps.start, steps.end - 1)
}

/// Returns the joint, the number from 1, and the control steps of each segment of the
/// piecewise-constant disturbances.
fn segments() -> impl Iterator<Item = (usize, usize, Range<usize>)> {
    let joints = 0..ARM_JOINTS;
    joints.flat_map(|joint| {
        (0..EPISODE_STEPS / SEGMENT).map(move |i| (joint, i + 1, i * SEGMENT..(i + 1) * SEGMENT))
    })
}

/// Returns the components of the observed positions: name with coordinate, unit, and index in the
/// observation.
fn positions(definition: &Definition) -> Vec<(String, &'static str, usize)> {
    let mut positions = Vec::new();
    let mut first = 0;
    for quantity in definition.whole_observation() {
        if quantity.unit == "m" && quantity.size == 3 {
            let entries = XYZ.into_iter().zip(first..);
            positions.extend(entries.map(|(axis, entry)| (format!("{}_{axis}", quantity.name), "m", entry)));
        }
        first += quantity.size;
    }
    positions
}
