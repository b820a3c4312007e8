//! Invariants of falsifications: batches, interruptions and budgets do not change the simulations.

use std::collections::BTreeMap;
use std::ops::ControlFlow;

use mishandle_falsification::{
    Falsification, FalsificationError, FalsificationOutcome, FalsificationSettings, TrialEnd,
};
use mishandle_rollout::{Axis, Episode, EpisodeEnd, Request, Seed, Space, Stream, System};
use mishandle_search::{Coordinate, SEARCHES, SearchOptions, by_name};
use mishandle_toys::{FunctionSystem, SimulatedEnd};

/// A simulation, and the end of its trial if it is the last one.
#[derive(Clone, Debug, PartialEq)]
struct Row {
    episode: Episode,
    trial_end: Option<TrialEnd>,
}

impl Row {
    fn trial(&self) -> u32 {
        self.episode.request.trial
    }

    fn number(&self) -> u32 {
        self.episode.request.number
    }

    fn robustness(&self) -> Option<f64> {
        self.episode.robustness()
    }
}

/// Rows by trial, in order.
type Rows = BTreeMap<u32, Vec<Row>>;

const TRIALS: u32 = 6;
const BUDGET: u32 = 90;

fn space() -> Space {
    Space::new("starts", vec![Axis::start("x", "m", -1.0, 3.0), Axis::start("y", "m", 0.2, 0.5)]).unwrap()
}

/// A smooth bowl above 0 for small x, in which a local search converges. Elsewhere a noisy cone
/// with a violation around (2, 0.4); the seed of the simulation determines the noise, divergence
/// and early stops.
fn simulated_end(request: &Request) -> SimulatedEnd {
    let [x, y] = [0, 1].map(|i| request.scenario.get(i).unwrap());
    let x = (x - 2.0) / 4.0;
    let y = (y - 0.4) / 0.3;
    if x < -0.35 {
        return SimulatedEnd::Robustness(0.01 + (x + 0.6).powi(2) + y.powi(2));
    }
    match request.seed.uniform(Stream::Push, 0, 0) {
        chance if chance < 0.05 => SimulatedEnd::Diverged,
        chance if chance < 0.1 => SimulatedEnd::Undecided,
        chance => SimulatedEnd::Robustness(x.hypot(y) - 0.08 + 0.02 * chance),
    }
}

fn system() -> FunctionSystem {
    FunctionSystem::new(space(), simulated_end)
}

fn falsification(search: &'static str, trials: u32, budget: u32, batch: usize) -> Falsification<'static> {
    let settings =
        FalsificationSettings { trials, budget, seed: Seed(11), batch, ..FalsificationSettings::default() };
    let make = move |seed| by_name(search, &[Coordinate::Continuous; 2], seed, &SearchOptions::default());
    Falsification::new(settings, &space(), make).unwrap()
}

/// Runs the falsification for at least `limit` simulations and adds them to `rows`. The returned
/// outcome has no surplus, which depends on the batch size.
fn run(
    falsification: &mut Falsification<'_>,
    system: &mut dyn System,
    limit: usize,
    rows: &mut Rows,
) -> FalsificationOutcome {
    let mut count = 0;
    let outcome = falsification.run(system, |batch| {
        count += batch.episodes.len();
        for episode in batch.episodes {
            let Request { trial, number, seed, .. } = episode.request;
            assert_eq!(seed, Seed(11).child(u64::from(trial) - 1).child(number.into()));
            rows.entry(trial).or_default().push(Row { episode: episode.clone(), trial_end: None });
        }
        for trial in batch.ended {
            rows.get_mut(&trial.trial).unwrap().last_mut().unwrap().trial_end = trial.end;
        }
        Ok::<_, FalsificationError>(if count < limit {
            ControlFlow::Continue(())
        } else {
            ControlFlow::Break(())
        })
    });
    FalsificationOutcome { surplus: 0, ..outcome.unwrap() }
}

fn whole(search: &'static str, trials: u32, budget: u32, batch: usize) -> (FalsificationOutcome, Rows) {
    let mut rows = Rows::new();
    let outcome =
        run(&mut falsification(search, trials, budget, batch), &mut system(), usize::MAX, &mut rows);
    (outcome, rows)
}

fn names() -> impl Iterator<Item = &'static str> {
    SEARCHES.iter().map(|entry| entry.name)
}

#[test]
fn the_test_cases_cover_every_kind_of_end() {
    let trials: Vec<_> = names().flat_map(|search| whole(search, TRIALS, BUDGET, 8).0.trials).collect();
    let ended =
        |matches: fn(TrialEnd) -> bool| trials.iter().filter(|trial| trial.end.is_some_and(matches)).count();
    assert!(ended(|end| end == TrialEnd::Falsified) >= 5);
    assert!(ended(|end| end == TrialEnd::BudgetSpent) >= 5);
    assert!(ended(|end| matches!(end, TrialEnd::SearchEnded(_))) >= 1 || names().count() == 1);
    assert!(trials.iter().any(|trial| trial.diverged > 0) && trials.iter().any(|trial| trial.undecided > 0));
}

#[test]
fn the_simulations_do_not_depend_on_the_batch_size() {
    for search in names() {
        for trials in [1, TRIALS] {
            let expected = whole(search, trials, BUDGET, 1);
            assert_eq!(expected.1.len(), trials as usize);
            for batch_size in [0, 2, 3, 7, 32, 400] {
                assert_eq!(
                    whole(search, trials, BUDGET, batch_size),
                    expected,
                    "{search}, batches of {batch_size}"
                );
            }
        }
    }
}

#[test]
fn the_simulations_of_a_trial_do_not_depend_on_other_trials() {
    for search in names() {
        let one = whole(search, 1, BUDGET, 4);
        let many = whole(search, TRIALS, BUDGET, 4);
        assert_eq!(one.1[&1], many.1[&1], "{search}");
    }
}

#[test]
fn a_resumed_campaign_has_the_same_result_as_an_uninterrupted_one() {
    for search in names() {
        let expected = whole(search, TRIALS, BUDGET, 6);
        let all: Vec<Row> = expected.1.values().flatten().cloned().collect();
        for cut in [1, 7, 23, 60, 120, 200, usize::MAX] {
            let mut rows = Rows::new();
            run(&mut falsification(search, TRIALS, BUDGET, 6), &mut system(), cut, &mut rows);
            let mut resumed = falsification(search, TRIALS, BUDGET, 5);
            rows.values().flatten().for_each(|row| resumed.replay(&row.episode).unwrap());
            let outcome = run(&mut resumed, &mut system(), usize::MAX, &mut rows);
            assert_eq!((outcome, rows), expected, "{search}, cut after {cut}");
        }
        // A killed run may end in the middle of a batch, so any prefix of each trial must be valid.
        for keep in [3, 17, 40] {
            let mut rows = Rows::new();
            let mut resumed = falsification(search, TRIALS, BUDGET, 6);
            for row in all.iter().filter(|row| row.number() <= keep + 4 * row.trial()) {
                resumed.replay(&row.episode).unwrap();
                rows.entry(row.trial()).or_default().push(row.clone());
            }
            let outcome = run(&mut resumed, &mut system(), usize::MAX, &mut rows);
            assert_eq!((outcome, rows), expected, "{search}, {keep} kept");
        }
    }
}

#[test]
fn a_paused_campaign_continues_to_the_same_result() {
    for search in names() {
        let expected = whole(search, TRIALS, BUDGET, 4);
        let mut paused = falsification(search, TRIALS, BUDGET, 4);
        let mut system = system();
        let mut rows = Rows::new();
        let mut outcome = run(&mut paused, &mut system, 1, &mut rows);
        for _ in 0..TRIALS * BUDGET {
            outcome = run(&mut paused, &mut system, 1, &mut rows);
        }
        assert_eq!((outcome, rows), expected, "{search}");
    }
}

#[test]
fn no_trial_exceeds_its_budget_and_the_count_includes_the_violation() {
    for search in names() {
        let (outcome, rows) = whole(search, TRIALS, BUDGET, 8);
        for (trial, rows) in outcome.trials.iter().zip(rows.values()) {
            assert_eq!(trial.simulations as usize, rows.len());
            assert!(rows.iter().zip(1..).all(|(row, number)| row.number() == number));
            let violated = |row: &Row| row.episode.is_violated();
            let (last, before) = rows.split_last().unwrap();
            assert!(!before.iter().any(violated) && before.iter().all(|row| row.trial_end.is_none()));
            assert_eq!(last.trial_end, trial.end, "{search}");
            match trial.end.unwrap() {
                TrialEnd::Falsified => assert!(violated(last)),
                TrialEnd::BudgetSpent => assert!(!violated(last) && rows.len() == BUDGET as usize),
                TrialEnd::SearchEnded(_) => {
                    assert!(!violated(last) && rows.len() < BUDGET as usize);
                }
                TrialEnd::ModesDriedUp => panic!("the trials do not keep going"),
            }
        }
    }
}

#[test]
fn the_minimum_is_the_smallest_recorded_robustness() {
    for search in names() {
        let (outcome, rows) = whole(search, TRIALS, BUDGET, 8);
        for (trial, rows) in outcome.trials.iter().zip(rows.values()) {
            let least = rows.iter().filter_map(Row::robustness).fold(f64::INFINITY, f64::min);
            let minimum = trial.minimum.as_ref().unwrap();
            let row = &rows[minimum.number as usize - 1];
            assert_eq!(minimum.robustness, least, "{search}");
            let request = &row.episode.request;
            assert_eq!((&minimum.scenario, minimum.seed), (&request.scenario, request.seed));
            assert_eq!(simulated_end(request), SimulatedEnd::Robustness(least));
            let count = |matches: fn(&Row) -> bool| rows.iter().filter(|row| matches(row)).count() as u32;
            assert_eq!(trial.diverged, count(|row| matches!(row.episode.end, EpisodeEnd::Diverged { .. })));
            assert_eq!(trial.undecided, count(|row| matches!(row.episode.end, EpisodeEnd::Stopped { .. })));
        }
    }
}

#[test]
fn the_surplus_is_smaller_than_the_number_of_simulations() {
    for batch_size in [1, 8, 64] {
        let mut system = system();
        let mut falsification = falsification("random", 1, 5000, batch_size);
        let outcome = run(&mut falsification, &mut system, usize::MAX, &mut Rows::new());
        assert_eq!(outcome.falsified_trials, 1);
        let spent = outcome.simulations as usize;
        assert!(system.simulations() < 2 * spent, "{} simulations for {spent}", system.simulations());
        assert!(batch_size > 1 || system.simulations() == spent);
    }
}

#[test]
fn a_campaign_resumes_with_a_larger_budget() {
    let (_, rows) = whole("random", 4, 10, 4);
    let mut longer = falsification("random", 4, 60, 4);
    rows.values().flatten().for_each(|row| longer.replay(&row.episode).unwrap());
    let mut rows = rows.into_iter().map(|(trial, rows)| (trial, strip_ends(rows))).collect();
    let outcome = run(&mut longer, &mut system(), usize::MAX, &mut rows);
    let expected = whole("random", 4, 60, 4);
    assert_eq!(outcome, expected.0);
    assert_eq!(
        rows.into_values().map(strip_ends).collect::<Vec<_>>(),
        expected.1.into_values().map(strip_ends).collect::<Vec<_>>()
    );
}

fn strip_ends(rows: Vec<Row>) -> Vec<Row> {
    rows.into_iter().map(|row| Row { trial_end: None, ..row }).collect()
}
