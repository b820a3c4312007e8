//! The result of a falsification, as text.

use mishandle::falsification::physics_text;
use mishandle::resolve::{nominal_scenario, nominal_values};
use mishandle::results::{
    Cause, Estimate, Falsification, PhysicsCheck, Repeats, SearchValue, SmoothRegion, Trial, TrialEnd,
};
use mishandle::search::OptionValue;
use mishandle_text::{decimal, plural};

use super::{answer, escape, output, physics, reasons, requirements, scenario, screening, subject};

/// Returns the trials, what they say together, and the part of the space that cannot fail.
pub fn text(found: &Falsification) -> String {
    let region = found.smooth_region.as_ref().map_or(String::new(), region_text);
    let requirements = requirements::text(found.requirements.as_deref());
    let reasons = reasons::text(found.reasons.as_deref());
    let meaning = if found.falsified_trials > 0 {
        "they do not count as counterexamples"
    } else {
        "whether the controller fails there is not known"
    };
    format!(
        "{}{}{region}{reasons}{requirements}{}",
        answer::without_verdict(&found.without_verdict, meaning),
        trials_text(found),
        screening::falsification_text(found)
    )
}

fn region_text(region: &SmoothRegion) -> String {
    match (region.slope, region.covered) {
        (Some(_), Some(covered)) if covered < 0.01 => {
            "\nno statement about the space between the samples: they are too far apart for such steep changes of the robustness".into()
        }
        (Some(slope), Some(covered)) => format!(
            "\nif no part of the formula is steeper than the samples show, {} by at most {} per width of the space (estimate, 95 % \
             confidence); then no scenario in {:.0} % of the space fails",
            match region.predicates {
                Some(2..) => "its predicates change",
                _ => "its predicate changes",
            },
            decimal(slope, 4),
            // A share that was measured at random points is never 100 %.
            (100.0 * covered).floor().min(99.0)
        ),
        _ => format!(
            "\nno statement about the space between the samples: {}",
            region.refusal.as_deref().unwrap_or_default()
        ),
    }
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

fn trials_text(found: &Falsification) -> String {
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
            trial.minimum_robustness.map_or("-".to_string(), |minimum| decimal(minimum.0, 4)),
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
    let mut text = format!(
        "{}\nsearch {}{}, at most {} per trial, seed {}{}\nformula {}\n\n{}\n\n{}",
        subject::heading(&found.subject),
        found.search,
        options_text(found),
        plural(found.budget, "simulation"),
        found.subject.seed.0,
        found.fixed_seed.map_or(String::new(), |seed| format!(", every simulation with seed {}", seed.0)),
        found.formula,
        output::table(&rows),
        summary(found),
    );
    if found.early_stopping && found.simulations > 0 && found.screening.is_none() {
        let whole = found.simulations * found.subject.episode_steps;
        text.push_str(&format!(
            "\nearly stopping: {:.0} % of {whole} control steps saved; robustness values of simulations that ended early are lower bounds",
            100.0 * (1.0 - found.control_steps as f64 / whole as f64)
        ));
    }
    if let Some(bound) = found.failure_rate_bound {
        text.push_str(&format!(
            "\nno violation in {} of the space: failure rate below {} (95 % confidence)",
            plural(found.simulations, "uniform random sample"),
            percent(bound)
        ));
    }
    if let (0, Some(reason)) = (found.falsified_trials, &found.asks_nothing) {
        text.push_str(&format!("\nnot violated: asks nothing: {}", escape::name(reason)));
    }
    text.push_str(&counterexample_text(found));
    text.push_str(&physics::count_text(found.trials.iter().filter_map(|trial| trial.physics.as_ref())));
    if has_repeats {
        let repeats = || found.trials.iter().filter_map(|trial| trial.repeats.as_ref());
        let sum = |of: fn(&Repeats) -> u64| repeats().map(of).sum::<u64>();
        let failures = sum(|found| found.failures);
        let n = sum(|found| found.failure_rate.n);
        text.push_str(&format!(
            "\nwith other seeds, the counterexamples fail in {failures} of {}",
            plural(n, "repeat")
        ));
    }
    text
}

/// Describes the counterexample of the first falsified trial.
fn counterexample_text(found: &Falsification) -> String {
    let mut falsified = found.trials.iter().filter(|trial| trial.falsified);
    let first = falsified.find_map(|trial| {
        let Trial { scenario, seed, simulation, minimum_robustness, .. } = trial;
        Some((trial, scenario.as_ref()?, (*seed)?, (*simulation)?, (*minimum_robustness)?))
    });
    first.map_or(String::new(), |(trial, at, seed, simulation, robustness)| {
        let physics = trial.physics.as_ref();
        let checked = physics.map_or(String::new(), |check| format!("\n{}", physics::text(check)));
        let cause = trial.cause.as_ref();
        let trial = trial.trial;
        let values = found.subject.space_axes.iter().zip(at.values().copied());
        format!(
            "\ncounterexample: {}, seed {} (trial {trial}, simulation {simulation}): robustness {}",
            scenario::text(values),
            seed.0,
            decimal(robustness.0, 4)
        ) + &checked
            + &cause.map_or(String::new(), |cause| cause_text(found, cause, physics))
    })
}

/// Says which axes cause the failure. `physics` is the check of the counterexample.
fn cause_text(found: &Falsification, cause: &Cause, physics: Option<&PhysicsCheck>) -> String {
    let axes = &found.subject.space_axes;
    let values = axes.iter().zip(cause.scenario.values().copied());
    let kept: Vec<_> = values.filter(|(axis, _)| cause.axes.contains(&axis.name)).collect();
    let nearest = match kept.len() {
        0 => format!("{} fails", escape::name(&nominal_scenario(&found.subject))),
        n if n == axes.len() => scenario::text(kept),
        _ => {
            let others = found.subject.moved_axes().filter(|axis| !cause.axes.contains(&axis.name));
            let others = match nominal_values(others) {
                values if values.is_empty() => values,
                values => format!(" ({})", escape::name(&values)),
            };
            format!("{}, all else nominal{others}", scenario::text(kept))
        }
    };
    let mut text = format!(
        "\nmoved toward nominal with {}: {nearest}: robustness {}",
        plural(cause.simulations, "more simulation"),
        decimal(cause.robustness.0, 4)
    );
    let depends = |check: &&PhysicsCheck| check.depends_on_solver;
    if cause.went_back {
        text.push_str("\nit went back toward the counterexample: nearer failures depend on the solver");
    } else if let (Some(check), None) = (cause.physics.as_ref().filter(depends), physics.filter(depends)) {
        text.push_str(&format!("\nit {}", physics_text(check)));
    }
    let list = |names: &[String]| match names {
        [] => "none".to_string(),
        names => names.iter().map(|name| escape::name(name)).collect::<Vec<_>>().join(", "),
    };
    if let (Some(sufficient), Some(necessary), false) =
        (&cause.sufficient, &cause.necessary, cause.axes.is_empty())
    {
        text.push_str(&format!(
            "\naxes that cause it alone: {}; axes that remove it alone if set to nominal: {}",
            list(sufficient),
            list(necessary)
        ));
    }
    if !cause.only_on_bounds.is_empty() {
        text.push_str(&format!(
            "\nonly on the bound of {}: a millionth of the width inside, it passes",
            list(&cause.only_on_bounds)
        ));
    }
    if let Some(Estimate { value: Some(rate), n, .. }) = &cause.other_seeds {
        let failures = (rate * *n as f64).round() as u64;
        text.push_str(&format!(
            "\nwith other seeds, the moved counterexample fails in {failures} of {n} repeats"
        ));
    }
    text
}

/// Formats a small rate in percent, rounded up to two digits.
fn percent(rate: f64) -> String {
    let percent = 100.0 * rate;
    let decimals = (1.0 - percent.log10().floor()).clamp(0.0, 12.0) as usize;
    let scale = 10_f64.powi(decimals as i32);
    format!("{:.decimals$} %", (percent * scale).ceil() / scale)
}

/// Returns the number of falsified trials, and the simulations up to the counterexample.
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
    text
}
