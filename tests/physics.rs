//! Counterexamples that depend on the solver of the physics: they are labeled and refused, and
//! minimal ones go back.

use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;

use mishandle::counterexample::{Chosen, Counterexample, Preparation, export};
use mishandle::falsification::FalsificationError;
use mishandle::inspect::{FailureMode, FurtherPart, MinimalFailure, further};
use mishandle::plan::{FalsifyPlan, ReportSettings};
use mishandle::results::{Answer, Cause, Falsification, PhysicsCheck, SolverChange as Change, Trial};
use mishandle::rollout::{
    Episode, Request, RolloutError, SolverChange, SolverVariant, Space, Specification, System,
};
use mishandle::run::{Engine, create_run};
use mishandle::store::RunFile;
use mishandle::{MishandleError, Plan, ResolvedPlan};

/// A system under a change that adds to the robustness.
struct Shifted(Box<dyn System>, f64);

impl System for Shifted {
    fn space(&self) -> &Space {
        self.0.space()
    }

    fn rollout(&mut self, requests: &[Request]) -> Result<Vec<Episode>, RolloutError> {
        let mut episodes = self.0.rollout(requests)?;
        for episode in &mut episodes {
            episode.verdict.robustness = episode.verdict.robustness.map(|rho| rho + self.1);
        }
        Ok(episodes)
    }
}

/// A toy that fails within 0.1 m of a point, and 0.1 m - `shift` with the other collider.
fn toy(search: &str, shift: f64) -> ResolvedPlan {
    let falsify = FalsifyPlan {
        search: search.to_string(),
        trials: 12,
        budget: 2000,
        isolate: Some(true),
        ..FalsifyPlan::default()
    };
    let plan = Plan { falsify: Some(falsify), seed: 3, ..Plan::new("toy/sphere-2d", "") };
    let mut target = mishandle::resolve::target(&plan).unwrap();
    let factory = target.factory.clone();
    target.solver_variants = SolverVariant::all(|change| {
        let factory = factory.clone();
        let shift = if change == SolverChange::OtherCollider { shift } else { 0.0 };
        Arc::new(move |space: &Space, specification: &Specification| {
            Ok(Box::new(Shifted(factory(space, specification)?, shift)) as Box<dyn System>)
        })
    });
    ResolvedPlan::with_target(&plan, target).unwrap()
}

/// Falsifies, and returns the answer and the numbers of announced and of made simulations.
fn falsify(resolved: &ResolvedPlan, path: &Path) -> (Falsification, [u64; 2]) {
    let run = create_run(resolved, Some(path)).unwrap();
    let mut answer =
        mishandle::run::ask(resolved, run, Engine::Direct, &mut |_| ControlFlow::Continue(())).unwrap();
    let mut simulations = [0; 2];
    further(resolved, &mut answer, &ReportSettings::default(), |part, done, most| {
        if part == FurtherPart::Physics {
            assert!(done > 0 || simulations == [0, 0], "announced before the first simulation");
            simulations = [most, done];
        }
        ControlFlow::Continue(())
    })
    .unwrap();
    (answer.try_into().unwrap(), simulations)
}

fn depends(check: &PhysicsCheck) -> bool {
    check.depends_on_solver
}

fn checked(trial: &Trial) -> (&PhysicsCheck, &Cause) {
    (trial.physics.as_ref().unwrap(), trial.cause.as_ref().unwrap())
}

#[test]
fn counterexamples_whose_violation_vanishes_are_labeled_and_minimal_ones_go_back() {
    const SHIFT: f64 = 0.05;
    let folder = tempfile::tempdir().unwrap();
    let resolved = toy("random", SHIFT);
    let (found, [most, made]) = falsify(&resolved, &folder.path().join("run.sqlite"));
    assert!(made > 0 && made <= most, "{made} of {most}");
    let falsified: Vec<&Trial> = found.trials.iter().filter(|trial| trial.falsified).collect();
    let labels: Vec<bool> = falsified.iter().map(|trial| depends(checked(trial).0)).collect();
    assert!(labels.contains(&true) && labels.contains(&false), "both labels are needed: {labels:?}");
    for trial in falsified {
        let (check, cause) = checked(trial);
        let robustness = trial.minimum_robustness.unwrap().0;
        assert_eq!(depends(check), robustness + SHIFT >= 0.0);
        let changes: Vec<Change> = check.simulations.iter().map(|simulation| simulation.change).collect();
        assert_eq!(changes, Change::ALL);
        for simulation in &check.simulations {
            let shift = if simulation.change == Change::OtherCollider { SHIFT } else { 0.0 };
            assert_eq!(simulation.robustness.unwrap().0, robustness + shift);
        }
        // The minimal failure is at the border of the disc, where the violation vanishes.
        let minimal = cause.physics.as_ref().unwrap();
        assert_eq!(depends(minimal), depends(check), "the minimal one survives if the found one does");
        assert_eq!(depends(minimal), cause.robustness.0 + SHIFT >= 0.0);
        if depends(check) {
            assert!(!cause.went_back);
        } else if cause.went_back {
            assert!(cause.checked.iter().any(|nearer| depends(&nearer.physics)));
        }
    }
    let went_back = |trial: &Trial| trial.cause.as_ref().is_some_and(|cause| cause.went_back);
    assert!(found.trials.iter().any(went_back), "the test needs one that goes back");
}

/// Returns an answer without its checks and the path of its run.
fn without_checks(found: &Falsification) -> serde_json::Value {
    let mut found = found.clone();
    found.run = None;
    for trial in &mut found.trials {
        trial.physics = None;
        trial.cause = None;
    }
    serde_json::to_value(Answer::Falsification(Box::new(found))).unwrap()
}

#[test]
fn checks_change_no_row_and_no_rate() {
    let folder = tempfile::tempdir().unwrap();
    let [plain, checked] = ["plain", "checked"].map(|name| folder.path().join(format!("{name}.sqlite")));
    let mut unchecked = toy("nelder-mead", 0.0);
    unchecked.target.solver_variants.clear();
    let (expected, simulations) = falsify(&unchecked, &plain);
    assert_eq!(simulations, [0, 0], "a target without variants has no checks");
    assert!(expected.trials.iter().all(|trial| trial.physics.is_none()));
    let (found, _) = falsify(&toy("nelder-mead", 0.05), &checked);
    assert_eq!(without_checks(&found), without_checks(&expected));
    assert!(Answer::Falsification(Box::new(found)).is_violated());
    let digest = |path: &Path| RunFile::open(path).unwrap().content_digest().unwrap();
    assert_eq!(digest(&plain), digest(&checked));
}

#[test]
fn a_counterexample_that_depends_on_the_solver_is_refused_and_a_minimized_one_survives() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.sqlite");
    let resolved = toy("random", 0.05);
    let (found, _) = falsify(&resolved, &path);
    let run = RunFile::open(&path).unwrap();
    let mut labels = Vec::new();
    let mut all = Vec::new();
    for trial in found.trials.iter().filter(|trial| trial.falsified) {
        let chosen = || {
            let simulation = trial.first_violation.unwrap();
            vec![Chosen { path: "a.json".into(), mode: None, trial: trial.trial, simulation }]
        };
        let depends = depends(checked(trial).0);
        labels.push(depends);
        all.extend(chosen());
        for minimize in [None, Some(100)] {
            let preparation = Preparation { resolved: &resolved, minimize };
            let exported = export(&run, chosen(), Some(preparation), |_| ControlFlow::Continue(()));
            match exported {
                Err(MishandleError::Falsification(FalsificationError::DependsOnSolver {
                    trial: named,
                    check,
                    ..
                })) => {
                    assert!(depends && named == trial.trial && check.depends_on_solver);
                }
                Err(error) => panic!("{error}"),
                Ok(exported) => {
                    assert!(!depends);
                    let [(_, written)] = &exported.files[..] else { panic!("one file") };
                    let check = written.physics.as_ref().unwrap();
                    assert!(!check.depends_on_solver && written.expected.robustness < -0.05);
                    // The file says so, and a replay makes the same check.
                    let read = Counterexample::from_json(&written.to_json()).unwrap();
                    assert_eq!(read.physics, written.physics);
                    assert!(read.replay(&resolved).unwrap().differences.is_empty());
                    let mut other = read;
                    other.physics = Some(PhysicsCheck::new(check.simulations[1..].to_vec()));
                    assert!(!other.replay(&resolved).unwrap().differences.is_empty());
                    if minimize.is_some() {
                        let minimized = exported.result.files[0].minimized.as_ref().unwrap();
                        assert!(!minimized.checked.is_empty());
                    }
                }
            }
        }
    }
    assert!(labels.contains(&true) && labels.contains(&false), "{labels:?}");
    // Of several, those that depend on the solver are left out.
    let preparation = Preparation { resolved: &resolved, minimize: None };
    let exported = export(&run, all, Some(preparation), |_| ControlFlow::Continue(())).unwrap();
    let left_out: Vec<bool> = exported.result.files.iter().map(|file| file.file.is_none()).collect();
    assert_eq!(left_out, labels);
}

#[test]
fn whoever_reads_the_run_names_the_cause_of_the_search_without_a_simulation() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.sqlite");
    let resolved = toy("random", 0.05);
    let (found, [_, made]) = falsify(&resolved, &path);
    assert!(made > 0 && found.trials.iter().any(|trial| trial.cause.as_ref().unwrap().went_back));
    let json = |found: &Falsification| serde_json::to_value(found).unwrap();
    let run = RunFile::open(&path).unwrap();
    let read: Falsification = mishandle::run::recorded_answer(&run, None).unwrap().try_into().unwrap();
    assert_eq!(json(&read), json(&found));
    // The failures are grouped by the same causes.
    let modes = mishandle::inspect::failure_modes(&run).unwrap();
    let causes: Vec<(u32, u32)> = modes
        .modes
        .iter()
        .map(FailureMode::representative)
        .filter_map(|failure| failure.cause.as_ref().map(|cause| cause.minimal))
        .collect();
    for trial in found.trials.iter().filter(|trial| trial.falsified) {
        let minimal = MinimalFailure::recorded(&run, trial.trial).unwrap().unwrap();
        assert_eq!(Some(&minimal.cause), trial.cause.as_ref());
        let row = &minimal.explained.recorded;
        let is_of_mode = causes.contains(&(row.trial, row.number));
        assert!(is_of_mode || causes.iter().all(|(other, _)| *other != row.trial));
    }
    drop(run);
    // Nothing is simulated twice, and the run stays as it is.
    let bytes = std::fs::read(&path).unwrap();
    let mut answer = Answer::Falsification(Box::new(read));
    let watch = |part, done, _| panic!("{part:?} {done}");
    further(&resolved, &mut answer, &ReportSettings::default(), watch).unwrap();
    assert_eq!(std::fs::read(&path).unwrap(), bytes);
}
