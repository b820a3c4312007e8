//! Values at some samples, and diagnoses, equal those of the evaluation of the whole trace.

use super::naive::{NAMES, Random, Tree};
use mishandle_stl::{Clock, Diagnosis, Formula, Monitor, Trace, Windows};
use std::ops::Range;

fn trace(random: &mut Random, n: usize) -> Trace {
    Trace::from_columns(NAMES.map(String::from).into(), NAMES.map(|_| random.column(n)).to_vec())
}

fn clock() -> Clock {
    Clock::steps(1.0 / 60.0)
}

fn monitor(text: &str, trace: &Trace) -> Monitor {
    Monitor::new(&Formula::parse(text).unwrap(), trace.names(), clock()).unwrap()
}

/// Returns the values at these samples, and checks that they are visited in the order of time.
fn visited(text: &str, trace: &Trace, samples: Range<usize>, is_decided: bool) -> Vec<f64> {
    let mut found = Vec::new();
    let visit = |first: usize, values: &[f64]| {
        assert_eq!(first, samples.start + found.len(), "{text}");
        found.extend_from_slice(values);
    };
    let mut monitor = monitor(text, trace);
    let windows = if is_decided { Windows::Whole } else { Windows::Cut };
    let result = monitor.visit_robustness(trace, samples.clone(), windows, visit);
    result.unwrap_or_else(|error| panic!("{text}: {error}"));
    found
}

/// Returns the values at all samples, or at all decided ones.
fn signal(text: &str, trace: &Trace, is_decided: bool) -> Vec<f64> {
    let mut monitor = monitor(text, trace);
    if is_decided {
        monitor.decided_robustness_signal(trace).unwrap().to_vec()
    } else {
        monitor.robustness_signal(trace).unwrap().to_vec()
    }
}

#[track_caller]
fn check_equal(found: &[f64], expected: &[f64], text: &str) {
    let bits = |values: &[f64]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(found), bits(expected), "{text}: {found:?}, not {expected:?}");
}

#[test]
fn values_at_some_samples_are_those_of_the_whole_trace() {
    let mut random = Random(41);
    for _ in 0..20_000 {
        let n = 1 + random.below(40);
        let size = random.below(6);
        let text = Tree::random(&mut random, size, 10).write(&mut random);
        let trace = trace(&mut random, n);
        for is_decided in [false, true] {
            let all = signal(&text, &trace, is_decided);
            let begin = random.below(all.len() + 1);
            let samples = begin..begin + random.below(all.len() - begin + 1);
            check_equal(&visited(&text, &trace, samples.clone(), is_decided), &all[samples], &text);
        }
    }
}

/// Formulas whose long traces are evaluated in parts, and some for which this is not possible.
const LONG: [&str; 12] = [
    "a <= 1 and b <= 1",
    "always[3:50](a <= 1 or b >= 0)",
    "eventually[0:400](always[0:30](a <= b))",
    "(a >= -1) until[5:90] (b >= 1)",
    "(a >= -1) release[0:9] (b >= 1)",
    "(a >= -1) unless[2:70] (b >= 1)",
    "historically[3:80](a <= 1) or once[1:2](b >= 1)",
    "(a >= -1) since[5:90] eventually[0:10](b >= 1)",
    "rise(a >= 0) -> next next (prev(b) >= 0)",
    "always(a >= -4 implies eventually[0:90](b >= 1))",
    "always(a <= 4 implies once(b >= 0))",
    "always[0:9](a) - 0.5 * eventually[0:9](b) >= -8",
];

#[test]
fn values_of_long_traces_are_the_same_in_parts() {
    let mut random = Random(42);
    let trace = trace(&mut random, 200_000);
    for text in LONG {
        for is_decided in [false, true] {
            let all = signal(text, &trace, is_decided);
            check_equal(&visited(text, &trace, 0..all.len(), is_decided), &all, text);
        }
    }
}

/// Checks that each sub-formula of a chain has the stated value at its sample.
fn check_chain(diagnosis: &Diagnosis, trace: &Trace, is_decided: bool) {
    for found in &diagnosis.path {
        let values = visited(&found.text, trace, found.sample..found.sample + 1, is_decided);
        check_equal(&values, &[found.robustness], &found.text);
    }
}

#[test]
fn a_diagnosis_of_a_long_trace_leads_to_the_value_at_its_start() {
    let mut random = Random(43);
    let trace = trace(&mut random, 200_000);
    for outer in ["", "always", "eventually", "not always", "0 <= 1 until", "0 <= 1 unless[9:inf]"] {
        for text in LONG {
            let text = format!("{outer}({text})");
            let formula = Formula::parse(&text).unwrap();
            let diagnosis = formula.diagnose(&trace, &clock()).unwrap();
            check_equal(&[diagnosis.robustness()], &signal(&text, &trace, false)[..1], &text);
            check_chain(&diagnosis, &trace, false);
            let decided = formula.diagnose_decided(&trace, &clock()).unwrap().expect("the trace is long");
            check_equal(&[decided.robustness()], &signal(&text, &trace, true)[..1], &text);
            check_chain(&decided, &trace, true);
        }
    }
}

#[test]
fn a_decided_diagnosis_leads_to_the_first_decided_value() {
    let mut random = Random(44);
    let mut counts = [0, 0];
    for _ in 0..20_000 {
        let n = 1 + random.below(14);
        let size = 1 + random.below(6);
        let tree = Tree::random(&mut random, size, n);
        let text = tree.write(&mut random);
        let trace = trace(&mut random, n);
        let diagnosis = Formula::parse(&text).unwrap().diagnose_decided(&trace, &clock()).unwrap();
        let expected = signal(&text, &trace, true);
        assert_eq!(diagnosis.is_some(), !expected.is_empty(), "{text}");
        counts[usize::from(diagnosis.is_some())] += 1;
        let Some(diagnosis) = diagnosis else { continue };
        check_equal(&[diagnosis.robustness()], &expected[..1], &text);
        check_chain(&diagnosis, &trace, true);
        if let Some(predicate) = &diagnosis.predicate {
            let sign = if predicate.is_negated { -1.0 } else { 1.0 };
            assert_eq!(sign * predicate.robustness, diagnosis.robustness(), "{text}: {predicate:?}");
        }
    }
    assert!(counts.iter().all(|count| *count > 1000), "{counts:?}");
}

#[test]
fn a_diagnosis_reads_no_sample_that_the_value_does_not_depend_on() {
    let names = ["x".to_owned()].into();
    let trace = Trace::from_columns(names, vec![vec![1.0, 0.0, 3.0, f64::NAN]]);
    let formula = Formula::parse("always[0:1](x >= 1) or x >= 8").unwrap();
    assert_eq!(formula.diagnose(&trace, &clock()).unwrap().robustness(), -1.0);
    let formula = Formula::parse("always(x >= 1)").unwrap();
    let error = formula.diagnose(&trace, &clock()).expect_err("the window has NaN").to_string();
    assert!(error.contains("NaN"), "{error}");
}
