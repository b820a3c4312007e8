//! Invariants of trials that continue after their first violation, on a toy with six known failure
//! modes.

use std::collections::BTreeSet;
use std::ops::ControlFlow;
use std::rc::Rc;

use mishandle_falsification::{
    Falsification, FalsificationError, FalsificationOutcome, FalsificationSettings, KeepGoing, Signature,
    TrialEnd, simulations_without_mode,
};
use mishandle_rollout::{Episode, Seed, Space, Specification, System};
use mishandle_search::{Coordinate, SEARCHES, SearchOptions, by_name};
use mishandle_stl::{Formula, Trace};

/// The centers of the pits of `toy/pits`.
const CENTERS: [[f64; 2]; 6] =
    [[0.2, 0.2], [0.75, 0.25], [0.25, 0.75], [0.55, 0.55], [0.85, 0.6], [0.8, 0.9]];

/// A toy with its space `starts`.
struct Setup {
    space: Space,
    system: Box<dyn System>,
    episode_steps: usize,
}

fn setup(name: &str) -> Setup {
    let target = mishandle_toys::target(name).unwrap().unwrap();
    let requirement = Formula::parse(&target.formulas[0].text).unwrap();
    let space = target.space("starts").unwrap();
    let system = target.system(&space, &Specification::new(requirement)).unwrap();
    Setup { space, system, episode_steps: target.episode_steps }
}

/// Returns the signal that is negative first, and when.
fn signature(trace: &Trace) -> Signature {
    let negative = |signal: usize| trace.column(signal).iter().position(|value| *value < 0.0);
    let first = (0..trace.names().len()).filter_map(|signal| Some((negative(signal)?, signal))).min();
    let (sample, signal) = first.unwrap_or_default();
    Signature { predicate: trace.names()[signal].clone(), sample }
}

fn falsification(
    search: &'static str,
    setup: &Setup,
    settings: FalsificationSettings,
) -> Falsification<'static> {
    let coordinates = vec![Coordinate::Continuous; setup.space.dimension()];
    let make = move |seed| by_name(search, &coordinates, seed, &SearchOptions::default());
    Falsification::new(settings, &setup.space, make).unwrap()
}

fn keep_going(setup: &Setup, new_mode_rate: f64) -> KeepGoing<'static> {
    KeepGoing {
        signature: Rc::new(|trace| Ok(signature(trace))),
        episode_steps: setup.episode_steps,
        new_mode_rate,
    }
}

/// Runs until at least `limit` simulations are in `rows`.
fn run(
    falsification: &mut Falsification<'_>,
    system: &mut dyn System,
    limit: usize,
    rows: &mut Vec<Episode>,
) -> FalsificationOutcome {
    let outcome = falsification.run(system, |batch| {
        rows.extend(batch.episodes.iter().cloned());
        let flow = if rows.len() < limit { ControlFlow::Continue(()) } else { ControlFlow::Break(()) };
        Ok::<_, FalsificationError>(flow)
    });
    FalsificationOutcome { surplus: 0, ..outcome.unwrap() }
}

fn settings(trials: u32, budget: u32, seed: u64) -> FalsificationSettings {
    FalsificationSettings { trials, budget, seed: Seed(seed), batch: 16, ..FalsificationSettings::default() }
}

fn whole(
    search: &'static str,
    setup: &mut Setup,
    settings: FalsificationSettings,
    rate: f64,
) -> (FalsificationOutcome, Vec<Episode>) {
    let mut rows = Vec::new();
    let mut falsification = falsification(search, setup, settings).keep_going(keep_going(setup, rate));
    let outcome = run(&mut falsification, &mut *setup.system, usize::MAX, &mut rows);
    // Trials are interleaved.
    rows.sort_by_key(|episode| (episode.request.trial, episode.request.number));
    (outcome, rows)
}

fn names() -> impl Iterator<Item = &'static str> {
    SEARCHES.iter().map(|entry| entry.name)
}

/// Returns the indices of the pits in which the trial fails.
fn pits(rows: &[Episode], trial: u32) -> BTreeSet<usize> {
    let failing = rows.iter().filter(|row| row.request.trial == trial && row.is_violated());
    let nearest = |row: &Episode| {
        let values = row.request.scenario.values();
        let [x, y] = [0, 1].map(|axis| values[axis].unwrap());
        let distance = |index: &usize| (x - CENTERS[*index][0]).hypot(y - CENTERS[*index][1]);
        (0..CENTERS.len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap()
    };
    failing.map(nearest).collect()
}

#[test]
fn the_simulations_up_to_the_first_violation_are_those_of_a_plain_trial() {
    let mut setup = setup("toy/pits");
    for search in names() {
        let settings = settings(3, 150, 5);
        let mut plain = Vec::new();
        let expected =
            run(&mut falsification(search, &setup, settings), &mut *setup.system, usize::MAX, &mut plain);
        let (found, rows) = whole(search, &mut setup, settings, 0.0);
        for row in &plain {
            assert!(rows.contains(row), "{search}");
        }
        for (expected, found) in expected.trials.iter().zip(&found.trials) {
            assert_eq!(expected.first_violation, found.first_violation, "{search}");
        }
        assert_eq!(expected.falsification_rate, found.falsification_rate, "{search}");
        assert_eq!(expected.mean_simulations, found.mean_simulations, "{search}");
        assert_eq!(expected.median_simulations, found.median_simulations, "{search}");
        assert_eq!(expected.restricted_mean_simulations, found.restricted_mean_simulations, "{search}");
    }
}

#[test]
fn the_simulations_do_not_depend_on_the_batch_size_or_on_an_interruption() {
    let mut setup = setup("toy/pits");
    for search in names() {
        let settings = settings(2, 260, 1);
        let (expected, rows) = whole(search, &mut setup, settings, 0.03);
        for batch in [1, 5, 64] {
            let found = whole(search, &mut setup, FalsificationSettings { batch, ..settings }, 0.03);
            assert_eq!(found, (expected.clone(), rows.clone()), "{search}, batch {batch}");
        }
        for limit in [1, 40, 290] {
            let mut first = Vec::new();
            let mut interrupted =
                falsification(search, &setup, settings).keep_going(keep_going(&setup, 0.03));
            run(&mut interrupted, &mut *setup.system, limit, &mut first);
            let mut resumed = falsification(search, &setup, settings).keep_going(keep_going(&setup, 0.03));
            first.iter().for_each(|row| resumed.replay(row).unwrap());
            assert_eq!(run(&mut resumed, &mut *setup.system, usize::MAX, &mut first), expected, "{search}");
            first.sort_by_key(|episode| (episode.request.trial, episode.request.number));
            assert_eq!(first, rows, "{search}, after {limit}");
        }
    }
}

#[test]
fn a_trial_spends_its_budget_or_ends_by_its_rule() {
    let mut setup = setup("toy/pits");
    for search in names() {
        let (outcome, _) = whole(search, &mut setup, settings(3, 300, 2), 0.0);
        for trial in &outcome.trials {
            match trial.end.unwrap() {
                TrialEnd::BudgetSpent => assert_eq!(trial.simulations, 300, "{search}"),
                TrialEnd::SearchEnded(_) => assert!(trial.simulations < 300, "{search}"),
                end => panic!("{search}: {end:?}"),
            }
        }
        let (outcome, rows) = whole(search, &mut setup, settings(3, 700, 2), 0.02);
        for trial in outcome.trials.iter().filter(|trial| trial.end == Some(TrialEnd::ModesDriedUp)) {
            // The pits may be grouped into fewer modes, but the last new one is at a pit.
            let wait = simulations_without_mode(1, 0.02).unwrap();
            let first = trial.first_violation.unwrap();
            assert!(trial.simulations >= first + wait && trial.simulations < 700, "{search}");
            assert!(!pits(&rows, trial.trial).is_empty());
        }
    }
}

#[test]
fn a_record_of_a_violation_without_a_trace_is_an_error() {
    let mut setup = setup("toy/pits");
    let settings = settings(1, 100, 0);
    let (_, rows) = whole("random", &mut setup, settings, 0.0);
    let mut resumed = falsification("random", &setup, settings).keep_going(keep_going(&setup, 0.0));
    let stripped = |row: &Episode| Episode { trace: Trace::new([].into()), ..row.clone() };
    let error = rows.iter().find_map(|row| resumed.replay(&stripped(row)).err()).unwrap();
    assert!(error.to_string().contains("violates the requirement but has no recorded trace"), "{error}");
}

/// At 0.2 % of the square, the smallest pit is missed by 1,000 random points with a probability of
/// 14 %.
#[test]
fn all_six_pits_are_found() {
    let mut setup = setup("toy/pits");
    for search in ["turbo", "dual-annealing", "differential-evolution"] {
        let (_, rows) = whole(search, &mut setup, settings(10, 1000, 3), 0.0);
        let complete = (1..=10).filter(|trial| pits(&rows, *trial).len() == 6).count();
        assert!(complete >= 8, "{search}: {complete} of 10 trials");
    }
}

#[test]
fn a_known_failing_patch_takes_few_of_the_simulations() {
    // The largest pit has 4.5 % of the square. A local search that is not steered away stays in it.
    let mut setup = setup("toy/pits");
    let (_, rows) = whole("turbo", &mut setup, settings(5, 500, 4), 0.0);
    let failing = rows.iter().filter(|row| row.is_violated()).count();
    assert!(failing < rows.len() / 4, "{failing} of {}", rows.len());
}

#[test]
fn the_stopping_rule_ends_with_one_mode_and_seldom_misses_one_of_six() {
    // With one mode, a trial ends 368 simulations after the first violation, or after failures at
    // the edge of the patch.
    let mut sphere = setup("toy/sphere-2d");
    let (outcome, _) = whole("turbo", &mut sphere, settings(20, 1500, 1), 0.01);
    let wait = simulations_without_mode(1, 0.01).unwrap();
    for trial in &outcome.trials {
        assert_eq!(trial.end, Some(TrialEnd::ModesDriedUp));
        assert_eq!(trial.simulations, trial.first_violation.unwrap() + wait);
    }
    // At the end, one in 500 random points is in the smallest pit, so a rate of 0.01 does not wait
    // for it: a trial may end with five modes. It must not end with fewer, except in 5 % of the
    // trials; 3 of 20 or more have a probability of 8 % then.
    let mut pits_setup = setup("toy/pits");
    let (_, rows) = whole("turbo", &mut pits_setup, settings(20, 3000, 1), 0.01);
    let early = (1..=20).filter(|trial| pits(&rows, *trial).len() < 5).count();
    assert!(early <= 3, "{early} of 20");
}

#[test]
fn a_search_that_keeps_exploring_is_not_replaced() {
    let mut setup = setup("toy/pits");
    let coordinates = [Coordinate::Continuous; 2];
    for search in ["random", "sobol", "direct"] {
        let (_, rows) = whole(search, &mut setup, settings(1, 400, 1), 0.0);
        let seed = settings(1, 400, 1).trial_seed(1).child(0).0;
        let mut alone = by_name(search, &coordinates, seed, &SearchOptions::default()).unwrap();
        // Values decide the points of `direct`, so only the others are compared.
        if search != "direct" {
            let points: Vec<_> = rows.iter().map(|row| row.request.unit_point.clone()).collect();
            assert_eq!(points, alone.ask_batch(400), "{search}");
        }
        let points: BTreeSet<String> =
            rows.iter().map(|row| format!("{:?}", row.request.unit_point)).collect();
        assert_eq!(points.len(), rows.len(), "{search}");
    }
}
