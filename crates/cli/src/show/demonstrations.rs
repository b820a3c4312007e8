//! A data set of recorded episodes.

use mishandle::results::Demonstrations;
use mishandle_text::plural;

use super::{escape, subject};

/// Returns the result as text.
pub fn text(found: &Demonstrations) -> String {
    let labels = match &found.relabel {
        Some(name) => format!("\nactions are those of {} in each state", escape::name(name)),
        None => String::new(),
    };
    let archive = match &found.archive {
        Some(path) => format!(
            "\n{} of {} have a scenario of {}",
            found.archived,
            plural(found.simulations, "simulation"),
            escape::name(path)
        ),
        None => String::new(),
    };
    let left_out = match found.left_out {
        0 => String::new(),
        left_out => format!("; {} left out", plural(left_out, "simulation")),
    };
    format!(
        "{}{labels}{archive}\n{} with {}: {}{left_out}\n{} in {} as {}",
        subject::heading(&found.subject),
        plural(found.episodes, "episode"),
        plural(found.frames, "frame"),
        plural_successes(found.successes),
        size(found.bytes),
        escape::name(&found.folder),
        found.format,
    )
}

fn plural_successes(successes: u64) -> String {
    if successes == 1 { "1 success".to_string() } else { format!("{successes} successes") }
}

/// Returns a size in words, such as `2.5 MB`.
fn size(bytes: u64) -> String {
    match bytes as f64 {
        few if few < 1e6 => format!("{:.1} kB", few / 1e3),
        some if some < 1e9 => format!("{:.1} MB", some / 1e6),
        many => format!("{:.1} GB", many / 1e9),
    }
}
