mod log;

use std::fs::File;
use std::io::Read;
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use mishandle::plural;
use mishandle::stl::{Clock, Formula, Monitor, MonitorError, TimeUnit};
use serde_json::json;

use crate::ExitStatus;
use crate::args;
use crate::formula_error;
use crate::output::{self, number};
use log::{Log, Samples};

pub fn run(command: &args::Monitor) -> Result<ExitStatus> {
    let formula = Formula::parse(&command.formula)
        .map_err(|error| anyhow::anyhow!("{}", formula_error::message(&command.formula, &error)))?;
    output::warn_of_chained_comparisons(&formula);
    let trace_name = || format!("trace {}", command.trace.display());
    let log = Log::open(source(&command.trace).with_context(trace_name)?).with_context(trace_name)?;
    check_signals(&formula, log.names())?;
    let samples = log.samples(&formula.signals()).with_context(trace_name)?;
    let period = samples.period(command.period).with_context(trace_name)?;
    let clock = match &command.unit {
        Some(unit) => Clock::rtamt(period, self::unit(unit)?),
        None => Clock::steps(period),
    };
    let mut monitor = Monitor::new(&formula, samples.trace.names(), clock)?;
    let cuts_windows = !command.strict_horizon && monitor.cuts_windows(samples.trace.len());
    let signal = signal(&mut monitor, &samples, command.strict_horizon)?;
    let robustness = signal[0];
    if command.json {
        let head = json!({
            "robustness": number(robustness),
            "windows": if command.strict_horizon { "whole" } else { "cut" },
            "cuts_windows": cuts_windows,
        });
        output::json_with_numbers(head, "robustness_signal", signal)?;
    } else {
        let verdict = match robustness {
            r if r > 0.0 => "satisfied",
            r if r < 0.0 => "violated",
            _ => "neither satisfied nor violated",
        };
        output::line(&format!("robustness {robustness} at time 0: {verdict}"))?;
        if cuts_windows {
            output::message(&format!(
                "note: a window extends past the end of the trace, which has {}; it is cut there, as in RTAMT; \
                 samples after the end could change the value (--strict-horizon uses whole windows only)",
                plural(samples.trace.len(), "sample")
            ));
        }
    }
    Ok(if robustness < 0.0 { ExitStatus::Violated } else { ExitStatus::Done })
}

/// Returns the robustness signal: all samples with cut windows, or the decided ones, of which there is at least one.
fn signal<'m>(monitor: &'m mut Monitor, samples: &Samples, strict_horizon: bool) -> Result<&'m [f64]> {
    let trace = &samples.trace;
    if !strict_horizon {
        return Ok(monitor.robustness_signal(trace)?);
    }
    let needed = monitor.needed_samples();
    ensure!(
        needed <= trace.len(),
        "the formula needs {needed} samples, but the trace has only {}; without --strict-horizon, windows are cut at its \
         end",
        trace.len()
    );
    let signal = monitor.decided_robustness_signal(trace)?;
    ensure!(
        signal[0].is_finite(),
        "the robustness at time 0 is {}: it depends on no sample of the trace; without --strict-horizon, empty windows \
         are allowed",
        signal[0]
    );
    Ok(signal)
}

fn unit(text: &str) -> Result<TimeUnit> {
    let known = TimeUnit::ALL.map(TimeUnit::symbol);
    TimeUnit::ALL
        .into_iter()
        .find(|unit| unit.symbol() == text)
        .with_context(|| format!("--unit is `{text}`; it must be one of {}", known.join(", ")))
}

/// Opens a file, or stdin for `-`.
fn source(path: &Path) -> Result<Box<dyn Read>> {
    if path.as_os_str() == "-" {
        return Ok(Box::new(std::io::stdin()));
    }
    let file = File::open(path).map_err(|error| match path.metadata() {
        Ok(found) if !found.is_file() => {
            std::io::Error::other("expected a file or a pipe, found a socket or a device")
        }
        _ => error,
    });
    Ok(Box::new(file?))
}

/// Checks the names in the formula against all columns. Only the columns of the formula are read later, so that errors
/// about them could not name the others.
fn check_signals(formula: &Formula, columns: &[String]) -> Result<()> {
    match Monitor::new(formula, columns, Clock::steps(1.0)) {
        Err(error @ (MonitorError::UnknownSignal { .. } | MonitorError::ShadowsSignal { .. })) => {
            bail!(error)
        }
        // The period is not known yet, so that other errors have no meaning.
        _ => Ok(()),
    }
}
