//! The axes of a task besides its initial box: model constants, events, and disturbances of observations and actions.

use std::ops::Range;

use mishandle_rollout::{
    Axis, AxisKind, AxisValues, Distribution, Disturbance, Effect, RolloutError, Space, TimeProfile,
};
use mishandle_world::{Body, Change, Mocap, Model, WorldError};

use crate::definition::{Definition, Preset};
use crate::robot::{ARM_JOINTS, CONTROL_DT, EPISODE_STEPS, JOINT_NAMES, Panda};

/// Length of a segment of a piecewise-constant disturbance, control steps: 1 s.
const SEGMENT: usize = 60;

/// Control steps of the knots of a piecewise-linear drift of an observation.
const DRIFT_KNOTS: [usize; 3] = [0, 150, 300];

/// Maximum delay, control steps: 50 ms.
const MAX_DELAY: f64 = 3.0;

/// Maximum bias or drift of an observed position, m.
const MAX_BIAS: f64 = 0.02;

/// Maximum disturbance of an action, which has the range \[-1, 1\].
const MAX_DISTURBANCE: f64 = 0.5;

/// Bound of explicit standard normal draws. The probability of a larger draw is 1 in 16,000.
const MAX_DRAW: f64 = 4.0;

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
    /// Random offset of the initial position of an arm joint, in units of the maximum.
    StartDraw(usize),
}

/// Constant of the model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Constant {
    /// Factor of the sliding friction of all contacts.
    Friction,
    /// Factor of the mass of an entry of [`Variations::masses`](crate::Variations::masses).
    Mass(usize),
    /// Factor of the stiffness and damping of the arm servos.
    Gain,
    /// Additional damping of the arm joints, N m s/rad.
    Damping,
}

/// Returns the axes of the environment and their parameters, axes of the initial box first.
pub(crate) fn parameters(
    definition: &Definition,
    preset: Preset,
) -> Result<Vec<(Axis, Parameter)>, RolloutError> {
    let starts = definition.starts(preset)?;
    let mut parameters: Vec<(Axis, Parameter)> =
        starts.axes().iter().cloned().zip((0..).map(Parameter::Start)).collect();
    parameters.extend(constants(definition));
    parameters.extend(events(definition));
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
    Ok(parameters)
}

fn constants(definition: &Definition) -> Vec<(Axis, Parameter)> {
    let scale = |name: &str, [low, high]: [f64; 2], meaning: &str| {
        let axis = Axis::new(AxisKind::Model, name, "", [low, high], Some(1.0));
        axis.with_values(AxisValues::Logarithmic).meaning(meaning)
    };
    let mut axes = Vec::new();
    if definition.variations.friction {
        let meaning = "factor of the sliding friction of all contacts";
        axes.push((scale("friction_scale", [0.5, 2.0], meaning), Constant::Friction));
    }
    for (index, body) in definition.variations.masses.iter().enumerate() {
        let meaning = format!("factor of the mass and inertia of the {body}");
        axes.push((scale(&format!("{body}_mass_scale"), [0.5, 2.0], &meaning), Constant::Mass(index)));
    }
    let gain = "factor of the stiffness and damping of the arm servos; their velocity limits do not change";
    axes.push((scale("servo_gain_scale", [0.8, 1.25], gain), Constant::Gain));
    let damping = Axis::new(AxisKind::Model, "joint_damping", "N m s/rad", [0.0, 10.0], Some(0.0))
        .meaning("additional viscous damping of each arm joint");
    axes.push((damping, Constant::Damping));
    axes.into_iter().map(|(axis, constant)| (axis, Parameter::Constant(constant))).collect()
}

/// Components of a push and of a jump.
const PUSH: [&str; 5] = ["push_time", "push_duration", "push_force_x", "push_force_y", "push_force_z"];
const JUMP: [&str; 4] = ["jump_time", "jump_x", "jump_y", "jump_z"];

const XYZ: [&str; 3] = ["x", "y", "z"];

fn events(definition: &Definition) -> Vec<(Axis, Parameter)> {
    let event = |name: &str, unit: &str, bounds, nominal: f64, meaning: &str| {
        Axis::new(AxisKind::Event, name, unit, bounds, Some(nominal)).meaning(meaning)
    };
    let mut axes = Vec::new();
    if let Some((body, force)) = definition.variations.push {
        let parts = PUSH.iter().enumerate().map(|(index, name)| {
            let axis = match index {
                0 => event(name, "s", [0.0, 4.0], 0.0, &format!("start time of the push on the {body}")),
                1 => event(name, "s", [0.01, 0.2], 0.1, &format!("duration of the push on the {body}")),
                _ => {
                    let meaning = format!("force on the {body} along the world's {} axis", XYZ[index - 2]);
                    event(name, "N", [-force, force], 0.0, &meaning)
                }
            };
            (axis, Parameter::Push(index))
        });
        axes.extend(parts);
    }
    if let Some(body) = definition.variations.jump {
        let parts = JUMP.iter().enumerate().map(|(index, name)| {
            let axis = match index {
                0 => event(name, "s", [0.0, 4.0], 0.0, &format!("time of the jump of the {body}")),
                _ => {
                    let meaning = format!("jump of the {body} along the world's {} axis", XYZ[index - 1]);
                    event(name, "m", [-0.1, 0.1], 0.0, &meaning)
                }
            };
            (axis, Parameter::Jump(index))
        });
        axes.extend(parts);
    }
    axes
}

/// Returns the disturbances of observations and actions. Explicit draws of the action noise exist only if there is noise.
pub(crate) fn disturbances(definition: &Definition, action_noise: bool) -> Vec<Disturbance> {
    let mut all = delays();
    for (name, unit, entry) in positions(definition) {
        all.push(Disturbance {
            axis: offset(AxisKind::Model, &format!("bias_{name}"), unit, MAX_BIAS)
                .meaning(&format!("constant bias of the observed {name}")),
            effect: Effect::Observation { entry, profile: TimeProfile::Constant(0..EPISODE_STEPS) },
        });
    }
    for (name, unit, entry) in positions(definition) {
        for (knot, at) in DRIFT_KNOTS.into_iter().enumerate() {
            let before = DRIFT_KNOTS[knot.saturating_sub(1)];
            let after = DRIFT_KNOTS[(knot + 1).min(DRIFT_KNOTS.len() - 1)];
            all.push(Disturbance {
                axis: offset(AxisKind::Input, &format!("drift_{name}_{}", knot + 1), unit, MAX_BIAS).meaning(
                    &format!("bias of the observed {name} at control step {at}, linear between the knots"),
                ),
                effect: Effect::Observation { entry, profile: TimeProfile::Linear { before, at, after } },
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
    all
}

fn delays() -> Vec<Disturbance> {
    [
        ("action_delay", "delay between controller and robot", Effect::ActionDelay),
        ("observation_delay", "delay between sensors and controller", Effect::ObservationDelay),
    ]
    .map(|(name, meaning, effect)| {
        let axis = Axis::new(AxisKind::Model, name, "control steps", [0.0, MAX_DELAY], Some(0.0));
        Disturbance { axis: axis.with_values(AxisValues::Integer).meaning(meaning), effect }
    })
    .to_vec()
}

/// Makes an axis with bounds symmetric about 0.
fn offset(kind: AxisKind, name: &str, unit: &str, bound: f64) -> Axis {
    Axis::new(kind, name, unit, [-bound, bound], Some(0.0))
}

/// Formats a range of control steps, including the last one.
fn first_to_last(steps: &Range<usize>) -> String {
    format!("{} to {}", steps.start, steps.end - 1)
}

/// Returns the joint, the number from 1, and the control steps of each segment of the piecewise-constant disturbances.
fn segments() -> impl Iterator<Item = (usize, usize, Range<usize>)> {
    let joints = 0..ARM_JOINTS;
    joints.flat_map(|joint| {
        (0..EPISODE_STEPS / SEGMENT).map(move |i| (joint, i + 1, i * SEGMENT..(i + 1) * SEGMENT))
    })
}

/// Returns the components of the observed positions: name with coordinate, unit, and index in the observation.
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

/// Returns the named spaces of a task, `starts` first, without empty ones.
pub(crate) fn spaces(
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
    [
        ("starts", of_scene(|parameter| matches!(parameter, Parameter::Start(_)))),
        ("dynamics", of_scene(|parameter| matches!(parameter, Parameter::Constant(_)))),
        ("delay", of_loop(|d| matches!(d.effect, Effect::ActionDelay | Effect::ObservationDelay))),
        (
            "sensing",
            of_loop(|d| d.axis.kind == AxisKind::Model && matches!(d.effect, Effect::Observation { .. })),
        ),
        (
            "drift",
            of_loop(|d| d.axis.kind == AxisKind::Input && matches!(d.effect, Effect::Observation { .. })),
        ),
        ("events", of_scene(|parameter| matches!(parameter, Parameter::Push(_) | Parameter::Jump(_)))),
        ("disturbance", of_loop(|d| matches!(d.effect, Effect::Action { .. }))),
        ("noise", [start_draws, action_draws].concat()),
    ]
    .into_iter()
    .filter(|(_, axes)| !axes.is_empty())
    .map(|(name, axes)| Space::new(name, axes))
    .collect()
}

/// Elements of the model that axes modify.
#[derive(Clone, Debug)]
pub(crate) struct Elements {
    masses: Vec<Vec<Body>>,
    arm: Panda,
    actuators: Vec<mishandle_world::Actuator>,
    pub push: Vec<Body>,
    pub jump: Option<Mocap>,
}

impl Elements {
    pub(crate) fn new(definition: &Definition, model: &Model, panda: Panda) -> Result<Elements, WorldError> {
        let variations = &definition.variations;
        Ok(Elements {
            masses: variations.masses.iter().map(|name| bodies(model, name)).collect::<Result<_, _>>()?,
            arm: panda,
            actuators: JOINT_NAMES[..ARM_JOINTS]
                .iter()
                .map(|name| model.actuator(name))
                .collect::<Result<_, _>>()?,
            push: variations.push.map_or(Ok(Vec::new()), |(name, _)| bodies(model, name))?,
            jump: variations.jump.map(|name| model.mocap(name)).transpose()?,
        })
    }

    /// Returns the change of the model for a value of a constant.
    pub(crate) fn change(&self, constant: Constant, value: f64) -> Change {
        match constant {
            Constant::Friction => Change::Friction(value),
            Constant::Mass(index) => Change::Mass(self.masses[index].clone(), value),
            Constant::Gain => Change::Gain(self.actuators.clone(), value),
            Constant::Damping => Change::Damping(self.arm.joints()[..ARM_JOINTS].to_vec(), value),
        }
    }
}

/// Returns the body with this name, or the bodies of the vertices of the flex with this name.
fn bodies(model: &Model, name: &str) -> Result<Vec<Body>, WorldError> {
    match model.flex(name) {
        Ok(flex) => Ok(flex.bodies().collect()),
        Err(_) => model.body(name).map(|body| vec![body]),
    }
}

/// A constant force during an interval of time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Push {
    start: f64,
    end: f64,
    force: [f64; 3],
}

impl Push {
    /// Makes a push from its components in the order of [`PUSH`]; `None` if the force is 0.
    pub(crate) fn new(components: &[f64]) -> Option<Push> {
        let [start, duration, x, y, z] = *components else { return None };
        let force = [x, y, z];
        (force != [0.0; 3]).then_some(Push { start, end: start + duration, force })
    }

    /// Returns the mean force over the physics step from `time` to `time + step`, s. The push may cover a part of the
    /// step.
    pub(crate) fn force(&self, time: f64, step: f64) -> [f64; 3] {
        let covered = ((time + step).min(self.end) - time.max(self.start)).max(0.0);
        mishandle_world::frame::scale(self.force, covered / step)
    }
}

/// Returns the displacement of the mocap body in control step `step`; `None` if it does not jump in this step.
///
/// `components` has the order of [`JUMP`].
pub(crate) fn jump(components: &[f64], step: usize) -> Option<[f64; 3]> {
    let offset = [components[1], components[2], components[3]];
    let is_due = (components[0] / CONTROL_DT).floor() as usize == step;
    (is_due && offset != [0.0; 3]).then_some(offset)
}

/// Number of components of a push and of a jump.
pub(crate) const PUSH_SIZE: usize = PUSH.len();
pub(crate) const JUMP_SIZE: usize = JUMP.len();

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_impulse_of_a_push_does_not_depend_on_the_physics_steps() {
        for (start, duration) in [(0.0, 0.1), (0.0123, 0.0507), (0.9999, 0.0101)] {
            let push = Push::new(&[start, duration, 2.0, 0.0, -1.0]).expect("the force is not 0");
            let step = 1.0 / 480.0;
            let impulse: f64 = (0..600).map(|i| push.force(f64::from(i) * step, step)[0] * step).sum();
            assert!((impulse - 2.0 * duration).abs() < 1e-12, "{impulse}");
        }
        assert!(Push::new(&[1.0, 0.1, 0.0, 0.0, 0.0]).is_none());
    }

    #[test]
    fn a_jump_happens_once_in_the_control_step_of_its_time() {
        let components = [1.01, 0.1, 0.0, 0.0];
        let steps: Vec<usize> = (0..300).filter(|step| jump(&components, *step).is_some()).collect();
        assert_eq!(steps, [60], "1.01 s is in control step 60, counted from 0");
        assert_eq!(jump(&[1.0, 0.0, 0.0, 0.0], 60), None);
    }
}
