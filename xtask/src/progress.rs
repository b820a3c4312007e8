//! A build by cargo as one line of progress instead of a line for each crate.

use std::io::{self, BufRead, BufReader, IsTerminal, Write};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};

use crate::process::as_typed;

/// Columns of cargo's progress bar.
const WIDTH: &str = "79";

/// Time between two lines of progress in a file.
const INTERVAL: Duration = Duration::from_secs(30);

/// Start of the lines of cargo that are not shown: its progress bar, which is written over itself,
/// and the names of crates.
const BAR: &str = "    Building [";
const NAMES: [&str; 6] =
    ["   Compiling ", "  Downloaded ", " Downloading ", "    Updating ", "     Locking ", "    Finished "];

/// Runs cargo. Shows its progress in one line of a terminal, or in a line from time to time, and
/// everything else that it writes.
///
/// # Errors
/// If it cannot be started, or fails.
pub fn run(cargo: &mut Command) -> Result<()> {
    let typed = as_typed(cargo);
    cargo.env("CARGO_TERM_COLOR", "never");
    cargo.env("CARGO_TERM_PROGRESS_WHEN", "always").env("CARGO_TERM_PROGRESS_WIDTH", WIDTH);
    let mut child = cargo.stderr(Stdio::piped()).spawn().with_context(|| format!("cannot run `{typed}`"))?;
    let stderr = child.stderr.take().context("cargo has no stderr")?;
    let is_terminal = io::stderr().is_terminal();
    show(BufReader::new(stderr), &mut io::stderr(), is_terminal)?;
    let status = child.wait()?;
    if !status.success() {
        bail!("`{typed}` ended with {status}");
    }
    Ok(())
}

/// Copies the output of cargo without the lines that name crates. Progress is a line that the next
/// one replaces.
fn show(mut from: impl BufRead, to: &mut impl Write, is_terminal: bool) -> io::Result<()> {
    let mut piece = Vec::new();
    let mut has_bar = false;
    let mut shown = Instant::now();
    let mut end_piece = |piece: &mut Vec<u8>| -> io::Result<()> {
        let text = String::from_utf8_lossy(piece).into_owned();
        piece.clear();
        let text = without_escapes(&text);
        if text.starts_with(BAR) {
            if is_terminal {
                write!(to, "\r{text:<79}")?;
                to.flush()?;
                has_bar = true;
            } else if shown.elapsed() >= INTERVAL {
                shown = Instant::now();
                writeln!(to, "{}", text.trim_end())?;
            }
            return Ok(());
        }
        if text.trim().is_empty() || NAMES.iter().any(|name| text.starts_with(name)) {
            return Ok(());
        }
        if std::mem::take(&mut has_bar) {
            writeln!(to)?;
        }
        writeln!(to, "{text}")
    };
    loop {
        let bytes = from.fill_buf()?;
        let length = bytes.len();
        if length == 0 {
            break;
        }
        for byte in bytes {
            match byte {
                b'\n' | b'\r' => end_piece(&mut piece)?,
                byte => piece.push(*byte),
            }
        }
        from.consume(length);
    }
    end_piece(&mut piece)?;
    if has_bar { writeln!(to) } else { Ok(()) }
}

/// Removes the escape sequences with which cargo clears a line.
fn without_escapes(text: &str) -> String {
    text.replace("\u{1b}[K", "").replace("\u{1b}[2K", "")
}

#[cfg(test)]
mod tests {
    use super::*;

    const OUTPUT: &str = "    Updating index\n   Compiling a v1.0.0\n    Building [>   ] 1/9: a\r\u{1b}[K   Compiling b v1.0.0\n\
                          warning: unused\n  --> src/lib.rs:1\n    Building [==> ] 9/9: b\r    Finished `demo` profile\n";

    fn shown(is_terminal: bool) -> String {
        let mut out = Vec::new();
        show(OUTPUT.as_bytes(), &mut out, is_terminal).unwrap();
        String::from_utf8(out).unwrap()
    }

    #[test]
    fn a_file_gets_no_progress_and_every_message() {
        assert_eq!(shown(false), "warning: unused\n  --> src/lib.rs:1\n");
    }

    #[test]
    fn a_terminal_gets_one_line_of_progress() {
        let text = shown(true);
        assert_eq!(text.matches('\n').count(), 4, "{text:?}");
        assert!(text.contains("\r    Building [==> ] 9/9: b"), "{text:?}");
        assert!(!text.contains("Compiling"), "{text:?}");
    }

    #[test]
    fn a_build_that_fails_is_an_error() {
        let error = run(Command::new("sh").args(["-c", "exit 101"])).unwrap_err().to_string();
        assert_eq!(error, "`sh -c exit 101` ended with exit status: 101");
    }
}
