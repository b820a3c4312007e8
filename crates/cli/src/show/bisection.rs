//! A bisection as text.

use mishandle::results::{BisectedCandidate, Bisection};
use mishandle_text::plural;

use super::{escape, output};

/// Returns the tested candidates and the answer.
pub fn text(found: &Bisection) -> String {
    let mut rows =
        vec![["place", "candidate", "result", "success rate", "simulations"].map(String::from).to_vec()];
    let rate = |candidate: &BisectedCandidate| {
        let percent = |value: f64| format!("{:.1} %", 100.0 * value);
        let rate = candidate.success_rate;
        match rate.and_then(|rate| Some((rate.value?, rate.low?, rate.high?))) {
            Some((value, low, high)) => {
                format!("{} [{}, {}]", percent(value), percent(low), percent(high))
            }
            None => "-".to_string(),
        }
    };
    rows.extend(found.tested.iter().map(|candidate| {
        vec![
            candidate.place.to_string(),
            escape::name(&candidate.name),
            candidate.result.clone(),
            rate(candidate),
            candidate.simulations.to_string(),
        ]
    }));
    let mut parts = vec![
        format!("test: {}", escape::name(&found.test)),
        output::table(&rows),
        format!(
            "{} of {} tested, {}",
            found.tested.len(),
            plural(found.candidates.len() as u64, "candidate"),
            plural(found.simulations, "simulation")
        ),
    ];
    let reasons: Vec<String> = found
        .tested
        .iter()
        .filter(|candidate| {
            found.first_bad.as_ref() == Some(&candidate.name) || candidate.result == "undecided"
        })
        .filter_map(|candidate| {
            let reason = escape::name(candidate.reason.as_ref()?);
            Some(format!("{} {}: {reason}", escape::name(&candidate.name), candidate.result))
        })
        .collect();
    if !reasons.is_empty() {
        parts.push(reasons.join("\n"));
    }
    parts.push(escape::name(&found.verdict));
    parts.join("\n\n")
}
