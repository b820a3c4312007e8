//! The axes of a file: numbers that expressions read, changes of the model, pushes, and
//! disturbances between sensors, policy and actuators.

use mishandle_expression::{Argument, NodeKind};
use mishandle_rollout::{Axis, AxisKind, AxisValues, Disturbance, Effect, TimeProfile};
use mishandle_world::{Body, Change, ElementKind, FieldOperation, Model, ModelField};

use crate::description::{AxisEffect, AxisTable, Description, Expression, ModelOperation, Named, Push};
use crate::error::Problem;
use crate::library::Library;
use crate::quantity::Quantity;

/// The part of the environment that an axis sets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Parameter {
    /// A number that expressions read.
    Value(usize),
    /// A change of the model.
    Change(usize),
    /// A component of a push: time, duration, or force along an axis.
    Push { push: usize, component: usize },
}

/// Number of components of a push: time, duration and three forces.
pub(crate) const PUSH_SIZE: usize = 5;

/// A change of numbers of the model by the value of an axis.
#[derive(Clone, Debug)]
pub(crate) struct ModelChange {
    pub operation: FieldOperation,
    pub targets: Vec<(ModelField, Vec<usize>)>,
    pub nominal: f64,
}

impl ModelChange {
    /// Returns the changes of the model for a value of the axis.
    pub(crate) fn changes(&self, value: f64) -> impl Iterator<Item = Change> + '_ {
        self.targets.iter().map(move |(field, entries)| Change::Field {
            field: *field,
            entries: entries.clone(),
            operation: self.operation,
            value,
        })
    }
}

/// The axes of a file, and what they set.
#[derive(Clone, Debug, Default)]
pub(crate) struct Axes {
    /// Axes of the environment.
    pub environment: Vec<(Axis, Parameter)>,
    /// Nominal values of the numbers that expressions read.
    pub values: Vec<f64>,
    pub changes: Vec<ModelChange>,
    pub pushed: Vec<Body>,
    /// Nominal components of each push.
    pub pushes: Vec<[f64; PUSH_SIZE]>,
    /// Disturbances of observations and actions.
    pub disturbances: Vec<Disturbance>,
}

/// Returns the names of the axes that expressions may read.
pub(crate) fn parameter_names(description: &Description) -> Vec<String> {
    let is_read =
        |axis: &&Named<AxisTable>| matches!(axis.value.effect, AxisEffect::Start | AxisEffect::Command);
    description.axes.iter().filter(is_read).map(|axis| axis.key.name.clone()).collect()
}

/// A part of the observation: name, first entry and size.
pub(crate) struct ObservedPart {
    pub name: String,
    pub unit: String,
    pub first: usize,
    pub size: usize,
}

impl Axes {
    /// Resolves the axes of a description.
    pub(crate) fn new(
        description: &Description,
        library: &Library<'_>,
        parts: &[ObservedPart],
    ) -> Result<Axes, Problem> {
        let mut axes = Axes::default();
        for axis in &description.axes {
            axes.add(axis, library, parts, description.control.steps)?;
        }
        axes.check_overlap(description)?;
        Ok(axes)
    }

    fn add(
        &mut self,
        named: &Named<AxisTable>,
        library: &Library<'_>,
        parts: &[ObservedPart],
        steps: usize,
    ) -> Result<(), Problem> {
        let table = &named.value;
        let name = named.key.name.as_str();
        let kind = match table.effect {
            AxisEffect::Start => AxisKind::Start,
            AxisEffect::Command => AxisKind::Input,
            AxisEffect::Push(_) => AxisKind::Event,
            _ => AxisKind::Model,
        };
        // A number without effect is the nominal one, where there is such a number.
        let default = match &table.effect {
            AxisEffect::Model { operation: ModelOperation::Add, .. } => Some(0.0),
            AxisEffect::Model { operation: ModelOperation::Scale, .. } => Some(1.0),
            AxisEffect::Model { .. } => None,
            AxisEffect::Start | AxisEffect::Command => {
                let [low, high] = table.range;
                Some(if low <= 0.0 && high >= 0.0 { 0.0 } else { (low + high) / 2.0 })
            }
            _ => Some(0.0),
        };
        let nominal = table.nominal.or(default).ok_or_else(|| {
            Problem::new(
                &named.key.span,
                format!("the axis `{name}` needs `nominal`, the value of the model as it is"),
            )
        })?;
        let axis = self.axis(kind, named, table.range, nominal)?;
        match &table.effect {
            AxisEffect::Start | AxisEffect::Command => {
                self.environment.push((axis, Parameter::Value(self.values.len())));
                self.values.push(nominal);
            }
            AxisEffect::Model { operation, fields } => {
                let change = model_change(*operation, fields, nominal, library)?;
                for value in [table.range[0], table.range[1], nominal] {
                    for change in change.changes(value) {
                        library.model.check_change(&change).map_err(|error| {
                            Problem::new(&named.key.span, format!("the axis `{name}`: {error}"))
                        })?;
                    }
                }
                if *operation == ModelOperation::Set {
                    check_nominal(&change, named, library.model)?;
                }
                self.environment.push((axis, Parameter::Change(self.changes.len())));
                self.changes.push(change);
            }
            AxisEffect::Delay { of_actions } => {
                if table.range[0] < 0.0 || table.range.iter().any(|bound| bound.fract() != 0.0) {
                    let message =
                        format!("the range of the delay `{name}` is in whole control steps, from 0");
                    return Err(Problem::new(&named.key.span, message));
                }
                let effect = if *of_actions { Effect::ActionDelay } else { Effect::ObservationDelay };
                self.disturbances.push(Disturbance { axis, effect });
            }
            AxisEffect::Bias { part, each } => {
                let part = find_part(part, parts)?;
                for entry in part.first..part.first + part.size {
                    let mut axis = axis.clone();
                    if *each && part.size > 1 {
                        axis.name = format!("{name}_{}", entry - part.first + 1);
                    }
                    let effect = Effect::Observation {
                        entry,
                        factor: 1.0,
                        profile: TimeProfile::Constant(0..steps + 1),
                    };
                    self.disturbances.push(Disturbance { axis, effect });
                }
            }
            AxisEffect::Noise { part } => {
                let part = find_part(part, parts)?;
                if table.range[0] < 0.0 {
                    return Err(Problem::new(&named.key.span, "a standard deviation is not negative"));
                }
                let entries = (part.first..part.first + part.size).map(|entry| (entry, 1.0)).collect();
                self.disturbances.push(Disturbance { axis, effect: Effect::ObservationNoise { entries } });
            }
            AxisEffect::Push(push) => self.push(named, push, library)?,
        }
        Ok(())
    }

    fn axis(
        &self,
        kind: AxisKind,
        named: &Named<AxisTable>,
        range: [f64; 2],
        nominal: f64,
    ) -> Result<Axis, Problem> {
        let table = &named.value;
        let name = named.key.name.as_str();
        let is_plain = |c: char| c.is_ascii_alphanumeric() || c == '_';
        if name.is_empty() || !name.chars().all(is_plain) || name.starts_with(|c: char| c.is_ascii_digit()) {
            return Err(Problem::new(&named.key.span, "the name of an axis has letters, digits and `_`"));
        }
        let mut axis = Axis::new(kind, name, &table.unit, range, Some(nominal));
        if table.logarithmic {
            if range[0] <= 0.0 {
                return Err(Problem::new(&named.key.span, "a logarithmic range is greater than 0"));
            }
            axis = axis.with_values(AxisValues::Logarithmic);
        }
        if table.integer {
            axis = axis.with_values(AxisValues::Integer);
        }
        if let Some(meaning) = &table.meaning {
            axis = axis.meaning(meaning);
        }
        Ok(axis)
    }

    fn push(&mut self, named: &Named<AxisTable>, push: &Push, library: &Library<'_>) -> Result<(), Problem> {
        let argument = Argument::Text(push.body.text.clone());
        let bodies = library.elements(ElementKind::Body, Some(&argument));
        let bodies = bodies.map_err(|message| Problem::new(&push.body.span, message))?;
        let [body] = bodies.as_slice() else {
            return Err(Problem::new(
                &push.body.span,
                format!("{} bodies match; a push acts on one", bodies.len()),
            ));
        };
        let index = self.pushed.len();
        let name = &named.key.name;
        let mut nominal = [push.time[0], push.duration[1], 0.0, 0.0, 0.0];
        let mut add = |axes: &mut Axes,
                       component: usize,
                       part: &str,
                       unit: &str,
                       range: [f64; 2],
                       meaning: String| {
            let [low, high] = range;
            if component >= 2 && !(low <= 0.0 && high >= 0.0) {
                let message = "the range of a force contains 0, the force of an undisturbed episode";
                return Err(Problem::new(&named.key.span, message));
            }
            if low == high {
                nominal[component] = low;
                return Ok(());
            }
            let axis =
                Axis::new(AxisKind::Event, &format!("{name}_{part}"), unit, range, Some(nominal[component]));
            axes.environment.push((axis.meaning(&meaning), Parameter::Push { push: index, component }));
            Ok(())
        };
        if push.time[0] < 0.0 || push.duration[0] < 0.0 {
            return Err(Problem::new(
                &named.key.span,
                "the time and the duration of a push are not negative",
            ));
        }
        let on = format!("the push on `{}`", push.body.text);
        add(self, 0, "time", "s", push.time, format!("start time of {on}"))?;
        add(self, 1, "duration", "s", push.duration, format!("duration of {on}"))?;
        for (component, axis) in ["x", "y", "z"].into_iter().enumerate() {
            if let Some(range) = push.force[component] {
                add(
                    self,
                    2 + component,
                    axis,
                    "N",
                    range,
                    format!("force of {on} along the world's {axis} axis"),
                )?;
            }
        }
        self.pushed.push(library.model.body_at(*body));
        self.pushes.push(nominal);
        Ok(())
    }

    /// Two axes must not change the same number: their order would matter, and the range of one may
    /// be wrong after the other.
    fn check_overlap(&self, description: &Description) -> Result<(), Problem> {
        let mut seen: Vec<(ModelField, usize)> = Vec::new();
        let models =
            description.axes.iter().filter(|axis| matches!(axis.value.effect, AxisEffect::Model { .. }));
        for (named, change) in models.zip(&self.changes) {
            let own: Vec<(ModelField, usize)> = change
                .targets
                .iter()
                .flat_map(|(field, entries)| entries.iter().map(|entry| (*field, *entry)))
                .collect();
            if own.iter().any(|entry| seen.contains(entry)) {
                let message = format!("`{}` changes a number that an axis before it changes", named.key.name);
                return Err(Problem::new(&named.key.span, message));
            }
            seen.extend(own);
        }
        Ok(())
    }
}

/// The nominal value of an axis that sets numbers must be that of the model: with it, the episode
/// is the undisturbed one.
fn check_nominal(change: &ModelChange, named: &Named<AxisTable>, model: &Model) -> Result<(), Problem> {
    for (field, entries) in &change.targets {
        for entry in entries {
            let found = model.field(*field)[*entry];
            if found != change.nominal {
                let message = format!(
                    "the axis `{}` has the nominal value {}, but {} of the model is {found}",
                    named.key.name,
                    change.nominal,
                    field.name()
                );
                return Err(Problem::new(&named.key.span, message));
            }
        }
    }
    Ok(())
}

fn find_part<'a>(
    name: &crate::document::Text,
    parts: &'a [ObservedPart],
) -> Result<&'a ObservedPart, Problem> {
    parts.iter().find(|part| part.name == name.text).ok_or_else(|| {
        let known: Vec<&str> = parts.iter().map(|part| part.name.as_str()).collect();
        Problem::new(
            &name.span,
            format!(
                "the policy has no part `{}` of the observation (parts: {})",
                name.text,
                known.join(", ")
            ),
        )
    })
}

fn model_change(
    operation: ModelOperation,
    fields: &[Expression],
    nominal: f64,
    library: &Library<'_>,
) -> Result<ModelChange, Problem> {
    let targets = fields.iter().map(|field| model_numbers(field, library)).collect::<Result<_, _>>()?;
    let operation = match operation {
        ModelOperation::Set => FieldOperation::Set,
        ModelOperation::Add => FieldOperation::Add,
        ModelOperation::Scale => FieldOperation::Scale,
    };
    Ok(ModelChange { operation, targets, nominal })
}

/// Resolves numbers of the model, such as `geom_friction('floor')[0]`.
fn model_numbers(
    expression: &Expression,
    library: &Library<'_>,
) -> Result<(ModelField, Vec<usize>), Problem> {
    let problem = |message: String| Problem::new(&expression.text.span, message);
    let form = || {
        problem(
            "write the numbers of the model as `field('element')`, with `[index]` or `[first:end]`"
                .to_string(),
        )
    };
    let index = |node: &mishandle_expression::Node| match node.kind {
        NodeKind::Number(value) if value.fract() == 0.0 && value >= 0.0 => Ok(value as usize),
        _ => Err(form()),
    };
    let (call, columns) = match &expression.node.kind {
        NodeKind::Index(call, column) => (&**call, Some((index(column)?, index(column)? + 1))),
        NodeKind::Slice(call, Some(first), Some(end)) => (&**call, Some((index(first)?, index(end)?))),
        NodeKind::Call(..) | NodeKind::Name(_) => (&expression.node, None),
        _ => return Err(form()),
    };
    let (name, argument) = match &call.kind {
        NodeKind::Name(name) => (name, None),
        NodeKind::Call(name, arguments) => match arguments.as_slice() {
            [] => (name, None),
            [node] => match &node.kind {
                NodeKind::Text(text) => (name, Some(Argument::Text(text.clone()))),
                NodeKind::Name(group) => (name, Some(Argument::Name(group.clone()))),
                _ => return Err(form()),
            },
            _ => return Err(form()),
        },
        _ => return Err(form()),
    };
    let field = match name.as_str() {
        "gravity" => ModelField::Gravity,
        "wind" => ModelField::Wind,
        name => ModelField::from_name(name).map_err(|error| problem(error.to_string()))?,
    };
    let rows: Vec<usize> = match field.rows() {
        None => vec![0],
        Some(kind) => {
            let elements = library.elements(kind, argument.as_ref()).map_err(problem)?;
            elements.into_iter().flat_map(|element| library.model.field_rows(field, element)).collect()
        }
    };
    let width = field.width();
    let (first, end) = columns.unwrap_or((0, width));
    if first >= end || end > width {
        return Err(problem(format!("`{name}` has the numbers 0 to {}", width - 1)));
    }
    Ok((field, rows.into_iter().flat_map(|row| row * width + first..row * width + end).collect()))
}

/// Returns the numbers of a part of the observation, which policies that are expressions read.
pub(crate) fn observed(part: &ObservedPart) -> Quantity {
    Quantity::Observed(part.first..part.first + part.size)
}

/// Returns the model with the changes of the values that differ from the nominal ones.
pub(crate) fn changed(model: &Model, changes: &[ModelChange], values: &[f64]) -> Model {
    let different = changes.iter().zip(values).filter(|(change, value)| change.nominal != **value);
    let all: Vec<Change> = different.flat_map(|(change, value)| change.changes(*value)).collect();
    if all.is_empty() { model.clone() } else { model.changed(&all) }
}
