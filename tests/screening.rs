//! A rate from screened simulations is that of the system's own simulations, if the engines agree
//! or every simulation is repeated.

use std::ops::ControlFlow;

use mishandle::plan::{EvaluatePlan, FalsifyPlan, MarginPlan, RiskPlan, ScreeningPlan};
use mishandle::results::{
    Answer, Confirmed, Evaluation, Falsification, Finding, Risk, ScreenedFailure, Screening, Trial,
};
use mishandle::rollout::{Request, Scenario, Seed};
use mishandle::run::{Engine, with_faster_engine};
use mishandle::store::{RunFile, RunWriter};
use mishandle::world::{CpuDevice, Outputs, WorldBatch, WorldDevice, WorldError};
use mishandle::{MishandleError, Plan, ResolvedPlan};

use crate::altered_worlds::{Alteration, AlteredDevice};

fn resolved() -> ResolvedPlan {
    let risk = RiskPlan {
        // The controller meets this bound in a part of the simulations.
        formula: Some("always[50:300](finger_target_distance <= 0.008)".to_string()),
        simulations: 100,
        method: "monte-carlo".to_string(),
        ..RiskPlan::default()
    };
    let plan = Plan { action_noise: 0.3, seed: 4, risk: Some(risk), ..Plan::new("point-reaching", "ppo") };
    ResolvedPlan::new(&plan).unwrap()
}

/// Returns a plan whose simulations are screened in 24 worlds. A search has six trials, and some
/// propose one point at a time; MuJoCo C steps idle worlds, too.
fn screening(resolved: ResolvedPlan, confirm: f64) -> ResolvedPlan {
    let rows = resolved.plan.falsify.as_ref().map_or(24, |falsify| falsify.batch.min(6));
    let screening = ScreeningPlan { rows, confirm, ..ScreeningPlan::default() };
    ResolvedPlan::new(&Plan { screening: Some(screening), ..resolved.plan }).unwrap()
}

/// Asks the question of a plan in a new run file.
fn ask(resolved: &ResolvedPlan, engine: Engine<'_>) -> Result<Answer, Box<MishandleError>> {
    let folder = tempfile::tempdir().unwrap();
    let run = mishandle::run::create_run(resolved, Some(&folder.path().join("run.sqlite"))).unwrap();
    mishandle::run::ask(resolved, run, engine, &mut |_| ControlFlow::Continue(())).map_err(Box::new)
}

fn screened(device: &dyn WorldDevice, sample_rate: f64) -> Risk {
    ask(&screening(resolved(), sample_rate), Engine::Screening(device)).unwrap().try_into().unwrap()
}

fn failures_of(resolved: &ResolvedPlan) -> u64 {
    let found: Risk = ask(resolved, Engine::Direct).unwrap().try_into().unwrap();
    found.monte_carlo.failures
}

/// Returns the counts of a screening, and where it found failures.
fn counts(found: &Risk) -> (&Screening, Finding) {
    let counts = found.screening.as_ref().unwrap();
    (counts, *counts.findings.as_ref().unwrap().get("failure").unwrap())
}

#[test]
fn an_engine_with_the_bits_of_the_system_flags_exactly_the_failures() {
    let failures = failures_of(&resolved());
    assert!((5..95).contains(&failures), "{failures} failures: the test needs both outcomes");
    let found = screened(&CpuDevice, 0.3);
    let (counts, finding) = counts(&found);
    assert_eq!((counts.simulations, counts.flagged, finding.flagged), (100, failures, failures));
    assert!(counts.audit_sample > 0);
    assert_eq!(finding.audit_sample, 0);
}

#[test]
fn signals_of_the_manner_on_an_engine_with_the_bits_of_the_system_flag_exactly_the_failures() {
    let plan = resolved().plan;
    let formula = Some("always(tool_speed <= 2.2)".to_string());
    let risk = plan.risk.map(|risk| RiskPlan { formula, ..risk });
    let resolved = ResolvedPlan::new(&Plan { risk, ..plan }).unwrap();
    let failures = failures_of(&resolved);
    assert!((5..95).contains(&failures), "{failures} failures: the test needs both outcomes");
    let answer = ask(&screening(resolved, 0.3), Engine::Screening(&CpuDevice)).unwrap();
    let found: Risk = answer.try_into().unwrap();
    let (counts, finding) = counts(&found);
    assert_eq!((counts.flagged, finding.flagged, finding.audit_sample), (failures, failures, 0));
}

#[test]
fn a_tiny_sample_rate_still_repeats_twenty_of_the_others() {
    let found = screened(&CpuDevice, 1e-9);
    let (counts, _) = counts(&found);
    let others = counts.simulations - counts.flagged;
    assert_eq!(counts.audit_sample, others.min(20));
    assert!(found.probability.as_ref().unwrap().value.is_some());
}

/// Worlds that report every row as diverged, or move the robot without regard to its targets.
#[derive(Clone)]
struct Wrong(bool);

impl Alteration for Wrong {
    fn start_step(&mut self, worlds: &mut dyn WorldBatch) -> Result<(), WorldError> {
        if !self.0 {
            worlds.buffers().inputs.fill(0.1);
        }
        worlds.start_step()
    }

    fn finish_step(&mut self, worlds: &mut dyn WorldBatch) -> Result<(), WorldError> {
        worlds.finish_step()?;
        if let (Outputs::Double(outputs), true) = (worlds.buffers().outputs, self.0) {
            outputs.fill(1.0);
        }
        Ok(())
    }
}

fn wrong(is_diverging: bool) -> AlteredDevice<Wrong> {
    AlteredDevice(Wrong(is_diverging))
}

#[test]
fn a_wrong_engine_changes_the_effort_but_not_the_answer() {
    let failures = failures_of(&resolved());
    for is_diverging in [false, true] {
        let found = screened(&wrong(is_diverging), 1.0);
        let (counts, finding) = counts(&found);
        assert_eq!(counts.flagged + counts.audit_sample, 100);
        assert_eq!(finding.flagged + finding.audit_sample, failures);
        assert_eq!(counts.without_verdict, if is_diverging { 100 } else { 0 });
        let value = found.probability.as_ref().unwrap().value.unwrap();
        assert!((value - failures as f64 / 100.0).abs() < 1e-12);
    }
}

/// The corners take more simulations than the random starts.
fn evaluation(corners: bool) -> ResolvedPlan {
    let evaluate = EvaluatePlan { episodes: 60, batch: 16, corners, ..EvaluatePlan::default() };
    let plan =
        Plan { action_noise: 1.0, seed: 4, evaluate: Some(evaluate), ..Plan::new("ball-balancing", "ppo") };
    ResolvedPlan::new(&plan).unwrap()
}

fn evaluated(device: &dyn WorldDevice, sample_rate: f64, corners: bool) -> Evaluation {
    let answer = ask(&screening(evaluation(corners), sample_rate), Engine::Screening(device));
    answer.unwrap().try_into().unwrap()
}

#[test]
fn a_screened_evaluation_has_the_rates_of_the_plain_one_whatever_the_engine_does() {
    let plain: Evaluation = ask(&evaluation(true), Engine::Direct).unwrap().try_into().unwrap();
    let value = |rate: Option<mishandle::evaluation::Estimate>| rate.and_then(|rate| rate.value).unwrap();
    let expected = [
        plain.metrics.success_rate.value.unwrap(),
        value(plain.metrics.strict_success_rate),
        value(plain.metrics.dangerous_episode_rate),
    ];
    assert!(
        expected.iter().any(|rate| (0.05..0.95).contains(rate)),
        "{expected:?}: both outcomes are needed"
    );
    // The corners are the system's, whatever the engine.
    for (device, sample_rate, corners) in
        [(&CpuDevice as &dyn WorldDevice, 0.2, true), (&wrong(false), 1.0, false), (&wrong(true), 1.0, false)]
    {
        let screened = evaluated(device, sample_rate, corners);
        let metrics = &screened.metrics;
        let found = [Some(metrics.success_rate), metrics.strict_success_rate, metrics.dangerous_episode_rate];
        for (index, (found, expected)) in found.iter().zip(expected).enumerate() {
            let found = found.unwrap();
            // An engine that agrees flags each failure. It flags nothing else, so without a whole
            // sample the other rates have an interval.
            if index == 0 || sample_rate == 1.0 {
                assert!((found.value.unwrap() - expected).abs() < 1e-12, "{found:?} and {expected}");
            } else {
                assert!(found.low.unwrap() <= expected && expected <= found.high.unwrap(), "{found:?}");
            }
        }
        // A screened evaluation has no careful success rate.
        let mut expected = plain.corners.clone().filter(|_| corners);
        if let Some(corners) = &mut expected {
            (corners.carefully_succeeding, corners.center_carefully_succeeds) = (None, None);
            corners.points.iter_mut().for_each(|point| point.careful_successes = None);
        }
        assert_eq!(screened.corners, expected);
        assert!(screened.is_complete);
    }
}

#[test]
fn a_screened_evaluation_repeats_failures_and_no_simulation_for_its_danger() {
    let plain: Evaluation = ask(&evaluation(false), Engine::Direct).unwrap().try_into().unwrap();
    let counts = evaluated(&CpuDevice, 0.2, false).screening.unwrap();
    assert_eq!(counts.flagged, plain.metrics.violations);
    let dangerous = plain.metrics.dangerous_episode_rate.and_then(|rate| rate.value).unwrap();
    assert!(
        counts.flagged < (dangerous * plain.metrics.simulations as f64) as u64,
        "the test needs danger without failures"
    );
}

#[test]
fn the_failures_of_a_screened_evaluation_are_those_of_the_system() {
    let resolved = evaluation(false);
    let found = evaluated(&CpuDevice, 0.2, false);
    let failures = found.failures.unwrap();
    let request = |failure: &ScreenedFailure| {
        let scenario = Scenario::new(failure.scenario.values().copied().collect());
        Request { number: failure.number, ..Request::new(scenario, Seed(failure.seed.0)) }
    };
    let requests: Vec<_> = failures.iter().map(request).collect();
    let episodes = resolved.system().unwrap().rollout(&requests).unwrap();
    assert!(requests.len() > 2);
    let findings = found.screening.unwrap().findings.unwrap();
    assert_eq!(findings.get("failure").unwrap().flagged, requests.len() as u64);
    for (failure, episode) in failures.iter().zip(&episodes) {
        let robustness = failure.robustness.map(|robustness| robustness.0);
        assert_eq!(robustness, episode.verdict.success);
        assert!(robustness.unwrap() <= 0.0);
    }
}

/// Returns an answer without the path of its run.
fn without_run(answer: &Answer) -> serde_json::Value {
    let mut json = serde_json::to_value(answer).unwrap();
    json.as_object_mut().unwrap().remove("run").unwrap();
    json
}

/// Asks a question in pieces, each of which has twice as many calls of `watch` as the one before,
/// and returns the answer with the run's digest and the number of pieces.
fn in_pieces(resolved: &ResolvedPlan, engine: Engine<'_>, calls: u32) -> (Answer, u128, u32) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.sqlite");
    let mut run = mishandle::run::create_run(resolved, Some(&path)).unwrap();
    for pieces in 1.. {
        let mut left = calls.saturating_mul(1 << pieces.min(30));
        let answer = mishandle::run::ask(resolved, run, engine, &mut |_| {
            left = left.saturating_sub(1);
            if left > 0 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        });
        let answer = answer.unwrap();
        if answer.is_complete() {
            let run = RunFile::open(&path).unwrap();
            run.check().unwrap();
            assert_eq!(mishandle::run::unfinished(&run).unwrap(), None);
            let (trial, number) = mishandle::replay::select_simulation(&run, None, None).unwrap().unwrap();
            let replayed = mishandle::replay::replay(&run, trial, number, None).unwrap();
            assert!(replayed.differences.is_empty(), "{:?}", replayed.differences);
            return (answer, run.content_digest().unwrap(), pieces);
        }
        assert!(mishandle::run::unfinished(&RunFile::open(&path).unwrap()).unwrap().is_some());
        run = RunWriter::resume(&path).unwrap();
    }
    unreachable!()
}

#[test]
#[ignore = "long"]
fn a_screened_question_in_pieces_has_the_answer_and_the_rows_of_one_in_one_go() {
    for plan in [resolved(), evaluation(true), falsification(8)] {
        let resolved = screening(plan, 0.2);
        let engine = Engine::Screening(&CpuDevice);
        let (whole, digest, _) = in_pieces(&resolved, engine, u32::MAX);
        let (pieces, digest_of_pieces, count) = in_pieces(&resolved, engine, 100);
        assert_eq!(without_run(&whole), without_run(&pieces));
        assert!(digest == digest_of_pieces && count > 1, "{count} pieces");
    }
}

#[test]
fn an_interrupted_screened_evaluation_counts_no_part_of_a_chunk() {
    let resolved = screening(evaluation(false), 0.5);
    let folder = tempfile::tempdir().unwrap();
    let run = mishandle::run::create_run(&resolved, Some(&folder.path().join("run.sqlite"))).unwrap();
    let mut calls = 0;
    let answer = mishandle::run::ask(&resolved, run, Engine::Screening(&CpuDevice), &mut |_| {
        calls += 1;
        if calls < 2 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    });
    let found: Evaluation = answer.unwrap().try_into().unwrap();
    assert!(!found.is_complete);
    assert_eq!((found.metrics.simulations, found.metrics.success_rate.value), (0, None));
}

#[test]
fn a_screening_that_keeps_going_is_an_error_of_the_plan() {
    let falsify = FalsifyPlan { keep_going: true, ..FalsifyPlan::default() };
    let plan =
        Plan { falsify: Some(falsify), screening: Some(ScreeningPlan::default()), ..evaluation(false).plan };
    let error = ResolvedPlan::new(&plan).unwrap_err().to_string();
    assert!(error.contains("cannot tell failure modes apart"), "{error}");
    let margin = Plan { falsify: None, margin: Some(MarginPlan::default()), ..plan.clone() };
    let toy = Plan { target: "toy/noisy".to_string(), controller: String::new(), ..plan };
    for (plan, expected) in [(margin, "evaluate, falsify or risk"), (toy, "only tasks do")] {
        let plan = Plan { falsify: None, ..plan };
        let error = ResolvedPlan::new(&plan).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn a_screened_plan_without_its_device_is_an_error() {
    let error = ask(&screening(resolved(), 0.2), Engine::Direct).unwrap_err();
    assert!(matches!(&*error, MishandleError::NoDevice { device } if device == "gpu"), "{error}");
}

/// Trials of which some are falsified soon, some late, and some not.
fn falsification(batch: u32) -> ResolvedPlan {
    let falsify = FalsifyPlan {
        search: "dual-annealing".to_string(),
        formula: Some("always[50:300](finger_target_distance <= 0.0115)".to_string()),
        trials: 6,
        budget: 25,
        batch,
        ..FalsifyPlan::default()
    };
    let plan =
        Plan { action_noise: 0.3, seed: 4, falsify: Some(falsify), ..Plan::new("point-reaching", "ppo") };
    ResolvedPlan::new(&plan).unwrap()
}

fn falsified(device: &dyn WorldDevice, sample_rate: f64, batch: u32) -> Falsification {
    falsified_by(&screening(falsification(batch), sample_rate), device)
}

fn falsified_by(resolved: &ResolvedPlan, device: &dyn WorldDevice) -> Falsification {
    ask(resolved, Engine::Screening(device)).unwrap().try_into().unwrap()
}

fn plain_falsification() -> Falsification {
    let found: Falsification = ask(&falsification(24), Engine::Direct).unwrap().try_into().unwrap();
    let falsified = found.falsified_trials;
    assert!(
        (1..6).contains(&falsified),
        "{falsified} of 6 trials are falsified: the test needs both outcomes"
    );
    found
}

/// Returns what a screening must not change.
fn evidence(found: &Falsification) -> Vec<impl PartialEq + std::fmt::Debug> {
    let evidence = |trial: &Trial| {
        let minimum = (trial.minimum_robustness, trial.scenario.clone(), trial.simulation, trial.seed);
        (trial.end, trial.simulations, trial.first_violation, minimum)
    };
    found.trials.iter().map(evidence).collect()
}

/// Returns the simulations of MuJoCo C for a reason.
fn confirmed(found: &Falsification, reason: &str) -> Confirmed {
    *found.screening.as_ref().unwrap().reasons.as_ref().unwrap().get(reason).unwrap()
}

/// Returns the number of simulations that MuJoCo C did not repeat.
fn not_repeated(found: &Falsification) -> u64 {
    let counts = found.screening.as_ref().unwrap();
    counts.simulations - counts.flagged - counts.audit_sample
}

#[test]
fn an_engine_with_the_bits_of_the_system_finds_the_same_counterexamples_and_minima() {
    let plain = plain_falsification();
    for batch in [1, 24, 64] {
        let found = falsified(&CpuDevice, 0.1, batch);
        assert_eq!(evidence(&found), evidence(&plain), "batch {batch}");
        let falsified = u64::from(plain.falsified_trials);
        let violated = confirmed(&found, "violated");
        assert_eq!((violated.simulations, violated.violations), (falsified, falsified));
        let lowest = confirmed(&found, "lowest");
        let sampled = confirmed(&found, "audit_sample");
        assert_eq!((lowest.violations, sampled.violations), (0, 0));
        // The test needs simulations of each kind.
        assert!(
            lowest.simulations > 3 && sampled.simulations > 0 && not_repeated(&found) > 20,
            "{:?}",
            found.screening
        );
        assert_eq!(found.failure_rate_bound, None);
    }
}

#[test]
fn what_the_system_repeats_does_not_depend_on_the_batch() {
    let expected = falsified(&wrong(false), 0.2, 24);
    let found = falsified(&wrong(false), 0.2, 7);
    assert_eq!(found.screening, expected.screening);
    assert_eq!(found.trials, expected.trials);
}

#[test]
fn a_wrong_engine_cannot_falsify_a_trial_and_with_all_repeated_it_changes_nothing() {
    let plain = plain_falsification();
    for is_diverging in [false, true] {
        let found = falsified(&wrong(is_diverging), 1.0, 24);
        assert_eq!(evidence(&found), evidence(&plain));
        assert_eq!(not_repeated(&found), 0);
        let without_verdict = confirmed(&found, "without_verdict").simulations;
        assert_eq!(without_verdict == found.simulations, is_diverging);
    }
    // The hand stays far from its target on this engine, so it reports violations that the system
    // refutes.
    let violated = confirmed(&falsified(&wrong(false), 0.01, 24), "violated");
    assert!(violated.simulations > violated.violations, "{violated:?}");
}

#[test]
fn changed_constants_events_and_faults_have_the_counterexamples_of_the_system() {
    for space in ["starts+dynamics+events", "starts+timing+faults-sensing+faults-actuation"] {
        let plan = Plan { space: space.to_string(), ..falsification(24).plan };
        let resolved = ResolvedPlan::new(&plan).unwrap();
        let plain: Falsification = ask(&resolved, Engine::Direct).unwrap().try_into().unwrap();
        let found = falsified_by(&screening(resolved, 0.1), &CpuDevice);
        assert_eq!(evidence(&found), evidence(&plain), "{space}");
        assert_eq!(confirmed(&found, "audit_sample").violations, 0, "{space}");
    }
}

/// Worlds of a device that is lost at its first step.
#[derive(Clone)]
struct Lost;

impl Alteration for Lost {
    fn finish_step(&mut self, _worlds: &mut dyn WorldBatch) -> Result<(), WorldError> {
        Err(WorldError::Device("the device is lost".to_string()))
    }
}

#[test]
fn a_lost_device_ends_a_campaign_with_its_error() {
    let error = ask(&screening(falsification(24), 0.1), Engine::Screening(&AlteredDevice(Lost))).unwrap_err();
    let text = error.to_string();
    assert!(
        text.contains("the physics engine of the worlds failed") && text.contains("the device is lost"),
        "{text}"
    );
}

const CART_POLE: &str = r#"<mujoco><worldbody><body name="cart">
  <joint name="slide" type="slide" axis="1 0 0" damping="0.1"/><geom size="0.1" mass="1"/>
  <body name="pole"><joint name="hinge" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 0.6" size="0.02" mass="0.1"/></body>
</body></worldbody><actuator><motor joint="slide" ctrlrange="-8 8"/></actuator></mujoco>"#;

const CART_POLE_FILE: &str = r#"
format = 1
name = "cart-pole"
model.file = "cart-pole.xml"
control = { period = 0.02, steps = 50 }
start.hinge = "tilt"
observation.state = "[*qpos('slide'), *qvel('slide'), *qpos('hinge'), *qvel('hinge')]"
policy = { expression = "dot([1, 2, 25, 4], state)", action = "action" }
signals.angle = "abs(qpos('hinge'))[0]"
axes.tilt = { range = [-0.3, 0.3], unit = "rad" }
formulas.upright = "always(angle <= 0.2)"
"#;

#[test]
fn a_robot_in_a_file_is_screened_as_a_task() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("cart-pole.xml"), CART_POLE).unwrap();
    let path = folder.path().join("cart-pole.toml");
    let risk = RiskPlan { simulations: 100, method: "monte-carlo".to_string(), ..RiskPlan::default() };
    let answers = |file: &str| {
        std::fs::write(&path, file).unwrap();
        let plan = Plan { seed: 4, risk: Some(risk.clone()), ..Plan::new(path.to_str().unwrap(), "") };
        let resolved = ResolvedPlan::new(&plan).unwrap();
        (failures_of(&resolved), ask(&screening(resolved, 0.3), Engine::Screening(&CpuDevice)))
    };
    let (failures, answer) = answers(CART_POLE_FILE);
    assert!((5..95).contains(&failures), "{failures} failures: the test needs both outcomes");
    let found: Risk = answer.unwrap().try_into().unwrap();
    let (counts, finding) = counts(&found);
    assert_eq!((counts.simulations, counts.flagged, finding.flagged), (100, failures, failures));
    assert!(counts.audit_sample > 0);
    assert_eq!(finding.audit_sample, 0);
    let peak = CART_POLE_FILE
        .replace("\"abs(qpos('hinge'))[0]\"", "{ value = \"abs(qpos('hinge'))[0]\", over = \"max\" }");
    let error = answers(&peak).1.unwrap_err().to_string();
    assert!(error.contains("cart-pole.toml, line 9: the signal `angle` has `over`"), "{error}");
}

/// Takes its time for each control step.
#[derive(Clone)]
struct Slow;

impl Alteration for Slow {
    fn start_step(&mut self, worlds: &mut dyn WorldBatch) -> Result<(), WorldError> {
        std::thread::sleep(std::time::Duration::from_millis(5));
        worlds.start_step()
    }
}

#[test]
fn a_slow_device_is_not_chosen_and_its_run_needs_none() {
    let plan = screening(evaluation(false), 0.1).plan;
    let watch = |_| ControlFlow::Continue(());
    let chosen = with_faster_engine(&ResolvedPlan::new, &plan, &AlteredDevice(Slow), &watch).unwrap();
    let (chosen, speeds) = chosen.unwrap();
    // 300 control steps of 5 ms in two batches.
    assert!(speeds.seconds[0] * speeds.simulations[0] as f64 > 3.0, "{speeds:?}");
    assert!(!speeds.prefers_screening() && chosen == evaluation(false).plan, "{speeds:?}");
    // The choice is in the header, so whoever continues the run reads it.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.sqlite");
    let resolved = ResolvedPlan::new(&chosen).unwrap();
    let run = mishandle::run::create_run(&resolved, Some(&path)).unwrap();
    let mut left = 2;
    let stopped = mishandle::run::ask(&resolved, run, Engine::Direct, &mut |_| {
        left -= 1;
        if left > 0 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    });
    assert!(!stopped.unwrap().is_complete());
    let run = RunWriter::resume(&path).unwrap();
    let recorded = mishandle::resolve::recorded_plan(run.file().header(), None).unwrap();
    assert_eq!(recorded.plan.screening, None);
    let answer =
        mishandle::run::ask(&recorded, run, Engine::Direct, &mut |_| ControlFlow::Continue(())).unwrap();
    assert!(answer.is_complete() && answer.screening().is_none());
    let ended = with_faster_engine(&ResolvedPlan::new, &plan, &CpuDevice, &|_| ControlFlow::Break(()));
    assert!(ended.unwrap().is_none());
}
