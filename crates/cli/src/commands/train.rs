use std::time::{Duration, Instant};

use anyhow::{Result, bail};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use mishandle::training::{Flow, Progress};
use mishandle::{TrainPlan, default_out};
use serde_json::{Value, json};

use crate::output::{self, number, shows_progress};
use crate::{Outcome, args, interrupt, run};

/// Without a terminal, a line is written this often.
const QUIET: Duration = Duration::from_secs(30);

pub fn run(command: &args::Train) -> Result<Outcome> {
    run::set_threads(command.run.threads)?;
    let seed = command.run.seed.unwrap_or(0);
    let plan = TrainPlan {
        task: command.task.clone(),
        algorithm: command.algorithm.clone(),
        reward: command.reward.clone(),
        settings: command.settings.clone(),
        steps: command.steps,
        seed,
        out: command.out.clone().unwrap_or_else(|| default_out(&command.task, &command.algorithm, seed)),
        resume: command.resume,
    };
    if command.dry_run {
        return dry_run(&plan, command.run.json);
    }
    let taken = [plan.out.clone(), plan.checkpoint()].into_iter().find(|path| path.exists());
    if let (Some(path), false) = (taken, plan.resume) {
        bail!("{} exists already; give another --out, or --resume to carry on", path.display());
    }
    let line = live_line();
    let shown = line.clone();
    interrupt::listen(move || {
        shown.suspend(|| output::say("finishing the iteration that has begun; Ctrl-C again ends at once"));
    })?;
    let mut last = Instant::now();
    let trained = mishandle::train(&plan, |progress| {
        line.set_message(progress.to_string());
        line.tick();
        if !shows_progress() && (progress.validation_is_fresh && last.elapsed() > QUIET) {
            output::say(&progress.to_string());
            last = Instant::now();
        } else if shows_progress() && progress.validation_is_fresh {
            line.println(curve_line(progress));
        }
        if interrupt::asked() { Flow::Stop } else { Flow::Continue }
    })?;
    line.finish_and_clear();
    let out = mishandle::shell_word(&plan.out.to_string_lossy());
    if interrupt::asked() {
        output::say(&format!("interrupted after {} environment steps", trained.environment_steps));
        output::say(&format!("Carry on: {} --out {out} --resume", plan.command()));
        return Ok(Outcome::Interrupted);
    }
    if let Some(asked) = plan.steps.filter(|asked| trained.environment_steps > *asked) {
        output::say(&format!("--steps {asked} was rounded up to whole iterations"));
    }
    if command.run.json {
        let found = trained.best_validation;
        output::json(&json!({
            "task": plan.task,
            "algorithm": plan.algorithm,
            "seed": plan.seed.to_string(),
            "environment_steps": trained.environment_steps,
            "best_environment_steps": trained.best_environment_steps,
            "success_rate": found.map(|found| number(found.success_rate)),
            "strict_success_rate": found.map(|found| number(found.strict_success_rate)),
            "controller_hash": trained.best.hash(),
        }))?;
    } else {
        let rate = trained.environment_steps as f64 / trained.wall_clock_secs;
        output::line(&format!(
            "{} environment steps in {:.0} s, {rate:.0} a second",
            trained.environment_steps, trained.wall_clock_secs
        ))?;
        if let Some(found) = trained.best_validation {
            output::line(&format!(
                "best on validation: success {:.1} %, strict {:.1} %, after {} steps",
                100.0 * found.success_rate,
                100.0 * found.strict_success_rate,
                trained.best_environment_steps
            ))?;
        }
    }
    output::say(&format!("The controller is in {}", plan.out.display()));
    output::say(&format!("Measure it: mishandle evaluate {} --controller {}", plan.task, out));
    Ok(Outcome::Done)
}

/// Says what would be trained.
fn dry_run(plan: &TrainPlan, as_json: bool) -> Result<Outcome> {
    let facts = mishandle::training_facts(plan)?;
    if !as_json {
        output::line(facts.settings.trim_end())?;
        return Ok(Outcome::Done);
    }
    let formats: Value =
        facts.formats.iter().map(|(kind, version)| ((*kind).to_string(), json!(version))).collect();
    output::json(&json!({
        "task": plan.task,
        "algorithm": plan.algorithm,
        "reward": plan.reward,
        "seed": plan.seed.to_string(),
        "command": plan.command(),
        "settings": facts.settings,
        "task_hash": facts.task_hash,
        "layout_hash": facts.layout_hash,
        "formats": formats,
    }))?;
    Ok(Outcome::Done)
}

/// A line on stderr that is written over, if somebody can watch it.
fn live_line() -> ProgressBar {
    let target = if shows_progress() { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
    let line = ProgressBar::with_draw_target(None, target);
    if let Ok(style) = ProgressStyle::with_template("{spinner} {elapsed} {msg}") {
        line.set_style(style);
    }
    line
}

/// A validation as a line of the learning curve: a bar for success, full of strict success.
fn curve_line(progress: &Progress) -> String {
    const WIDTH: f64 = 40.0;
    let (success, strict) =
        progress.validation.map_or((0.0, 0.0), |found| (found.success_rate, found.strict_success_rate));
    let strict_cells = (WIDTH * strict).round() as usize;
    let success_cells = ((WIDTH * success).round() as usize).max(strict_cells);
    format!(
        "{:>9} steps |{}{}{}| success {:5.1} %  strict {:5.1} %",
        progress.steps_done(),
        "#".repeat(strict_cells),
        "-".repeat(success_cells - strict_cells),
        " ".repeat(WIDTH as usize - success_cells),
        100.0 * success,
        100.0 * strict
    )
}
