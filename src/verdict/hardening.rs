//! Whether a hardening made a controller better.

use mishandle_results::{Estimate, HardenedMeasure, Hardening};
use mishandle_text::{p_value_text, plural};

use super::subject::file_name;
use super::{Conclusion, Verdict, percent, points, undecided};

/// Returns what a hardening means.
pub fn hardening(found: &Hardening) -> Verdict {
    let conclusion = match &found.after {
        _ if found.without_verdict.is_too_large() => Conclusion::NoVerdict,
        Some(_) => Conclusion::Better,
        None => Conclusion::NoDifference,
    };
    let undecided = undecided(&found.without_verdict, "they do not count as successes");
    let guard = found.guard.as_ref().map_or(String::new(), |guard| format!(" and {}", guard.words()));
    let subject = format!(
        "{} with {}{guard} (space {})",
        file_name(&found.target),
        file_name(&found.before),
        found.space
    );
    let mut verdict = Verdict::new(conclusion, format!("{undecided}{subject}: {}", found.verdict));
    verdict.table = table(found);
    verdict.add(
        "searches",
        match &found.searches[..] {
            [before, after, ..] => format!(
                "find {} before and {} after, with {} each",
                plural(before.failures, "failure"),
                after.failures,
                plural(before.simulations, "simulation")
            ),
            [before] => format!(
                "find {} in {}",
                plural(before.failures, "failure"),
                plural(before.simulations, "simulation")
            ),
            [] => String::new(),
        },
    );
    verdict.add(
        "corners",
        found.corners.as_ref().map_or(String::new(), |corners| {
            let after = corners.after.map_or(String::new(), |after| format!(", {after} after"));
            format!("{} of {} succeed before{after}", corners.before, corners.corners)
        }),
    );
    verdict.add("worse", found.worse.join(", "));
    if let Some(after) = &found.after {
        verdict.add("file", after.as_str());
    }
    verdict
}

fn table(found: &Hardening) -> Vec<Vec<String>> {
    let rate = |estimate: Option<&Estimate>| match estimate {
        Some(Estimate { value: Some(value), .. }) => percent(*value),
        _ => "-".to_string(),
    };
    let mut rows =
        vec![["", "before", "after", "after - before", "p (Holm)", "n"].map(String::from).to_vec()];
    for measure in &found.measures {
        let HardenedMeasure { before, after, difference, adjusted_p_value, .. } = measure;
        rows.push(vec![
            measure.label().to_string(),
            rate(Some(before)),
            rate(after.as_ref()),
            difference.as_ref().map_or("-".to_string(), points),
            adjusted_p_value.map_or("-".to_string(), p_value_text),
            before.n.to_string(),
        ]);
    }
    rows
}
