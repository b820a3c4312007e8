use anyhow::Result;
use mishandle::evaluation::{Estimate, Report};
use mishandle::tasks::CONTROL_DT;
use mishandle::{EvaluatePlan, Plan, Starts, Subject};
use serde_json::{Value, json};

use crate::output::{self, number};
use crate::{Outcome, args, progress, run};

pub fn run(command: &args::Evaluate) -> Result<Outcome> {
    run::set_threads(command.run.threads)?;
    let bar = progress::bar(0, "simulations");
    run::end_on_signals(&bar)?;
    let moved = command.subject.controller.as_deref();
    let (plan, subject, file) =
        run::open(command.resume.as_deref(), moved, command.out.as_deref(), || plan(command))?;
    let name = run::name(file.file());
    let episodes = plan.evaluate.as_ref().map_or(0, |evaluate| evaluate.episodes);
    bar.set_length(episodes);
    let report = mishandle::evaluate(&plan, &subject, file, |done| {
        bar.set_position(done);
        run::flow()
    })?;
    bar.finish_and_clear();
    if report.simulations < episodes {
        run::say_interrupted("evaluate", report.simulations, &name);
        return Ok(Outcome::Interrupted);
    }
    if command.run.json {
        output::json(&document(&plan, &subject, &report))?;
    } else {
        output::line(&text(&plan, &report))?;
    }
    if starts(&plan) == Starts::Reachable && !mishandle::leaves_out_starts(&plan, &subject) {
        output::say("no part of the box is proven out of reach: these are starts of the whole box");
    }
    output::say(&format!("Every simulation is in {name}"));
    Ok(Outcome::Done)
}

fn plan(command: &args::Evaluate) -> Result<Plan> {
    let mut plan = run::plan(&command.subject, &command.run)?;
    let mut evaluate = plan.evaluate.take().unwrap_or_default();
    evaluate.episodes = command.episodes.unwrap_or(evaluate.episodes);
    if let Some(starts) = &command.starts {
        evaluate.starts = match starts.as_str() {
            "whole" => Starts::Whole,
            "reachable" => Starts::Reachable,
            other => anyhow::bail!("--box is `{other}`; it has to be whole or reachable"),
        };
    }
    plan.falsify = None;
    plan.evaluate = Some(EvaluatePlan { ..evaluate });
    Ok(plan)
}

fn starts(plan: &Plan) -> Starts {
    plan.evaluate.as_ref().map_or(Starts::Whole, |evaluate| evaluate.starts)
}

fn document(plan: &Plan, subject: &Subject, report: &Report) -> Value {
    let estimate = |estimate: &Estimate| {
        let value = |value: Option<f64>| value.map_or(Value::Null, number);
        json!({
            "value": value(estimate.value),
            "low": value(estimate.low),
            "high": value(estimate.high),
            "n": estimate.n,
        })
    };
    json!({
        "task": plan.task,
        "preset": plan.preset,
        "controller": mishandle::controller_name(&plan.controller),
        "controller_hash": subject.controller_hash,
        "stochastic": plan.stochastic,
        "action_noise": plan.action_noise,
        "observation_noise": plan.observation_noise,
        "seed": plan.seed.to_string(),
        "box": starts(plan),
        "leaves_out_starts": mishandle::leaves_out_starts(plan, subject),
        "simulations": report.simulations,
        "diverged": report.diverged,
        "undecided": report.undecided,
        "success_rate": estimate(&report.success_rate),
        "strict_success_rate": estimate(&report.strict_success_rate),
        "dangerous_behavior_rate": estimate(&report.dangerous_behavior_rate),
        "task_completion_time": estimate(&report.task_completion_time),
    })
}

fn text(plan: &Plan, report: &Report) -> String {
    // A single number has a mean, but says nothing of its spread.
    let cells = |estimate: &Estimate, value: &dyn Fn(f64) -> String, end: &dyn Fn(f64) -> String| {
        let interval =
            estimate.low.zip(estimate.high).map(|(low, high)| format!("[{}, {}]", end(low), end(high)));
        [estimate.value.map_or("-".to_string(), value), interval.unwrap_or("-".to_string())]
    };
    let hundredth = |share: f64| format!("{:.2}", 100.0 * share);
    let percent =
        |estimate: &Estimate| cells(estimate, &|share| format!("{} %", hundredth(share)), &hundredth);
    let steps = |estimate: &Estimate| {
        let value = |steps: f64| format!("{steps:.1} control steps ({:.2} s)", steps * CONTROL_DT);
        cells(estimate, &value, &|steps| format!("{steps:.1}"))
    };
    let row = |name: &str, [value, interval]: [String; 2], n: u64| {
        vec![name.to_string(), value, interval, n.to_string()]
    };
    let rows = vec![
        ["", "value", "95 % interval", "n"].map(String::from).to_vec(),
        row("success rate", percent(&report.success_rate), report.success_rate.n),
        row("strict success rate", percent(&report.strict_success_rate), report.strict_success_rate.n),
        row(
            "dangerous behavior rate",
            percent(&report.dangerous_behavior_rate),
            report.dangerous_behavior_rate.n,
        ),
        row("task completion time", steps(&report.task_completion_time), report.task_completion_time.n),
    ];
    let mut text = format!(
        "{}, controller {}, task preset {}{}{}\n\n{}",
        plan.task,
        plan.controller,
        plan.preset,
        match starts(plan) {
            Starts::Whole => "",
            Starts::Reachable => ", starts from the reachable part of the box",
        },
        noise(plan),
        output::table(&rows)
    );
    if report.diverged + report.undecided > 0 {
        text.push_str(&format!(
            "\n\n{} simulations diverged, {} were undecided; neither counts as a success.",
            report.diverged, report.undecided
        ));
    }
    text
}

/// What is out of the ordinary about the plan, for a heading.
pub fn noise(plan: &Plan) -> String {
    let mut text = String::new();
    if plan.action_noise > 0.0 {
        text.push_str(&format!(", action noise {}", plan.action_noise));
    }
    if plan.observation_noise > 0.0 {
        text.push_str(&format!(", observation noise {}", plan.observation_noise));
    }
    if plan.stochastic {
        text.push_str(", sampled actions");
    }
    text
}
