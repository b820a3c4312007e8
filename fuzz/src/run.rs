//! Run files to be changed, and their content.

use std::path::Path;

use mishandle::store::{
    AxisRecord, BuildRecord, ComponentRecord, FormulaRecord, IfExists, RunHeader, RunKind, RunWriter,
    SignalRecord, Simulation, SimulationEnd, StoredTrace, TargetRecord, TrialStatus,
};

/// Returns the header of a run with two axes, a verdict, and `signals` signals.
pub fn header(signals: usize) -> RunHeader {
    let axis = |name: &str, nominal| AxisRecord {
        name: name.into(),
        unit: "m".into(),
        kind: "start".into(),
        low: 0.3,
        high: 0.7,
        nominal,
        values: "continuous".into(),
        meaning: "distance of the target".into(),
    };
    RunHeader {
        kind: RunKind::Falsify,
        build: BuildRecord { program_version: "0.1.0".into(), ..BuildRecord::default() },
        versions: vec![("MuJoCo".into(), "3.17.0".into())],
        plan: "target = \"toy/sphere-2d\"\n".into(),
        target: TargetRecord {
            kind: "toy".into(),
            name: "toy/sphere-2d".into(),
            hash: "41d0".into(),
            is_deterministic: true,
        },
        components: vec![ComponentRecord {
            role: "controller".into(),
            name: "ppo".into(),
            hash: "9f2c".into(),
            file_hash: "07aa".into(),
        }],
        space: "starts".into(),
        formula: "always(d >= 0)".into(),
        formulas: vec![FormulaRecord { name: "success".into(), text: "always(d >= 0)".into() }],
        search: "random".into(),
        seed: u64::MAX,
        control_dt: 1.0 / 60.0,
        episode_steps: 20,
        signals: (0..signals).map(|i| SignalRecord { name: format!("d{i}"), unit: "m".into() }).collect(),
        axes: vec![axis("target_x", Some(0.5)), axis("target_y", None)],
        verdicts: vec!["strict_robustness".into()],
        preflight: vec![],
    }
}

pub fn simulation(trial: u32, number: u32, trace: Option<StoredTrace>) -> Simulation {
    let robustness = Some(f64::from(number) - 2.5);
    Simulation {
        trial,
        number,
        seed: u64::MAX - u64::from(number),
        unit_point: vec![0.25, f64::from(number).recip()],
        scenario: vec![Some(-0.0), None],
        robustness,
        robustness_low: robustness,
        robustness_high: Some(f64::INFINITY),
        stop_threshold: Some(-0.1),
        end: SimulationEnd::Stopped { step: number },
        steps: number,
        verdicts: vec![None],
        reason: String::new(),
        trace_digest: None,
        trace,
    }
}

/// Writes two trials of three simulations each and returns the writer, which is still open. The
/// second simulation of a trial has a trace.
pub fn write(path: &Path) -> RunWriter {
    let mut writer = RunWriter::create(path, &header(2), IfExists::Refuse).expect("a new file");
    for trial in [1, 2] {
        writer.start_trial(trial, u64::from(trial)).expect("a new trial");
        for number in 1..=3 {
            let column = |phase: u32| (0..20).map(|k| f64::from(k * phase + trial).sin()).collect();
            let trace = (number == 2).then(|| StoredTrace { columns: vec![column(1), column(2)] });
            writer.record(&[simulation(trial, number, trace)]).expect("a new simulation");
        }
        writer.end_trial(trial, TrialStatus::Falsified).expect("a running trial");
    }
    writer
}
