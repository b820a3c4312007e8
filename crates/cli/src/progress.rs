//! A progress bar on stderr, drawn only where somebody can watch it.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::output::shows_progress;

/// A bar over `total` of `what`, with room for a message; invisible unless stderr is a terminal.
pub fn bar(total: u64, what: &str) -> ProgressBar {
    let target = if shows_progress() { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
    let bar = ProgressBar::with_draw_target(Some(total), target);
    let template = format!("{{bar:24}} {{pos}}/{{len}} {what}, {{elapsed}} elapsed, {{eta}} left {{msg}}");
    // The template is a constant but for a word; a mistake in it would show in every run.
    if let Ok(style) = ProgressStyle::with_template(&template) {
        bar.set_style(style);
    }
    bar
}
