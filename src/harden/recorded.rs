//! Failures of run files and counterexamples as scenarios of a space, for trainers outside of this
//! program.

use std::path::{Path, PathBuf};

use mishandle_rollout::{Axis, Scenario, Space};
use mishandle_store::{AxisRecord, RunFile};

use super::archive::{Simulated, shows_nan, weighted};
use super::search::simulated;
use crate::counterexample::{Counterexample, suite_files};
use crate::error::MishandleError;
use crate::run::axis_records;

/// Returns the failures of files, and scenarios that passed nearby, each with its weight in
/// training. The files are run files, counterexamples (`.json`) and folders of counterexamples.
///
/// The weights are those of a hardening. Failures that show NaN to the policy are left out.
///
/// # Errors
/// If a file cannot be read, its axes or a scenario are not of the space, or nothing failed.
pub fn recorded_failures(paths: &[PathBuf], space: &Space) -> Result<Vec<(Scenario, f64)>, MishandleError> {
    let axes = axis_records(space);
    let mut all = Vec::new();
    for path in paths {
        all.extend(read(path, &axes)?.into_iter().map(|found| (path, found)));
    }
    for (path, found) in &all {
        let scenario = Scenario::new(found.scenario.clone());
        space.check(&scenario).map_err(|error| other_space(path, vec![error.to_string()]))?;
        let differences = outside(space, &scenario);
        if !differences.is_empty() {
            return Err(other_space(path, differences));
        }
    }
    let trainable = all.into_iter().map(|(_, found)| found);
    let trainable: Vec<Simulated> =
        trainable.filter(|found| !shows_nan(space.axes(), &found.scenario)).collect();
    let weighted = weighted(&trainable);
    if weighted.is_empty() {
        let names: Vec<String> = paths.iter().map(|path| path.display().to_string()).collect();
        return Err(MishandleError::InvalidValue {
            what: "the archive",
            value: names.join(", "),
            expected: "run files or counterexamples with at least one failure to train on",
        });
    }
    Ok(weighted
        .into_iter()
        .map(|(weight, found)| (space.canonical(Scenario::new(found.scenario.clone())), weight))
        .collect())
}

/// Lists the values outside of the bounds of their axes: a simulation may have an initial state
/// there, but the space does not contain it.
fn outside(space: &Space, scenario: &Scenario) -> Vec<String> {
    let text = |(axis, value): (&Axis, &Option<f64>)| {
        let Axis { name, low, high, .. } = axis;
        let value = value.filter(|value| !(*low..=*high).contains(value))?;
        Some(format!("`{name}` is {value} there, outside of its range from {low} to {high}"))
    };
    space.axes().iter().zip(scenario.values()).filter_map(text).collect()
}

fn other_space(path: &Path, differences: Vec<String>) -> MishandleError {
    MishandleError::OtherSpace { path: path.to_path_buf(), differences }
}

/// Reads the simulations of a file or folder, with the values in the order of `axes`.
fn read(path: &Path, axes: &[AxisRecord]) -> Result<Vec<Simulated>, MishandleError> {
    if path.is_dir() {
        let files =
            suite_files(path).map_err(|source| MishandleError::File { path: path.to_path_buf(), source })?;
        let read = files.iter().map(|file| counterexample(file, axes));
        return read.collect();
    }
    if path.extension().is_some_and(|found| found.eq_ignore_ascii_case("json")) {
        return Ok(vec![counterexample(path, axes)?]);
    }
    let run = RunFile::open(path)?;
    let recorded: Vec<RecordedAxis<'_>> = run
        .header()
        .axes
        .iter()
        .map(|axis| RecordedAxis { name: &axis.name, unit: &axis.unit, values: Some(axis) })
        .collect();
    let order = order(&recorded, axes).map_err(|differences| other_space(path, differences))?;
    let (mut found, _) = simulated(&[run])?;
    for simulated in &mut found {
        simulated.scenario = order.iter().map(|index| simulated.scenario[*index]).collect();
    }
    Ok(found)
}

fn counterexample(path: &Path, axes: &[AxisRecord]) -> Result<Simulated, MishandleError> {
    let read = Counterexample::read(path)?;
    let recorded: Vec<RecordedAxis<'_>> = read
        .scenario
        .iter()
        .map(|value| RecordedAxis { name: &value.axis, unit: &value.unit, values: None })
        .collect();
    let order = order(&recorded, axes).map_err(|differences| other_space(path, differences))?;
    Ok(Simulated {
        scenario: order.iter().map(|index| read.scenario[*index].value).collect(),
        seed: read.seed,
        robustness: read.expected.robustness,
        mode: None,
    })
}

/// An axis of a file.
struct RecordedAxis<'a> {
    name: &'a str,
    unit: &'a str,
    /// Its record in the file; a counterexample has none.
    values: Option<&'a AxisRecord>,
}

/// Returns the index of each axis among the recorded ones, or the differences.
fn order(recorded: &[RecordedAxis<'_>], axes: &[AxisRecord]) -> Result<Vec<usize>, Vec<String>> {
    let mut differences = Vec::new();
    for unknown in recorded.iter().filter(|found| axes.iter().all(|axis| axis.name != found.name)) {
        differences.push(format!("the space has no axis `{}`", unknown.name));
    }
    let mut order = Vec::new();
    for axis in axes {
        let name = &axis.name;
        let Some(index) = recorded.iter().position(|found| found.name == name) else {
            differences.push(format!("they have no axis `{name}`"));
            continue;
        };
        let found = &recorded[index];
        if found.unit != axis.unit {
            differences.push(format!("the unit of `{name}` is `{}` there, not `{}`", found.unit, axis.unit));
        }
        // The numbers of categories count from the lower bound.
        let has_other_values = |then: &AxisRecord| {
            let is_numbered = axis.values.starts_with("categorical");
            then.values != axis.values || (is_numbered && then.low != axis.low)
        };
        if let Some(then) = found.values.filter(|then| has_other_values(then)) {
            differences
                .push(format!("the values of `{name}` are {} there, not {}", then.values, axis.values));
        }
        order.push(index);
    }
    if differences.is_empty() { Ok(order) } else { Err(differences) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axis(name: &str, unit: &str, values: &str) -> AxisRecord {
        AxisRecord { name: name.into(), unit: unit.into(), values: values.into(), ..AxisRecord::default() }
    }

    fn order_of(recorded: &[AxisRecord], axes: &[AxisRecord]) -> Result<Vec<usize>, Vec<String>> {
        let facts: Vec<RecordedAxis<'_>> = recorded
            .iter()
            .map(|axis| RecordedAxis { name: &axis.name, unit: &axis.unit, values: Some(axis) })
            .collect();
        order(&facts, axes)
    }

    #[test]
    fn initial_states_outside_of_the_range_are_named() {
        let space = Space::new("starts", vec![Axis::start("x", "m", 0.0, 1.0)]).unwrap();
        assert!(outside(&space, &Scenario::from([1.0])).is_empty());
        let found = outside(&space, &Scenario::from([1.5]));
        assert_eq!(found, ["`x` is 1.5 there, outside of its range from 0 to 1"]);
    }

    #[test]
    fn axes_are_found_by_name_and_must_agree() {
        let [x, kind] = [axis("x", "m", "continuous"), axis("kind", "", "categorical: dry, wet")];
        let both = [x.clone(), kind.clone()];
        assert_eq!(order_of(&both, &both), Ok(vec![0, 1]));
        assert_eq!(order_of(&[kind.clone(), x.clone()], &both), Ok(vec![1, 0]));
        let narrowed = AxisRecord { low: 1.0, ..kind.clone() };
        for (recorded, part) in [
            (vec![x.clone()], "no axis `kind`"),
            (vec![x.clone(), kind.clone(), axis("y", "m", "continuous")], "no axis `y`"),
            (vec![axis("x", "mm", "continuous"), kind.clone()], "`mm` there"),
            (vec![axis("x", "m", "integer"), kind], "integer there"),
            (vec![x, narrowed], "the values of `kind`"),
        ] {
            let differences = order_of(&recorded, &both).unwrap_err();
            assert_eq!(differences.len(), 1, "{differences:?}");
            assert!(differences[0].contains(part), "{part}: {differences:?}");
        }
    }
}
