//! The table `[axes]` of a target file, before it is compared with the model.

use crate::description::Expression;
use crate::document::{Fields, Item, Key, Table, Text, Value};
use crate::error::Problem;

/// Effect of an axis.
#[derive(Clone, Debug)]
pub(crate) enum AxisEffect {
    /// A number that expressions may read.
    Start,
    /// As `Start`, of the kind input.
    Command,
    /// Numbers of the model.
    Model { operation: ModelOperation, fields: Vec<Expression> },
    /// A delay of observations or actions.
    Delay { of_actions: bool },
    /// A constant bias of a part of the observation: the same for all its numbers, or an axis for
    /// each of them.
    Bias { part: Text, each: bool },
    /// White noise of a part of the observation.
    Noise { part: Text },
    /// A random draw that expressions may read. With a standard deviation it is normal and the
    /// value of the axis is in units of it; otherwise it is uniform.
    Draw { std: Option<f64> },
    /// Something that happens at a point in time.
    Event(Event),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ModelOperation {
    Set,
    Add,
    Scale,
}

/// Something that happens at a point in time.
#[derive(Clone, Debug)]
pub(crate) struct Event {
    pub kind: EventKind,
    pub time: [f64; 2],
    /// Duration, s; 0 for a jump.
    pub duration: [f64; 2],
}

/// Effect of an event.
#[derive(Clone, Debug)]
pub(crate) enum EventKind {
    /// A force acts on a body: its range along each axis of the world, N.
    Push { body: Text, force: Ranges },
    /// A body is displaced: by its range along each axis of the world, m.
    Jump { body: Text, offset: Ranges },
    /// Numbers of the model are different for a while: by the range of the operation.
    Slip { operation: ModelOperation, fields: Vec<Expression>, range: [f64; 2], unit: String },
}

/// A range along each axis of the world, if there is one.
pub(crate) type Ranges = [Option<[f64; 2]>; 3];

#[derive(Clone, Debug)]
pub(crate) struct AxisTable {
    pub effect: AxisEffect,
    pub range: [f64; 2],
    pub nominal: Option<f64>,
    pub unit: String,
    pub meaning: Option<String>,
    pub logarithmic: bool,
    pub integer: bool,
}

/// The operations on numbers of the model, with the keys that name them.
const OPERATIONS: [(&str, ModelOperation); 3] =
    [("set", ModelOperation::Set), ("add", ModelOperation::Add), ("scale", ModelOperation::Scale)];

/// Bound of the explicit value of a normal draw, standard deviations. The probability of a larger
/// one is 1 in 16,000.
const MAX_DRAW: f64 = 4.0;

fn expressions(texts: Vec<Text>) -> Result<Vec<Expression>, Problem> {
    texts.into_iter().map(Expression::new).collect()
}

/// Reads an axis of the kind "event", whose kind has been read.
fn event(key: &Key, table: &Table, fields: &mut Fields<'_>) -> Result<AxisTable, Problem> {
    let body = fields.text("body")?;
    let jump = fields.text("jump")?;
    let slip = fields.texts("slip")?;
    let mut along = || Ok::<Ranges, Problem>([fields.range("x")?, fields.range("y")?, fields.range("z")?]);
    let kind = match (body, jump, slip.is_empty()) {
        (Some(body), None, true) => EventKind::Push { body, force: along()? },
        (None, Some(body), true) => EventKind::Jump { body, offset: along()? },
        (None, None, false) => {
            let mut changes = Vec::new();
            for (key, operation) in OPERATIONS {
                changes.extend(fields.range(key)?.map(|range| (operation, range)));
            }
            let [(operation, range)] = changes.as_slice() else {
                let message = format!(
                    "the slip `{}` needs exactly one of `set`, `add` and `scale`, with the range [low, high]",
                    key.name
                );
                return Err(Problem::new(&table.span, message));
            };
            let unit = fields.text("unit")?.map(|text| text.text).unwrap_or_default();
            EventKind::Slip { operation: *operation, fields: expressions(slip)?, range: *range, unit }
        }
        _ => {
            let message = format!(
                "the event `{}` needs exactly one of `body` (a push), `jump` (a displacement of a body) and `slip` (other numbers of \
                 the model for a while)",
                key.name
            );
            return Err(Problem::new(&table.span, message));
        }
    };
    let number_or_range = |item: &Item, what| match item.value {
        Value::Number(_) => Ok([item.number(what)?; 2]),
        _ => item.range(what),
    };
    let time = number_or_range(fields.need("time")?, "time")?;
    let duration = match kind {
        EventKind::Jump { .. } => [0.0; 2],
        _ => number_or_range(fields.need("duration")?, "duration")?,
    };
    Ok(AxisTable {
        effect: AxisEffect::Event(Event { kind, time, duration }),
        range: [0.0; 2],
        nominal: None,
        unit: String::new(),
        meaning: None,
        logarithmic: false,
        integer: false,
    })
}

/// Reads an axis.
pub(crate) fn axis(key: &Key, item: &Item) -> Result<AxisTable, Problem> {
    let table = item.table(&key.name)?;
    let mut fields = Fields::new(table, format!("the axis `{}`", key.name));
    let kind = fields.text("kind")?;
    let kind_name = kind.as_ref().map_or("start", |kind| kind.text.as_str());
    if kind_name == "event" {
        let axis = event(key, table, &mut fields)?;
        fields.finish()?;
        return Ok(axis);
    }
    let mut range = fields.range("range")?;
    let mut integer = false;
    let effect = match kind_name {
        "start" => AxisEffect::Start,
        "command" => AxisEffect::Command,
        "model" => {
            let mut effects = Vec::new();
            for (key, operation) in OPERATIONS {
                let texts = fields.texts(key)?;
                if !texts.is_empty() {
                    effects.push(AxisEffect::Model { operation, fields: expressions(texts)? });
                }
            }
            if let Some(delayed) = fields.text("delay")? {
                let of_actions = match delayed.text.as_str() {
                    "action" => true,
                    "observation" => false,
                    _ => {
                        return Err(Problem::new(
                            &delayed.span,
                            "`delay` must be \"action\" or \"observation\"",
                        ));
                    }
                };
                integer = true;
                effects.push(AxisEffect::Delay { of_actions });
            }
            let each = fields.flag("each")?;
            effects.extend(fields.text("bias")?.map(|part| AxisEffect::Bias { part, each }));
            effects.extend(fields.text("noise")?.map(|part| AxisEffect::Noise { part }));
            match effects.pop() {
                Some(effect) if effects.is_empty() => effect,
                _ => {
                    let message = format!(
                        "the axis `{}` of the kind \"model\" needs exactly one of `set`, `add`, `scale`, `delay`, `bias` and `noise`",
                        key.name
                    );
                    return Err(Problem::new(&table.span, message));
                }
            }
        }
        "noise" => {
            let std = fields.number("std")?;
            if std.is_some() == range.is_some() || std.is_some_and(|std| std <= 0.0) {
                let message = format!(
                    "the axis `{}` of the kind \"noise\" needs `range`, of a uniform draw, or `std` above 0, of a normal one",
                    key.name
                );
                return Err(Problem::new(&table.span, message));
            }
            range.get_or_insert([-MAX_DRAW, MAX_DRAW]);
            AxisEffect::Draw { std }
        }
        _ => {
            let span = kind.map_or(table.span.clone(), |kind| kind.span);
            return Err(Problem::new(
                &span,
                "`kind` must be \"start\", \"command\", \"model\", \"event\" or \"noise\"",
            ));
        }
    };
    let missing = Problem::new(&table.span, format!("the axis `{}` needs `range = [low, high]`", key.name));
    let axis = AxisTable {
        effect,
        range: range.ok_or(missing)?,
        nominal: fields.number("nominal")?,
        unit: fields.text("unit")?.map(|text| text.text).unwrap_or_default(),
        meaning: fields.text("meaning")?.map(|text| text.text),
        logarithmic: fields.flag("logarithmic")?,
        integer: fields.flag("integer")? || integer,
    };
    fields.finish()?;
    Ok(axis)
}
