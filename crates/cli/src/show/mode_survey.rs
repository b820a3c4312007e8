//! Output of trials that keep going: failure modes, when they appeared, coverage of the space, and estimates of the unseen.

use std::collections::{BTreeMap, BTreeSet};

use mishandle::store::RunHeader;
use mishandle::{ModeSurvey, plural};
use serde_json::{Value, json};

use super::{modes, output};

/// Returns the keys that a survey adds to the JSON document of a run.
pub fn document(header: &RunHeader, survey: &ModeSurvey) -> Value {
    let found = |first: &BTreeMap<u32, u32>| -> Vec<Value> {
        first.iter().map(|(trial, number)| json!({ "trial": trial, "simulation": number })).collect()
    };
    let modes = modes::documents(header, &survey.modes).into_iter().zip(&survey.first);
    let unseen = survey.unseen.map(|unseen| {
        json!({
            "trials": unseen.trials,
            "found_once": unseen.found_once,
            "expected_new": unseen.expected_new,
            "total": unseen.total,
        })
    });
    let coverage = survey.coverage;
    json!({
        "failures": survey.modes.failures,
        "not_grouped": survey.modes.not_grouped,
        "modes": modes.map(|(mode, first)| output::joined(mode, json!({ "found": found(first) }))).collect::<Vec<_>>(),
        "unseen_modes": unseen,
        "coverage": {
            "pairs": coverage.pairs,
            "cells": coverage.cells,
            "visited": coverage.visited,
            "failing": coverage.failing,
        },
    })
}

/// Returns the text about the failure modes of a run.
pub fn text(header: &RunHeader, survey: &ModeSurvey) -> String {
    let mut parts = vec![format!("\n{}", modes::text(header, &survey.modes))];
    let mut lines: Vec<String> = trials(survey)
        .into_iter()
        .map(|trial| {
            let numbers: Vec<String> = survey.curve(trial).iter().map(u32::to_string).collect();
            format!("modes of trial {trial} appear at simulations {}", numbers.join(", "))
        })
        .collect();
    if let Some(unseen) = survey.unseen {
        lines.push(format!(
            "modes that only one trial found: {}; another trial would find {:.2} new ones on average; estimate of all modes: at \
             least {:.1} (Chao2)",
            unseen.found_once, unseen.expected_new, unseen.total
        ));
    }
    lines.extend(coverage(survey));
    parts.push(lines.join("\n"));
    parts.join("\n\n")
}

/// Returns the trials that found a mode, in order.
fn trials(survey: &ModeSurvey) -> BTreeSet<u32> {
    survey.first.iter().flat_map(|first| first.keys().copied()).collect()
}

fn coverage(survey: &ModeSurvey) -> Option<String> {
    let coverage = survey.coverage;
    let (visited, failing) = (coverage.visited_fraction()?, coverage.failing_fraction()?);
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
