//! Random formulas and signals in dense time.

use super::naive::{NAMES, ONE, Random, Tree};
use mishandle_stl::{
    DenseError, DenseMonitor, DenseRobustness, DenseSignal, Formula, Interpolation, TimeUnit,
};

pub fn evaluate(text: &str, signals: &[DenseSignal]) -> Result<DenseRobustness, DenseError> {
    compile(text, signals)?.robustness_signal(signals)
}

pub fn compile(text: &str, signals: &[DenseSignal]) -> Result<DenseMonitor, DenseError> {
    let formula = Formula::parse(text).unwrap_or_else(|error| panic!("{text}: {error}"));
    let names: Vec<String> = signals.iter().map(|signal| signal.name().to_owned()).collect();
    DenseMonitor::new(&formula, &names, Some(TimeUnit::Seconds))
}

/// Random signals with times that are multiples of 1/8 s, from 0 to `end` eighths.
pub fn random_signals(random: &mut Random, end: usize) -> Vec<DenseSignal> {
    let one = |name: &&str| {
        let is_sample = |time: &usize| *time == 0 || *time == end;
        let times: Vec<usize> = (0..=end).collect();
        let times: Vec<f64> = times
            .into_iter()
            .filter(|time| is_sample(time) || random.below(3) == 0)
            .map(|time| time as f64 / 8.0)
            .collect();
        let values = random.column(times.len());
        DenseSignal::new(*name, times, values, random.pick(&[Interpolation::Hold, Interpolation::Linear]))
            .unwrap()
    };
    NAMES.iter().map(one).collect()
}

/// Calls `check` with random formulas that have a value, and signals.
pub fn for_random_cases(
    seed: u64,
    count: usize,
    mut check: impl FnMut(&Tree, &str, &[DenseSignal], &mut Random),
) {
    let mut random = Random(seed);
    let mut done = 0;
    while done < count {
        let end = 1 + random.below(40);
        let size = random.below(6);
        let tree = Tree::random(&mut random, size, 1 + end / 8);
        let text = tree.write(&mut random);
        let signals = random_signals(&mut random, end);
        match evaluate(&text, &signals) {
            Ok(_) => check(&tree, &text, &signals, &mut random),
            Err(DenseError::NoNeighbor { operator }) => assert!(ONE.contains(&operator), "{text}"),
            Err(DenseError::NotLinear { term }) => assert!(term.contains('*'), "{text}: {term}"),
            Err(error) => panic!("{text}: {error}"),
        }
        done += 1;
    }
}
