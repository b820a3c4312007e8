//! Disk space and time of recording a campaign: `cargo bench -p mishandle-store [-- SIMULATIONS]`
//! (default 100,000).
//!
//! The ratio compares with the simplest alternative: one line of CSV per simulation, appended and
//! flushed.
#![allow(clippy::print_stdout)]

use std::error::Error;
use std::io::Write as _;
use std::path::Path;
use std::time::Instant;

use mishandle_store::{
    AxisRecord, BuildRecord, ComponentRecord, IfExists, RunFile, RunHeader, RunKind, RunWriter, SignalRecord,
    Simulation, SimulationEnd, StoredTrace, TargetRecord, export_csv,
};

const AXES: usize = 6;
const TRIALS: u32 = 30;
/// Trials whose simulations are recorded alternately, as by worker threads.
const AT_ONCE: u32 = 8;
const BATCH: u32 = 32;

fn main() -> Result<(), Box<dyn Error>> {
    let argument = std::env::args().find_map(|word| word.parse().ok());
    let simulations: u32 = argument.unwrap_or(100_000);
    let folder = tempfile::tempdir()?;
    rows(simulations, &folder.path().join("rows.sqlite"))?;
    let csv = lines(simulations, &folder.path().join("rows.csv"))?;
    println!("  flushed lines of CSV, for comparison  {csv:8.2} s");
    traces(&folder.path().join("traces.sqlite"))
}

fn rows(simulations: u32, path: &Path) -> Result<(), Box<dyn Error>> {
    let mut writer = RunWriter::create(path, &header(), IfExists::Refuse)?;
    (0..TRIALS).try_for_each(|trial| writer.start_trial(trial, trial.into()))?;
    let start = Instant::now();
    for records in batches(simulations) {
        writer.record(&records)?;
    }
    let recorded = start.elapsed().as_secs_f64();
    writer.close()?;
    let closed = start.elapsed().as_secs_f64();
    let size = std::fs::metadata(path)?.len() as f64 / f64::from(simulations);
    println!("{simulations} simulations of {AXES} axes without traces, batches of {BATCH}");
    println!(
        "  record                                {recorded:8.2} s, {:.1} us each",
        recorded / f64::from(simulations) * 1e6
    );
    println!("  record and close                      {closed:8.2} s");
    println!("  file                                  {size:8.1} bytes each");

    time("open, with its check", || Ok(RunFile::open(path).map(drop)?))?;
    time("open without the check", || Ok(RunFile::open_unchecked(path).map(drop)?))?;
    let run = RunFile::open_unchecked(path)?;
    time("read all in order", || Ok(run.simulations().try_for_each(|simulation| simulation.map(drop))?))?;
    time("count the trials' simulations", || Ok(run.trials().map(drop)?))?;
    time("content digest", || Ok(run.content_digest().map(drop)?))?;
    time("check", || Ok(run.check()?))?;
    time("export as CSV", || Ok(export_csv(&run, &mut std::io::sink())?))?;
    println!("  largest memory so far                 {:8.1} MiB", peak_mib());
    Ok(())
}

fn lines(simulations: u32, path: &Path) -> Result<f64, Box<dyn Error>> {
    let mut file = std::fs::File::create(path)?;
    let start = Instant::now();
    for s in batches(simulations).flatten() {
        let line = format!(
            "{},{},{},{:?},{:?},{},{:?},{:?},{:?}\n",
            s.trial, s.number, s.seed, s.robustness, s.end, s.steps, s.unit_point, s.scenario, s.verdicts
        );
        file.write_all(line.as_bytes())?;
    }
    Ok(start.elapsed().as_secs_f64())
}

fn traces(path: &Path) -> Result<(), Box<dyn Error>> {
    let count = 2000;
    let mut writer = RunWriter::create(path, &header(), IfExists::Refuse)?;
    writer.start_trial(0, 0)?;
    let trace = smooth_trace();
    let raw = trace.columns.iter().map(|column| column.len() * 8).sum::<usize>();
    let start = Instant::now();
    for number in 1..=count {
        let trace = Some(trace.clone());
        writer.record(&[Simulation { trace_digest: None, trace, ..simulation(0, number) }])?;
    }
    let each = start.elapsed().as_secs_f64() / f64::from(count) * 1e6;
    writer.close()?;
    let size = std::fs::metadata(path)?.len() as f64 / f64::from(count);
    println!("{count} simulations with a trace of 301 samples of 6 signals ({raw} bytes), one by one");
    println!("  record                                {each:8.1} us each");
    println!("  file                                  {size:8.1} bytes each");
    time("open, with its check", || Ok(RunFile::open(path).map(drop)?))?;
    time("open without the check", || Ok(RunFile::open_unchecked(path).map(drop)?))?;
    let run = RunFile::open_unchecked(path)?;
    time("read all", || Ok((1..=count).try_for_each(|number| run.simulation(0, number).map(drop))?))
}

fn time(what: &str, work: impl FnOnce() -> Result<(), Box<dyn Error>>) -> Result<(), Box<dyn Error>> {
    let start = Instant::now();
    work()?;
    println!("  {what:37} {:8.2} s", start.elapsed().as_secs_f64());
    Ok(())
}

fn peak_mib() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak =
        status.lines().find_map(|line| line.strip_prefix("VmHWM:")?.trim().strip_suffix(" kB")?.parse().ok());
    peak.unwrap_or(f64::NAN) / 1024.0
}

fn batches(simulations: u32) -> impl Iterator<Item = Vec<Simulation>> {
    let per_trial = simulations.div_ceil(TRIALS);
    // Eight trials run at a time and record their batches in turn.
    let groups = (0..TRIALS).step_by(AT_ONCE as usize).map(|first| first..TRIALS.min(first + AT_ONCE));
    groups.flat_map(move |trials| {
        (1..=per_trial).step_by(BATCH as usize).flat_map(move |first| {
            let numbers = first..=per_trial.min(first + BATCH - 1);
            trials.clone().map(move |trial| numbers.clone().map(|number| simulation(trial, number)).collect())
        })
    })
}

fn simulation(trial: u32, number: u32) -> Simulation {
    let x = f64::from(number) * 0.618 + f64::from(trial) * 0.414;
    Simulation {
        trial,
        number,
        seed: u64::from(number).wrapping_mul(0x9e37_79b9_7f4a_7c15),
        unit_point: (1..=AXES).map(|axis| (x * axis as f64).fract()).collect(),
        scenario: (1..=AXES).map(|axis| Some((x * axis as f64).fract() * 0.3 + 0.1)).collect(),
        robustness: Some(x.sin()),
        robustness_low: Some(x.sin()),
        robustness_high: Some(x.sin()),
        stop_threshold: None,
        end: SimulationEnd::Completed,
        steps: 300,
        verdicts: vec![Some(x.cos()), Some(0.25), None, Some(-x)],
        reason: String::new(),
        trace_digest: Some(u128::from(number) << 64 | 7),
        trace: None,
    }
}

/// Signals of a trace: a servo that follows a sine, a bouncing ball, their distances, and a
/// distance that becomes constant.
fn smooth_trace() -> StoredTrace {
    let mut q = 0.7_f64;
    let mut q_dot = 0.0;
    let mut z = 1.0_f64;
    let mut z_dot = 0.3;
    let mut columns = vec![Vec::new(); 6];
    for step in 0..301 {
        let t = f64::from(step) / 60.0;
        let target = 0.3 * (1.3 * t).sin();
        for _ in 0..2 {
            q_dot += (40.0 * (target - q) - 8.0 * q_dot) / 120.0;
            q += q_dot / 120.0;
            z_dot -= 9.81 / 120.0;
            z += z_dot / 120.0;
            if z < 0.0 {
                (z, z_dot) = (-z, -0.4 * z_dot);
            }
        }
        let x = 0.5 + 0.2 * t;
        let at_rest = 0.05 * (-t.min(2.5)).exp();
        for (column, value) in
            columns.iter_mut().zip([q, q_dot, z, x.hypot(z), (q - x).hypot(z - 0.2), at_rest])
        {
            column.push(value);
        }
    }
    StoredTrace { columns }
}

fn header() -> RunHeader {
    RunHeader {
        kind: RunKind::Falsify,
        build: BuildRecord::default(),
        versions: vec![],
        plan: String::new(),
        target: TargetRecord {
            kind: "task".into(),
            name: "point-reaching".into(),
            ..TargetRecord::default()
        },
        components: vec![ComponentRecord {
            role: "controller".into(),
            name: "ppo".into(),
            ..ComponentRecord::default()
        }],
        space: "starts".into(),
        formula: String::new(),
        formulas: vec![],
        search: "random".into(),
        seed: 1,
        control_dt: 1.0 / 60.0,
        episode_steps: 300,
        signals: (0..6).map(|i| SignalRecord { name: format!("signal_{i}"), unit: "m".into() }).collect(),
        axes: (0..AXES)
            .map(|i| AxisRecord {
                name: format!("axis_{i}"),
                unit: "m".into(),
                high: 1.0,
                ..AxisRecord::default()
            })
            .collect(),
        verdicts: ["strict", "dangerous", "completion", "return"].map(Into::into).into(),
        preflight: vec![],
    }
}
