//! Why simulations ended as they did, in the words of their target, as text.

use mishandle::results::EndReasons;
use mishandle_text::{first_and_last_line, plural};

use super::{escape, output, simulation};

/// Returns the reasons of the simulations of a run, after an empty line; nothing without one.
pub fn text(found: Option<&[EndReasons]>) -> String {
    let Some(found) = found else { return String::new() };
    let line = |found: &EndReasons| {
        let first = simulation::name(found.trial, None, found.simulation);
        let which = if found.simulations == 1 { first } else { format!("the first is {first}") };
        let text = format!(
            "{}: {} ({which}): {}",
            escape::name(found.word()),
            plural(found.simulations, "simulation"),
            escape::name(&first_and_last_line(&found.reason))
        );
        output::wrapped(&text, output::width().saturating_sub(2)).replace('\n', "\n  ")
    };
    format!("\n\n{}", found.iter().map(line).collect::<Vec<_>>().join("\n"))
}

/// Returns the whole reason of one simulation on lines of its own; nothing without one.
pub fn of_one(reason: Option<&str>) -> String {
    reason.map_or(String::new(), |reason| {
        format!("\nreason: {}", escape::text(reason.trim_end()).replace('\n', "\n  "))
    })
}
