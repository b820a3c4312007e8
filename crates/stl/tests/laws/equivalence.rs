//! Formulas with one meaning have one value, bit by bit, in every evaluator.

use super::naive::{NAMES, Random, Tree};
use mishandle_stl::{
    Clock, DenseMonitor, DenseSignal, Formula, Interpolation, Monitor, OnlineMonitor, Trace, is_satisfied,
};

const CLOCK: fn() -> Clock = || Clock::steps(1.0);

fn parsed(text: &str) -> Formula {
    Formula::parse(text).unwrap_or_else(|error| panic!("{text}: {error}"))
}

fn trace_of(columns: &[Vec<f64>]) -> Trace {
    Trace::from_columns(NAMES.map(String::from).into(), columns.to_vec())
}

/// Returns the bits of what the evaluators of discrete time say about a formula: values with cut
/// and whole windows, the bounds after each sample and at the end, the two diagnoses.
fn discrete(text: &str, columns: &[Vec<f64>]) -> Vec<Vec<u64>> {
    let formula = parsed(text);
    let names = NAMES.map(String::from);
    let trace = trace_of(columns);
    let mut monitor = Monitor::new(&formula, &names, CLOCK()).unwrap();
    let bits = |values: &[f64]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
    let mut found = vec![bits(monitor.robustness_signal(&trace).unwrap())];
    found.push(bits(monitor.decided_robustness_signal(&trace).unwrap()));
    // Online monitors refuse a formula that reads no signal.
    if let Ok(mut online) = OnlineMonitor::new(std::slice::from_ref(&formula), &names, CLOCK(), None) {
        let mut bounds = Vec::new();
        for step in 0..trace.len() {
            online.push(&columns.iter().map(|column| column[step]).collect::<Vec<_>>()).unwrap();
            bounds.extend([online.bounds(0).low, online.bounds(0).high]);
        }
        online.finish();
        bounds.extend([online.bounds(0).low, online.bounds(0).high]);
        found.push(bits(&bounds));
    }
    found.push(bits(&[formula.diagnose(&trace, &CLOCK()).unwrap().robustness()]));
    let decided = formula.diagnose_decided(&trace, &CLOCK()).unwrap();
    found.push(bits(&decided.map(|found| found.robustness()).into_iter().collect::<Vec<_>>()));
    found.push(vec![monitor.needed_samples() as u64, u64::from(monitor.cuts_windows(trace.len()))]);
    found
}

/// `p unless q` is `(always p) or (p until q)`, also where windows of its operands reach beyond the
/// end of the trace by different lengths.
#[test]
fn unless_has_the_values_of_its_expansion() {
    let mut random = Random(90);
    let mut decided = 0;
    for _ in 0..4_000 {
        let n = 1 + random.below(12);
        let mut part = || {
            let size = random.below(3);
            let tree = Tree::random(&mut random, size, n);
            tree.write(&mut random)
        };
        let p = part();
        let q = part();
        let begin = random.below(4);
        let end = begin + random.below(6);
        let windows = [
            (String::new(), String::new()),
            (format!("[{begin}:inf]"), String::new()),
            (format!("[{begin}:{end}]"), format!("[0:{end}]")),
        ];
        let columns = NAMES.map(|_| random.column(n)).to_vec();
        for (own, held) in windows {
            let unless = discrete(&format!("({p}) unless{own} ({q})"), &columns);
            let expanded = discrete(&format!("(always{held}({p})) or (({p}) until{own} ({q}))"), &columns);
            assert_eq!(unless, expanded, "({p}) unless{own} ({q}) on {columns:?}");
            decided += usize::from(!unless[1].is_empty());
        }
    }
    assert!(decided > 5_000, "{decided}");
}

/// The last two samples violate p, and q, which needs two samples more, never holds.
#[test]
fn the_left_operand_of_unless_holds_up_to_the_last_sample() {
    let columns = [vec![1.0, 1.0, 1.0, -2.0], vec![-1.0; 4], vec![0.0; 4]];
    let value = |text: &str| {
        let formula = parsed(text);
        let mut monitor = Monitor::new(&formula, &NAMES.map(String::from), CLOCK()).unwrap();
        monitor.decided_robustness(&trace_of(&columns)).unwrap()
    };
    // max(min(1, 1, 1, -2), max over the first two samples of min(-1, ...)) is -1.
    assert_eq!(value("a unless (always[0:2] b)"), Some(-1.0));
    assert_eq!(value("(always a) or (a until (always[0:2] b))"), Some(-1.0));
}

/// A zero of a signal, or of arithmetic on signals, has no sign in the place of a formula.
#[test]
fn both_zeros_of_a_signal_are_one() {
    let mut random = Random(91);
    for _ in 0..4_000 {
        let n = 1 + random.below(10);
        let size = random.below(4);
        let tree = Tree::random(&mut random, size, n);
        let text = tree.write(&mut random);
        let columns =
            NAMES.map(|_| (0..n).map(|_| random.pick(&[-1.0, 0.0, 0.0, 1.5])).collect::<Vec<f64>>());
        let negative = columns.clone().map(|column| {
            column.into_iter().map(|x| if x == 0.0 && random.below(2) == 0 { -0.0 } else { x }).collect()
        });
        assert_eq!(discrete(&text, &negative), discrete(&text, &columns), "{text} on {negative:?}");
    }
    for (text, holds) in [
        ("a", true),
        ("-a", true),
        ("a * -2", true),
        ("-(b - 3)", true),
        ("always(a and -a)", true),
        ("not a", false),
        ("a implies a < 0", false),
        ("eventually(-a)", true),
        // The scale of a formula does not change its verdict.
        ("(a < 0) * 2", false),
        ("not (-0)", false),
    ] {
        for zero in [0.0, -0.0] {
            let trace = trace_of(&[vec![zero; 2], vec![3.0; 2], vec![0.0; 2]]);
            let formula = parsed(text);
            let mut monitor = Monitor::new(&formula, trace.names(), CLOCK()).unwrap();
            let found = monitor.robustness(&trace).unwrap();
            assert_eq!(is_satisfied(found), holds, "{text} at {zero}: {found}");
            let signals = [("a", zero), ("b", 3.0)].map(|(name, value)| {
                DenseSignal::new(name, vec![0.0, 1.0], vec![value; 2], Interpolation::Hold).unwrap()
            });
            let names = signals.each_ref().map(|signal| signal.name().to_owned());
            let dense = DenseMonitor::new(&formula, &names, None).unwrap();
            let found = dense.robustness(&signals).unwrap();
            assert_eq!(is_satisfied(found), holds, "{text} at {zero} in dense time: {found}");
            let found = dense.diagnose(&signals).unwrap().robustness;
            assert_eq!(is_satisfied(found), holds, "diagnosis of {text} at {zero} in dense time: {found}");
        }
    }
}
