//! The tuning of a guard: its threshold, its scenarios, and its three held-out evaluations.

use std::collections::BTreeSet;
use std::ops::ControlFlow;
use std::path::Path;

use mishandle::plan::{AxisSetting, EvaluatePlan, GuardPlan, TuneSettings};
use mishandle::results::{Choice, GuardTuning, Key, Number, Remedy};
use mishandle::rollout::{Episode, Request, Scenario, Seed};
use mishandle::store::RunFile;
use mishandle::tune::tune;
use mishandle::{Plan, ResolvedPlan};

/// The success formula of ball-balancing: always[50:200](ball_tray_horizontal_distance <= 0.25).
const JUDGED: std::ops::RangeInclusive<usize> = 50..=200;
const DISTANCE: f64 = 0.25;

/// Largest share of false alarms.
const LIMIT: f64 = 0.3;

fn plan() -> Plan {
    // The ball 0.2 s later, if it keeps its velocity: a good prediction.
    let [x, y] = [1, 2].map(|i| format!("(tray_from_ball_{i} - 0.2 * ball_velocity_{i})"));
    let guard = GuardPlan {
        formula: format!("{x} * {x} + {y} * {y} <= 0.04"),
        fallback: "expert".to_string(),
        ..GuardPlan::default()
    };
    let delays = [("action_delay", 2.0), ("observation_delay", 1.0)];
    let axes = delays.map(|(name, high)| (name.to_string(), AxisSetting::Range([0.0, high]))).into();
    let space = "starts+delay".to_string();
    Plan { guard: Some(guard), space, axes, seed: 3, ..Plan::new("ball-balancing", "ppo") }
}

fn settings() -> TuneSettings {
    TuneSettings { episodes: 40, held_out: 24, false_alarms: LIMIT, ..TuneSettings::default() }
}

fn run(plan: &Plan, settings: &TuneSettings, folder: &Path) -> GuardTuning {
    tune(plan, settings, folder, &mut |_| ControlFlow::Continue(())).unwrap().unwrap()
}

/// Returns scenarios and seeds of a run.
fn requests(path: &Path) -> Vec<Request> {
    let run = RunFile::open(path).unwrap();
    let request =
        |row: mishandle::store::Simulation| Request::new(Scenario::new(row.scenario), Seed(row.seed));
    run.simulations().map(|row| request(row.unwrap())).collect()
}

fn episodes(plan: &Plan, requests: &[Request]) -> Vec<Episode> {
    ResolvedPlan::new(plan).unwrap().system().unwrap().rollout(requests).unwrap()
}

fn column<'e>(episode: &'e Episode, name: &str) -> &'e [f64] {
    let index = episode.trace.names().iter().position(|own| own == name).unwrap();
    episode.trace.column(index)
}

/// Returns the bits of all signals of the task.
fn bits(episode: &Episode) -> Vec<u64> {
    let names = episode.trace.names().iter().filter(|name| !name.starts_with("guard_"));
    names.flat_map(|name| column(episode, name).iter().map(|value| value.to_bits())).collect()
}

/// A ball near the center of the tray has no square root. The requirement of the tuning decides,
/// and what it leaves open is too much for a conclusion.
#[test]
fn simulations_that_leave_the_requirement_open_are_counted_in_all_runs() {
    let home = tempfile::tempdir().unwrap();
    let folder = home.path().join("open");
    let formula = format!(
        "always[50:200](ball_tray_horizontal_distance <= {DISTANCE}) and sqrt(ball_tray_horizontal_distance - 0.001) >= 0"
    );
    let settings = TuneSettings { formula: Some(formula), episodes: 60, ..settings() };
    let found = run(&plan(), &settings, &folder);
    let open: usize = ["training", "controller", "guarded"]
        .map(|name| {
            let requests = requests(&folder.join(format!("{name}.sqlite")));
            let guard =
                GuardPlan::from_toml(&std::fs::read_to_string(folder.join("guard.toml")).unwrap()).unwrap();
            let guard = (name == "guarded").then_some(guard);
            let traces = episodes(&Plan { guard, ..plan() }, &requests);
            traces
                .iter()
                .filter(|episode| {
                    column(episode, "ball_tray_horizontal_distance")[..=*JUDGED.end()]
                        .iter()
                        .any(|x| *x < 0.001)
                })
                .count()
        })
        .iter()
        .sum();
    let without = &found.without_verdict;
    assert!(open > 0);
    assert_eq!((without.ends.simulations, without.ends.undecided), (60 + 2 * 24, open as u64));
    assert_eq!(without.is_too_large(), open as f64 > 0.05 * 108.0, "{open}");
    let other = Plan { max_without_verdict: 0.9, ..plan() };
    let error = tune(&other, &settings, &folder, &mut |_| ControlFlow::Continue(())).unwrap_err();
    assert!(error.with_causes().contains("max-without-verdict: recorded 0.05, given 0.9"), "{error}");
}

#[test]
fn a_tuning_is_that_of_its_traces_and_continues_where_it_stopped() {
    let folder = tempfile::tempdir().unwrap();
    let whole = folder.path().join("whole");
    let parts = folder.path().join("parts");
    let found = run(&plan(), &settings(), &whole);
    let threshold = found.subject.guard.as_ref().unwrap().threshold.0;

    // Disjoint scenarios, and the same ones for all three.
    let training = requests(&whole.join("training.sqlite"));
    let held_out =
        ["controller", "guarded", "fallback"].map(|name| requests(&whole.join(format!("{name}.sqlite"))));
    let seeds: BTreeSet<u64> = training.iter().chain(&held_out[0]).map(|request| request.seed.0).collect();
    assert_eq!(seeds.len(), 40 + 24);
    assert!(held_out[1..].iter().all(|other| *other == held_out[0]));

    // Every point of the curve, counted in the traces.
    let guard = plan().guard.unwrap();
    let watching = GuardPlan { threshold: f64::NEG_INFINITY, ..guard.clone() };
    let watched = episodes(&Plan { guard: Some(watching), ..plan() }, &training);
    assert!(found.curve.len() > 10 && threshold.is_finite());
    for point in &found.curve {
        let mut missed = 0;
        let mut false_alarms = 0;
        for episode in &watched {
            let certain = JUDGED
                .clone()
                .find(|step| column(episode, "ball_tray_horizontal_distance")[*step] > DISTANCE);
            // The sample after an action has the robustness that decided about it.
            let alarm = column(episode, "guard_robustness")[1..].iter().position(|x| *x < point.threshold.0);
            match (certain, alarm) {
                (Some(certain), Some(alarm)) if alarm < certain => {}
                (Some(_), _) => missed += 1,
                (None, alarm) => false_alarms += u64::from(alarm.is_some()),
            }
        }
        assert_eq!((point.missed, point.false_alarms), (missed, false_alarms), "{}", point.threshold.0);
        let is_allowed = false_alarms as f64 <= LIMIT * found.training.successes as f64;
        let chosen = found.curve.iter().find(|point| point.threshold == Number(threshold)).unwrap();
        assert!(!is_allowed || missed >= chosen.missed);
    }

    // The written guard is the guarded controller.
    let written = std::fs::read_to_string(whole.join("guard.toml")).unwrap();
    let written = GuardPlan::from_toml(&written).unwrap();
    assert_eq!(written, GuardPlan { threshold, ..guard.clone() });

    // Without an alarm it is the controller alone, and with one from the start the fallback.
    let first = &held_out[0][..8];
    let alone = episodes(&Plan { guard: None, ..plan() }, first);
    let expert = episodes(&Plan { guard: None, controller: "expert".to_string(), ..plan() }, first);
    for (threshold, expected) in [(f64::NEG_INFINITY, alone), (f64::INFINITY, expert)] {
        let guarded =
            episodes(&Plan { guard: Some(GuardPlan { threshold, ..guard.clone() }), ..plan() }, first);
        for (guarded, expected) in guarded.iter().zip(&expected) {
            assert_eq!(bits(guarded), bits(expected), "{threshold}");
        }
    }

    // Interrupted in each phase, and continued.
    for limit in [10, 30, 50, 70] {
        let mut calls = 0;
        let watch = &mut |_: &_| {
            calls += 1;
            if calls * 8 > limit { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        let small = Plan { evaluate: Some(EvaluatePlan { batch: 8, ..Default::default() }), ..plan() };
        drop(tune(&small, &settings(), &parts, watch).unwrap());
    }
    let again = run(&plan(), &settings(), &parts);
    let at = |found: &GuardTuning| GuardTuning {
        folder: String::new(),
        guard_file: String::new(),
        ..found.clone()
    };
    assert_eq!(at(&again), at(&found));
    // The runs of other settings stay as they are.
    assert!(
        tune(&plan(), &TuneSettings { episodes: 41, ..settings() }, &parts, &mut |_| {
            ControlFlow::Continue(())
        })
        .is_err()
    );
}

#[test]
fn refusals_say_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let error = |plan: &Plan, settings: &TuneSettings| {
        let folder = folder.path().join(plan.space.len().to_string());
        tune(plan, settings, &folder, &mut |_| ControlFlow::Continue(())).unwrap_err()
    };
    let missing = error(&Plan { guard: None, ..plan() }, &settings());
    assert_eq!(missing.remedies(), [Remedy::set(Key::GUARD, Choice::FILE)]);
    let error = |plan: &Plan, settings: &TuneSettings| error(plan, settings).to_string();
    assert!(
        error(&Plan { guard: plan().guard, ..Plan::new("toy/noisy", "") }, &settings()).contains("guard")
    );
    assert!(
        error(&plan(), &TuneSettings { false_alarms: 1.0, ..settings() })
            .contains("the share of false alarms")
    );
    // Without delays, ppo does not fail.
    let easy = Plan { space: "starts".to_string(), axes: Default::default(), ..plan() };
    let found = error(&easy, &TuneSettings { episodes: 12, ..settings() });
    assert!(found.starts_with("0 of 12 training scenarios fail"), "{found}");
    let back =
        GuardPlan { threshold: f64::NEG_INFINITY, return_threshold: Some(0.1), ..plan().guard.unwrap() };
    assert!(error(&Plan { guard: Some(back), ..plan() }, &settings()).contains("return-threshold"));
}
