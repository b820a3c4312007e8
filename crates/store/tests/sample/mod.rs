//! A run to test with.
#![allow(dead_code)] // each test file uses its own part

use mishandle_store::{Axis, Build, End, RunHeader, RunKind, Simulation, SimulationRecord, Trace};

/// Two axes, two signals, two verdicts.
pub fn header() -> RunHeader {
    RunHeader {
        kind: RunKind::Falsify,
        build: Build {
            program_version: "0.1.0".into(),
            git_commit: "63b21f9".into(),
            target: "x86_64-unknown-linux-gnu".into(),
            rustc: "1.95.0".into(),
            mujoco_version: "3.17.0".into(),
            architecture: "x86-64-v3".into(),
        },
        plan: "task = \"ball-pushing\"\nbudget = 300 # \u{3c1} < 0\n".into(),
        controller: "controllers/ball-pushing/ppo.safetensors".into(),
        controller_hash: "a1".into(),
        controller_bytes_hash: "b2".into(),
        task: "ball-pushing".into(),
        preset: "paper".into(),
        formula: "eventually[0:300](ball_hole_distance <= 0.3)".into(),
        search: "nelder-mead".into(),
        seed: u64::MAX - 1,
        control_dt: 1.0 / 60.0,
        signals: vec!["ball_hole_distance".into(), "ball_height".into()],
        axes: vec![
            Axis { name: "ball_x".into(), unit: "m".into(), low: 0.4, high: 0.6 },
            Axis { name: "ball_velocity_x".into(), unit: "m/s".into(), low: -0.0, high: 1.5 },
        ],
        verdicts: vec!["strict_robustness".into(), "completion_step".into()],
    }
}

pub fn trace(samples: u32) -> Trace {
    let column = |phase: f64| (0..samples).map(|step| (phase + 0.02 * f64::from(step)).sin()).collect();
    Trace { columns: vec![column(0.0), column(1.0)] }
}

/// A record whose every value follows from its number.
pub fn record(trial: u32, number: u32) -> SimulationRecord {
    let x = f64::from(number) / 7.0 + f64::from(trial);
    SimulationRecord {
        simulation: Simulation {
            trial,
            number,
            seed: u64::from(number).wrapping_mul(0x9e37_79b9_7f4a_7c15),
            unit_point: vec![x.fract(), (2.0 * x).fract()],
            initial_configuration: vec![0.4 + 0.2 * x.fract(), 1.5 * (2.0 * x).fract()],
            robustness: match number % 5 {
                0 => None,
                1 => Some(f64::INFINITY),
                2 => Some(-0.0),
                3 => Some(f64::NEG_INFINITY),
                _ => Some(x.sin()),
            },
            end: match number % 3 {
                0 => End::Horizon,
                1 => End::Stopped { step: number },
                _ => End::Diverged { step: number + 1 },
            },
            steps: number.min(300),
            verdicts: vec![Some(-x), number.is_multiple_of(2).then(|| f64::from(number))],
            trace_digest: Some(u128::from(number) << 64 | u128::from(trial)),
        },
        trace: None,
    }
}

/// The same with a trace, and with its digest.
pub fn traced_record(trial: u32, number: u32) -> SimulationRecord {
    let trace = trace(50 + number);
    let mut record = record(trial, number);
    record.simulation.trace_digest = Some(trace.digest());
    SimulationRecord { trace: Some(trace), ..record }
}
