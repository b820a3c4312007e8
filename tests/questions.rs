//! Every question is asked in one go or in pieces, with the same answer and the same rows.

use std::ops::ControlFlow;
use std::path::Path;

use mishandle::plan::{
    AxisSetting, EvaluatePlan, FalsifyPlan, MarginPlan, MetamorphicPlan, RelationPlan, RiskPlan,
};
use mishandle::results::Answer;
use mishandle::run::Engine;
use mishandle::store::{RunFile, RunKind, RunWriter, TrialStatus};
use mishandle::{Compared, MishandleError, Plan, ResolvedPlan, RunError};
use serde_json::Value;

/// Relations by name: a change of an axis and what must hold.
fn relations(of: &[(&str, &str, &str, &str)]) -> MetamorphicPlan {
    let relation = |(name, axis, change, holds): &(&str, &str, &str, &str)| {
        let change = [(axis.to_string(), change.to_string())].into();
        (name.to_string(), RelationPlan { holds: holds.to_string(), change })
    };
    let relations = of.iter().map(relation).collect();
    MetamorphicPlan { pairs: 40, batch: 8, relations, ..MetamorphicPlan::default() }
}

fn plans() -> Vec<Plan> {
    let evaluate = EvaluatePlan { episodes: 40, batch: 8, ..EvaluatePlan::default() };
    let falsify = FalsifyPlan { trials: 3, budget: 60, batch: 4, ..FalsifyPlan::default() };
    let margin = MarginPlan { budget: 300, ..MarginPlan::default() };
    let risk = RiskPlan { simulations: 3000, ..RiskPlan::default() };
    let car = Plan { space: "dynamics+events".to_string(), seed: 3, ..Plan::new("toy/car-following", "") };
    vec![
        Plan { evaluate: Some(evaluate), ..Plan::new("toy/noisy", "") },
        Plan { falsify: Some(falsify), ..Plan::new("toy/needle", "") },
        Plan { margin: Some(margin.clone()), ..car.clone() },
        // The witness is repeated with other seeds.
        Plan {
            margin: Some(MarginPlan { budget: 60, ..margin }),
            space: "starts+delay".to_string(),
            action_noise: 0.3,
            ..Plan::new("point-reaching", "ppo")
        },
        Plan { risk: Some(risk.clone()), ..Plan::new("toy/hidden-corner", "") },
        // Every kind of fault of the sensors, and random faults of both sides.
        Plan {
            margin: Some(MarginPlan { budget: 20, ..MarginPlan::default() }),
            space: "faults-sensing".to_string(),
            ..Plan::new("point-reaching", "ppo")
        },
        Plan {
            evaluate: Some(EvaluatePlan { episodes: 40, batch: 8, ..EvaluatePlan::default() }),
            space: "starts+timing+faults-sensing+faults-actuation".to_string(),
            ..Plan::new("point-reaching", "ppo")
        },
        Plan {
            falsify: Some(FalsifyPlan {
                trials: 2,
                budget: 40,
                batch: 1,
                isolate: Some(true),
                ..FalsifyPlan::default()
            }),
            space: "faults-sensing+faults-actuation".to_string(),
            ..Plan::new("point-reaching", "ppo")
        },
        Plan { risk: Some(RiskPlan { simulations: 300, ..risk.clone() }), ..car.clone() },
        // A proposal chooses draws of the action noise while the robot moves.
        Plan {
            risk: Some(RiskPlan { simulations: 300, method: "sequence".to_string(), ..risk }),
            space: "starts+noise".to_string(),
            action_noise: 0.3,
            ..Plan::new("point-reaching", "ppo")
        },
        // The counterexamples move toward nominal.
        Plan {
            falsify: Some(FalsifyPlan {
                trials: 2,
                budget: 60,
                batch: 1,
                isolate: Some(true),
                ..FalsifyPlan::default()
            }),
            ..car
        },
        // A relation that pairs break, one that they do not, and one whose axis source cases lack.
        Plan {
            metamorphic: Some(relations(&[
                ("lower", "x", "-0.4", "robustness-within:0.3"),
                ("same", "x", "+0", "robustness-within:0"),
            ])),
            axes: [("x".to_string(), AxisSetting::Range([0.25, 0.75]))].into(),
            ..Plan::new("toy/noisy", "")
        },
        Plan {
            metamorphic: Some(relations(&[("late", "action_delay", "+3", "robustness-within:0.001")])),
            action_noise: 0.3,
            ..Plan::new("point-reaching", "ppo")
        },
    ]
}

/// Asks the question of a plan, each time up to `calls` more calls of `watch`. Returns the answer,
/// the digest of the rows, and the number of pieces.
fn in_pieces(plan: &Plan, calls: u64) -> (Value, u128, u64) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.sqlite");
    let resolved = ResolvedPlan::new(plan).unwrap();
    let mut run = mishandle::run::create_run(&resolved, Some(&path)).unwrap();
    for pieces in 1.. {
        let mut left = calls.saturating_mul(pieces);
        let answer = mishandle::run::ask(&resolved, run, Engine::Direct, &mut |_| {
            left = left.saturating_sub(1);
            if left > 0 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        })
        .unwrap();
        check_recorded(&resolved, &path, &answer);
        if answer.is_complete() {
            let run = RunFile::open(&path).unwrap();
            assert_eq!(mishandle::run::unfinished(&run).unwrap(), None);
            check_replays(&run, &answer);
            return (json(&answer), run.content_digest().unwrap(), pieces);
        }
        assert!(mishandle::run::unfinished(&RunFile::open(&path).unwrap()).unwrap().is_some());
        run = RunWriter::resume(&path).unwrap();
    }
    unreachable!()
}

/// Returns an answer without the path of its run.
fn json(answer: &Answer) -> Value {
    let mut json = serde_json::to_value(answer).unwrap();
    json.as_object_mut().unwrap().remove("run").unwrap();
    json
}

/// Leaves out whether success is possible from corners, which only the target knows.
fn without_reach(mut json: Value) -> Value {
    let points = json.pointer_mut("/corners/points").and_then(Value::as_array_mut);
    points.into_iter().flatten().for_each(|point| point["reachable"] = Value::Null);
    json
}

/// Checks that the answer follows from the run file alone, also that of an interrupted run.
fn check_recorded(resolved: &ResolvedPlan, path: &Path, answer: &Answer) {
    let run = RunFile::open(path).unwrap();
    let is_begun = run.counts().unwrap().simulations > 0;
    if !is_begun && matches!(answer, Answer::Margin(_) | Answer::Metamorphic(_) | Answer::Risk(_)) {
        return;
    }
    let recorded = mishandle::run::recorded_answer(&run, Some(resolved)).unwrap();
    assert_eq!(json(&recorded), json(answer));
    // Without the target, corners are known if all of them are there.
    if answer.is_complete() {
        let recorded = mishandle::run::answer_of_run(&run, None).unwrap();
        assert_eq!(without_reach(json(&recorded)), without_reach(json(answer)));
    }
}

/// Replays the first, the last and the first failing simulation.
fn check_replays(run: &RunFile, answer: &Answer) {
    let rows: Vec<_> = run.simulations().map(Result::unwrap).collect();
    let failing = rows.iter().find(|row| row.is_violated());
    for row in [rows.first(), rows.last(), failing].into_iter().flatten() {
        let replayed = mishandle::replay::replay(run, row.trial, row.number, None).unwrap();
        assert!(replayed.differences.is_empty(), "{:?}", replayed.differences);
    }
    // What the answer names is in the file.
    match answer {
        Answer::Margin(found) => {
            let witness = found.witness.as_ref().unwrap();
            let row = run.simulation(1, witness.simulation).unwrap();
            assert_eq!(row.robustness, witness.robustness.map(|robustness| robustness.0));
            assert!(row.scenario.iter().eq(witness.scenario.values()));
            // Commands that name no simulation take the witness.
            let chosen = mishandle::replay::select_simulation(run, None, None).unwrap();
            assert_eq!(chosen, Some((1, witness.simulation)));
        }
        Answer::Metamorphic(found) => {
            for pair in found.relations.iter().flat_map(|relation| &relation.worst) {
                let case = &pair.follow_up;
                let row = run.simulation(case.trial, case.simulation).unwrap();
                assert_eq!((row.seed, row.robustness), (pair.seed.0, case.robustness));
                assert_eq!(run.simulation(1, case.simulation).unwrap().seed, row.seed);
            }
            let smallest = found.relations.iter().filter_map(|relation| relation.smallest_change.as_ref());
            for case in smallest.map(|smallest| &smallest.follow_up) {
                let replayed = mishandle::replay::replay(run, case.trial, case.simulation, None).unwrap();
                assert_eq!(replayed.episode.robustness(), case.robustness);
                assert!(replayed.differences.is_empty(), "{:?}", replayed.differences);
            }
        }
        Answer::Risk(found) => {
            for failure in &found.failures {
                let row = run.simulation(1, failure.simulation).unwrap();
                assert!(row.scenario.iter().eq(failure.scenario.values()));
                assert_eq!((row.seed, row.robustness), (failure.seed.0, Some(failure.robustness.0)));
            }
        }
        _ => {}
    }
}

#[test]
fn a_question_in_pieces_has_the_answer_and_the_rows_of_one_in_one_go() {
    for plan in plans() {
        let (whole, digest, _) = in_pieces(&plan, u64::MAX);
        let (pieces, digest_of_pieces, count) = in_pieces(&plan, 7);
        assert_eq!(whole, pieces, "{:?} of {}", plan.kind(), plan.target);
        assert!(
            digest == digest_of_pieces && count > 1,
            "{:?} of {}: {count} pieces",
            plan.kind(),
            plan.target
        );
    }
}

#[test]
fn trials_that_no_question_asks_and_wrong_statuses_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.sqlite");
    for plan in plans().into_iter().filter(|plan| plan.falsify.is_none() && plan.evaluate.is_none()) {
        let resolved = ResolvedPlan::new(&plan).unwrap();
        type Change = fn(&mut RunWriter);
        let changes: [(u64, Change, &str); 2] = [
            (u64::MAX, |run| run.start_trial(9, 0).unwrap(), "trial 9: the question has no such trial"),
            (2, |run| run.end_trial(1, TrialStatus::Converged).unwrap(), "status of trial 1"),
        ];
        for (calls, change, expected) in changes {
            let run = mishandle::run::create_run(&resolved, Some(&path)).unwrap();
            let mut left = calls;
            mishandle::run::ask(&resolved, run, Engine::Direct, &mut |_| {
                left -= 1;
                if left > 0 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
            })
            .unwrap();
            let mut run = RunWriter::resume(&path).unwrap();
            change(&mut run);
            run.close().unwrap();
            let check = |error: MishandleError| assert!(error.to_string().contains(expected), "{error}");
            let run = RunFile::open(&path).unwrap();
            check(mishandle::run::recorded_answer(&run, Some(&resolved)).unwrap_err());
            drop(run);
            let run = RunWriter::resume(&path).unwrap();
            let mut watch = |_: &_| ControlFlow::Continue(());
            check(mishandle::run::ask(&resolved, run, Engine::Direct, &mut watch).unwrap_err());
            std::fs::remove_file(&path).unwrap();
        }
    }
}

#[test]
fn a_run_of_another_question_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let plans = plans();
    let margin = &plans[2];
    let risk = &plans[5];
    let path = folder.path().join("run.sqlite");
    let resolved = ResolvedPlan::new(margin).unwrap();
    mishandle::run::create_run(&resolved, Some(&path)).unwrap().close().unwrap();
    assert_eq!(RunFile::open(&path).unwrap().header().kind, RunKind::Margin);
    let ask = |plan: &Plan| {
        let resolved = ResolvedPlan::new(plan).unwrap();
        let run = RunWriter::resume(&path).unwrap();
        let asked = mishandle::run::ask(&resolved, run, Engine::Direct, &mut |_| ControlFlow::Break(()));
        asked.map(drop).map_err(Box::new)
    };
    let other = Plan { margin: Some(MarginPlan { budget: 99, ..MarginPlan::default() }), ..margin.clone() };
    let error = ask(&other).unwrap_err();
    assert!(
        matches!(*error, MishandleError::Run(RunError::Differs { whose: Compared::Settings, .. })),
        "{error}"
    );
    assert!(ask(risk).is_err());
    ask(margin).unwrap();
}

#[test]
fn a_changed_row_is_named_by_the_replay_and_refused_by_the_question() {
    let plan = &plans()[4];
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.sqlite");
    let resolved = ResolvedPlan::new(plan).unwrap();
    let run = mishandle::run::create_run(&resolved, Some(&path)).unwrap();
    mishandle::run::ask(&resolved, run, Engine::Direct, &mut |_| ControlFlow::Continue(())).unwrap();
    // A copy of the rows in which one scenario is another one.
    let copy = folder.path().join("copy.sqlite");
    let source = RunFile::open(&path).unwrap();
    let mut forged = mishandle::run::create_run(&resolved, Some(&copy)).unwrap();
    forged.start_trial(1, source.trial(1).unwrap().seed).unwrap();
    let mut rows: Vec<_> = source.simulations().map(Result::unwrap).collect();
    rows[9].scenario[0] = rows[8].scenario[0];
    forged.record(&rows).unwrap();
    forged.close().unwrap();
    let replayed = mishandle::replay::replay(&RunFile::open(&copy).unwrap(), 1, 10, None).unwrap();
    assert!(
        replayed.differences.iter().any(|text| text.contains("scenario of simulation 10")),
        "{:?}",
        replayed.differences
    );
    let run = RunWriter::resume(&copy).unwrap();
    let error =
        mishandle::run::ask(&resolved, run, Engine::Direct, &mut |_| ControlFlow::Continue(())).unwrap_err();
    assert!(matches!(error, MishandleError::Run(RunError::OtherRequest { number: 10, .. })), "{error}");
}
