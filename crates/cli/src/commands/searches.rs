use anyhow::Result;
use mishandle::search::{OptionSpec, SEARCHES, SearchEntry};
use serde_json::{Value, json};

use crate::output::{self, table, wrapped};
use crate::{ExitStatus, args};

/// What the options count in.
const UNITS: &str = "d is the number of coordinates, one for each axis of the scenario space (`--space`). Each runs from 0 to \
                     1, from the lower bound of its axis to the upper one; points and tolerances are in these units.";

pub fn run(command: &args::Searches) -> Result<ExitStatus> {
    let chosen = match &command.search {
        Some(name) => std::slice::from_ref(mishandle::search_entry(name)?),
        None => SEARCHES,
    };
    if command.json {
        output::json(chosen.iter().map(document).collect())?;
    } else if let (Some(_), [entry]) = (&command.search, chosen) {
        output::line(&page(entry))?;
    } else {
        output::line(&list(chosen))?;
    }
    Ok(ExitStatus::Done)
}

fn document(entry: &SearchEntry) -> Value {
    let option = |option: &OptionSpec| {
        json!({
            "name": option.name,
            "type": option.kind.name(),
            "default": option.default,
            "range": option.range,
            "meaning": option.meaning,
        })
    };
    json!({
        "name": entry.name,
        "summary": entry.summary,
        "reference": entry.reference,
        "options": (entry.options)().iter().map(option).collect::<Vec<_>>(),
    })
}

fn list(entries: &[SearchEntry]) -> String {
    let head = ["search", "summary"].map(String::from).to_vec();
    let rows = entries.iter().map(|entry| vec![entry.name.to_string(), entry.summary.to_string()]);
    let all: Vec<Vec<String>> = std::iter::once(head).chain(rows).collect();
    format!("{}\n\n`mishandle searches SEARCH` explains one with its options.", table(&all))
}

fn page(entry: &SearchEntry) -> String {
    let options: Vec<String> = (entry.options)().iter().map(paragraph).collect();
    let options = if options.is_empty() {
        "Options: none".to_string()
    } else {
        format!(
            "Options, set by `falsify --search-option NAME=VALUE` or the table [falsify.options] of a plan\n{}\n\n{}",
            options.join("\n"),
            wrapped(UNITS, output::width())
        )
    };
    let reference = indented(&wrapped(entry.reference, output::width() - 2), 2);
    format!("{}: {}\n\n{options}\n\nReference\n{reference}", entry.name, entry.summary)
}

/// Name, type, range and default in one line, and the meaning below.
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
