//! The axes of a task beside its initial box: what each sets in the model, as an event, or in the loop.

use std::ops::Range;

use mishandle_rollout::{
    Axis, AxisKind, AxisValues, Distribution, Disturbance, Effect, RolloutError, Space, TimeProfile,
};
use mishandle_world::{Body, Change, Mocap, Model, WorldError};

use crate::definition::{Definition, Preset};
use crate::robot::{ARM_JOINTS, CONTROL_DT, EPISODE_STEPS, JOINT_NAMES, Panda};

/// Control steps of a segment of a piecewise-constant disturbance: one second.
const SEGMENT: usize = 60;

/// Control steps at which a linear drift of an observation has its knots.
const DRIFT_KNOTS: [usize; 3] = [0, 150, 300];

/// Largest delay, control steps: 50 ms.
const MAX_DELAY: f64 = 3.0;

/// Largest bias or drift of an observed position, m.
const MAX_BIAS: f64 = 0.02;

/// Largest disturbance of an action, of the range \[-1, 1\].
const MAX_DISTURBANCE: f64 = 0.5;

/// Explicit draws of a standard normal law stay within this: 1 in 16,000 would lie outside.
const MAX_DRAW: f64 = 4.0;

/// What an axis of the environment sets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Setting {
    /// Value `0` of the initial configuration.
    Start(usize),
    /// A constant of the model.
    Constant(Constant),
    /// A number of the push.
    Push(usize),
    /// A number of the jump.
    Jump(usize),
    /// The random offset of an arm joint's start, in units of the largest.
    StartDraw(usize),
}

/// A constant of the model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Constant {
    /// Factor of all sliding friction.
    Friction,
    /// Factor of the mass of the definition's `masses[0]`.
    Mass(usize),
    /// Factor of the arm servos' stiffness and damping.
    Gain,
    /// Damping added to the arm's joints, N m s/rad.
    Damping,
}

/// The axes of the environment and what they set, start axes first.
pub(crate) fn settings(
    definition: &Definition,
    preset: Preset,
) -> Result<Vec<(Axis, Setting)>, RolloutError> {
    let starts = definition.starts(preset)?;
    let mut settings: Vec<(Axis, Setting)> =
        starts.axes().iter().cloned().zip((0..).map(Setting::Start)).collect();
    settings.extend(constants(definition));
    settings.extend(events(definition));
    if definition.start_noise > 0.0 {
        settings.extend((0..ARM_JOINTS).map(|joint| {
            let name = format!("start_draw_{}", JOINT_NAMES[joint]);
            let meaning = format!(
                "random offset of the joint's start, in units of the largest, {} rad",
                definition.start_noise
            );
            let axis = Axis::new(AxisKind::Noise, &name, "", [-1.0, 1.0], None).meaning(&meaning);
            (axis, Setting::StartDraw(joint))
        }));
    }
    Ok(settings)
}

fn constants(definition: &Definition) -> Vec<(Axis, Setting)> {
    let scale = |name: &str, [low, high]: [f64; 2], meaning: &str| {
        let axis = Axis::new(AxisKind::Model, name, "", [low, high], Some(1.0));
        axis.with_values(AxisValues::Logarithmic).meaning(meaning)
    };
    let mut axes = Vec::new();
    if definition.variations.friction {
        let meaning = "factor of the sliding friction of every contact";
        axes.push((scale("friction_scale", [0.5, 2.0], meaning), Constant::Friction));
    }
    for (index, body) in definition.variations.masses.iter().enumerate() {
        let meaning = format!("factor of mass and inertia of the {body}");
        axes.push((scale(&format!("{body}_mass_scale"), [0.5, 2.0], &meaning), Constant::Mass(index)));
    }
    let gain = "factor of stiffness and damping of the arm's servos; their velocity limits stay";
    axes.push((scale("servo_gain_scale", [0.8, 1.25], gain), Constant::Gain));
    let damping = Axis::new(AxisKind::Model, "joint_damping", "N m s/rad", [0.0, 10.0], Some(0.0))
        .meaning("viscous damping added to each joint of the arm");
    axes.push((damping, Constant::Damping));
    axes.into_iter().map(|(axis, constant)| (axis, Setting::Constant(constant))).collect()
}

/// The parts of a push and of a jump, in the order of their numbers.
const PUSH: [&str; 5] = ["push_time", "push_duration", "push_force_x", "push_force_y", "push_force_z"];
const JUMP: [&str; 4] = ["jump_time", "jump_x", "jump_y", "jump_z"];

fn events(definition: &Definition) -> Vec<(Axis, Setting)> {
    let event = |name: &str, unit: &str, bounds, nominal: f64, meaning: &str| {
        Axis::new(AxisKind::Event, name, unit, bounds, Some(nominal)).meaning(meaning)
    };
    let mut axes = Vec::new();
    if let Some((body, force)) = definition.variations.push {
        let parts = PUSH.iter().enumerate().map(|(index, name)| {
            let axis = match index {
                0 => event(name, "s", [0.0, 4.0], 0.0, &format!("when the push on the {body} begins")),
                1 => event(name, "s", [0.01, 0.2], 0.1, "how long it lasts"),
                _ => event(name, "N", [-force, force], 0.0, &format!("force on the {body}, world axes")),
            };
            (axis, Setting::Push(index))
        });
        axes.extend(parts);
    }
    if let Some(body) = definition.variations.jump {
        let parts = JUMP.iter().enumerate().map(|(index, name)| {
            let axis = match index {
                0 => event(name, "s", [0.0, 4.0], 0.0, &format!("when the {body} jumps")),
                _ => event(name, "m", [-0.1, 0.1], 0.0, &format!("how far the {body} jumps, world axes")),
            };
            (axis, Setting::Jump(index))
        });
        axes.extend(parts);
    }
    axes
}

/// The axes that act in the loop of observation and action. Explicit draws of the action noise are there if there is noise.
pub(crate) fn disturbances(definition: &Definition, action_noise: bool) -> Vec<Disturbance> {
    let mut all = delays();
    for (name, unit, entry) in positions(definition) {
        all.push(Disturbance {
            axis: offset(AxisKind::Model, &format!("bias_{name}"), unit, MAX_BIAS)
                .meaning(&format!("constant error of the observed {name}")),
            effect: Effect::Observation { entry, profile: TimeProfile::Constant(0..EPISODE_STEPS) },
        });
    }
    for (name, unit, entry) in positions(definition) {
        for (knot, at) in DRIFT_KNOTS.into_iter().enumerate() {
            let before = DRIFT_KNOTS[knot.saturating_sub(1)];
            let after = DRIFT_KNOTS[(knot + 1).min(DRIFT_KNOTS.len() - 1)];
            all.push(Disturbance {
                axis: offset(AxisKind::Input, &format!("drift_{name}_{}", knot + 1), unit, MAX_BIAS).meaning(
                    &format!("error of the observed {name} at control step {at}, linear between the knots"),
                ),
                effect: Effect::Observation { entry, profile: TimeProfile::Linear { before, at, after } },
            });
        }
    }
    for (joint, segment, steps) in segments() {
        let name = format!("disturbance_{}_{segment}", JOINT_NAMES[joint]);
        all.push(Disturbance {
            axis: offset(AxisKind::Input, &name, "", MAX_DISTURBANCE).meaning(&format!(
                "added to the joint's action, which is in [-1, 1], in control steps {}",
                first_to_last(&steps)
            )),
            effect: Effect::Action { entry: joint, profile: TimeProfile::Constant(steps) },
        });
    }
    if action_noise {
        for (joint, segment, steps) in segments() {
            let name = format!("draw_{}_{segment}", JOINT_NAMES[joint]);
            let mut axis = Axis::new(AxisKind::Noise, &name, "", [-MAX_DRAW, MAX_DRAW], None).meaning(&format!(
                "mean of the joint's action noise in control steps {}, in units of its standard deviation",
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
        ("action_delay", "control steps until an action reaches the robot", Effect::ActionDelay),
        (
            "observation_delay",
            "control steps until an observation reaches the controller",
            Effect::ObservationDelay,
        ),
    ]
    .map(|(name, meaning, effect)| {
        let axis = Axis::new(AxisKind::Model, name, "control steps", [0.0, MAX_DELAY], Some(0.0));
        Disturbance { axis: axis.with_values(AxisValues::Integer).meaning(meaning), effect }
    })
    .to_vec()
}

/// An axis around 0.
fn offset(kind: AxisKind, name: &str, unit: &str, bound: f64) -> Axis {
    Axis::new(kind, name, unit, [-bound, bound], Some(0.0))
}

/// Control steps in words, the last one included.
fn first_to_last(steps: &Range<usize>) -> String {
    format!("{} to {}", steps.start, steps.end - 1)
}

/// Joint, number from 1 and control steps of each segment of a piecewise-constant disturbance.
fn segments() -> impl Iterator<Item = (usize, usize, Range<usize>)> {
    let joints = 0..ARM_JOINTS;
    joints.flat_map(|joint| {
        (0..EPISODE_STEPS / SEGMENT).map(move |i| (joint, i + 1, i * SEGMENT..(i + 1) * SEGMENT))
    })
}

/// The observed positions: name with its axis, unit, and place in the observation.
fn positions(definition: &Definition) -> Vec<(String, &'static str, usize)> {
    let mut positions = Vec::new();
    let mut first = 0;
    for quantity in definition.whole_observation() {
        if quantity.unit == "m" && quantity.size == 3 {
            let entries = ["x", "y", "z"].into_iter().zip(first..);
            positions.extend(entries.map(|(axis, entry)| (format!("{}_{axis}", quantity.name), "m", entry)));
        }
        first += quantity.size;
    }
    positions
}

/// The named spaces of a task, `starts` first. Spaces without axes are left out.
pub(crate) fn spaces(
    settings: &[(Axis, Setting)],
    loops: &[Disturbance],
) -> Result<Vec<Space>, RolloutError> {
    let of_environment = |wanted: fn(Setting) -> bool| -> Vec<Axis> {
        settings.iter().filter(|(_, setting)| wanted(*setting)).map(|(axis, _)| axis.clone()).collect()
    };
    let of_loop = |wanted: fn(&Disturbance) -> bool| -> Vec<Axis> {
        loops.iter().filter(|disturbance| wanted(disturbance)).map(|d| d.axis.clone()).collect()
    };
    let start_draws = of_environment(|setting| matches!(setting, Setting::StartDraw(_)));
    let action_draws = of_loop(|d| d.axis.kind == AxisKind::Noise);
    [
        ("starts", of_environment(|setting| matches!(setting, Setting::Start(_)))),
        ("dynamics", of_environment(|setting| matches!(setting, Setting::Constant(_)))),
        ("delay", of_loop(|d| matches!(d.effect, Effect::ActionDelay | Effect::ObservationDelay))),
        (
            "sensing",
            of_loop(|d| d.axis.kind == AxisKind::Model && matches!(d.effect, Effect::Observation { .. })),
        ),
        (
            "drift",
            of_loop(|d| d.axis.kind == AxisKind::Input && matches!(d.effect, Effect::Observation { .. })),
        ),
        ("events", of_environment(|setting| matches!(setting, Setting::Push(_) | Setting::Jump(_)))),
        ("disturbance", of_loop(|d| matches!(d.effect, Effect::Action { .. }))),
        ("noise", [start_draws, action_draws].concat()),
    ]
    .into_iter()
    .filter(|(_, axes)| !axes.is_empty())
    .map(|(name, axes)| Space::new(name, axes))
    .collect()
}

/// The elements of a model that axes set, found by name once.
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

    /// The change of the model that a value of a constant makes.
    pub(crate) fn change(&self, constant: Constant, value: f64) -> Change {
        match constant {
            Constant::Friction => Change::Friction(value),
            Constant::Mass(index) => Change::Mass(self.masses[index].clone(), value),
            Constant::Gain => Change::Gain(self.actuators.clone(), value),
            Constant::Damping => Change::Damping(self.arm.joints()[..ARM_JOINTS].to_vec(), value),
        }
    }
}

/// The body of that name, or the vertices of the flex of that name.
fn bodies(model: &Model, name: &str) -> Result<Vec<Body>, WorldError> {
    match model.flex(name) {
        Ok(flex) => Ok(flex.bodies().collect()),
        Err(_) => model.body(name).map(|body| vec![body]),
    }
}

/// A push as its five numbers say.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Push {
    begin: f64,
    end: f64,
    force: [f64; 3],
}

impl Push {
    /// `None` if nothing pushes.
    pub(crate) fn new(numbers: &[f64]) -> Option<Push> {
        let force = [numbers[2], numbers[3], numbers[4]];
        (force != [0.0; 3]).then(|| Push { begin: numbers[0], end: numbers[0] + numbers[1], force })
    }

    /// The mean force over a physics step that begins at `time` and lasts `step`, s: the push may cover a part of it.
    pub(crate) fn force(&self, time: f64, step: f64) -> [f64; 3] {
        let covered = ((time + step).min(self.end) - time.max(self.begin)).max(0.0);
        mishandle_world::frame::scale(self.force, covered / step)
    }
}

/// How far the mocap body jumps in control step `step`; `None` if it does not.
pub(crate) fn jump(numbers: &[f64], step: usize) -> Option<[f64; 3]> {
    let offset = [numbers[1], numbers[2], numbers[3]];
    let due = (numbers[0] / CONTROL_DT).floor() as usize == step;
    (due && offset != [0.0; 3]).then_some(offset)
}

/// Numbers of a push and of a jump.
pub(crate) const PUSH_NUMBERS: usize = PUSH.len();
pub(crate) const JUMP_NUMBERS: usize = JUMP.len();

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_push_gives_its_impulse_however_it_lies_between_the_steps() {
        for (begin, duration) in [(0.0, 0.1), (0.0123, 0.0507), (0.9999, 0.0101)] {
            let push = Push::new(&[begin, duration, 2.0, 0.0, -1.0]).expect("it pushes");
            let step = 1.0 / 480.0;
            let impulse: f64 = (0..600).map(|i| push.force(f64::from(i) * step, step)[0] * step).sum();
            assert!((impulse - 2.0 * duration).abs() < 1e-12, "{impulse}");
        }
        assert!(Push::new(&[1.0, 0.1, 0.0, 0.0, 0.0]).is_none());
    }

    #[test]
    fn a_jump_happens_once_in_the_control_step_of_its_time() {
        let numbers = [1.01, 0.1, 0.0, 0.0];
        let steps: Vec<usize> = (0..300).filter(|step| jump(&numbers, *step).is_some()).collect();
        assert_eq!(steps, [60], "1.01 s lie in control step 60, counted from 0");
        assert_eq!(jump(&[1.0, 0.0, 0.0, 0.0], 60), None);
    }
}
