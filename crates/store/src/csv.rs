//! Exports simulations and traces of a run as CSV.

use std::io::{self, Write};

use crate::columns::{Field, columns, fields, with_unit};
use crate::{Result, RunFile, RunHeader, StoreError, StoredTrace};

/// Writes all simulations of a run as CSV (RFC 4180): a header, then one line per simulation,
/// ordered by trial and number.
///
/// The columns are `trial`, `simulation`, `seed`, `robustness`, `violated`, `robustness_low`,
/// `robustness_high`, `stop_threshold`, `end`, `end_step`, `end_index`, `steps`; then one column
/// `u_NAME` per axis (the unit point); then one column `NAME_UNIT` per axis (the scenario; the unit
/// `m/s` becomes `m_per_s`); then one column per verdict; then `trace_digest` in hexadecimal.
/// Numbers have enough digits to be read back exactly, infinities are `inf` and `-inf`, and missing
/// values are empty.
///
/// Control characters in names become escapes such as `\n`. Names that start with `=`, `+`, `-` or
/// `@` are written as they are, because programs find columns by their names; import an untrusted
/// file into a spreadsheet as text.
///
/// # Errors
/// [`Write`](StoreError::Write) if `writer` fails, or an error of the run file.
pub fn export_csv(run: &RunFile, writer: &mut impl Write) -> Result<()> {
    let mut writer = io::BufWriter::new(writer);
    let header = run.header();
    line(&mut writer, columns(header).iter().map(|(name, _)| quoted(name))).map_err(failed)?;
    for simulation in run.simulations() {
        line(&mut writer, fields(&simulation?, header.axes.len()).into_iter().map(text)).map_err(failed)?;
    }
    writer.flush().map_err(failed)
}

/// A column that an exported trace has in addition to its signals.
#[derive(Debug, Clone, PartialEq)]
pub struct TraceColumn {
    /// Name.
    pub name: String,
    /// Unit, or empty.
    pub unit: String,
    /// Value at each sample; `None` is missing.
    pub values: Vec<Option<f64>>,
}

/// Writes a trace as CSV (RFC 4180) that `mishandle monitor` reads: a column `time` in seconds,
/// then one column per signal of the header, then one column `NAME_UNIT` for each of `more`; one
/// line per sample.
///
/// # Errors
/// [`Write`](StoreError::Write) if `writer` fails.
pub fn export_trace_csv(
    header: &RunHeader,
    trace: &StoredTrace,
    more: &[TraceColumn],
    writer: &mut impl Write,
) -> Result<()> {
    let mut writer = io::BufWriter::new(writer);
    let signals = header.signals.iter().map(|signal| signal.name.clone());
    let names = std::iter::once("time".to_string())
        .chain(signals)
        .chain(more.iter().map(|column| with_unit(&column.name, &column.unit)));
    line(&mut writer, names.map(|name| quoted(&name))).map_err(failed)?;
    for step in 0..trace.samples() {
        let time = step as f64 * header.control_dt;
        let values = trace.columns.iter().filter_map(|column| column.get(step).copied());
        let more = more.iter().map(|column| column.values.get(step).copied().flatten());
        let fields = std::iter::once(time).chain(values).map(number);
        line(&mut writer, fields.chain(more.map(|value| value.map(number).unwrap_or_default())))
            .map_err(failed)?;
    }
    writer.flush().map_err(failed)
}

fn text(field: Field) -> String {
    match field {
        Field::Integer(value) => value.map(|value| value.to_string()).unwrap_or_default(),
        Field::Number(value) => value.map(number).unwrap_or_default(),
        Field::Text(value) => value.unwrap_or_default(),
    }
}

/// Returns the shortest text that is read back as the same number.
fn number(value: f64) -> String {
    format!("{value:?}")
}

/// Quotes a name. Control characters become visible escapes, because a line break or an escape
/// sequence in a header breaks what reads it line by line or prints it.
fn quoted(name: &str) -> String {
    let name = name.chars().fold(String::with_capacity(name.len()), |mut out, c| {
        if c.is_control() {
            out.extend(c.escape_default());
        } else {
            out.push(c);
        }
        out
    });
    if name.contains(['"', ',']) { format!("\"{}\"", name.replace('"', "\"\"")) } else { name }
}

fn line(writer: &mut impl Write, mut fields: impl Iterator<Item = String>) -> io::Result<()> {
    if let Some(first) = fields.next() {
        write!(writer, "{first}")?;
    }
    for field in fields {
        write!(writer, ",{field}")?;
    }
    writeln!(writer)
}

fn failed(source: io::Error) -> StoreError {
    StoreError::Write { what: "cannot write the CSV".into(), source }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_header_has_one_line_and_prints_safely() {
        assert_eq!(quoted("gap_m"), "gap_m");
        assert_eq!(quoted("a,\"b\""), "\"a,\"\"b\"\"\"");
        assert_eq!(quoted("a\r\nb\u{1b}[2J"), "a\\r\\nb\\u{1b}[2J");
        assert_eq!(quoted("=cmd|'/C calc'!A0"), "=cmd|'/C calc'!A0");
    }
}
