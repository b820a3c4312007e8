//! Templates of Dwyer, EARS and FRET have the verdicts of their definitions, which are stated here
//! by intervals of samples and share nothing with formulas.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

use mishandle_random::Sequence;
use mishandle_requirements::{Pattern, pattern, patterns};
use mishandle_results::ParameterKind;
use mishandle_stl::{Clock, Formula, Monitor, Trace, is_satisfied};

/// The duration and the deadline, in samples.
const DURATION: usize = 2;

const SCOPES: [&str; 5] = ["-globally", "-before", "-after-until", "-after", "-between"];

/// A condition at each sample.
type Columns = BTreeMap<&'static str, Vec<bool>>;

fn samples(columns: &Columns) -> usize {
    columns.values().next().map_or(0, Vec::len)
}

/// Returns the intervals of a scope.
fn scopes(scope: &str, columns: &Columns) -> Vec<Range<usize>> {
    let n = samples(columns);
    let first = |name: &str| columns[name].iter().position(|holds| *holds);
    match scope {
        "-before" => first("end").map(|end| 0..end).into_iter().collect(),
        "-after" => first("begin").map(|begin| begin..n).into_iter().collect(),
        "-between" | "-after-until" => (0..n)
            .filter(|t| columns["begin"][*t] && !columns["end"][*t])
            .filter_map(|t| {
                let end = (t..n).find(|end| columns["end"][*end]);
                end.or((scope == "-after-until").then_some(n)).map(|end| t..end)
            })
            .collect(),
        _ => std::iter::once(0..n).collect(),
    }
}

/// Returns whether a pattern of Dwyer, Avrunin and Corbett holds in an interval.
fn dwyer(pattern: &str, scope: Range<usize>, columns: &Columns) -> bool {
    let p = |t: usize| columns["p"][t];
    let q = |t: usize| columns["q"][t];
    let Range { start, end } = scope;
    match pattern {
        "absence" => !(start..end).any(p),
        "invariant" => (start..end).all(p),
        "existence" => (start..end).any(p),
        "precedence" => (start..end).filter(|t| q(*t)).all(|t| (start..=t).any(p)),
        "response" => (start..end).filter(|t| p(*t)).all(|t| (t..end).any(q)),
        _ => panic!("{pattern}"),
    }
}

/// Returns the samples at which a condition starts to hold in an interval.
fn starts(condition: &[bool], interval: Range<usize>) -> Vec<usize> {
    let first = interval.start;
    interval.filter(|t| condition[*t] && (*t == first || !condition[t - 1])).collect()
}

/// Returns whether a requirement of FRET holds: its interval semantics, in which `n` samples later
/// is `n` samples after the trigger.
fn fret(timing: &str, columns: &Columns) -> bool {
    let n = samples(columns);
    let response = |t: usize| columns["response"][t];
    let scope = &columns["scope"];
    let intervals = starts(scope, 0..n).into_iter().map(|left| {
        let right = (left..n).find(|t| !scope[*t]).unwrap_or(n);
        left..right
    });
    intervals.into_iter().all(|interval| {
        let end = interval.end;
        starts(&columns["condition"], interval).into_iter().all(|t| {
            let stop = || (t..end).find(|stop| columns["stop"][*stop]);
            let last = t + DURATION;
            match timing {
                "immediately" => response(t),
                "always" => (t..end).all(response),
                "never" => !(t..end).any(response),
                "eventually" => (t..end).any(response),
                "until" => (t..stop().unwrap_or(end)).all(response),
                "before" => stop().is_none_or(|stop| (t..stop).any(response)),
                "within" => last >= end || (t..=last).any(response),
                "for" => (t..end.min(last + 1)).all(response),
                "after" => !(t..end.min(last + 1)).any(response) && (last + 1 >= end || response(last + 1)),
                _ => panic!("{timing}"),
            }
        })
    })
}

fn ears(template: &str, columns: &Columns) -> bool {
    let n = samples(columns);
    let response = |t: usize| columns["response"][t];
    let whenever = |name: &str| (0..n).all(|t| !columns[name][t] || response(t));
    match template {
        "ubiquitous" => (0..n).all(response),
        "state-driven" => whenever("state"),
        "optional-feature" => whenever("feature"),
        _ => {
            starts(&columns["trigger"], 0..n).into_iter().all(|t| (t..n.min(t + DURATION + 1)).any(response))
        }
    }
}

/// Returns the verdict by definition; `None` if the pattern is of another kind.
fn expected(name: &str, columns: &Columns) -> Option<bool> {
    if let Some(timing) = name.strip_prefix("fret-") {
        return Some(fret(timing, columns));
    }
    if let Some(template) = name.strip_prefix("ears-") {
        return Some(ears(template, columns));
    }
    let scope = SCOPES.into_iter().find(|scope| name.ends_with(scope));
    let is_general = ["absence", "invariant", "precedence"].contains(&name);
    let pattern = name.strip_suffix(scope.filter(|_| !is_general).unwrap_or_default())?;
    let known = scope.is_some() || is_general;
    let scope = scope.unwrap_or_default();
    known.then(|| scopes(scope, columns).into_iter().all(|scope| dwyer(pattern, scope, columns)))
}

/// Returns the verdict of the formula, in which `name` holds where the signal is 2.
fn found(pattern: &Pattern, columns: &Columns, leaves_defaults: bool) -> bool {
    let setting = |slot: &mishandle_requirements::Slot| {
        let value = match slot.kind {
            ParameterKind::Time => format!("{DURATION}s"),
            _ => format!("{} >= 1", slot.name),
        };
        (slot.name.to_owned(), value)
    };
    let slots = pattern.slots.iter().filter(|slot| !leaves_defaults || slot.default.is_none());
    let (formula, _) = pattern.fill(&slots.map(setting).collect::<Vec<_>>()).expect("all are set");
    let names: Arc<[String]> = columns.keys().map(|name| (*name).to_owned()).collect();
    let values = columns.values().map(|column| column.iter().map(|holds| 2.0 * f64::from(*holds)).collect());
    let trace = Trace::from_columns(Arc::clone(&names), values.collect());
    let formula = Formula::parse(&formula).expect("a formula");
    let mut monitor = Monitor::new(&formula, &names, Clock::steps(1.0)).expect("of these signals");
    is_satisfied(monitor.robustness(&trace).expect("a value"))
}

#[test]
fn templates_have_the_verdicts_of_their_definitions() {
    let mut random = Sequence::new(11, 0);
    let mut templates = 0;
    for pattern in patterns() {
        let mut counts = [0, 0];
        for number in 0..500 {
            let n = 1 + random.below(9) as usize;
            let leaves_defaults = number % 4 == 0;
            let column = |random: &mut Sequence| (0..n).map(|_| random.below(2) == 0).collect::<Vec<bool>>();
            let conditions = pattern.slots.iter().filter(|slot| slot.kind == ParameterKind::Condition);
            let columns: Columns = conditions
                .map(|slot| match slot.default {
                    Some(_) if leaves_defaults => (slot.name, vec![true; n]),
                    _ => (slot.name, column(&mut random)),
                })
                .collect();
            let Some(expected) = expected(pattern.name, &columns) else { break };
            assert_eq!(
                found(pattern, &columns, leaves_defaults),
                expected,
                "{} on {columns:?}",
                pattern.name
            );
            counts[usize::from(expected)] += 1;
        }
        templates += usize::from(counts != [0, 0]);
        assert!(counts == [0, 0] || counts.iter().all(|count| *count > 20), "{}: {counts:?}", pattern.name);
    }
    // 25 of Dwyer, 5 of EARS, 9 of FRET.
    assert_eq!(templates, 39);
}

/// Deadlines of the shown traces are their own, so that those are judged by hand.
#[test]
fn the_shown_traces_of_templates_are_right_by_definition() {
    for pattern in patterns() {
        let has_time = pattern.slots.iter().any(|slot| slot.kind == ParameterKind::Time);
        let is_template =
            pattern.shown.signals.iter().all(|signal| pattern.slots.iter().any(|slot| slot.name == *signal));
        if has_time || !is_template {
            continue;
        }
        let columns = |values: &[&[f64]]| -> Columns {
            let bits = values.iter().map(|column| column.iter().map(|value| *value >= 1.0).collect());
            pattern.shown.signals.iter().copied().zip(bits).collect()
        };
        assert_eq!(expected(pattern.name, &columns(pattern.shown.satisfies)), Some(true), "{}", pattern.name);
        assert_eq!(expected(pattern.name, &columns(pattern.shown.violates)), Some(false), "{}", pattern.name);
    }
}

/// A precedence is no absence before an event: without the event, the first one is violated where
/// the other one requires nothing.
#[test]
fn an_absence_before_an_event_requires_nothing_without_it() {
    let columns: Columns =
        [("p", vec![false, true]), ("q", vec![false, true]), ("end", vec![false; 2])].into();
    let of = |name: &str| found(pattern(name).expect("there is one"), &columns, false);
    assert!(of("absence-before") && of("precedence-before"));
    let columns: Columns = [("p", vec![false; 2]), ("q", vec![false, true])].into();
    assert!(!found(pattern("precedence").expect("there is one"), &columns, false));
}
