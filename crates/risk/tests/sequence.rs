//! Importance sampling with a proposal that depends on the state, for processes with known failure
//! probabilities. The full table is in studies/notebook/2026-11-27-risk-of-sequences.md.

use std::ops::ControlFlow;

use crate::sequences::{PROCESSES, Process};
use mishandle_random::Seed;
use mishandle_risk::{Method, Report, RiskError, Scenarios, Settings, Source, risk};
use mishandle_rollout::{Axis, Request, Seen, Space, SteeredAxis, Steering, System};
use mishandle_toys::{FunctionSystem, SimulatedEnd};

fn process(name: &str) -> Process {
    *PROCESSES.iter().find(|process| process.name.starts_with(name)).unwrap()
}

fn report(process: &Process, settings: Settings) -> Report {
    let (mut system, scenarios) = process.system();
    risk(&mut system, &scenarios, &settings, |_| ControlFlow::Continue(())).unwrap()
}

fn settings(simulations: u64, seed: u64) -> Settings {
    Settings { simulations, method: Method::Sequence, seed: Seed(seed), batch: 64 }
}

/// The seeds are those of no measurement. With two standard errors of a correct interval, at most
/// one of 4 misses.
fn check(name: &str, simulations: u64) {
    let process = process(name);
    let p = process.probability;
    let mut hits = 0;
    let mut sum = 0.0;
    let mut variance = 0.0;
    let seeds = 501..505;
    for seed in seeds.clone() {
        let report = report(&process, settings(simulations, seed));
        assert_eq!((report.simulations, report.answer.source), (simulations, Some(Source::Importance)));
        let found = report.importance.unwrap();
        let value = found.regions.value.unwrap();
        hits += usize::from(found.regions.low.unwrap() <= p && p <= found.regions.high.unwrap());
        sum += value / p;
        // Of n draws with the mean p, of which the effective number fails.
        variance += 1.0 / found.effective_failures;
    }
    let n = seeds.count();
    assert!(hits + 1 >= n, "{name}: {hits} of {n} intervals contain {p}");
    // The estimate of a frozen proposal is unbiased.
    let error = (variance / (n * n) as f64).sqrt();
    assert!((sum / n as f64 - 1.0).abs() < 4.0 * error, "{name}: {} ± {error}", sum / n as f64);
}

#[test]
fn a_rare_barrier_is_measured_without_bias() {
    check("walk to a barrier, 1e-6", 6000);
}

#[test]
fn both_of_two_failure_modes_are_measured() {
    check("walk to two barriers", 10_000);
}

/// On average over the signs, no disturbance is more frequent before a failure than its opposite.
#[test]
fn failures_that_only_a_reaction_to_the_state_finds_are_measured() {
    check("sign of the noise is seen", 8000);
}

#[test]
fn results_do_not_depend_on_batches_and_threads() {
    let process = process("walk to a barrier, 1e-4");
    let run = |batch, threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| report(&process, Settings { batch, ..settings(2000, 3) }))
    };
    let expected = run(64, 1);
    assert!(expected.importance.is_some());
    assert_eq!(run(64, 3), expected);
    assert_eq!(run(999, 2), expected);
}

/// Replaces the values by a function of what it sees.
struct Reaction;

impl Steering for Reaction {
    fn memory_size(&self) -> usize {
        1
    }

    fn steer(&self, seen: Seen<'_>, axes: &[SteeredAxis], memory: &mut [f64], values: &mut [f64]) {
        memory[0] += axes.len() as f64;
        values.fill((0.3 * seen.signals[0] + f64::from(seen.observation[1])).clamp(-4.0, 4.0));
    }
}

#[test]
fn a_steered_simulation_is_that_of_its_scenario() {
    let process = process("walk to two barriers");
    let (mut system, _) = process.system();
    let scenario = system.space().sample(Seed(1), 0);
    let requests: Vec<Request> = (0..5).map(|seed| Request::new(scenario.clone(), Seed(seed))).collect();
    let steered = system.rollout_steered(&requests, &Reaction).unwrap();
    for (steered, request) in steered.iter().zip(&requests) {
        assert_eq!(steered.memory, [process.steps as f64]);
        assert!(!steered.episode.request.scenario.is_same(&request.scenario));
        let again = system.rollout(std::slice::from_ref(&steered.episode.request)).unwrap();
        assert_eq!(again[0], steered.episode);
    }
}

#[test]
fn a_system_that_cannot_be_steered_is_an_error() {
    let space = Space::new("starts", vec![Axis::start("x", "", 0.0, 1.0)]).unwrap();
    let scenarios = Scenarios::new(&space, [], false).unwrap();
    let mut system = FunctionSystem::new(space, |_: &Request| SimulatedEnd::Robustness(1.0));
    let error = risk(&mut system, &scenarios, &settings(1000, 1), |_| ControlFlow::Continue(()));
    assert!(matches!(error, Err(RiskError::NotSteerable)));
}
