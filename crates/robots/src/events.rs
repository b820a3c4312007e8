//! Events: pushes, jumps and slips, which happen at a point in time.

use crate::expression::Argument;
use mishandle_rollout::{Axis, AxisKind};
use mishandle_world::{Body, ElementKind, Joint, JointKind, Mocap, World};

use crate::axes::{Axes, Parameter};
use crate::axis_table::{self, AxisTable, EventKind, ModelOperation};
use crate::change::{ModelChange, checked_change};
use crate::description::Named;
use crate::document::Text;
use crate::error::Problem;
use crate::library::Library;

/// Number of components of an event: its time and its duration, and the force of a push or the
/// offset of a jump along the axes of the world, or the value of a slip.
pub(crate) const EVENT_SIZE: usize = 5;

/// Index of the first component after time and duration.
const MAGNITUDE: usize = 2;

/// An event of a robot.
#[derive(Clone, Debug)]
pub(crate) struct Event {
    pub effect: EventEffect,
    /// Components in an undisturbed episode.
    pub nominal: [f64; EVENT_SIZE],
}

/// Effect of an event.
#[derive(Clone, Debug)]
pub(crate) enum EventEffect {
    /// A force acts on a body.
    Push(Body),
    /// A mocap body or a free body is displaced.
    Jump(Jumping),
    /// Numbers of the model are different.
    Slip(ModelChange),
}

/// The body that a jump displaces.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Jumping {
    Mocap(Mocap),
    Free(Joint),
}

impl Jumping {
    /// Displaces it by `offset`, m. Its velocity stays.
    pub(crate) fn shift(self, world: &mut World, offset: [f64; 3]) {
        match self {
            Jumping::Mocap(mocap) => world.shift(mocap, offset),
            Jumping::Free(joint) => {
                let position = &mut world.qpos_mut()[joint.qpos..][..3];
                position.iter_mut().zip(offset).for_each(|(x, offset)| *x += offset);
            }
        }
    }
}

/// Returns the mean force of a push over the physics step from `time` to `time + step`, N. The push
/// may cover a part of the step.
pub(crate) fn force(push: &[f64; EVENT_SIZE], time: f64, step: f64) -> [f64; 3] {
    let [start, duration, x, y, z] = *push;
    let covered = ((time + step).min(start + duration) - time.max(start)).max(0.0) / step;
    [x * covered, y * covered, z * covered]
}

/// Returns the displacement of a jump in a control step; `None` if it does not happen then.
pub(crate) fn jump(jump: &[f64; EVENT_SIZE], step: f64, control_dt: f64) -> Option<[f64; 3]> {
    let [time, _, x, y, z] = *jump;
    ((time / control_dt).floor() == step && [x, y, z] != [0.0; 3]).then_some([x, y, z])
}

/// Returns the value of a slip in the physics step from `time` to `time + step`; `None` if it does
/// not last in the middle of the step. Times at the border of two steps are rounded numbers.
pub(crate) fn slip(slip: &[f64; EVENT_SIZE], time: f64, step: f64) -> Option<f64> {
    let [start, duration, value, ..] = *slip;
    let middle = time + step / 2.0;
    (middle >= start && middle < start + duration).then_some(value)
}

impl Event {
    /// Returns the body that the event pushes.
    pub(crate) fn pushed(&self) -> Option<Body> {
        match self.effect {
            EventEffect::Push(body) => Some(body),
            _ => None,
        }
    }

    /// Returns whether the event number `index` of a robot has an effect in some episode in which
    /// these parameters are set.
    pub(crate) fn can_act(&self, index: usize, parameters: &[Parameter]) -> bool {
        let mut rest = [0.0; EVENT_SIZE];
        rest[MAGNITUDE] = self.change().map_or(0.0, |change| change.nominal);
        (MAGNITUDE..EVENT_SIZE).any(|component| {
            let parameter = Parameter::Event { event: index, component };
            self.nominal[component] != rest[component] || parameters.contains(&parameter)
        })
    }

    /// Returns the change of the model that the event may make.
    pub(crate) fn change(&self) -> Option<&ModelChange> {
        match &self.effect {
            EventEffect::Slip(change) => Some(change),
            _ => None,
        }
    }
}

impl Axes {
    /// Adds an event and its axes.
    pub(crate) fn add_event(
        &mut self,
        named: &Named<AxisTable>,
        event: &axis_table::Event,
        library: &Library<'_>,
    ) -> Result<(), Problem> {
        let problem = |message: String| Problem::new(&named.key.span, message);
        if event.time[0] < 0.0 || event.duration[0] < 0.0 {
            return Err(problem("the time and the duration of an event are not negative".to_string()));
        }
        let (effect, on, magnitudes) = match &event.kind {
            EventKind::Push { body, force } => {
                let pushed = library.model.body_at(one_body(body, library, "a push acts on one")?);
                let on = format!("the push on `{}`", body.text);
                (EventEffect::Push(pushed), on.clone(), along_axes(force, "N", &format!("force of {on}")))
            }
            EventKind::Jump { body, offset } => {
                let on = format!("the jump of `{}`", body.text);
                (EventEffect::Jump(jumping(body, library)?), on.clone(), along_axes(offset, "m", &on))
            }
            EventKind::Slip { operation, fields, range, unit } => {
                let (key, nominal, what) = match operation {
                    ModelOperation::Set => ("set", None, "value of"),
                    ModelOperation::Add => ("add", Some(0.0), "offset of"),
                    ModelOperation::Scale => ("scale", Some(1.0), "factor of"),
                };
                let change = checked_change(named, *operation, fields, *range, nominal, library)?;
                let on = format!("the slip `{}`", named.key.name);
                let texts: Vec<&str> = fields.iter().map(|field| field.text.text.as_str()).collect();
                let meaning = format!("{what} {} during {on}", texts.join(", "));
                let magnitude =
                    Magnitude { key, unit: unit.clone(), range: *range, nominal: change.nominal, meaning };
                (EventEffect::Slip(change), on, vec![(MAGNITUDE, magnitude)])
            }
        };
        let mut nominal = [event.time[0], event.duration[1], 0.0, 0.0, 0.0];
        let index = self.events.len();
        let mut add = |axes: &mut Axes, component: usize, magnitude: Magnitude| {
            let Magnitude { key, unit, range: [low, high], nominal: at_rest, meaning } = magnitude;
            nominal[component] = if low == high { low } else { at_rest };
            if low == high {
                return;
            }
            let name = format!("{}_{key}", named.key.name);
            let axis = Axis::new(AxisKind::Event, &name, &unit, [low, high], Some(at_rest)).meaning(&meaning);
            axes.environment.push((axis, Parameter::Event { event: index, component }));
        };
        let timing = |key, range, nominal, meaning: &str| Magnitude {
            key,
            unit: "s".to_string(),
            range,
            nominal,
            meaning: format!("{meaning} of {on}"),
        };
        let start = if matches!(effect, EventEffect::Jump(_)) { "time" } else { "start time" };
        add(self, 0, timing("time", event.time, event.time[0], start));
        add(self, 1, timing("duration", event.duration, event.duration[1], "duration"));
        for (component, magnitude) in magnitudes {
            let [low, high] = magnitude.range;
            if !(low..=high).contains(&magnitude.nominal) {
                return Err(problem(format!(
                    "the range of `{}` of an event contains {}, that of an undisturbed episode",
                    magnitude.key, magnitude.nominal
                )));
            }
            add(self, component, magnitude);
        }
        self.events.push(Event { effect, nominal });
        Ok(())
    }
}

/// The axis of a component of an event.
struct Magnitude {
    key: &'static str,
    unit: String,
    range: [f64; 2],
    nominal: f64,
    meaning: String,
}

/// Returns the components of an event along the axes of the world.
fn along_axes(ranges: &axis_table::Ranges, unit: &str, what: &str) -> Vec<(usize, Magnitude)> {
    let one = |(index, key): (usize, &'static str)| {
        let range = ranges[index]?;
        let meaning = format!("{what} along the world's {key} axis");
        Some((MAGNITUDE + index, Magnitude { key, unit: unit.to_string(), range, nominal: 0.0, meaning }))
    };
    ["x", "y", "z"].into_iter().enumerate().filter_map(one).collect()
}

fn one_body(body: &Text, library: &Library<'_>, rule: &str) -> Result<usize, Problem> {
    let bodies = library.elements(ElementKind::Body, Some(&Argument::Text(body.text.clone())));
    match bodies.map_err(|message| Problem::new(&body.span, message))?.as_slice() {
        [body] => Ok(*body),
        bodies => Err(Problem::new(&body.span, format!("{} bodies match; {rule}", bodies.len()))),
    }
}

fn jumping(body: &Text, library: &Library<'_>) -> Result<Jumping, Problem> {
    let model = library.model;
    let index = one_body(body, library, "a jump displaces one")?;
    if let Ok(mocap) = model.mocap(&model.names(ElementKind::Body)[index]) {
        return Ok(Jumping::Mocap(mocap));
    }
    let is_free = |joint: &usize| {
        model.joint_kind(*joint) == JointKind::Free && model.body_of_joint(*joint) == model.body_at(index)
    };
    let joint = (0..model.joint_count()).find(is_free).map(|joint| Jumping::Free(model.joint_at(joint)));
    joint.ok_or_else(|| {
        let message = format!("`{}` cannot jump: it is neither a mocap body nor has a free joint", body.text);
        Problem::new(&body.span, message)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slip_lasts_as_many_physics_steps_as_its_duration_has() {
        for step in [0.002, 0.004, 0.005, 1.0 / 120.0] {
            for (first, count) in (0..60).flat_map(|first| (0..60).map(move |count| (first, count))) {
                let event = [f64::from(first) * step, f64::from(count) * step, 0.5, 0.0, 0.0];
                let found: Vec<i32> =
                    (0..130).filter(|k| slip(&event, f64::from(*k) * step, step).is_some()).collect();
                assert_eq!(found, (first..first + count).collect::<Vec<_>>(), "step {step} s, {event:?}");
            }
        }
    }
}
