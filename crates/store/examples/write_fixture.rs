//! Writes the run file that later programs must still read:
//! `cargo run -p mishandle-store --example write_fixture -- crates/store/tests/fixtures/v1.sqlite`.
//!
//! To be run once per format version, when it is released; `tests/old_files.rs` holds the values by hand.

use mishandle_store::{
    Axis, Build, End, Existing, Result, RunHeader, RunKind, RunWriter, Simulation, SimulationRecord, Trace,
    TrialStatus,
};

fn main() -> Result<()> {
    let Some(path) = std::env::args_os().nth(1) else {
        eprintln!("usage: write_fixture FILE");
        std::process::exit(2);
    };
    let mut writer = RunWriter::create(path, &header(), Existing::Refuse)?;
    let statuses =
        [TrialStatus::Running, TrialStatus::Falsified, TrialStatus::BudgetSpent, TrialStatus::Converged];
    for (trial, status) in (1..).zip(statuses) {
        writer.start_trial(trial, u64::MAX - u64::from(trial))?;
        writer.end_trial(trial, status)?;
    }
    writer.record(&[
        record(1, 1, Some(0.1 + 0.2), End::Horizon),
        record(1, 2, None, End::Diverged { step: 12 }),
        record(1, 3, Some(f64::INFINITY), End::Stopped { step: 34 }),
        record(2, 1, Some(-0.0), End::Horizon),
        SimulationRecord { trace: Some(trace()), ..record(2, 2, Some(f64::NEG_INFINITY), End::Horizon) },
    ])?;
    writer.close()
}

fn header() -> RunHeader {
    RunHeader {
        kind: RunKind::Evaluate,
        build: Build {
            program_version: "0.1.0".into(),
            git_commit: "63b21f9".into(),
            target: "x86_64-unknown-linux-gnu".into(),
            rustc: "1.95.0".into(),
            mujoco_version: "3.17.0".into(),
            architecture: "x86-64-v3".into(),
        },
        plan: "task = \"ball-catching\"\n# ρ ≥ 0\n".into(),
        controller: "expert".into(),
        controller_hash: "c0".into(),
        controller_bytes_hash: "c1".into(),
        task: "ball-catching".into(),
        preset: "code".into(),
        formula: "always[50:300](ball_box_horizontal_distance <= 0.1)".into(),
        search: "random".into(),
        seed: 1 << 63,
        control_dt: 0.25,
        signals: vec!["linear".into(), "strange".into()],
        axes: vec![
            Axis { name: "ball_x".into(), unit: "m".into(), low: -0.5, high: 1.25 },
            Axis { name: "ball_velocity_z".into(), unit: "m/s".into(), low: 2.0, high: 3.0 },
        ],
        verdicts: vec!["strict_robustness".into(), "return".into()],
    }
}

fn record(trial: u32, number: u32, robustness: Option<f64>, end: End) -> SimulationRecord {
    let simulation = Simulation {
        trial,
        number,
        seed: u64::MAX - u64::from(number),
        unit_point: vec![0.25, 0.75],
        initial_configuration: vec![f64::from(number) / 3.0, -0.0],
        robustness,
        end,
        steps: 300,
        verdicts: vec![None, Some(f64::from(number) * 0.1)],
        trace_digest: None,
    };
    SimulationRecord { simulation, trace: None }
}

fn trace() -> Trace {
    let linear = (0..301).map(|step| f64::from(step) * 0.1).collect();
    let mut strange = vec![7.5; 301];
    strange[3] = f64::NAN;
    strange[4] = f64::NEG_INFINITY;
    strange[5] = -0.0;
    Trace { columns: vec![linear, strange] }
}
