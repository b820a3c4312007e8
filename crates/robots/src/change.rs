//! Changes of numbers of the model by the values of axes.

use crate::expression::{Argument, NodeKind};
use mishandle_world::{Change, FieldOperation, Model, ModelField};

use crate::axis_table::{AxisTable, ModelOperation};
use crate::description::{Expression, Named};
use crate::error::Problem;
use crate::library::Library;

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

    /// Returns the numbers that it changes.
    pub(crate) fn numbers(&self) -> impl Iterator<Item = (ModelField, usize)> + '_ {
        self.targets.iter().flat_map(|(field, entries)| entries.iter().map(move |entry| (*field, *entry)))
    }
}

/// Returns the change of the model by an axis, which can be made at each end of its range. Without
/// a nominal value, it is that of the model.
pub(crate) fn checked_change(
    named: &Named<AxisTable>,
    operation: ModelOperation,
    fields: &[Expression],
    range: [f64; 2],
    nominal: Option<f64>,
    library: &Library<'_>,
) -> Result<ModelChange, Problem> {
    let mut change = model_change(operation, fields, nominal.unwrap_or_default(), library)?;
    let first = change.numbers().next();
    if let (None, Some((field, entry))) = (nominal, first) {
        change.nominal = library.model.field(field)[entry];
    }
    for value in [range[0], range[1], change.nominal] {
        for change in change.changes(value) {
            library.model.check_change(&change).map_err(|error| {
                Problem::new(&named.key.span, format!("the axis `{}`: {error}", named.key.name))
            })?;
        }
    }
    if operation == ModelOperation::Set {
        check_nominal(&change, named, library.model)?;
    }
    Ok(change)
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
    let index = |node: &crate::expression::Node| match node.kind {
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

/// Returns the model with the changes of the values that differ from the nominal ones.
pub(crate) fn changed(model: &Model, changes: &[ModelChange], values: &[f64]) -> Model {
    let different = changes.iter().zip(values).filter(|(change, value)| change.nominal != **value);
    let all: Vec<Change> = different.flat_map(|(change, value)| change.changes(*value)).collect();
    if all.is_empty() { model.clone() } else { model.changed(&all) }
}
