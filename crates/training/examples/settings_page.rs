//! Writes the page of all settings, `docs/algorithms/settings.md`, to stdout; `cargo xtask settings` keeps it.

#![allow(clippy::print_stdout, reason = "the page goes there")]

use mishandle_training::{ALGORITHMS, Setting};

const HEAD: &str = "\
# All settings

A settings file is TOML: the keys of an algorithm's first table stand at the top, those of the others under `[run]`,
`[episodes]` and so on. What a file leaves out has the default below, unless it begins with `preset = \"skrl-0.10\"`
([settings presets](../presets.md)). `mishandle train TASK --algorithm NAME --dry-run` tells the settings of a training with
their values; those of the controllers here are in [experiments/training](../../experiments/training). What the
algorithms do with them: [algorithms](README.md). Whole numbers are written out, as 20_000_000. For example:

```toml
gamma = 0.995

[run]
total_steps = 2_000_000
stop_success = 0.98

[episodes]
action_noise = 0.5
```

This page is made from the declarations in [crates/training](../../crates/training/src) by `cargo xtask settings`.";

/// What each table is about.
fn heading(algorithm: &str, table: &str) -> String {
    let algorithm = algorithm.to_uppercase();
    let about = match table {
        "" => return format!("## {algorithm}"),
        "run" => ": how long to train, when to look how it goes, when to stop",
        "episodes" => ": the simulations that are learned from",
        "replay" => ": what is remembered, and how much is learned from it",
        "policy" => ": the network that acts, and its normaliser",
        "critic" => ": what learns values",
        _ => "",
    };
    format!("### {algorithm}, `[{table}]`{about}")
}

/// A text with a capital at its start.
fn sentence(text: &str) -> String {
    let (first, rest) = text.split_at(text.chars().next().map_or(0, char::len_utf8));
    first.to_uppercase() + rest
}

/// A text in one line, safe inside a cell.
fn cell(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ").replace('|', "\\|")
}

fn row(setting: &Setting, default: Option<&str>) -> String {
    let (_, key) = setting.table_and_key();
    let default = default.map_or("not set".to_string(), |default| format!("`{default}`"));
    let choices = setting.choices.iter();
    let choices: Vec<String> =
        choices.map(|choice| format!("`\"{}\"`: {}", choice.name, cell(choice.meaning))).collect();
    let allowed = if choices.is_empty() { cell(&setting.wanted) } else { choices.join("<br>") };
    format!("| `{key}` | {default} | {} | {allowed} |", cell(setting.meaning))
}

fn main() {
    println!("{HEAD}");
    for entry in ALGORITHMS {
        let mut within = None;
        for (setting, default) in (entry.default)().values() {
            let (table, _) = setting.table_and_key();
            if within != Some(table) {
                println!("\n{}\n", heading(entry.name, table));
                if table.is_empty() {
                    println!("{}.\n", sentence(entry.summary));
                }
                println!("| key | default | meaning | allowed |\n|---|---|---|---|");
                within = Some(table);
            }
            println!("{}", row(&setting, default.as_deref()));
        }
    }
}
