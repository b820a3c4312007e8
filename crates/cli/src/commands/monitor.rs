use std::io::Read;
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, bail, ensure};
use mishandle::stl::{Clock, Formula, Monitor, TimeUnit, Trace};
use serde_json::{Value, json};

use crate::ExitStatus;
use crate::args;
use crate::output::{self, number};

/// Column with the time of each sample, in seconds.
const TIME: &str = "time";

/// Largest deviation of a sampling interval from the period, as a fraction of the period.
const JITTER: f64 = 1e-3;

pub fn run(command: &args::Monitor) -> Result<ExitStatus> {
    let formula = Formula::parse(&command.formula).map_err(|error| {
        let column = error.position().column;
        let marker = format!("\n  {}\n  {}^", command.formula, " ".repeat(column.saturating_sub(1)));
        anyhow::anyhow!("formula: {error}{marker}")
    })?;
    output::warn_of_chained_comparisons(&formula);
    let name = command.trace.display().to_string();
    let trace = read(&command.trace).with_context(|| format!("trace {name}"))?;
    let period = period(&trace, command.period).with_context(|| format!("trace {name}"))?;
    let clock = match &command.unit {
        Some(unit) => Clock::rtamt(period, self::unit(unit)?),
        None => Clock::steps(period),
    };
    let mut monitor = Monitor::new(&formula, trace.names(), clock)?;
    let covered = monitor.horizon().is_none_or(|horizon| horizon < trace.len());
    let horizon = monitor.horizon().unwrap_or(0);
    if command.strict_horizon && !covered {
        bail!(
            "the formula reaches {horizon} samples past the first, but the trace has only {} samples",
            trace.len()
        );
    }
    let signal = monitor.robustness_signal(&trace)?;
    let robustness = signal[0];
    if command.json {
        let values: Vec<Value> = signal.iter().map(|value| number(*value)).collect();
        output::json(json!({ "robustness": number(robustness), "robustness_signal": values }))?;
    } else {
        let verdict = match robustness {
            r if r > 0.0 => "satisfied",
            r if r < 0.0 => "violated",
            _ => "neither satisfied nor violated",
        };
        output::line(&format!("robustness {robustness} at time 0: {verdict}"))?;
        if !covered {
            output::message(&format!(
                "note: the formula reaches {horizon} samples past the first, but the trace has only {} samples; \
                 intervals are truncated at its end (with --strict-horizon this is an error)",
                trace.len()
            ));
        }
    }
    Ok(if robustness < 0.0 { ExitStatus::Violated } else { ExitStatus::Done })
}

fn unit(text: &str) -> Result<TimeUnit> {
    let known = TimeUnit::ALL.map(TimeUnit::symbol);
    TimeUnit::ALL
        .into_iter()
        .find(|unit| unit.symbol() == text)
        .with_context(|| format!("--unit is `{text}`; it must be one of {}", known.join(", ")))
}

/// Reads a trace: a header with the signal names, then one row of numbers per sample.
fn read(path: &Path) -> Result<Trace> {
    let mut text = String::new();
    if path.as_os_str() == "-" {
        std::io::stdin().read_to_string(&mut text)?;
    } else {
        text = std::fs::read_to_string(path)?;
    }
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(text.as_bytes());
    let names: Arc<[String]> = reader.headers()?.iter().map(str::to_string).collect();
    ensure!(!names.is_empty(), "the file is empty; the first line must contain the signal names");
    for (i, name) in names.iter().enumerate() {
        ensure!(!name.is_empty(), "column {} has no name in the header", i + 1);
        ensure!(!names[..i].contains(name), "two columns are named `{name}`");
    }
    let mut trace = Trace::new(names.clone());
    let mut sample = vec![0.0; names.len()];
    for (row, record) in reader.records().enumerate() {
        let record = record?;
        for ((value, cell), name) in sample.iter_mut().zip(&record).zip(names.iter()) {
            *value = cell
                .parse()
                .ok()
                .with_context(|| format!("line {}: `{name}` is `{cell}`, which is not a number", row + 2))?;
        }
        trace.push(&sample);
    }
    ensure!(!trace.is_empty(), "the file has a header, but no samples");
    Ok(trace)
}

/// Returns the sampling period in seconds: `--period`, or else the mean step of the column `time`, or else 1.
fn period(trace: &Trace, flag: Option<f64>) -> Result<f64> {
    let times = trace.signal(TIME).filter(|times| times.len() > 1);
    let Some(times) = times else { return Ok(flag.unwrap_or(1.0)) };
    let found = (times[times.len() - 1] - times[0]) / (times.len() - 1) as f64;
    ensure!(found > 0.0, "column `{TIME}` does not increase");
    let uneven =
        |(i, pair): (usize, &[f64])| (((pair[1] - pair[0]) / found - 1.0).abs() > JITTER).then_some(i);
    if let Some(sample) = times.windows(2).enumerate().find_map(uneven) {
        bail!(
            "samples must be evenly spaced; column `{TIME}` steps from {} to {} after line {}, its mean step is \
             {found}",
            times[sample],
            times[sample + 1],
            sample + 2
        );
    }
    if let Some(period) = flag {
        ensure!(
            (period / found - 1.0).abs() <= JITTER,
            "--period is {period} s, but the mean step of column `{TIME}` is {found} s; leave out --period"
        );
        return Ok(period);
    }
    // Rounded times, such as 0.03333 for 1/30, give an inexact period. A nearly integer sampling rate is meant exactly.
    let rate = (1.0 / found).round();
    Ok(if (found * rate - 1.0).abs() < 1e-4 { 1.0 / rate } else { found })
}
