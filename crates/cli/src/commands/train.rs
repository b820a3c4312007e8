use std::path::Path;

use anyhow::{Error, Result, anyhow};
use mishandle::training::RunSettings;
use mishandle::{MishandleError, TrainPlan, TrainReport, default_out};
use serde_json::{Value, json};

use crate::output::{self, number};
use crate::train_watch::{Watch, whole};
use crate::{ExitStatus, args, interrupt, run, training_time};

pub fn run(command: &args::Train) -> Result<ExitStatus> {
    run::set_threads(command.run.threads)?;
    let plan = plan(command);
    if mishandle::uses_default_settings(&plan)? {
        output::message(&format!(
            "note: no settings are shipped for {} with {}: taking the defaults of docs/algorithms/settings.md",
            plan.task, plan.algorithm
        ));
    }
    if command.dry_run {
        return dry_run(&plan, command.run.json);
    }
    let mut watch = Watch::begin(&plan)?;
    let report = mishandle::train(&plan, &mut watch);
    watch.finish();
    let report = report?;
    let trained = &report.trained;
    if interrupt::requested() && !report.has_ended() {
        return Ok(interrupted(&plan, &report));
    }
    if !report.unwritten.is_empty() {
        return Err(unwritten(&plan, &report));
    }
    if let Some(asked) =
        plan.steps.filter(|asked| !report.stopped_early() && trained.environment_steps > *asked)
    {
        output::message(&format!("--steps {asked} was rounded up to whole iterations"));
    }
    if watch.iterations == 0 {
        output::message("nothing was left to do: the training had come to its end before");
    }
    if command.run.json {
        output::json(document(&plan, &report))?;
        if report.training_time.is_err() {
            output::message(&training_time_line(&report));
        }
    } else {
        for line in lines(&report) {
            output::line(&line)?;
        }
    }
    say_places(&plan);
    Ok(ExitStatus::Done)
}

/// Says how far an interrupted training came, and how it goes on: its first checkpoint is there, if no later one.
fn interrupted(plan: &TrainPlan, report: &TrainReport) -> ExitStatus {
    for failure in &report.unwritten {
        output::message(&format!("error: {}", whole(failure)));
    }
    let is_checkpoint = |failure: &MishandleError| matches!(failure, MishandleError::Training(_));
    let lost = match report.unwritten.iter().any(is_checkpoint) {
        true => "; what was learned since the last checkpoint is lost",
        false => "",
    };
    output::message(&format!(
        "interrupted after {} environment steps{lost}",
        report.trained.environment_steps
    ));
    output::message(&format!("Carry on: {}", plan.resuming_command()));
    ExitStatus::Interrupted
}

/// What a training that came to its end could not write, and how it can be made up for.
fn unwritten(plan: &TrainPlan, report: &TrainReport) -> Error {
    let failures: Vec<String> = report.unwritten.iter().map(whole).collect();
    let error = anyhow!(failures.join("; "));
    // Rows that are lost do not come back, but the controllers do.
    match report.unwritten.iter().any(|failure| matches!(failure, MishandleError::Controller(_))) {
        true => anyhow!("{error}\nCarry on once it can be written: {}", plan.resuming_command()),
        false => error,
    }
}

/// Says what would be trained.
fn dry_run(plan: &TrainPlan, as_json: bool) -> Result<ExitStatus> {
    let facts = mishandle::training_facts(plan)?;
    let total_steps = facts.config.run().total_steps;
    if !as_json {
        let TrainPlan { task, algorithm, reward, seed, .. } = plan;
        output::line(&format!("# task {task}, algorithm {algorithm}, reward {reward}, seed {seed}"))?;
        output::line(&format!("# {total_steps} environment steps, to {}", plan.out.display()))?;
        output::line(&format!("# {}\n", plan.whole_command()))?;
        output::line(facts.config.listing().trim_end())?;
        return Ok(ExitStatus::Done);
    }
    let formats: Value =
        facts.formats.iter().map(|(kind, version)| ((*kind).to_string(), json!(version))).collect();
    output::json(json!({
        "task": plan.task,
        "algorithm": plan.algorithm,
        "reward": plan.reward,
        "seed": plan.seed.to_string(),
        "environment_steps": total_steps,
        "command": plan.command(),
        "settings": facts.config.to_toml(),
        "task_hash": facts.task_hash,
        "layout_hash": facts.layout_hash,
        "formats": formats,
    }))?;
    Ok(ExitStatus::Done)
}

fn plan(command: &args::Train) -> TrainPlan {
    let seed = command.run.seed.unwrap_or(0);
    TrainPlan {
        task: command.task.clone(),
        algorithm: command.algorithm.clone(),
        reward: command.reward.clone(),
        settings: command.settings.clone(),
        steps: command.steps,
        seed,
        out: command.out.clone().unwrap_or_else(|| default_out(&command.task, &command.algorithm, seed)),
        csv: command.csv.clone(),
        tensorboard: command.tensorboard.clone(),
        resume: command.resume,
    }
}

/// What came out, for people.
fn lines(report: &TrainReport) -> Vec<String> {
    let TrainReport { trained, config, .. } = report;
    let rate = trained.environment_steps as f64 / trained.wall_clock_secs;
    let mut lines = vec![format!(
        "{} environment steps in {:.0} s, {rate:.0} a second",
        trained.environment_steps, trained.wall_clock_secs
    )];
    if report.stopped_early() {
        lines.push(format!("stopped early: {}", contentment(config.run())));
    }
    lines.push(training_time_line(report));
    if let Some(found) = trained.best_validation {
        lines.push(format!(
            "best on validation: success {:.1} %, strict {:.1} %, after {} steps",
            100.0 * found.success_rate,
            100.0 * found.strict_success_rate,
            trained.best_environment_steps
        ));
    }
    lines
}

fn training_time_line(report: &TrainReport) -> String {
    let environments = report.config.episodes().environments;
    training_time::line(report.training_time.as_ref().map_err(|reason| *reason), Some(environments))
}

/// What the settings wanted of validations, and found.
fn contentment(run: &RunSettings) -> String {
    let wanted =
        |name: &str, rate: Option<f64>| rate.map(|rate| format!("{name} at least {} %", 100.0 * rate));
    let rates = [wanted("success", run.stop_success), wanted("strict success", run.stop_strict)];
    let rates: Vec<String> = rates.into_iter().flatten().collect();
    format!("{} in {} validations in a row", rates.join(" and "), run.stop_validations)
}

fn document(plan: &TrainPlan, report: &TrainReport) -> Value {
    let TrainReport { trained, config, training_time, .. } = report;
    let found = trained.best_validation;
    let place = |path: &Path| path.to_string_lossy().into_owned();
    let environments = config.episodes().environments;
    let training_time = training_time.as_ref().map_err(|reason| *reason);
    json!({
        "task": plan.task,
        "algorithm": plan.algorithm,
        "seed": plan.seed.to_string(),
        "environments": environments,
        "environment_steps": trained.environment_steps,
        "best_environment_steps": trained.best_environment_steps,
        "wall_clock_secs": number(trained.wall_clock_secs),
        "stopped_early": report.stopped_early(),
        "training_time": training_time::document(training_time, Some(environments)),
        "success_rate": found.map(|found| number(found.success_rate)),
        "strict_success_rate": found.map(|found| number(found.strict_success_rate)),
        "controller_hash": trained.best.hash(),
        "best": place(&plan.out),
        "last": place(&plan.last()),
        "csv": plan.csv.as_deref().map(place),
        "tensorboard": plan.tensorboard.as_deref().map(place),
    })
}

fn say_places(plan: &TrainPlan) {
    output::message(&format!(
        "The best controller is in {}, the last in {}",
        plan.out.display(),
        plan.last().display()
    ));
    if let Some(csv) = &plan.csv {
        output::message(&format!("The training's curve is in {}", csv.display()));
    }
    if let Some(folder) = &plan.tensorboard {
        let folder = mishandle::shell_quote(&folder.to_string_lossy());
        output::message(&format!("Look at it: tensorboard --logdir {folder}"));
    }
    // A bare word would be taken for the name of a shipped controller.
    let is_bare = plan.out.components().count() == 1 && plan.out.extension().is_none();
    let out = if is_bare { Path::new(".").join(&plan.out) } else { plan.out.clone() };
    let out = mishandle::shell_quote(&out.to_string_lossy());
    output::message(&format!("Measure it: mishandle evaluate {} --controller {out}", plan.task));
}
