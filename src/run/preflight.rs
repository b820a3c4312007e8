//! Checks before the first simulation counts: mistakes that no result would show.

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use mishandle_rollout::{
    Axis, AxisKind, AxisValues, Episode, EpisodeEnd, Holds, Request, Scenario, Seed, System,
};
use mishandle_stl::{Clock, Formula, Monitor, Trace, is_satisfied};

use crate::error::MishandleError;
use crate::resolve::{ResolvedPlan, contract_warnings, nominal_scenario};
use crate::run::cost::{Probes, cost};
use crate::run::end_text;
use crate::run::violation::decided;

/// Time that the probes take at most, unless they are less than [`SHARE`] of the question.
const TIME: Duration = Duration::from_secs(1);

/// Share of the question's simulations that may be probes however long they take.
const SHARE: f64 = 0.01;

/// Share of an axis at which the other disturbances are held while one is probed: away from
/// nominal, because the time of a push means nothing without its force.
const AWAY: f64 = 0.8;

/// Largest length of a warning.
const MAX_CHARACTERS: usize = 1000;

/// Largest number of values of a discrete axis that are probed.
const MAX_LEVELS: usize = 5;

/// Purpose of the simulations before the first one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Probed {
    /// Requirement and axes.
    All,
    /// The requirement alone: another run probes the axes of this space.
    Requirement,
}

/// Checks requirement and space with a few simulations of their own, which are part of no result,
/// and returns warnings in words, and what the simulations cost.
///
/// The first probe is the nominal scenario. The next ones set each axis to its bounds, and to its
/// nominal value if the bounds agree. If that changes no trace, the same follows with each of
/// [`Others`]. The probes end after a second or one percent of the question's simulations,
/// whichever is more, for each of these. A probe that fails is skipped: the question itself reports
/// such simulations. If the nominal one fails, few others may succeed, so that is a warning.
///
/// # Errors
/// If the requirement does not fit the signals, the policy of a target file cannot act, or the
/// system fails as a whole, as after Ctrl-C in a system in Python.
pub(crate) fn preflight(
    resolved: &ResolvedPlan,
    probed: Probed,
) -> Result<(Vec<String>, Probes), MishandleError> {
    let mut warnings = contract_warnings(&resolved.plan)?;
    unseen_axes(resolved, &mut warnings);
    fixed_axes(resolved, &mut warnings);
    mixed_units(resolved, &mut warnings)?;
    let seed = Seed(resolved.plan.seed).child(u64::MAX).child(u64::MAX);
    let mut system = CountedSystem { system: resolved.system()?, simulations: 0 };
    let start = Instant::now();
    let nominal = Request::new(resolved.space.nominal(), seed);
    let Some(nominal) = system.rollout(vec![nominal])?.pop() else {
        return Ok((warnings, Probes::default()));
    };
    warnings.extend(failed(&nominal, resolved));
    let each = start.elapsed().as_secs_f64().max(1e-6);
    let in_time = (TIME.as_secs_f64() / each) as usize;
    let limit = in_time.max((SHARE * cost(resolved)?.simulations as f64) as usize);
    let mut probes = vec![nominal];
    // Traces of a nondeterministic target differ without a reason.
    if resolved.target.is_deterministic && probed == Probed::All {
        axes_without_effect(resolved, &mut system, seed, limit, &mut probes, &mut warnings)?;
    }
    let seconds = match system.simulations - 1 {
        0 => each,
        others => (start.elapsed().as_secs_f64() - each) / others as f64,
    };
    let found = Probes { simulations: system.simulations, seconds };
    requirement(resolved, &probes, &mut warnings)?;
    Ok((warnings.iter().map(|warning| short(warning)).collect(), found))
}

/// Shortens a warning: a run file has short texts, and nobody reads a long one.
fn short(warning: &str) -> String {
    warning.chars().take(MAX_CHARACTERS).collect()
}

/// Warns of a nominal scenario that a simulator or a controller cannot simulate.
fn failed(nominal: &Episode, resolved: &ResolvedPlan) -> Option<String> {
    let ends = matches!(
        nominal.end,
        EpisodeEnd::Crashed { .. } | EpisodeEnd::TimedOut { .. } | EpisodeEnd::InvalidScenario
    );
    let names: Vec<&str> = resolved.signals.iter().map(|signal| signal.name.as_str()).collect();
    let reason = if nominal.reason.is_empty() { String::new() } else { format!(": {}", nominal.reason) };
    let scenario = nominal_scenario(&resolved.subject());
    ends.then(|| format!("{scenario} has no verdict: {}{reason}", end_text(nominal.end, &names)))
}

/// A system that counts its probes.
struct CountedSystem {
    system: Box<dyn System>,
    simulations: u64,
}

impl CountedSystem {
    fn rollout(&mut self, requests: Vec<Request>) -> Result<Vec<Episode>, MishandleError> {
        self.simulations += requests.len() as u64;
        let requests: Vec<Request> =
            (1..).zip(requests).map(|(number, request)| Request { number, ..request }).collect();
        Ok(self.system.rollout(&requests)?)
    }
}

/// Returns whether an axis changes images that the controller of this target does not see.
fn is_unseen(axis: &Axis, resolved: &ResolvedPlan) -> bool {
    let named = |known: &Axis| known.name == axis.name;
    let has_space = resolved.target.spaces.iter().any(|space| space.axes().iter().any(named));
    has_space && !resolved.target.axes.iter().any(named)
}

fn unseen_axes(resolved: &ResolvedPlan, warnings: &mut Vec<String>) {
    let unseen = resolved.space.axes().iter().filter(|axis| is_unseen(axis, resolved));
    let names: Vec<String> = unseen.map(|axis| format!("`{}`", axis.name)).collect();
    if !names.is_empty() {
        warnings.push(format!(
            "these axes of sight change nothing that the controller sees: {}",
            names.join(", ")
        ));
    }
}

fn fixed_axes(resolved: &ResolvedPlan, warnings: &mut Vec<String>) {
    let is_asked = |axis: &Axis| resolved.plan.axes.contains_key(&axis.name);
    for axis in resolved.space.axes().iter().filter(|axis| axis.is_fixed() && !is_asked(axis)) {
        warnings.push(format!("axis `{}` has one value, {}: nothing varies it", axis.name, axis.low));
    }
}

/// Warns of an `and` or `or` whose operands have different units: the smallest number decides,
/// whatever its unit.
fn mixed_units(resolved: &ResolvedPlan, warnings: &mut Vec<String>) -> Result<(), MishandleError> {
    let formula = &resolved.specification.requirement;
    let mut units = BTreeSet::new();
    for name in formula.signals() {
        let signal = resolved.signals.iter().find(|signal| signal.name == name);
        units.extend(signal.map(|signal| signal.unit.as_str()).filter(|unit| !unit.is_empty()));
    }
    let clock = Clock::steps(resolved.target.control_dt);
    let nodes = formula.subformula_nodes(&clock).map_err(|source| monitor_error(formula, source))?;
    let joins = nodes.iter().any(|node| matches!(node.operator, Some("and" | "or" | "implies")));
    if joins && units.len() > 1 {
        let units: Vec<&str> = units.into_iter().collect();
        warnings.push(format!(
            "the requirement compares numbers in {}: its robustness is the smallest of them, whatever the unit; \
             an explanation of masked parts shows which part decides",
            units.join(" and ")
        ));
    }
    Ok(())
}

/// The values of the other axes while one is probed. Each can hide an effect: a push means nothing
/// without its duration, nor after a robot has fallen because of a delay.
#[derive(Clone, Copy)]
enum Others {
    /// Away from nominal, but for the start, which is nominal: it may be an equilibrium.
    Away,
    /// Away from nominal.
    AllAway,
    /// Those of the same kind are away from nominal, the rest is nominal.
    KindAway,
    /// Nominal.
    Nominal,
    /// The random scenario of this number.
    Random(u64),
}

impl Others {
    const ALL: [Others; 7] = [
        Others::Away,
        Others::AllAway,
        Others::KindAway,
        Others::Nominal,
        Others::Random(0),
        Others::Random(1),
        Others::Random(2),
    ];

    /// Returns whether another axis is away from nominal while `axis` is probed.
    fn is_away(self, axis: &Axis, other: &Axis) -> bool {
        let [axis, other] = [axis, other].map(|axis| axis.kind);
        match self {
            Others::Away => axis != AxisKind::Start && other != AxisKind::Start,
            Others::AllAway => axis != AxisKind::Start || other == AxisKind::Start,
            Others::KindAway => axis == other,
            Others::Nominal | Others::Random(_) => false,
        }
    }
}

/// Warns of axes that change no trace, whatever the values of the others.
fn axes_without_effect(
    resolved: &ResolvedPlan,
    system: &mut CountedSystem,
    seed: Seed,
    limit: usize,
    probes: &mut Vec<Episode>,
    warnings: &mut Vec<String>,
) -> Result<(), MishandleError> {
    let axes = resolved.space.axes();
    let is_probed = |index: &usize| !axes[*index].is_fixed() && !is_unseen(&axes[*index], resolved);
    let mut unchanged: Vec<usize> = (0..axes.len()).filter(is_probed).collect();
    for others in Others::ALL {
        unchanged = unchanging(resolved, system, seed, limit, &unchanged, others, probes)?;
    }
    warnings.extend(unchanged.into_iter().map(|index| without_effect(&axes[index])));
    Ok(())
}

/// Returns the warning of an axis that changes no trace at the points that were probed.
pub(super) fn without_effect(axis: &Axis) -> String {
    short(&format!(
        "axis `{}` changes no trace at the probed points: all signals are equal at its {}, with the other axes nominal, away \
         from nominal and at random; is its name right, and does the system read it?",
        axis.name,
        match axis.levels() {
            Some(levels) if levels > MAX_LEVELS => "nominal value and some others",
            Some(_) => "values",
            None => "lowest, nominal and highest value",
        }
    ))
}

/// Probes axes at their bounds and between them, and returns those that change no trace.
fn unchanging(
    resolved: &ResolvedPlan,
    system: &mut CountedSystem,
    seed: Seed,
    limit: usize,
    probed: &[usize],
    way: Others,
    probes: &mut Vec<Episode>,
) -> Result<Vec<usize>, MishandleError> {
    let axes = resolved.space.axes();
    let values = |axis: &Axis| -> Vec<f64> {
        match axis.levels() {
            Some(levels) => {
                let count = levels.min(MAX_LEVELS);
                let level = |index: usize| index * (levels - 1) / (count - 1).max(1);
                (0..count).map(|index| axis.at((level(index) as f64 + 0.5) / levels as f64)).collect()
            }
            None => vec![axis.low, axis.high],
        }
    };
    let is_category = |axis: &Axis| matches!(axis.values, AxisValues::Categorical(_));
    let is_same_fault = |index: usize, other: &Axis| {
        let place = axes.iter().position(|axis| axis.name == other.name).unwrap_or(index);
        let own = resolved.space.with_needed(index);
        let others = resolved.space.with_needed(place);
        own.iter().any(|needed| others.contains(needed))
    };
    // The values of the other axis with which the axis has an effect, if they are listed.
    let effective = |axis: &Axis, other: &Axis| {
        axis.conditions.iter().filter(|needed| needed.axis == other.name).find_map(|needed| {
            match &needed.holds {
                Holds::OneOf(values) => {
                    let in_space = values.iter().copied().filter(|x| (other.low..=other.high).contains(x));
                    Some(in_space.take(MAX_LEVELS).collect::<Vec<f64>>())
                }
                Holds::Except(_) => None,
            }
        })
    };
    // The scenarios in which an axis is probed: with each category of another axis, because the
    // severity of a fault means nothing without the fault.
    let bases = |index: usize| -> Vec<Vec<Option<f64>>> {
        if let Others::Random(number) = way {
            return vec![resolved.space.sample(seed, number).values().to_vec()];
        }
        // Another fault would hide the effect, and a late onset comes after the end of an episode.
        let hides = |other: &Axis| {
            other.kind == AxisKind::Fault && (other.is_onset() || !is_same_fault(index, other))
        };
        let is_away = |other: &Axis| way.is_away(&axes[index], other) && !other.is_fixed() && !hides(other);
        let value = |other: &Axis| if is_away(other) { Some(other.at(AWAY)) } else { other.nominal };
        let base: Vec<Option<f64>> = axes.iter().map(value).collect();
        let others = axes.iter().enumerate();
        let category = others.filter(|(other, axis)| *other != index && is_category(axis) && is_away(axis));
        // The one that decides whether the axis has an effect, if there is one.
        let decides = |other: &Axis| axes[index].conditions.iter().any(|needed| needed.axis == other.name);
        let Some((place, axis)) = category.min_by_key(|(_, other)| !decides(other)) else {
            return vec![base];
        };
        let with = |value: f64| {
            let mut base = base.clone();
            base[place] = Some(value);
            base
        };
        effective(&axes[index], axis).unwrap_or_else(|| values(axis)).into_iter().map(with).collect()
    };
    let request = |base: &[Option<f64>], index: usize, value: Option<f64>| {
        let mut scenario = base.to_vec();
        scenario[index] = value;
        Request::new(resolved.space.canonical(Scenario::new(scenario)), seed)
    };
    let mut requests = Vec::new();
    let mut ranges = Vec::new();
    for index in probed.iter().copied() {
        let bases = bases(index);
        let values = values(&axes[index]);
        let first = requests.len();
        let count = bases.len() * values.len();
        if first + count > limit {
            break;
        }
        for base in &bases {
            requests.extend(values.iter().map(|value| request(base, index, Some(*value))));
        }
        ranges.push((index, bases, values.len(), first..first + count));
    }
    let episodes = system.rollout(requests)?;
    let is_comparable = |episode: &Episode| episode.end.has_verdict() && !episode.trace.is_empty();
    let mut unchanged = Vec::new();
    for (index, bases, count, range) in ranges {
        let Some(found) = episodes.get(range).filter(|found| found.iter().all(is_comparable)) else {
            continue;
        };
        let changes = |group: &[Episode]| group.iter().any(|other| !is_same(&group[0].trace, &other.trace));
        if !found.chunks(count).any(changes) {
            unchanged.push((index, bases, found.iter().step_by(count)));
        }
    }
    // The bounds of a symmetric system have equal traces, but the value between them has another.
    let between = |(index, bases, _): &(usize, Vec<Vec<Option<f64>>>, _)| -> Vec<Request> {
        let value = axes[*index].nominal.or(Some(axes[*index].at(0.5)));
        bases.iter().map(|base| request(base, *index, value)).collect()
    };
    let mut nominal = system.rollout(unchanged.iter().flat_map(between).collect())?.into_iter();
    let mut without_effect = Vec::new();
    for (index, bases, found) in unchanged {
        let nominal: Vec<Episode> = nominal.by_ref().take(bases.len()).collect();
        let is_same = |(a, b): (&Episode, &Episode)| is_comparable(b) && is_same(&a.trace, &b.trace);
        if nominal.len() == bases.len() && found.zip(&nominal).all(is_same) {
            without_effect.push(index);
        }
    }
    probes.extend(episodes);
    Ok(without_effect)
}

fn is_same(a: &Trace, b: &Trace) -> bool {
    let bits = |trace: &Trace, index: usize| -> Vec<u64> {
        trace.column(index).iter().map(|value| value.to_bits()).collect()
    };
    a.len() == b.len() && (0..a.names().len()).all(|index| bits(a, index) == bits(b, index))
}

/// Warns of a requirement that says nothing about these simulations, the first of which is the
/// nominal one.
fn requirement(
    resolved: &ResolvedPlan,
    probes: &[Episode],
    warnings: &mut Vec<String>,
) -> Result<(), MishandleError> {
    let formula = &resolved.specification.requirement;
    let clock = Clock::steps(resolved.target.control_dt);
    let nominal = &probes[0];
    if let Some(robustness) = nominal.robustness().filter(|_| nominal.is_violated()) {
        warnings.push(format!(
            "{} violates the requirement (robustness {}): a failure elsewhere says little about its scenario",
            nominal_scenario(&resolved.subject()),
            mishandle_text::decimal(robustness, 4)
        ));
    }
    let names = resolved.signal_names();
    let monitor = Monitor::new(formula, &names, clock).map_err(|source| monitor_error(formula, source))?;
    let samples = nominal.trace.len();
    if nominal.end == EpisodeEnd::Completed && samples > 0 && nominal.robustness().is_none() {
        let needed = monitor.needed_samples();
        if needed > samples {
            warnings.push(format!(
                "the requirement reads {needed} samples, and a trace has {samples}: no simulation has a verdict; make the \
                 episode {} longer, or the windows shorter",
                mishandle_text::plural((needed - samples) as u64, "sample")
            ));
        }
    }
    let with_verdict: Vec<&Episode> = probes.iter().filter(|probe| probe.robustness().is_some()).collect();
    if with_verdict.is_empty() || with_verdict.iter().any(|probe| probe.trace.len() < 2) {
        return Ok(());
    }
    let mut at_start = true;
    for probe in &with_verdict {
        let robustness = probe.robustness().unwrap_or_default();
        at_start &= decided(formula, &probe.trace, clock, robustness)? == Some(0);
    }
    if at_start {
        let verdict = if nominal.is_violated() { "violates" } else { "satisfies" };
        warnings.push(format!(
            "sample 0 alone {verdict} the requirement, whatever follows: the controller has no influence on the verdict"
        ));
    }
    for premise in premises(formula, clock)? {
        let mut monitor =
            Monitor::new(&premise, &names, clock).map_err(|source| monitor_error(&premise, source))?;
        let mut is_met = false;
        for probe in &with_verdict {
            let values =
                monitor.robustness_signal(&probe.trace).map_err(|source| monitor_error(&premise, source))?;
            is_met |= values.iter().copied().any(is_satisfied);
        }
        if !is_met {
            warnings.push(format!(
                "the premise `{premise}` held at no sample of the first {}: there the requirement asks nothing",
                mishandle_text::plural(with_verdict.len() as u64, "simulation")
            ));
        }
    }
    Ok(())
}

/// Returns the left operands of `implies`.
fn premises(formula: &Formula, clock: Clock) -> Result<Vec<Formula>, MishandleError> {
    let nodes = formula.subformula_nodes(&clock).map_err(|source| monitor_error(formula, source))?;
    let of_premises = nodes.iter().filter(|node| node.operator == Some("implies"));
    // The texts of all sub-formulas are quadratic in the length of the formula.
    let mut texts = formula.subformulas();
    let mut next = 0;
    let mut premise = |node: &mishandle_stl::SubformulaNode| {
        let position = *node.operands.first()?;
        let text = texts.nth(position.checked_sub(next)?)?;
        next = position + 1;
        Formula::parse(&text).ok()
    };
    let mut found = Vec::new();
    of_premises.for_each(|node| found.extend(premise(node)));
    Ok(found)
}

fn monitor_error(formula: &Formula, source: mishandle_stl::MonitorError) -> MishandleError {
    mishandle_rollout::RolloutError::Monitor { formula: formula.to_string(), source }.into()
}

#[cfg(test)]
#[path = "../../crates/stl/tests/processor_time.rs"]
mod processor_time;

#[cfg(test)]
mod tests {
    use super::processor_time::processor_secs;
    use super::*;

    fn premises_of(text: &str) -> Vec<String> {
        let found = premises(&Formula::parse(text).unwrap(), Clock::steps(0.1)).unwrap();
        found.iter().map(ToString::to_string).collect()
    }

    #[test]
    fn premises_are_the_left_operands_of_implies_nested_ones_too() {
        let text = "always((a > 0 implies b > 0) implies (c > 0 implies d > 0)) and (e > 0 implies f > 0)";
        assert_eq!(premises_of(text), ["a > 0 implies b > 0", "a > 0", "c > 0", "e > 0"]);
        assert!(premises_of("always(a > 0)").is_empty());
    }

    #[test]
    fn a_long_formula_has_its_premises_in_linear_time() {
        // The texts of its sub-formulas have 0.8 GB.
        let text = format!("{}(a > 0 implies b > 0)", "not ".repeat(20_000));
        let start = processor_secs();
        assert_eq!(premises_of(&text), ["a > 0"]);
        assert!(processor_secs() - start < 5.0, "{} s", processor_secs() - start);
    }
}
