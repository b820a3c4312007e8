//! A run for tests.

use mishandle_store::{
    AxisRecord, BuildRecord, ComponentRecord, FormulaRecord, RunHeader, RunKind, SignalRecord, Simulation,
    SimulationEnd, StoredTrace, TargetRecord,
};

/// Two axes, two signals, two verdicts.
pub fn header() -> RunHeader {
    RunHeader {
        kind: RunKind::Falsify,
        build: BuildRecord {
            program_version: "0.1.0".into(),
            git_commit: "63b21f9".into(),
            target: "x86_64-unknown-linux-gnu".into(),
            rustc: "1.95.0".into(),
            architecture: "x86-64-v3".into(),
        },
        versions: vec![("MuJoCo".into(), "3.17.0".into()), ("NumPy".into(), "2.4.0".into())],
        plan: "task = \"ball-pushing\"\nbudget = 300 # \u{3c1} < 0\n".into(),
        target: TargetRecord {
            kind: "task".into(),
            name: "ball-pushing".into(),
            hash: "77".into(),
            is_deterministic: true,
        },
        components: vec![ComponentRecord {
            role: "controller".into(),
            name: "controllers/ball-pushing/ppo.safetensors".into(),
            hash: "a1".into(),
            file_hash: "b2".into(),
        }],
        space: "starts".into(),
        formula: "eventually[0:300](ball_hole_distance <= 0.3)".into(),
        formulas: vec![
            FormulaRecord {
                name: "success".into(),
                text: "eventually[0:300](ball_hole_distance <= 0.3)".into(),
            },
            FormulaRecord { name: "safe".into(), text: "ball_hole_distance <= 0.5".into() },
        ],
        search: "nelder-mead".into(),
        seed: u64::MAX - 1,
        control_dt: 1.0 / 60.0,
        episode_steps: 300,
        signals: vec![signal("ball_hole_distance", "m"), signal("ball_height", "")],
        axes: vec![
            AxisRecord { nominal: Some(0.5), ..axis("ball_x", "m", 0.4, 0.6) },
            AxisRecord { kind: "noise".into(), nominal: None, ..axis("ball_velocity_x", "m/s", -0.0, 1.5) },
        ],
        verdicts: vec!["strict_robustness".into(), "completion_step".into()],
        preflight: vec![],
    }
}

pub fn signal(name: &str, unit: &str) -> SignalRecord {
    SignalRecord { name: name.into(), unit: unit.into() }
}

pub fn axis(name: &str, unit: &str, low: f64, high: f64) -> AxisRecord {
    AxisRecord {
        name: name.into(),
        unit: unit.into(),
        kind: "start".into(),
        low,
        high,
        nominal: Some(low),
        values: "continuous".into(),
        meaning: format!("what {name} means"),
    }
}

pub fn trace(samples: u32) -> StoredTrace {
    let column = |phase: f64| (0..samples).map(|step| (phase + 0.02 * f64::from(step)).sin()).collect();
    StoredTrace { columns: vec![column(0.0), column(1.0)] }
}

/// Returns a simulation whose values are functions of its number.
pub fn record(trial: u32, number: u32) -> Simulation {
    let x = f64::from(number) / 7.0 + f64::from(trial);
    let robustness = match number % 5 {
        0 => None,
        1 => Some(f64::INFINITY),
        2 => Some(-0.0),
        3 => Some(f64::NEG_INFINITY),
        _ => Some(x.sin()),
    };
    let step = number + 1;
    Simulation {
        trial,
        number,
        seed: u64::from(number).wrapping_mul(0x9e37_79b9_7f4a_7c15),
        unit_point: vec![x.fract(), (2.0 * x).fract()],
        scenario: vec![
            Some(0.4 + 0.2 * x.fract()),
            (!number.is_multiple_of(7)).then(|| 1.5 * (2.0 * x).fract()),
        ],
        robustness,
        robustness_low: robustness.map(|rho| rho - 0.1),
        robustness_high: robustness.filter(|_| !number.is_multiple_of(3)),
        stop_threshold: number.is_multiple_of(2).then_some(-0.0),
        end: match number % 12 {
            0 => SimulationEnd::Completed,
            1 => SimulationEnd::Terminated { step },
            2 => SimulationEnd::Stopped { step: number },
            3 => SimulationEnd::Diverged { step },
            4 => SimulationEnd::Undefined { step },
            5 => SimulationEnd::InvalidAction { step, index: 0 },
            6 => SimulationEnd::InvalidScenario,
            7 => SimulationEnd::Crashed { step },
            8 => SimulationEnd::TimedOut { step },
            9 => SimulationEnd::InvalidObservation { step, index: number },
            10 => SimulationEnd::InvalidReward { step, index: u32::MAX },
            _ => SimulationEnd::InvalidSignal { step, index: 1 },
        },
        steps: number.min(300),
        verdicts: vec![Some(-x), number.is_multiple_of(2).then(|| f64::from(number))],
        reason: String::new(),
        trace_digest: Some(u128::from(number) << 64 | u128::from(trial)),
        trace: None,
    }
}

/// Returns the same simulation with a trace and its digest.
pub fn traced_record(trial: u32, number: u32) -> Simulation {
    let trace = trace(50 + number);
    Simulation { trace_digest: Some(trace.digest()), trace: Some(trace), ..record(trial, number) }
}
