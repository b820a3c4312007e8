//! A simulation and a trial as rows: their columns, their hash, and the guards on the way in.

use std::path::Path;

use rusqlite::{CachedStatement, Row, params};

use crate::digest::Digest;
use crate::error::{InFile, StoreError};
use crate::{End, Result, RunHeader, Simulation, SimulationRecord, Trial, TrialStatus};

/// The columns of a simulation, in the order in which [`insert`] and [`read`] take them.
pub(crate) const COLUMNS: &str = "trial, number, seed, robustness, ended, end_step, steps, unit_point, \
     initial_configuration, verdicts, trace_digest, row_hash";

/// Stands for `None` among the verdicts; a verdict that is NaN is refused, so that no other meaning is lost.
const ABSENT: u64 = 0x7ff8_0000_0000_0000;

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

/// The word for an end, and its step.
pub(crate) fn end_text(end: End) -> (&'static str, Option<u32>) {
    match end {
        End::Horizon => ("horizon", None),
        End::Stopped { step } => ("stopped", Some(step)),
        End::Diverged { step } => ("diverged", Some(step)),
        End::Undefined { step } => ("undefined", Some(step)),
    }
}

fn end_from_text(text: &str, step: Option<u32>) -> Option<End> {
    match (text, step) {
        ("horizon", None) => Some(End::Horizon),
        ("stopped", Some(step)) => Some(End::Stopped { step }),
        ("diverged", Some(step)) => Some(End::Diverged { step }),
        ("undefined", Some(step)) => Some(End::Undefined { step }),
        _ => None,
    }
}

/// Feeds all of a simulation, so that no field can change unseen.
pub(crate) fn feed(digest: &mut Digest, simulation: &Simulation) {
    let Simulation {
        trial,
        number,
        seed,
        unit_point,
        initial_configuration,
        robustness,
        end,
        steps,
        verdicts,
        trace_digest,
    } = simulation;
    let (end, end_step) = end_text(*end);
    digest.integer(u64::from(*trial));
    digest.integer(u64::from(*number));
    digest.integer(*seed);
    digest.floats(unit_point);
    digest.floats(initial_configuration);
    digest.optional(*robustness);
    digest.text(end);
    digest.integer(end_step.map_or(0, u64::from));
    digest.integer(u64::from(*steps));
    digest.integer(verdicts.len() as u64);
    verdicts.iter().for_each(|&verdict| digest.optional(verdict));
    digest.integer(trace_digest.is_some().into());
    let trace_digest = trace_digest.unwrap_or(0);
    digest.integer(trace_digest as u64);
    digest.integer((trace_digest >> 64) as u64);
}

fn hash(simulation: &Simulation) -> i64 {
    let mut digest = Digest::of("simulation");
    feed(&mut digest, simulation);
    digest.finish_row()
}

/// Feeds all of a trial.
pub(crate) fn feed_trial(digest: &mut Digest, trial: &Trial) {
    let Trial { number, seed, status } = *trial;
    digest.integer(u64::from(number));
    digest.integer(seed);
    digest.text(status_text(status));
}

pub(crate) fn trial_hash(trial: &Trial) -> i64 {
    let mut digest = Digest::of("trial");
    feed_trial(&mut digest, trial);
    digest.finish_row()
}

/// Reads a trial from its number, seed, status and hash, and compares the hash.
pub(crate) fn read_trial(row: &Row<'_>, path: &Path) -> Result<Trial> {
    let number = row.get(0).in_file(path)?;
    let damaged = |what: &str| StoreError::damaged(path, format!("trial {number}: {what}"));
    let status = row.get_ref(2).in_file(path)?.as_str().ok().and_then(status_from_text);
    let status = status.ok_or_else(|| damaged("its status is unknown"))?;
    let trial = Trial { number, seed: row.get::<_, i64>(1).in_file(path)?.cast_unsigned(), status };
    if trial_hash(&trial) != row.get::<_, i64>(3).in_file(path)? {
        return Err(damaged("it does not match its hash"));
    }
    Ok(trial)
}

/// Refuses a record that does not fit the run's header or holds a number that means nothing.
pub(crate) fn guard(record: &SimulationRecord, header: &RunHeader) -> Result<()> {
    let simulation = &record.simulation;
    let (trial, number) = (simulation.trial, simulation.number);
    if number < 1 {
        return Err(StoreError::NumberedFromOne { trial });
    }
    let length = |list, found: usize, expected: usize| {
        if found == expected {
            Ok(())
        } else {
            Err(StoreError::WrongLength { list, trial, number, found, expected })
        }
    };
    let axes = header.axes.len();
    length("initial configuration", simulation.initial_configuration.len(), axes)?;
    if !simulation.unit_point.is_empty() {
        length("unit point", simulation.unit_point.len(), axes)?;
    }
    length("list of verdicts", simulation.verdicts.len(), header.verdicts.len())?;
    if let Some(trace) = &record.trace {
        length("trace", trace.columns.len(), header.signals.len())?;
        for (signal, column) in header.signals.iter().zip(&trace.columns) {
            let (found, expected) = (column.len(), trace.samples());
            if found != expected {
                let (signal, first) = (signal.clone(), header.signals[0].clone());
                return Err(StoreError::RaggedTrace { trial, number, signal, found, first, expected });
            }
        }
    }
    let bad = |what: &str, name: &str, value| {
        let what = if name.is_empty() { what.into() } else { format!("{what} `{name}`") };
        Err(StoreError::NotANumber { what, trial, number, value })
    };
    for (axis, &value) in header.axes.iter().zip(&simulation.initial_configuration) {
        if !value.is_finite() {
            return bad("initial configuration's axis", &axis.name, value);
        }
    }
    for (axis, &value) in header.axes.iter().zip(&simulation.unit_point) {
        if !value.is_finite() {
            return bad("unit point's axis", &axis.name, value);
        }
    }
    for (name, &verdict) in header.verdicts.iter().zip(&simulation.verdicts) {
        if let Some(value) = verdict.filter(|value| value.is_nan()) {
            return bad("verdict", name, value);
        }
    }
    match simulation.robustness {
        Some(value) if value.is_nan() => bad("robustness", "", value),
        _ => Ok(()),
    }
}

/// Inserts a simulation.
pub(crate) fn insert(
    statement: &mut CachedStatement<'_>,
    simulation: &Simulation,
) -> rusqlite::Result<usize> {
    let (ended, end_step) = end_text(simulation.end);
    let verdicts = simulation.verdicts.iter().map(|verdict| verdict.map_or(ABSENT, f64::to_bits));
    statement.execute(params![
        simulation.trial,
        simulation.number,
        simulation.seed.cast_signed(),
        simulation.robustness,
        ended,
        end_step,
        simulation.steps,
        bytes(simulation.unit_point.iter().map(|value| value.to_bits())),
        bytes(simulation.initial_configuration.iter().map(|value| value.to_bits())),
        bytes(verdicts),
        simulation.trace_digest.map(u128::to_be_bytes),
        hash(simulation),
    ])
}

/// Reads a simulation from a row of [`COLUMNS`] and compares its hash.
pub(crate) fn read(row: &Row<'_>, path: &Path) -> Result<Simulation> {
    let (trial, number): (u32, u32) = (row.get(0).in_file(path)?, row.get(1).in_file(path)?);
    let damaged =
        |what: &str| StoreError::damaged(path, format!("simulation {number} of trial {trial}: {what}"));
    let words = |column| -> Result<Vec<u64>> {
        let blob =
            row.get_ref(column).in_file(path)?.as_blob().map_err(|_| damaged("a list is not a blob"))?;
        words(blob).ok_or_else(|| damaged("a list of doubles has a broken length"))
    };
    let floats = |column| Ok(words(column)?.into_iter().map(f64::from_bits).collect());
    let ended = row.get_ref(4).in_file(path)?.as_str().map_err(|_| damaged("its end is not a text"))?;
    let end_step = row.get(5).in_file(path)?;
    let simulation = Simulation {
        trial,
        number,
        seed: row.get::<_, i64>(2).in_file(path)?.cast_unsigned(),
        robustness: row.get(3).in_file(path)?,
        end: end_from_text(ended, end_step).ok_or_else(|| damaged("its end is unknown"))?,
        steps: row.get(6).in_file(path)?,
        unit_point: floats(7)?,
        initial_configuration: floats(8)?,
        verdicts: words(9)?.into_iter().map(|bits| (bits != ABSENT).then(|| f64::from_bits(bits))).collect(),
        trace_digest: row.get::<_, Option<[u8; 16]>>(10).in_file(path)?.map(u128::from_be_bytes),
    };
    if hash(&simulation) != row.get::<_, i64>(11).in_file(path)? {
        return Err(damaged("it does not match its hash"));
    }
    Ok(simulation)
}

fn bytes(words: impl ExactSizeIterator<Item = u64>) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(words.len() * 8);
    words.for_each(|word| bytes.extend(word.to_le_bytes()));
    bytes
}

fn words(bytes: &[u8]) -> Option<Vec<u64>> {
    let (words, rest) = bytes.as_chunks::<8>();
    rest.is_empty().then(|| words.iter().map(|&word| u64::from_le_bytes(word)).collect())
}
