//! Single facts of campaigns: how trials end, and what is refused.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::ops::ControlFlow;

use mishandle_falsification::{Campaign, CampaignOutcome, CampaignSettings, FalsificationError, TrialEnd};
use mishandle_rollout::{
    Axis, Episode, EpisodeEnd, Request, RolloutError, Scenario, Seed, Space, System, Verdict,
};
use mishandle_search::{Coordinate, Observation, Search, SearchEnd, SearchError, SearchOptions, by_name};
use mishandle_toys::{FunctionSystem, SimulatedEnd};

fn space() -> Space {
    Space::new("starts", vec![Axis::start("x", "m", 0.0, 10.0)]).unwrap()
}

fn system(fate: impl Fn(&Request) -> SimulatedEnd + 'static) -> FunctionSystem {
    FunctionSystem::new(space(), fate)
}

/// Walks through given points, and takes values below 6.5 and +∞.
struct Walk {
    points: Vec<f64>,
    asked: usize,
    told: Vec<f64>,
}

impl Search for Walk {
    fn name(&self) -> &'static str {
        "walk"
    }

    fn dimension(&self) -> usize {
        1
    }

    fn ask_batch(&mut self, n: usize) -> Vec<Vec<f64>> {
        let points: Vec<Vec<f64>> = self.points[self.asked..].iter().take(n).map(|u| vec![*u]).collect();
        self.asked += points.len();
        points
    }

    fn tell(&mut self, u: &[f64], observation: &Observation) -> Result<(), SearchError> {
        let value = observation.robustness;
        assert_eq!(u, [self.points[self.told.len()]], "values come back in the order of asking");
        assert!(self.told.iter().all(|told| *told >= 0.0), "nothing is told after a violation");
        assert!(value < 6.5 || value == f64::INFINITY, "what is no counterexample is told as +inf");
        self.told.push(value);
        Ok(())
    }

    fn finished(&self) -> Option<SearchEnd> {
        (self.told.len() == self.points.len()).then_some(SearchEnd::Converged)
    }

    fn best(&self) -> Option<(&[f64], f64)> {
        None
    }
}

fn walk(points: &[f64], trials: u32, budget: u32) -> Campaign<'_> {
    walk_in_batches(points, trials, budget, 32)
}

fn walk_in_batches(points: &[f64], trials: u32, budget: u32, batch: usize) -> Campaign<'_> {
    let settings = CampaignSettings { trials, budget, seed: Seed(3), batch };
    let make =
        move |_| Ok(Box::new(Walk { points: points.to_vec(), asked: 0, told: vec![] }) as Box<dyn Search>);
    Campaign::new(settings, &space(), make).unwrap()
}

fn run(campaign: &mut Campaign<'_>, system: &mut dyn System) -> Result<CampaignOutcome, FalsificationError> {
    campaign.run(system, |_| Ok(ControlFlow::Continue(())))
}

/// Robustness x - 2; above x = 9 it diverges, above x = 8 it is undecided.
fn by_place(request: &Request) -> SimulatedEnd {
    match request.scenario.get(0).unwrap() {
        x if x > 9.0 => SimulatedEnd::Diverged,
        x if x > 8.0 => SimulatedEnd::Undecided,
        x => SimulatedEnd::Robustness(x - 2.0),
    }
}

/// One trial that walks through `points`: how it ended, after how many simulations, with which minimum, diverged and
/// undecided ones.
#[track_caller]
fn check(points: &[f64], budget: u32, expected: (TrialEnd, u32, Option<f64>, u32, u32)) {
    for batch_size in [1, 2, 100] {
        let mut campaign = walk_in_batches(points, 1, budget, batch_size);
        let outcome = run(&mut campaign, &mut system(by_place)).unwrap();
        let trial = &outcome.trials[0];
        let minimum = trial.minimum.as_ref().map(|minimum| minimum.robustness);
        let found = (trial.end.unwrap(), trial.simulations, minimum, trial.diverged, trial.undecided);
        assert_eq!(found, expected, "{points:?}, batches of {batch_size}");
    }
}

#[test]
fn how_trials_end() {
    let converged = TrialEnd::SearchEnded(SearchEnd::Converged);
    // x = 10 u. A violation counts itself, and nothing after it.
    check(&[0.1], 9, (TrialEnd::Falsified, 1, Some(-1.0), 0, 0));
    check(&[0.5, 0.7, 0.1, 0.0, 0.5], 9, (TrialEnd::Falsified, 3, Some(-1.0), 0, 0));
    // A violation by the last simulation of the budget, or by the last one of the search, is one.
    check(&[0.5, 0.1, 0.1], 2, (TrialEnd::Falsified, 2, Some(-1.0), 0, 0));
    check(&[0.5, 0.1], 9, (TrialEnd::Falsified, 2, Some(-1.0), 0, 0));
    // One just after the budget is not seen.
    check(&[0.5, 0.7, 0.1], 2, (TrialEnd::BudgetSpent, 2, Some(3.0), 0, 0));
    check(&[0.5, 0.7], 9, (converged, 2, Some(3.0), 0, 0));
    // Robustness 0 is no violation.
    check(&[0.2], 9, (converged, 1, Some(0.0), 0, 0));
    // Diverged and undecided simulations are spent, counted, and neither found nor least.
    check(&[0.95, 0.85, 0.5, 1.0], 9, (converged, 4, Some(3.0), 2, 1));
    check(&[0.95, 0.85], 9, (converged, 2, None, 1, 1));
}

#[test]
fn the_earliest_of_equal_minima_counts() {
    let outcome = run(&mut walk(&[0.5, 0.3, 0.3, 0.5], 1, 9), &mut system(by_place)).unwrap();
    assert_eq!(outcome.trials[0].minimum.as_ref().unwrap().number, 2);
}

#[test]
fn nothing_is_simulated_beyond_the_budget() {
    let mut system = system(by_place);
    let outcome = run(&mut walk_in_batches(&[0.5; 40], 2, 17, 100), &mut system).unwrap();
    assert_eq!((outcome.simulations, system.simulations()), (34, 34));
}

#[test]
fn a_search_that_has_nothing_to_say_ends_its_trial() {
    check(&[], 9, (TrialEnd::SearchEnded(SearchEnd::Converged), 0, None, 0, 0));
}

#[test]
fn a_negative_robustness_of_a_diverged_simulation_is_no_violation() {
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
fn a_formula_longer_than_the_episode_is_refused() {
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
fn a_robustness_that_is_nan_is_refused_with_its_place() {
    let error =
        run(&mut walk(&[0.5], 1, 9), &mut system(|_| SimulatedEnd::Robustness(f64::NAN))).unwrap_err();
    assert_eq!(
        error.to_string(),
        "the robustness of simulation 1 of trial 1, with scenario [Some(5.0)], is NaN; it has to be a number"
    );
}

#[test]
fn a_system_that_gives_too_few_episodes_is_refused() {
    struct Lazy(FunctionSystem);
    impl System for Lazy {
        fn space(&self) -> &Space {
            self.0.space()
        }
        fn rollout(&mut self, requests: &[Request]) -> Result<Vec<Episode>, RolloutError> {
            self.0.rollout(&requests[1..])
        }
    }
    let error = run(&mut walk(&[0.5], 3, 9), &mut Lazy(system(by_place))).unwrap_err();
    assert!(matches!(error, FalsificationError::Episodes { asked: 3, given: 2 }), "{error}");
}

#[test]
fn a_search_of_another_dimension_than_the_box_is_refused() {
    let settings = CampaignSettings { trials: 1, budget: 1, ..CampaignSettings::default() };
    let make = |seed| by_name("random", &[Coordinate::Continuous; 2], seed, &SearchOptions::default());
    let mut campaign = Campaign::new(settings, &space(), make).unwrap();
    let error = run(&mut campaign, &mut system(by_place)).unwrap_err();
    assert!(matches!(error, FalsificationError::Dimension { found: 2, wanted: 1, .. }), "{error}");
}

#[test]
fn an_empty_campaign_is_refused() {
    for (trials, budget) in [(0, 1), (1, 0)] {
        let settings = CampaignSettings { trials, budget, ..CampaignSettings::default() };
        let make = |seed| by_name("random", &[Coordinate::Continuous], seed, &SearchOptions::default());
        assert!(Campaign::new(settings, &space(), make).is_err());
    }
}

/// The record of simulation `number` of trial 1, at unit point `u`, with robustness 3.
fn recorded(number: u32, u: f64, x0: f64) -> Episode {
    Episode {
        request: Request {
            trial: 1,
            number,
            unit_point: vec![u],
            scenario: [x0].into(),
            seed: Seed(3).child(0).child(number.into()),
            wants_subformulas: false,
        },
        end: EpisodeEnd::Completed,
        steps: 1,
        verdict: Verdict { robustness: Some(3.0), ..Verdict::default() },
        total_reward: 0.0,
        trace: mishandle_stl::Trace::new([].into()),
    }
}

/// The same with another request.
fn changed(episode: &Episode, change: impl FnOnce(&mut Request)) -> Episode {
    let mut episode = episode.clone();
    change(&mut episode.request);
    episode
}

#[test]
fn records_that_are_not_the_campaigns_are_refused() {
    let good = recorded(1, 0.5, 5.0);
    let next_up = f64::from_bits(0.5_f64.to_bits() + 1);
    let refused = |record: Episode| walk(&[0.5, 0.6], 1, 2).replay(&record).unwrap_err();
    assert!(walk(&[0.5, 0.6], 1, 2).replay(&good).is_ok());
    for other in [
        recorded(1, next_up, 5.0),
        recorded(1, 0.5, 5.000_000_000_000_001),
        changed(&good, |request| request.seed = Seed(3)),
        changed(&good, |request| request.unit_point.clear()),
        changed(&good, |request| request.scenario = Scenario::new(vec![None])),
    ] {
        let error = refused(other);
        assert!(matches!(error, FalsificationError::OtherBuild { trial: 1, number: 1, .. }), "{error}");
        assert!(error.to_string().contains("another build"), "{error}");
    }
    for trial in [0, 2] {
        let error = refused(changed(&good, |request| request.trial = trial));
        assert!(matches!(error, FalsificationError::UnknownTrial { trials: 1, .. }), "{error}");
    }
    let error = refused(changed(&good, |request| request.number = 2));
    assert!(matches!(error, FalsificationError::OutOfOrder { wanted: 1, .. }), "{error}");

    let mut full = walk(&[0.5, 0.6, 0.7], 1, 2);
    full.replay(&good).unwrap();
    assert!(matches!(full.replay(&good), Err(FalsificationError::OutOfOrder { wanted: 2, .. })));
    full.replay(&recorded(2, 0.6, 6.0)).unwrap();
    let error = full.replay(&recorded(3, 0.7, 7.0)).unwrap_err();
    assert!(matches!(error, FalsificationError::PastTheEnd { last: 2, .. }), "{error}");
}

#[test]
fn what_comes_after_a_violation_in_its_batch_is_surplus() {
    // Batches of 1, 2 and 4 simulations: the violation is the first of the third batch.
    let points = [0.5, 0.6, 0.7, 0.1, 0.5, 0.5, 0.5, 0.5];
    let mut system = system(by_place);
    let outcome = run(&mut walk_in_batches(&points, 1, 9, 4), &mut system).unwrap();
    assert_eq!((outcome.simulations, outcome.surplus, system.simulations()), (4, 3, 7));
}

#[test]
fn what_the_callback_cannot_do_ends_the_campaign() {
    let found = walk(&[0.5], 1, 9).run(&mut system(by_place), |_| {
        Err(FalsificationError::Rollout(RolloutError::System("disk full".into())))
    });
    assert!(found.unwrap_err().to_string().contains("disk full"));
}
