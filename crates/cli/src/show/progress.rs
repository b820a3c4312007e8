//! Progress on stderr: one line that fits the width of the terminal. Without a terminal, a line of
//! its own from time to time.

use std::fmt::Write;
use std::sync::{Arc, Mutex, Once, PoisonError};
use std::time::{Duration, Instant};

use console::Term;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use mishandle::training::format_duration;

use super::output::{self, shows_progress};

/// Smallest and largest width of the bar, in columns.
const CELLS: [usize; 2] = [10, 40];

/// Interval between redraws that update the elapsed time.
const TICK: Duration = Duration::from_millis(500);

/// Time before the first line without a terminal, and between two of them.
const LINES: [Duration; 2] = [Duration::from_secs(10), Duration::from_secs(30)];

/// A progress bar. It is shown as soon as it has items, so that a bar that waits for them does not
/// write into the line of another one. Dropping it clears its line, also after an error.
pub struct Bar {
    line: ProgressBar,
    note: Arc<Mutex<String>>,
    shown: Once,
    unit: &'static str,
    /// The part that was announced last.
    announced: Mutex<String>,
    start: Instant,
    /// When the next line without a terminal is due, after the start.
    due: Mutex<Duration>,
}

impl Bar {
    /// Creates a bar for `total` items, 0 if their number is not known yet; `unit` is their plural
    /// noun. Without a terminal, there is a line of text from time to time.
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
        let (start, due) = (Instant::now(), Mutex::new(LINES[0]));
        let announced = Mutex::default();
        let bar = Bar { line, note, shown: Once::new(), unit, announced, start, due };
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
        let elapsed = self.start.elapsed();
        let mut due = self.due.lock().unwrap_or_else(PoisonError::into_inner);
        if elapsed < *due || shows_progress() {
            return;
        }
        *due = elapsed + LINES[1];
        let total = self.line.length().unwrap_or(0);
        let left = elapsed.mul_f64(total.saturating_sub(done) as f64 / done.max(1) as f64);
        let note = &self.note.lock().unwrap_or_else(PoisonError::into_inner);
        let progress = Progress { done, total, unit: self.unit, elapsed, left, note };
        output::message(&progress.text());
    }

    /// Sets the number of items of a part, whose name is the note. Announces each part.
    pub fn set_part(&self, name: &str, total: u64) {
        self.set_note(name.to_string());
        self.set_length(total);
        let mut announced = self.announced.lock().unwrap_or_else(PoisonError::into_inner);
        if total > 0 && *announced != name {
            *announced = name.to_string();
            self.line.suspend(|| output::message(&format!("{name}: at most {total} {}", self.unit)));
        }
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
    /// Returns the counts, the elapsed time and the time that is left.
    fn parts(&self) -> [String; 3] {
        let left = match self.done {
            0 => String::new(),
            _ => format!("{} left", format_duration(self.left.as_secs_f64())),
        };
        let count = format!("{}/{} {}", self.done, self.total, self.unit);
        [count, format_duration(self.elapsed.as_secs_f64()), left]
    }

    /// Formats all parts, without a bar.
    fn text(&self) -> String {
        let [count, elapsed, left] = self.parts();
        joined([&count, &elapsed, &left, self.note])
    }

    /// Formats the line in at most `columns` columns. If it is too long, it drops the note, then
    /// the elapsed time, then the bar, and then truncates the rest.
    fn line(&self, columns: usize) -> String {
        let [count, elapsed, left] = self.parts();
        for parts in [
            [&count, elapsed.as_str(), &left, self.note],
            [&count, elapsed.as_str(), &left, ""],
            [&count, left.as_str(), "", ""],
        ] {
            let text = joined(parts);
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

/// Joins the parts that are there.
fn joined(parts: [&str; 4]) -> String {
    let parts: Vec<&str> = parts.into_iter().filter(|part| !part.is_empty()).collect();
    parts.join(", ")
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
    fn without_a_terminal_a_line_has_all_parts() {
        let expected = "45/180 simulations, 1:01, 3:03 left, 1 trial finished, 1 falsified";
        assert_eq!(progress().text(), expected);
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
