//! Writes the reference of all settings. `cargo xtask settings` runs it.

use std::fs;
use std::path::Path;

use mishandle_training::{ALGORITHMS, Setting};

/// The text before the tables.
const HEAD: &str = "docs/reference/algorithms/settings.md";

/// Folder of the page.
const REFERENCE: &str = "target/reference";

/// Returns the heading of a table.
fn heading(algorithm: &str, table: &str) -> String {
    let algorithm = algorithm.to_uppercase();
    let about = match table {
        "" => return format!("## {algorithm}"),
        "run" => ": length, validation, early stopping, checkpoints",
        "episodes" => ": the parallel environments",
        "scenarios" => ": the scenarios of the episodes",
        "rewards" => ": reward terms for the manner",
        "replay" => ": the replay buffer and the number of updates",
        "policy" => ": the policy network and the observation normalizer",
        "critic" => ": the value networks",
        _ => "",
    };
    format!("### {algorithm}, `[{table}]`{about}")
}

/// Capitalizes the first letter.
fn sentence(text: &str) -> String {
    let (first, rest) = text.split_at(text.chars().next().map_or(0, char::len_utf8));
    first.to_uppercase() + rest
}

/// Joins a text to one line and escapes it for a table cell.
fn cell(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ").replace('|', "\\|")
}

fn row(setting: &Setting, default: Option<&str>) -> String {
    let (_, key) = setting.table_and_key();
    let default = default.map_or("not set".to_string(), |default| format!("`{default}`"));
    let choices = setting.choices.iter();
    let choices: Vec<String> =
        choices.map(|choice| format!("`\"{}\"`: {}", choice.name, cell(choice.description))).collect();
    let allowed = if choices.is_empty() { cell(&setting.allowed) } else { choices.join("<br>") };
    format!("| `{key}` | {default} | {} | {allowed} |", cell(setting.description))
}

/// Returns the tables that follow the text.
fn tables() -> String {
    let mut lines = Vec::new();
    for entry in ALGORITHMS {
        let mut within = None;
        for (setting, default) in (entry.default)().values() {
            let (table, _) = setting.table_and_key();
            if within != Some(table) {
                lines.push(format!("\n{}\n", heading(entry.name, table)));
                if table.is_empty() {
                    lines.push(format!("{}.\n", sentence(entry.summary)));
                }
                lines.push("| key | default | meaning | allowed |\n|---|---|---|---|".to_string());
                within = Some(table);
            }
            lines.push(row(&setting, default.as_deref()));
        }
    }
    lines.join("\n") + "\n"
}

fn main() -> std::io::Result<()> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let head = fs::read_to_string(root.join(HEAD))?;
    fs::create_dir_all(root.join(REFERENCE))?;
    fs::write(root.join(REFERENCE).join("settings.md"), head + &tables())
}
