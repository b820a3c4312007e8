//! Tests evaluations of a system in closed form: their simulations, and their independence of
//! batches.

use std::ops::ControlFlow;
use std::sync::Arc;

use mishandle_evaluation::{Evaluation, EvaluationError, FormulaRoles, MetricCounter, Metrics, evaluate};
use mishandle_rollout::{
    Axis, Episode, EpisodeEnd, Request, RolloutError, Scenario, Seed, Space, System, Verdict,
};
use mishandle_stl::Trace;

const ALL: FormulaRoles = FormulaRoles { strict: true, careful: false, safe: true, completion: true };

/// Succeeds if x is above `threshold`. The integer part of y is the number of steps until
/// completion.
struct ClosedForm {
    space: Space,
    threshold: f64,
    largest_batch: usize,
}

impl ClosedForm {
    fn new(threshold: f64) -> ClosedForm {
        let axes = vec![Axis::start("x", "m", 0.0, 1.0), Axis::start("y", "m", 0.0, 9.0)];
        ClosedForm { space: Space::new("starts", axes).unwrap(), threshold, largest_batch: 0 }
    }
}

impl System for ClosedForm {
    fn space(&self) -> &Space {
        &self.space
    }

    fn rollout(&mut self, requests: &[Request]) -> Result<Vec<Episode>, RolloutError> {
        assert!(!requests.is_empty());
        self.largest_batch = self.largest_batch.max(requests.len());
        let episode = |request: &Request| {
            let [x, y] = [0, 1].map(|i| request.scenario.get(i).unwrap());
            let mut trace = Trace::new(Arc::from(["d".to_string()]));
            (0..11).for_each(|_| trace.push(&[x]));
            let rho = Some(x - self.threshold);
            Episode {
                request: request.clone(),
                end: EpisodeEnd::Completed,
                steps: 10,
                verdict: Verdict {
                    robustness: rho,
                    success: rho,
                    strict: rho,
                    careful: rho,
                    dangerous_steps: Some(y as usize),
                    completion_step: Some(y as usize),
                    ..Verdict::default()
                },
                reason: String::new(),
                total_reward: 0.0,
                trace,
                trace_digest: None,
            }
        };
        Ok(requests.iter().map(episode).collect())
    }
}

fn run(system: &mut ClosedForm, evaluation: &Evaluation<'_>) -> (Metrics, Vec<Episode>) {
    let mut recorded = Vec::new();
    let report = evaluate(system, evaluation, &mut MetricCounter::new(ALL), |episodes| {
        assert_eq!(episodes[0].request.number as usize, recorded.len() + 1);
        recorded.extend_from_slice(episodes);
        Ok::<_, EvaluationError>(ControlFlow::Continue(()))
    });
    (report.unwrap(), recorded)
}

fn batches(batch: usize, evaluation: Evaluation<'_>) -> Evaluation<'_> {
    Evaluation { batch, ..evaluation }
}

#[test]
fn the_simulations_and_the_report_do_not_depend_on_the_batch_size() {
    let evaluation = Evaluation::new(101, Seed(3));
    let expected = run(&mut ClosedForm::new(0.3), &batches(1, evaluation));
    for batch in [0, 2, 7, 32, 101, 1000] {
        let mut system = ClosedForm::new(0.3);
        assert_eq!(run(&mut system, &batches(batch, evaluation)), expected, "batch size {batch}");
        assert_eq!(system.largest_batch, batch.clamp(1, 101));
    }
}

#[test]
fn simulation_i_has_child_seed_i_and_scenario_i_of_the_seed() {
    let mut system = ClosedForm::new(0.3);
    let (_, episodes) = run(&mut system, &Evaluation::new(20, Seed(6)));
    for (episode, i) in episodes.iter().zip(0..) {
        assert_eq!(episode.request.seed, Seed(6).child(i));
        assert_eq!(episode.request.scenario, system.space.sample(Seed(6), i));
    }
}

#[test]
fn two_controllers_have_the_same_initial_states_and_seeds() {
    let keys = |threshold, episodes| -> Vec<(Scenario, Seed)> {
        let (_, episodes) = run(&mut ClosedForm::new(threshold), &Evaluation::new(episodes, Seed(5)));
        episodes.into_iter().map(|episode| (episode.request.scenario, episode.request.seed)).collect()
    };
    let one = keys(0.3, 50);
    let other = keys(0.9, 50);
    assert_eq!(one, other);
    assert_eq!(keys(0.3, 20), one[..20], "a shorter evaluation is a prefix of a longer one");
    assert!((1..50).all(|i| one[i] != one[0]), "the initial states differ");
}

#[test]
fn the_success_rate_is_the_successful_fraction_of_the_box() {
    let (report, _) = run(&mut ClosedForm::new(0.3), &Evaluation::new(4000, Seed(1)));
    // Five standard errors of a rate of 0.7 in 4000 simulations are 0.036. Steps 0 to 8 are equally
    // likely.
    assert!((report.success_rate.value.unwrap() - 0.7).abs() < 0.036, "{report:?}");
    assert!((report.task_completion_time.unwrap().value.unwrap() - 4.0).abs() < 0.25, "{report:?}");
    assert!((report.dangerous_behavior_rate.unwrap().value.unwrap() - 0.4).abs() < 0.025, "{report:?}");
}

#[test]
fn the_filter_replaces_only_rejected_scenarios() {
    let filter = |scenario: &Scenario| scenario.get(0) > Some(0.5);
    let all = run(&mut ClosedForm::new(0.3), &Evaluation::new(60, Seed(2))).1;
    let part =
        run(&mut ClosedForm::new(0.3), &Evaluation { filter: Some(&filter), ..Evaluation::new(60, Seed(2)) })
            .1;
    assert!(part.iter().all(|episode| episode.request.scenario.get(0) > Some(0.5)));
    for (whole, part) in all.iter().zip(&part) {
        let whole = &whole.request;
        let part = &part.request;
        assert_eq!(whole.seed, part.seed);
        let is_kept = whole.scenario == part.scenario;
        assert!(is_kept || whole.scenario.get(0) <= Some(0.5), "an accepted scenario was replaced");
    }
}

#[test]
fn a_filter_that_rejects_every_scenario_is_an_error() {
    let evaluation = Evaluation { filter: Some(&|_| false), ..Evaluation::new(1, Seed(0)) };
    let found = evaluate(&mut ClosedForm::new(0.3), &evaluation, &mut MetricCounter::new(ALL), |_| {
        Ok::<_, EvaluationError>(ControlFlow::Continue(()))
    });
    assert!(matches!(found, Err(EvaluationError::NoAcceptedScenario { simulation: 1, .. })), "{found:?}");
}

#[test]
fn a_resumed_evaluation_has_the_same_report() {
    let evaluation = batches(8, Evaluation::new(100, Seed(4)));
    let (expected, _) = run(&mut ClosedForm::new(0.3), &evaluation);
    let mut metrics = MetricCounter::new(ALL);
    let stopped = evaluate(&mut ClosedForm::new(0.3), &evaluation, &mut metrics, |episodes| {
        Ok::<_, EvaluationError>(if episodes[0].request.number > 16 {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        })
    });
    assert_eq!(stopped.unwrap().simulations, 24);
    let resumed = evaluate(&mut ClosedForm::new(0.3), &batches(13, evaluation), &mut metrics, |_| {
        Ok::<_, EvaluationError>(ControlFlow::Continue(()))
    });
    assert_eq!(resumed.unwrap(), expected);
}

#[test]
fn an_error_of_the_callback_ends_the_evaluation() {
    let found = evaluate(
        &mut ClosedForm::new(0.3),
        &Evaluation::new(9, Seed(0)),
        &mut MetricCounter::new(ALL),
        |_| Err(EvaluationError::Rollout(RolloutError::System("disk full".into()))),
    );
    assert!(found.unwrap_err().to_string().contains("disk full"));
}
