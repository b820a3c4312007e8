//! Findings of trials that keep going, as text: failure modes, when they appeared, coverage of the
//! space, estimates of the unseen.

use std::collections::BTreeMap;

use mishandle::results::{Coverage, Modes, Subject};
use mishandle_text::plural;

use super::modes;

/// Returns the text about the failure modes of a run.
pub fn text(subject: &Subject, survey: &Modes) -> String {
    let modes = modes::Modes {
        modes: survey.modes.iter().map(|found| &found.mode).collect(),
        failures: survey.failures,
        not_grouped: survey.not_grouped,
        axes: &subject.space_axes,
        control_dt: subject.control_dt,
    };
    let mut lines: Vec<String> = appearances(survey)
        .into_iter()
        .map(|(trial, mut numbers)| {
            numbers.sort_unstable();
            let numbers: Vec<String> = numbers.iter().map(u32::to_string).collect();
            format!("modes of trial {trial} appear at simulations {}", numbers.join(", "))
        })
        .collect();
    if let Some(unseen) = survey.unseen_modes {
        lines.push(format!(
            "modes that only one trial found: {}; another trial would find {:.2} new ones on average; estimate of all modes: at \
             least {:.1} (Chao2)",
            unseen.found_once, unseen.expected_new, unseen.total
        ));
    }
    lines.extend(coverage(&survey.coverage));
    format!("\n{}\n\n{}", modes.text(), lines.join("\n"))
}

/// Returns the trials that found a mode, in order, each with the numbers of its first simulations
/// in the modes.
fn appearances(survey: &Modes) -> BTreeMap<u32, Vec<u32>> {
    let mut trials: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for first in survey.modes.iter().flat_map(|mode| &mode.found) {
        trials.entry(first.trial).or_default().push(first.simulation);
    }
    trials
}

fn coverage(coverage: &Coverage) -> Option<String> {
    let visited = coverage.visited_fraction()?;
    let failing = coverage.failing_fraction()?;
    Some(format!(
        "pairwise coverage: simulations in {:.0} % of {} of {}, failures in {:.0} % of the visited cells",
        100.0 * visited,
        plural(coverage.cells, "cell"),
        match coverage.pairs {
            1 => "the space".to_string(),
            pairs => format!("{pairs} pairs of axes"),
        },
        100.0 * failing,
    ))
}
