//! Axes of faults of sensors and actuators.

use mishandle_rollout::Disturbance;
use mishandle_rollout::fault::{Channel, FaultSite, Side};

use crate::definition::{Definition, Quantity};
use crate::robot::{ARM_JOINTS, CONTROL_DT, EPISODE_STEPS, JOINT_NAMES, JOINTS, VELOCITY_LIMIT};

/// Largest speed of an object, m/s, and angular velocity, rad/s, that a sensor can measure.
const MAX_SPEED: f64 = 2.0;
const MAX_TURN: f64 = 10.0;

/// Largest coordinate that a sensor can measure, m: the robot reaches 0.85 m.
const MAX_COORDINATE: f64 = 1.0;

/// Returns the axes of a fault of the observation and of a fault of the action.
pub(super) fn faults(definition: &Definition) -> Vec<Disturbance> {
    sites(definition).into_iter().flat_map(FaultSite::disturbances).collect()
}

/// Returns the places of faults: the observation and the action.
pub(crate) fn sites(definition: &Definition) -> [FaultSite; 2] {
    [sensing(definition), actuation()]
}

fn sensing(definition: &Definition) -> FaultSite {
    let quantities = definition.whole_observation();
    let mut first = 0;
    let mut channels = Vec::new();
    let mut ranges = Vec::new();
    for quantity in &quantities {
        let entries: Vec<usize> = (first..first + quantity.size).collect();
        ranges.extend((0..quantity.size).map(|index| range(definition, quantity, index)));
        channels.push(Channel { name: quantity.name.to_string(), entries });
        first += quantity.size;
    }
    site(Side::Sensing, "sensor_fault", channels, ranges)
}

/// Returns the range that the sensor of a number can measure, in the unit of the observation.
fn range(definition: &Definition, quantity: &Quantity, index: usize) -> [f64; 2] {
    let largest = match (quantity.name, quantity.unit) {
        ("joint_velocities", _) => VELOCITY_LIMIT[index] * definition.velocity_scale,
        (_, "m") => MAX_COORDINATE,
        (_, "m/s") => MAX_SPEED,
        (_, "rad/s") => MAX_TURN,
        (_, "rad") => std::f64::consts::PI,
        _ => 1.0,
    };
    [-largest, largest]
}

fn actuation() -> FaultSite {
    let joint = |index: usize| Channel { name: JOINT_NAMES[index].to_string(), entries: vec![index] };
    let mut channels: Vec<Channel> = (0..ARM_JOINTS).map(joint).collect();
    channels.push(Channel { name: "fingers".to_string(), entries: (ARM_JOINTS..JOINTS).collect() });
    site(Side::Actuation, "actuator_fault", channels, vec![[-1.0, 1.0]; JOINTS])
}

fn site(side: Side, name: &str, channels: Vec<Channel>, ranges: Vec<[f64; 2]>) -> FaultSite {
    FaultSite {
        side,
        name: name.to_string(),
        number: 0,
        channels,
        ranges,
        has_numbers: true,
        control_dt: CONTROL_DT,
        episode_steps: EPISODE_STEPS,
    }
}
