//! Mined values are the tightest ones: compared with all values of a grid.

use std::sync::Arc;

use mishandle_random::Sequence;
use mishandle_requirements::{MiningQuestion, NamedTrace, ParameterRange, mine};
use mishandle_results::Mining;
use mishandle_stl::{Clock, Formula, Monitor, Parameter, TimeUnit, Trace, is_satisfied};

const PERIOD: f64 = 0.5;

fn range(name: &str, low: f64, high: f64) -> ParameterRange {
    ParameterRange { name: name.to_owned(), low, high, unit: None, resolution: None }
}

fn log(name: &str, x: &[f64], y: &[f64]) -> NamedTrace {
    let names: Arc<[String]> = vec!["x".to_owned(), "y".to_owned()].into();
    let trace = Trace::from_columns(names, vec![x.to_vec(), y.to_vec()]);
    NamedTrace { name: name.to_owned(), trace, clock: Clock::steps(PERIOD), start: 0.0 }
}

fn ask(
    formula: &str,
    parameters: &[ParameterRange],
    share: f64,
    traces: &[NamedTrace],
) -> Result<Mining, String> {
    let question = MiningQuestion { formula, parameters, share, points: 8, unit: None };
    mine(&question, traces).map_err(|error| error.to_string())
}

fn holds(formula: &str, parameters: &[ParameterRange], values: &[f64], trace: &NamedTrace) -> bool {
    let named: Vec<Parameter<'_>> = parameters
        .iter()
        .zip(values)
        .map(|(range, value)| Parameter { name: &range.name, value: *value, unit: range.unit })
        .collect();
    let formula = Formula::parse_with(formula, &named).expect("a formula");
    let mut monitor = Monitor::new(&formula, trace.trace.names(), trace.clock).expect("a monitor");
    is_satisfied(monitor.robustness(&trace.trace).expect("a value"))
}

#[test]
fn the_tightest_limit_is_the_greatest_value_of_the_logs() {
    let traces = [log("a", &[1.0, 3.1, 2.0], &[0.0; 3]), log("b", &[0.0, 7.3, 1.0], &[0.0; 3])];
    let found = ask("always(x <= limit)", &[range("limit", 0.0, 50.0)], 1.0, &traces).expect("mined");
    let point = &found.points[0];
    assert_eq!((found.outcome.name(), point.values[0].0), ("found", 7.3));
    assert_eq!(point.formula, "always(x <= 7.3)");
    assert_eq!((point.decisive.as_deref(), point.decisive_sample), (Some("b"), Some(1)));
    assert_eq!((point.satisfied, point.violated_if_tighter[0]), (2, Some(1)));
    let half = ask("always(x <= limit)", &[range("limit", 0.0, 50.0)], 0.5, &traces).expect("mined");
    assert_eq!((half.points[0].values[0].0, half.points[0].satisfied), (3.1, 1));
}

#[test]
fn the_tightest_deadline_is_the_first_sample_that_meets_the_goal() {
    let traces = [log("a", &[0.0, 0.0, 0.0, 1.0, 0.0], &[0.0; 5])];
    let deadline = ParameterRange { unit: Some(TimeUnit::Seconds), ..range("T", 0.0, 2.0) };
    let found = ask("eventually[0:T](x >= 1)", std::slice::from_ref(&deadline), 1.0, &traces).expect("mined");
    assert_eq!(found.points[0].values[0].0, 3.0 * PERIOD);
    assert_eq!(found.points[0].formula, "eventually[0s:1.5s](x >= 1)");
    let held = ask("always[0:T](x <= 0.5)", &[deadline], 1.0, &traces).expect("mined");
    assert_eq!((held.points[0].values[0].0, held.parameters[0].tightest.name()), (2.0 * PERIOD, "high"));
}

#[test]
fn a_mined_formula_has_plain_numbers() {
    let traces = [log("a", &[4.0, 2.0], &[0.0; 2])];
    let found = ask("always(x <= -c)", &[range("c", -50.0, 5.0)], 1.0, &traces).expect("mined");
    assert_eq!((found.points[0].values[0].0, found.points[0].formula.as_str()), (-4.0, "always(x <= 4)"));
}

#[test]
fn ends_of_the_range_are_not_mined() {
    let traces = [log("a", &[5.0], &[0.0])];
    let low = ask("always(x <= limit)", &[range("limit", 0.0, 4.0)], 1.0, &traces).expect("an answer");
    assert_eq!((low.outcome.name(), low.points.len()), ("loosest-fails", 0));
    let high = ask("always(x <= limit)", &[range("limit", 6.0, 9.0)], 1.0, &traces).expect("an answer");
    assert_eq!((high.outcome.name(), high.points[0].values[0].0), ("tightest-holds", 6.0));
}

#[test]
fn traces_without_the_condition_do_not_support_a_value() {
    let traces = [log("a", &[1.0, 0.0], &[3.0, 9.0]), log("b", &[0.0, 0.0], &[9.0, 9.0])];
    let formula = "always(x >= 1 implies y <= limit)";
    let found = ask(formula, &[range("limit", 0.0, 50.0)], 1.0, &traces).expect("mined");
    let point = &found.points[0];
    assert_eq!((point.values[0].0, point.satisfied, point.support), (3.0, 2, 1));
    let supports: Vec<bool> = found.per_trace.iter().map(|trace| trace.supports).collect();
    assert_eq!(supports, [true, false]);
    // Above x = 1, the condition holds in no trace, and the tightest limit would be 0.
    let both = [range("least", 0.0, 9.0), range("limit", 0.0, 50.0)];
    let found = ask("always(x >= least implies y <= limit)", &both, 1.0, &traces).expect("mined");
    let values: Vec<Vec<f64>> =
        found.points.iter().map(|point| point.values.iter().map(|value| value.0).collect()).collect();
    assert_eq!(values.len(), found.points.iter().filter(|point| point.support > 0).count());
    assert!(!values.is_empty() && values.iter().all(|values| values[1] >= 3.0), "{values:?}");
}

/// A log in which the condition never holds satisfies every value. It must not make room for one
/// that violates the value.
#[test]
fn traces_without_the_condition_are_no_part_of_a_share() {
    let idle = |name: &str| log(name, &[0.0, 0.0], &[9.0, 9.0]);
    let traces =
        [log("a", &[1.0, 0.0], &[3.0, 9.0]), log("b", &[1.0, 0.0], &[5.0, 9.0]), idle("c"), idle("d")];
    let found = ask("always(x >= 1 implies y <= limit)", &[range("limit", 0.0, 50.0)], 0.5, &traces);
    let point = found.expect("mined").points.remove(0);
    assert_eq!((point.values[0].0, point.satisfied, point.support), (3.0, 3, 1));
    assert_eq!(point.decisive.as_deref(), Some("a"));
}

#[test]
fn a_trace_shorter_than_the_window_supports_nothing() {
    let traces = [log("short", &[0.0; 3], &[0.0; 3]), log("long", &[0.0; 9], &[0.0; 9])];
    let time = ParameterRange { unit: Some(TimeUnit::Seconds), ..range("T", 0.0, 2.0) };
    let found = ask("always[0:T](x <= 1)", &[time], 1.0, &traces).expect("mined");
    let point = &found.points[0];
    assert_eq!(
        (found.outcome.name(), point.satisfied, point.support, point.cut),
        ("tightest-holds", 2, 1, 1)
    );
    assert_eq!(point.decisive, None);
    let supports: Vec<bool> = found.per_trace.iter().map(|trace| trace.supports).collect();
    assert_eq!(supports, [false, true]);
}

/// The robustness of a log is least where x is near 1, but the time of the other log decides T.
#[test]
fn the_log_that_a_tighter_value_violates_decides() {
    let traces =
        [log("near", &[1.001, 0.0, 0.0, 0.0], &[0.0; 4]), log("late", &[0.0, 0.0, 3.0, 3.0], &[0.0; 4])];
    let found = ask("eventually[0:T](x >= 1)", &[range("T", 0.0, 3.0)], 1.0, &traces).expect("mined");
    assert_eq!((found.points[0].values[0].0, found.points[0].decisive.as_deref()), (2.0, Some("late")));
}

#[test]
fn messages_quote_parameters_by_their_names() {
    let traces = [log("a", &[1.0, 1.0], &[1.0, 1.0])];
    let error = |formula: &str, name: &str| {
        ask(formula, &[range(name, 0.0, 1.0)], 1.0, &traces).expect_err("a mistake")
    };
    let both = error("always(x * gain <= 1)", "gain");
    assert!(both.contains("`x * gain`"), "{both}");
    let windows = error("always[0:T](x <= 1) and eventually[0:T](x >= 1)", "T");
    assert!(windows.contains("`eventually[0:T]`") && windows.contains("`always[0:T]`"), "{windows}");
    assert!(error("always(x <= F)", "F").contains("`F` is an operator"));
    assert!(error("always(x <= a b)", "a b").contains("plain word"));
}

#[test]
fn mistakes_are_named() {
    let traces = [log("a", &[1.0], &[1.0])];
    let error = |formula: &str, parameter: ParameterRange| {
        ask(formula, &[parameter], 1.0, &traces).expect_err("a mistake")
    };
    assert!(error("always(x <= y)", range("y", 0.0, 1.0)).contains("is also a signal"));
    assert!(error("always(x <= 1)", range("c", 0.0, 1.0)).contains("does not depend"));
    assert!(
        error("always(x <= c and x >= c)", range("c", 0.0, 1.0))
            .contains("easier to satisfy at `c` (column 13)")
    );
    assert!(error("always(x * c <= 1)", range("c", 0.0, 1.0)).contains("both greater and less"));
    assert!(error("always(x == c)", range("c", 0.0, 1.0)).contains("both greater and less"));
    assert!(error("always(x <= c)", range("c", 1.0, 0.0)).contains("the lower one first"));
    assert!(error("always(x <= c)", range("c", f64::NAN, 0.0)).contains("the lower one first"));
    assert!(error("always(x <= not c)", range("not", 0.0, 1.0)).contains("cannot be a parameter"));
}

/// Formulas with two parameters, a and b. A greater value of one is either looser or tighter.
const FORMULAS: [&str; 8] = [
    "always(x <= a and y >= b)",
    "always(x <= a) or eventually[0:2](y >= b)",
    "eventually[0:a] always(x <= b)",
    "always(x >= b implies eventually[0:a](y >= 0))",
    "(x <= b) until[0:a] (y >= 0)",
    "always[a:inf](abs(x - y) <= b)",
    "once[0:3](x > -a) and not (historically(y > b))",
    "(x <= b) unless[0:a] (y >= 0.5)",
];

fn is_bound(formula: &str) -> bool {
    formula.contains("a]") || formula.contains("[a")
}

/// Each point of a front holds, and fails if any parameter is a step tighter; and no value of the
/// whole grid that holds is tighter than all points.
#[test]
fn fronts_are_those_of_the_whole_grid() {
    let mut random = Sequence::new(7, 0);
    let mut unsupported = 0;
    for formula in FORMULAS {
        for _ in 0..12 {
            let mut values = || (0..6).map(|_| (random.below(9) as f64 - 4.0) / 2.0).collect::<Vec<f64>>();
            let traces = [log("a", &values(), &values()), log("b", &values(), &values())];
            let first = if is_bound(formula) {
                ParameterRange { resolution: None, ..range("a", 0.0, 5.0) }
            } else {
                ParameterRange { resolution: Some(0.25), ..range("a", -3.0, 3.0) }
            };
            let second = ParameterRange { resolution: Some(0.25), ..range("b", -3.0, 3.0) };
            let parameters = [first, second];
            let steps = [if is_bound(formula) { 1.0 } else { 0.25 }, 0.25];
            let found = ask(formula, &parameters, 1.0, &traces).expect("mined");
            let all = |values: &[f64]| traces.iter().all(|trace| holds(formula, &parameters, values, trace));
            // Greater is looser for an axis whose tightest value is the low one.
            let signs: Vec<f64> = found
                .parameters
                .iter()
                .map(|p| if p.tightest.name() == "low" { 1.0 } else { -1.0 })
                .collect();
            let grid = |n: usize| {
                let range = &parameters[n];
                let count = ((range.high - range.low) / steps[n]).round() as usize;
                (0..=count).map(move |k| range.low + k as f64 * steps[n])
            };
            let valid: Vec<[f64; 2]> =
                grid(0).flat_map(|a| grid(1).map(move |b| [a, b])).filter(|values| all(values)).collect();
            assert_eq!(found.outcome.name() == "loosest-fails", valid.is_empty(), "{formula}");
            // Only the implication can ask nothing: its condition holds nowhere with any tightest
            // value.
            let is_tightest = |values: &&[f64; 2]| {
                (0..2).all(|axis| {
                    let mut tighter = **values;
                    tighter[axis] -= signs[axis] * steps[axis];
                    !(parameters[axis].low..=parameters[axis].high).contains(&tighter[axis]) || !all(&tighter)
                })
            };
            let columns = traces.iter().flat_map(|trace| trace.trace.column(0).to_vec());
            let greatest = columns.fold(f64::NEG_INFINITY, f64::max);
            let asks_nothing = formula.contains("implies")
                && !valid.is_empty()
                && valid.iter().filter(is_tightest).all(|values| values[1] > greatest);
            assert_eq!(found.outcome.name() == "no-support", asks_nothing, "{formula}");
            if asks_nothing {
                assert!(found.points.is_empty(), "{formula}");
                unsupported += 1;
                continue;
            }
            // The condition of an implication holds at some sample.
            let is_asked = |values: &[f64; 2]| {
                let x = traces.iter().flat_map(|trace| trace.trace.column(0));
                !formula.contains("implies") || x.into_iter().any(|x| *x >= values[1])
            };
            for point in &found.points {
                let values: Vec<f64> = point.values.iter().map(|value| value.0).collect();
                assert!(all(&values), "{formula} {values:?}");
                for axis in 0..2 {
                    let mut tighter = values.clone();
                    tighter[axis] -= signs[axis] * steps[axis];
                    let is_inside = (parameters[axis].low..=parameters[axis].high).contains(&tighter[axis]);
                    assert!(!is_inside || !all(&tighter), "{formula} {values:?} can be tighter");
                    assert_eq!(point.violated_if_tighter[axis].is_some(), is_inside, "{formula} {values:?}");
                }
            }
            // The tightest value of each parameter alone is on the front, if a trace asks for it.
            for axis in 0..2 {
                let least = |values: &mut dyn Iterator<Item = f64>| {
                    values.map(|value| signs[axis] * value).fold(f64::INFINITY, f64::min)
                };
                let in_grid =
                    least(&mut valid.iter().filter(|values| is_asked(values)).map(|values| values[axis]));
                let in_front = least(&mut found.points.iter().map(|point| point.values[axis].0));
                assert_eq!(in_grid, in_front, "{formula} {:?}", found.points);
            }
        }
    }
    assert!(unsupported < 10, "{unsupported}");
}

/// The tightest end of the range satisfies the formula where nothing is asked; it is not a value.
#[test]
fn values_that_no_trace_supports_are_not_mined() {
    let idle = [log("a", &[0.0, 0.0], &[9.0, 9.0]), log("b", &[0.0, 0.0], &[3.0, 3.0])];
    let short = [log("a", &[0.0; 3], &[0.0; 3])];
    let time = ParameterRange { unit: Some(TimeUnit::Seconds), ..range("T", 0.0, 2.0) };
    let limit = range("limit", 0.0, 50.0);
    for (formula, parameter, traces) in
        [("always(x >= 1 implies y <= limit)", &limit, &idle[..]), ("always[0:T](x <= 1)", &time, &short[..])]
    {
        let found = ask(formula, std::slice::from_ref(parameter), 1.0, traces).expect("an answer");
        assert_eq!(found.outcome.name(), "no-support", "{formula}");
        assert!(found.points.is_empty() && found.per_trace.is_empty(), "{formula}: {found:?}");
    }
}
