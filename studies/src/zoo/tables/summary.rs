//! The tables in a sentence, and the controllers below a threshold.

use crate::zoo::algorithms;
use crate::zoo::tables::{Shown, missed};

/// How many controllers reach all their thresholds, and which do not.
pub(super) fn table(shown: &Shown<'_>) -> String {
    let mut planned = 0;
    let mut reaching = 0;
    let mut others = String::new();
    for task in shown.names() {
        let mut missing = Vec::new();
        for algorithm in algorithms() {
            planned += 1;
            match shown.recorded(task, algorithm).map(|(_, record)| missed(record, algorithm)) {
                Some(missed) if missed.is_empty() => reaching += 1,
                Some(missed) => missing.push(format!("`{algorithm}` ({})", missed.join(", "))),
                None => missing.push(format!("`{algorithm}` (not measured)")),
            }
        }
        if !missing.is_empty() {
            others += &format!("| `{task}` | {} |\n", missing.join("; "));
        }
    }
    let end = if others.is_empty() {
        ".\n".to_string()
    } else {
        format!(". The others:\n\n| task | below threshold |\n|---|---|\n{others}")
    };
    format!("Of {planned} controllers of the first generation {reaching} meet every threshold{end}")
}
