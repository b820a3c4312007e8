//! Failures of run files and counterexamples as scenarios of a space.

use std::path::{Path, PathBuf};

use mishandle_results::{Command, Remedy};
use mishandle_rollout::{Axis, AxisKind, Scenario, Space};
use mishandle_store::{AxisRecord, ComponentRecord, RunFile, TargetRecord};

use super::simulated::simulated;
use super::weights::{Simulated, shows_nan, weighted};
use crate::counterexample::{Counterexample, suite_files};
use crate::error::{MishandleError, invalid, problem};
use crate::plan::Plan;
use crate::resolve::TrainingTarget;
use crate::run::axis_records;

/// Returns the failures of files, and scenarios that passed nearby, each with its weight in
/// training. The files are run files, counterexamples (`.json`) and folders of counterexamples.
///
/// The weights are those of a hardening. Failures that show NaN to the policy are left out. An axis
/// that a file does not have was nominal, or random if it is one of the initial state. With a
/// `target`, the files must be of this one.
///
/// # Errors
/// If a file cannot be read, it is of another target or of another version of it, its axes or a
/// scenario are not of the space, or nothing failed.
pub fn recorded_failures(
    paths: &[PathBuf],
    space: &Space,
    target: Option<&dyn TrainingTarget>,
) -> Result<Vec<(Scenario, f64)>, MishandleError> {
    let mut all = Vec::new();
    for path in paths {
        all.extend(read(path, space, target)?.into_iter().map(|found| (path, found)));
    }
    for (path, found) in &all {
        let scenario = Scenario::new(found.scenario.clone());
        space.check(&scenario).map_err(|error| other_space(path, &[error.to_string()]))?;
        let differences = outside(space, &scenario);
        if !differences.is_empty() {
            return Err(other_space(path, &differences));
        }
    }
    let trainable = all.into_iter().map(|(_, found)| found);
    let trainable: Vec<Simulated> =
        trainable.filter(|found| !shows_nan(space.axes(), &found.scenario)).collect();
    let weighted = weighted(&trainable);
    if weighted.is_empty() {
        let names: Vec<String> = paths.iter().map(|path| path.display().to_string()).collect();
        return Err(invalid(
            "the archive",
            names.join(", "),
            "run files or counterexamples with at least one failure to train on",
        ));
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

fn other_space(path: &Path, differences: &[String]) -> MishandleError {
    problem(format!(
        "the scenarios of {} are of another space: {}; pass files that were made with the same axes",
        path.display(),
        differences.join("; ")
    ))
}

/// Reads the simulations of a file or folder, with the values in the order of the space's axes.
fn read(
    path: &Path,
    space: &Space,
    target: Option<&dyn TrainingTarget>,
) -> Result<Vec<Simulated>, MishandleError> {
    let of_file = |file: &Path| {
        let known = Counterexample::read(file)?;
        check_target(file, &known.plan, &known.components, &known.target, target)?;
        simulated_in(file, &known, space)
    };
    if path.is_dir() {
        let files = suite_files(path).map_err(MishandleError::file(path))?;
        return files.iter().map(|file| of_file(file)).collect();
    }
    if path.extension().is_some_and(|found| found.eq_ignore_ascii_case("json")) {
        return Ok(vec![of_file(path)?]);
    }
    let run = RunFile::open(path)?;
    let header = run.header();
    check_target(path, &Plan::from_toml(&header.plan)?, &header.components, &header.target, target)?;
    let recorded: Vec<RecordedAxis<'_>> = run
        .header()
        .axes
        .iter()
        .map(|axis| RecordedAxis { name: &axis.name, unit: &axis.unit, values: Some(axis) })
        .collect();
    let order = order(&recorded, space).map_err(|differences| other_space(path, &differences))?;
    let (mut found, _) = simulated(&[run])?;
    for simulated in &mut found {
        simulated.scenario = in_order(space, &order, |index| simulated.scenario[index]);
    }
    Ok(found)
}

/// Checks that a file is of this target, in its present version. `plan` and `components` are those
/// of the file.
fn check_target(
    path: &Path,
    plan: &Plan,
    components: &[ComponentRecord],
    found: &TargetRecord,
    expected: Option<&dyn TrainingTarget>,
) -> Result<(), MishandleError> {
    let Some(target) = expected else { return Ok(()) };
    let is_present = || {
        let controller = components.first().map_or("", |controller| controller.hash.as_str());
        Ok::<bool, MishandleError>(target.identity(plan, controller)?.hash == found.hash)
    };
    if found.name == target.name() && is_present()? {
        return Ok(());
    }
    let expected = target.name();
    let version = if *expected == *found.name { " in another version" } else { "" };
    let text = format!(
        "{} has failures of {}{version}, and training on them needs those of {expected} as it is now: search again",
        path.display(),
        found.name
    );
    Err(problem(text).with(Remedy::Run(Command::Falsify { target: target.given() })))
}

/// Returns the scenario of a counterexample with the values in the order of the space's axes.
///
/// # Errors
/// If its axes are not of the space.
pub(crate) fn simulated_in(
    path: &Path,
    read: &Counterexample,
    space: &Space,
) -> Result<Simulated, MishandleError> {
    let recorded: Vec<RecordedAxis<'_>> = read
        .scenario
        .iter()
        .map(|value| RecordedAxis { name: &value.axis, unit: &value.unit, values: None })
        .collect();
    let order = order(&recorded, space).map_err(|differences| other_space(path, &differences))?;
    Ok(Simulated {
        scenario: in_order(space, &order, |index| read.scenario[index].value),
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

/// Returns the value of each axis: that of its place in a file, or the nominal one.
fn in_order(
    space: &Space,
    order: &[Option<usize>],
    value: impl Fn(usize) -> Option<f64>,
) -> Vec<Option<f64>> {
    let open = |axis: &Axis| if axis.kind == AxisKind::Start { None } else { axis.nominal };
    let values = space.axes().iter().zip(order);
    values.map(|(axis, place)| place.map_or_else(|| open(axis), &value)).collect()
}

/// Returns the index of each axis among the recorded ones, `None` if it is not there, or the
/// differences.
fn order(recorded: &[RecordedAxis<'_>], space: &Space) -> Result<Vec<Option<usize>>, Vec<String>> {
    let axes = axis_records(space);
    let mut differences = Vec::new();
    for unknown in recorded.iter().filter(|found| axes.iter().all(|axis| axis.name != found.name)) {
        differences.push(format!("the space has no axis `{}`", unknown.name));
    }
    let mut order = Vec::new();
    for axis in &axes {
        let name = &axis.name;
        let place = recorded.iter().position(|found| found.name == name);
        order.push(place);
        let Some(found) = place.map(|index| &recorded[index]) else { continue };
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
    }
    if differences.is_empty() { Ok(order) } else { Err(differences) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mishandle_rollout::AxisValues;

    fn recorded<'a>(axes: &'a [AxisRecord]) -> Vec<RecordedAxis<'a>> {
        let fact =
            |axis: &'a AxisRecord| RecordedAxis { name: &axis.name, unit: &axis.unit, values: Some(axis) };
        axes.iter().map(fact).collect()
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
        let kinds = ["dry", "wet"].map(String::from);
        let kind = Axis::new(AxisKind::Model, "kind", "", [0.0, 1.0], Some(1.0));
        let kind = kind.with_values(AxisValues::Categorical(kinds.into()));
        let space = Space::new("both", vec![Axis::start("x", "m", 0.0, 1.0), kind]).unwrap();
        let [x, kind] = <[AxisRecord; 2]>::try_from(axis_records(&space)).unwrap();
        assert_eq!(order(&recorded(&[x.clone(), kind.clone()]), &space), Ok(vec![Some(0), Some(1)]));
        assert_eq!(order(&recorded(&[kind.clone(), x.clone()]), &space), Ok(vec![Some(1), Some(0)]));
        // A missing axis was nominal, or random if it is one of the initial state.
        for (axes, expected) in [([x.clone()], [Some(0.25), Some(1.0)]), ([kind.clone()], [None, Some(0.25)])]
        {
            let places = order(&recorded(&axes), &space).unwrap();
            assert_eq!(in_order(&space, &places, |_| Some(0.25)), expected);
        }
        let y = AxisRecord { name: "y".to_string(), ..x.clone() };
        let narrowed = AxisRecord { low: 1.0, ..kind.clone() };
        for (axes, part) in [
            (vec![x.clone(), kind.clone(), y], "no axis `y`"),
            (vec![AxisRecord { unit: "mm".to_string(), ..x.clone() }, kind.clone()], "`mm` there"),
            (vec![AxisRecord { values: "integer".to_string(), ..x.clone() }, kind], "integer there"),
            (vec![x, narrowed], "the values of `kind`"),
        ] {
            let differences = order(&recorded(&axes), &space).unwrap_err();
            assert_eq!(differences.len(), 1, "{differences:?}");
            assert!(differences[0].contains(part), "{part}: {differences:?}");
        }
    }
}
