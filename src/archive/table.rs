//! Tables of scenarios to train on, each with its weight.

use std::path::Path;

use csv::{ReaderBuilder, StringRecord};
use mishandle_files::{limits, read_text_bounded};
use mishandle_rollout::{Axis, AxisKind, AxisValues, Scenario, Space};

use super::recorded_failures;
use crate::error::{MishandleError, problem};
use crate::resolve::TrainingTarget;

/// Column of the weights.
const WEIGHT: &str = "weight";

/// Name of the table in a folder of failures.
pub(crate) const TABLE: &str = "archive.csv";

/// Returns the scenarios of a table, or the failures of a run file, of a counterexample or of a
/// folder of them, each with its weight. A folder with a table, as that of a hardening's round, has
/// the scenarios of this table. With a `target`, failures must be of this one.
///
/// # Errors
/// If a file cannot be read, its scenarios are not of the space, or those of
/// [`recorded_failures`].
pub(crate) fn given_scenarios(
    path: &Path,
    space: &Space,
    target: Option<&dyn TrainingTarget>,
) -> Result<Vec<(Scenario, f64)>, MishandleError> {
    let table = path.join(TABLE);
    let path = if table.exists() { &table } else { path };
    let is_table = path.extension().is_some_and(|found| found.eq_ignore_ascii_case("csv"));
    if !is_table && path.exists() {
        return recorded_failures(&[path.to_path_buf()], space, target);
    }
    let text = read_text_bounded(path, limits::SCENARIOS).map_err(MishandleError::file(path))?;
    parse(&text, space).map_err(|text| problem(format!("the scenarios {}: {text}", path.display())))
}

fn parse(text: &str, space: &Space) -> Result<Vec<(Scenario, f64)>, String> {
    let mut reader = ReaderBuilder::new().from_reader(text.as_bytes());
    let columns = reader.headers().map_err(|error| error.to_string())?.clone();
    let mut places = Vec::new();
    for (number, column) in columns.iter().enumerate() {
        let place = space.axes().iter().position(|axis| axis.name == column);
        if place.is_none() && column != WEIGHT {
            let names: Vec<&str> = space.axes().iter().map(|axis| axis.name.as_str()).collect();
            let known = names.join(", ");
            return Err(format!("column `{column}` is not an axis of the space; expected weight, {known}"));
        }
        if columns.iter().take(number).any(|before| before == column) {
            return Err(format!("two columns have the name `{column}`"));
        }
        places.push(place);
    }
    let mut scenarios = Vec::new();
    for record in reader.records() {
        let record = record.map_err(|error| error.to_string())?;
        let line = record.position().map_or(0, csv::Position::line);
        let row = row(&record, &places, space).map_err(|problem| format!("line {line}: {problem}"))?;
        scenarios.push(row);
    }
    if scenarios.iter().any(|(_, weight)| *weight > 0.0) {
        Ok(scenarios)
    } else {
        Err("it has no scenario with a weight above 0".to_string())
    }
}

/// Reads a scenario and its weight. An empty cell is nominal, or random on an axis of the start.
fn row(record: &StringRecord, places: &[Option<usize>], space: &Space) -> Result<(Scenario, f64), String> {
    let axes = space.axes();
    let open = |axis: &Axis| if axis.kind == AxisKind::Start { None } else { axis.nominal };
    let mut values: Vec<Option<f64>> = axes.iter().map(open).collect();
    let mut weight: f64 = 1.0;
    for (cell, place) in record.iter().zip(places).filter(|(cell, _)| !cell.trim().is_empty()) {
        match place {
            Some(place) => values[*place] = Some(value(cell.trim(), &axes[*place])?),
            None => weight = cell.trim().parse().unwrap_or(f64::NAN),
        }
    }
    if !(weight >= 0.0 && weight.is_finite()) {
        return Err("a weight must be a number of at least 0".to_string());
    }
    let filled = values.iter().zip(axes).map(|(value, axis)| value.or(axis.nominal));
    space.check(&Scenario::new(filled.collect())).map_err(|error| error.to_string())?;
    Ok((Scenario::new(values), weight))
}

/// Returns the value of a cell: a number, or the name of a category.
fn value(cell: &str, axis: &Axis) -> Result<f64, String> {
    let category = match &axis.values {
        AxisValues::Categorical(names) => names.iter().position(|name| name == cell),
        _ => None,
    };
    let number = category.map(|index| axis.low + index as f64).or_else(|| cell.parse().ok());
    number.ok_or_else(|| format!("`{}` is `{cell}`; expected a value of the axis", axis.name))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::Plan;
    use crate::resolve::ResolvedPlan;

    #[test]
    fn a_file_of_scenarios_states_weights_values_and_categories() {
        let plan =
            Plan { space: "starts+delay+faults-actuation".to_string(), ..Plan::new("ball-balancing", "ppo") };
        let space = &ResolvedPlan::new(&plan).unwrap().space;
        let at = |name: &str| space.axes().iter().position(|axis| axis.name == name).unwrap();
        let text = "weight,action_delay,actuator_fault,ball_x\n2,3,pause,\n,,,0.3\n";
        let read = parse(text, space).unwrap();
        let get = |row: usize, name: &str| read[row].0.get(at(name));
        assert_eq!((read[0].1, read[1].1), (2.0, 1.0));
        assert_eq!((get(0, "action_delay"), get(0, "observation_delay")), (Some(3.0), Some(0.0)));
        assert_eq!((get(0, "actuator_fault"), get(1, "actuator_fault")), (Some(7.0), Some(0.0)));
        assert_eq!((get(0, "ball_x"), get(1, "ball_x")), (None, Some(0.3)), "an empty start is random");
        for (text, part) in [
            ("action_delai\n1\n", "`action_delai` is not an axis"),
            ("action_delay,action_delay\n1,1\n", "two columns"),
            ("action_delay\n0.5\n", "line 2"),
            ("action_delay\nsoon\n", "expected a value of the axis"),
            ("weight\n-1\n", "at least 0"),
            ("weight\nnan\n", "at least 0"),
            ("weight\n0\n", "no scenario"),
            ("action_delay,weight\n1\n", "record"),
            ("action_delay\n", "no scenario"),
        ] {
            let error = parse(text, space).unwrap_err();
            assert!(error.contains(part), "{text}: {error}");
        }
    }
}
