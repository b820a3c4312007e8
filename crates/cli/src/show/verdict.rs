//! The few lines that say what an answer means: labels on the left, texts wrapped beside them.

use console::{Color, Style};
use mishandle::verdict::{Conclusion, Line, Verdict};

use super::{escape, output};
use crate::words::{python_call, shell_command};

/// Width of the text of a result in Python.
const PYTHON_WIDTH: usize = 80;

/// Shortest width of a text beside its label.
const MIN_TEXT: usize = 30;

/// Returns the lines with commands of the shell. On a terminal that shows colors, labels have them.
pub fn text(verdict: &Verdict) -> String {
    shown(verdict, &verdict.lines(shell_command), output::width(), " \\\n", |is_first, label| {
        let style =
            if is_first { Style::new().bold().fg(color(verdict.conclusion)) } else { Style::new().bold() };
        style.apply_to(label).to_string()
    })
}

/// Returns the lines with calls of Python, 80 columns wide.
pub fn python_text(verdict: &Verdict) -> String {
    shown(verdict, &verdict.lines(python_call), PYTHON_WIDTH, "\n", |_, label| label.to_string())
}

fn color(conclusion: Conclusion) -> Color {
    match conclusion {
        Conclusion::Fails | Conclusion::Worse => Color::Red,
        Conclusion::Holds | Conclusion::Better => Color::Green,
        Conclusion::NothingFound | Conclusion::NoVerdict | Conclusion::NoDifference => Color::Yellow,
    }
}

/// Formats lines in `width` columns. `continued` stands at the end of a line of a command that goes
/// on, and `styled` makes a label, of which it knows whether it is the first.
fn shown(
    verdict: &Verdict,
    lines: &[Line],
    width: usize,
    continued: &str,
    styled: impl Fn(bool, &str) -> String,
) -> String {
    let indent = 2 + lines.iter().map(|line| line.label.chars().count()).max().unwrap_or(0);
    let room = width.saturating_sub(indent).max(MIN_TEXT);
    let mut before = "";
    let mut text = String::new();
    for (index, line) in lines.iter().enumerate() {
        let label = if line.label == before { "" } else { line.label };
        before = line.label;
        let words = escape::name(&line.text);
        // A quoted word may contain spaces.
        let is_whole = line.is_command && words.contains(['\'', '"']);
        let wrapped = if is_whole {
            words
        } else if line.is_command {
            output::wrapped(&words, room - 2).replace('\n', continued)
        } else {
            output::wrapped(&words, room)
        };
        let gap = " ".repeat(indent - label.chars().count());
        text += &format!("{}{gap}{}\n", styled(index == 0, label), output::indented(&wrapped, indent));
        if index == 0 && !verdict.table.is_empty() {
            text += &format!("\n{}\n\n", output::table_in(&verdict.table, width));
        }
    }
    text.truncate(text.trim_end().len());
    text
}
