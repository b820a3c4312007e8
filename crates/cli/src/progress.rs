//! A progress bar on stderr, drawn only on a terminal, in one line that fits its width.

use std::fmt::Write;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use console::Term;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use mishandle::training::format_duration;

use crate::output::shows_progress;

/// Cells of the narrowest and of the widest bar.
const CELLS: [usize; 2] = [10, 40];

/// How often the line is drawn when nothing else happens, so that the time goes on.
const TICK: Duration = Duration::from_millis(500);

/// A progress bar. It is cleared when it is dropped, so an error that ends the command leaves nothing of it.
pub struct Bar {
    line: ProgressBar,
    note: Arc<Mutex<String>>,
}

impl Bar {
    /// A bar over `total` of `what`; invisible unless stderr is a terminal.
    pub fn new(total: u64, what: &'static str) -> Bar {
        let target =
            if shows_progress() { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
        let line = ProgressBar::with_draw_target(Some(total), target);
        let note = Arc::new(Mutex::new(String::new()));
        let shown = note.clone();
        let draw = move |state: &ProgressState, out: &mut dyn Write| {
            let note = shown.lock().unwrap_or_else(PoisonError::into_inner);
            let facts = Facts {
                done: state.pos(),
                total: state.len().unwrap_or(0),
                what,
                elapsed: state.elapsed(),
                left: state.eta(),
                note: &note,
            };
            // The last column stays free: some terminals begin a new line with it.
            let columns = usize::from(Term::stderr().size().1).saturating_sub(1);
            // A buffer in memory takes everything.
            let _ = out.write_str(&facts.line(columns));
        };
        // The template is a constant; a mistake in it would show in every run.
        if let Ok(style) = ProgressStyle::with_template("{line}") {
            line.set_style(style.with_key("line", draw));
        }
        if shows_progress() {
            line.enable_steady_tick(TICK);
        }
        Bar { line, note }
    }

    /// How much there is to do.
    pub fn set_length(&self, total: u64) {
        self.line.set_length(total);
    }

    /// How much is done.
    pub fn set_position(&self, done: u64) {
        self.line.set_position(done);
    }

    /// What is said at the end of the line, where there is room.
    pub fn set_note(&self, note: String) {
        *self.note.lock().unwrap_or_else(PoisonError::into_inner) = note;
    }

    /// Clears the line.
    pub fn clear(&self) {
        self.line.finish_and_clear();
    }

    /// The line itself, for a thread that writes to the terminal.
    pub fn line(&self) -> ProgressBar {
        self.line.clone()
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.clear();
    }
}

/// What the line says.
struct Facts<'a> {
    done: u64,
    total: u64,
    what: &'a str,
    elapsed: Duration,
    left: Duration,
    note: &'a str,
}

impl Facts<'_> {
    /// The line in at most `columns`. Where that is too narrow, the note goes first, then the time that has passed, the bar,
    /// and the rest from its end.
    fn line(&self, columns: usize) -> String {
        let count = format!("{}/{} {}", self.done, self.total, self.what);
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
        let share = if self.total == 0 { 0.0 } else { self.done as f64 / self.total as f64 };
        let filled = (share.min(1.0) * cells as f64) as usize;
        "#".repeat(filled) + &"-".repeat(cells - filled)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn facts() -> Facts<'static> {
        Facts {
            done: 45,
            total: 180,
            what: "simulations",
            elapsed: Duration::from_secs(61),
            left: Duration::from_secs(183),
            note: "1 trials ended, 1 falsified",
        }
    }

    #[test]
    fn the_line_says_what_fits() {
        // A quarter of the cells is filled: of 40, of 38, then 44 - 29 - 3 = 12 without the time that has passed.
        let rest = "45/180 simulations, 1:01, 3:03 left";
        let bar = |filled, empty| format!("[{}{}]", "#".repeat(filled), "-".repeat(empty));
        assert_eq!(facts().line(120), format!("{} {rest}, 1 trials ended, 1 falsified", bar(10, 30)));
        assert_eq!(facts().line(76), format!("{} {rest}", bar(9, 29)));
        assert_eq!(facts().line(44), format!("{} 45/180 simulations, 3:03 left", bar(3, 9)));
        assert_eq!(facts().line(35), "45/180 simulations, 3:03 left");
        assert_eq!(facts().line(8), "45/180 s");
    }

    #[test]
    fn no_line_is_wider_than_the_terminal() {
        for columns in 0..200 {
            for done in [0, 45, 180] {
                let line = Facts { done, ..facts() }.line(columns);
                assert!(line.chars().count() <= columns, "{line}");
            }
        }
        assert_eq!(Facts { done: 0, total: 0, ..facts() }.line(60).find("--"), Some(1));
    }
}
