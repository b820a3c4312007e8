//! Writes the reference of all settings. `cargo xtask settings` runs it; the test of this example
//! compares it with the file.

use std::fs;
use std::path::{Path, PathBuf};

use mishandle_training::{ALGORITHMS, Setting};

/// The page.
const PAGE: &str = "docs/reference/algorithms/settings.md";

const HEAD: &str = "\
# All settings

A settings file is TOML. The keys of an algorithm's first table are at the top of the file, those of the other tables under
`[run]`, `[episodes]` and so on:

```toml
gamma = 0.995

[run]
total_steps = 2_000_000
stop_success = 0.98

[episodes]
action_noise = 0.5
```

Whole numbers are written out, as 20_000_000. A missing key has the default below, or the value of the base if the file
contains `base = \"skrl-0.10\"` ([settings bases](../bases.md)).

`mishandle train TASK --algorithm NAME --dry-run` prints all settings of a training run. The settings of the shipped
controllers are in [controllers/training](../../../controllers/training). [Train a controller](../../guide/training.md) explains what
the algorithms share.

`cargo xtask settings` generates this page from the declarations in [crates/training](../../../crates/training/src).";

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

/// Returns the path of the page.
fn path() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(PAGE)
}

/// Returns the page.
fn page() -> String {
    let mut lines = vec![HEAD.to_string()];
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
    fs::write(path(), page())
}

#[test]
fn the_page_is_up_to_date() {
    let found = fs::read_to_string(path()).unwrap();
    assert!(found == page(), "{PAGE} is out of date; run: cargo xtask settings");
}
