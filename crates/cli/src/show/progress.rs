//! Progress bar on stderr: one line that fits the width of the terminal. Without a terminal it is
//! hidden.

use std::fmt::Write;
use std::sync::{Arc, Mutex, Once, PoisonError};
use std::time::Duration;

use console::Term;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use mishandle::training::format_duration;

use super::output::shows_progress;

/// Smallest and largest width of the bar, in columns.
const CELLS: [usize; 2] = [10, 40];

/// Interval between redraws that update the elapsed time.
const TICK: Duration = Duration::from_millis(500);

/// A progress bar. It is shown as soon as it has items, so that a bar that waits for them does not
/// write into the line of another one. Dropping it clears its line, also after an error.
pub struct Bar {
    line: ProgressBar,
    note: Arc<Mutex<String>>,
    shown: Once,
}

impl Bar {
    /// Creates a bar for `total` items, 0 if their number is not known yet; `unit` is their plural
    /// noun. The bar is hidden unless stderr is a terminal.
    pub fn new(total: u64, unit: &'static str) -> Bar {
        let target =
            if shows_progress() { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
        let line = ProgressBar::with_draw_target(Some(total), target);
        let note = Arc::new(Mutex::new(String::new()));
        let shown = note.clone();
        let draw = move |state: &ProgressState, out: &mut dyn Write| {
            let note = shown.lock().unwrap_or_else(PoisonError::into_inner);
            let progress = Progress {
                done: state.pos(),
                total: state.len().unwrap_or(0),
                unit,
                elapsed: state.elapsed(),
                left: state.eta(),
                note: &note,
            };
            // The last column stays empty, because some terminals wrap after it.
            let columns = usize::from(Term::stderr().size().1).saturating_sub(1);
            // Writing to a buffer in memory cannot fail.
            let _ = out.write_str(&progress.line(columns));
        };
        // The template is constant and valid.
        if let Ok(style) = ProgressStyle::with_template("{line}") {
            line.set_style(style.with_key("line", draw));
        }
        let bar = Bar { line, note, shown: Once::new() };
        bar.show(total);
        bar
    }

    fn show(&self, total: u64) {
        if total > 0 && shows_progress() {
            self.shown.call_once(|| self.line.enable_steady_tick(TICK));
        }
    }

    /// Sets the total number of items.
    pub fn set_length(&self, total: u64) {
        self.line.set_length(total);
        self.show(total);
    }

    /// Sets the number of finished items.
    pub fn set_position(&self, done: u64) {
        self.line.set_position(done);
    }

    /// Sets the note at the end of the line. A narrow terminal does not show it.
    pub fn set_note(&self, note: String) {
        *self.note.lock().unwrap_or_else(PoisonError::into_inner) = note;
    }

    /// Clears the line.
    pub fn clear(&self) {
        self.line.finish_and_clear();
    }

    /// Returns a handle to the line, for a thread that writes to the terminal.
    pub fn line(&self) -> ProgressBar {
        self.line.clone()
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.clear();
    }
}

/// Content of the progress line.
struct Progress<'a> {
    done: u64,
    total: u64,
    unit: &'a str,
    elapsed: Duration,
    left: Duration,
    note: &'a str,
}

impl Progress<'_> {
    /// Formats the line in at most `columns` columns. If it is too long, it drops the note, then
    /// the elapsed time, then the bar, and then truncates the rest.
    fn line(&self, columns: usize) -> String {
        let count = format!("{}/{} {}", self.done, self.total, self.unit);
        let elapsed = format_duration(self.elapsed.as_secs_f64());
        let left = match self.done {
            0 => String::new(),
            _ => format!("{} left", format_duration(self.left.as_secs_f64())),
        };
        for parts in [
            [&count, elapsed.as_str(), &left, self.note],
            [&count, elapsed.as_str(), &left, ""],
            [&count, left.as_str(), "", ""],
        ] {
            let parts: Vec<&str> = parts.into_iter().filter(|part| !part.is_empty()).collect();
            let text = parts.join(", ");
            let cells = columns.saturating_sub(text.chars().count() + "[] ".len()).min(CELLS[1]);
            if cells >= CELLS[0] {
                return format!("[{}] {text}", self.bar(cells));
            }
        }
        let text = if left.is_empty() { count } else { format!("{count}, {left}") };
        text.chars().take(columns).collect()
    }

    fn bar(&self, cells: usize) -> String {
        let fraction = if self.total == 0 { 0.0 } else { self.done as f64 / self.total as f64 };
        let filled = (fraction.min(1.0) * cells as f64) as usize;
        "#".repeat(filled) + &"-".repeat(cells - filled)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn progress() -> Progress<'static> {
        Progress {
            done: 45,
            total: 180,
            unit: "simulations",
            elapsed: Duration::from_secs(61),
            left: Duration::from_secs(183),
            note: "1 trial finished, 1 falsified",
        }
    }

    #[test]
    fn the_line_drops_the_parts_that_do_not_fit() {
        // A quarter of the cells is filled: of 40, of 38, then of 44 - 29 - 3 = 12 without the
        // elapsed time.
        let rest = "45/180 simulations, 1:01, 3:03 left";
        let bar = |filled, empty| format!("[{}{}]", "#".repeat(filled), "-".repeat(empty));
        assert_eq!(progress().line(120), format!("{} {rest}, 1 trial finished, 1 falsified", bar(10, 30)));
        assert_eq!(progress().line(76), format!("{} {rest}", bar(9, 29)));
        assert_eq!(progress().line(44), format!("{} 45/180 simulations, 3:03 left", bar(3, 9)));
        assert_eq!(progress().line(35), "45/180 simulations, 3:03 left");
        assert_eq!(progress().line(8), "45/180 s");
    }

    #[test]
    fn no_line_is_wider_than_the_terminal() {
        for columns in 0..200 {
            for done in [0, 45, 180] {
                let line = Progress { done, ..progress() }.line(columns);
                assert!(line.chars().count() <= columns, "{line}");
            }
        }
        assert_eq!(Progress { done: 0, total: 0, ..progress() }.line(60).find("--"), Some(1));
    }
}
