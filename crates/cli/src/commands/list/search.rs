//! The list of searches, and the options of one.

use mishandle::search::{OptionSpec, SEARCHES, SearchEntry};

use crate::show::output::{self, table, wrapped};

/// Units of the options.
const UNITS: &str = "d is the number of coordinates, one per axis of the scenario space (`--space`). A coordinate of 0 is \
                     the lower bound of its axis, a coordinate of 1 the upper bound. Points and tolerances are in \
                     these units.";

/// Returns all searches with their summaries.
pub fn list() -> String {
    let head = ["search", "summary"].map(String::from).to_vec();
    let rows = SEARCHES.iter().map(|entry| vec![entry.name.to_string(), entry.summary.to_string()]);
    let all: Vec<Vec<String>> = std::iter::once(head).chain(rows).collect();
    format!("{}\n\n`mishandle list SEARCH` lists the options of a search.", table(&all))
}

/// Returns the description of a search.
pub fn page(entry: &SearchEntry) -> String {
    let options: Vec<String> = (entry.options)().iter().map(paragraph).collect();
    let options = if options.is_empty() {
        "Options: none".to_string()
    } else {
        format!(
            "Options (set with `falsify -k falsify.options.NAME=VALUE` or in [falsify.options] of a plan)\n\
             {}\n\n{}",
            options.join("\n"),
            wrapped(UNITS, output::width())
        )
    };
    let reference = indented(&wrapped(entry.reference, output::width() - 2), 2);
    format!("{}: {}\n\n{options}\n\nReference\n{reference}", entry.name, entry.summary)
}

/// Formats an option: name, type, range and default in one line, the meaning below.
fn paragraph(option: &OptionSpec) -> String {
    let range = if option.range.is_empty() { String::new() } else { format!(", {}", option.range) };
    format!(
        "  {}: {}{range} [default: {}]\n{}",
        option.name,
        option.kind.name(),
        option.default,
        indented(&wrapped(&option.meaning, output::width() - 4), 4)
    )
}

fn indented(text: &str, spaces: usize) -> String {
    text.lines().map(|line| format!("{:spaces$}{line}", "")).collect::<Vec<_>>().join("\n")
}
