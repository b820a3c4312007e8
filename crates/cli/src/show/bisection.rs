//! A bisection as text, and the command that asks for it.

use std::path::Path;

use mishandle::Plan;
use mishandle::bisect::{BisectionPlan, BisectionTest};
use mishandle::plan::assignments;
use mishandle::results::{BisectedCandidate, BisectedResult, Bisection};
use mishandle_text::{plural, shell_path, shell_quote};

use super::{escape, output};

/// Returns the command that asks a question, with the plan as keys.
pub fn command(plan: &BisectionPlan) -> String {
    let path = |path: &Path| shell_path(path);
    let controllers = path(&plan.controllers);
    let mut words = vec!["mishandle regress".to_string()];
    match &plan.test {
        BisectionTest::Counterexamples(tests) => {
            words.extend([path(tests), format!("--first-bad {controllers}")]);
        }
        BisectionTest::Rate(asked) => {
            let rate = asked.evaluate.as_ref().and_then(|evaluate| evaluate.rate).unwrap_or_default();
            words.push(format!("--first-bad {controllers} --rate {rate}"));
            let keys = asked_keys(asked, rate).into_iter();
            words.extend(keys.map(|(key, text)| format!("-k {}", shell_quote(&format!("{key}={text}")))));
        }
    }
    words.extend(plan.every.then(|| "-k regress.every=true".to_string()));
    let is_default = plan.folder == Path::new(BisectionPlan::FOLDER);
    words.extend((!is_default).then(|| format!("--out {}", path(&plan.folder))));
    words.join(" ")
}

/// Returns the keys of a plan that the test by a rate does not set itself.
fn asked_keys(asked: &Plan, rate: f64) -> Vec<(String, String)> {
    let Ok(BisectionTest::Rate(mut base)) = BisectionTest::rate(Plan::new("", ""), rate) else {
        return Vec::new();
    };
    // The number of simulations is always stated: its default depends on the other keys.
    if let Some(evaluate) = &mut base.evaluate {
        evaluate.episodes = 0;
    }
    assignments(asked, &base)
}

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
            candidate.result.to_string(),
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
            found.first_bad.as_ref() == Some(&candidate.name) || candidate.result == BisectedResult::Undecided
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
