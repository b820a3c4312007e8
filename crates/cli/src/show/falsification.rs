//! The result of a falsification, as text.

use mishandle::results::{Cause, Falsification, SearchValue, SmoothRegion, Trial, TrialEnd};
use mishandle::search::OptionValue;
use mishandle_text::{measured, plural};

use super::{escape, output, physics, reasons, requirements, scenario, screening, subject};

/// Returns what stands below the verdict: reasons, engines, and the part of the space that cannot
/// fail.
pub fn text(found: &Falsification) -> String {
    let region = found.smooth_region.as_ref().map_or(String::new(), region_text);
    let reasons = reasons::text(found.reasons.as_deref());
    format!("{region}{reasons}{}", screening::falsification_text(found))
}

fn region_text(region: &SmoothRegion) -> String {
    let text = match (region.slope, region.covered) {
        (Some(_), Some(covered)) if covered < 0.01 => {
            "no statement about the space between the samples: they are too far apart for such steep changes of the robustness".into()
        }
        (Some(slope), Some(covered)) => format!(
            "if no part of the formula is steeper than the samples show, {} by at most {} per width of the space (estimate, 95 % \
             confidence); then no scenario in {:.0} % of the space fails",
            match region.predicates {
                Some(2..) => "its predicates change",
                _ => "its predicate changes",
            },
            measured(slope),
            // A share that was measured at random points is never 100 %.
            (100.0 * covered).floor().min(99.0)
        ),
        _ => format!(
            "no statement about the space between the samples: {}",
            region.refusal.as_deref().unwrap_or_default()
        ),
    };
    format!("\n\n{}", output::wrapped(&escape::name(&text), output::width()))
}

/// Returns the options that the plan sets, in parentheses.
fn options_text(found: &Falsification) -> String {
    let value = |value: &SearchValue| match value.clone() {
        SearchValue::Float(value) => OptionValue::Float(value.0),
        SearchValue::Integer(value) => OptionValue::Integer(value),
        SearchValue::Boolean(value) => OptionValue::Boolean(value),
        SearchValue::Text(value) => OptionValue::Text(value),
        SearchValue::Point(value) => OptionValue::Point(value),
        SearchValue::Points(value) => OptionValue::Points(value),
    };
    let options: Vec<String> =
        found.search_options.0.iter().map(|(name, option)| format!("{name} = {}", value(option))).collect();
    if options.is_empty() { String::new() } else { format!(" ({})", options.join(", ")) }
}

/// Warns about simulations that have no verdict because a value is not finite: the first one of up
/// to `SHOWN` trials.
pub fn report_unevaluated(found: &Falsification) {
    const SHOWN: usize = 3;
    let first =
        found.trials.iter().filter_map(|trial| Some((trial.trial, trial.first_unevaluated.as_ref()?)));
    let mut shown = 0;
    for (trial, first) in first.take(SHOWN) {
        shown += 1;
        output::message(&format!(
            "warning: simulation {} of trial {trial} ({}, seed {}) has no verdict: {}",
            first.simulation,
            scenario::summary(&found.subject.space_axes, &first.scenario),
            first.seed.0,
            first.end,
        ));
    }
    let affected = total(found, |trial| trial.undefined + trial.invalid + trial.failed);
    if affected > shown {
        let more = plural(affected - shown, "more simulation");
        output::message(&format!("warning: no verdict either: {more}"));
    }
}

/// Adds a number of all trials.
fn total(found: &Falsification, count: fn(&Trial) -> u32) -> u64 {
    found.trials.iter().map(|trial| u64::from(count(trial))).sum()
}

/// Returns the search, the table of its trials, and each counterexample with all values.
pub fn details(found: &Falsification) -> String {
    let mut parts = vec![
        format!(
            "{}\nsearch {}{}, at most {} per trial, seed {}{}\nformula {}",
            subject::heading(&found.subject),
            found.search,
            options_text(found),
            plural(found.budget, "simulation"),
            found.subject.seed.0,
            found.fixed_seed.map_or(String::new(), |seed| format!(", every simulation with seed {}", seed.0)),
            escape::name(&found.formula),
        ),
        output::table_in(&trials_table(found), output::width()),
        summary(found),
    ];
    parts.extend(
        found.trials.iter().filter(|trial| trial.falsified).map(|trial| counterexample(found, trial)),
    );
    let wrapped = |part: &String| {
        part.lines().map(|line| output::folded(line, output::width())).collect::<Vec<_>>().join("\n")
    };
    // A table keeps its lines.
    let lines =
        parts.iter().enumerate().map(|(index, part)| if index == 1 { part.clone() } else { wrapped(part) });
    lines.collect::<Vec<_>>().join("\n\n") + &requirements::text(found.requirements.as_deref())
}

fn trials_table(found: &Falsification) -> Vec<Vec<String>> {
    let axes = &found.subject.space_axes;
    let has_repeats = found.trials.iter().any(|trial| trial.repeats.is_some());
    let has_physics = found.trials.iter().any(|trial| trial.physics.is_some());
    let mut header = vec!["trial", "result", "simulations", "min robustness", "scenario"];
    if has_physics {
        header.insert(4, "physics");
    }
    if has_repeats {
        header.insert(4, "fails in repeats");
    }
    let mut rows = vec![header.into_iter().map(String::from).collect::<Vec<_>>()];
    for trial in &found.trials {
        let at = trial.scenario.as_ref();
        let mut row = vec![
            trial.trial.to_string(),
            trial.end.map_or("interrupted", TrialEnd::name).to_string(),
            trial.simulations.to_string(),
            trial.minimum_robustness.map_or("-".to_string(), |minimum| measured(minimum.0)),
            at.map_or(String::new(), |at| scenario::summary(axes, at)),
        ];
        if has_physics {
            row.insert(4, physics::word(trial.physics.as_ref()).to_string());
        }
        if has_repeats {
            let repeats = trial.repeats.as_ref();
            row.insert(
                4,
                repeats.map_or("-".to_string(), |found| {
                    format!("{} of {}", found.failures, found.failure_rate.n)
                }),
            );
        }
        rows.push(row);
    }
    rows
}

/// Returns all values of the counterexample of a trial, and what moving it toward nominal says.
fn counterexample(found: &Falsification, trial: &Trial) -> String {
    let axes = &found.subject.space_axes;
    let values = trial.scenario.iter().flat_map(|at| axes.iter().zip(at.values().copied()));
    let mut lines = vec![format!(
        "counterexample of trial {}, simulation {}, seed {}: {}",
        trial.trial,
        trial.simulation.unwrap_or_default(),
        trial.seed.map_or(0, |seed| seed.0),
        scenario::text(values)
    )];
    lines.extend(trial.physics.as_ref().map(physics::text));
    lines.extend(trial.cause.as_ref().map(|cause| cause_text(found, cause)));
    lines.join("\n")
}

/// Says which axes cause the failure, alone and together.
fn cause_text(found: &Falsification, cause: &Cause) -> String {
    let values = found.subject.space_axes.iter().zip(cause.scenario.values().copied());
    let off: Vec<_> = values.filter(|(axis, _)| cause.axes.contains(&axis.name)).collect();
    let nearest = if off.is_empty() { "nominal".to_string() } else { scenario::text(off) };
    let list = |names: &[String]| match names {
        [] => "none".to_string(),
        names => names.iter().map(|name| escape::label(name)).collect::<Vec<_>>().join(", "),
    };
    let alone = match (&cause.sufficient, &cause.necessary) {
        (Some(sufficient), Some(necessary)) if !cause.axes.is_empty() => format!(
            "\naxes that cause it alone: {}; axes that remove it alone if set to nominal: {}",
            list(sufficient),
            list(necessary)
        ),
        _ => String::new(),
    };
    format!(
        "moved toward nominal with {}: {nearest}: robustness {}{alone}",
        plural(cause.simulations, "more simulation"),
        measured(cause.robustness.0)
    )
}

/// Returns the number of falsified trials, the simulations up to the counterexample, and what early
/// stopping saved.
fn summary(found: &Falsification) -> String {
    let ended = found.falsification_rate.n;
    let mut text = format!("falsified {} of {}", found.falsified_trials, plural(ended, "trial"));
    if let Some(mean) = found.mean_simulations {
        text.push_str(&format!("; simulations to a counterexample: mean {mean:.1} over falsified trials"));
    }
    match found.median_simulations {
        Some(median) => text.push_str(&format!(", median {median} over all trials")),
        None if found.falsified_trials > 0 && found.trials.iter().all(|trial| trial.end.is_some()) => {
            text.push_str(", median over all trials not reached within the budget");
        }
        None => {}
    }
    if found.early_stopping && found.simulations > 0 && found.screening.is_none() {
        let whole = found.simulations * found.subject.episode_steps;
        text.push_str(&format!(
            "\nearly stopping: {:.0} % of {whole} control steps saved; robustness values of simulations that ended early are lower bounds",
            100.0 * (1.0 - found.control_steps as f64 / whole as f64)
        ));
    }
    text
}
