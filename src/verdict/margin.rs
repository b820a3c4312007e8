//! How small a disturbance breaks a requirement.

use mishandle_results::{Command, Margin, Named, Witness};
use mishandle_text::{measured, plural};

use super::axes::off_nominal;
use super::subject::{tested, varied};
use super::{Conclusion, LUCK, Verdict, repeats_text, undecided};
use crate::resolve::{nominal_scenario, nominal_values};

pub(super) fn verdict(found: &Margin) -> Verdict {
    let undecided = undecided(&found.without_verdict, "nothing is claimed about disturbances as large");
    let subject = format!("{undecided}{}", tested(&found.subject));
    let simulations = plural(found.simulations, "simulation");
    let end = if found.is_complete { "" } else { "; interrupted" };
    let mut verdict = match (&found.witness, found.no_violation_up_to) {
        (Some(witness), _) => fails(found, witness, &format!("{subject}: "), end),
        (None, Some(amplitude)) => {
            let how_far =
                if amplitude >= 1.0 { "the largest disturbance".to_string() } else { size(amplitude) };
            let fixed = match fixed(found) {
                fixed if fixed.is_empty() => fixed,
                fixed => format!("; fixed: {fixed}"),
            };
            let headline =
                format!("{subject}: no violation in {}, up to {how_far}{fixed}{end}", evidence(found));
            Verdict::new(Conclusion::NothingFound, headline)
        }
        (None, None) => {
            let from = found.smallest_without_verdict.map_or(String::new(), |amplitude| match amplitude {
                0.0 => "; the nominal scenario itself has no verdict".to_string(),
                _ => format!("; simulations have no verdict from {} on", size(amplitude)),
            });
            let headline = format!(
                "{subject}: no violation in {simulations}, which says nothing about the space{from}{end}"
            );
            Verdict::new(Conclusion::NoVerdict, headline)
        }
    };
    if found.witness.is_none() {
        verdict.add("varied", varied(&found.subject));
    }
    if found.witness.is_some() || found.no_violation_up_to.is_none() {
        verdict.add("fixed", fixed(found));
    }
    if let Some(run) = &found.run {
        verdict.then("look", Command::Report { run: run.clone() });
        if found.witness.is_some() {
            verdict.then("keep", Command::Keep { run: run.clone() });
        }
    }
    verdict
}

fn fails(found: &Margin, witness: &Witness, subject: &str, end: &str) -> Verdict {
    let what = match witness.axes {
        0 => "the controller fails without a disturbance".to_string(),
        _ => format!("a disturbance of {} is enough", size(witness.norms.amplitude)),
    };
    let doubt = match &witness.repeats {
        Some(repeats) if !repeats.fails_in_most() => ", but not with most other seeds",
        _ => "",
    };
    let simulations = plural(found.simulations, "simulation");
    let headline = format!("{subject}{what}{doubt}, after {simulations}{end}");
    let mut verdict = Verdict::new(Conclusion::Fails, headline);
    let values = found.subject.space_axes.iter().zip(witness.scenario.values().copied());
    let control_dt = found.subject.control_dt;
    let off: Vec<String> = values
        .filter(|(axis, value)| value.is_some() && *value != axis.nominal)
        .map(|(axis, value)| off_nominal(axis, value, control_dt))
        .collect();
    let free = off.len().saturating_sub(witness.axes as usize);
    verdict.add(
        "at",
        match off.len() {
            0 => nominal_scenario(&found.subject),
            n if n == found.subject.space_axes.len() => off.join(", "),
            _ => format!("{}; all else nominal", off.join(", ")),
        },
    );
    if free > 0 && witness.axes > 0 {
        let count = if witness.axes == 1 { "counts" } else { "count" };
        let axes = witness.axes;
        verdict.add(
            "size",
            format!("{axes} of these values {count}; starts, and times and durations of events, are free"),
        );
    }
    verdict.add(
        "sure",
        witness.repeats.as_ref().map_or(String::new(), |repeats| {
            repeats_text(repeats) + if repeats.fails_in_most() { "" } else { LUCK }
        }),
    );
    verdict.add(
        "below",
        found.no_violation_up_to.map_or(String::new(), |amplitude| {
            format!("no violation up to {}, in {}", size(amplitude), evidence(found))
        }),
    );
    verdict.add(
        "above",
        found.smallest_without_verdict.map_or(String::new(), |amplitude| {
            format!("nothing is claimed from {} on, where simulations have no verdict", size(amplitude))
        }),
    );
    verdict
}

/// Formats the largest offset of a disturbed axis.
fn size(amplitude: f64) -> String {
    format!("{} % of the way to the bounds", measured(100.0 * amplitude))
}

/// Names what the disturbances leave as it is.
fn fixed(found: &Margin) -> String {
    let measured_from = match nominal_values(found.measured_axes()) {
        values if values.is_empty() => values,
        values => format!("measured from {values}"),
    };
    let parts = [category_names(&found.categories), found.at_nominal_text(), measured_from];
    parts.into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join("; ")
}

/// Names categories: `surface = ice`.
pub fn category_names(categories: &Named<String>) -> String {
    let name = |(axis, category): &(String, String)| format!("{axis} = {category}");
    categories.0.iter().map(name).collect::<Vec<_>>().join(", ")
}

/// Describes the simulations on which a claim that nothing fails rests.
fn evidence(found: &Margin) -> String {
    let all = match (found.no_violation_is_exhaustive, found.no_violation_seeds) {
        (Some(true), _) => ", which are all scenarios".to_string(),
        (_, Some(seeds)) if found.is_random => format!(" with {}", plural(seeds, "seed")),
        _ => String::new(),
    };
    format!("{}{all}", plural(found.no_violation_simulations.unwrap_or(0), "simulation"))
}
