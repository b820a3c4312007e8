use mishandle_rollout::{Axis, AxisKind, AxisValues, Condition, Holds, Request, Scenario, Stream};
use mishandle_toys::{FunctionSystem, SimulatedEnd};

use super::amplitude::{all_scenarios, between, scaled, scenario_at};
use super::*;
use crate::repeat::BATCH;

const BUDGET: u64 = 4000;

fn settings(budget: u64) -> MarginSettings {
    MarginSettings { seed: Seed(1), budget, is_random: false }
}

fn inputs(n: usize) -> Vec<Axis> {
    (0..n).map(|i| Axis::new(AxisKind::Input, &format!("x{i}"), "", [-1.0, 1.0], Some(0.0))).collect()
}

fn found(axes: Vec<Axis>, robustness: impl Fn(&[f64]) -> f64 + 'static) -> (Margin, u64) {
    let space = Space::new("disturbance", axes).unwrap();
    let outcome = move |request: &Request| {
        let values: Vec<f64> = request.scenario.values().iter().map(|value| value.unwrap()).collect();
        SimulatedEnd::Robustness(robustness(&values))
    };
    let mut system = FunctionSystem::new(space, outcome);
    let found = margin(&mut system, settings(BUDGET), |_| ControlFlow::Continue(())).unwrap();
    (found, system.simulations() as u64)
}

/// The smallest L∞ disturbance with w x >= c is c / |w|₁: 0.3 / (0.5 + 0.3 + 0.2).
#[test]
fn the_margin_of_a_half_space_is_that_of_a_hand_calculation() {
    let (margin, simulations) = found(inputs(3), |x| 0.3 - (0.5 * x[0] - 0.3 * x[1] + 0.2 * x[2]));
    let witness = margin.witness.as_ref().unwrap();
    let norms = witness.norms;
    assert!((0.3..0.312).contains(&norms.amplitude), "{norms:?}");
    assert!(witness.episode.robustness().unwrap() < 0.0 && witness.axes == 3);
    assert!((norms.l1 - 3.0 * norms.amplitude).abs() < 0.02 && norms.l2 < norms.l1);
    let passed = margin.largest_without_violation().unwrap();
    assert!((0.28..0.3).contains(&passed.amplitude) && passed.simulations > 100, "{passed:?}");
    assert_eq!(margin.simulations, simulations);
    assert!(simulations <= BUDGET);
}

/// The witness is at the boundary of the violations: nearer to nominal on its ray, nothing fails. A
/// calculation by hand gives the smallest disturbances: c / |w|₁ of a half-space, r / √n of the
/// outside of a ball, and the corner itself of a corner.
#[test]
fn the_witness_is_bisected_along_its_ray() {
    type Robustness = fn(&[f64]) -> f64;
    let systems: [(usize, Robustness, f64); 4] = [
        (2, |x| 0.8 - x[0] - x[1], 0.4),
        (10, |x| 3.0 - x.iter().zip(10..).map(|(x, w)| f64::from(w) / 10.0 * x).sum::<f64>(), 3.0 / 14.5),
        (5, |x| 0.16 - x.iter().map(|x| x * x).sum::<f64>(), 0.4 / 5.0_f64.sqrt()),
        (4, |x| if x.iter().all(|x| *x >= 0.5) { -1.0 } else { 1.0 }, 0.5),
    ];
    for (n, robustness, smallest) in systems {
        let outcome = move |request: &Request| {
            let values: Vec<f64> = request.scenario.values().iter().map(|value| value.unwrap()).collect();
            SimulatedEnd::Robustness(robustness(&values))
        };
        for seed in 0..5 {
            let mut system = FunctionSystem::new(Space::new("d", inputs(n)).unwrap(), outcome);
            let settings = MarginSettings { seed: Seed(seed), ..settings(BUDGET) };
            let found = margin(&mut system, settings, |_| ControlFlow::Continue(())).unwrap();
            assert!(found.simulations <= BUDGET && found.simulations == system.simulations() as u64);
            let witness = found.witness.unwrap();
            let scenario = witness.episode.request.scenario;
            let nearer: Vec<f64> = scenario.values().iter().map(|value| 0.9998 * value.unwrap()).collect();
            assert!(robustness(&nearer) >= 0.0, "{n} axes, seed {seed}: {nearer:?}");
            let ratio = witness.norms.amplitude / smallest;
            assert!((1.0 - 1e-9..1.005).contains(&ratio), "{n} axes, seed {seed}: {ratio}");
        }
    }
}

/// From the start 0 the disturbance 0.3 is enough, from the nominal start 0.5 it takes 0.8.
#[test]
fn the_initial_state_is_searched_with_the_disturbance() {
    let axes = [vec![Axis::start("s", "m", 0.0, 1.0)], inputs(1)].concat();
    let (margin, _) = found(axes, |x| 0.3 + x[0] - x[1]);
    let largest = margin.witness.unwrap().norms.amplitude;
    assert!((0.3..0.33).contains(&largest), "{largest}");
}

#[test]
fn axes_without_effect_are_not_in_the_witness() {
    let (margin, _) = found(inputs(10), |x| 0.2 - x[4]);
    let witness = margin.witness.unwrap();
    assert_eq!(witness.axes, 1, "{:?}", witness.episode.request.scenario);
    assert!((0.2..0.212).contains(&witness.norms.amplitude));
}

fn integer(name: &str, low: f64, high: f64) -> Axis {
    Axis::new(AxisKind::Model, name, "control steps", [low, high], Some(0.0)).with_values(AxisValues::Integer)
}

/// Delays of 2 and 3 steps fail. Offsets are thirds of the range: 1/3 passes, 2/3 and 1 fail, and
/// no delay is between 1/3 and 2/3. All four delays are simulated at 1, so 2/3 is known to fail.
#[test]
fn integers_are_bisected_by_whole_steps_and_each_scenario_is_simulated_once() {
    let (margin, _) = found(vec![integer("delay", 0.0, 3.0)], |x| 1.5 - x[0]);
    let tried: Vec<(f64, u64)> =
        margin.levels.iter().map(|level| (level.amplitude, level.simulations)).collect();
    let thirds = [(1.0, 4), (1.0 / 3.0, 2)];
    assert!(tried.len() == 2 && margin.levels.iter().all(|level| level.is_exhaustive), "{tried:?}");
    for ((amplitude, simulations), (expected, scenarios)) in tried.into_iter().zip(thirds) {
        assert!((amplitude - expected).abs() < 1e-12 && simulations == scenarios, "{amplitude}");
    }
    let passed = margin.largest_without_violation().unwrap();
    assert!((passed.amplitude - 1.0 / 3.0).abs() < 1e-12 && passed.simulations == 2);
    let witness = margin.witness.unwrap();
    assert_eq!(witness.episode.request.scenario.get(0), Some(2.0));
    assert!((witness.norms.amplitude - 2.0 / 3.0).abs() < 1e-12);
}

/// Two axes with 2 steps down and 3 up have the amplitudes 1/3, 1/2, 2/3 and 1.
#[test]
fn the_bisection_skips_amplitudes_with_the_same_scenarios() {
    let space = Space::new("s", vec![integer("a", -2.0, 3.0), integer("b", -2.0, 3.0)]).unwrap();
    let third = 1.0 / 3.0;
    for (passes, fails, expected) in [
        (0.0, 1.0, Some(0.5)),
        (0.0, 0.5, Some(third)),
        (0.0, third, None),
        (0.5, 1.0, Some(2.0 * third)),
        (0.51, 1.0, Some(2.0 * third)),
        (2.0 * third, 1.0, None),
    ] {
        let found = between(&space, passes, fails);
        let is_near = found
            .zip(expected)
            .map_or(found == expected, |(found, expected)| (found - expected).abs() < 1e-12);
        assert!(is_near, "{found:?} between {passes} and {fails}");
    }
    let mixed = Space::new("s", [vec![integer("a", -2.0, 3.0)], inputs(1)].concat()).unwrap();
    assert_eq!(between(&mixed, 0.5, 1.0), Some(0.75));
    assert_eq!(between(&mixed, 0.5, 0.509), None);
}

#[test]
fn all_scenarios_are_those_of_a_filtered_grid() {
    let fixed = Axis { nominal: Some(1.0), low: 1.0, high: 1.0, ..inputs(1).remove(0) };
    let noise = Axis::new(AxisKind::Noise, "draw", "", [-4.0, 4.0], None);
    let axes = vec![integer("a", -2.0, 3.0), fixed, integer("b", 0.0, 5.0), noise];
    let space = Space::new("s", axes).unwrap();
    let mut grid = Vec::new();
    for a in -2_i32..=3 {
        for b in 0..=5 {
            let scenario = [Some(f64::from(a)), Some(1.0), Some(f64::from(b)), None];
            let down_or_up = if a < 0 { 2.0 } else { 3.0 };
            grid.push((
                f64::from(a.abs()) / down_or_up,
                f64::from(b) / 5.0,
                Scenario::new(scenario.to_vec()),
            ));
        }
    }
    for amplitude in [0.0, 0.2, 0.34, 0.5, 2.0 / 3.0, 0.8, 1.0] {
        let within = |(a, b, _): &&(f64, f64, Scenario)| a.max(*b) <= amplitude + 1e-9;
        let expected: Vec<&Scenario> = grid.iter().filter(within).map(|(.., scenario)| scenario).collect();
        let found = all_scenarios(&space, amplitude, 36).unwrap();
        assert_eq!(found.iter().collect::<Vec<_>>(), expected, "{amplitude}");
        assert_eq!(all_scenarios(&space, amplitude, expected.len() as u64 - 1), None);
    }
    assert_eq!(all_scenarios(&Space::new("s", inputs(1)).unwrap(), 0.5, u64::MAX), None);
}

/// The nominal 0 of 6 steps: at amplitude k / 6 the ends are -k and k, and no point leads further.
#[test]
fn every_step_within_the_amplitude_is_reached_and_no_other() {
    let space = Space::new("s", vec![integer("a", -6.0, 6.0)]).unwrap();
    for k in 0..=6 {
        let amplitude = f64::from(k) / 6.0;
        let at = |u: f64| scenario_at(&space, &[u], amplitude).get(0).unwrap();
        let mut reached: Vec<i32> = (0..=1000).map(|i| at(f64::from(i) / 1000.0) as i32).collect();
        assert_eq!((reached[0], reached[1000]), (-k, k));
        reached.dedup();
        assert_eq!(reached, (-k..=k).collect::<Vec<_>>());
        let moved = scaled(&space, &Scenario::from([-6.0]), amplitude).get(0);
        assert_eq!(moved, Some(f64::from(-k)));
    }
}

#[test]
fn a_requirement_that_is_never_violated_has_no_witness_after_the_whole_budget() {
    let (margin, simulations) = found(inputs(2), |x| 3.0 - x[0] - x[1]);
    assert!(margin.witness.is_none() && margin.is_complete);
    let [level] = margin.levels[..] else { panic!("{:?}", margin.levels) };
    assert_eq!((level.amplitude, level.simulations, simulations), (1.0, BUDGET, BUDGET));
    assert_eq!(margin.largest_without_violation(), Some(level));
    assert!((1.0..1.1).contains(&level.minimum_robustness.unwrap()), "a corner was tried");
    // All scenarios of two integers are simulated once instead.
    let (margin, simulations) = found(vec![integer("a", 0.0, 3.0), integer("b", 0.0, 1.0)], |_| 1.0);
    assert!(margin.is_complete && margin.levels[0].is_exhaustive && margin.levels[0].is_complete);
    assert_eq!(simulations, 8);
}

/// One of 2⁸ vectors of signs fails, and only above 0.9. A sixteenth of the budget tries 62 of
/// them: found with a probability of 22 %. The whole budget tries 1000: 98 %.
#[test]
fn a_violation_that_the_first_sixteenth_of_the_budget_misses_is_found_by_the_rest() {
    let is_hit = |x: &[f64]| x.iter().zip(0..).all(|(x, i)| if i % 3 == 0 { *x > 0.9 } else { *x < -0.9 });
    let (margin, simulations) = found(inputs(8), move |x| if is_hit(x) { -1.0 } else { 1.0 });
    assert!((BUDGET / 16..BUDGET).contains(&margin.levels[0].simulations), "{:?}", margin.levels);
    assert!(margin.levels[0].is_violated && margin.levels[0].is_complete && simulations <= BUDGET);
    let witness = margin.witness.unwrap();
    assert!((0.9..0.95).contains(&witness.norms.amplitude) && witness.axes == 8, "{:?}", witness.norms);
}

/// The half-space fails at 1 and 0.7 and passes below 0.3, where the search is interrupted.
#[test]
fn an_interrupted_amplitude_is_not_finished() {
    let axes = inputs(3);
    let run = |stop: u64, robustness: fn(&Request) -> f64| {
        let outcome = move |request: &Request| SimulatedEnd::Robustness(robustness(request));
        let mut system = FunctionSystem::new(Space::new("disturbance", axes.clone()).unwrap(), outcome);
        let watch = |done| if done >= stop { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
        margin(&mut system, settings(BUDGET), watch).unwrap()
    };
    let sum = |request: &Request| 0.9 - request.scenario.values().iter().flatten().sum::<f64>();
    let all = run(u64::MAX, sum);
    assert!(all.levels[2].amplitude < 0.3);
    assert!(!all.levels[2].is_violated && all.levels[2].is_complete);
    let before: u64 = all.levels[..2].iter().map(|level| level.simulations).sum();
    let stopped = run(before + 100, sum);
    assert_eq!(stopped.levels.len(), 3);
    assert!(!stopped.levels[2].is_complete && stopped.levels[..2].iter().all(|level| level.is_complete));
    assert_eq!(stopped.largest_without_violation(), None);
    assert!(stopped.witness.is_some() && !stopped.is_complete);
    // Nor is the largest amplitude, without a violation.
    let stopped = run(500, |_| 1.0);
    assert_eq!((stopped.levels.len(), stopped.levels[0].is_complete), (1, false));
    assert_eq!(stopped.largest_without_violation(), None);
    // It is if the interruption comes with the last batch.
    let stopped = run(BUDGET, |_| 1.0);
    assert_eq!(stopped.largest_without_violation().map(|level| level.simulations), Some(BUDGET));
}

#[test]
fn an_amplitude_without_any_verdict_says_nothing() {
    let outcome = |_: &Request| SimulatedEnd::Diverged;
    let mut system = FunctionSystem::new(Space::new("disturbance", inputs(2)).unwrap(), outcome);
    let found = margin(&mut system, settings(50), |_| ControlFlow::Continue(())).unwrap();
    assert_eq!((found.largest_without_violation(), found.has_verdict()), (None, false));
}

/// Without a verdict at all but the nominal value, an amplitude is neither without a violation nor
/// exhausted.
#[test]
fn simulations_without_a_verdict_are_counted_and_are_no_evidence() {
    for axis in [inputs(1).remove(0), integer("k", 0.0, 5.0)] {
        let outcome = |request: &Request| match request.scenario.values()[0] {
            Some(0.0) => SimulatedEnd::Robustness(1.0),
            _ => SimulatedEnd::Diverged,
        };
        let mut system = FunctionSystem::new(Space::new("disturbance", vec![axis]).unwrap(), outcome);
        let found = margin(&mut system, settings(60), |_| ControlFlow::Continue(())).unwrap();
        assert_eq!(found.largest_without_violation(), None, "{:?}", found.levels);
        assert!(found.levels.iter().all(|level| level.without_verdict > 0 && !level.is_exhaustive));
    }
}

/// Nothing fails, and simulations beyond 0.6 of the way to a bound have no verdict: no claim
/// reaches that far. Without them, the same search claims the whole space. Scenarios from which the
/// system cannot start are no such region.
#[test]
fn nothing_is_claimed_about_a_region_without_a_verdict() {
    let search = |end: SimulatedEnd| {
        let outcome = move |request: &Request| match request.scenario.values()[0] {
            Some(x) if x.abs() > 0.6 => end,
            _ => SimulatedEnd::Robustness(1.0),
        };
        let mut system = FunctionSystem::new(Space::new("disturbance", inputs(2)).unwrap(), outcome);
        margin(&mut system, settings(200), |_| ControlFlow::Continue(())).unwrap()
    };
    for end in [SimulatedEnd::Diverged, SimulatedEnd::Undecided] {
        let found = search(end);
        assert_eq!(found.largest_without_violation(), None, "{:?}", found.levels);
        assert!(found.smallest_without_verdict > Some(0.6) && found.witness.is_none());
    }
    for end in [SimulatedEnd::Robustness(1.0), SimulatedEnd::InvalidStart] {
        let found = search(end);
        assert_eq!(found.largest_without_violation().map(|level| level.amplitude), Some(1.0));
        assert_eq!(found.smallest_without_verdict, None);
    }
}

/// An axis of one value is not searched: the margin is that of the other, 0.3 / 0.5.
#[test]
fn a_fixed_axis_is_not_searched() {
    let mut axes = inputs(2);
    // The second one is a random draw that is fixed, so that it has no nominal value.
    axes[1] = Axis::new(AxisKind::Noise, "x1", "", [0.1, 0.1], None);
    let (margin, _) = found(axes, |x| 0.2 + x[1] - 0.5 * x[0]);
    assert!((0.6..0.612).contains(&margin.witness.unwrap().norms.amplitude));
    let mut axes = inputs(2);
    axes[1] = Axis::new(AxisKind::Input, "x1", "", [0.5, 0.5], Some(0.5));
    let (margin, simulations) = found(axes, |x| x[1]);
    assert_eq!((margin.witness.is_none(), simulations), (true, BUDGET));
}

#[test]
fn no_budget_is_exceeded() {
    for budget in [1, 2, 3, 7, 16, 17, 33, 100] {
        for limit in [-2.0, 0.3, 0.9, 5.0] {
            let outcome = move |request: &Request| {
                SimulatedEnd::Robustness(limit - request.scenario.values().iter().flatten().sum::<f64>())
            };
            let mut system = FunctionSystem::new(Space::new("disturbance", inputs(4)).unwrap(), outcome);
            let found = margin(&mut system, settings(budget), |_| ControlFlow::Continue(())).unwrap();
            assert!(found.simulations <= budget && found.is_complete, "{budget}: {}", found.simulations);
            assert_eq!(system.simulations() as u64, found.simulations);
            assert!(found.levels.iter().all(|level| level.is_complete && level.simulations > 0));
        }
    }
}

#[test]
fn a_space_of_initial_states_only_is_an_error() {
    let mut system = FunctionSystem::new(
        Space::new("starts", vec![Axis::start("x", "m", 0.0, 1.0)]).unwrap(),
        |_: &Request| SimulatedEnd::Robustness(1.0),
    );
    let error = margin(&mut system, settings(10), |_| ControlFlow::Continue(())).unwrap_err().to_string();
    assert!(error.contains("number of disturbed axes"), "{error}");
}

#[test]
fn the_time_of_an_event_is_no_disturbance() {
    let event =
        |name: &str, unit: &str, high: f64| Axis::new(AxisKind::Event, name, unit, [0.0, high], Some(0.0));
    // A push of 0.3 is enough, but only after 3 s.
    let axes = vec![event("time", "s", 4.0), event("force", "N", 1.0)];
    let (margin, _) = found(axes, |x| if x[0] > 3.0 { 0.3 - x[1] } else { 1.0 });
    let witness = margin.witness.unwrap();
    assert!(witness.norms.amplitude < 0.32 && witness.axes == 1, "{:?}", witness.norms);
}

#[test]
fn an_interruption_keeps_the_witness_so_far() {
    let outcome = |request: &Request| SimulatedEnd::Robustness(0.3 - request.scenario.get(0).unwrap());
    let system = || FunctionSystem::new(Space::new("disturbance", inputs(4)).unwrap(), outcome);
    let all = margin(&mut system(), settings(BUDGET), |_| ControlFlow::Continue(())).unwrap().simulations;
    let mut largest = f64::INFINITY;
    for stop in [1, all / 8, all / 2, 3 * all / 4] {
        let mut system = system();
        let mut has_ended = false;
        let watch = |done| {
            assert!(!has_ended, "a simulation after the end");
            has_ended = done >= stop;
            if has_ended { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        let found = margin(&mut system, settings(BUDGET), watch).unwrap();
        assert!(!found.is_complete && found.simulations < stop + 2 * BATCH as u64, "{stop}");
        assert_eq!(system.simulations() as u64, found.simulations);
        let witness = found.witness.unwrap();
        assert!(witness.episode.is_violated() && witness.norms.amplitude <= largest);
        largest = witness.norms.amplitude;
    }
    assert!(largest < 0.32, "{largest}");
}

fn random_system(axes: Vec<Axis>, fails: impl Fn(&[f64], f64) -> bool + 'static) -> FunctionSystem {
    let outcome = move |request: &Request| {
        let values: Vec<f64> = request.scenario.values().iter().map(|value| value.unwrap()).collect();
        let draw = request.seed.uniform(Stream::ActionNoise, 0, 0);
        SimulatedEnd::Robustness(if fails(&values, draw) { -1.0 } else { 1.0 })
    };
    FunctionSystem::new(Space::new("disturbance", axes).unwrap(), outcome)
}

fn random_margin(system: &mut FunctionSystem, seed: u64, budget: u64) -> Margin {
    let settings = MarginSettings { seed: Seed(seed), budget, is_random: true };
    margin(system, settings, |_| ControlFlow::Continue(())).unwrap()
}

/// 30 % of the simulations fail, whatever the scenario: 300 of them all pass with a probability of
/// 1e-46, so no seed of the search claims that there is no violation.
#[test]
fn a_random_system_that_fails_often_is_never_called_safe() {
    for seed in 0..30 {
        let mut system = random_system(inputs(2), |_, draw| draw < 0.3);
        let found = random_margin(&mut system, seed, 300);
        assert_eq!(found.witness.unwrap().norms.amplitude, 0.0, "seed {seed}");
    }
}

/// Only the corner (1, 1) fails, with one of four seeds. The repeats of the lowest robustness find
/// it, although its robustness is the lowest one only without a failure.
#[test]
fn the_lowest_scenarios_of_a_random_system_are_repeated_before_a_claim() {
    let outcome = |request: &Request| {
        let near = request.scenario.values().iter().flatten().sum::<f64>();
        let draw = request.seed.uniform(Stream::ActionNoise, 0, 0);
        SimulatedEnd::Robustness(if near > 1.98 && draw < 0.25 { -1.0 } else { 2.5 - near })
    };
    for seed in 0..20 {
        let mut system = FunctionSystem::new(Space::new("disturbance", inputs(2)).unwrap(), outcome);
        assert!(random_margin(&mut system, seed, 400).witness.is_some(), "seed {seed}");
    }
}

/// A claim counts what it rests on: as many seeds as simulations, and never all scenarios.
#[test]
fn a_claim_about_a_random_system_names_its_seeds_and_is_never_exhaustive() {
    for axes in [inputs(2), vec![integer("a", 0.0, 3.0), integer("b", 0.0, 1.0)]] {
        let mut system = random_system(axes, |_, _| false);
        let found = random_margin(&mut system, 5, 200);
        let level = found.largest_without_violation().unwrap();
        assert_eq!((level.amplitude, level.simulations, level.seeds), (1.0, 200, 200));
        assert!(!level.is_exhaustive && found.is_complete);
    }
}

/// The law of all claims: a simulation at most as large as a claim of an exhaustive level passes,
/// and the witness violates.
#[test]
fn an_exhaustive_claim_holds_for_every_scenario() {
    for limit in 0..40 {
        let fails = move |x: &[f64]| 7.0 * x[0] + 3.0 * x[1] >= f64::from(limit);
        let axes = vec![integer("a", 0.0, 3.0), integer("b", 0.0, 6.0)];
        let (margin, _) = found(axes.clone(), move |x| if fails(x) { -1.0 } else { 1.0 });
        let space = Space::new("disturbance", axes).unwrap();
        let grid = (0..=3).flat_map(|a| (0..=6).map(move |b| [f64::from(a), f64::from(b)]));
        let smallest = grid
            .filter(|x| fails(x))
            .map(|x| norms(&space, &Scenario::from(x)).amplitude)
            .fold(f64::INFINITY, f64::min);
        let witness = margin.witness.as_ref().map_or(f64::INFINITY, |witness| witness.norms.amplitude);
        assert_eq!(witness, smallest, "limit {limit}");
        let passed = margin.largest_without_violation();
        assert!(passed.is_none_or(|level| level.is_exhaustive && level.amplitude < smallest));
    }
}

#[test]
fn the_distance_from_nominal_counts_the_initial_state_and_no_category() {
    let names = ["a", "b", "c"].map(String::from).to_vec();
    let axes = vec![
        Axis { nominal: Some(20.0), ..Axis::start("t0", "degC", 10.0, 25.0) },
        integer("n", 0.0, 4.0),
        Axis::new(AxisKind::Model, "season", "", [0.0, 2.0], Some(0.0))
            .with_values(AxisValues::Categorical(names.into())),
    ];
    let space = Space::new("s", axes).unwrap();
    let at = |values: [f64; 3]| distance(&space, &Scenario::from(values));
    assert_eq!(at([20.0, 0.0, 0.0]), 0.0);
    assert!((at([10.0, 0.0, 0.0]) - 1.0).abs() < 1e-12, "its bound is 1 away");
    assert!((at([22.5, 2.0, 2.0]) - 1.0).abs() < 1e-12, "half of each range");
    assert!(at([11.0, 0.0, 0.0]) < at([10.5, 0.0, 0.0]));
}

/// A ridge between 0 and 1 that a bisection does not come back to: it fails above 0.3 near one of
/// 2¹² vectors of signs, and everywhere above 0.9. All seeds come within 0.01 of each other or
/// within a factor of 1.3.
#[test]
fn all_seeds_come_back_below_an_amplitude_that_passed() {
    let sign = |i: usize| if i.is_multiple_of(3) { 1.0 } else { -1.0 };
    let robustness = move |request: &Request| {
        let x: Vec<f64> = request.scenario.values().iter().map(|value| value.unwrap()).collect();
        let along: f64 = x.iter().enumerate().map(|(i, x)| sign(i) * x).sum::<f64>() / 12.0;
        let largest = x.iter().map(|x| x.abs()).fold(0.0, f64::max);
        SimulatedEnd::Robustness((0.3 - along).min(0.9 - largest))
    };
    let smallest: Vec<f64> = (0..10)
        .map(|seed| {
            let mut system = FunctionSystem::new(Space::new("d", inputs(12)).unwrap(), robustness);
            let settings = MarginSettings { seed: Seed(seed), budget: 3000, is_random: false };
            let found = margin(&mut system, settings, |_| ControlFlow::Continue(())).unwrap();
            found.witness.unwrap().norms.amplitude
        })
        .collect();
    let [low, high] = [f64::min, f64::max].map(|of| smallest.iter().copied().reduce(of).unwrap());
    assert!(low >= 0.3 && high <= 1.3 * low, "{smallest:?}");
}

/// A delay fails from 3 steps on wet ground, and from 8 on dry ground.
#[test]
fn each_category_has_its_own_margin_and_the_others_stay_nominal() {
    let ground = Axis::new(AxisKind::Model, "ground", "", [0.0, 1.0], Some(0.0))
        .with_values(AxisValues::Categorical(["dry".to_string(), "wet".to_string()].into()));
    let space = Space::new("d", vec![ground, integer("delay", 0.0, 10.0)]).unwrap();
    let outcome = |request: &Request| {
        let [ground, delay] = [0, 1].map(|i| request.scenario.get(i).unwrap());
        SimulatedEnd::Robustness(if ground > 0.0 { 2.5 - delay } else { 7.5 - delay })
    };
    let smallest = |space: &Space| {
        let mut system = FunctionSystem::new(space.clone(), outcome);
        let found = margin(&mut system, settings(300), |_| ControlFlow::Continue(())).unwrap();
        (found.witness.unwrap().norms.amplitude, system.simulations())
    };
    assert!((smallest(&space).0 - 0.8).abs() < 1e-9);
    let each: Vec<f64> = each_category(&space).unwrap().iter().map(|space| smallest(space).0).collect();
    assert!((each[0] - 0.8).abs() < 1e-9 && (each[1] - 0.3).abs() < 1e-9, "{each:?}");
    assert_eq!(category_axes(&space), [0]);
}

/// Whole numbers and a random system take other paths, each of which ends at once.
#[test]
fn nothing_is_simulated_after_the_end() {
    for (axes, is_random) in [
        (vec![integer("a", 0.0, 40.0), integer("b", 0.0, 40.0)], false),
        (vec![integer("a", 0.0, 40.0), integer("b", 0.0, 40.0)], true),
        ([vec![Axis::start("s", "m", 0.0, 1.0)], inputs(2)].concat(), true),
    ] {
        let outcome = |request: &Request| {
            let sum: f64 = request.scenario.values().iter().flatten().map(|x| x.abs()).sum();
            SimulatedEnd::Robustness(1.3 - sum)
        };
        for stop in 1..30 {
            let mut system = FunctionSystem::new(Space::new("d", axes.clone()).unwrap(), outcome);
            let mut left = stop;
            let settings = MarginSettings { seed: Seed(1), budget: 600, is_random };
            let found = margin(&mut system, settings, |_| {
                assert!(left > 0, "a simulation after the end, {stop}");
                left -= 1;
                if left > 0 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
            });
            assert_eq!(found.unwrap().is_complete, left > 0);
        }
    }
}

/// Axes of a fault whose kinds are none, dropout and bias, with a duration and an offset.
fn fault() -> Space {
    let condition = |axis: &str, holds| Condition { axis: axis.to_string(), nominal: 0.0, holds };
    let kinds = |kinds: &[f64]| condition("fault", Holds::OneOf(kinds.into()));
    let lasts = || condition("fault_duration", Holds::Except(0.0));
    let axis = |name: &str, unit: &str, bounds| Axis::new(AxisKind::Fault, name, unit, bounds, Some(0.0));
    let names = AxisValues::Categorical(["none", "dropout", "bias"].map(String::from).into());
    let axes = vec![
        axis("fault", "", [0.0, 2.0]).with_values(names).only_if([lasts()]),
        axis("fault_onset", "s", [0.0, 4.0]).only_if([lasts(), kinds(&[1.0, 2.0])]),
        axis("fault_duration", "s", [0.0, 2.0]).only_if([kinds(&[1.0, 2.0])]),
        axis("fault_offset", "m", [-0.5, 0.5]).only_if([lasts(), kinds(&[2.0])]),
    ];
    Space::new("faults", axes).unwrap()
}

#[test]
fn the_shortest_fault_of_each_kind_is_found_at_any_onset() {
    // A dropout of more than 0.5 s after 3 s fails; a bias fails by its size times its duration.
    let outcome = |request: &Request| {
        let [kind, onset, duration, offset] = [0, 1, 2, 3].map(|i| request.scenario.get(i).unwrap());
        SimulatedEnd::Robustness(match kind {
            1.0 => (0.5 - duration).max((3.0 - onset) / 10.0),
            2.0 => 0.3 - offset * duration,
            _ => 1.0,
        })
    };
    let space = fault();
    let parts = each_fault(&space).unwrap();
    let kinds: Vec<f64> = parts.iter().map(|part| part.axes()[0].low).collect();
    assert_eq!(kinds, [1.0, 2.0], "without a fault nothing is disturbed");
    assert!(parts[0].axes()[3].is_fixed(), "a dropout has no offset");
    let mut system = FunctionSystem::new(space.clone(), outcome);
    let mut smallest = |part: &Space| {
        let mut system = Narrowed { system: &mut system, space: part };
        let found = margin(&mut system, settings(600), |_| ControlFlow::Continue(())).unwrap();
        found.witness.unwrap().episode.request.scenario
    };
    let dropout = smallest(&parts[0]);
    let duration = dropout.get(2).unwrap();
    assert!(duration > 0.5 && duration < 0.53, "1 % of 2 s above the threshold of 0.5 s: {duration}");
    assert!(dropout.get(1).unwrap() > 3.0 && space.ineffective(&dropout).is_empty());
    // Both the duration and the offset are off nominal.
    let bias = smallest(&parts[1]);
    assert!(bias.get(3).unwrap() * bias.get(2).unwrap() > 0.3);
    assert_eq!(each_category(&space).unwrap().len(), 2);
    // A space without a fault stays as it is.
    let plain = Space::new("d", vec![integer("delay", 0.0, 10.0)]).unwrap();
    assert_eq!(each_fault(&plain).unwrap(), [plain]);
}
