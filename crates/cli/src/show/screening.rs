//! Text and JSON of an evaluation whose simulations a GPU screens.

use mishandle::evaluation::{Estimate, TwoPhase};
use mishandle::rollout::Axis;
use mishandle::{ResolvedPlan, ScreenedEvaluationOutcome, plural};
use serde_json::{Value, json};

use super::{corners, output, scenario, simulation};

/// Returns the rates, the disagreements of the two engines, and the corners.
pub fn text(axes: &[Axis], outcome: &ScreenedEvaluationOutcome) -> String {
    let report = &outcome.report;
    let percent = |rate: Option<f64>| rate.map_or("-".to_string(), |rate| format!("{:.2}", 100.0 * rate));
    let row = |name: &str, rate: &Estimate| {
        let interval = format!("[{}, {}]", percent(rate.low), percent(rate.high));
        vec![name.to_string(), format!("{} %", percent(rate.value)), interval, rate.n.to_string()]
    };
    let mut rates = vec![["", "value", "95 % interval", "n"].map(String::from).to_vec()];
    rates.push(row("success rate", &report.success_rate()));
    rates.extend(report.strict_success_rate().iter().map(|rate| row("strict success rate", rate)));
    rates.extend(report.dangerous_episode_rate().iter().map(|rate| row("episodes with any danger", rate)));
    let mut text = format!(
        "{}{}\n\nThe rates are from simulations of MuJoCo C and assume nothing of MuJoCo Warp.\n\n{}",
        if report.is_complete { "" } else { "interrupted: the answer is that of the simulations so far\n\n" },
        output::table(&rates),
        output::table(&engines(outcome)),
    );
    if let Some(report) = &outcome.corners {
        text.push_str(&format!("\n\n{}", corners::text(axes, report)));
    }
    text.push_str(&simulation::without_gpu_verdict(report.screened_without_verdict, report.overflows));
    if report.without_verdict > 0 {
        let undecided = plural(report.without_verdict, "simulation");
        text.push_str(&format!("\n\n{undecided} of MuJoCo C without a verdict do not count as successes"));
    }
    text
}

/// Returns what MuJoCo C found in the simulations that it repeated.
fn engines(outcome: &ScreenedEvaluationOutcome) -> Vec<Vec<String>> {
    let report = &outcome.report;
    let columns = [
        ("confirmed failures", Some(report.failures)),
        ("strict failures", report.strict_failures),
        ("dangerous", report.dangerous),
    ];
    let columns: Vec<(&str, TwoPhase)> =
        columns.into_iter().filter_map(|(name, counts)| Some((name, counts?))).collect();
    let counts = report.failures;
    let row = |name: &str, screened: u64, repeated: u64, events: fn(&TwoPhase) -> u64| {
        let mut cells = vec![name.to_string(), screened.to_string(), repeated.to_string()];
        cells.extend(columns.iter().map(|(_, counts)| events(counts).to_string()));
        cells
    };
    let mut header: Vec<String> =
        ["screening by MuJoCo Warp", "simulations", "repeated by MuJoCo C"].map(String::from).to_vec();
    header.extend(columns.iter().map(|(name, _)| (*name).to_string()));
    vec![
        header,
        row("flagged (any violation or no verdict)", counts.flagged, counts.flagged, |counts| {
            counts.flagged_events
        }),
        row("not flagged (audit sample)", counts.trials - counts.flagged, counts.sampled, |counts| {
            counts.sampled_events
        }),
    ]
}

/// Returns the JSON of the simulations of MuJoCo Warp.
pub fn screening(counts: &TwoPhase, without_verdict: u64, overflows: u64) -> Value {
    json!({
        "device": "gpu",
        "simulations": counts.trials,
        "flagged": counts.flagged,
        "without_verdict": without_verdict,
        "overflows": overflows,
    })
}

/// Returns the JSON document.
pub fn document(resolved: &ResolvedPlan, outcome: &ScreenedEvaluationOutcome) -> Value {
    let report = &outcome.report;
    let counts = report.failures;
    let confirmed = |counts: &TwoPhase| json!({ "flagged_events": counts.flagged_events, "audit_sample_events": counts.sampled_events });
    let failures = report.first_failures.iter().map(|failure| {
        json!({
            "number": failure.request.number,
            "scenario": scenario::document(resolved.space.axes(), failure.request.scenario.values()),
            "seed": failure.request.seed.0.to_string(),
            "robustness": failure.robustness.map(output::number),
        })
    });
    json!({
        "is_complete": report.is_complete,
        "success_rate": output::estimate(&report.success_rate()),
        "strict_success_rate": report.strict_success_rate().as_ref().map(output::estimate),
        "dangerous_episode_rate": report.dangerous_episode_rate().as_ref().map(output::estimate),
        "screening": screening(&counts, report.screened_without_verdict, report.overflows),
        "confirmation": {
            "flagged": counts.flagged,
            "audit_sample": counts.sampled,
            "success": confirmed(&report.failures),
            "strict": report.strict_failures.as_ref().map(confirmed),
            "dangerous": report.dangerous.as_ref().map(confirmed),
            "without_verdict": report.without_verdict,
        },
        "corners": outcome
            .corners
            .as_ref()
            .map_or(Value::Null, |report| corners::document(resolved.space.axes(), report)),
        "failures": failures.collect::<Vec<_>>(),
    })
}
