//! The result of the tuning of a guard, as text.

use mishandle::results::{AlarmLead, Estimate, GuardAlarms, GuardTuning, PairedRates};
use mishandle_text::p_value_text;

use super::{answer, escape, output, subject};

/// Returns the verdict, the alarms and the success rates.
pub fn text(found: &GuardTuning) -> String {
    let mut parts = vec![
        format!(
            "{}{}\nrequirement {}",
            answer::without_verdict(&found.without_verdict, "they do not count as successes"),
            subject::heading(&found.subject),
            escape::name(&found.requirement)
        ),
        found.verdict.clone(),
    ];
    if let Some(guard) = &found.subject.guard {
        let back = guard.return_threshold.map_or(String::new(), |back| format!(", back from {back} on"));
        parts.push(format!(
            "formula of the guard {}\nthreshold {}{back}: the fewest missed failures with at most {:.1} % false alarms",
            escape::name(&guard.formula.split_whitespace().collect::<Vec<_>>().join(" ")),
            guard.threshold.0,
            100.0 * found.false_alarm_limit
        ));
    }
    parts.push(output::table(&alarms(found)));
    parts.extend(found.lead.as_ref().map(lead));
    parts.push(output::table(&successes(found)));
    parts.join("\n\n")
}

fn percent(estimate: &Estimate) -> String {
    match (estimate.value, estimate.low.zip(estimate.high)) {
        (Some(value), Some((low, high))) => {
            format!("{:.1} [{:.1}, {:.1}] %", 100.0 * value, 100.0 * low, 100.0 * high)
        }
        (Some(value), None) => format!("{:.1} %", 100.0 * value),
        _ => "-".to_string(),
    }
}

fn alarms(found: &GuardTuning) -> Vec<Vec<String>> {
    let row = |name: &str, show: &dyn Fn(&GuardAlarms) -> String| {
        vec![name.to_string(), show(&found.training), show(&found.held_out)]
    };
    let area = |estimate: &Estimate| match (estimate.value, estimate.low.zip(estimate.high)) {
        (Some(value), Some((low, high))) => format!("{value:.2} [{low:.2}, {high:.2}]"),
        _ => "-".to_string(),
    };
    vec![
        ["alarms of the watching guard", "training", "held-out"].map(String::from).to_vec(),
        row("failures of the controller", &|alarms| alarms.failures.to_string()),
        row("missed, of the failures", &|alarms| percent(&alarms.missed)),
        row("  of these with a late alarm", &|alarms| alarms.late.to_string()),
        row("successes of the controller", &|alarms| alarms.successes.to_string()),
        row("false alarms, of the successes", &|alarms| percent(&alarms.false_alarms)),
        row("without a verdict", &|alarms| alarms.without_verdict.to_string()),
        row("P(failure below success)", &|alarms| area(&alarms.area)),
    ]
}

fn lead(lead: &AlarmLead) -> String {
    let AlarmLead { n, median, low, high } = lead;
    format!(
        "From the alarm to the certain failure (held-out, n = {n}): median {median:.2} s, 10 to 90 %: {low:.2} to {high:.2} s"
    )
}

fn successes(found: &GuardTuning) -> Vec<Vec<String>> {
    let points = |estimate: &Estimate| match (estimate.value, estimate.low.zip(estimate.high)) {
        (Some(value), Some((low, high))) => {
            format!("{:+.1} [{:+.1}, {:+.1}]", 100.0 * value, 100.0 * low, 100.0 * high)
        }
        _ => "-".to_string(),
    };
    let row = |name: &str, rates: &PairedRates| {
        vec![
            name.to_string(),
            percent(&rates.second),
            points(&rates.difference),
            rates.second_only.to_string(),
            rates.first_only.to_string(),
            p_value_text(rates.p_value),
        ]
    };
    let head = ["held-out scenarios", "success", "difference, points", "saved", "broken", "p"];
    let alone =
        ["controller alone", &percent(&found.guarded.first), "", "", "", ""].map(String::from).to_vec();
    vec![
        head.map(String::from).to_vec(),
        alone,
        row("guarded", &found.guarded),
        row("fallback alone", &found.fallback),
    ]
}
