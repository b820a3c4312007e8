//! The header as rows: single values by key, and a table for each list.

use std::path::Path;

use rusqlite::types::{FromSql, Value};
use rusqlite::{Connection, params};

use crate::digest::Digest;
use crate::error::{InFile, StoreError};
use crate::{Axis, Build, Result, RunHeader, RunKind};

const HASH: &str = "header_hash";

const KINDS: [(RunKind, &str); 2] = [(RunKind::Falsify, "falsify"), (RunKind::Evaluate, "evaluate")];

fn kind_text(kind: RunKind) -> &'static str {
    KINDS.iter().find(|(known, _)| *known == kind).map_or("", |(_, text)| text)
}

/// Refuses a header that a reader could not make sense of.
pub(crate) fn guard(header: &RunHeader) -> Result<()> {
    let bad = |what| Err(StoreError::BadHeader { what });
    if !(header.control_dt > 0.0 && header.control_dt.is_finite()) {
        return bad(format!("its control period is {} s, it must be above 0 and finite", header.control_dt));
    }
    if let Some(axis) = header.axes.iter().find(|axis| !(axis.low.is_finite() && axis.high.is_finite())) {
        return bad(format!(
            "axis `{}` has the bounds {} and {}, they must be finite",
            axis.name, axis.low, axis.high
        ));
    }
    let axes: Vec<&str> = header.axes.iter().map(|axis| axis.name.as_str()).collect();
    let signals: Vec<&str> = header.signals.iter().map(String::as_str).collect();
    let verdicts: Vec<&str> = header.verdicts.iter().map(String::as_str).collect();
    for (list, mut names) in [("signals", signals), ("axes", axes), ("verdicts", verdicts)] {
        names.sort_unstable();
        if let Some([name, _]) = names.array_windows().find(|[a, b]| a == b) {
            return bad(format!("two of its {list} have the name `{name}`, each must have its own"));
        }
    }
    Ok(())
}

/// The single values, by key.
fn values(header: &RunHeader) -> [(&'static str, Value); 17] {
    let text = |text: &String| Value::from(text.clone());
    [
        ("kind", Value::from(kind_text(header.kind).to_owned())),
        ("program_version", text(&header.build.program_version)),
        ("git_commit", text(&header.build.git_commit)),
        ("target", text(&header.build.target)),
        ("rustc", text(&header.build.rustc)),
        ("mujoco_version", text(&header.build.mujoco_version)),
        ("architecture", text(&header.build.architecture)),
        ("plan", text(&header.plan)),
        ("controller", text(&header.controller)),
        ("controller_hash", text(&header.controller_hash)),
        ("controller_bytes_hash", text(&header.controller_bytes_hash)),
        ("task", text(&header.task)),
        ("preset", text(&header.preset)),
        ("formula", text(&header.formula)),
        ("search", text(&header.search)),
        ("seed", Value::from(header.seed.cast_signed())),
        ("control_dt", Value::from(header.control_dt)),
    ]
}

fn hash(header: &RunHeader) -> i64 {
    let mut digest = Digest::of("header");
    for (key, value) in values(header) {
        digest.text(key);
        match value {
            Value::Text(text) => digest.text(&text),
            Value::Integer(integer) => digest.integer(integer.cast_unsigned()),
            Value::Real(real) => digest.float(real),
            Value::Null | Value::Blob(_) => {}
        }
    }
    for names in [&header.signals, &header.verdicts] {
        digest.integer(names.len() as u64);
        names.iter().for_each(|name| digest.text(name));
    }
    for Axis { name, unit, low, high } in &header.axes {
        digest.text(name);
        digest.text(unit);
        digest.float(*low);
        digest.float(*high);
    }
    digest.finish_row()
}

pub(crate) fn write(connection: &Connection, header: &RunHeader) -> rusqlite::Result<()> {
    let mut insert = connection.prepare("INSERT INTO header (key, value) VALUES (?1, ?2)")?;
    for (key, value) in values(header) {
        insert.execute(params![key, value])?;
    }
    insert.execute(params![HASH, hash(header)])?;
    for (table, names) in [("signal", &header.signals), ("verdict", &header.verdicts)] {
        let mut insert =
            connection.prepare(&format!("INSERT INTO {table} (position, name) VALUES (?1, ?2)"))?;
        for (position, name) in names.iter().enumerate() {
            insert.execute(params![position as i64, name])?;
        }
    }
    let mut insert = connection
        .prepare("INSERT INTO axis (position, name, unit, low, high) VALUES (?1, ?2, ?3, ?4, ?5)")?;
    for (position, axis) in header.axes.iter().enumerate() {
        insert.execute(params![position as i64, axis.name, axis.unit, axis.low, axis.high])?;
    }
    Ok(())
}

pub(crate) fn read(connection: &Connection, path: &Path) -> Result<RunHeader> {
    let kind: String = value(connection, path, "kind")?;
    let text = |key| value::<String>(connection, path, key);
    let header = RunHeader {
        kind: KINDS
            .iter()
            .find(|(_, known)| *known == kind)
            .map(|(kind, _)| *kind)
            .ok_or_else(|| StoreError::damaged(path, format!("its kind is {kind:?}")))?,
        build: Build {
            program_version: text("program_version")?,
            git_commit: text("git_commit")?,
            target: text("target")?,
            rustc: text("rustc")?,
            mujoco_version: text("mujoco_version")?,
            architecture: text("architecture")?,
        },
        plan: text("plan")?,
        controller: text("controller")?,
        controller_hash: text("controller_hash")?,
        controller_bytes_hash: text("controller_bytes_hash")?,
        task: text("task")?,
        preset: text("preset")?,
        formula: text("formula")?,
        search: text("search")?,
        seed: value::<i64>(connection, path, "seed")?.cast_unsigned(),
        control_dt: value(connection, path, "control_dt")?,
        signals: names(connection, "signal").in_file(path)?,
        axes: axes(connection).in_file(path)?,
        verdicts: names(connection, "verdict").in_file(path)?,
    };
    if hash(&header) != value::<i64>(connection, path, HASH)? {
        return Err(StoreError::damaged(path, "the header does not match its hash"));
    }
    Ok(header)
}

fn value<T: FromSql>(connection: &Connection, path: &Path, key: &str) -> Result<T> {
    let value = connection.query_row("SELECT value FROM header WHERE key = ?1", [key], |row| row.get(0));
    value.map_err(|error| match error {
        rusqlite::Error::QueryReturnedNoRows => {
            StoreError::damaged(path, format!("its header lacks `{key}`"))
        }
        error => StoreError::from_sqlite(path, &error),
    })
}

fn names(connection: &Connection, table: &str) -> rusqlite::Result<Vec<String>> {
    let mut select = connection.prepare(&format!("SELECT name FROM {table} ORDER BY position"))?;
    select.query_map([], |row| row.get(0))?.collect()
}

fn axes(connection: &Connection) -> rusqlite::Result<Vec<Axis>> {
    let mut select = connection.prepare("SELECT name, unit, low, high FROM axis ORDER BY position")?;
    select
        .query_map([], |row| {
            Ok(Axis { name: row.get(0)?, unit: row.get(1)?, low: row.get(2)?, high: row.get(3)? })
        })?
        .collect()
}
