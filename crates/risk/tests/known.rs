//! Estimates for systems with known failure probabilities. The full table is in
//! studies/notebook/2026-11-23-risk.md.

use std::cell::Cell;
use std::ops::ControlFlow;

use crate::systems::{Known, systems};
use mishandle_evaluation::Estimate;
use mishandle_random::Seed;
use mishandle_risk::{Method, Refusal, Report, Scenarios, Settings, Source, risk};
use mishandle_rollout::{Axis, Request, Space, Stream};
use mishandle_toys::{FunctionSystem, SimulatedEnd};

const SEEDS: u64 = 20;

fn settings(simulations: u64, method: Method, seed: u64) -> Settings {
    Settings { simulations, method, seed: Seed(seed), batch: 64 }
}

fn reports(name: &str, simulations: u64, method: Method) -> (f64, Vec<Report>) {
    let known: Known = systems().into_iter().find(|known| known.name == name).unwrap();
    let report = |seed| {
        let (mut system, scenarios) = known.system();
        risk(&mut system, &scenarios, &settings(simulations, method, seed), |_| ControlFlow::Continue(()))
            .unwrap()
    };
    (known.probability, (1..=SEEDS).map(report).collect())
}

fn covers(estimate: &Estimate, p: f64) -> bool {
    estimate.low <= Some(p) && Some(p) <= estimate.high
}

/// Returns how many estimates of a source there are, and how many of them contain the truth.
fn counted(p: f64, reports: &[Report], source: Source) -> (usize, usize) {
    let answers: Vec<_> = reports.iter().filter(|report| report.answer.source == Some(source)).collect();
    (answers.len(), answers.iter().filter(|report| covers(&report.answer.estimate, p)).count())
}

/// At most 4 of 20 intervals miss: with 5 % each, more have a probability of 0.3 %. The bounds are
/// wider.
fn check(name: &str, simulations: u64, method: Method, source: Source, least: usize) {
    let (p, reports) = reports(name, simulations, method);
    let (estimates, hits) = counted(p, &reports, source);
    assert!(estimates >= least && hits + 4 >= estimates, "{name}: {estimates} estimates, {hits} contain {p}");
    let bounded =
        reports.iter().filter(|report| (report.answer.bounds[0]..=report.answer.bounds[1]).contains(&p));
    assert!(bounded.count() + 4 >= reports.len(), "{name}");
}

#[test]
fn importance_sampling_measures_one_in_a_million() {
    check("half-space, 1e-6, 10 axes", 20_000, Method::Importance, Source::Importance, 15);
    check("two modes, 1e-6, 2 axes", 10_000, Method::Importance, Source::Importance, 15);
    check("corner cube, 1e-6, 3 axes", 10_000, Method::Importance, Source::Importance, 15);
}

#[test]
fn chains_measure_one_in_ten_thousand() {
    check("half-space, 1e-4, 10 axes", 100_000, Method::Splitting, Source::Splitting, 15);
}

#[test]
fn frequent_failures_are_answered_by_monte_carlo() {
    check("half-space, 1e-2, 10 axes", 20_000, Method::Auto, Source::MonteCarlo, 20);
}

/// Chains that start without strata lose the corner and agree on the disc, 1e-4, where the truth is
/// 2e-3: see the test of `splitting.rs`.
#[test]
fn a_hidden_corner_is_found_or_the_chains_are_refused() {
    let (p, reports) = reports("hidden corner, 2e-3, 2 axes", 20_000, Method::Splitting);
    let (estimates, hits) = counted(p, &reports, Source::Splitting);
    assert!(estimates - hits <= 1, "{} of {estimates} wrong", estimates - hits);
    check("hidden corner, 2e-3, 2 axes", 10_000, Method::Importance, Source::Importance, 15);
}

#[test]
fn a_needle_that_no_search_finds_has_bounds_and_no_estimate() {
    let (p, reports) = reports("needle, 1e-6, 3 axes", 10_000, Method::Auto);
    for report in reports {
        assert!(report.answer.source.is_none_or(|source| source == Source::MonteCarlo));
        assert!(report.answer.bounds[1] >= p);
    }
}

#[test]
fn the_budget_is_spent_exactly_and_batches_do_not_matter() {
    let known = &systems()[4];
    // Functions cannot be steered.
    for method in Method::ALL.map(|(method, _)| method).into_iter().filter(|own| *own != Method::Sequence) {
        for simulations in [100, 101, 999, 17_000] {
            let run = |batch| {
                let (mut system, scenarios) = known.system();
                let last = Cell::new(0);
                let settings = Settings { batch, ..settings(simulations, method, 3) };
                let report = risk(&mut system, &scenarios, &settings, |done| {
                    assert!(last.replace(done) < done);
                    ControlFlow::Continue(())
                })
                .unwrap();
                assert_eq!((report.simulations, system.simulations() as u64), (simulations, simulations));
                assert_eq!(last.get(), simulations);
                report
            };
            assert_eq!(run(64), run(999), "{method:?} {simulations}");
        }
    }
}

fn line() -> Space {
    Space::new("starts", vec![Axis::start("x", "", 0.0, 1.0)]).unwrap()
}

#[test]
fn noise_that_only_the_seed_changes_is_part_of_the_probability() {
    let outcome = |request: &Request| {
        SimulatedEnd::Robustness(request.seed.uniform(Stream::ObservationNoise, 0, 0) - 0.01)
    };
    let scenarios = Scenarios::new(&line(), [], true).unwrap();
    let mut system = FunctionSystem::new(line(), outcome);
    let report =
        risk(&mut system, &scenarios, &settings(20_000, Method::Auto, 1), |_| ControlFlow::Continue(()))
            .unwrap();
    assert!(covers(&report.answer.estimate, 0.01), "{:?}", report.answer);
    // The failures are the simulations of their seeds.
    for failure in &report.failures {
        assert_eq!(failure.robustness, failure.draw.seed.uniform(Stream::ObservationNoise, 0, 0) - 0.01);
    }
}

#[test]
fn simulations_without_a_verdict_are_counted_apart() {
    let outcome = |request: &Request| match request.scenario.get(0) {
        Some(x) if x < 0.3 => SimulatedEnd::Undecided,
        Some(x) if x < 0.5 => SimulatedEnd::Diverged,
        _ => SimulatedEnd::Robustness(1.0),
    };
    for method in [Method::Auto, Method::Splitting] {
        let scenarios = Scenarios::new(&line(), [], false).unwrap();
        let mut system = FunctionSystem::new(line(), outcome);
        let report =
            risk(&mut system, &scenarios, &settings(40_800, method, 1), |_| ControlFlow::Continue(()))
                .unwrap();
        let monte_carlo = &report.monte_carlo;
        let share = monte_carlo.ends.total() as f64 / monte_carlo.simulations as f64;
        assert!((share - 0.5).abs() < 0.025 && monte_carlo.failures == 0 && report.failures.is_empty());
        assert!(report.answer.source.is_none() && monte_carlo.bound_with_undecided() > Some(0.5));
    }
}

/// The target cannot start from half of the line, and `rare` of the line fails: 2 `rare` of the
/// valid scenarios.
fn half_valid(rare: f64, method: Method, seed: u64) -> Report {
    let outcome = move |request: &Request| match request.scenario.get(0) {
        Some(x) if x < 0.5 => SimulatedEnd::InvalidStart,
        Some(x) => SimulatedEnd::Robustness(1.0 - rare - x),
        None => SimulatedEnd::Undecided,
    };
    let scenarios = Scenarios::new(&line(), [], false).unwrap();
    let mut system = FunctionSystem::new(line(), outcome);
    risk(&mut system, &scenarios, &settings(20_000, method, seed), |_| ControlFlow::Continue(())).unwrap()
}

#[test]
fn the_probability_is_that_among_the_scenarios_from_which_the_target_can_start() {
    for method in [Method::MonteCarlo, Method::Auto] {
        let found: Vec<Report> = (0..20).map(|seed| half_valid(0.01, method, seed)).collect();
        assert!(found.iter().filter(|report| covers(&report.answer.estimate, 0.02)).count() >= 16);
        for Report { monte_carlo, answer, .. } in &found {
            assert_eq!(monte_carlo.estimate().n, monte_carlo.simulations - monte_carlo.ends.invalid_starts);
            assert!((monte_carlo.ends.invalid_starts as f64 / 20_000.0 - 0.5).abs() < 0.02);
            assert_eq!((monte_carlo.ends.total(), answer.source), (0, Some(Source::MonteCarlo)));
        }
    }
}

#[test]
fn importance_sampling_and_splitting_refuse_invalid_starts() {
    for method in [Method::Auto, Method::Importance, Method::Splitting] {
        let Report { answer, monte_carlo, splitting, .. } = half_valid(1e-4, method, 1);
        assert!(matches!(answer.source, None | Some(Source::MonteCarlo)), "{method:?}");
        assert_eq!(answer.splitting_refusal == Some(Refusal::InvalidStarts), splitting.is_some());
        assert!(answer.bounds[0] < 2e-4 && answer.bounds[1] > 2e-4);
        assert!(monte_carlo.valid() < monte_carlo.simulations);
    }
}

#[test]
fn without_any_valid_scenario_there_is_no_estimate() {
    let scenarios = Scenarios::new(&line(), [], false).unwrap();
    for end in [SimulatedEnd::InvalidStart, SimulatedEnd::Diverged, SimulatedEnd::Undecided] {
        let mut system = FunctionSystem::new(line(), move |_| end);
        let settings = settings(1000, Method::MonteCarlo, 1);
        let report = risk(&mut system, &scenarios, &settings, |_| ControlFlow::Continue(())).unwrap();
        assert_eq!((report.answer.source, report.answer.bounds), (None, [0.0, 1.0]), "{end:?}");
        assert_eq!(report.monte_carlo.estimate().value, None, "{end:?}");
    }
}

#[test]
fn splitting_with_a_small_budget_says_so() {
    let known = &systems()[4];
    let report = |method, simulations| {
        let (mut system, scenarios) = known.system();
        let settings = settings(simulations, method, 1);
        risk(&mut system, &scenarios, &settings, |_| ControlFlow::Continue(())).unwrap()
    };
    // 5 chains of 81 simulations for each of 180 particles are 72,900; 75 % of 97,200, and 35 % of
    // 208,286.
    for (method, needed, part) in [(Method::Splitting, 97_200, 72_899), (Method::Auto, 208_286, 72_899)] {
        let found = report(method, needed - 1);
        let expected = Refusal::Budget { simulations: part, needed };
        assert_eq!(found.answer.splitting_refusal, Some(expected));
        // The chains are still worth their failures.
        assert!(found.splitting.is_some_and(|splitting| splitting.estimate().is_err()));
        let refusal = report(method, needed).answer.splitting_refusal;
        assert!(!matches!(refusal, Some(Refusal::Budget { .. })), "{refusal:?}");
    }
    // 30 particles need 12,150, which are 75 % of 16,200.
    assert!(report(Method::Splitting, 16_199).splitting.is_none());
    assert!(report(Method::Splitting, 16_200).splitting.is_some());
    // No budget helps a method without splitting.
    assert_eq!(report(Method::Importance, 1000).answer.splitting_refusal, None);
}

#[test]
fn an_interruption_keeps_the_simulations_of_monte_carlo_and_the_failures() {
    let known = &systems()[0];
    for stop in [64, 640, 4_992, 5_056, 8_000] {
        let (mut system, scenarios) = known.system();
        let settings = settings(20_000, Method::Auto, 1);
        let watch = |done| if done >= stop { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
        let report = risk(&mut system, &scenarios, &settings, watch).unwrap();
        // The batch that was running is finished.
        assert!(
            !report.is_complete && (stop..stop + 64).contains(&report.simulations),
            "{}",
            report.simulations
        );
        assert_eq!(system.simulations() as u64, report.simulations);
        // 1 % fails: the first 5,000 decide that all are Monte Carlo.
        assert_eq!(report.monte_carlo.simulations, report.simulations);
        assert!(report.answer.source.is_none() || covers(&report.answer.estimate, known.probability));
        assert_eq!(report.monte_carlo.failures > 0, !report.failures.is_empty());
    }
}
