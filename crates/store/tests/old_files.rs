//! Every run file ever released still reads. The values are stated here by hand; how the files were made says
//! `examples/write_fixture.rs`.
#![allow(clippy::unwrap_used)] // what serves tests is a test

use mishandle_store::{Axis, Counts, End, RunFile, RunKind, TrialStatus};

#[test]
fn version_1() {
    // A copy, since opening an older file upgrades it.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("v1.sqlite");
    std::fs::copy("tests/fixtures/v1.sqlite", &path).unwrap();
    let run = RunFile::open(path).unwrap();
    run.check().unwrap();

    let header = run.header();
    assert_eq!(header.kind, RunKind::Evaluate);
    assert_eq!(header.build.program_version, "0.1.0");
    assert_eq!(header.build.git_commit, "63b21f9");
    assert_eq!(header.build.target, "x86_64-unknown-linux-gnu");
    assert_eq!(header.build.rustc, "1.95.0");
    assert_eq!(header.build.mujoco_version, "3.17.0");
    assert_eq!(header.build.architecture, "x86-64-v3");
    assert_eq!(header.plan, "task = \"ball-catching\"\n# \u{3c1} \u{2265} 0\n");
    assert_eq!(header.controller, "expert");
    assert_eq!(header.controller_hash, "c0");
    assert_eq!(header.controller_bytes_hash, "c1");
    assert_eq!(header.task, "ball-catching");
    assert_eq!(header.preset, "code");
    assert_eq!(header.formula, "always[50:300](ball_box_horizontal_distance <= 0.1)");
    assert_eq!(header.search, "random");
    assert_eq!(header.seed, 9_223_372_036_854_775_808);
    assert_eq!(header.control_dt, 0.25);
    assert_eq!(header.signals, ["linear", "strange"]);
    assert_eq!(header.axes[0], Axis { name: "ball_x".into(), unit: "m".into(), low: -0.5, high: 1.25 });
    assert_eq!(
        header.axes[1],
        Axis { name: "ball_velocity_z".into(), unit: "m/s".into(), low: 2.0, high: 3.0 }
    );
    assert_eq!(header.verdicts, ["strict_robustness", "return"]);

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
    assert_eq!(run.counts().unwrap(), Counts { simulations: 5, falsified: 1, undecided: 1, diverged: 1 });

    let simulations: Vec<_> = run.simulations().map(Result::unwrap).collect();
    let outcomes: Vec<_> =
        simulations.iter().map(|s| (s.trial, s.number, s.robustness.map(f64::to_bits), s.end)).collect();
    assert_eq!(
        outcomes,
        [
            (1, 1, Some(0x3fd3_3333_3333_3334), End::Horizon), // 0.1 + 0.2, not 0.3
            (1, 2, None, End::Diverged { step: 12 }),
            (1, 3, Some(0x7ff0_0000_0000_0000), End::Stopped { step: 34 }), // +inf
            (2, 1, Some(0x8000_0000_0000_0000), End::Horizon),              // -0.0
            (2, 2, Some(0xfff0_0000_0000_0000), End::Horizon),              // -inf
        ]
    );
    let second = &simulations[1];
    assert_eq!((second.seed, second.steps), (18_446_744_073_709_551_613, 300));
    assert_eq!(second.unit_point, [0.25, 0.75]);
    assert_eq!(second.initial_configuration[0], 2.0 / 3.0);
    assert_eq!(second.initial_configuration[1].to_bits(), 1 << 63);
    assert_eq!(second.verdicts, [None, Some(0.2)]);
    assert_eq!(second.trace_digest, None);

    assert_eq!(run.traced().unwrap(), [(2, 2)]);
    let columns = run.simulation(2, 2).unwrap().trace.unwrap().columns;
    assert_eq!((columns[0].len(), columns[1].len()), (301, 301));
    assert_eq!((columns[0][0], columns[0][300], columns[1][2]), (0.0, 30.0, 7.5));
    assert!(columns[1][3].is_nan());
    assert_eq!((columns[1][4], columns[1][5].to_bits()), (f64::NEG_INFINITY, 1 << 63));
}
