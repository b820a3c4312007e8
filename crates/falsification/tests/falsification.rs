//! Tests how trials end and which inputs are errors.

use std::ops::ControlFlow;

use mishandle_falsification::{
    Falsification, FalsificationError, FalsificationOutcome, FalsificationSettings, TrialEnd,
};
use mishandle_rollout::{
    Axis, Episode, EpisodeEnd, Request, RolloutError, Scenario, Seed, Space, System, Verdict,
};
use mishandle_search::{Coordinate, Observation, Search, SearchEnd, SearchError, SearchOptions, by_name};
use mishandle_toys::{FunctionSystem, SimulatedEnd};

fn space() -> Space {
    Space::new("starts", vec![Axis::start("x", "m", 0.0, 10.0)]).unwrap()
}

fn system(simulate: impl Fn(&Request) -> SimulatedEnd + 'static) -> FunctionSystem {
    FunctionSystem::new(space(), simulate)
}

/// Proposes a list of points, and checks that every observed value is below 6.5 or +∞.
struct Walk {
    points: Vec<f64>,
    proposed: usize,
    observed: Vec<f64>,
}

impl Search for Walk {
    fn name(&self) -> &'static str {
        "walk"
    }

    fn dimension(&self) -> usize {
        1
    }

    fn ask_batch(&mut self, n: usize) -> Vec<Vec<f64>> {
        let points: Vec<Vec<f64>> = self.points[self.proposed..].iter().take(n).map(|u| vec![*u]).collect();
        self.proposed += points.len();
        points
    }

    fn tell(&mut self, u: &[f64], observation: &Observation) -> Result<(), SearchError> {
        let value = observation.robustness;
        assert_eq!(u, [self.points[self.observed.len()]], "observations arrive in the order of the points");
        assert!(self.observed.iter().all(|value| *value >= 0.0), "no observation follows a violation");
        assert!(
            value < 6.5 || value == f64::INFINITY,
            "a simulation without a robustness is observed as +inf"
        );
        self.observed.push(value);
        Ok(())
    }

    fn finished(&self) -> Option<SearchEnd> {
        (self.observed.len() == self.points.len()).then_some(SearchEnd::Converged)
    }

    fn best(&self) -> Option<(&[f64], f64)> {
        None
    }
}

fn walk(points: &[f64], trials: u32, budget: u32) -> Falsification<'_> {
    walk_in_batches(points, trials, budget, 32)
}

fn walk_in_batches(points: &[f64], trials: u32, budget: u32, batch: usize) -> Falsification<'_> {
    let settings =
        FalsificationSettings { trials, budget, seed: Seed(3), batch, ..FalsificationSettings::default() };
    let make = move |_| {
        Ok(Box::new(Walk { points: points.to_vec(), proposed: 0, observed: vec![] }) as Box<dyn Search>)
    };
    Falsification::new(settings, &space(), make).unwrap()
}

fn run(
    falsification: &mut Falsification<'_>,
    system: &mut dyn System,
) -> Result<FalsificationOutcome, FalsificationError> {
    falsification.run(system, |_| Ok(ControlFlow::Continue(())))
}

/// The robustness is x - 2. The simulation diverges for x > 9 and is undecided for 8 < x <= 9.
fn shifted_line(request: &Request) -> SimulatedEnd {
    match request.scenario.get(0).unwrap() {
        x if x > 9.0 => SimulatedEnd::Diverged,
        x if x > 8.0 => SimulatedEnd::Undecided,
        x => SimulatedEnd::Robustness(x - 2.0),
    }
}

/// Checks the end, number of simulations, minimum, and numbers of diverged and undecided
/// simulations of one trial that walks through `points`.
#[track_caller]
fn check(points: &[f64], budget: u32, expected: (TrialEnd, u32, Option<f64>, u32, u32)) {
    for batch_size in [1, 2, 100] {
        let mut falsification = walk_in_batches(points, 1, budget, batch_size);
        let outcome = run(&mut falsification, &mut system(shifted_line)).unwrap();
        let trial = &outcome.trials[0];
        let minimum = trial.minimum.as_ref().map(|minimum| minimum.robustness);
        let found = (trial.end.unwrap(), trial.simulations, minimum, trial.diverged, trial.undecided);
        assert_eq!(found, expected, "{points:?}, batches of {batch_size}");
    }
}

#[test]
fn trials_end_at_a_violation_the_budget_or_the_end_of_the_search() {
    let converged = TrialEnd::SearchEnded(SearchEnd::Converged);
    // x = 10 u. The count includes the violation and nothing after it.
    check(&[0.1], 9, (TrialEnd::Falsified, 1, Some(-1.0), 0, 0));
    check(&[0.5, 0.7, 0.1, 0.0, 0.5], 9, (TrialEnd::Falsified, 3, Some(-1.0), 0, 0));
    // A violation in the last simulation of the budget or of the search counts.
    check(&[0.5, 0.1, 0.1], 2, (TrialEnd::Falsified, 2, Some(-1.0), 0, 0));
    check(&[0.5, 0.1], 9, (TrialEnd::Falsified, 2, Some(-1.0), 0, 0));
    // A violation just after the budget is not simulated.
    check(&[0.5, 0.7, 0.1], 2, (TrialEnd::BudgetSpent, 2, Some(3.0), 0, 0));
    check(&[0.5, 0.7], 9, (converged, 2, Some(3.0), 0, 0));
    // A robustness of 0 is not a violation.
    check(&[0.2], 9, (converged, 1, Some(0.0), 0, 0));
    // Diverged and undecided simulations count against the budget, but are neither violations nor
    // the minimum.
    check(&[0.95, 0.85, 0.5, 1.0], 9, (converged, 4, Some(3.0), 2, 1));
    check(&[0.95, 0.85], 9, (converged, 2, None, 1, 1));
}

#[test]
fn the_minimum_is_the_earliest_of_equals() {
    let outcome = run(&mut walk(&[0.5, 0.3, 0.3, 0.5], 1, 9), &mut system(shifted_line)).unwrap();
    assert_eq!(outcome.trials[0].minimum.as_ref().unwrap().number, 2);
}

#[test]
fn no_simulation_exceeds_the_budget() {
    let mut system = system(shifted_line);
    let outcome = run(&mut walk_in_batches(&[0.5; 40], 2, 17, 100), &mut system).unwrap();
    assert_eq!((outcome.simulations, system.simulations()), (34, 34));
}

#[test]
fn a_search_without_points_ends_its_trial() {
    check(&[], 9, (TrialEnd::SearchEnded(SearchEnd::Converged), 0, None, 0, 0));
}

#[test]
fn a_negative_robustness_of_a_diverged_simulation_is_not_a_violation() {
    struct Diverging(FunctionSystem);
    impl System for Diverging {
        fn space(&self) -> &Space {
            self.0.space()
        }
        fn rollout(&mut self, requests: &[Request]) -> Result<Vec<Episode>, RolloutError> {
            let mut episodes = self.0.rollout(requests)?;
            episodes.iter_mut().for_each(|episode| episode.end = EpisodeEnd::Diverged { step: 1 });
            Ok(episodes)
        }
    }
    let mut system = Diverging(system(|_| SimulatedEnd::Robustness(-1.0)));
    let outcome = run(&mut walk(&[0.5, 0.6], 1, 9), &mut system).unwrap();
    assert_eq!((outcome.falsified_trials, outcome.diverged), (0, 2));
    assert_eq!(outcome.trials[0].minimum, None);
}

#[test]
fn a_formula_longer_than_the_episode_is_an_error() {
    struct Short(FunctionSystem);
    impl System for Short {
        fn space(&self) -> &Space {
            self.0.space()
        }
        fn rollout(&mut self, requests: &[Request]) -> Result<Vec<Episode>, RolloutError> {
            let mut episodes = self.0.rollout(requests)?;
            episodes.iter_mut().for_each(|episode| episode.end = EpisodeEnd::Completed);
            Ok(episodes)
        }
    }
    let error = run(&mut walk(&[0.5], 1, 9), &mut Short(system(|_| SimulatedEnd::Undecided))).unwrap_err();
    assert!(matches!(error, FalsificationError::Undecidable { trial: 1, number: 1 }), "{error}");
}

#[test]
fn a_robustness_of_nan_is_an_error_with_trial_and_simulation() {
    let error =
        run(&mut walk(&[0.5], 1, 9), &mut system(|_| SimulatedEnd::Robustness(f64::NAN))).unwrap_err();
    assert_eq!(
        error.to_string(),
        "the robustness of simulation 1 of trial 1, with scenario [Some(5.0)], is NaN; expected a number"
    );
}

#[test]
fn a_system_that_returns_too_few_episodes_is_an_error() {
    struct Lazy(FunctionSystem);
    impl System for Lazy {
        fn space(&self) -> &Space {
            self.0.space()
        }
        fn rollout(&mut self, requests: &[Request]) -> Result<Vec<Episode>, RolloutError> {
            self.0.rollout(&requests[1..])
        }
    }
    let error = run(&mut walk(&[0.5], 3, 9), &mut Lazy(system(shifted_line))).unwrap_err();
    assert!(matches!(error, FalsificationError::EpisodeCount { requested: 3, returned: 2 }), "{error}");
}

#[test]
fn all_simulations_of_a_run_can_have_one_seed() {
    let seeds_and_points = |fixed_seed| {
        let settings = FalsificationSettings { trials: 2, budget: 5, fixed_seed, ..Default::default() };
        let make = |seed| by_name("random", &[Coordinate::Continuous], seed, &SearchOptions::default());
        let mut found = Vec::new();
        let outcome = Falsification::new(settings, &space(), make).unwrap().run(
            &mut system(|_| SimulatedEnd::Robustness(1.0)),
            |batch| {
                let asked = batch.episodes.iter().map(|episode| &episode.request);
                found.extend(asked.map(|request| (request.seed, request.unit_point.clone())));
                Ok::<_, FalsificationError>(ControlFlow::Continue(()))
            },
        );
        assert_eq!(outcome.unwrap().simulations, 10);
        found.into_iter().unzip::<Seed, Vec<f64>, Vec<_>, Vec<_>>()
    };
    let (own, points) = seeds_and_points(None);
    let (fixed, same_points) = seeds_and_points(Some(Seed(7)));
    assert_eq!(fixed, [Seed(7); 10]);
    assert_eq!(own.iter().map(|seed| seed.0).collect::<std::collections::BTreeSet<_>>().len(), 10);
    assert_eq!(points, same_points, "the seed of the search stays");
}

#[test]
fn a_search_with_another_dimension_than_the_space_is_an_error() {
    let settings = FalsificationSettings { trials: 1, budget: 1, ..FalsificationSettings::default() };
    let make = |seed| by_name("random", &[Coordinate::Continuous; 2], seed, &SearchOptions::default());
    let mut falsification = Falsification::new(settings, &space(), make).unwrap();
    let error = run(&mut falsification, &mut system(shifted_line)).unwrap_err();
    assert!(matches!(error, FalsificationError::Dimension { found: 2, expected: 1, .. }), "{error}");
}

#[test]
fn an_empty_campaign_is_an_error() {
    for (trials, budget) in [(0, 1), (1, 0)] {
        let settings = FalsificationSettings { trials, budget, ..FalsificationSettings::default() };
        let make = |seed| by_name("random", &[Coordinate::Continuous], seed, &SearchOptions::default());
        assert!(Falsification::new(settings, &space(), make).is_err());
    }
}

/// Returns the record of simulation `number` of trial 1 at the point `u`, with robustness 3.
fn recorded(number: u32, u: f64, x0: f64) -> Episode {
    Episode {
        request: Request {
            trial: 1,
            number,
            unit_point: vec![u],
            scenario: [x0].into(),
            seed: Seed(3).child(0).child(number.into()),
            needs_parts: false,
            stop_threshold: None,
        },
        end: EpisodeEnd::Completed,
        steps: 1,
        verdict: Verdict { robustness: Some(3.0), ..Verdict::default() },
        reason: String::new(),
        total_reward: 0.0,
        trace: mishandle_stl::Trace::new([].into()),
        trace_digest: None,
    }
}

/// Returns the episode with a changed request.
fn changed(episode: &Episode, change: impl FnOnce(&mut Request)) -> Episode {
    let mut episode = episode.clone();
    change(&mut episode.request);
    episode
}

#[test]
fn records_of_another_campaign_are_errors() {
    let good = recorded(1, 0.5, 5.0);
    let next_up = f64::from_bits(0.5_f64.to_bits() + 1);
    let error_of = |record: Episode| walk(&[0.5, 0.6], 1, 2).replay(&record).unwrap_err();
    assert!(walk(&[0.5, 0.6], 1, 2).replay(&good).is_ok());
    for other in [
        recorded(1, next_up, 5.0),
        recorded(1, 0.5, 5.000_000_000_000_001),
        changed(&good, |request| request.seed = Seed(3)),
        changed(&good, |request| request.unit_point.clear()),
        changed(&good, |request| request.scenario = Scenario::new(vec![None])),
    ] {
        let error = error_of(other);
        assert!(matches!(error, FalsificationError::RecordMismatch { trial: 1, number: 1, .. }), "{error}");
        assert!(error.to_string().contains("another build"), "{error}");
    }
    for trial in [0, 2] {
        let error = error_of(changed(&good, |request| request.trial = trial));
        assert!(matches!(error, FalsificationError::UnknownTrial { trials: 1, .. }), "{error}");
    }
    let error = error_of(changed(&good, |request| request.number = 2));
    assert!(matches!(error, FalsificationError::OutOfOrder { expected: 1, .. }), "{error}");

    let mut full = walk(&[0.5, 0.6, 0.7], 1, 2);
    full.replay(&good).unwrap();
    assert!(matches!(full.replay(&good), Err(FalsificationError::OutOfOrder { expected: 2, .. })));
    full.replay(&recorded(2, 0.6, 6.0)).unwrap();
    let error = full.replay(&recorded(3, 0.7, 7.0)).unwrap_err();
    assert!(matches!(error, FalsificationError::AfterTrialEnd { last: 2, .. }), "{error}");
}

#[test]
fn simulations_after_a_violation_in_the_same_batch_are_surplus() {
    // Batches of 1, 2 and 4 simulations: the violation is the first of the third batch.
    let points = [0.5, 0.6, 0.7, 0.1, 0.5, 0.5, 0.5, 0.5];
    let mut system = system(shifted_line);
    let outcome = run(&mut walk_in_batches(&points, 1, 9, 4), &mut system).unwrap();
    assert_eq!((outcome.simulations, outcome.surplus, system.simulations()), (4, 3, 7));
}

#[test]
fn an_error_of_the_callback_ends_the_campaign() {
    let found = walk(&[0.5], 1, 9).run(&mut system(shifted_line), |_| {
        Err(FalsificationError::Rollout(RolloutError::System("disk full".into())))
    });
    assert!(found.unwrap_err().to_string().contains("disk full"));
}
