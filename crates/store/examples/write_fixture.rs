//! Writes the run file that later programs of the same format version must be able to read:
//! `cargo run -p mishandle-store --example write_fixture -- crates/store/tests/fixtures/v5.sqlite`.
//!
//! Run once per format version. `tests/fixture.rs` states the values by hand.

use mishandle_store::{
    AxisRecord, BuildRecord, ComponentRecord, FormulaRecord, IfExists, Result, RunHeader, RunKind, RunWriter,
    SignalRecord, Simulation, SimulationEnd, StoredTrace, TargetRecord, TrialStatus,
};

fn main() -> Result<()> {
    let Some(path) = std::env::args_os().nth(1) else {
        eprintln!("usage: write_fixture FILE");
        std::process::exit(2);
    };
    let mut writer = RunWriter::create(path, &header(), IfExists::Refuse)?;
    let statuses =
        [TrialStatus::Running, TrialStatus::Falsified, TrialStatus::BudgetSpent, TrialStatus::Converged];
    for (trial, status) in (1..).zip(statuses) {
        writer.start_trial(trial, u64::MAX - u64::from(trial))?;
        writer.end_trial(trial, status)?;
    }
    let part = simulation(1, 3, Some(-0.25), SimulationEnd::Stopped { step: 34 });
    writer.record(&[
        simulation(1, 1, Some(0.1 + 0.2), SimulationEnd::Completed),
        simulation(1, 2, None, SimulationEnd::Diverged { step: 12 }),
        Simulation { robustness_low: Some(f64::NEG_INFINITY), stop_threshold: Some(-0.0), ..part },
        simulation(1, 4, Some(f64::INFINITY), SimulationEnd::Terminated { step: 56 }),
        simulation(1, 5, None, SimulationEnd::Undefined { step: 0 }),
        simulation(1, 6, None, SimulationEnd::InvalidAction { step: 7, index: 3 }),
        Simulation {
            unit_point: vec![],
            scenario: vec![None, None],
            ..simulation(1, 7, None, SimulationEnd::InvalidScenario)
        },
        simulation(1, 8, None, SimulationEnd::Crashed { step: 8 }),
        simulation(1, 9, None, SimulationEnd::TimedOut { step: 9 }),
        simulation(1, 10, None, SimulationEnd::InvalidObservation { step: 0, index: 5 }),
        simulation(1, 11, None, SimulationEnd::InvalidReward { step: 11, index: 1 }),
        simulation(1, 12, None, SimulationEnd::InvalidSignal { step: 12, index: u32::MAX }),
        simulation(2, 1, Some(-0.0), SimulationEnd::Completed),
        Simulation {
            trace: Some(trace()),
            ..simulation(2, 2, Some(f64::NEG_INFINITY), SimulationEnd::Completed)
        },
    ])?;
    writer.close()
}

fn header() -> RunHeader {
    RunHeader {
        kind: RunKind::Evaluate,
        build: BuildRecord {
            program_version: "0.1.0".into(),
            git_commit: "51c0ab8".into(),
            target: "x86_64-unknown-linux-gnu".into(),
            rustc: "1.95.0".into(),
            architecture: "x86-64-v3".into(),
        },
        versions: vec![("MuJoCo".into(), "3.17.0".into()), ("Python".into(), "3.11.2".into())],
        plan: "task = \"ball-catching\"\n# ρ ≥ 0\n".into(),
        target: TargetRecord {
            kind: "python".into(),
            name: "ball-catching".into(),
            hash: "t0".into(),
            is_deterministic: false,
        },
        components: vec![
            ComponentRecord {
                role: "controller".into(),
                name: "expert".into(),
                hash: "c0".into(),
                file_hash: "c1".into(),
            },
            ComponentRecord { role: "filter".into(), name: "none".into(), ..ComponentRecord::default() },
        ],
        space: "everything".into(),
        formula: "always[50:300](ball_box_horizontal_distance <= 0.1)".into(),
        formulas: vec![
            FormulaRecord { name: "success".into(), text: "linear <= 0.1".into() },
            FormulaRecord { name: "safe".into(), text: "linear < 0.2".into() },
        ],
        search: "random".into(),
        seed: 1 << 63,
        control_dt: 0.25,
        episode_steps: 150,
        signals: vec![
            SignalRecord { name: "linear".into(), unit: "m".into() },
            SignalRecord { name: "strange".into(), unit: String::new() },
        ],
        axes: vec![
            AxisRecord {
                name: "ball_x".into(),
                unit: "m".into(),
                kind: "start".into(),
                low: -0.5,
                high: 1.25,
                nominal: Some(-0.0),
                values: "continuous".into(),
                meaning: "where the ball starts".into(),
            },
            AxisRecord {
                name: "say \"ρ\"".into(),
                kind: "noise".into(),
                low: 2.0,
                high: 3.0,
                nominal: None,
                values: "integer".into(),
                ..AxisRecord::default()
            },
        ],
        verdicts: vec!["strict_robustness".into(), "return".into()],
        preflight: vec![],
    }
}

fn simulation(trial: u32, number: u32, robustness: Option<f64>, end: SimulationEnd) -> Simulation {
    Simulation {
        trial,
        number,
        seed: u64::MAX - u64::from(number),
        unit_point: vec![0.25, 0.75],
        scenario: vec![Some(f64::from(number) / 3.0), Some(-0.0)],
        robustness,
        robustness_low: robustness,
        robustness_high: robustness,
        stop_threshold: None,
        end,
        steps: 150,
        verdicts: vec![None, Some(f64::from(number) * 0.1)],
        reason: String::new(),
        trace_digest: None,
        trace: None,
    }
}

fn trace() -> StoredTrace {
    let linear = (0..301).map(|step| f64::from(step) * 0.1).collect();
    let mut strange = vec![7.5; 301];
    strange[3] = f64::NAN;
    strange[4] = f64::NEG_INFINITY;
    strange[5] = -0.0;
    StoredTrace { columns: vec![linear, strange] }
}
