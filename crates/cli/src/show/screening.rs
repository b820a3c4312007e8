//! Screened results, as text: what the other engine flagged, and what MuJoCo C found.

use mishandle::results::{Confirmed, Evaluation, Falsification, Finding, Screening};

use super::{output, simulation};

/// Says what the rates of a screened evaluation assume, and where the two engines disagree.
pub fn evaluation_text(found: &Evaluation, counts: &Screening) -> String {
    let columns =
        [("failure", "failures there"), ("strict_failure", "strict failures"), ("dangerous", "dangerous")];
    let mut text = format!(
        "The rates are from simulations of MuJoCo C and assume nothing of MuJoCo Warp.{}\n\n{}",
        limits(found),
        engines(counts, &columns, ["no success or no verdict", "success"]),
    );
    text.push_str(&simulation::without_gpu_verdict(counts.without_verdict, counts.overflows));
    text
}

/// Says what the audit sample alone finds, and which metrics are missing.
fn limits(found: &Evaluation) -> String {
    let metrics = &found.metrics;
    let others = match (&metrics.strict_success_rate, &metrics.dangerous_episode_rate) {
        (Some(_), Some(_)) => Some("strict success and danger"),
        (Some(_), None) => Some("strict success"),
        (None, Some(_)) => Some("danger"),
        (None, None) => None,
    };
    let sampled = others.map_or(String::new(), |others| {
        format!(
            " A simulation is flagged if it has no success; of the others, the audit sample alone looks for {others}, so these \
             intervals are wider."
        )
    });
    let missing = others
        .map_or("", |_| " Dangerous behavior rate and completion time take MuJoCo C in every simulation.");
    sampled + missing
}

/// Returns a table of what MuJoCo C found in the simulations that it repeated. `columns` are kinds
/// of findings with their titles, `kinds` describe the flagged simulations and the others.
pub fn engines(counts: &Screening, columns: &[(&str, &str)], kinds: [&str; 2]) -> String {
    let findings = |name: &str| counts.findings.as_ref().and_then(|findings| findings.get(name));
    let columns: Vec<(&str, &Finding)> =
        columns.iter().filter_map(|(name, title)| Some((*title, findings(name)?))).collect();
    let row = |name: &str, screened: u64, repeated: u64, found: fn(&Finding) -> u64| {
        let mut cells = vec![name.to_string(), screened.to_string(), repeated.to_string()];
        cells.extend(columns.iter().map(|(_, finding)| found(finding).to_string()));
        cells
    };
    let mut header: Vec<String> =
        ["screened by MuJoCo Warp", "simulations", "repeated by MuJoCo C"].map(String::from).to_vec();
    header.extend(columns.iter().map(|(title, _)| (*title).to_string()));
    let Screening { simulations, flagged, audit_sample, .. } = *counts;
    output::table(&[
        header,
        row(kinds[0], flagged, flagged, |finding| finding.flagged),
        row(kinds[1], simulations - flagged, audit_sample, |finding| finding.audit_sample),
    ])
}

/// Returns the paragraphs about the engines of a screened falsification.
pub fn falsification_text(found: &Falsification) -> String {
    let Some(counts) = &found.screening else { return String::new() };
    let confirmed = |name: &str| {
        let reasons = counts.reasons.as_ref();
        reasons.and_then(|reasons| reasons.get(name)).copied().unwrap_or_default()
    };
    let row = |name: &str, simulations: u64, repeated: Confirmed| {
        [
            name.to_string(),
            simulations.to_string(),
            repeated.simulations.to_string(),
            repeated.violations.to_string(),
        ]
        .to_vec()
    };
    let all = |name: &str, repeated: Confirmed| row(name, repeated.simulations, repeated);
    let table = output::table(&[
        ["screened by MuJoCo Warp", "simulations", "repeated by MuJoCo C", "violations there"]
            .map(String::from)
            .to_vec(),
        all("violated", confirmed("violated")),
        all("no verdict", confirmed("without_verdict")),
        all("lowest of its trial so far", confirmed("lowest")),
        row("others", counts.simulations - counts.flagged, confirmed("audit_sample")),
    ]);
    let without = simulation::without_gpu_verdict(counts.without_verdict, counts.overflows);
    format!("\n\n{table}{without}")
}
