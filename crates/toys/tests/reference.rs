//! Traces agree with those of SciPy's integrators, which studies/experiments/arch/reference.py
//! wrote from equations of its own.

use std::collections::BTreeMap;

use mishandle_rollout::{Episode, Request, Scenario, Seed, Specification};
use mishandle_stl::Formula;

/// Inputs of a case, and its samples: time and signals.
#[derive(Default)]
struct Case {
    inputs: Vec<f64>,
    samples: Vec<Vec<f64>>,
}

fn cases(text: &str) -> BTreeMap<u64, Case> {
    let mut cases: BTreeMap<u64, Case> = BTreeMap::new();
    for line in text.lines() {
        let mut words = line.split(',');
        let kind = words.next().expect("a kind");
        let case = cases.entry(words.next().expect("a case").parse().expect("a number")).or_default();
        let numbers = words.map(|word| word.parse().expect("a number")).collect();
        if kind == "input" { case.inputs = numbers } else { case.samples.push(numbers) }
    }
    cases
}

fn episode(name: &str, inputs: &[f64]) -> Episode {
    let target = mishandle_toys::arch::target(name).expect("a problem").expect("a target");
    let requirement = Formula::parse(&target.formulas[0].text).expect("a formula");
    let space = target.space("instance-1").expect("a space");
    let mut system = target.system(&space, &Specification::new(requirement)).expect("a system");
    let scenario = Scenario::new(inputs.iter().copied().map(Some).collect());
    system.rollout(&[Request::new(scenario, Seed(0))]).expect("an episode").remove(0)
}

/// Compares signals of all samples; each signal has its own tolerance. Prints the largest
/// differences.
#[expect(clippy::print_stdout, reason = "the documentation quotes the differences")]
fn compare(name: &str, dt: f64, case: &Case, signals: &[(&str, f64)]) {
    let episode = episode(name, &case.inputs);
    for (column, (signal, tolerance)) in signals.iter().enumerate() {
        let own = episode.trace.signal(signal).expect("a signal");
        let mut largest = 0.0_f64;
        for sample in &case.samples {
            let found = own[(sample[0] / dt).round() as usize];
            let expected = sample[column + 1];
            assert!(
                (found - expected).abs() < *tolerance,
                "{name} {signal} at {} s: {found} {expected}",
                sample[0]
            );
            largest = largest.max((found - expected).abs());
        }
        println!("{name} {signal}: {largest:.1e}");
    }
}

#[test]
fn chasing_cars_agree() {
    let cases = cases(include_str!("data/chasing_cars.csv"));
    assert_eq!(cases.len(), 6);
    for case in cases.values() {
        let signals = ["y1", "y2", "y3", "y4", "y5"].map(|name| (name, 1e-6));
        compare("arch/cc1", 0.05, case, &signals);
    }
}

#[test]
fn the_steam_condenser_agrees() {
    let cases = cases(include_str!("data/steam_condenser.csv"));
    assert_eq!(cases.len(), 6);
    for case in cases.values() {
        let signals = [("pressure", 1e-6), ("temperature", 1e-6), ("water", 1e-5), ("heat", 1e-3)];
        compare("arch/sc", 0.01, case, &signals);
    }
}

#[test]
fn fuel_control_agrees() {
    let cases = cases(include_str!("data/fuel_control.csv"));
    assert_eq!(cases.len(), 6);
    for (number, case) in &cases {
        // The cases 2 and 3 are in power mode.
        let name = if [2, 3].contains(number) { "arch/afc33" } else { "arch/afc29" };
        let signals = [("mu", 2e-6), ("air_fuel_ratio", 3e-5), ("manifold_pressure", 1e-7), ("fuel", 1e-6)];
        compare(name, 0.01, case, &signals);
    }
}
