//! Output: results on stdout, messages on stderr. Everything printed is escaped: see [`escape`].

use std::borrow::Cow;
use std::fs::File;
use std::io::{BufWriter, ErrorKind, IsTerminal, Read, Write};
use std::path::Path;

use anyhow::{Context, Error, Result, anyhow, bail, ensure};
use console::Term;
use mishandle::MishandleError;
use mishandle::files::{AtomicFile, is_same_file};
use mishandle::results::Versioned;
use mishandle::rollout::RolloutError;
use mishandle::stl::{Formula, spelled};
use mishandle_text::short;
use serde::Serialize;

use super::escape::EscapedJson;
use super::{escape, formula_error};
use crate::words;

/// Prints a line to stdout.
pub fn line(text: &str) -> Result<()> {
    print(&escape::text(text))
}

/// Prints lines that are escaped already, and have the colors of a terminal.
pub fn styled(escaped: &str) -> Result<()> {
    print(escaped)
}

fn print(escaped: &str) -> Result<()> {
    writeln!(std::io::stdout().lock(), "{escaped}")?;
    Ok(())
}

/// Prints a result as a JSON document, whose first key is its version.
pub fn json(result: &impl Serialize) -> Result<()> {
    print_json(&Versioned::new(result))
}

/// Prints a result as a JSON document on one line, which a reader has at once.
pub fn json_line(result: &impl Serialize) -> Result<()> {
    let mut text = Vec::new();
    serde_json::to_writer(EscapedJson(&mut text), &Versioned::new(result))?;
    text.push(b'\n');
    let mut out = std::io::stdout().lock();
    out.write_all(&text)?;
    out.flush()?;
    Ok(())
}

/// Prints results as a JSON array. Each of them has its version as the first key.
pub fn json_array<T: Serialize>(results: &[T]) -> Result<()> {
    print_json(&results.iter().map(Versioned::new).collect::<Vec<_>>())
}

/// Writes a document as it is serialized, so that one with millions of numbers takes no memory for
/// their text.
fn print_json(document: &impl Serialize) -> Result<()> {
    let mut out = BufWriter::new(std::io::stdout().lock());
    // As an error of the system, by which a closed pipe is recognized.
    serde_json::to_writer_pretty(EscapedJson(&mut out), document).map_err(std::io::Error::from)?;
    writeln!(out)?;
    out.flush()?;
    Ok(())
}

/// Creates a file that appears under its name when it is complete. An existing file is replaced
/// only with `force`.
pub fn create(path: &Path, force: bool) -> Result<AtomicFile> {
    ensure!(
        !force || !is_database(path),
        "{} is a run file or another SQLite database, which no file of another format replaces; choose another path, or remove it first",
        path.display()
    );
    let created = if force { AtomicFile::replace(path) } else { AtomicFile::create_new(path) };
    with_path(path, created, "choose another path, or overwrite it with --force")
}

/// Returns whether there is an SQLite database, such as a run file.
fn is_database(path: &Path) -> bool {
    let mut start = [0; 16];
    // Opening a FIFO would block.
    path.is_file()
        && File::open(path).and_then(|mut file| file.read_exact(&mut start)).is_ok()
        && start == *b"SQLite format 3\0"
}

/// Refuses an output that is one of the inputs of the command, also under another name.
pub fn refuse_inputs<'a>(path: &Path, flag: &str, inputs: impl IntoIterator<Item = &'a Path>) -> Result<()> {
    match inputs.into_iter().find(|input| is_same_file(path, input)) {
        None => Ok(()),
        Some(input) => bail!(
            "{flag} is {}, the same file as the input {}; choose another {flag}",
            path.display(),
            input.display()
        ),
    }
}

fn with_path(path: &Path, created: std::io::Result<AtomicFile>, advice: &str) -> Result<AtomicFile> {
    match created {
        Err(error) if error.kind() == ErrorKind::AlreadyExists => {
            bail!("{} exists already; {advice}", path.display())
        }
        Err(error) if error.kind() == ErrorKind::NotFound => {
            let folder = path.parent().unwrap_or(path);
            bail!("cannot write {}: there is no folder {}", path.display(), folder.display())
        }
        created => created.with_context(|| format!("cannot write {}", path.display())),
    }
}

/// Writes a file that appears under its name when it is complete. An existing file is replaced only
/// with `force`.
pub fn write_atomically(path: &Path, force: bool, bytes: &[u8]) -> Result<()> {
    let mut file = create(path, force)?;
    file.write_all(bytes)
        .and_then(|()| file.persist())
        .with_context(|| format!("cannot write {}", path.display()))
}

/// Creates a file and fills it with `write`. An existing file is an error.
pub fn write_new(path: &Path, write: impl FnOnce(&mut AtomicFile) -> Result<()>) -> Result<()> {
    let mut file = with_path(path, AtomicFile::create_new(path), "choose another path")?;
    write(&mut file).and_then(|()| Ok(file.persist()?)).map_err(|error| {
        // The functions that write name neither the file nor its flag, and some say again that they
        // cannot write.
        let system = error.chain().find_map(|cause| cause.downcast_ref::<std::io::Error>());
        let cause = system.map_or_else(|| words::with_causes(error.chain()), ToString::to_string);
        anyhow!("cannot write {}: {cause}", path.display())
    })
}

/// Prints a message to stderr. Lines after the first are indented, so that a name with a line break
/// cannot pose as another message.
pub fn message(text: &str) {
    let text = escape::text(&shortened(text)).replace('\n', "\n  ").replace("\n  \n", "\n\n");
    // If stderr is closed, the error cannot be reported.
    let _ = writeln!(std::io::stderr().lock(), "{text}");
}

/// Largest number of characters of a message. Names and texts from files can be longer.
const MAX_MESSAGE: usize = 8000;

/// Leaves out the middle of a text that is too long for a message.
fn shortened(text: &str) -> Cow<'_, str> {
    let count = text.chars().count();
    if count <= MAX_MESSAGE {
        return Cow::Borrowed(text);
    }
    let at = |characters: usize| text.char_indices().nth(characters).map_or(text.len(), |(index, _)| index);
    let first = &text[..at(MAX_MESSAGE / 2)];
    let last = &text[at(count - MAX_MESSAGE / 2)..];
    Cow::Owned(format!("{first} … ({} characters left out) … {last}", count - MAX_MESSAGE))
}

/// Warns about what users rarely mean: chained comparisons and definitions without use.
pub fn warn_about(formula: &Formula) {
    if formula.chains_comparisons() {
        message(&format!(
            "warning: comparisons do not chain: `0.2 <= v <= 0.3` means `(0.2 <= v) <= 0.3`, as in RTAMT; write \
             `0.2 <= v and v <= 0.3` instead. The formula is {formula}"
        ));
    }
    for name in formula.unused_definitions() {
        message(&format!(
            "warning: no statement reads the definition `{}`; the formula is {formula}",
            escape::name(&spelled(name))
        ));
    }
}

/// Returns whether stderr is a terminal, which shows a progress bar.
pub fn shows_progress() -> bool {
    std::io::stderr().is_terminal()
}

/// Prints an error with its causes, and a hint if there is one.
pub fn report_error(error: &Error) {
    let known = error.chain().find_map(|cause| cause.downcast_ref::<MishandleError>());
    let (whose, known) = match known {
        Some(MishandleError::Of { source, .. }) => (format!("{error}: "), Some(&**source)),
        known => (String::new(), known),
    };
    let remedies = words::remedies(error.chain());
    match known {
        Some(MishandleError::Rollout(RolloutError::Parse { formula, source })) => {
            message(&format!("error: {whose}{}", formula_error::message(formula, source)));
        }
        _ => {
            let text = words::with_causes(error.chain());
            message(&format!("error: {}", words::described(&text, &remedies, &words::Shell)));
        }
    }
    if let Some(hint) = words::hint(&remedies) {
        message(&format!("hint: {hint}"));
    }
}

/// Returns whether the reader of stdout has closed the pipe, as `head` does.
pub fn is_broken_pipe(error: &Error) -> bool {
    error
        .chain()
        .filter_map(|cause| cause.downcast_ref::<std::io::Error>())
        .any(|error| error.kind() == ErrorKind::BrokenPipe)
}

/// Formats a table with aligned columns. The first row is the header.
pub fn table(rows: &[Vec<String>]) -> String {
    let lines: Vec<String> = table_cells(rows).iter().map(|line| line.trim_end().to_string()).collect();
    lines.join("\n").trim_end().to_string()
}

/// Returns the width of text output in columns: the width of the terminal, from 40 to 100, or 80
/// without a terminal.
pub fn width() -> usize {
    if std::io::stdout().is_terminal() { usize::from(Term::stdout().size().1).clamp(40, 100) } else { 80 }
}

/// Formats a table in `width` columns. The last column is wrapped, but never to less than 16
/// columns.
pub fn table_in(rows: &[Vec<String>], width: usize) -> String {
    let head: Vec<Vec<String>> = rows.iter().map(|row| row[..row.len().saturating_sub(1)].to_vec()).collect();
    let head = table_cells(&head);
    let indent = head.iter().map(|line| line.chars().count()).max().unwrap_or(0);
    let lines = head.iter().zip(rows).map(|(head, row)| {
        let last = row.last().map_or("", String::as_str);
        let text = wrapped(last, width.saturating_sub(indent).max(16));
        format!("{}{}", padded(head, indent), indented(&text, indent)).trim_end().to_string()
    });
    lines.collect::<Vec<_>>().join("\n")
}

/// Largest number of characters of a cell. Names and formulas from files can be longer, and every
/// row is as wide as the widest.
const MAX_CELL: usize = 200;

/// Appends spaces up to `width` characters. The widths of `format!` end at 65,535.
fn padded(text: &str, width: usize) -> String {
    format!("{text}{}", " ".repeat(width.saturating_sub(text.chars().count())))
}

/// Aligns the cells of each row, with two spaces after each cell. Escapes them first, so that a
/// cell has one line and the width that is printed.
fn table_cells(rows: &[Vec<String>]) -> Vec<String> {
    let escaped = |row: &Vec<String>| row.iter().map(|text| short(&escape::name(text), MAX_CELL)).collect();
    let rows: Vec<Vec<String>> = rows.iter().map(escaped).collect();
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |column: usize| {
        rows.iter().filter_map(|row| row.get(column)).map(|c| c.chars().count()).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let line = |row: &Vec<String>| -> String {
        row.iter().zip(&widths).map(|(cell, width)| padded(cell, width + 2)).collect()
    };
    rows.iter().map(line).collect()
}

/// Indents all lines except the first by `indent` spaces.
pub fn indented(text: &str, indent: usize) -> String {
    text.replace('\n', &format!("\n{}", " ".repeat(indent)))
}

/// Wraps a line at `width` columns. Continuation lines are indented by two more columns than the
/// first.
pub fn folded(line: &str, width: usize) -> String {
    let start = line.len() - line.trim_start().len();
    let text = wrapped(line, width.saturating_sub(start + 2));
    format!("{}{}", " ".repeat(start), indented(&text, start + 2))
}

/// Wraps text between words into lines of at most `width` characters. Words longer than that are
/// not broken.
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
    fn the_last_column_wraps_within_its_column() {
        let rows = [["a", "x", "one two three four"], ["bcd", "", "one"]];
        let rows = rows.map(|row| row.map(String::from).to_vec());
        assert_eq!(table_in(&rows, 24), "a    x  one two three\n        four\nbcd     one");
        assert_eq!(table(&rows), "a    x  one two three four\nbcd     one");
    }

    #[test]
    fn the_middle_of_a_huge_message_is_left_out() {
        let huge = format!("error: {} is unknown", "é".repeat(1_000_000));
        let text = shortened(&huge);
        assert!(text.starts_with("error: é") && text.ends_with("é is unknown"), "{text}");
        assert!(text.contains(" … (992018 characters left out) … "), "{text}");
        assert!(text.chars().count() < 8100);
        assert_eq!(shortened("error: no"), "error: no");
    }

    #[test]
    fn a_cell_has_one_line_and_its_printed_width() {
        let rows = [["a\nb", "x"], ["\u{1b}", "x"]].map(|row| row.map(String::from).to_vec());
        assert_eq!(table(&rows), "a\\nb    x\n\\u{1b}  x");
    }

    #[test]
    fn a_huge_cell_is_cut_and_many_columns_are_aligned() {
        let rows = [vec!["é".repeat(70_000), "x".to_string()], vec!["a".to_string(), "y".to_string()]];
        let lines: Vec<String> = table(&rows).lines().map(String::from).collect();
        assert_eq!(lines[0], format!("{}…  x", "é".repeat(199)));
        assert_eq!(lines[1], format!("a{}  y", " ".repeat(199)));
        // 400 columns of 200 characters are wider than the widths of `format!`.
        let wide = vec![vec!["a".repeat(200); 400], vec!["b".to_string(); 400]];
        assert_eq!(table_in(&wide, 80).lines().nth(1).unwrap().chars().count(), 399 * 202 + 1);
    }

    #[test]
    fn continuation_lines_are_indented_below_the_start_of_the_line() {
        assert_eq!(folded("  a b", 5), "  a\n    b");
        assert_eq!(folded("  one two three", 12), "  one two\n    three");
    }

    #[test]
    fn lines_are_filled_up_to_the_width_and_words_are_not_broken() {
        assert_eq!(wrapped("to be or  not", 5), "to be\nor\nnot");
        assert_eq!(wrapped("incorrigible a b", 3), "incorrigible\na b");
        assert_eq!(wrapped("", 3), "");
    }
}
