use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::Result;
use mishandle::training::{Flow, RunSettings};
use mishandle::{CurveRow, TrainPlan, TrainReport, default_out};
use serde_json::{Value, json};

use crate::live_curve::LiveCurve;
use crate::output::{self, number, shows_progress};
use crate::{Outcome, args, interrupt, run};

/// Without a terminal, a line is written this often.
const QUIET: Duration = Duration::from_secs(30);

pub fn run(command: &args::Train) -> Result<Outcome> {
    run::set_threads(command.run.threads)?;
    let plan = plan(command);
    if command.dry_run {
        return dry_run(&plan, command.run.json);
    }
    let live = LiveCurve::new();
    let shown = live.clone();
    interrupt::listen(move || {
        shown.suspend(|| output::say("finishing the iteration that has begun; Ctrl-C again ends at once"));
    })?;
    let mut iterations = 0_u64;
    let mut last = Instant::now();
    let report = mishandle::train(&plan, |progress| {
        iterations += 1;
        live.show(progress);
        if !shows_progress() && progress.validation_is_fresh && last.elapsed() > QUIET {
            output::say(&progress.to_string());
            last = Instant::now();
        }
        if interrupt::asked() { Flow::Stop } else { Flow::Continue }
    });
    live.finish();
    let report = report?;
    let trained = &report.trained;
    if interrupt::asked() && !report.has_ended() {
        output::say(&format!("interrupted after {} environment steps", trained.environment_steps));
        output::say(&format!("Carry on: {}", plan.resuming_command()));
        return Ok(Outcome::Interrupted);
    }
    if let Some(asked) =
        plan.steps.filter(|asked| !report.stopped_early() && trained.environment_steps > *asked)
    {
        output::say(&format!("--steps {asked} was rounded up to whole iterations"));
    }
    if iterations == 0 {
        output::say("nothing was left to do: the training had come to its end before");
    }
    if command.run.json {
        output::json(&document(&plan, &report))?;
    } else {
        for line in lines(&report) {
            output::line(&line)?;
        }
    }
    say_places(&plan);
    Ok(Outcome::Done)
}

/// Says what would be trained.
fn dry_run(plan: &TrainPlan, as_json: bool) -> Result<Outcome> {
    let facts = mishandle::training_facts(plan)?;
    let total_steps = facts.config.run().total_steps;
    if !as_json {
        let TrainPlan { task, algorithm, reward, seed, .. } = plan;
        output::line(&format!("# task {task}, algorithm {algorithm}, reward {reward}, seed {seed}"))?;
        output::line(&format!("# {total_steps} environment steps, to {}", plan.out.display()))?;
        output::line(&format!("# {}\n", plan.command()))?;
        output::line(facts.config.listing().trim_end())?;
        return Ok(Outcome::Done);
    }
    let formats: Value =
        facts.formats.iter().map(|(kind, version)| ((*kind).to_string(), json!(version))).collect();
    output::json(&json!({
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
    Ok(Outcome::Done)
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
    let TrainReport { trained, config, flat_after } = report;
    let rate = trained.environment_steps as f64 / trained.wall_clock_secs;
    let mut lines = vec![format!(
        "{} environment steps in {:.0} s, {rate:.0} a second",
        trained.environment_steps, trained.wall_clock_secs
    )];
    if report.stopped_early() {
        lines.push(format!("stopped early: {}", contentment(config.run())));
    }
    if let Some(row) = flat_after {
        lines.push(format!(
            "training time, until the return is flat: {} environment steps, {} control steps of each environment, {:.0} s",
            row.environment_steps,
            row.control_steps(config.episodes().environments),
            row.wall_clock_secs
        ));
    }
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

/// What the settings wanted of validations, and found.
fn contentment(run: &RunSettings) -> String {
    let wanted =
        |name: &str, rate: Option<f64>| rate.map(|rate| format!("{name} at least {} %", 100.0 * rate));
    let rates = [wanted("success", run.stop_success), wanted("strict success", run.stop_strict)];
    let rates: Vec<String> = rates.into_iter().flatten().collect();
    format!("{} in {} validations in a row", rates.join(" and "), run.stop_validations)
}

fn document(plan: &TrainPlan, report: &TrainReport) -> Value {
    let TrainReport { trained, config, flat_after } = report;
    let found = trained.best_validation;
    let place = |path: &Path| path.to_string_lossy().into_owned();
    let environments = config.episodes().environments;
    let training_time = |row: &CurveRow| {
        json!({
            "environment_steps": row.environment_steps,
            "control_steps": row.control_steps(environments),
            "secs": number(row.wall_clock_secs),
        })
    };
    json!({
        "task": plan.task,
        "algorithm": plan.algorithm,
        "seed": plan.seed.to_string(),
        "environments": environments,
        "environment_steps": trained.environment_steps,
        "best_environment_steps": trained.best_environment_steps,
        "wall_clock_secs": number(trained.wall_clock_secs),
        "stopped_early": report.stopped_early(),
        "training_time": flat_after.as_ref().map(training_time),
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
    output::say(&format!(
        "The best controller is in {}, the last in {}",
        plan.out.display(),
        plan.last().display()
    ));
    if let Some(csv) = &plan.csv {
        output::say(&format!("The training's curve is in {}", csv.display()));
    }
    if let Some(folder) = &plan.tensorboard {
        let folder = mishandle::shell_word(&folder.to_string_lossy());
        output::say(&format!("Look at it: tensorboard --logdir {folder}"));
    }
    // A bare word would be taken for the name of a shipped controller.
    let is_bare = plan.out.components().count() == 1 && plan.out.extension().is_none();
    let out = if is_bare { Path::new(".").join(&plan.out) } else { plan.out.clone() };
    let out = mishandle::shell_word(&out.to_string_lossy());
    output::say(&format!("Measure it: mishandle evaluate {} --controller {out}", plan.task));
}
