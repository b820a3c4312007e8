//! Simulations and trials as rows: columns, hashes, and checks before writing.

use std::path::Path;

use rusqlite::types::ValueRef;
use rusqlite::{Connection, Row, params};

use crate::digest::Digest;
use crate::error::{InFile, StoreError};
use crate::{Result, RunHeader, Simulation, SimulationEnd, TrialRecord, TrialStatus, json};

/// The columns of a simulation, in the order in which [`insert`] and [`read`] take them.
pub(crate) const COLUMNS: &str = "trial, number, seed, scenario, unit_point, robustness, violated, robustness_low, \
     robustness_high, stop_threshold, ended, end_step, end_index, steps, verdicts, trace_digest, row_hash";

/// [`Counts`](crate::Counts) as SQL, for a row of `simulation` or for none.
pub(crate) const COUNTS: &str = "count(simulation.number) AS simulations,
    count(*) FILTER (WHERE violated) AS falsified,
    count(*) FILTER (WHERE simulation.number IS NOT NULL AND robustness IS NULL) AS undecided,
    count(*) FILTER (WHERE ended = 'diverged') AS diverged,
    count(*) FILTER (WHERE end_index IS NOT NULL) AS invalid";

const STATUSES: [(TrialStatus, &str); 4] = [
    (TrialStatus::Running, "running"),
    (TrialStatus::Falsified, "falsified"),
    (TrialStatus::BudgetSpent, "budget spent"),
    (TrialStatus::Converged, "converged"),
];

pub(crate) fn status_text(status: TrialStatus) -> &'static str {
    STATUSES.iter().find(|(known, _)| *known == status).map_or("", |(_, text)| text)
}

fn status_from_text(text: &str) -> Option<TrialStatus> {
    STATUSES.iter().find(|(_, known)| *known == text).map(|(status, _)| *status)
}

/// An end as it is stored: its name, its control step and the index of an invalid value.
pub(crate) type EndColumns = (&'static str, Option<u32>, Option<u32>);

pub(crate) fn end_columns(end: SimulationEnd) -> EndColumns {
    use SimulationEnd as End;
    match end {
        End::Completed => ("completed", None, None),
        End::Terminated { step } => ("terminated", Some(step), None),
        End::Stopped { step } => ("stopped", Some(step), None),
        End::Diverged { step } => ("diverged", Some(step), None),
        End::Undefined { step } => ("undefined", Some(step), None),
        End::InvalidAction { step, index } => ("invalid action", Some(step), Some(index)),
        End::InvalidObservation { step, index } => ("invalid observation", Some(step), Some(index)),
        End::InvalidReward { step, index } => ("invalid reward", Some(step), Some(index)),
        End::InvalidSignal { step, index } => ("invalid signal", Some(step), Some(index)),
        End::InvalidScenario => ("invalid scenario", None, None),
        End::Crashed { step } => ("crashed", Some(step), None),
        End::TimedOut { step } => ("timed out", Some(step), None),
    }
}

pub(crate) fn end_from_columns(text: &str, step: Option<u32>, index: Option<u32>) -> Option<SimulationEnd> {
    use SimulationEnd as End;
    let end = match (text, step, index) {
        ("completed", None, None) => End::Completed,
        ("terminated", Some(step), None) => End::Terminated { step },
        ("stopped", Some(step), None) => End::Stopped { step },
        ("diverged", Some(step), None) => End::Diverged { step },
        ("undefined", Some(step), None) => End::Undefined { step },
        ("invalid action", Some(step), Some(index)) => End::InvalidAction { step, index },
        ("invalid observation", Some(step), Some(index)) => End::InvalidObservation { step, index },
        ("invalid reward", Some(step), Some(index)) => End::InvalidReward { step, index },
        ("invalid signal", Some(step), Some(index)) => End::InvalidSignal { step, index },
        ("invalid scenario", None, None) => End::InvalidScenario,
        ("crashed", Some(step), None) => End::Crashed { step },
        ("timed out", Some(step), None) => End::TimedOut { step },
        _ => return None,
    };
    Some(end)
}

/// Feeds all fields of a simulation, so that a change of any field is detected. The digest
/// represents the trace.
pub(crate) fn feed(digest: &mut Digest, simulation: &Simulation, trace_digest: Option<u128>) {
    let Simulation {
        trial,
        number,
        seed,
        unit_point,
        scenario,
        robustness,
        robustness_low,
        robustness_high,
        stop_threshold,
        end,
        steps,
        verdicts,
        reason: _,
        trace_digest: _,
        trace: _,
    } = simulation;
    let (end, end_step, end_index) = end_columns(*end);
    digest.integer(u64::from(*trial));
    digest.integer(u64::from(*number));
    digest.integer(*seed);
    digest.floats(unit_point);
    digest.optionals(scenario);
    for value in [robustness, robustness_low, robustness_high, stop_threshold] {
        digest.optional(*value);
    }
    digest.text(end);
    digest.integer(end_step.map_or(0, u64::from));
    digest.integer(u64::from(*steps));
    digest.optionals(verdicts);
    digest.integer(trace_digest.is_some().into());
    let trace_digest = trace_digest.unwrap_or(0);
    digest.integer(trace_digest as u64);
    digest.integer((trace_digest >> 64) as u64);
    // An index of 0 is not fed. This is part of the format.
    if let Some(index) = end_index.filter(|&index| index > 0) {
        digest.integer(u64::from(index));
    }
}

fn hash(simulation: &Simulation, trace_digest: Option<u128>) -> i64 {
    let mut digest = Digest::of("simulation");
    feed(&mut digest, simulation, trace_digest);
    digest.finish_row()
}

/// Feeds all fields of a trial.
pub(crate) fn feed_trial(digest: &mut Digest, trial: &TrialRecord) {
    let TrialRecord { number, seed, status } = *trial;
    digest.integer(u64::from(number));
    digest.integer(seed);
    digest.text(status_text(status));
}

pub(crate) fn trial_hash(trial: &TrialRecord) -> i64 {
    let mut digest = Digest::of("trial");
    feed_trial(&mut digest, trial);
    digest.finish_row()
}

/// Inserts a trial.
pub(crate) fn insert_trial(connection: &Connection, trial: &TrialRecord) -> rusqlite::Result<usize> {
    let sql = "INSERT INTO trial (number, seed, status, row_hash) VALUES (?1, ?2, ?3, ?4)";
    connection.prepare_cached(sql)?.execute(params![
        trial.number,
        trial.seed.to_string(),
        status_text(trial.status),
        trial_hash(trial)
    ])
}

/// Reads a trial from a row of number, seed, status and hash, and checks the hash.
pub(crate) fn read_trial(row: &Row<'_>, path: &Path) -> Result<TrialRecord> {
    let number = row.get(0).in_file(path)?;
    let damaged = |what: &str| StoreError::damaged(path, format!("trial {number}: {what}"));
    let text = |column| row.get_ref(column).in_file(path).map(|value| value.as_str().unwrap_or_default());
    let seed: u64 = text(1)?.parse().map_err(|_| damaged("its seed is not a number"))?;
    if seed.to_string() != text(1)? {
        return Err(damaged("the text of its seed was changed"));
    }
    let status = status_from_text(text(2)?).ok_or_else(|| damaged("its status is unknown"))?;
    let trial = TrialRecord { number, seed, status };
    if trial_hash(&trial) != row.get::<_, i64>(3).in_file(path)? {
        return Err(damaged("it does not match its hash"));
    }
    Ok(trial)
}

/// Checks that a simulation fits the run's header and that its values are valid.
pub(crate) fn guard(simulation: &Simulation, header: &RunHeader) -> Result<()> {
    let trial = simulation.trial;
    let number = simulation.number;
    if number < 1 {
        return Err(StoreError::SimulationZero { trial });
    }
    let length = |list, found: usize, expected: usize| {
        if found == expected {
            Ok(())
        } else {
            Err(StoreError::WrongLength { list, trial, number, found, expected })
        }
    };
    let axes = header.axes.len();
    length("scenario", simulation.scenario.len(), axes)?;
    if !simulation.unit_point.is_empty() {
        length("unit point", simulation.unit_point.len(), axes)?;
    }
    length("list of verdicts", simulation.verdicts.len(), header.verdicts.len())?;
    if let Some(trace) = &simulation.trace {
        if trace.is_too_large() {
            return Err(StoreError::TraceTooLarge { trial, number, samples: trace.samples() });
        }
        length("trace", trace.columns.len(), header.signals.len())?;
        for (signal, column) in header.signals.iter().zip(&trace.columns) {
            let found = column.len();
            let expected = trace.samples();
            if found != expected {
                let signal = signal.name.clone();
                let first = header.signals[0].name.clone();
                return Err(StoreError::RaggedTrace { trial, number, signal, found, first, expected });
            }
        }
    }
    let bad = |what, value| Err(StoreError::NotANumber { what, trial, number, value });
    for (axis, value) in header.axes.iter().zip(&simulation.scenario) {
        if let Some(value) = value.filter(|value| !value.is_finite()) {
            return bad(format!("scenario value of axis `{}`", axis.name), value);
        }
    }
    for (axis, &value) in header.axes.iter().zip(&simulation.unit_point) {
        if !value.is_finite() {
            return bad(format!("unit point value of axis `{}`", axis.name), value);
        }
    }
    for (name, verdict) in header.verdicts.iter().zip(&simulation.verdicts) {
        if let Some(value) = verdict.filter(|value| value.is_nan()) {
            return bad(format!("verdict `{name}`"), value);
        }
    }
    for (what, value) in [
        ("robustness", simulation.robustness),
        ("lower bound of the robustness", simulation.robustness_low),
        ("upper bound of the robustness", simulation.robustness_high),
        ("stop threshold", simulation.stop_threshold),
    ] {
        if let Some(value) = value.filter(|value| value.is_nan()) {
            return bad(what.into(), value);
        }
    }
    Ok(())
}

/// Inserts a simulation without its trace. [`guard`] has checked it, and `trace_digest` is the
/// digest of its trace.
pub(crate) fn insert(
    connection: &Connection,
    header: &RunHeader,
    simulation: &Simulation,
    trace_digest: Option<u128>,
) -> rusqlite::Result<usize> {
    let sql = format!(
        "INSERT INTO simulation ({COLUMNS})
         VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12, ?13, ?14, ?15, ?16, ?17)"
    );
    let (ended, end_step, end_index) = end_columns(simulation.end);
    let unwritable = |error: serde_json::Error| rusqlite::Error::ToSqlConversionFailure(error.into());
    let hash = hash(simulation, trace_digest);
    let [seed, scenario, unit_point, verdicts, trace_digest] =
        texts(simulation, trace_digest, header).map_err(unwritable)?;
    connection.prepare_cached(&sql)?.execute(params![
        simulation.trial,
        simulation.number,
        seed,
        scenario,
        unit_point,
        simulation.robustness,
        violated(simulation),
        simulation.robustness_low,
        simulation.robustness_high,
        simulation.stop_threshold,
        ended,
        end_step,
        end_index,
        simulation.steps,
        verdicts,
        trace_digest,
        hash,
    ])
}

/// Reads a simulation without its trace from a row of [`COLUMNS`], and checks its hash.
pub(crate) fn read(row: &Row<'_>, path: &Path, header: &RunHeader) -> Result<Simulation> {
    let trial: u32 = row.get(0).in_file(path)?;
    let number: u32 = row.get(1).in_file(path)?;
    let damaged =
        |what: &str| StoreError::damaged(path, format!("simulation {number} of trial {trial}: {what}"));
    let text = |column| row.get_ref(column).in_file(path).map(|value| value.as_str().ok());
    let unit_point = match text(4)? {
        None => Vec::new(),
        Some(text) => json::parse_array(text).ok_or_else(|| damaged("its unit point is unreadable"))?,
    };
    let scenario = json::parse_object(text(3)?.unwrap_or_default(), axis_names(header));
    let verdicts = text(14)?.unwrap_or_default();
    let verdicts = json::parse_object(verdicts, header.verdicts.iter().map(String::as_str));
    let trace_digest = text(15)?.map(|text| u128::from_str_radix(text, 16)).transpose();
    let end_step = row.get(11).in_file(path)?;
    let end_index = row.get(12).in_file(path)?;
    let end = end_from_columns(text(10)?.unwrap_or_default(), end_step, end_index);
    let simulation = Simulation {
        trial,
        number,
        seed: text(2)?.and_then(|text| text.parse().ok()).ok_or_else(|| damaged("its seed is unreadable"))?,
        unit_point,
        scenario: scenario.ok_or_else(|| damaged("its scenario is unreadable"))?,
        robustness: row.get(5).in_file(path)?,
        robustness_low: row.get(7).in_file(path)?,
        robustness_high: row.get(8).in_file(path)?,
        stop_threshold: row.get(9).in_file(path)?,
        end: end.ok_or_else(|| damaged("its end is unknown"))?,
        steps: row.get(13).in_file(path)?,
        verdicts: verdicts.ok_or_else(|| damaged("its verdicts are unreadable"))?,
        reason: String::new(),
        trace_digest: trace_digest.map_err(|_| damaged("its trace digest is unreadable"))?,
        trace: None,
    };
    if hash(&simulation, simulation.trace_digest) != row.get::<_, i64>(16).in_file(path)? {
        return Err(damaged("it does not match its hash"));
    }
    if row.get::<_, Option<bool>>(6).in_file(path)? != violated(&simulation) {
        return Err(damaged("its verdict contradicts its robustness"));
    }
    // The hash is not a secret, so the values of a forged row can be out of their ranges.
    guard(&simulation, header).map_err(|error| damaged(&error.to_string()))?;
    // The hash covers the values. Another text of the same value means that a cell was changed.
    let written =
        texts(&simulation, simulation.trace_digest, header).map_err(|error| damaged(&error.to_string()))?;
    for (column, expected) in TEXT_COLUMNS.into_iter().zip(&written) {
        let found = row.get_ref(column).in_file(path)?;
        let is_same = match expected {
            Some(text) => found.as_str() == Ok(text),
            None => found == ValueRef::Null,
        };
        if !is_same {
            return Err(damaged("the text of a value was changed"));
        }
    }
    Ok(simulation)
}

/// Returns the verdict as it is stored beside the robustness, for readers who do not know the sign
/// of a zero.
fn violated(simulation: &Simulation) -> Option<bool> {
    simulation.robustness.map(|_| simulation.is_violated())
}

/// Columns of [`COLUMNS`] that contain a value as text, in the order of [`texts`].
const TEXT_COLUMNS: [usize; 5] = [2, 3, 4, 14, 15];

/// Returns seed, scenario, unit point, verdicts and trace digest as they are stored.
fn texts(
    simulation: &Simulation,
    trace_digest: Option<u128>,
    header: &RunHeader,
) -> serde_json::Result<[Option<String>; 5]> {
    let unit_point = match &simulation.unit_point[..] {
        [] => None,
        values => Some(json::array(values)?),
    };
    let verdict_names = header.verdicts.iter().map(String::as_str);
    Ok([
        Some(simulation.seed.to_string()),
        Some(json::object(axis_names(header), &simulation.scenario)?),
        unit_point,
        Some(json::object(verdict_names, &simulation.verdicts)?),
        trace_digest.map(|digest| format!("{digest:032x}")),
    ])
}

fn axis_names(header: &RunHeader) -> impl ExactSizeIterator<Item = &str> {
    header.axes.iter().map(|axis| axis.name.as_str())
}
