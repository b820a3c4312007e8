//! Laws of online monitors, checked on random formulas.

use super::naive::{NAMES, Random, Tree};
use mishandle_stl::{Bounds, Clock, CutMonitor, Formula, Monitor, OnlineMonitor, Trace, is_satisfied};
use std::sync::Arc;

fn names() -> Arc<[String]> {
    NAMES.map(String::from).into()
}

fn online(texts: &[&str], samples: Option<usize>) -> OnlineMonitor {
    let formulas: Vec<Formula> = texts.iter().map(|text| Formula::parse(text).unwrap()).collect();
    OnlineMonitor::new(&formulas, &names(), Clock::steps(1.0), samples).unwrap()
}

fn sample(columns: &[Vec<f64>], step: usize) -> Vec<f64> {
    columns.iter().map(|column| column[step]).collect()
}

/// Number of random formulas of each law; MISHANDLE_FORMULAS sets another one.
fn formulas(default: usize) -> usize {
    std::env::var("MISHANDLE_FORMULAS").map_or(default, |text| text.parse().unwrap())
}

fn bits(bounds: Bounds) -> (u64, u64) {
    (bounds.low.to_bits(), bounds.high.to_bits())
}

/// A random formula that reads a signal, with its text, and a trace.
fn case(random: &mut Random, case: usize) -> (Tree, String, Vec<Vec<f64>>) {
    let samples = 1 + random.below(if case.is_multiple_of(20) { 40 } else { 14 });
    let size = random.below(6);
    let n = 1 + samples * random.below(4) / 3;
    let tree = Tree::reading(random, size, n);
    let text = tree.write(random);
    (tree, text, NAMES.map(|_| random.column(samples)).to_vec())
}

#[test]
fn the_bounds_follow_the_definitions_at_every_prefix() {
    let mut random = Random(41);
    let mut prefixes = 0;
    let mut early = 0;
    for number in 0..formulas(4000) {
        let (tree, text, columns) = case(&mut random, number);
        // Shorter than the trace, as long, or longer.
        let stated = 1 + random.below(columns[0].len() + 6);
        let mut monitor = online(&[&text], Some(stated));
        for n in 1..=columns[0].len() {
            monitor.push(&sample(&columns, n - 1)).unwrap();
            let found = monitor.bounds(0);
            let expected = tree.bounds(&columns, n, &[stated.max(n)]).unwrap_or(Bounds::UNKNOWN);
            assert_eq!(
                bits(found),
                bits(expected),
                "{text} after {n} of {stated} on {columns:?}: {found:?} {expected:?}"
            );
            prefixes += 1;
            early += usize::from(n < stated && found.verdict().is_some());
        }
    }
    assert!(8 * early > prefixes, "{early} of {prefixes} verdicts are early");
}

/// The bounds contain those of every length. They may be wider, because the length counts as
/// independent for each window without an end.
#[test]
fn the_bounds_without_a_length_are_those_of_all_lengths() {
    let mut random = Random(42);
    let mut prefixes = 0;
    let mut wider = 0;
    for number in 0..formulas(400) {
        let (tree, text, columns) = case(&mut random, number);
        let mut monitor = online(&[&text], None);
        let (behind, ahead) = tree.offsets();
        for n in 1..=columns[0].len() {
            monitor.push(&sample(&columns, n - 1)).unwrap();
            let found = monitor.bounds(0);
            // Longer traces have the bounds of the longest one: all windows contain unknown
            // samples.
            let longest = n + (ahead - behind) as usize + 8;
            let lengths: Vec<usize> = (n..=longest).collect();
            let expected = tree.bounds(&columns, n, &lengths).unwrap_or(Bounds::UNKNOWN);
            assert_eq!(
                bits(found),
                bits(expected),
                "{text} after {n} on {columns:?}: {found:?} {expected:?}"
            );
            let each = lengths.iter().filter_map(|length| tree.bounds(&columns, n, &[*length]));
            let join = |x: Bounds, y: Bounds| Bounds { low: x.low.min(y.low), high: x.high.max(y.high) };
            let hull = each.reduce(join).unwrap();
            assert!(
                found.low <= hull.low && hull.high <= found.high,
                "{text} after {n} on {columns:?}: {found:?} {hull:?}"
            );
            prefixes += 1;
            wider += usize::from(found != hull);
        }
    }
    assert!(wider * 50 < prefixes, "{wider} of {prefixes} bounds are wider");
}

#[test]
fn each_push_decides_the_value_that_the_whole_trace_has() {
    let mut random = Random(43);
    let mut values = 0;
    for number in 0..formulas(4000) {
        let (_, text, columns) = case(&mut random, number);
        let samples = columns[0].len();
        let formula = Formula::parse(&text).unwrap();
        let mut offline = Monitor::new(&formula, &names(), Clock::steps(1.0)).unwrap();
        let mut trace = Trace::new(names());
        (0..samples).for_each(|step| trace.push(&sample(&columns, step)));
        let horizon = offline.horizon();
        let expected = offline.decided_robustness_signal(&trace).unwrap();
        let mut monitor = online(&[&text], None);
        for step in 0..samples {
            monitor.push(&sample(&columns, step)).unwrap();
            let decided = horizon.and_then(|horizon| step.checked_sub(horizon));
            let found = monitor.decided(0).map(|(sample, value)| (sample, value.to_bits()));
            assert_eq!(
                found,
                decided.map(|sample| (sample, expected[sample].to_bits())),
                "{text} on {columns:?}"
            );
            values += usize::from(decided.is_some());
        }
        monitor.finish();
        let expected = expected.first().map_or(Bounds::UNKNOWN, |value| Bounds { low: *value, high: *value });
        assert_eq!(bits(monitor.bounds(0)), bits(expected), "{text} on {columns:?}");
    }
    assert!(values > 10_000, "{values}");
}

/// One monitor serves three traces of different lengths in turns, and equals a monitor of each.
#[test]
fn a_saved_monitor_continues_with_the_same_bits() {
    let mut random = Random(44);
    for number in 0..formulas(2000) {
        let (_, text, columns) = case(&mut random, number);
        let samples = columns[0].len();
        let stated = Some(samples + random.below(3)).filter(|_| number % 3 > 0);
        let mut shared = online(&[&text], stated);
        let size = shared.row_size(samples);
        // Each trace starts at another sample of the columns.
        let mut traces: Vec<_> =
            (0..3).map(|shift| (shift, online(&[&text], stated), vec![0.0; size])).collect();
        traces.iter_mut().for_each(|(_, _, row)| shared.save(row));
        for turn in 0..2 * samples {
            let (shift, own, row) = &mut traces[(turn + random.below(2)) % 3];
            if own.len() == samples {
                continue;
            }
            let next = sample(&columns, (own.len() + *shift) % samples);
            shared.restore(row);
            shared.push(&next).unwrap();
            own.push(&next).unwrap();
            if number % 2 == 0 {
                shared.save(row);
            }
            assert_eq!(bits(shared.bounds(0)), bits(own.bounds(0)), "{text} on {columns:?}");
            assert_eq!(shared.decided(0), own.decided(0), "{text} on {columns:?}");
            shared.save(row);
        }
    }
}

/// A monitor with cut windows has, at each end, the robustness of the monitor that reads whole
/// traces, and its bounds before are those of all ends that follow.
#[test]
fn cut_windows_have_the_robustness_of_the_trace_so_far() {
    let mut random = Random(45);
    let mut early = 0;
    for number in 0..formulas(4000) {
        let (_, text, columns) = case(&mut random, number);
        let formula = Formula::parse(&text).unwrap();
        let nodes = formula.subformula_nodes(&Clock::steps(1.0)).unwrap();
        let sides = nodes.iter().flat_map(|node| node.sides.iter().flatten());
        if !sides.clone().all(|side| Formula::parse(side).unwrap().is_state_predicate()) {
            // The documentation excludes them.
            continue;
        }
        let mut offline = Monitor::new(&formula, &names(), Clock::steps(1.0)).unwrap();
        let mut online = CutMonitor::new(&[formula], &names(), Clock::steps(1.0)).unwrap();
        let mut trace = Trace::new(names());
        let mut known = Bounds::UNKNOWN;
        for step in 0..columns[0].len() {
            trace.push(&sample(&columns, step));
            online.push(&sample(&columns, step)).unwrap();
            let Ok(expected) = offline.robustness(&trace) else { continue };
            let bounds = online.bounds(0);
            known = Bounds { low: known.low.max(bounds.low), high: known.high.min(bounds.high) };
            let shown = || format!("{text} after {} on {columns:?}: {known:?} {expected:?}", step + 1);
            assert!(known.low <= expected && expected <= known.high, "{}", shown());
            let verdict = known.verdict();
            assert!(verdict.is_none_or(|verdict| verdict == is_satisfied(expected)), "{}", shown());
            early += usize::from(verdict.is_some() && step + 1 < columns[0].len());
            let mut ended = online.clone();
            ended.finish().unwrap();
            let exact = Bounds { low: expected, high: expected };
            assert_eq!(bits(ended.bounds(0)), bits(exact), "{}: {:?}", shown(), ended.bounds(0));
        }
    }
    assert!(early > 4000, "{early}");
}

/// Formulas that share parts have the values of separate monitors, also after a reset.
#[test]
fn formulas_that_share_parts_have_their_own_values() {
    let mut random = Random(44);
    for number in 0..formulas(1000) {
        let (_, part, columns) = case(&mut random, number);
        let texts = [
            part.clone(),
            format!("always[0:3]({part})"),
            format!("({part}) until[1:4] (not ({part}))"),
            format!("once[1:2]({part}) or a > 0"),
            format!("(a > 0) since ({part})"),
        ];
        let stated = Some(columns[0].len()).filter(|_| number % 2 == 0);
        let mut shared = online(&texts.each_ref().map(String::as_str), stated);
        for step in 0..random.below(columns[0].len()) {
            shared.push(&sample(&columns, step)).unwrap();
            shared.bounds(random.below(texts.len()));
        }
        shared.reset();
        let mut separate = texts.each_ref().map(|text| online(&[text], stated));
        for step in 0..columns[0].len() {
            shared.push(&sample(&columns, step)).unwrap();
            for (i, one) in separate.iter_mut().enumerate() {
                one.push(&sample(&columns, step)).unwrap();
                let text = &texts[i];
                assert_eq!(shared.decided(i), one.decided(0), "{text} on {columns:?}");
                assert_eq!(bits(shared.bounds(i)), bits(one.bounds(0)), "{text} after {step} on {columns:?}");
            }
        }
    }
}

/// A rejected sample leaves no trace: the monitor equals one that never saw it.
#[test]
fn a_rejected_sample_leaves_the_monitor_unchanged() {
    let mut random = Random(45);
    for number in 0..formulas(500) {
        let (_, text, columns) = case(&mut random, number);
        let text = format!("({text}) and a < 1e300 and 1 / b < 1e300");
        let mut plain = online(&[&text], None);
        let mut tried = online(&[&text], None);
        for step in 0..columns[0].len() {
            let good: Vec<f64> = sample(&columns, step).iter().map(|value| value.abs() + 1.0).collect();
            for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
                let mut sample = good.clone();
                sample[0] = bad;
                assert!(tried.push(&sample).is_err(), "{text}");
            }
            let mut zero = good.clone();
            zero[1] = 0.0;
            assert!(tried.push(&zero).is_err(), "{text}: 1 / 0");
            assert_eq!(tried.len(), step, "{text}");
            let expected = plain.push(&good);
            let found = tried.push(&good);
            assert_eq!(found, expected, "{text}");
            assert_eq!(tried.decided(0), plain.decided(0), "{text}");
            assert_eq!(bits(tried.bounds(0)), bits(plain.bounds(0)), "{text}");
            if expected.is_err() {
                break;
            }
        }
    }
}

/// `historically a` is 0 once a is, and 1 / 0 has no value.
#[test]
fn a_failed_monitor_says_so_until_it_is_reset() {
    let mut monitor = online(&["1 / historically(a)"], None);
    let push = |monitor: &mut OnlineMonitor, a: f64| monitor.push(&[a; NAMES.len()]);
    push(&mut monitor, 2.0).unwrap();
    assert_eq!(monitor.decided(0), Some((0, 0.5)));
    let error = push(&mut monitor, 0.0).expect_err("1 / 0");
    assert_eq!(error.to_string(), "`1 / 0` has no finite value at step 1 (t = 1 s)");
    for _ in 0..3 {
        assert_eq!(push(&mut monitor, 2.0), Err(error.clone()));
        assert_eq!(monitor.decided(0), None);
    }
    monitor.reset();
    push(&mut monitor, 4.0).unwrap();
    assert_eq!((monitor.len(), monitor.decided(0)), (1, Some((0, 0.25))));

    // The bounds that wait for more samples are unknown, too.
    let mut monitor = online(&["always[0:5](1 / historically(a))"], None);
    push(&mut monitor, 2.0).unwrap();
    assert_eq!(monitor.bounds(0).high, 0.5);
    push(&mut monitor, 0.0).expect_err("1 / 0");
    assert_eq!(monitor.bounds(0), Bounds::UNKNOWN);
    assert_eq!(monitor.verdict(0), None);
}
