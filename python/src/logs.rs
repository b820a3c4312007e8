//! Logs of robots: files and columns in memory, and the verdicts of formulas on them.

use std::collections::BTreeMap;
use std::path::PathBuf;

use mishandle::plan::{LogSettings, MonitorSettings, Settings};
use mishandle::results::{FormulaTrap, NoVerdict, Severity};
use mishandle::stl::{Clock, DenseMonitor, Formula, Monitor};
use mishandle_logs::{
    Column, Evaluation, Log, LogError, NamedSamples, OpenLog, Options, Requirement, Samples, Signals, Source,
    TimeValues, Times, Topic,
};
use mishandle_requirements::{certainty, start_traps};
use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;

use crate::call::{Keys, settings};
use crate::formula::PyFormula;
use crate::words::worded;
use crate::work::json;
use crate::{InvalidValueError, plain, raised};

/// The times of a topic in memory.
#[derive(FromPyObject)]
pub(crate) enum TimeArgument<'py> {
    Integers(PyReadonlyArray1<'py, i64>),
    Numbers(PyReadonlyArray1<'py, f64>),
    Texts(Vec<String>),
}

/// A topic in memory: name, column and kind of the times, times, columns.
pub(crate) type TopicArgument<'py> =
    (Option<String>, Option<(String, String, TimeArgument<'py>)>, Vec<(String, PyReadonlyArray1<'py, f64>)>);

/// A log: name, files with their topics, topics in memory.
pub(crate) type LogArgument<'py> = (String, Vec<(Option<String>, PathBuf)>, Vec<TopicArgument<'py>>);

/// A topic as Python gets it: name, times in nanoseconds, columns.
type TopicColumns<'py> =
    (Option<String>, Option<Bound<'py, PyArray1<i64>>>, Vec<(String, Bound<'py, PyArray1<f64>>)>);

/// Topics, and columns that were left out, with the reasons.
type TableTopics<'py> = (Vec<TopicColumns<'py>>, Vec<(String, String)>);

/// Checks the settings of a call about logs. Returns the value of `log.time`, and the keys of `log`
/// that the call states, without the name of the table.
#[pyfunction]
pub fn log_keys(call: &str) -> PyResult<(Option<String>, Vec<String>)> {
    let Keys { settings, stated, .. } = Keys::read(call)?;
    let keys = stated.iter().filter_map(|key| key.strip_prefix("log.")).map(|key| key.replace('-', "_"));
    Ok((settings.log.time, keys.collect()))
}

/// Returns the places of the columns with whole seconds and with the rest that a name of times
/// means, and the nanoseconds of the unit of the rest; `None` if it means one column.
#[pyfunction]
pub fn time_columns(names: Vec<String>, name: &str) -> Option<(usize, usize, i64)> {
    mishandle_logs::seconds_and_rest(&names, name)
}

/// Returns the row with which each run of a clock starts but the first one, of times in
/// nanoseconds.
#[pyfunction]
pub fn clock_restarts(times: PyReadonlyArray1<'_, i64>) -> Vec<usize> {
    let first = times.as_array().first().copied().unwrap_or(0);
    let secs: Vec<f64> = times.as_array().iter().map(|time| time.wrapping_sub(first) as f64 / 1e9).collect();
    mishandle_logs::restarts(&secs)
}

/// A log whose signals were not read yet.
pub(crate) enum Contents {
    Files(Vec<Source>),
    Topics(Log),
}

impl Contents {
    pub(crate) fn new(
        files: Vec<(Option<String>, PathBuf)>,
        topics: Vec<TopicArgument<'_>>,
        options: &Options,
    ) -> PyResult<Self> {
        if !files.is_empty() {
            let source = |(topic, path)| Source { topic, path };
            return Ok(Contents::Files(files.into_iter().map(source).collect()));
        }
        let topic = |(name, times, columns): TopicArgument<'_>| {
            let times =
                times.map(|(column, kind, values)| times_of(&column, &kind, &values, options)).transpose()?;
            let column = |(name, values): (String, PyReadonlyArray1<'_, f64>)| Column {
                name,
                values: values.as_array().to_vec(),
            };
            Topic::of_values(name, times, columns.into_iter().map(column).collect()).map_err(plain)
        };
        let topics = topics.into_iter().map(topic).collect::<PyResult<Vec<_>>>()?;
        Ok(Contents::Topics(Log { topics, likely_time: None }))
    }

    /// Returns the error of each formula whose signals the log lacks. Python has checked columns in
    /// memory.
    fn errors<'a>(
        &self,
        formulas: impl Iterator<Item = &'a Formula>,
        options: &Options,
    ) -> Result<Vec<Option<LogError>>, LogError> {
        Ok(match self {
            Contents::Files(files) => {
                let log = OpenLog::open(files, options)?;
                formulas.map(|formula| log.check_signals(formula).err()).collect()
            }
            Contents::Topics(_) => formulas.map(|_| None).collect(),
        })
    }

    /// Returns the signals of the formulas as a log for each run of its clock.
    pub(crate) fn runs<'a>(
        self,
        name: &str,
        formulas: impl IntoIterator<Item = &'a Formula> + Clone,
        options: &Options,
    ) -> Result<Vec<NamedSamples>, LogError> {
        let runs = match self {
            Contents::Files(files) => OpenLog::open(&files, options)?.samples_of_runs(formulas, options),
            Contents::Topics(log) => log.read_by(formulas)?.samples_of_runs(options),
        };
        Ok(NamedSamples::of_runs(name, runs?))
    }

    /// Returns the signals of a formula; the log must be one run.
    fn samples(self, formula: &Formula, options: &Options) -> Result<Samples, LogError> {
        match self {
            Contents::Files(files) => {
                let log = OpenLog::open(&files, options)?;
                log.check_signals(formula)?;
                log.read(&formula.signals())?.samples(options)
            }
            Contents::Topics(log) => log.read_by([formula])?.samples(options),
        }
    }
}

/// Returns times in memory. The integers of the kind `log` are nanoseconds of a log that was read.
fn times_of(column: &str, kind: &str, values: &TimeArgument<'_>, options: &Options) -> PyResult<Times> {
    let found = match values {
        TimeArgument::Integers(values) => {
            let values = values.as_array().to_vec();
            match kind {
                "log" => Ok(Times::nanoseconds(column, &values)),
                "instants" => Times::of_values(column, TimeValues::Instants(&values), options),
                _ => Times::of_values(column, TimeValues::Integers(&values), options),
            }
        }
        TimeArgument::Numbers(values) => {
            Times::of_values(column, TimeValues::Numbers(&values.as_array().to_vec()), options)
        }
        TimeArgument::Texts(values) => Times::of_values(column, TimeValues::Texts(values), options),
    };
    found.map_err(plain)
}

/// Returns the document of the verdicts of formulas on logs, its text, and why others have no
/// verdict. Each log comes with the formulas whose signals it can have.
#[pyfunction]
pub fn monitor(
    py: Python<'_>,
    formulas: Vec<(Option<String>, Py<PyFormula>)>,
    logs: Vec<(LogArgument<'_>, Vec<usize>)>,
    call: &str,
) -> PyResult<(String, String, Vec<String>)> {
    let Settings { log: settings, monitor: MonitorSettings { values, .. }, .. } = settings(call)?;
    let LogSettings { unit, strict_horizon, .. } = settings;
    let options = settings.options().map_err(raised)?;
    if values && logs.len() > 1 {
        return Err(InvalidValueError::new_err("plan[\"monitor\"][\"values\"] is about one log; pass one"));
    }
    let requirement = |(name, formula): (Option<String>, Py<PyFormula>)| {
        let formula = formula.get().formula.clone();
        let traps = start_traps(&formula).iter().map(FormulaTrap::at_start).collect();
        let certainty = certainty(&formula);
        Requirement {
            name,
            formula,
            severity: Severity::Error,
            unit,
            description: None,
            units: BTreeMap::new(),
            traps,
            certainty,
        }
    };
    let requirements: Vec<Requirement> = formulas.into_iter().map(requirement).collect();
    let mut names: Vec<String> = logs.iter().map(|((name, ..), _)| name.clone()).collect();
    mishandle_logs::tell_apart(&mut names);
    let mut count = 0;
    let mut verdicts = Vec::new();
    let mut signal = None;
    let mut without = Vec::new();
    for (name, ((_, files, topics), stated)) in names.into_iter().zip(logs) {
        let named = |error: LogError| InvalidValueError::new_err(format!("trace {name}: {}", worded(&error)));
        let contents = Contents::new(files, topics, &options)?;
        let mut asked: Vec<&Requirement> =
            stated.iter().filter_map(|index| requirements.get(*index)).collect();
        let formulas = || asked.iter().map(|requirement| &requirement.formula);
        // Each formula has a verdict of its own.
        let errors = py.detach(|| contents.errors(formulas(), &options)).map_err(named)?;
        let mut lacking: Vec<(&Requirement, LogError)> = Vec::new();
        let mut found = errors.into_iter();
        asked.retain(|requirement| match found.next().flatten() {
            Some(error) => {
                lacking.push((requirement, error));
                false
            }
            None => true,
        });
        let formulas = || asked.iter().map(|requirement| &requirement.formula);
        if asked.is_empty()
            && let Some((_, error)) = lacking.pop()
        {
            return Err(named(error));
        }
        let runs = py.detach(|| contents.runs(&name, formulas(), &options)).map_err(named)?;
        count += runs.len();
        let first = verdicts.len();
        for (log, requirement) in runs.iter().flat_map(|log| asked.iter().map(move |asked| (log, *asked))) {
            match py.detach(|| log.verdict(requirement, strict_horizon)) {
                Ok(verdict) => verdicts.push(verdict),
                Err(error) => lacking.push((requirement, error)),
            }
        }
        if verdicts.len() == first
            && let Some((_, error)) = lacking.pop()
        {
            return Err(named(error));
        }
        without
            .extend(lacking.iter().map(|(requirement, error)| requirement.no_verdict(&name, worded(error))));
        if values {
            let first = &requirements[0];
            let evaluation = Evaluation { unit: first.unit, strict_horizon };
            let [log] = &runs[..] else {
                return Err(InvalidValueError::new_err(format!(
                    "trace {name}: plan[\"monitor\"][\"values\"] is about one log, and its times start again; cut it into its runs"
                )));
            };
            signal = Some(log.samples.robustness_signal(&first.formula, &evaluation).map_err(named)?);
        }
    }
    let text = |found: &NoVerdict| {
        format!("trace {}, {}: {}", found.log, found.name.as_ref().unwrap_or(&found.formula), found.reason)
    };
    let texts = without.iter().map(text).collect();
    let found = mishandle_logs::document(verdicts, without, count, strict_horizon, signal);
    Ok((json(&found)?, mishandle_cli::verdict_text(&mishandle::verdict::monitor(&found, count)), texts))
}

/// Returns the robustness of a formula at the first time of a log; `None` if `decided_only` and
/// windows reach past its end.
#[pyfunction]
pub fn log_robustness(
    py: Python<'_>,
    formula: &PyFormula,
    log: LogArgument<'_>,
    call: &str,
    decided_only: bool,
) -> PyResult<Option<f64>> {
    let (name, files, topics) = log;
    let options = settings(call)?.log.options().map_err(raised)?;
    let formula = &formula.formula;
    let contents = Contents::new(files, topics, &options)?;
    let named = |error: LogError| match name.as_str() {
        "" => plain(error),
        name => InvalidValueError::new_err(format!("trace {name}: {}", worded(&error))),
    };
    let found = py.detach(|| first_value(&contents.samples(formula, &options)?, formula, decided_only));
    found.map_err(named)
}

/// Returns the robustness at the first time; `None` if `decided_only` and a window reaches past the
/// end.
fn first_value(samples: &Samples, formula: &Formula, decided_only: bool) -> Result<Option<f64>, LogError> {
    match &samples.signals {
        // The error says what the log lacks.
        Signals::Even { period: None, .. } if formula.needs_period(false) => {
            let found = samples.robustness_signal(formula, &Evaluation::default())?;
            Ok(found.first().map(|(_, value)| *value))
        }
        Signals::Even { trace, period, .. } => {
            let clock = period.map_or(Clock::unknown(), Clock::steps);
            let mut monitor = Monitor::new(formula, trace.names(), clock)?;
            if decided_only {
                Ok(monitor.decided_robustness_signal(trace)?.first().copied())
            } else {
                Ok(Some(monitor.robustness(trace)?))
            }
        }
        Signals::Dense(signals) => {
            let names: Vec<String> = signals.iter().map(|signal| signal.name().to_owned()).collect();
            let monitor = DenseMonitor::new(formula, &names, None)?;
            if decided_only {
                Ok(monitor.decided_robustness_signal(signals)?.first())
            } else {
                Ok(Some(monitor.robustness(signals)?))
            }
        }
    }
}

/// Reads all columns of numbers of a file, and says why others are none.
#[pyfunction]
pub fn read_table<'py>(py: Python<'py>, path: PathBuf, call: &str) -> PyResult<TableTopics<'py>> {
    let options = settings(call)?.log.options().map_err(raised)?;
    let source = Source { topic: None, path };
    let shown = source.path.display().to_string();
    let named = |error: LogError| InvalidValueError::new_err(format!("{shown}: {}", worded(&error)));
    let read = || OpenLog::open(&[source], &options)?.read_all();
    let (log, left_out) = py.detach(read).map_err(named)?;
    let mut topics = Vec::new();
    for Topic { name, times, columns, .. } in log.topics {
        let times = times.map(|times| times.to_nanoseconds()).transpose().map_err(named)?;
        let columns = columns.into_iter().map(|Column { name, values }| (name, values.into_pyarray(py)));
        topics.push((name, times.map(|times| times.into_pyarray(py)), columns.collect()));
    }
    Ok((topics, left_out.into_iter().collect()))
}
