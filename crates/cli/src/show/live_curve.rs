//! Live display of a training run: one line per validation, and a status line that is updated.

use console::Term;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use mishandle::training::{TrainingProgress, format_duration};

use super::output::shows_progress;

/// Maximum width of the bar, cells.
const MAX_BAR_WIDTH: usize = 40;

/// Live learning curve; hidden unless stderr is a terminal.
#[derive(Clone)]
pub struct LiveCurve {
    line: ProgressBar,
}

impl LiveCurve {
    pub fn new() -> LiveCurve {
        let target =
            if shows_progress() { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
        let line = ProgressBar::with_draw_target(None, target);
        // The template is constant, so it is either valid in every run or in none.
        if let Ok(style) = ProgressStyle::with_template("{spinner} {wide_msg}") {
            line.set_style(style);
        }
        LiveCurve { line }
    }

    /// Shows the progress.
    pub fn show(&self, progress: &TrainingProgress) {
        // The last column stays free, because some terminals wrap after it. The spinner takes two
        // columns.
        let columns = usize::from(Term::stderr().size().1).saturating_sub(1);
        if progress.validation_is_fresh {
            self.line.println(validation_line(progress, columns));
        }
        self.line.set_message(status_line(progress, columns.saturating_sub(2)));
        self.line.tick();
    }

    /// Hides the status line while `write` writes to the terminal.
    pub fn suspend(&self, write: impl FnOnce()) {
        self.line.suspend(write);
    }

    /// Clears the status line.
    pub fn finish(&self) {
        self.line.finish_and_clear();
    }
}

/// Returns the line of a validation, with a bar of the success rates: `#` for strict success, `-`
/// for success.
fn validation_line(progress: &TrainingProgress, columns: usize) -> String {
    let (success, strict) =
        progress.validation.map_or((0.0, 0.0), |v| (v.success_rate, v.strict_success_rate));
    let steps = progress.steps_done();
    let percent = 100.0 * success;
    let strict_percent = 100.0 * strict;
    let long =
        (format!("{steps:>9} steps "), format!(" success {percent:5.1} %  strict {strict_percent:5.1} %"));
    let short = (format!("{steps:>7} "), format!(" {percent:5.1} {strict_percent:5.1} %"));
    let room = |(head, tail): &(String, String)| columns.saturating_sub(head.len() + tail.len() + 2);
    let ((head, tail), cells) = if room(&long) >= 10 { (&long, room(&long)) } else { (&short, room(&short)) };
    let cells = cells.min(MAX_BAR_WIDTH);
    let filled = |rate: f64| (cells as f64 * rate).round() as usize;
    let strict_cells = filled(strict);
    let success_cells = filled(success).max(strict_cells);
    let bar = "#".repeat(strict_cells) + &"-".repeat(success_cells - strict_cells);
    format!("{head}|{bar:cells$}|{tail}")
}

/// Returns the status line: wall-clock time and progress, without the least important parts if it
/// is too long.
fn status_line(progress: &TrainingProgress, columns: usize) -> String {
    let text = format!("{}, {progress}", format_duration(progress.wall_clock_secs));
    let mut parts: Vec<&str> = text.split(", ").collect();
    // The first two parts are time and steps, the last one is the remaining time; parts between
    // them are optional.
    while parts.len() > 3 && parts.join(", ").len() > columns {
        parts.remove(2);
    }
    parts.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use mishandle::training::{Rates, TimeShares, Validation};

    fn progress() -> TrainingProgress {
        TrainingProgress {
            iteration: 3,
            environment_steps: 1_500_000,
            total_steps: 20_000_000,
            steps_per_second: 50_000.0,
            wall_clock_secs: 61.4,
            mean_return: Some(101.26),
            mean_episode_steps: Some(300.0),
            terminated_rate: Some(0.0),
            diverged: 0,
            reward_terms: vec![],
            validation: Some(Validation::of_starts(Rates {
                success_rate: 0.75,
                strict_success_rate: 0.5,
                mean_return: 100.0,
            })),
            validation_is_fresh: true,
            scenario_share: None,
            kl: None,
            entropy: None,
            learning_rate: 1e-3,
            time_shares: TimeShares::default(),
        }
    }

    #[test]
    fn the_validation_bar_fits_the_terminal_width() {
        // At most 40 cells: 20 for strict success, 10 more for success.
        let bar = format!("|{}{}{}|", "#".repeat(20), "-".repeat(10), " ".repeat(10));
        let line = validation_line(&progress(), 119);
        assert_eq!(line, format!("    1.50M steps {bar} success  75.0 %  strict  50.0 %"));
        // 79 - 16 - 32 - 2 = 29 cells: 14.5 and 21.75 of them.
        let bar = format!("|{}{}{}|", "#".repeat(15), "-".repeat(7), " ".repeat(7));
        let line = validation_line(&progress(), 79);
        assert_eq!(line, format!("    1.50M steps {bar} success  75.0 %  strict  50.0 %"));
        // 39 - 8 - 14 - 2 = 15 cells: 7.5 and 11.25.
        assert_eq!(validation_line(&progress(), 39), "  1.50M |########---    |  75.0  50.0 %");
        for columns in 24..200 {
            let length = validation_line(&progress(), columns).len();
            assert!(length <= columns, "{length} of {columns}");
        }
        assert_eq!(validation_line(&progress(), 0), "  1.50M ||  75.0  50.0 %");
    }

    #[test]
    fn the_status_line_omits_parts_that_do_not_fit() {
        let whole = status_line(&progress(), 200);
        assert_eq!(
            whole,
            "1:01, 1.50M of 20M steps, 50.0k steps/s, return 101.3, success 75.0 %, strict 50.0 %, 6:10 left"
        );
        assert_eq!(
            status_line(&progress(), 77),
            "1:01, 1.50M of 20M steps, return 101.3, success 75.0 %, strict 50.0 %, 6:10 left"
                .replace("return 101.3, ", "")
        );
        assert_eq!(status_line(&progress(), 37), "1:01, 1.50M of 20M steps, 6:10 left");
    }
}
