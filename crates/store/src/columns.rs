//! The columns of exported simulations.

use crate::{RunHeader, Simulation, row};

/// A value of a column; `None` is missing.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Field {
    Integer(Option<u64>),
    Number(Option<f64>),
    Text(Option<String>),
}

/// Type of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum FieldType {
    Integer,
    Number,
    Text,
}

/// Columns that every export has, before those of axes and verdicts.
const FIXED: [(&str, FieldType); 12] = [
    ("trial", FieldType::Integer),
    ("simulation", FieldType::Integer),
    ("seed", FieldType::Integer),
    ("robustness", FieldType::Number),
    ("violated", FieldType::Integer),
    ("robustness_low", FieldType::Number),
    ("robustness_high", FieldType::Number),
    ("stop_threshold", FieldType::Number),
    ("end", FieldType::Text),
    ("end_step", FieldType::Integer),
    ("end_index", FieldType::Integer),
    ("steps", FieldType::Integer),
];

/// Returns names and types of the columns, in the order of [`fields`].
pub(crate) fn columns(header: &RunHeader) -> Vec<(String, FieldType)> {
    let mut columns: Vec<(String, FieldType)> =
        FIXED.iter().map(|(name, kind)| (name.to_string(), *kind)).collect();
    let mut numbers = |name: String| columns.push((name, FieldType::Number));
    header.axes.iter().for_each(|axis| numbers(format!("u_{}", axis.name)));
    header.axes.iter().for_each(|axis| numbers(with_unit(&axis.name, &axis.unit)));
    header.verdicts.iter().for_each(|name| numbers(name.clone()));
    columns.push(("trace_digest".to_owned(), FieldType::Text));
    columns
}

/// Returns the values of a simulation of a run with `axes` axes, one per column.
pub(crate) fn fields(simulation: &Simulation, axes: usize) -> Vec<Field> {
    let (end, end_step, end_index) = row::end_columns(simulation.end);
    let integer = |value: Option<u32>| Field::Integer(value.map(u64::from));
    let mut fields = vec![
        Field::Integer(Some(simulation.trial.into())),
        Field::Integer(Some(simulation.number.into())),
        Field::Integer(Some(simulation.seed)),
        Field::Number(simulation.robustness),
        Field::Integer(simulation.robustness.map(|_| simulation.is_violated().into())),
        Field::Number(simulation.robustness_low),
        Field::Number(simulation.robustness_high),
        Field::Number(simulation.stop_threshold),
        Field::Text(Some(end.to_owned())),
        integer(end_step),
        integer(end_index),
        Field::Integer(Some(simulation.steps.into())),
    ];
    fields.extend((0..axes).map(|axis| Field::Number(simulation.unit_point.get(axis).copied())));
    fields.extend(simulation.scenario.iter().copied().map(Field::Number));
    fields.extend(simulation.verdicts.iter().copied().map(Field::Number));
    fields.push(Field::Text(simulation.trace_digest.map(|digest| format!("{digest:032x}"))));
    fields
}

/// Returns the name of a column with its unit, such as `speed_m_per_s`.
pub(crate) fn with_unit(name: &str, unit: &str) -> String {
    if unit.is_empty() { name.to_string() } else { format!("{name}_{}", unit.replace('/', "_per_")) }
}
