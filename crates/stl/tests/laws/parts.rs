//! Laws of the parts of a robustness.

use super::naive::{NAMES, Random, Tree};
use mishandle_stl::{Clock, Composition, Decomposition, Formula, Monitor, Trace};
use std::sync::Arc;

const CLOCK: fn() -> Clock = || Clock::steps(1.0 / 60.0);

fn trace_of(columns: &[Vec<f64>]) -> Trace {
    let names: Arc<[String]> = NAMES.map(String::from).into();
    let mut trace = Trace::new(names);
    for step in 0..columns[0].len() {
        trace.push(&columns.iter().map(|column| column[step]).collect::<Vec<f64>>());
    }
    trace
}

fn value(composition: &Composition, parts: &[f64]) -> f64 {
    let of = |operands: &[Composition]| operands.iter().map(|x| value(x, parts)).collect::<Vec<f64>>();
    match composition {
        Composition::Part(index) => parts[*index],
        Composition::Min(operands) => of(operands).into_iter().min_by(f64::total_cmp).unwrap(),
        Composition::Max(operands) => of(operands).into_iter().max_by(f64::total_cmp).unwrap(),
    }
}

/// A random formula whose outer operators are those that are split.
fn random_formula(random: &mut Random, n: usize) -> Formula {
    let mut text = |depth: usize| Tree::random(random, depth, n).write(random);
    let p = text(2);
    let q = text(1);
    let r = text(2);
    let begin = random.below(4);
    let window = random.pick(&["", "[0:2]", "[1:inf]", "[2:4]"]).to_owned();
    let outer = format!("[{begin}:{}]", begin + random.below(8));
    let texts = [
        format!("always{outer} ({p}) -> always{window} ({q})"),
        format!("always{window} (({p}) and not (({q}) or always{outer} ({r})))"),
        format!("eventually{outer} (({p}) or eventually{window} ({q})) and not (({r}) implies ({q}))"),
        format!("not eventually{window} (not always{outer} (({p}) and ({r})))"),
        format!("always{window} (({p}) and always{outer} ({q})) or eventually ({r})"),
        p.clone(),
    ];
    Formula::parse(&texts[random.below(texts.len())]).unwrap()
}

/// Calls `check` with random formulas, traces of at most `n` samples that decide them, their
/// decompositions for traces of `n` samples, and their parts.
fn for_random_cases(
    seed: u64,
    mut check: impl FnMut(&mut Random, &Formula, &[Vec<f64>], usize, &Decomposition, &[f64]),
) {
    let mut random = Random(seed);
    let mut cases = 0;
    let mut with_several = 0;
    while cases < 5000 {
        let n = 1 + random.below(30);
        let formula = random_formula(&mut random, n.min(5));
        let length = if random.below(3) == 0 { 1 + random.below(n) } else { n };
        let columns = NAMES.map(|_| random.column(length)).to_vec();
        let trace = trace_of(&columns);
        let most = 1 + random.below(16);
        let decomposition = formula.decompose(&CLOCK(), n, most).unwrap();
        let mut monitor = Monitor::new(&formula, trace.names(), CLOCK()).unwrap();
        let expected = monitor.decided_robustness_signal(&trace).unwrap().first().copied();
        let parts = monitor.parts(&trace, &decomposition).unwrap();
        assert_eq!(parts.is_some(), expected.is_some(), "{formula}");
        let (Some(parts), Some(expected)) = (parts, expected) else { continue };
        let composed = value(decomposition.composition(), &parts);
        assert_eq!(composed.to_bits(), expected.to_bits(), "{formula} on {columns:?}: {decomposition:?}");
        assert!(parts.len() <= most && parts.len() == decomposition.ends().len(), "{formula}");
        check(&mut random, &formula, &columns, n, &decomposition, &parts);
        cases += 1;
        with_several += usize::from(parts.len() > 2);
    }
    assert!(with_several > 2000, "{with_several}");
}

/// Also on traces that are shorter than those that the decomposition is for.
#[test]
fn parts_compose_the_robustness() {
    for_random_cases(31, |_, _, _, _, _, _| {});
}

#[test]
fn samples_after_the_end_of_a_part_do_not_change_it() {
    let mut changed = 0;
    for_random_cases(32, |random, formula, columns, n, decomposition, parts| {
        if columns[0].len() < n {
            return;
        }
        let mut monitor = Monitor::new(formula, trace_of(columns).names(), CLOCK()).unwrap();
        for (index, end) in decomposition.ends().enumerate() {
            let other: Vec<Vec<f64>> = columns
                .iter()
                .map(|column| [&column[..=end], &random.column(n - end - 1)].concat())
                .collect();
            let found = monitor.parts(&trace_of(&other), decomposition).unwrap().unwrap();
            assert_eq!(found[index].to_bits(), parts[index].to_bits(), "{formula}, part {index}");
            changed += usize::from(found != parts);
        }
    });
    assert!(changed > 500, "{changed}");
}

/// Two heaters: the premise is violated or the conclusion holds.
#[test]
fn a_formula_of_two_signals_has_windows_of_each() {
    let formula = Formula::parse("always[0:9](a <= 3) -> always[0:3](b <= 1 and c_1 <= 2)").unwrap();
    let decomposition = formula.decompose(&CLOCK(), 10, 6).unwrap();
    assert_eq!(decomposition.ends().collect::<Vec<_>>(), [4, 9, 1, 3, 1, 3]);
    assert_eq!(decomposition.leaves().collect::<Vec<_>>(), [0, 0, 1, 1, 2, 2]);
    let columns = [(0..10).map(f64::from).collect(), vec![0.0, 2.0, 1.0, 4.0], vec![0.0; 10]];
    let columns = columns.map(|mut column: Vec<f64>| {
        column.resize(10, 0.0);
        column
    });
    let trace = trace_of(&columns);
    let mut monitor = Monitor::new(&formula, trace.names(), CLOCK()).unwrap();
    let parts = monitor.parts(&trace, &decomposition).unwrap().unwrap();
    // a - 3 is at most 1 and 6; 1 - b at least -1 and -3.
    assert_eq!(parts, [1.0, 6.0, -1.0, -3.0, 2.0, 2.0]);
}
