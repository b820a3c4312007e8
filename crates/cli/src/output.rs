//! Data on stdout, words on stderr.

use std::fs::File;
use std::io::{ErrorKind, IsTerminal, Write};
use std::path::Path;

use anyhow::{Context, Error, Result, bail};
use mishandle::MishandleError;
use mishandle::stl::{Formula, MonitorError};
use serde_json::{Number, Value};

/// Writes a line of data.
pub fn line(text: &str) -> Result<()> {
    writeln!(std::io::stdout().lock(), "{text}")?;
    Ok(())
}

/// Writes a JSON document.
pub fn json(value: &Value) -> Result<()> {
    line(&serde_json::to_string_pretty(value)?)
}

/// Writes a file that is not there yet. If that fails, nothing is left of it.
pub fn write_new(path: &Path, write: impl FnOnce(&mut File) -> Result<()>) -> Result<()> {
    let name = || format!("cannot write {}", path.display());
    let mut file = match File::create_new(path) {
        Err(error) if error.kind() == ErrorKind::AlreadyExists => {
            bail!("{} exists already; give another name", path.display());
        }
        opened => opened.with_context(name)?,
    };
    write(&mut file).and_then(|()| Ok(file.flush()?)).with_context(name).inspect_err(|_| {
        // It was made here and is worth nothing; the first failure is the one to tell.
        let _ = std::fs::remove_file(path);
    })
}

/// A number in JSON; infinities, which JSON lacks, are the strings "inf" and "-inf".
pub fn number(value: f64) -> Value {
    match Number::from_f64(value) {
        Some(number) => Value::Number(number),
        None => Value::String(value.to_string()),
    }
}

/// Says something on stderr.
pub fn say(text: &str) {
    // There is nowhere to report that stderr is closed.
    let _ = writeln!(std::io::stderr().lock(), "{text}");
}

/// Warns of a formula that is hardly ever meant.
pub fn warn_of_chains(formula: &Formula) {
    if formula.chains_comparisons() {
        say(&format!(
            "warning: comparisons are not chained: `0.2 <= v <= 0.3` is `(0.2 <= v) <= 0.3`, as in RTAMT; write \
             `0.2 <= v and v <= 0.3`. The formula is {formula}"
        ));
    }
}

/// Whether stderr is a terminal, where a progress bar can be drawn.
pub fn shows_progress() -> bool {
    std::io::stderr().is_terminal()
}

/// Says what went wrong, from the outside in, and what to try instead.
pub fn report_error(error: &Error) {
    say(&format!("error: {error:#}"));
    let hint = error.chain().find_map(|cause| {
        let ours = cause.downcast_ref::<MishandleError>().and_then(MishandleError::hint);
        ours.or_else(|| cause.downcast_ref::<MonitorError>().and_then(MonitorError::hint))
    });
    if let Some(hint) = hint {
        say(&format!("hint: {hint}"));
    }
}

/// Whether the reader of stdout went away, as `head` does.
pub fn is_broken_pipe(error: &Error) -> bool {
    error
        .chain()
        .filter_map(|cause| cause.downcast_ref::<std::io::Error>())
        .any(|error| error.kind() == ErrorKind::BrokenPipe)
}

/// Lines up the columns of a table; numbers should be formatted already. The first row is the header.
pub fn table(rows: &[Vec<String>]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |column: usize| {
        rows.iter().filter_map(|row| row.get(column)).map(|c| c.chars().count()).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let mut text = String::new();
    for row in rows {
        let cells: Vec<String> =
            row.iter().zip(&widths).map(|(cell, width)| format!("{cell:<width$}")).collect();
        text.push_str(cells.join("  ").trim_end());
        text.push('\n');
    }
    text.truncate(text.trim_end().len());
    text
}

/// Breaks text into lines of at most `width` characters, between words.
pub fn wrapped(text: &str, width: usize) -> String {
    let mut lines = vec![String::new()];
    for word in text.split_whitespace() {
        let line = lines.len() - 1;
        if lines[line].is_empty() {
            lines[line] = word.to_string();
        } else if lines[line].chars().count() + 1 + word.chars().count() <= width {
            lines[line] += &format!(" {word}");
        } else {
            lines.push(word.to_string());
        }
    }
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_as_full_as_the_width_allows_and_no_word_is_cut() {
        assert_eq!(wrapped("to be or  not", 5), "to be\nor\nnot");
        assert_eq!(wrapped("incorrigible a b", 3), "incorrigible\na b");
        assert_eq!(wrapped("", 3), "");
    }
}
