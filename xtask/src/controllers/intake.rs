//! Takes in what was trained, here or elsewhere: checks it, measures it, puts it in its place.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use serde_json::Value;

use super::curve::Curve;
use super::facts::{Facts, Wanted, file_hash, keys};
use super::home::write;
use super::measure::{Bench, Candidate, remove};
use super::plan::Training;
use super::record::Record;
use super::state::{Standing, State, differences};

/// Takes in a controller and the curve of its training. What says that it is done comes last: the controller's file, and of
/// further seeds, whose file is where it was trained, the record.
///
/// # Errors
/// If the training was another one, was not finished, or its controller cannot be measured: nothing is put in place then.
pub fn take_in(
    bench: &Bench<'_>,
    task: &Value,
    training: &Training,
    wanted: &Wanted,
    controller: &Path,
    csv: &Path,
) -> Result<()> {
    let mut facts = Facts::of_file(controller)?;
    let found = differences(bench.program, training, wanted, &mut facts, false);
    let told: Vec<String> = found.iter().map(ToString::to_string).collect();
    ensure!(found.is_empty(), "{} is refused: {}", controller.display(), told.join("; "));
    let curve = Curve::read(csv)?;
    is_finished(&curve, facts.text("settings")).with_context(|| csv.display().to_string())?;
    let settings = keys(facts.text("settings"));
    let environments = settings.get("episodes.environments").context("the settings have no environments")?;
    facts.0["training_time"] = bench.program.training_time(csv, environments)?;
    facts.0["trained_steps"] = curve.rows.last().map(|row| row.environment_steps).into();
    let record = measured(bench, task, training, &facts, controller)?;
    write(&bench.home.curve(training), curve.text().as_bytes())?;
    record.save(bench.home)?;
    let place = bench.home.controller(training);
    if place != controller {
        let bytes = fs::read(controller).with_context(|| controller.display().to_string())?;
        write(&place, &bytes)?;
    }
    Ok(())
}

/// Measures a controller that is in its place. If it was put there by hand, a curve that is there is another training's.
///
/// # Errors
/// If it cannot be measured.
pub fn measure_again(bench: &Bench<'_>, task: &Value, standing: &Standing) -> Result<()> {
    let training = &standing.training;
    let facts = standing.facts.as_ref().context("there is no controller to measure")?;
    let record = measured(bench, task, training, facts, &bench.home.controller(training))?;
    if standing.record.as_ref().is_none_or(|old| old.file_hash() != record.file_hash()) {
        remove(&bench.home.curve(training))?;
    }
    record.save(bench.home)
}

fn measured(
    bench: &Bench<'_>,
    task: &Value,
    training: &Training,
    facts: &Facts,
    controller: &Path,
) -> Result<Record> {
    let hash = file_hash(controller)?;
    let found = bench.measure(&Candidate {
        task,
        task_hash: facts.text("task_hash"),
        controller: controller.to_string_lossy().into_owned(),
        falsifies: training.is_falsified(),
        name: format!("{}.measure", training.name()),
    })?;
    Ok(Record::trained(&training.task, &training.controller(), facts, &hash, found))
}

/// Measures the expert of a task.
///
/// # Errors
/// If it cannot be measured.
pub fn measure_expert(bench: &Bench<'_>, task: &Value, task_hash: &str) -> Result<()> {
    let name = task["name"].as_str().unwrap_or_default();
    let found = bench.measure(&Candidate {
        task,
        task_hash,
        controller: "expert".to_string(),
        falsifies: false,
        name: format!("{name}-expert.measure"),
    })?;
    Record::untrained(name, "expert", found).save(bench.home)
}

/// Takes in the finished trainings of a folder that the plan still lacks, and says what it refuses.
///
/// # Errors
/// If any was refused.
pub fn import(bench: &Bench<'_>, folder: &Path, tasks: &[Value], standings: &[Standing]) -> Result<()> {
    let (mut taken, mut refused) = (0, 0);
    for standing in standings {
        let training = &standing.training;
        let file = |ending: &str| folder.join(training.name() + ending);
        if !file(".safetensors").is_file() {
            continue;
        }
        // One without a curve, as it may have been put there by hand, can still be given one.
        if standing.state == State::Done && bench.home.curve(training).is_file() {
            eprintln!("{}: there already", training.name());
            continue;
        }
        let task = tasks.iter().find(|task| task["name"] == training.task.as_str());
        let task = task.context("a training without a task")?;
        match take_in(bench, task, training, &standing.wanted, &file(".safetensors"), &file(".csv")) {
            Ok(()) => taken += 1,
            Err(error) => {
                refused += 1;
                eprintln!("{}: {error:#}", training.name());
                continue;
            }
        }
        eprintln!("{}: taken in", training.name());
    }
    for name in others(folder, standings)? {
        eprintln!("{name}: there is no such training in the plan");
    }
    eprintln!("{taken} taken in, {refused} refused");
    match refused {
        0 => Ok(()),
        _ => bail!("{refused} of the trainings in {} were refused", folder.display()),
    }
}

/// Controllers in a folder that are of no training asked for; the last ones beside the best are left out too.
fn others(folder: &Path, standings: &[Standing]) -> Result<Vec<String>> {
    let mut names = Vec::new();
    for entry in fs::read_dir(folder).with_context(|| folder.display().to_string())? {
        let path = entry?.path();
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let is_known = standings.iter().any(|standing| standing.training.name() == name);
        if path.extension().is_some_and(|ending| ending == "safetensors")
            && !is_known
            && !name.ends_with(".last")
        {
            names.push(name);
        }
    }
    names.sort();
    Ok(names)
}

/// Checks that a curve goes to the end of its training: to all its steps, or to enough good validations in a row.
fn is_finished(curve: &Curve, settings: &str) -> Result<()> {
    let settings = keys(settings);
    let setting = |key: &str| settings.get(&format!("run.{key}")).and_then(|value| value.parse::<f64>().ok());
    let total = setting("total_steps").context("the settings have no `run.total_steps`")?;
    let last = curve.rows.last().context("it has no rows")?;
    if last.environment_steps as f64 >= total {
        return Ok(());
    }
    let wanted = [setting("stop_success"), setting("stop_strict")];
    let streak = curve.rows.iter().rev().filter(|row| row.success_rate.is_some()).take_while(|row| {
        let reached =
            |wanted: Option<f64>, rate: Option<f64>| wanted.is_none_or(|wanted| rate >= Some(wanted));
        reached(wanted[0], row.success_rate) && reached(wanted[1], row.strict_success_rate)
    });
    let needed = setting("stop_validations").unwrap_or_default();
    ensure!(
        wanted.iter().any(Option::is_some) && streak.count() as f64 >= needed,
        "the training is not finished: it has {} of {total} environment steps",
        last.environment_steps
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(settings: &str, rows: &[(u64, f64)], finished: bool) {
        let text: String =
            rows.iter().map(|(steps, rate)| format!("{steps},1.0,2.0,{rate},{rate},3.0\n")).collect();
        let curve = Curve::parse(&format!("{}\n{text}", super::super::curve::COLUMNS.join(","))).unwrap();
        let found = is_finished(&curve, settings);
        assert_eq!(found.is_ok(), finished, "{settings} {rows:?}: {found:?}");
    }

    #[test]
    fn a_training_ends_with_its_steps_or_after_enough_good_validations() {
        let steps = "[run]\ntotal_steps = 100\n";
        check(steps, &[(64, 1.0), (128, 0.0)], true);
        check(steps, &[(64, 1.0)], false);
        let early = "[run]\ntotal_steps = 100\nstop_success = 0.9\nstop_strict = 0.8\nstop_validations = 2\n";
        check(early, &[(16, 0.95), (32, 0.9)], true);
        check(early, &[(16, 0.95), (32, 0.85), (48, 0.9)], false);
    }
}
