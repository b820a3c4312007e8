use anyhow::{Result, bail, ensure};
use clap::Args;
use mishandle::evaluation::Estimate;
use mishandle::plan::{EvaluatePlan, StartRegion};
use mishandle::run::{Answer, Device, EvaluationOutcome, ScreenedEvaluationOutcome};
use mishandle::store::RunKind;
use mishandle::{Plan, ResolvedPlan};
use serde_json::{Value, json};

use crate::{ExitStatus, args, corners, numbers, output, question, run, screened_text};

/// Evaluate a controller: success rate, dangerous behavior rate and completion time, with 95 % intervals
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle evaluate point-reaching --controller ppo --episodes 1000
  mishandle evaluate point-reaching --controller ppo --episodes 1000 --action-noise 0.5
  mishandle evaluate point-reaching --controller my_controller.safetensors --json")]
pub struct Arguments {
    #[command(flatten)]
    pub subject: args::Subject,
    /// Number of random initial states; the corners and the center of the initial box are simulated as well [default: 100]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u64>(Plan::EPISODES))]
    #[arg(conflicts_with = "resume")]
    pub episodes: Option<u64>,
    /// Region of the initial states: whole, or reachable (the part of the box from which the task is feasible)
    /// [default: whole]
    #[arg(long = "box", value_name = "PART", conflicts_with = "resume")]
    pub starts: Option<String>,
    #[command(flatten)]
    pub screen: args::Screen,
    #[command(flatten)]
    pub file: args::OpenRun,
    #[command(flatten)]
    pub run: args::Run,
}

pub fn run(command: &Arguments, gpu: Option<&Device>) -> Result<ExitStatus> {
    run::set_threads(command.run.threads)?;
    let asked = question::ask(RunKind::Evaluate, &command.subject, &command.file, gpu, || plan(command))?;
    let (resolved, is_complete) = (&asked.resolved, asked.answer.is_complete());
    let (has_result, has_verdict) = match &asked.answer {
        Answer::Evaluation(found) => {
            if command.run.json {
                output::json(document(resolved, found, &asked.path))?;
            } else if is_complete {
                output::line(&text(resolved, found))?;
            }
            let report = &found.report;
            let without = report.diverged + report.invalid + report.undecided;
            (true, without < report.simulations)
        }
        Answer::ScreenedEvaluation(found) => {
            let (report, has_result) = (&found.report, found.report.failures.trials > 0);
            if command.run.json {
                output::json(screened_document(resolved, found, &asked.path))?;
            } else if has_result {
                let text = screened_text::text(resolved.space.axes(), found);
                output::line(&format!("{}\n\n{text}", heading(resolved)))?;
            }
            asked.report_screening(report.failures.trials, report.confirmed());
            (has_result, report.without_verdict < report.confirmed())
        }
        _ => bail!("the answer is that of another question"),
    };
    if let Some(status) = asked.report_file() {
        return Ok(status);
    }
    if starts(&resolved.plan) == StartRegion::Reachable && !mishandle::run::rejects_scenarios(resolved) {
        output::message(
            "note: no initial state was rejected as unreachable: --box whole gives the same result",
        );
    }
    // Exit status 0 would say that the success rate was measured.
    ensure!(
        has_result && has_verdict,
        "no simulation has a verdict, so the controller was not tested; the run file contains the end of each simulation"
    );
    Ok(ExitStatus::Done)
}

fn plan(command: &Arguments) -> Result<Plan> {
    let mut plan = run::plan(&command.subject, &command.run)?;
    let mut evaluate = plan.evaluate.take().unwrap_or_default();
    evaluate.episodes = command.episodes.unwrap_or(evaluate.episodes);
    evaluate.batch = command.subject.batch.unwrap_or(evaluate.batch);
    if let Some(starts) = &command.starts {
        evaluate.starts = match starts.as_str() {
            "whole" => StartRegion::Whole,
            "reachable" => StartRegion::Reachable,
            other => anyhow::bail!("--box is `{other}`; it must be whole or reachable"),
        };
    }
    plan.evaluate = Some(EvaluatePlan { ..evaluate });
    plan.screening = command.screen.plan(plan.screening.take())?;
    Ok(plan.only(RunKind::Evaluate))
}

fn starts(plan: &Plan) -> StartRegion {
    plan.evaluate.as_ref().map_or(StartRegion::Whole, |evaluate| evaluate.starts)
}

/// Returns the JSON document of the run.
pub fn document(resolved: &ResolvedPlan, outcome: &EvaluationOutcome, path: &str) -> Value {
    let report = &outcome.report;
    let mut own = json!({
        "is_complete": outcome.is_complete,
        "simulations": report.simulations,
        "diverged": report.diverged,
        "invalid": report.invalid,
        "failed": report.failed,
        "undecided": report.undecided,
        "success_rate": output::estimate(&report.success_rate),
    });
    let optional = [
        ("strict_success_rate", &report.strict_success_rate),
        ("dangerous_behavior_rate", &report.dangerous_behavior_rate),
        ("dangerous_episode_rate", &report.dangerous_episode_rate),
        ("task_completion_time", &report.task_completion_time),
    ];
    for (key, estimate) in optional {
        if let Some(estimate) = estimate {
            own[key] = output::estimate(estimate);
        }
    }
    own["corners"] = outcome
        .corners
        .as_ref()
        .map_or(Value::Null, |report| corners::document(resolved.space.axes(), report));
    output::joined(run::document(resolved, path), output::joined(region(resolved), own))
}

/// Returns the JSON document of a screened run.
pub fn screened_document(resolved: &ResolvedPlan, outcome: &ScreenedEvaluationOutcome, path: &str) -> Value {
    let own = output::joined(region(resolved), screened_text::document(resolved, outcome));
    output::joined(run::document(resolved, path), own)
}

/// Returns the JSON of the region of the initial states.
fn region(resolved: &ResolvedPlan) -> Value {
    json!({ "box": starts(&resolved.plan), "leaves_out_starts": mishandle::run::rejects_scenarios(resolved) })
}

/// Returns the first line of the result.
fn heading(resolved: &ResolvedPlan) -> String {
    let part = match starts(&resolved.plan) {
        StartRegion::Whole => "",
        StartRegion::Reachable => ", initial states from the reachable part of the box",
    };
    format!("{}{part}", run::heading(resolved))
}

fn text(resolved: &ResolvedPlan, outcome: &EvaluationOutcome) -> String {
    let report = &outcome.report;
    // A single value has a mean, but no confidence interval.
    let cells = |estimate: &Estimate, value: &dyn Fn(f64) -> String, end: &dyn Fn(f64) -> String| {
        let interval =
            estimate.low.zip(estimate.high).map(|(low, high)| format!("[{}, {}]", end(low), end(high)));
        [estimate.value.map_or("-".to_string(), value), interval.unwrap_or("-".to_string())]
    };
    let percentage = |rate: f64| format!("{:.2}", 100.0 * rate);
    let percent =
        |estimate: &Estimate| cells(estimate, &|rate| format!("{} %", percentage(rate)), &percentage);
    let steps = |estimate: &Estimate| {
        let value =
            |steps: f64| format!("{steps:.1} control steps ({:.2} s)", steps * resolved.target.control_dt);
        cells(estimate, &value, &|steps| format!("{steps:.1}"))
    };
    let row = |name: &str, estimate: &Estimate, cells: &dyn Fn(&Estimate) -> [String; 2]| {
        let [value, interval] = cells(estimate);
        vec![name.to_string(), value, interval, estimate.n.to_string()]
    };
    let mut rows = vec![["", "value", "95 % interval", "n"].map(String::from).to_vec()];
    rows.push(row("success rate", &report.success_rate, &percent));
    rows.extend(report.strict_success_rate.iter().map(|rate| row("strict success rate", rate, &percent)));
    rows.extend(
        report.dangerous_behavior_rate.iter().map(|rate| row("dangerous behavior rate", rate, &percent)),
    );
    rows.extend(
        report.dangerous_episode_rate.iter().map(|rate| row("episodes with any danger", rate, &percent)),
    );
    rows.extend(report.task_completion_time.iter().map(|time| row("task completion time", time, &steps)));
    let mut text = format!("{}\n\n{}", heading(resolved), output::table(&rows));
    if let Some(report) = &outcome.corners {
        text.push_str(&format!("\n\n{}", corners::text(resolved.space.axes(), report)));
    }
    if let Some(counts) =
        run::without_verdict(report.diverged, report.invalid, report.failed, report.undecided)
    {
        text.push_str(&format!("\n\n{counts}; they do not count as successes"));
    }
    text
}
