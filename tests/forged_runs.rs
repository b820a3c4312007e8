//! A run file whose rows were changed and whose hashes were computed again is reported, with the
//! name of what differs.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use mishandle::plan::{EvaluatePlan, FalsifyPlan};
use mishandle::run::{Engine, ask};
use mishandle::store::{
    IfExists, RunFile, RunHeader, RunKind, RunWriter, Simulation, SimulationEnd, TrialRecord, TrialStatus,
};
use mishandle::{Compared, MishandleError, Plan, ResolvedPlan, RunError};
use tempfile::TempDir;

/// Everything in a run file.
struct Content {
    header: RunHeader,
    trials: Vec<TrialRecord>,
    simulations: Vec<Simulation>,
}

impl Content {
    fn read(path: &Path) -> Content {
        let run = RunFile::open(path).unwrap();
        let simulations = run.simulations().map(|simulation| {
            let Simulation { trial, number, .. } = simulation.unwrap();
            run.simulation(trial, number).unwrap()
        });
        Content {
            header: run.header().clone(),
            trials: run.trials().unwrap().iter().map(|summary| summary.trial).collect(),
            simulations: simulations.collect(),
        }
    }

    /// Writes a run file with valid hashes.
    fn write(&self, path: &Path) {
        let mut writer = RunWriter::create(path, &self.header, IfExists::Replace).unwrap();
        for trial in &self.trials {
            writer.start_trial(trial.number, trial.seed).unwrap();
            writer.end_trial(trial.number, trial.status).unwrap();
        }
        writer.record(&self.simulations).unwrap();
        writer.close().unwrap();
    }

    /// The first counterexample; without one, the second simulation.
    fn chosen(&mut self) -> &mut Simulation {
        let is_falsified = |simulation: &Simulation| simulation.is_violated();
        let index = self.simulations.iter().position(is_falsified).unwrap_or(1);
        &mut self.simulations[index]
    }
}

type Change = fn(&mut Content);

struct Bench {
    folder: TempDir,
    resolved: ResolvedPlan,
}

impl Bench {
    fn falsification() -> Bench {
        let falsify = FalsifyPlan {
            search: "nelder-mead".to_string(),
            formula: Some("always(gap >= 20)".to_string()),
            trials: 3,
            budget: 40,
            ..FalsifyPlan::default()
        };
        let bench = Bench::new(&Plan { falsify: Some(falsify), ..Plan::new("toy/car-following", "") });
        let run = mishandle::run::create_run(&bench.resolved, Some(&bench.honest())).unwrap();
        let answer = ask(&bench.resolved, run, Engine::Direct, &mut |_| ControlFlow::Continue(())).unwrap();
        assert!(answer.is_violated() && answer.simulations() > 3, "{answer:?}");
        bench
    }

    fn evaluation() -> Bench {
        let evaluate = EvaluatePlan { episodes: 5, ..EvaluatePlan::default() };
        let bench = Bench::new(&Plan { evaluate: Some(evaluate), ..Plan::new("toy/car-following", "") });
        let run = mishandle::run::create_run(&bench.resolved, Some(&bench.honest())).unwrap();
        ask(&bench.resolved, run, Engine::Direct, &mut |_| ControlFlow::Continue(())).unwrap();
        bench
    }

    fn new(plan: &Plan) -> Bench {
        Bench { folder: tempfile::tempdir().unwrap(), resolved: ResolvedPlan::new(plan).unwrap() }
    }

    fn honest(&self) -> PathBuf {
        self.folder.path().join("honest.sqlite")
    }

    /// Writes a forged copy, and returns its path and the chosen simulation before the change.
    fn forge(&self, change: Change) -> (PathBuf, (u32, u32)) {
        let path = self.folder.path().join("forged.sqlite");
        let mut content = Content::read(&self.honest());
        let chosen = (content.chosen().trial, content.chosen().number);
        change(&mut content);
        content.write(&path);
        (path, chosen)
    }

    /// Replays the chosen simulation of a forged copy.
    fn replay(&self, change: Change) -> Vec<String> {
        let (path, (trial, number)) = self.forge(change);
        match mishandle::replay::replay(&RunFile::open(path).unwrap(), trial, number, None) {
            Ok(replayed) => replayed.differences,
            Err(MishandleError::Run(RunError::Differs { whose: Compared::Plan, differences })) => differences,
            Err(error) => panic!("{error}"),
        }
    }

    #[track_caller]
    fn check_replay(&self, changes: &[(&str, Change)]) {
        assert_eq!(self.replay(|_| ()), Vec::<String>::new());
        for (expected, change) in changes {
            let found = self.replay(*change);
            assert!(found.iter().any(|difference| difference.contains(expected)), "{expected}: {found:?}");
        }
    }

    fn resume(&self, change: Change) -> Result<(), String> {
        let (path, _) = self.forge(change);
        let run = RunWriter::resume(path).unwrap();
        let resumed = ask(&self.resolved, run, Engine::Direct, &mut |_| ControlFlow::Continue(()));
        resumed.map(drop).map_err(|error| error.to_string())
    }

    #[track_caller]
    fn check_resume(&self, changes: &[(&str, Change)]) {
        self.resume(|_| ()).unwrap();
        for (expected, change) in changes {
            let error = self.resume(*change).expect_err(expected);
            assert!(error.contains(expected), "{expected}: {error}");
        }
    }
}

/// Changes of the header that a replay and a resumption report.
const HEADER: &[(&str, Change)] = &[
    ("kind of run: recorded", |run| {
        run.header.kind = match run.header.kind {
            RunKind::Falsify => RunKind::Evaluate,
            _ => RunKind::Falsify,
        };
    }),
    ("kind of target: recorded \"task\", expected \"toy\"", |run| run.header.target.kind = "task".into()),
    ("target: recorded \"toy/needle\"", |run| run.header.target.name = "toy/needle".into()),
    ("determinism: recorded false", |run| run.header.target.is_deterministic = false),
    ("space: recorded \"everything\"", |run| run.header.space = "everything".into()),
    ("formula: recorded \"always(gap >= 0)\"", |run| run.header.formula = "always(gap >= 0)".into()),
    ("named formula 1: recorded", |run| run.header.formulas[0].text = "always(gap >= 0)".into()),
    ("list `named formula`: recorded 2", |run| drop(run.header.formulas.pop())),
    ("search: recorded \"simplex\"", |run| run.header.search = "simplex".into()),
    ("seed: recorded 5, expected 0", |run| run.header.seed = 5),
    ("control period in seconds: recorded 2.0", |run| run.header.control_dt = 2.0),
    ("number of control steps: recorded 1,", |run| run.header.episode_steps = 1),
    ("signal 1: recorded \"distance\"", |run| run.header.signals[0].name = "distance".into()),
    ("unit of signal 1: recorded \"ft\"", |run| run.header.signals[0].unit = "ft".into()),
    ("axis 1: recorded", |run| run.header.axes[0].high += 1e-9),
    ("axis 1: recorded", |run| run.header.axes[0].meaning = "a safe distance".into()),
    ("hash of the target: recorded \"forged\"", |run| run.header.target.hash = "forged".into()),
    ("hash of the target: recorded \"\"", |run| run.header.target.hash.clear()),
    ("verdict 1: recorded \"failure\"", |run| run.header.verdicts[0] = "failure".into()),
];

/// Changes after which a simulation contradicts itself or its target.
const IMPOSSIBLE: &[(&str, Change)] = &[
    ("its end allows no verdict, but it has one", |run| {
        run.chosen().end = SimulationEnd::Diverged { step: 1 };
    }),
    ("it completed, but with another number", |run| run.chosen().steps = 0),
    ("it ended after another control step than it took", |run| {
        run.chosen().end = SimulationEnd::Stopped { step: 1 };
    }),
    ("the bounds of its robustness differ", |run| run.chosen().robustness_high = Some(9.0)),
    ("which its target does not have", |run| run.chosen().end = SimulationEnd::TimedOut { step: 1 }),
    ("`steps` of simulation", |run| run.chosen().steps = 1_000_000),
    ("`end_step` of simulation", |run| run.chosen().end = SimulationEnd::Stopped { step: 1_000_000 }),
    ("`dangerous_steps` of simulation", |run| run.chosen().verdicts[2] = Some(-1.0)),
    ("`dangerous_steps` of simulation", |run| run.chosen().verdicts[2] = Some(1e9)),
    ("`completion_step` of simulation", |run| run.chosen().verdicts[3] = Some(0.5)),
];

#[test]
fn a_replay_names_every_forged_value_of_a_counterexample() {
    let bench = Bench::falsification();
    bench.check_replay(HEADER);
    bench.check_replay(&[
        ("formula: recorded", |run| run.header.plan = run.header.plan.replace("gap >= 20", "gap >= 19")),
        ("seed of simulation", |run| run.chosen().seed += 1),
        ("unit point of simulation", |run| run.chosen().unit_point[0] += 1e-12),
        ("scenario of simulation", |run| {
            let value = run.chosen().scenario[0].as_mut().unwrap();
            *value = value.next_down();
        }),
        ("scenario of simulation", |run| run.chosen().scenario[0] = Some(1e9)),
        ("robustness: recorded -1.0", |run| run.chosen().robustness = Some(-1.0)),
        ("lower bound of the robustness: recorded none", |run| run.chosen().robustness_low = None),
        ("upper bound of the robustness: recorded 9.0", |run| run.chosen().robustness_high = Some(9.0)),
        ("stop threshold of simulation", |run| run.chosen().stop_threshold = Some(0.0)),
        ("end: recorded stopped, step 1", |run| run.chosen().end = SimulationEnd::Stopped { step: 1 }),
        ("number of control steps: recorded 1,", |run| run.chosen().steps = 1),
        ("verdict `success`: recorded 9.0", |run| run.chosen().verdicts[0] = Some(9.0)),
        ("verdict `strict`: recorded none", |run| run.chosen().verdicts[1] = None),
        ("verdict `dangerous_steps`: recorded 7.0", |run| run.chosen().verdicts[2] = Some(7.0)),
        ("verdict `completion_step`: recorded 3.0", |run| run.chosen().verdicts[3] = Some(3.0)),
        ("verdict `total_reward`: recorded -0.0", |run| run.chosen().verdicts[4] = Some(-0.0)),
        ("verdict `careful`: recorded 7.0", |run| run.chosen().verdicts[5] = Some(7.0)),
        ("digest of the trace: recorded", |run| {
            let simulation = run.chosen();
            simulation.trace.as_mut().unwrap().columns[0][0] += 1.0;
            simulation.trace_digest = None;
        }),
        ("whether the trace is stored: recorded false", |run| run.chosen().trace = None),
        ("rows are missing", |run| {
            let trial = run.chosen().trial;
            run.simulations.retain(|simulation| (simulation.trial, simulation.number) != (trial, 1));
        }),
        ("seed of trial", |run| run.trials.iter_mut().for_each(|trial| trial.seed += 1)),
        ("status of trial", |run| {
            run.trials.iter_mut().for_each(|trial| trial.status = TrialStatus::Converged);
        }),
        ("trial 4: the plan has no trial of this number", |run| {
            run.trials.push(TrialRecord { number: 4, seed: 0, status: TrialStatus::Running });
        }),
    ]);
}

#[test]
fn a_counterexample_that_the_search_did_not_find_is_reported() {
    let bench = Bench::falsification();
    // The forger simulates a worse scenario honestly and stores it in place of the recorded one.
    let found = bench.replay(|run| {
        let chosen = run.chosen();
        let number = chosen.number;
        let other = Simulation { number, ..chosen.clone() };
        let scenario = other.scenario.iter().map(|value| value.map(|value| value * 0.999)).collect();
        *chosen = Simulation { scenario, ..other };
    });
    assert!(found.iter().any(|difference| difference.contains("scenario of simulation")), "{found:?}");
    // The trial continues after its counterexample.
    let found = bench.replay(|run| {
        let last = run.chosen().clone();
        run.simulations.push(Simulation { number: last.number + 1, ..last });
    });
    assert!(found.iter().any(|difference| difference.contains("the trial ended before it")), "{found:?}");
}

#[test]
fn a_replay_names_every_forged_value_of_an_evaluation() {
    let bench = Bench::evaluation();
    bench.check_replay(HEADER);
    bench.check_replay(&[
        ("seed of simulation 2 of trial 1: recorded 1,", |run| run.chosen().seed = 1),
        ("unit point of simulation 2", |run| run.chosen().unit_point = vec![0.5; run.header.axes.len()]),
        ("scenario of simulation 2", |run| {
            let value = run.chosen().scenario[0].as_mut().unwrap();
            *value = value.next_down();
        }),
        ("verdict `success`: recorded", |run| run.chosen().verdicts[0] = Some(9.0)),
        ("seed of trial 1: recorded 9, expected 0", |run| run.trials[0].seed = 9),
        ("status of trial 1: recorded Falsified", |run| run.trials[0].status = TrialStatus::Falsified),
        ("recorded as complete, but it has 4 of 5", |run| {
            run.simulations.retain(|simulation| (simulation.trial, simulation.number) != (1, 5));
        }),
        ("trial 1: its last simulation has the number 5, but it has 4 simulations", |run| {
            run.simulations.retain(|simulation| (simulation.trial, simulation.number) != (1, 4));
        }),
        ("trial 3: the plan has no such trial", |run| {
            run.trials.push(TrialRecord { number: 3, seed: 0, status: TrialStatus::Running });
        }),
        ("trial 1: it has 6 simulations, but the plan has 5 simulations", |run| {
            let added = Simulation { number: 6, ..run.chosen().clone() };
            run.simulations.push(added);
        }),
    ]);
}

#[test]
fn a_forged_falsification_is_not_resumed() {
    let bench = Bench::falsification();
    bench.check_resume(HEADER);
    bench.check_resume(IMPOSSIBLE);
    bench.check_resume(&[
        ("simulation", |run| run.chosen().seed += 1),
        ("simulation", |run| run.chosen().unit_point[0] += 1e-12),
        ("simulation", |run| run.simulations.remove(0).seed += 1),
        ("seed of trial 1", |run| run.trials[0].seed += 1),
        ("status of trial", |run| {
            let chosen = run.chosen();
            let better = Some(1.0);
            (chosen.robustness, chosen.robustness_low, chosen.robustness_high) = (better, better, better);
        }),
        ("status of trial 1: recorded Converged, expected BudgetSpent", |run| {
            run.trials[0].status = TrialStatus::Converged;
        }),
    ]);
}

#[test]
fn a_forged_falsification_lacks_what_its_search_asks() {
    let bench = Bench::falsification();
    let missing = |change: Change| {
        let (path, _) = bench.forge(change);
        mishandle::run::missing(&RunFile::open(path).unwrap(), &bench.resolved).unwrap()
    };
    assert_eq!(missing(|_| ()), None);
    assert!(missing(|run| run.chosen().seed += 1).unwrap().contains("simulation"));
    // A search that is said to have ended, but has further simulations.
    let cut = missing(|run| {
        run.simulations.retain(|simulation| simulation.trial != 1 || simulation.number <= 10);
        run.trials[0].status = TrialStatus::Converged;
    });
    assert!(cut.unwrap().contains("status of trial 1"));
}

#[test]
fn a_forged_evaluation_is_not_resumed() {
    let bench = Bench::evaluation();
    bench.check_resume(HEADER);
    bench.check_resume(IMPOSSIBLE);
    bench.check_resume(&[
        ("simulation 2", |run| run.chosen().seed += 1),
        ("simulation 2", |run| run.chosen().unit_point = vec![0.5; run.header.axes.len()]),
        ("simulation 2", |run| run.chosen().scenario[0] = Some(0.0)),
        ("seed of trial 1", |run| run.trials[0].seed += 1),
        ("status of trial 1", |run| run.trials[0].status = TrialStatus::Converged),
        ("recorded as complete, but it has 4 of 5", |run| {
            run.simulations.retain(|simulation| (simulation.trial, simulation.number) != (1, 5));
        }),
        ("trial 3: the plan has no such trial", |run| {
            run.trials.push(TrialRecord { number: 3, seed: 0, status: TrialStatus::Running });
        }),
    ]);
}

#[test]
fn a_run_of_a_target_in_python_is_not_taken_for_a_misspelled_name() {
    let bench = Bench::evaluation();
    let mut header = RunFile::open(bench.honest()).unwrap().header().clone();
    header.plan = header.plan.replace("toy/car-following", "python/point-reaching");
    let error = mishandle::resolve::recorded_plan(&header, None).unwrap_err();
    assert!(error.to_string().contains("resumed by the Python package"), "{error}");
    assert_eq!(error.remedies(), []);
}
