//! The findings of a search.

use mishandle_results::{
    AxisFacts, AxisValues, Cause, Choice, Command, Estimate, Falsification, Key, PhysicsCheck, Repeats,
    Trial, Violation,
};
use mishandle_text::{measured, plural, sample_time};

use super::axes::{off_nominal, shown, value_text};
use super::subject::{settings, tested, varied};
use super::{Conclusion, LUCK, Verdict, repeats_text, undecided};
use crate::resolve::{has_scene, nominal_scenario, nominal_values};

/// Largest number of axes of a counterexample that was not moved toward nominal.
const NAMED: usize = 4;

/// Largest number of ways that are named.
const WAYS: usize = 3;

pub(super) fn verdict(found: &Falsification) -> Verdict {
    match smallest_cause(found) {
        Some(trial) => fails(found, trial),
        None => passes(found),
    }
}

/// Returns the trial whose counterexample is shown: one that no check of the physics removes, that
/// is not the luck of its seed, with the fewest axes off nominal, and of these the first. `None`
/// without a counterexample.
pub fn smallest_cause(found: &Falsification) -> Option<&Trial> {
    let falsified = found.trials.iter().filter(|trial| trial.falsified && trial.scenario.is_some());
    falsified.min_by_key(|trial| {
        let axes = trial.cause.as_ref().map_or(usize::MAX, |cause| cause.axes.len());
        let depends_on_solver = physics(trial).is_some_and(|check| check.depends_on_solver);
        let is_luck = is_luck(trial.cause.as_ref(), trial.repeats.as_ref());
        (depends_on_solver, is_luck, axes, trial.trial)
    })
}

/// Returns whether a failure fails with at most half of the other seeds.
fn is_luck(cause: Option<&Cause>, repeats: Option<&Repeats>) -> bool {
    match (cause.and_then(|cause| cause.other_seeds), repeats) {
        (Some(Estimate { value: Some(rate), .. }), _) => rate <= 0.5,
        (_, Some(repeats)) => !repeats.fails_in_most(),
        _ => false,
    }
}

/// Returns the check of the physics of the minimal failure, or of a counterexample that was not
/// moved: what is true of the one need not be true of the other.
fn physics(trial: &Trial) -> Option<&PhysicsCheck> {
    match &trial.cause {
        Some(cause) => cause.physics.as_ref(),
        None => trial.physics.as_ref(),
    }
}

fn fails(found: &Falsification, trial: &Trial) -> Verdict {
    let headline = format!(
        "{}{}: {} of {}, first after {}",
        undecided(&found.without_verdict, "they do not count as counterexamples"),
        tested(&found.subject),
        found.falsified_trials,
        searches(found),
        plural(first_after(found), "simulation")
    );
    let mut verdict = Verdict::new(Conclusion::Fails, headline);
    verdict.add("cause", cause(found, trial));
    let violation = trial.cause.as_ref().map_or(&trial.violation, |cause| &cause.violation);
    verdict.add("since", violation.as_ref().map_or(String::new(), |found_at| since(found_at, found)));
    verdict.add("sure", sure(found, trial));
    verdict.add("ways", ways(found));
    if let Some(run) = &found.run {
        verdict.then("look", Command::Report { run: run.clone() });
        verdict.then("keep", Command::Keep { run: run.clone() });
    }
    if found.subject.offered.as_ref().is_some_and(|offered| offered.can_harden) {
        verdict.then(
            "fix",
            Command::Harden { target: found.subject.target.clone(), settings: settings(&found.subject) },
        );
    }
    verdict
}

/// Returns the number of trials.
fn searches(found: &Falsification) -> String {
    match found.trials.len() {
        1 => "1 search".to_string(),
        count => format!("{count} searches"),
    }
}

/// Returns the number of simulations up to the first counterexample, in the order of the trials.
fn first_after(found: &Falsification) -> u64 {
    let passing = found.trials.iter().take_while(|trial| !trial.falsified);
    let before: u64 = passing.map(|trial| u64::from(trial.simulations)).sum();
    let first = found.trials.iter().find_map(|trial| trial.first_violation);
    before + u64::from(first.unwrap_or(0))
}

/// Says how little is enough for the failure.
fn cause(found: &Falsification, trial: &Trial) -> String {
    let axes = &found.subject.space_axes;
    let control_dt = found.subject.control_dt;
    let Some(cause) = &trial.cause else {
        let scenario = trial.scenario.iter().flat_map(|scenario| scenario.values().copied());
        let off: Vec<_> = axes.iter().zip(scenario).filter(|(axis, value)| *value != axis.nominal).collect();
        let named: Vec<String> =
            off.iter().take(NAMED).map(|(axis, value)| off_nominal(axis, *value, control_dt)).collect();
        let more = match off.len().saturating_sub(NAMED) {
            0 => String::new(),
            more => format!(" and {} more", plural(more as u64, "value")),
        };
        return format!("{}{more}; not moved toward nominal", named.join(", "));
    };
    let values = axes.iter().zip(cause.scenario.values().copied());
    let kept: Vec<String> = values
        .filter(|(axis, _)| cause.axes.contains(&axis.name))
        .map(|(axis, value)| off_nominal(axis, value, control_dt))
        .collect();
    let others = found.subject.moved_axes().filter(|axis| !cause.axes.contains(&axis.name));
    let others = match nominal_values(others) {
        values if values.is_empty() => values,
        values => format!(" ({values})"),
    };
    let bounds = match &cause.only_on_bounds[..] {
        [] => String::new(),
        names => format!("; only exactly on the bound of {}", names.join(", ")),
    };
    match kept.len() {
        0 => {
            let is_luck = is_luck(Some(cause), trial.repeats.as_ref());
            let seed = if is_luck { " with this seed" } else { "" };
            format!("none is needed: {} fails{seed}", nominal_scenario(&found.subject))
        }
        n if n == axes.len() => kept.join(", ") + &bounds,
        _ => format!("{}; all else nominal{others}{bounds}", kept.join(", ")),
    }
}

/// Says what the formula forbids and when it happens, and when nothing can satisfy it any more.
fn since(violation: &Violation, found: &Falsification) -> String {
    let control_dt = found.subject.control_dt;
    let time = |sample: u64| sample_time(sample as usize, control_dt);
    let decided = violation.decided.map(|decided| decided.sample);
    let words = &violation.words;
    let end = "nothing can satisfy the requirement any more";
    match (decided, violation.at.map(|at| at.sample)) {
        (Some(decided), _) if words.is_empty() => format!("from {} on {end}", time(decided)),
        (Some(decided), Some(at)) if decided == at => format!("at {} {words}; from then on {end}", time(at)),
        (Some(decided), Some(at)) => format!("at {} {words}; from {} on {end}", time(at), time(decided)),
        (Some(decided), None) => format!("{words}; from {} on {end}", time(decided)),
        (None, Some(at)) if !words.is_empty() => format!("at {} {words}", time(at)),
        (None, _) => words.clone(),
    }
}

fn sure(found: &Falsification, trial: &Trial) -> String {
    let Trial { cause, repeats, .. } = trial;
    let physics = physics(trial);
    let is_open = physics.is_none() && has_scene(&found.subject.target_kind);
    let open =
        is_open.then(|| "not repeated with another physics step, collision algorithm and start".to_string());
    let known = sureness(cause.as_ref(), repeats.as_ref(), physics, is_deterministic(found, trial));
    let parts = Some(known).filter(|text| !text.is_empty()).into_iter().chain(open);
    parts.collect::<Vec<_>>().join("; ")
}

/// Says whether other seeds and another solver give a failure, too. `repeats` are those of the
/// failure that was found, from which the minimal one of `cause` was moved.
pub fn sureness(
    cause: Option<&Cause>,
    repeats: Option<&Repeats>,
    physics: Option<&PhysicsCheck>,
    is_deterministic: bool,
) -> String {
    let seeds = match (cause, repeats) {
        (Some(Cause { other_seeds: Some(Estimate { value: Some(rate), n, .. }), .. }), _) => {
            Some(format!("fails in {:.0} of {n} repeats with other seeds", rate * *n as f64))
        }
        (_, Some(repeats)) => {
            let which = if cause.is_some() { "the counterexample fails" } else { "fails" };
            Some(repeats_text(repeats).replacen("fails", which, 1))
        }
        _ if is_deterministic => Some("the same with every seed: nothing in it is random".to_string()),
        _ => None,
    };
    let seeds = seeds.map(|text| if is_luck(cause, repeats) { text + LUCK } else { text });
    let went_back = cause.is_some_and(|cause| cause.went_back);
    let went_back = went_back.then(|| "nearer to nominal it fails with some of these only".to_string());
    let parts = seeds.into_iter().chain(physics.map(solver_text)).chain(went_back);
    parts.collect::<Vec<_>>().join("; ")
}

/// Says whether a failure depends on the solver of the physics.
fn solver_text(check: &PhysicsCheck) -> String {
    let names: Vec<&str> = check.simulations.iter().map(|simulation| simulation.change.words()).collect();
    if check.depends_on_solver {
        let vanishing: Vec<&str> = check.vanishing().map(|simulation| simulation.change.words()).collect();
        return format!(
            "no evidence about a real robot: it vanishes with {}, so it depends on the solver",
            vanishing.join(" and with ")
        );
    }
    match names.split_last() {
        Some((last, [])) => format!("remains with {last}"),
        Some((last, others)) => format!("remains with {} and {last}", others.join(", ")),
        None => String::new(),
    }
}

/// Returns whether another seed cannot change the failure; `false` if that is not known.
fn is_deterministic(found: &Falsification, trial: &Trial) -> bool {
    let scenario = trial.cause.as_ref().map(|cause| &cause.scenario).or(trial.scenario.as_ref());
    let Some((offered, scenario)) = found.subject.offered.as_ref().zip(scenario) else { return false };
    let mut values = found.subject.space_axes.iter().zip(scenario.values());
    let is_drawn = |(axis, value): (&AxisFacts, &Option<f64>)| {
        value.is_none() || (*value != axis.nominal && offered.random_axes.contains(&axis.name))
    };
    !offered.is_random && !values.any(is_drawn)
}

/// Returns the side of nominal on which the value of an axis is, or its category.
fn side(axis: &AxisFacts, value: Option<f64>) -> String {
    match (&axis.values, axis.nominal.zip(value)) {
        (AxisValues::Categories(_), _) => format!("= {}", value_text(axis, value)),
        (_, Some((nominal, value))) if value < nominal => "below nominal".to_string(),
        _ => "above nominal".to_string(),
    }
}

/// Counts the failures by their causes, or by their modes.
fn ways(found: &Falsification) -> String {
    if let Some(modes) = &found.modes {
        let largest = modes.modes.first().map_or(String::new(), |found| {
            format!("; the largest has {}: `{}` fails", found.mode.failures, found.mode.predicate)
        });
        return format!(
            "{} with {}{largest}",
            plural(modes.modes.len() as u64, "failure mode"),
            plural(modes.failures, "failure")
        );
    }
    // A way is a set of axes and their sides, as in a failure mode.
    let axes = &found.subject.space_axes;
    let mut counts: Vec<(Vec<(&str, String)>, usize)> = Vec::new();
    for cause in found.trials.iter().filter_map(|trial| trial.cause.as_ref()) {
        let values = axes.iter().zip(cause.scenario.values().copied());
        let of_cause = values.filter(|(axis, _)| cause.axes.contains(&axis.name));
        let way: Vec<(&str, String)> =
            of_cause.map(|(axis, value)| (axis.name.as_str(), side(axis, value))).collect();
        match counts.iter_mut().find(|(known, _)| *known == way) {
            Some((_, count)) => *count += 1,
            None => counts.push((way, 1)),
        }
    }
    counts.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    let all = found.falsified_trials;
    let names = |way: &[(&str, String)]| way.iter().map(|(name, _)| name.to_string()).collect::<Vec<_>>();
    let name = |way: &[(&str, String)]| {
        let has_sides = counts.iter().filter(|(other, _)| names(other) == names(way)).count() > 1;
        let axis = |(name, side): &(&str, String)| {
            if has_sides { format!("{} {side}", shown(name)) } else { shown(name) }
        };
        match way {
            [] => "the nominal scenario".to_string(),
            axes => axes.iter().map(axis).collect::<Vec<_>>().join(" with "),
        }
    };
    let named: Vec<String> =
        counts.iter().take(WAYS).map(|(way, count)| format!("{} ({count} of {all})", name(way))).collect();
    match counts.len() {
        0 => String::new(),
        n if n > WAYS => format!("{n}: {} and {} more", named.join(", "), n - WAYS),
        n => format!("{n}: {}", named.join(", ")),
    }
}

fn passes(found: &Falsification) -> Verdict {
    let subject = tested(&found.subject);
    let meaning = "whether the controller fails there is not known";
    let undecided = undecided(&found.without_verdict, meaning);
    let has_verdict = found.trials.iter().any(|trial| trial.minimum_robustness.is_some());
    if let Some(reason) = &found.asks_nothing {
        return Verdict::new(
            Conclusion::NoVerdict,
            format!("{undecided}{subject}: the requirement asks nothing: {reason}"),
        );
    }
    if !has_verdict {
        return Verdict::new(Conclusion::NoVerdict, format!("{undecided}{subject} was not tested"));
    }
    let headline = format!(
        "{undecided}{subject}: 0 of {}, {}",
        searches(found),
        plural(found.simulations, "simulation")
    );
    let mut verdict = Verdict::new(Conclusion::NothingFound, headline);
    verdict.add("varied", varied(&found.subject));
    verdict.add("closest", closest(found));
    verdict.add(
        "bound",
        match found.failure_rate_bound {
            Some(bound) => format!(
                "fewer than {} of the scenarios of this space fail (95 % confidence, from {})",
                percent_up(bound),
                plural(found.simulations, "uniform random sample")
            ),
            None => {
                "none: a search chose the points, so they say nothing about the rate of failures".to_string()
            }
        },
    );
    for changed in untried(found) {
        let command = Command::Again {
            question: "falsify",
            target: found.subject.target.clone(),
            kept: settings(&found.subject).into_iter().filter(|(key, _)| *key != changed.0).collect(),
            changed: vec![changed],
        };
        verdict.then("try", command);
    }
    if found.failure_rate_bound.is_none() {
        verdict.then(
            "try",
            Command::Again {
                question: "evaluate",
                target: found.subject.target.clone(),
                kept: settings(&found.subject),
                changed: Vec::new(),
            },
        );
    }
    verdict
}

/// Names the simulation that came nearest to a violation.
fn closest(found: &Falsification) -> String {
    let trials = found.trials.iter().filter_map(|trial| Some((trial.minimum_robustness?.0, trial)));
    let Some((robustness, trial)) = trials.min_by(|a, b| a.0.total_cmp(&b.0)) else { return String::new() };
    let place = trial
        .simulation
        .map_or(String::new(), |simulation| format!(" (search {}, simulation {simulation})", trial.trial));
    format!("robustness {}; a violation is below 0{place}", measured(robustness))
}

/// Returns what the target has and the search did not try: another space, a stricter formula, more
/// budget.
fn untried(found: &Falsification) -> Vec<(Key, Choice)> {
    let tried: Vec<&str> = found.subject.space.split('+').collect();
    let is_new = |name: &&String| !tried.contains(&name.as_str()) && !tried.contains(&"all");
    let mut next = Vec::new();
    if let Some(offered) = &found.subject.offered {
        let spaces = || offered.spaces.iter().filter(is_new);
        let space = spaces().find(|name| *name == "delay").or_else(|| spaces().next());
        next.extend(space.map(|name| (Key::SPACE, Choice::Text(name.clone()))));
        let strict = offered.formulas.iter().find(|(name, text)| name == "strict" && *text != found.formula);
        next.extend(strict.map(|(name, _)| (Key::FORMULA, Choice::Text(name.clone()))));
    }
    next.push((Key::BUDGET, Choice::Number((10 * u64::from(found.budget)).min(1_000_000) as f64)));
    next
}

/// Formats a small rate in percent, rounded up to two digits.
fn percent_up(rate: f64) -> String {
    let percent = 100.0 * rate;
    let decimals = (1.0 - percent.log10().floor()).clamp(0.0, 12.0) as usize;
    let scale = 10_f64.powi(decimals as i32);
    format!("{:.decimals$} %", (percent * scale).ceil() / scale)
}
