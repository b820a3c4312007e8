//! Storage of the header: a table of single values by key, and one table per list.

use std::path::Path;

use rusqlite::types::{FromSql, Value};
use rusqlite::{Connection, Row, params, params_from_iter};

use crate::digest::Digest;
use crate::error::{InFile, StoreError};
use crate::{
    AxisRecord, BuildRecord, ComponentRecord, FormulaRecord, Result, RunHeader, RunKind, SignalRecord,
    TargetRecord,
};

const HASH: &str = "header_hash";

/// The tables that hold the header's lists, each with its columns.
const LISTS: [(&str, &str); 7] = [
    ("version", "name, version"),
    ("component", "role, name, hash, file_hash"),
    ("formula", "name, text"),
    ("signal", "name, unit"),
    ("axis", "name, unit, kind, low, high, nominal, domain, meaning"),
    ("verdict", "name"),
    ("preflight", "name"),
];

/// Largest text of the table `header`, such as the plan, in bytes.
const MAX_TEXT_BYTES: usize = 1 << 20;

/// Largest number of rows of a list.
const MAX_ROWS: usize = 100_000;

/// Largest size of all texts of a list, in bytes.
const MAX_LIST_BYTES: usize = 16 << 20;

/// Largest name in a list, in bytes. The name of a controller is a path.
const MAX_NAME_BYTES: usize = 4096;

/// Checks a header before it is written.
pub(crate) fn guard(header: &RunHeader) -> Result<()> {
    let bad = |what| Err(StoreError::BadHeader { what });
    let length = |value: &Value| match value {
        Value::Text(text) => text.len(),
        _ => 0,
    };
    if let Some((key, value)) = values(header).iter().find(|(_, value)| length(value) > MAX_TEXT_BYTES) {
        return bad(format!("`{key}` has {} bytes; it must have at most {MAX_TEXT_BYTES}", length(value)));
    }
    for ((list, columns), rows) in LISTS.iter().zip(rows(header)) {
        let name = columns.split(", ").position(|column| column == "name");
        let names = rows.iter().filter_map(|row| row.get(name?));
        if let Some(longest) = names.map(length).max().filter(|longest| *longest > MAX_NAME_BYTES) {
            return bad(format!(
                "its table `{list}` would have a name of {longest} bytes; a name must have at most {MAX_NAME_BYTES}"
            ));
        }
        let bytes = rows.iter().flatten().map(length).sum::<usize>();
        if rows.len() > MAX_ROWS || bytes > MAX_LIST_BYTES {
            return bad(format!(
                "its table `{list}` would have {} rows and {bytes} bytes; it must have at most {MAX_ROWS} rows and \
                 {MAX_LIST_BYTES} bytes",
                rows.len()
            ));
        }
    }
    if !(header.control_dt > 0.0 && header.control_dt.is_finite()) {
        return bad(format!("its control period is {} s; it must be positive and finite", header.control_dt));
    }
    for AxisRecord { name, low, high, nominal, .. } in &header.axes {
        if !(low.is_finite() && high.is_finite()) {
            return bad(format!("axis `{name}` has the bounds {low} and {high}; they must be finite"));
        }
        if let Some(nominal) = nominal.filter(|nominal| !nominal.is_finite()) {
            return bad(format!("axis `{name}` has the nominal value {nominal}; it must be finite"));
        }
    }
    let versions: Vec<&str> = header.versions.iter().map(|(name, _)| name.as_str()).collect();
    let formulas: Vec<&str> = header.formulas.iter().map(|formula| formula.name.as_str()).collect();
    let signals: Vec<&str> = header.signals.iter().map(|signal| signal.name.as_str()).collect();
    let axes: Vec<&str> = header.axes.iter().map(|axis| axis.name.as_str()).collect();
    let verdicts: Vec<&str> = header.verdicts.iter().map(String::as_str).collect();
    for (list, mut names) in [
        ("versions", versions),
        ("formulas", formulas),
        ("signals", signals),
        ("axes", axes),
        ("verdicts", verdicts),
    ] {
        names.sort_unstable();
        if let Some([name, _]) = names.array_windows().find(|[a, b]| a == b) {
            return bad(format!("two of its {list} have the name `{name}`; names must be unique"));
        }
    }
    Ok(())
}

/// Number of keys of the table `header`: the single values and their hash.
const KEYS: i64 = VALUES as i64 + 1;

const VALUES: usize = 17;

/// Returns the single values by key.
fn values(header: &RunHeader) -> [(&'static str, Value); VALUES] {
    [
        ("kind", text(header.kind.name())),
        ("program_version", text(&header.build.program_version)),
        ("git_commit", text(&header.build.git_commit)),
        ("build_target", text(&header.build.target)),
        ("rustc", text(&header.build.rustc)),
        ("architecture", text(&header.build.architecture)),
        ("plan", text(&header.plan)),
        ("target_kind", text(&header.target.kind)),
        ("target_name", text(&header.target.name)),
        ("target_hash", text(&header.target.hash)),
        ("target_is_deterministic", Value::from(header.target.is_deterministic)),
        ("space", text(&header.space)),
        ("formula", text(&header.formula)),
        ("search", text(&header.search)),
        ("seed", text(&header.seed.to_string())),
        ("control_dt", Value::from(header.control_dt)),
        ("episode_steps", Value::from(header.episode_steps)),
    ]
}

/// Returns the rows of each table in [`LISTS`].
fn rows(header: &RunHeader) -> [Vec<Vec<Value>>; LISTS.len()] {
    let version = |(name, version): &(String, String)| vec![text(name), text(version)];
    let component = |component: &ComponentRecord| {
        let ComponentRecord { role, name, hash, file_hash } = component;
        vec![text(role), text(name), text(hash), text(file_hash)]
    };
    let formula = |formula: &FormulaRecord| vec![text(&formula.name), text(&formula.text)];
    let signal = |signal: &SignalRecord| vec![text(&signal.name), text(&signal.unit)];
    let axis = |axis: &AxisRecord| {
        let AxisRecord { name, unit, kind, low, high, nominal, values, meaning } = axis;
        let low = Value::from(*low);
        let high = Value::from(*high);
        let nominal = Value::from(*nominal);
        vec![text(name), text(unit), text(kind), low, high, nominal, text(values), text(meaning)]
    };
    [
        header.versions.iter().map(version).collect(),
        header.components.iter().map(component).collect(),
        header.formulas.iter().map(formula).collect(),
        header.signals.iter().map(signal).collect(),
        header.axes.iter().map(axis).collect(),
        header.verdicts.iter().map(|name| vec![text(name)]).collect(),
        header.preflight.iter().map(|warning| vec![text(warning)]).collect(),
    ]
}

fn text(text: &str) -> Value {
    Value::from(text.to_owned())
}

fn hash(header: &RunHeader) -> i64 {
    let mut digest = Digest::of("header");
    for (key, value) in values(header) {
        digest.text(key);
        feed(&mut digest, &value);
    }
    for ((table, _), rows) in LISTS.iter().zip(rows(header)) {
        digest.text(table);
        digest.integer(rows.len() as u64);
        rows.iter().flatten().for_each(|value| feed(&mut digest, value));
    }
    digest.finish_row()
}

fn feed(digest: &mut Digest, value: &Value) {
    match value {
        Value::Text(text) => digest.text(text),
        Value::Integer(integer) => digest.integer(integer.cast_unsigned()),
        Value::Real(real) => digest.optional(Some(*real)),
        Value::Null | Value::Blob(_) => digest.optional(None),
    }
}

pub(crate) fn write(connection: &Connection, header: &RunHeader) -> rusqlite::Result<()> {
    let mut insert = connection.prepare("INSERT INTO header (key, value) VALUES (?1, ?2)")?;
    for (key, value) in values(header) {
        insert.execute(params![key, value])?;
    }
    insert.execute(params![HASH, hash(header)])?;
    for ((table, columns), rows) in LISTS.iter().zip(rows(header)) {
        let parameters = ", ?".repeat(columns.split(',').count());
        let sql = format!("INSERT INTO {table} (position, {columns}) VALUES (?{parameters})");
        let mut insert = connection.prepare(&sql)?;
        for (position, row) in (0_i64..).zip(rows) {
            insert.execute(params_from_iter(std::iter::once(Value::from(position)).chain(row)))?;
        }
    }
    Ok(())
}

/// Writes the last version of a header that is in the file without it.
pub(crate) fn add_version(connection: &Connection, header: &RunHeader) -> rusqlite::Result<()> {
    let Some(((name, version), position)) = header.versions.last().zip(header.versions.len().checked_sub(1))
    else {
        return Ok(());
    };
    let sql = "INSERT INTO version (position, name, version) VALUES (?1, ?2, ?3)";
    connection.execute(sql, params![position as i64, name, version])?;
    connection.execute("UPDATE header SET value = ?2 WHERE key = ?1", params![HASH, hash(header)])?;
    Ok(())
}

pub(crate) fn read(connection: &Connection, path: &Path) -> Result<RunHeader> {
    check_keys(connection, path)?;
    let kind: String = value(connection, path, "kind")?;
    let text = |key| value::<String>(connection, path, key);
    let seed = text("seed")?;
    let header = RunHeader {
        kind: RunKind::of_name(&kind)
            .ok_or_else(|| StoreError::damaged(path, format!("its kind {kind:?} is unknown")))?,
        build: BuildRecord {
            program_version: text("program_version")?,
            git_commit: text("git_commit")?,
            target: text("build_target")?,
            rustc: text("rustc")?,
            architecture: text("architecture")?,
        },
        versions: list(connection, path, "version", |row| Ok((row.get(0)?, row.get(1)?)))?,
        plan: text("plan")?,
        target: TargetRecord {
            kind: text("target_kind")?,
            name: text("target_name")?,
            hash: text("target_hash")?,
            is_deterministic: match value::<i64>(connection, path, "target_is_deterministic")? {
                0 => false,
                1 => true,
                _ => {
                    return Err(StoreError::damaged(path, "`target_is_deterministic` is neither 0 nor 1"));
                }
            },
        },
        components: list(connection, path, "component", |row| {
            Ok(ComponentRecord {
                role: row.get(0)?,
                name: row.get(1)?,
                hash: row.get(2)?,
                file_hash: row.get(3)?,
            })
        })?,
        space: text("space")?,
        formula: text("formula")?,
        formulas: list(connection, path, "formula", |row| {
            Ok(FormulaRecord { name: row.get(0)?, text: row.get(1)? })
        })?,
        search: text("search")?,
        seed: seed
            .parse()
            .ok()
            .filter(|number: &u64| number.to_string() == seed)
            .ok_or_else(|| StoreError::damaged(path, "its seed is not a number"))?,
        control_dt: value(connection, path, "control_dt")?,
        episode_steps: value(connection, path, "episode_steps")?,
        signals: list(connection, path, "signal", |row| {
            Ok(SignalRecord { name: row.get(0)?, unit: row.get(1)? })
        })?,
        axes: list(connection, path, "axis", |row| {
            Ok(AxisRecord {
                name: row.get(0)?,
                unit: row.get(1)?,
                kind: row.get(2)?,
                low: row.get(3)?,
                high: row.get(4)?,
                nominal: row.get(5)?,
                values: row.get(6)?,
                meaning: row.get(7)?,
            })
        })?,
        verdicts: list(connection, path, "verdict", |row| row.get(0))?,
        preflight: list(connection, path, "preflight", |row| row.get(0))?,
    };
    if hash(&header) != value::<i64>(connection, path, HASH)? {
        return Err(StoreError::damaged(path, "the header does not match its hash"));
    }
    Ok(header)
}

/// Checks that the table `header` has as many keys as this program writes. Each of them is read by
/// name.
fn check_keys(connection: &Connection, path: &Path) -> Result<()> {
    let count = connection.query_row("SELECT count(*) FROM header", [], |row| row.get::<_, i64>(0));
    match count.in_file(path)? {
        KEYS => Ok(()),
        found => Err(StoreError::damaged(path, format!("its header has {found} keys instead of {KEYS}"))),
    }
}

/// Returns the value of a key.
fn value<T: FromSql>(connection: &Connection, path: &Path, key: &str) -> Result<T> {
    // A larger value becomes NULL, which has no type.
    let sql = format!(
        "SELECT CASE WHEN octet_length(value) <= {MAX_TEXT_BYTES} THEN value END FROM header WHERE key = ?1"
    );
    let value = connection.query_row(&sql, [key], |row| row.get(0));
    value.map_err(|error| match error {
        rusqlite::Error::QueryReturnedNoRows => {
            StoreError::damaged(path, format!("its header lacks `{key}`"))
        }
        rusqlite::Error::InvalidColumnType(..) => {
            StoreError::damaged(path, format!("`{key}` of its header has a wrong type or is too large"))
        }
        error => StoreError::from_sqlite(path, &error),
    })
}

/// Reads a table of [`LISTS`], which has the column `name`. Checks its size before it reads a row.
fn list<T>(
    connection: &Connection,
    path: &Path,
    table: &str,
    read: impl FnMut(&Row<'_>) -> rusqlite::Result<T>,
) -> Result<Vec<T>> {
    let columns = LISTS.iter().find(|(known, _)| *known == table).map_or("", |(_, columns)| columns);
    let lengths: Vec<String> =
        columns.split(", ").map(|column| format!("ifnull(octet_length({column}), 0)")).collect();
    let sql = format!(
        "SELECT count(*), ifnull(sum({}), 0), ifnull(max(octet_length(name)), 0) FROM {table}",
        lengths.join(" + ")
    );
    let sizes = connection.query_row(&sql, [], |row| Ok((row.get(0)?, row.get(1)?, row.get(2)?)));
    let (count, bytes, longest): (i64, i64, i64) = sizes.in_file(path)?;
    // Numbers have a few bytes, too.
    if count > MAX_ROWS as i64 || bytes > (MAX_LIST_BYTES + MAX_ROWS * 100) as i64 {
        return Err(StoreError::damaged(path, format!("its table {table} is too large")));
    }
    if longest > MAX_NAME_BYTES as i64 {
        return Err(StoreError::damaged(
            path,
            format!("its table {table} contains a name of {longest} bytes"),
        ));
    }
    let sql = format!("SELECT {columns} FROM {table} ORDER BY position");
    let mut select = connection.prepare(&sql).in_file(path)?;
    let rows = select.query_map([], read).in_file(path)?;
    rows.collect::<rusqlite::Result<_>>().in_file(path)
}
