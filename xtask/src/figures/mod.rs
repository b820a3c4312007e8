//! `cargo xtask figures`: measures the shipped controllers and the experts, and writes the tables of README.md and
//! controllers/README.md.
//!
//! What was measured of a controller is kept as it was printed, in `controllers/figures/TASK/CONTROLLER.json`; the
//! tables are made of these records alone. A table stands between two comments, `<!-- figures: NAME -->` and
//! `<!-- end of figures -->`; nothing in it is typed by hand.

mod measure;
mod paper;
mod tables;

use std::fs;
use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result, bail};
use serde_json::Value;

use crate::process::{cargo, output, run};
use measure::Record;

const PROGRAM: &str = "target/release/mishandle";

/// Measures what `arguments` say (`--only TASK` or `--only TASK/CONTROLLER`; without, everything that has no record
/// yet; `--all`, everything), and rewrites the tables.
///
/// # Errors
/// If something cannot be built, measured, read or written.
pub fn remake(root: &Path, arguments: &[String]) -> Result<()> {
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let (all, only) = match words.as_slice() {
        [] => (false, None),
        ["--all"] => (true, None),
        ["--only", name] => (false, Some(*name)),
        _ => bail!("`figures` takes --all or --only TASK[/CONTROLLER], not `{}`", arguments.join(" ")),
    };
    run(&mut cargo(root, &["build", "--release", "-p", "mishandle-cli"]), &[0])?;
    let tasks: Value = serde_json::from_str(&output(program(root).args(["tasks", "--json"]))?)?;
    let (mut records, mut chosen) = (Vec::new(), 0);
    for task in tasks.as_array().context("`tasks --json` is no list")? {
        for controller in task["controllers"].as_array().into_iter().flatten() {
            let (name, controller) = (text(&task["name"]), text(controller));
            let asked = only.map(|only| only == name || only == format!("{name}/{controller}"));
            let old = Record::load(root, &name, &controller)?;
            let wanted = all || asked.unwrap_or(old.is_none());
            chosen += usize::from(asked == Some(true));
            match old {
                Some(record) if !wanted => records.push(record),
                None if !wanted => eprintln!("{name} {controller}: not measured yet"),
                _ => {
                    records.push(Record::measure(root, task, &controller)?);
                    eprintln!("{name} {controller}: measured");
                }
            }
        }
    }
    if let (Some(only), 0) = (only, chosen) {
        bail!("no task or controller is called `{only}`");
    }
    replace(&root.join("README.md"), "tasks", &tables::tasks(&tasks, &records))?;
    replace(&root.join("controllers/README.md"), "controllers", &tables::controllers(root, &records)?)
}

fn program(root: &Path) -> Command {
    let mut command = Command::new(root.join(PROGRAM));
    command.current_dir(root);
    command
}

fn text(value: &Value) -> String {
    value.as_str().unwrap_or_default().to_string()
}

/// Puts `table` between the comments of that name in a file.
pub fn replace(path: &Path, name: &str, table: &str) -> Result<()> {
    let old = fs::read_to_string(path).with_context(|| path.display().to_string())?;
    let new = replaced(&old, name, table).with_context(|| path.display().to_string())?;
    fs::write(path, new)?;
    Ok(())
}

fn replaced(old: &str, name: &str, table: &str) -> Result<String> {
    let (begin, end) = (format!("<!-- figures: {name} -->"), "<!-- end of figures -->");
    let start = old.find(&begin).with_context(|| format!("it has no `{begin}`"))? + begin.len();
    let stop = start + old[start..].find(end).with_context(|| format!("it has no `{end}`"))?;
    Ok(format!("{}\n{}\n{}", &old[..start], table.trim_end(), &old[stop..]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_stands_between_the_comments_is_replaced() {
        let old = "a\n<!-- figures: x -->\nold\n<!-- end of figures -->\nb\n";
        let new = replaced(old, "x", "new\n").unwrap();
        assert_eq!(new, "a\n<!-- figures: x -->\nnew\n<!-- end of figures -->\nb\n");
        assert!(replaced(old, "y", "new").unwrap_err().to_string().contains("figures: y"));
    }
}
