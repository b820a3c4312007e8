//! A rate from screened simulations is that of the system's own simulations, if the engines agree
//! or every simulation is repeated.

use std::ops::ControlFlow;

use mishandle::falsification::{FalsificationOutcome, ScreenedCounts, TrialOutcome};
use mishandle::plan::{EvaluatePlan, FalsifyPlan, MarginPlan, RiskPlan, ScreeningPlan};
use mishandle::run::{Answer, Engine};
use mishandle::store::{RunFile, RunWriter};
use mishandle::world::{BatchBuffers, BatchSpec, CpuDevice, Outputs, WorldBatch, WorldDevice, WorldError};
use mishandle::{MishandleError, Plan, ResolvedPlan};

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

fn screened(device: &dyn WorldDevice, sample_rate: f64) -> mishandle::risk::ScreenedReport {
    match ask(&screening(resolved(), sample_rate), Engine::Screening(device)).unwrap() {
        Answer::ScreenedRisk(report) => report,
        answer => panic!("{answer:?}"),
    }
}

fn direct_failures() -> u64 {
    match ask(&resolved(), Engine::Direct).unwrap() {
        Answer::Risk(report) => report.monte_carlo.failures,
        answer => panic!("{answer:?}"),
    }
}

#[test]
fn an_engine_with_the_bits_of_the_system_flags_exactly_the_failures() {
    let failures = direct_failures();
    assert!((5..95).contains(&failures), "{failures} failures: the test needs both outcomes");
    let counts = screened(&CpuDevice, 0.3).counts;
    assert_eq!((counts.trials, counts.flagged, counts.flagged_events), (100, failures, failures));
    assert!(counts.sampled > 0);
    assert_eq!(counts.sampled_events, 0);
}

#[test]
fn signals_of_the_manner_on_an_engine_with_the_bits_of_the_system_flag_exactly_the_failures() {
    let plan = resolved().plan;
    let formula = Some("always(tool_speed <= 2.2)".to_string());
    let risk = plan.risk.map(|risk| RiskPlan { formula, ..risk });
    let resolved = ResolvedPlan::new(&Plan { risk, ..plan }).unwrap();
    let failures = match ask(&resolved, Engine::Direct).unwrap() {
        Answer::Risk(report) => report.monte_carlo.failures,
        answer => panic!("{answer:?}"),
    };
    assert!((5..95).contains(&failures), "{failures} failures: the test needs both outcomes");
    let Answer::ScreenedRisk(report) = ask(&screening(resolved, 0.3), Engine::Screening(&CpuDevice)).unwrap()
    else {
        panic!("expected the answer of a screening");
    };
    let counts = report.counts;
    assert_eq!((counts.flagged, counts.flagged_events, counts.sampled_events), (failures, failures, 0));
}

#[test]
fn a_tiny_sample_rate_still_repeats_twenty_of_the_others() {
    let report = screened(&CpuDevice, 1e-9);
    let others = report.counts.trials - report.counts.flagged;
    assert_eq!(report.counts.sampled, others.min(20));
    assert!(report.estimate().value.is_some());
}

/// An engine that reports every row as diverged, or moves the robot without regard to its targets.
struct Wrong(bool);

struct WrongWorlds(Box<dyn WorldBatch>, bool);

impl WorldDevice for Wrong {
    fn engine(&self) -> &'static str {
        "wrong"
    }

    fn batch(&self, spec: &BatchSpec) -> Result<Box<dyn WorldBatch>, WorldError> {
        Ok(Box::new(WrongWorlds(CpuDevice.batch(spec)?, self.0)))
    }
}

impl WorldBatch for WrongWorlds {
    fn write_states(&mut self, rows: &[usize], states: &[f64]) -> Result<(), WorldError> {
        self.0.write_states(rows, states)
    }

    fn write_fields(&mut self, rows: &[usize], values: &[f64]) -> Result<(), WorldError> {
        self.0.write_fields(rows, values)
    }

    fn read_states(&mut self, states: &mut [f64]) -> Result<(), WorldError> {
        self.0.read_states(states)
    }

    fn buffers(&mut self) -> BatchBuffers<'_> {
        self.0.buffers()
    }

    fn start_step(&mut self) -> Result<(), WorldError> {
        if !self.1 {
            self.0.buffers().inputs.fill(0.1);
        }
        self.0.start_step()
    }

    fn finish_step(&mut self) -> Result<(), WorldError> {
        self.0.finish_step()?;
        if let (Outputs::Double(outputs), true) = (self.0.buffers().outputs, self.1) {
            outputs.fill(1.0);
        }
        Ok(())
    }
}

#[test]
fn a_wrong_engine_changes_the_effort_but_not_the_answer() {
    let failures = direct_failures();
    for is_diverging in [false, true] {
        let report = screened(&Wrong(is_diverging), 1.0);
        let counts = report.counts;
        assert_eq!(counts.flagged + counts.sampled, 100);
        assert_eq!(counts.flagged_events + counts.sampled_events, failures);
        assert_eq!(report.screened_without_verdict, if is_diverging { 100 } else { 0 });
        assert!((report.estimate().value.unwrap() - failures as f64 / 100.0).abs() < 1e-12);
    }
}

/// The corners take more simulations than the random starts.
fn evaluation(corners: bool) -> ResolvedPlan {
    let evaluate = EvaluatePlan { episodes: 60, batch: 16, corners, ..EvaluatePlan::default() };
    let plan =
        Plan { action_noise: 1.0, seed: 4, evaluate: Some(evaluate), ..Plan::new("ball-balancing", "ppo") };
    ResolvedPlan::new(&plan).unwrap()
}

fn evaluated(
    device: &dyn WorldDevice,
    sample_rate: f64,
    corners: bool,
) -> mishandle::run::ScreenedEvaluationOutcome {
    match ask(&screening(evaluation(corners), sample_rate), Engine::Screening(device)).unwrap() {
        Answer::ScreenedEvaluation(outcome) => outcome,
        answer => panic!("{answer:?}"),
    }
}

#[test]
fn a_screened_evaluation_has_the_rates_of_the_plain_one_whatever_the_engine_does() {
    let folder = tempfile::tempdir().unwrap();
    let run = mishandle::run::create_run(&evaluation(true), Some(&folder.path().join("run.sqlite"))).unwrap();
    let plain = mishandle::evaluate(&evaluation(true), run, |_| ControlFlow::Continue(())).unwrap();
    let value = |rate: Option<mishandle::evaluation::Estimate>| rate.and_then(|rate| rate.value).unwrap();
    let expected = [
        plain.report.success_rate.value.unwrap(),
        value(plain.report.strict_success_rate),
        value(plain.report.dangerous_episode_rate),
    ];
    assert!(
        expected.iter().any(|rate| (0.05..0.95).contains(rate)),
        "{expected:?}: both outcomes are needed"
    );
    // The corners are the system's, whatever the engine.
    for (device, sample_rate, corners) in
        [(&CpuDevice as &dyn WorldDevice, 0.2, true), (&Wrong(false), 1.0, false), (&Wrong(true), 1.0, false)]
    {
        let outcome = evaluated(device, sample_rate, corners);
        let report = &outcome.report;
        let found = [
            report.success_rate().value.unwrap(),
            value(report.strict_success_rate()),
            value(report.dangerous_episode_rate()),
        ];
        for (found, expected) in found.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-12, "{found} and {expected}");
        }
        // A screened evaluation has no careful success rate.
        let mut expected = plain.corners.clone().filter(|_| corners);
        for point in expected.iter_mut().flat_map(|report| &mut report.points) {
            (point.careful_successes, point.verdicts[2]) = (None, 0);
        }
        assert_eq!(outcome.corners, expected);
        assert!(report.is_complete);
    }
}

#[test]
fn the_failures_of_a_screened_evaluation_are_those_of_the_system() {
    let resolved = evaluation(false);
    let report = evaluated(&CpuDevice, 0.2, false).report;
    let requests: Vec<_> = report.first_failures.iter().map(|failure| failure.request.clone()).collect();
    let episodes = resolved.system().unwrap().rollout(&requests).unwrap();
    assert!(requests.len() > 2);
    assert_eq!(report.failures.flagged_events, requests.len() as u64);
    for (failure, episode) in report.first_failures.iter().zip(&episodes) {
        assert_eq!(failure.robustness, episode.verdict.success);
        assert!(failure.robustness.unwrap() <= 0.0);
    }
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
        assert_eq!(format!("{whole:?}"), format!("{pieces:?}"));
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
    let Answer::ScreenedEvaluation(outcome) = answer.unwrap() else { panic!("another question") };
    assert!(!outcome.report.is_complete);
    assert_eq!((outcome.report.failures.trials, outcome.report.success_rate().value), (0, None));
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

fn falsified(
    device: &dyn WorldDevice,
    sample_rate: f64,
    batch: u32,
) -> (FalsificationOutcome, ScreenedCounts) {
    falsified_by(&screening(falsification(batch), sample_rate), device)
}

fn falsified_by(resolved: &ResolvedPlan, device: &dyn WorldDevice) -> (FalsificationOutcome, ScreenedCounts) {
    match ask(resolved, Engine::Screening(device)).unwrap() {
        Answer::Falsification(outcome, Some(counts)) => (outcome, counts),
        answer => panic!("{answer:?}"),
    }
}

fn plain_falsification() -> FalsificationOutcome {
    let folder = tempfile::tempdir().unwrap();
    let resolved = falsification(24);
    let run = mishandle::run::create_run(&resolved, Some(&folder.path().join("run.sqlite"))).unwrap();
    let outcome = mishandle::falsify(&resolved, run, |_| ControlFlow::Continue(())).unwrap();
    let falsified = outcome.falsified_trials;
    assert!(
        (1..6).contains(&falsified),
        "{falsified} of 6 trials are falsified: the test needs both outcomes"
    );
    outcome
}

/// Returns what a screening must not change.
fn evidence(trial: &TrialOutcome) -> impl PartialEq + std::fmt::Debug {
    (trial.end, trial.simulations, trial.first_violation, trial.minimum.clone())
}

#[test]
fn an_engine_with_the_bits_of_the_system_finds_the_same_counterexamples_and_minima() {
    let plain = plain_falsification();
    for batch in [1, 24, 64] {
        let (found, counts) = falsified(&CpuDevice, 0.1, batch);
        assert!(found.trials.iter().map(evidence).eq(plain.trials.iter().map(evidence)), "batch {batch}");
        let falsified = u64::from(plain.falsified_trials);
        assert_eq!((counts.violated.simulations, counts.violated.violations), (falsified, falsified));
        assert_eq!((counts.minima.violations, counts.sampled.violations), (0, 0));
        assert_eq!(found.screened, counts.not_repeated);
        // The test needs simulations of each kind.
        assert!(
            counts.minima.simulations > 3 && counts.sampled.simulations > 0 && found.screened > 20,
            "{counts:?}"
        );
        assert_eq!(found.failure_rate_bound(), None);
    }
}

#[test]
fn what_the_system_repeats_does_not_depend_on_the_batch() {
    let expected = falsified(&Wrong(false), 0.2, 24);
    let found = falsified(&Wrong(false), 0.2, 7);
    assert_eq!(found.1, expected.1);
    assert_eq!(found.0.trials, expected.0.trials);
}

#[test]
fn a_wrong_engine_cannot_falsify_a_trial_and_with_all_repeated_it_changes_nothing() {
    let plain = plain_falsification();
    for is_diverging in [false, true] {
        let (found, counts) = falsified(&Wrong(is_diverging), 1.0, 24);
        assert!(found.trials.iter().map(evidence).eq(plain.trials.iter().map(evidence)));
        assert_eq!((found.screened, counts.not_repeated), (0, 0));
        let without_verdict = counts.without_verdict.simulations;
        assert_eq!(without_verdict == found.simulations, is_diverging);
    }
    // The hand stays far from its target on this engine, so it reports violations that the system
    // refutes.
    let counts = falsified(&Wrong(false), 0.01, 24).1;
    assert!(counts.violated.simulations > counts.violated.violations, "{counts:?}");
}

#[test]
fn changed_constants_events_and_faults_have_the_counterexamples_of_the_system() {
    for space in ["starts+dynamics+events", "starts+timing+faults-sensing+faults-actuation"] {
        let plan = Plan { space: space.to_string(), ..falsification(24).plan };
        let resolved = ResolvedPlan::new(&plan).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let run = mishandle::run::create_run(&resolved, Some(&folder.path().join("run.sqlite"))).unwrap();
        let plain = mishandle::falsify(&resolved, run, |_| ControlFlow::Continue(())).unwrap();
        let (found, counts) = falsified_by(&screening(resolved, 0.1), &CpuDevice);
        assert!(found.trials.iter().map(evidence).eq(plain.trials.iter().map(evidence)), "{space}");
        assert_eq!(counts.sampled.violations, 0, "{space}");
    }
}

/// A device that is lost at its first step.
struct Lost;

struct LostWorlds(Box<dyn WorldBatch>);

impl WorldDevice for Lost {
    fn engine(&self) -> &'static str {
        "lost"
    }

    fn batch(&self, spec: &BatchSpec) -> Result<Box<dyn WorldBatch>, WorldError> {
        Ok(Box::new(LostWorlds(CpuDevice.batch(spec)?)))
    }
}

impl WorldBatch for LostWorlds {
    fn write_states(&mut self, rows: &[usize], states: &[f64]) -> Result<(), WorldError> {
        self.0.write_states(rows, states)
    }

    fn write_fields(&mut self, rows: &[usize], values: &[f64]) -> Result<(), WorldError> {
        self.0.write_fields(rows, values)
    }

    fn read_states(&mut self, states: &mut [f64]) -> Result<(), WorldError> {
        self.0.read_states(states)
    }

    fn buffers(&mut self) -> BatchBuffers<'_> {
        self.0.buffers()
    }

    fn start_step(&mut self) -> Result<(), WorldError> {
        self.0.start_step()
    }

    fn finish_step(&mut self) -> Result<(), WorldError> {
        Err(WorldError::Device("the device is lost".to_string()))
    }
}

#[test]
fn a_lost_device_ends_a_campaign_with_its_error() {
    let error = ask(&screening(falsification(24), 0.1), Engine::Screening(&Lost)).unwrap_err();
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
        let Answer::Risk(direct) = ask(&resolved, Engine::Direct).unwrap() else { panic!("a failure rate") };
        (direct.monte_carlo.failures, ask(&screening(resolved, 0.3), Engine::Screening(&CpuDevice)))
    };
    let (failures, answer) = answers(CART_POLE_FILE);
    assert!((5..95).contains(&failures), "{failures} failures: the test needs both outcomes");
    let Answer::ScreenedRisk(report) = answer.unwrap() else { panic!("a screened rate") };
    let counts = report.counts;
    assert_eq!((counts.trials, counts.flagged, counts.flagged_events), (100, failures, failures));
    assert!(counts.sampled > 0);
    assert_eq!(counts.sampled_events, 0);
    let peak = CART_POLE_FILE
        .replace("\"abs(qpos('hinge'))[0]\"", "{ value = \"abs(qpos('hinge'))[0]\", over = \"max\" }");
    let error = answers(&peak).1.unwrap_err().to_string();
    assert!(error.contains("cart-pole.toml, line 9: the signal `angle` has `over`"), "{error}");
}
