use std::io::Read;
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, bail, ensure};
use mishandle::stl::{Clock, Formula, Monitor, TimeUnit, Trace};
use serde_json::{Value, json};

use crate::ExitStatus;
use crate::args;
use crate::output::{self, number};

/// Column that holds the time of each sample, s.
const TIME: &str = "time";

/// Sampling times may differ from an even grid by this share of the period.
const JITTER: f64 = 1e-3;

pub fn run(command: &args::Monitor) -> Result<ExitStatus> {
    let formula = Formula::parse(&command.formula).map_err(|error| {
        let column = error.position().column;
        let marker = format!("\n  {}\n  {}^", command.formula, " ".repeat(column.saturating_sub(1)));
        anyhow::anyhow!("formula: {error}{marker}")
    })?;
    output::warn_of_chains(&formula);
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
        bail!("the formula reaches {horizon} samples past the first; the trace has {} in all", trace.len());
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
            output::say(&format!(
                "note: the formula reaches {horizon} samples past the first, the trace has {} in all; windows are \
                 cut at its end (--strict-horizon refuses that)",
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
        .with_context(|| format!("--unit is `{text}`; it has to be one of {}", known.join(", ")))
}

/// Reads a trace: a header of signal names, then a row of finite numbers for each sample.
fn read(path: &Path) -> Result<Trace> {
    let mut text = String::new();
    if path.as_os_str() == "-" {
        std::io::stdin().read_to_string(&mut text)?;
    } else {
        text = std::fs::read_to_string(path)?;
    }
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(text.as_bytes());
    let names: Arc<[String]> = reader.headers()?.iter().map(str::to_string).collect();
    ensure!(!names.is_empty(), "the file is empty; it has to begin with a header of signal names");
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
    ensure!(!trace.is_empty(), "there is no sample below the header");
    Ok(trace)
}

/// The sampling period, s: as asked for, else as the time column has it, else 1.
fn period(trace: &Trace, asked: Option<f64>) -> Result<f64> {
    let times = trace.signal(TIME).filter(|times| times.len() > 1);
    let Some(times) = times else { return Ok(asked.unwrap_or(1.0)) };
    let found = (times[times.len() - 1] - times[0]) / (times.len() - 1) as f64;
    ensure!(found > 0.0, "column `{TIME}` does not increase");
    let even = |(i, pair): (usize, &[f64])| (((pair[1] - pair[0]) / found - 1.0).abs() > JITTER).then_some(i);
    if let Some(sample) = times.windows(2).enumerate().find_map(even) {
        bail!(
            "samples have to be evenly spaced; column `{TIME}` goes from {} to {} after line {}, on average it \
             moves by {found}",
            times[sample],
            times[sample + 1],
            sample + 2
        );
    }
    if let Some(asked) = asked {
        ensure!(
            (asked / found - 1.0).abs() <= JITTER,
            "--period is {asked} s, column `{TIME}` moves by {found} s"
        );
        return Ok(asked);
    }
    // Times written with few digits give 0.03333 for 1/30: where a whole number of samples a second is that near, it
    // is what was meant.
    let rate = (1.0 / found).round();
    Ok(if (found * rate - 1.0).abs() < 1e-4 { 1.0 / rate } else { found })
}
