//! Whether the second of two runs is better.

use mishandle_results::{ComparedRun, Comparison, Estimate, GuardFacts, PairedRates};
use mishandle_text::{p_value_text, plural};

use super::subject::file_name;
use super::{Conclusion, Verdict, nothing, percent, points};
use crate::run::compared_without_verdict;

/// Level below which a p-value counts as a difference.
const SIGNIFICANT: f64 = 0.05;

/// Returns what a comparison means.
pub fn comparison(found: &Comparison) -> Verdict {
    let success = &found.success;
    let runs = [&found.first, &found.second];
    let is_open = found.new_violations == 0 && runs.iter().any(|run| run.without_verdict.is_too_large());
    let conclusion = match success.difference.value {
        _ if is_open || !found.has_verdicts() || found.asks_nothing.is_some() => Conclusion::NoVerdict,
        Some(difference) if success.p_value < SIGNIFICANT && difference > 0.0 => Conclusion::Better,
        Some(difference) if success.p_value < SIGNIFICANT && difference < 0.0 => Conclusion::Worse,
        _ => Conclusion::NoDifference,
    };
    let ends: String = compared_without_verdict(found)
        .iter()
        .map(|text| format!("{text}; they do not count as successes. "))
        .collect();
    let left_out = match found.left_out {
        0 => String::new(),
        n => format!("left out: {}, from whose scenario the target cannot start. ", plural(n, "pair")),
    };
    let open =
        if is_open { "too many have no verdict for a conclusion; counted as no success, " } else { "" };
    let headline = format!(
        "{ends}{left_out}{}: {open}{}{}",
        file_name(&found.target),
        found.verdict.trim_end_matches('.'),
        nothing(found.asks_nothing.as_deref())
    );
    let mut verdict = Verdict::new(conclusion, headline);
    verdict.table = table(found);
    verdict.add("A", name(&found.first));
    verdict.add("B", name(&found.second));
    verdict
}

/// Names a run and its controller.
fn name(run: &ComparedRun) -> String {
    let controller = run.controller.as_ref().map(|name| file_name(name));
    let guard = run.guard.as_ref().map(GuardFacts::words);
    let parts = controller.into_iter().chain(guard).chain([run.run.clone()]);
    parts.collect::<Vec<_>>().join(", ")
}

fn table(found: &Comparison) -> Vec<Vec<String>> {
    let rate = |rate: &Estimate| rate.value.map_or("-".to_string(), percent);
    let mut rows = vec![["succeeds", "A", "B", "B - A, points", "p", "n"].map(String::from).to_vec()];
    let rates = [
        ("in the space", Some(&found.success)),
        ("strictly", found.strict_success.as_ref()),
        ("carefully", found.careful_success.as_ref()),
    ];
    for (name, rates) in rates.into_iter().filter_map(|(name, rates)| Some((name, rates?))) {
        let PairedRates { first, second, difference, p_value, .. } = rates;
        rows.push(vec![
            name.to_string(),
            rate(first),
            rate(second),
            points(difference),
            difference.value.map_or("-".to_string(), |_| p_value_text(*p_value)),
            difference.n.to_string(),
        ]);
    }
    if let (Some(first), Some(second)) = (&found.first.nominal, &found.second.nominal) {
        let n = if first.n == second.n { first.n.to_string() } else { format!("{}, {}", first.n, second.n) };
        rows.push(vec![
            "at nominal".to_string(),
            rate(first),
            rate(second),
            "-".to_string(),
            "-".to_string(),
            n,
        ]);
    }
    rows
}
