mod log;
mod times;

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail, ensure};
use clap::Args;
use log::{Log, Samples};
use mishandle::results::{self, Number, RequirementVerdict};
use mishandle::stl::{
    Clock, Formula, Monitor, MonitorError, Recording, TimeUnit, is_violated, name_hint, unquoted,
};
use mishandle_text::{number_text, plural, shell_quote, visible};

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::show::{formula_error, output, requirements};

/// Sampling periods.
const PERIOD: &str = "a number of seconds above 0, such as 0.1";

fn is_period(secs: f64) -> bool {
    secs > 0.0 && secs.is_finite()
}

/// Compute the robustness of a temporal logic formula on a recorded trace
#[derive(Debug, Args)]
#[command(after_help = "The trace is a CSV file: a header with the signal names, then one row of numbers per
sample. The optional column `time` (seconds) determines the sampling period; --time names
another column. Columns that the formula does not read may have any name and hold any text.
In a formula, the name of a column that is not a plain word stands in backquotes:
`/joint[0]/position`. In a shell, a formula with backquotes stands in single quotes.

Windows that extend past the end of the trace are cut there, as in RTAMT. A cut window can
satisfy a formula that the whole window would violate. --strict-horizon uses whole windows
only, as verdicts about episodes do: a window without an end (`eventually p`) then ends at
the last sample at which p's own windows are inside the trace, and a formula whose windows
do not fit into the trace is an error.

Examples:
  mishandle monitor --formula 'always[0:2](d <= 0.3)' trace.csv             bounds count samples
  mishandle monitor --formula 'always[0:2s](d <= 0.3)' --period 0.1 trace.csv
  mishandle monitor --formula 'always[0:2](d <= 0.3)' --period 0.1 --unit s trace.csv  as in RTAMT

Exit code 1 means that a formula is violated at time 0. docs/reference/formulas.md describes
the language of formulas.")]
pub struct Arguments {
    /// Formula in the syntax of RTAMT
    #[arg(long, allow_hyphen_values = true)]
    pub formula: Option<String>,
    /// Formula with a name; repeat the flag for several. Each has a verdict of its own
    #[arg(long, value_name = "NAME=FORMULA", allow_hyphen_values = true, value_parser = flags::named_formula)]
    pub requirement: Vec<(String, String)>,
    /// CSV file with the trace; - reads stdin
    pub trace: PathBuf,
    /// Sampling period in seconds [default: that of the times; bounds in seconds need one of both]
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, value_parser = numbers::number(PERIOD, is_period))]
    pub period: Option<f64>,
    /// Column with the times of the samples in seconds [default: `time`, if there is one]
    #[arg(long, value_name = "COLUMN")]
    pub time: Option<String>,
    /// Unit of interval bounds without a unit: s, ms, us or ns [default: such bounds count samples]
    #[arg(long)]
    pub unit: Option<String>,
    /// Use only windows inside the trace, instead of cutting them at its end as RTAMT does
    #[arg(long)]
    pub strict_horizon: bool,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    let formula = command.formula.iter().map(|text| (None, text));
    let named = command.requirement.iter().map(|(name, text)| (Some(name), text));
    ensure!(
        command.formula.is_some() || !command.requirement.is_empty(),
        "there is no formula: give --formula FORMULA, or --requirement NAME=FORMULA"
    );
    ensure!(
        usize::from(command.formula.is_some()) + command.requirement.len() == 1
            || command.trace.as_os_str() != "-",
        "several formulas need a trace in a file, because stdin can be read once"
    );
    let found = formula
        .chain(named)
        .map(|(name, text)| Ok((name, evaluate(command, text)?)))
        .collect::<Result<Vec<_>>>()?;
    let verdict = |(name, found): &(Option<&String>, Evaluated)| {
        let robustness = found.signal[0];
        Some(RequirementVerdict {
            name: (*name)?.clone(),
            formula: found.formula.to_string(),
            robustness: Some(robustness.into()),
            violated: Some(is_violated(robustness)),
        })
    };
    let verdicts: Vec<RequirementVerdict> = found.iter().filter_map(verdict).collect();
    let (_, first) = &found[0];
    let robustness = first.signal[0];
    if command.json {
        output::json(&results::Monitor {
            robustness: robustness.into(),
            violated: is_violated(robustness),
            windows: if command.strict_horizon { "whole" } else { "cut" }.to_string(),
            cuts_windows: first.cuts_windows,
            robustness_signal: first.signal.iter().copied().map(Number).collect(),
            requirements: (!verdicts.is_empty()).then_some(verdicts),
        })?;
    } else {
        if command.formula.is_some() {
            let verdict = if is_violated(robustness) { "violated" } else { "satisfied" };
            output::line(&format!("robustness {} at time 0: {verdict}", number_text(robustness + 0.0)))?;
        }
        if !verdicts.is_empty() {
            output::line(requirements::verdicts_text(Some(&verdicts)).trim_start())?;
        }
        if found.iter().any(|(_, found)| found.cuts_windows) {
            output::message(&format!(
                "note: a window extends past the end of the trace, which has {}; it is cut there, as in RTAMT; \
                 samples after the end could change the value (--strict-horizon uses whole windows only)",
                plural(first.samples, "sample")
            ));
        }
    }
    let fails = found.iter().any(|(_, found)| is_violated(found.signal[0]));
    Ok(if fails { ExitStatus::Violated } else { ExitStatus::Done })
}

/// A formula on the trace.
struct Evaluated {
    formula: Formula,
    samples: usize,
    cuts_windows: bool,
    /// The robustness at each sample; at least one.
    signal: Vec<f64>,
}

fn evaluate(command: &Arguments, text: &str) -> Result<Evaluated> {
    let unit = command.unit.as_deref().map(unit).transpose()?;
    let parsed = Formula::parse(text);
    if let Err(error) = &parsed
        && let Some(hint) = hint(command, text)
    {
        bail!("{}\nhint: {hint}", formula_error::message(text, error));
    }
    let formula = parsed.map_err(|error| anyhow!("{}", formula_error::message(text, &error)))?;
    output::warn_about(&formula);
    let trace_name = || format!("trace {}", command.trace.display());
    let log = Log::open(source(&command.trace).with_context(trace_name)?).with_context(trace_name)?;
    log.check_signals(&formula).with_context(trace_name)?;
    let likely_time = log.likely_time().filter(|name| visible(name) == *name).map(str::to_owned);
    let samples = log.samples(&formula, command.time.as_deref()).with_context(trace_name)?;
    let period = match &samples.times {
        Some(times) => times.period(command.period).with_context(trace_name)?,
        None => command.period,
    };
    let clock = match (period, unit) {
        (Some(period), Some(unit)) => Clock::rtamt(period, unit),
        (Some(period), None) => Clock::steps(period),
        (None, unit) if formula.needs_period(unit.is_some()) => {
            bail!(no_period(&samples, likely_time.as_deref()))
        }
        (None, _) => Clock::unknown(),
    };
    let mut monitor = Monitor::new(&formula, &samples.names, clock).map_err(|error| match error {
        MonitorError::NotAMultiple { .. } if samples.times.is_some() && command.period.is_none() => {
            anyhow!("{error}; the steps are those of the times, in seconds; --period sets another one that fits them")
        }
        error => error.into(),
    })?;
    let count = samples.recording.len();
    let cuts_windows = !command.strict_horizon && monitor.cuts_windows(count);
    let signal = signal(&mut monitor, samples.recording, command.strict_horizon)?.to_vec();
    Ok(Evaluated { formula, samples: count, cuts_windows, signal })
}

/// Returns the hint on a formula that does not parse, if it has the name of a column without the
/// backquotes that it needs.
fn hint(command: &Arguments, text: &str) -> Option<String> {
    let file = File::open(&command.trace).ok().filter(|_| command.trace.is_file())?;
    let log = Log::open(file).ok()?;
    name_hint(unquoted(text, log.names().iter().map(String::as_str))?)
}

/// Describes why the sampling period is unknown, although a bound is a time.
fn no_period(samples: &Samples, likely_time: Option<&str>) -> String {
    let needs = "a bound of the formula is a time, which needs the time between two samples";
    match (&samples.times, likely_time) {
        (Some(_), _) => format!("{needs}, but the trace has one sample; pass --period SECONDS"),
        (None, Some(name)) => format!(
            "{needs}, but the trace has no column `time`; if the column `{name}` has the times in seconds, pass --time {}, \
             otherwise --period SECONDS",
            shell_quote(name)
        ),
        (None, None) => format!(
            "{needs}, but the trace has no column `time`; pass --period SECONDS, or the name of the column with the times \
             as --time COLUMN"
        ),
    }
}

/// Returns the robustness signal: all samples with cut windows, or the decided ones, of which there
/// is at least one.
fn signal(monitor: &mut Monitor, recording: Recording, strict_horizon: bool) -> Result<&[f64]> {
    if !strict_horizon {
        return Ok(monitor.recorded_robustness_signal(recording)?);
    }
    let needed = monitor.needed_samples();
    ensure!(
        needed <= recording.len(),
        "the formula needs {needed} samples, but the trace has only {}; without --strict-horizon, windows are cut at its \
         end",
        recording.len()
    );
    let signal = monitor.recorded_decided_robustness_signal(recording)?;
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
