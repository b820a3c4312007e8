//! The axes of a task besides its initial box: model constants, events, and disturbances of
//! observations and actions.

mod constants;
mod disturbances;
mod events;
mod faults;

use mishandle_camera::sight::{SEVERITIES, severity_space};
use mishandle_rollout::fault::Side;
use mishandle_rollout::{Axis, AxisKind, Disturbance, Effect, RolloutError, Space};

pub(crate) use constants::{Constant, Elements, size_axis};
pub(crate) use disturbances::{disturbances, random_axes};
pub(crate) use events::{JUMP_SIZE, PUSH_SIZE, Push, SLIP_SIZE, jump, slip};
pub(crate) use faults::sites;

use crate::definition::{Definition, Preset};
use crate::robot::{ARM_JOINTS, JOINT_NAMES};

const XYZ: [&str; 3] = ["x", "y", "z"];

/// Parameter of the scene that an axis sets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Parameter {
    /// Component of the initial configuration.
    Start(usize),
    /// Constant of the model.
    Constant(Constant),
    /// Component of the push.
    Push(usize),
    /// Component of the jump.
    Jump(usize),
    /// Component of the slip.
    Slip(usize),
    /// Factor of the initial velocity of the thrown object.
    ThrowSpeed,
    /// Random offset of the initial position of an arm joint, in units of the maximum.
    StartDraw(usize),
    /// Offset of the initial position of an arm joint, rad.
    StartOffset(usize),
    /// A number of what cameras see.
    Sight,
}

/// Returns the axes of the environment and their parameters, axes of the initial box first.
pub(crate) fn parameters(
    definition: &Definition,
    preset: Preset,
) -> Result<Vec<(Axis, Parameter)>, RolloutError> {
    let starts = definition.starts(preset)?;
    let mut parameters: Vec<(Axis, Parameter)> =
        starts.axes().iter().cloned().zip((0..).map(Parameter::Start)).collect();
    parameters.extend(constants::constants(definition));
    parameters.extend(events::events(definition));
    if definition.start_noise > 0.0 {
        parameters.extend((0..ARM_JOINTS).map(|joint| {
            let name = format!("start_draw_{}", JOINT_NAMES[joint]);
            let meaning = format!(
                "random offset of the initial position of {}, in units of its maximum, {} rad",
                JOINT_NAMES[joint], definition.start_noise
            );
            let axis = Axis::new(AxisKind::Noise, &name, "", [-1.0, 1.0], None).meaning(&meaning);
            (axis, Parameter::StartDraw(joint))
        }));
    }
    let start_offset = |joint: usize| (start_offset(joint, SEVERITIES), Parameter::StartOffset(joint));
    parameters.extend((0..ARM_JOINTS).map(start_offset));
    let sight = crate::sight::sight(definition);
    parameters.extend(sight.axes().map(|axis| (axis.clone(), Parameter::Sight)));
    Ok(parameters)
}

/// Offset of the initial position of each arm joint for a severity of 1, rad: the square of the
/// distance of a random posture from the usual one has the mean 0.1².
const START_OFFSET: f64 = 0.0655;

/// Returns the axis of the offset of the initial position of an arm joint.
fn start_offset(joint: usize, severity: usize) -> Axis {
    let name = JOINT_NAMES[joint];
    let most = START_OFFSET * severity as f64;
    Axis::new(AxisKind::Model, &format!("start_offset_{name}"), "rad", [-most, most], Some(0.0))
        .meaning(&format!("offset of the initial position of {name}"))
}

/// Returns whether a parameter describes an event.
fn is_event(parameter: Parameter) -> bool {
    use Parameter as P;
    matches!(parameter, P::Push(_) | P::Jump(_) | P::Slip(_) | P::ThrowSpeed)
}

/// Returns whether a disturbance changes when values arrive during an episode.
fn is_timing(disturbance: &Disturbance) -> bool {
    use Effect as E;
    matches!(disturbance.effect, E::ActionJitter | E::ObservationJitter | E::ObservationPeriod)
}

fn is_fault(disturbance: &Disturbance, side: Side) -> bool {
    matches!(&disturbance.effect, Effect::Fault { site, .. } if site.side == side)
}

/// Returns the named spaces of a task, `starts` first, without empty ones.
pub(crate) fn spaces(
    definition: &Definition,
    parameters: &[(Axis, Parameter)],
    disturbances: &[Disturbance],
) -> Result<Vec<Space>, RolloutError> {
    let of_scene = |matches: fn(Parameter) -> bool| -> Vec<Axis> {
        parameters.iter().filter(|(_, parameter)| matches(*parameter)).map(|(axis, _)| axis.clone()).collect()
    };
    let of_loop = |matches: fn(&Disturbance) -> bool| -> Vec<Axis> {
        disturbances.iter().filter(|disturbance| matches(disturbance)).map(|d| d.axis.clone()).collect()
    };
    let start_draws = of_scene(|parameter| matches!(parameter, Parameter::StartDraw(_)));
    let action_draws = of_loop(|d| d.axis.kind == AxisKind::Noise);
    let physical = [
        ("starts", of_scene(|parameter| matches!(parameter, Parameter::Start(_)))),
        ("dynamics", of_scene(|parameter| matches!(parameter, Parameter::Constant(_)))),
        ("delay", of_loop(|d| matches!(d.effect, Effect::ActionDelay | Effect::ObservationDelay))),
        ("timing", of_loop(is_timing)),
        (
            "sensing",
            of_loop(|d| {
                let is_error =
                    matches!(d.effect, Effect::Observation { .. } | Effect::ObservationNoise { .. });
                d.axis.kind == AxisKind::Model && is_error
            }),
        ),
        (
            "drift",
            of_loop(|d| d.axis.kind == AxisKind::Input && matches!(d.effect, Effect::Observation { .. })),
        ),
        ("events", of_scene(is_event)),
        ("faults-sensing", of_loop(|d| is_fault(d, Side::Sensing))),
        ("faults-actuation", of_loop(|d| is_fault(d, Side::Actuation))),
        ("disturbance", of_loop(|d| matches!(d.effect, Effect::Action { .. }))),
        ("noise", [start_draws, action_draws].concat()),
    ];
    let physical = physical.into_iter().filter(|(_, axes)| !axes.is_empty());
    let postures = (1..=SEVERITIES).map(|severity| {
        let axes = (0..ARM_JOINTS).map(|joint| start_offset(joint, severity)).collect();
        Space::new(&severity_space(POSTURE, severity), axes)
    });
    let sight = crate::sight::sight(definition).spaces()?;
    let physical = physical.map(|(name, axes)| Space::new(name, axes));
    physical.chain(postures).chain(sight.into_iter().map(Ok)).collect()
}

/// The name of the factor of the initial state of the robot.
const POSTURE: &str = "posture";
