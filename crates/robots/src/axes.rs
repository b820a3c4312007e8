//! The axes of a file: numbers that expressions read, changes of the model, events, random draws,
//! and disturbances between sensors, policy and actuators.

use mishandle_rollout::{
    Axis, AxisKind, AxisValues, Distribution, Disturbance, Effect, Seed, Stream, TimeProfile,
};
use mishandle_world::{FieldOperation, ModelField};

use crate::axis_table::{AxisEffect, AxisTable, ModelOperation};
use crate::change::{ModelChange, checked_change};
use crate::description::{Description, Named};
use crate::error::Problem;
use crate::events::Event;
use crate::library::Library;
use crate::quantity::Quantity;

/// The part of the environment that an axis sets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Parameter {
    /// A number that expressions read.
    Value(usize),
    /// A change of the model.
    Change(usize),
    /// A component of an event.
    Event { event: usize, component: usize },
    /// A random draw.
    Draw(usize),
}

/// A random draw that expressions read.
#[derive(Clone, Debug)]
pub(crate) struct Draw {
    axis: Axis,
    /// Standard deviation of a normal draw; a draw without one is uniform.
    std: Option<f64>,
    /// Index of its value among the numbers that expressions read.
    pub index: usize,
}

impl Draw {
    /// Returns the value that expressions read: that of the scenario, or else draw number `number`
    /// of the seed.
    pub(crate) fn value(&self, given: Option<f64>, seed: Seed, number: u32) -> f64 {
        let Some(std) = self.std else {
            return given.unwrap_or_else(|| self.axis.at(seed.uniform(Stream::Reset, 0, number)));
        };
        let mut drawn = [0.0];
        seed.normals(Stream::Reset, 1 + u64::from(number), &mut drawn);
        std * given.unwrap_or(drawn[0])
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
    pub events: Vec<Event>,
    pub draws: Vec<Draw>,
    /// Disturbances of observations and actions.
    pub disturbances: Vec<Disturbance>,
}

/// Returns the names of the axes that expressions may read.
pub(crate) fn parameter_names(description: &Description) -> Vec<String> {
    use AxisEffect as E;
    let is_read =
        |axis: &&Named<AxisTable>| matches!(axis.value.effect, E::Start | E::Command | E::Draw { .. });
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
            AxisEffect::Event(_) => AxisKind::Event,
            AxisEffect::Draw { .. } => AxisKind::Noise,
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
        let axis = self.axis(kind, named, nominal)?;
        match &table.effect {
            AxisEffect::Start | AxisEffect::Command => {
                self.environment.push((axis, Parameter::Value(self.values.len())));
                self.values.push(nominal);
            }
            AxisEffect::Model { operation, fields } => {
                let change = checked_change(named, *operation, fields, table.range, Some(nominal), library)?;
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
            AxisEffect::Draw { std } => self.add_draw(named, axis, *std)?,
            AxisEffect::Event(event) => self.add_event(named, event, library)?,
        }
        Ok(())
    }

    fn axis(&self, kind: AxisKind, named: &Named<AxisTable>, nominal: f64) -> Result<Axis, Problem> {
        let table = &named.value;
        let range = table.range;
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

    fn add_draw(&mut self, named: &Named<AxisTable>, axis: Axis, std: Option<f64>) -> Result<(), Problem> {
        let table = &named.value;
        if table.nominal.is_some() {
            let message = "a random draw has no nominal value: without a value, its seed decides";
            return Err(Problem::new(&named.key.span, message));
        }
        let mut axis = Axis { nominal: None, ..axis };
        if let Some(std) = std {
            if axis.values != AxisValues::Continuous {
                return Err(Problem::new(&named.key.span, "a normal draw is neither whole nor logarithmic"));
            }
            let meaning = table.meaning.as_deref().unwrap_or("random draw");
            let unit = if axis.unit.is_empty() { String::new() } else { format!(" {}", axis.unit) };
            axis.meaning = format!("{meaning}, in units of its standard deviation, {std}{unit}");
            axis.unit = String::new();
            axis.distribution = Distribution::Normal;
        }
        self.environment.push((axis.clone(), Parameter::Draw(self.draws.len())));
        self.draws.push(Draw { axis, std, index: self.values.len() });
        // A reset replaces it.
        self.values.push(0.0);
        Ok(())
    }

    /// Two axes must not change the same number: their order would matter, and the range of one may
    /// be wrong after the other. A slip may set or scale a number of an axis: it comes after it.
    fn check_overlap(&self, description: &Description) -> Result<(), Problem> {
        let mut seen: Vec<(ModelField, usize)> = Vec::new();
        let mut seen_by_slips = Vec::new();
        let mut changes = self.changes.iter();
        let mut events = self.events.iter();
        for named in &description.axes {
            let (change, is_after) = match &named.value.effect {
                AxisEffect::Model { .. } => (changes.next(), false),
                AxisEffect::Event(_) => (events.next().and_then(Event::change), true),
                _ => continue,
            };
            let Some(change) = change else { continue };
            let own: Vec<(ModelField, usize)> = change.numbers().collect();
            let is_after = is_after && change.operation != FieldOperation::Add;
            let others = if is_after { &mut seen_by_slips } else { &mut seen };
            if own.iter().any(|entry| others.contains(entry)) {
                let message = format!("`{}` changes a number that an axis before it changes", named.key.name);
                return Err(Problem::new(&named.key.span, message));
            }
            others.extend(own);
        }
        Ok(())
    }
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

/// Returns the numbers of a part of the observation, which policies that are expressions read.
pub(crate) fn observed(part: &ObservedPart) -> Quantity {
    Quantity::Observed(part.first..part.first + part.size)
}
