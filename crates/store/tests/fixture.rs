//! A run file that was written when its format was new can be read. The expected values are written
//! by hand; `examples/write_fixture.rs` wrote the file.

use mishandle_store::{
    ComponentRecord, Counts, FormulaRecord, RunFile, RunKind, SignalRecord, Simulation, SimulationEnd,
    TargetRecord, TrialStatus,
};

fn target(kind: &str, hash: &str, is_deterministic: bool) -> TargetRecord {
    TargetRecord { kind: kind.into(), name: "ball-catching".into(), hash: hash.into(), is_deterministic }
}

fn component(role: &str, name: &str, hash: &str, file_hash: &str) -> ComponentRecord {
    ComponentRecord { role: role.into(), name: name.into(), hash: hash.into(), file_hash: file_hash.into() }
}

fn signal(name: &str, unit: &str) -> SignalRecord {
    SignalRecord { name: name.into(), unit: unit.into() }
}

fn formula(name: &str, text: &str) -> FormulaRecord {
    FormulaRecord { name: name.into(), text: text.into() }
}

#[track_caller]
fn check_trials(run: &RunFile) {
    let trials: Vec<_> = run.trials().unwrap().iter().map(|summary| summary.trial).collect();
    let statuses: Vec<_> = trials.iter().map(|trial| (trial.number, trial.status)).collect();
    assert_eq!(
        statuses,
        [
            (1, TrialStatus::Running),
            (2, TrialStatus::Falsified),
            (3, TrialStatus::BudgetSpent),
            (4, TrialStatus::Converged)
        ]
    );
    assert_eq!(trials[0].seed, 18_446_744_073_709_551_614);
}

#[track_caller]
fn check_traces(run: &RunFile) {
    assert_eq!(run.stored_traces().unwrap(), [(2, 2)]);
    let columns = run.simulation(2, 2).unwrap().trace.unwrap().columns;
    assert_eq!((columns[0].len(), columns[1].len()), (301, 301));
    assert_eq!((columns[0][0], columns[0][300], columns[1][2]), (0.0, 30.0, 7.5));
    assert!(columns[1][3].is_nan());
    assert_eq!((columns[1][4], columns[1][5].to_bits()), (f64::NEG_INFINITY, 1 << 63));
}

#[track_caller]
fn check_header(run: &RunFile) {
    let header = run.header();
    assert_eq!(header.kind, RunKind::Evaluate);
    assert_eq!(header.build.program_version, "0.1.0");
    assert_eq!(header.build.git_commit, "51c0ab8");
    assert_eq!(header.build.target, "x86_64-unknown-linux-gnu");
    assert_eq!(header.build.rustc, "1.95.0");
    assert_eq!(header.build.architecture, "x86-64-v3");
    let versions: Vec<_> = header.versions.iter().map(|(name, version)| (&name[..], &version[..])).collect();
    assert_eq!(versions, [("MuJoCo", "3.17.0"), ("Python", "3.11.2")]);
    assert_eq!(header.plan, "task = \"ball-catching\"\n# \u{3c1} \u{2265} 0\n");
    assert_eq!(header.target, target("python", "t0", false));
    let [controller, filter] =
        [component("controller", "expert", "c0", "c1"), component("filter", "none", "", "")];
    assert_eq!(header.components, [controller, filter]);
    assert_eq!(header.space, "everything");
    assert_eq!(header.formula, "always[50:300](ball_box_horizontal_distance <= 0.1)");
    assert_eq!(header.formulas, [formula("success", "linear <= 0.1"), formula("safe", "linear < 0.2")]);
    assert_eq!(header.search, "random");
    assert_eq!(header.seed, 9_223_372_036_854_775_808);
    assert_eq!(header.control_dt, 0.25);
    assert_eq!(header.episode_steps, 150);
    assert_eq!(header.signals, [signal("linear", "m"), signal("strange", "")]);
    let [first, second] = &header.axes[..] else { panic!("two axes") };
    assert_eq!((&first.name[..], &first.unit[..], &first.kind[..]), ("ball_x", "m", "start"));
    assert_eq!((first.low, first.high), (-0.5, 1.25));
    assert_eq!(first.nominal.map(f64::to_bits), Some(1 << 63)); // -0.0
    assert_eq!((&first.values[..], &first.meaning[..]), ("continuous", "where the ball starts"));
    assert_eq!((&second.name[..], &second.unit[..], &second.kind[..]), ("say \"\u{3c1}\"", "", "noise"));
    assert_eq!((second.low, second.high, second.nominal), (2.0, 3.0, None));
    assert_eq!((&second.values[..], &second.meaning[..]), ("integer", ""));
    assert_eq!(header.verdicts, ["strict_robustness", "return"]);
}

/// Checks simulations 1 to 9 of trial 1, and trial 2.
#[track_caller]
fn check_simulations(simulations: &[Simulation]) {
    let simulations: Vec<_> = simulations.iter().filter(|s| s.number <= 9).collect();
    let ends: Vec<_> = simulations.iter().map(|s| (s.trial, s.number, s.end)).collect();
    assert_eq!(
        ends,
        [
            (1, 1, SimulationEnd::Completed),
            (1, 2, SimulationEnd::Diverged { step: 12 }),
            (1, 3, SimulationEnd::Stopped { step: 34 }),
            (1, 4, SimulationEnd::Terminated { step: 56 }),
            (1, 5, SimulationEnd::Undefined { step: 0 }),
            (1, 6, SimulationEnd::InvalidAction { step: 7, index: 3 }),
            (1, 7, SimulationEnd::InvalidScenario),
            (1, 8, SimulationEnd::Crashed { step: 8 }),
            (1, 9, SimulationEnd::TimedOut { step: 9 }),
            (2, 1, SimulationEnd::Completed),
            (2, 2, SimulationEnd::Completed),
        ]
    );
    let robustness: Vec<_> = simulations
        .iter()
        .map(|s| {
            [s.robustness_low, s.robustness, s.robustness_high, s.stop_threshold].map(|x| x.map(f64::to_bits))
        })
        .collect();
    let whole = |bits| [Some(bits), Some(bits), Some(bits), None];
    let infinity = 0x7ff0_0000_0000_0000;
    let minus_infinity = 0xfff0_0000_0000_0000;
    let minus_zero = 0x8000_0000_0000_0000;
    let minus_quarter = 0xbfd0_0000_0000_0000;
    assert_eq!(robustness[0], whole(0x3fd3_3333_3333_3334)); // 0.1 + 0.2, not 0.3
    assert_eq!(robustness[1], [None; 4]);
    assert_eq!(
        robustness[2],
        [Some(minus_infinity), Some(minus_quarter), Some(minus_quarter), Some(minus_zero)]
    );
    assert_eq!(robustness[3], whole(infinity));
    assert_eq!(robustness[4..9], [[None; 4]; 5]);
    assert_eq!(robustness[9..], [whole(minus_zero), whole(minus_infinity)]);

    let second = &simulations[1];
    assert_eq!((second.seed, second.steps), (18_446_744_073_709_551_613, 150));
    assert_eq!(second.unit_point, [0.25, 0.75]);
    assert_eq!(second.scenario[0], Some(2.0 / 3.0));
    assert_eq!(second.scenario[1].map(f64::to_bits), Some(1 << 63));
    assert_eq!(second.verdicts, [None, Some(0.2)]);
    assert_eq!((second.trace_digest, &second.trace), (None, &None));
    assert_eq!((&simulations[6].unit_point[..], &simulations[6].scenario[..]), (&[][..], &[None, None][..]));
}

#[test]
fn a_file_of_this_version_can_be_read() {
    let run = RunFile::open("tests/fixtures/v5.sqlite").unwrap();
    run.check().unwrap();
    check_header(&run);
    check_trials(&run);
    let counts = Counts { simulations: 14, falsified: 3, undecided: 9, diverged: 1, invalid: 4 };
    assert_eq!(run.counts().unwrap(), counts);
    let simulations: Vec<_> = run.simulations().map(Result::unwrap).collect();
    check_simulations(&simulations);
    let ends: Vec<_> = simulations[9..12].iter().map(|s| (s.number, s.end)).collect();
    assert_eq!(
        ends,
        [
            (10, SimulationEnd::InvalidObservation { step: 0, index: 5 }),
            (11, SimulationEnd::InvalidReward { step: 11, index: 1 }),
            (12, SimulationEnd::InvalidSignal { step: 12, index: u32::MAX }),
        ]
    );
    check_traces(&run);
}
