//! Evaluations of a system in closed form: what they run, and that batches change nothing.
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use std::ops::ControlFlow;
use std::sync::Arc;

use mishandle_evaluation::{Evaluation, EvaluationError, Metrics, Report, evaluate};
use mishandle_rollout::{Axis, End, Episode, InitialBox, Request, RolloutError, Seed, System, Verdict};
use mishandle_stl::Trace;

/// Succeeds where the first coordinate is above `threshold`, after as many steps as the second one says.
struct Closed {
    initial_box: InitialBox,
    batch_size: usize,
    threshold: f64,
}

impl Closed {
    fn new(threshold: f64, batch_size: usize) -> Closed {
        let axis = |name: &str, high| Axis { name: name.into(), unit: "m".into(), low: 0.0, high };
        let initial_box = InitialBox::new(vec![axis("x", 1.0), axis("y", 9.0)]).unwrap();
        Closed { initial_box, batch_size, threshold }
    }
}

impl System for Closed {
    fn initial_box(&self) -> &InitialBox {
        &self.initial_box
    }

    fn batch_size(&self) -> usize {
        self.batch_size
    }

    fn rollout(&mut self, requests: &[Request]) -> Result<Vec<Episode>, RolloutError> {
        assert!(!requests.is_empty() && requests.len() <= self.batch_size.max(1));
        let episode = |request: &Request| {
            let mut trace = Trace::new(Arc::from(["d".to_string()]));
            (0..11).for_each(|_| trace.push(&[request.x0[0]]));
            let rho = Some(request.x0[0] - self.threshold);
            Episode {
                x0: request.x0.clone(),
                seed: request.seed,
                trace,
                verdict: Verdict {
                    robustness: rho,
                    success: rho,
                    strict: rho,
                    dangerous_steps: request.x0[1] as usize,
                    completion_step: Some(request.x0[1] as usize),
                },
                total_reward: 0.0,
                end: End::Completed,
            }
        };
        Ok(requests.iter().map(episode).collect())
    }
}

fn run(system: &mut Closed, evaluation: &Evaluation<'_>) -> (Report, Vec<Episode>) {
    let mut seen = Vec::new();
    let report = evaluate(system, evaluation, &mut Metrics::new(), |first, episodes| {
        assert_eq!(first, seen.len() as u64);
        seen.extend_from_slice(episodes);
        Ok::<_, EvaluationError>(ControlFlow::Continue(()))
    });
    (report.unwrap(), seen)
}

#[test]
fn any_batch_size_gives_the_same_simulations_and_the_same_report() {
    let evaluation = Evaluation::new(101, Seed(3));
    let expected = run(&mut Closed::new(0.3, 1), &evaluation);
    for batch_size in [0, 2, 7, 32, 101, 1000] {
        assert_eq!(run(&mut Closed::new(0.3, batch_size), &evaluation), expected, "batch size {batch_size}");
    }
}

#[test]
fn simulation_i_is_the_ith_child_and_the_ith_start_of_the_seed() {
    let mut system = Closed::new(0.3, 8);
    let (_, episodes) = run(&mut system, &Evaluation::new(20, Seed(6)));
    for (episode, i) in episodes.iter().zip(0..) {
        assert_eq!(episode.seed, Seed(6).child(i));
        assert_eq!(episode.x0, system.initial_box.sample(Seed(6), i));
    }
}

#[test]
fn two_controllers_meet_the_same_starts_and_seeds() {
    let keys = |threshold, episodes| -> Vec<(Vec<f64>, Seed)> {
        let (_, episodes) = run(&mut Closed::new(threshold, 8), &Evaluation::new(episodes, Seed(5)));
        episodes.into_iter().map(|episode| (episode.x0, episode.seed)).collect()
    };
    let (one, other) = (keys(0.3, 50), keys(0.9, 50));
    assert_eq!(one, other);
    assert_eq!(keys(0.3, 20), one[..20], "a shorter evaluation is the beginning of a longer one");
    assert!((1..50).all(|i| one[i] != one[0]), "starts differ from one another");
}

#[test]
fn the_rate_of_a_uniform_start_is_the_share_of_the_box() {
    let (report, _) = run(&mut Closed::new(0.3, 64), &Evaluation::new(4000, Seed(1)));
    // Five standard errors of a share of 0.7 among 4000 are 0.036. Steps 0 to 8 are equally likely.
    assert!((report.success_rate.value.unwrap() - 0.7).abs() < 0.036, "{report:?}");
    assert!((report.task_completion_time.value.unwrap() - 4.0).abs() < 0.25, "{report:?}");
    assert!((report.dangerous_behavior_rate.value.unwrap() - 0.4).abs() < 0.025, "{report:?}");
}

#[test]
fn only_accepted_starts_are_run_and_others_are_left_as_they_were() {
    let accepted = |x0: &[f64]| x0[0] > 0.5;
    let all = run(&mut Closed::new(0.3, 8), &Evaluation::new(60, Seed(2))).1;
    let part = run(
        &mut Closed::new(0.3, 8),
        &Evaluation { accepted: Some(&accepted), ..Evaluation::new(60, Seed(2)) },
    )
    .1;
    assert!(part.iter().all(|episode| episode.x0[0] > 0.5));
    for (whole, part) in all.iter().zip(&part) {
        assert_eq!(whole.seed, part.seed);
        assert!(whole.x0 == part.x0 || whole.x0[0] <= 0.5, "an accepted start was moved");
    }
}

#[test]
fn a_box_without_an_accepted_start_is_an_error() {
    let evaluation = Evaluation { accepted: Some(&|_| false), ..Evaluation::new(1, Seed(0)) };
    let found = evaluate(&mut Closed::new(0.3, 4), &evaluation, &mut Metrics::new(), |_, _| {
        Ok::<_, EvaluationError>(ControlFlow::Continue(()))
    });
    assert!(matches!(found, Err(EvaluationError::NoStart { simulation: 0, .. })), "{found:?}");
}

#[test]
fn a_stopped_evaluation_goes_on_to_the_same_report() {
    let evaluation = Evaluation::new(100, Seed(4));
    let (expected, _) = run(&mut Closed::new(0.3, 8), &evaluation);
    let mut metrics = Metrics::new();
    let stopped = evaluate(&mut Closed::new(0.3, 8), &evaluation, &mut metrics, |first, _| {
        Ok::<_, EvaluationError>(if first >= 16 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
    });
    assert_eq!(stopped.unwrap().simulations, 24);
    let resumed = evaluate(&mut Closed::new(0.3, 13), &evaluation, &mut metrics, |_, _| {
        Ok::<_, EvaluationError>(ControlFlow::Continue(()))
    });
    assert_eq!(resumed.unwrap(), expected);
}

#[test]
fn what_the_callback_cannot_do_ends_the_evaluation() {
    let found =
        evaluate(&mut Closed::new(0.3, 8), &Evaluation::new(9, Seed(0)), &mut Metrics::new(), |_, _| {
            Err(EvaluationError::Rollout(RolloutError::System("disk full".into())))
        });
    assert!(found.unwrap_err().to_string().contains("disk full"));
}
