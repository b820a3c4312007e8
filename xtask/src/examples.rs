//! `cargo xtask examples`: runs the robots in files, and the Python examples, which need PyTorch
//! and other large packages.
//!
//! Each file of requirements in `python/examples` has a virtual environment under `target`. An
//! example that no other file is named after uses `requirements.txt`.

use std::fs;
use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result, bail, ensure};

use crate::mujoco;
use crate::process::run;
use crate::robots::{self, ROBOTS};
use crate::venv::environment;

/// Examples whose packages exclude those of `requirements.txt`, with their file of requirements.
const OTHER_REQUIREMENTS: &[(&str, &str)] = &[
    ("fetch", "requirements-robots.txt"),
    ("lift", "requirements-robots.txt"),
    ("point_reaching_lerobot", "requirements-lerobot.txt"),
    ("pusht", "requirements-lerobot.txt"),
];
/// Modules that the examples import.
const NO_EXAMPLES: &[&str] = &["lerobot_commands", "recording"];

/// Runs the named examples (all without a name) with the remaining arguments, those that start with
/// `--`.
///
/// # Errors
/// If a name is unknown, or a command fails.
pub fn examples(root: &Path, arguments: &[String]) -> Result<()> {
    let (options, names): (Vec<_>, Vec<_>) =
        arguments.iter().cloned().partition(|argument| argument.starts_with("--"));
    let folder = root.join("python/examples");
    let mut known = find(&folder)?;
    known.extend(ROBOTS.iter().map(|robot| robot.name.to_string()));
    for name in &names {
        ensure!(known.contains(name), "unknown example `{name}`; expected one of {}", known.join(", "));
    }
    let chosen = if names.is_empty() { known } else { names };
    mujoco::fetch(root)?;
    for name in &chosen {
        if let Some(robot) = ROBOTS.iter().find(|robot| robot.name == *name) {
            robots::show(root, robot)?;
            continue;
        }
        let python =
            environment(root, &root.join("target/examples-venv"), &folder.join(requirements_of(name)))?;
        eprintln!("running python/examples/{name}.py");
        run(Command::new(python).arg(format!("{name}.py")).args(&options).current_dir(&folder), &[0])?;
    }
    Ok(())
}

/// Returns the names of the examples, sorted.
fn find(folder: &Path) -> Result<Vec<String>> {
    let entries = fs::read_dir(folder).with_context(|| format!("cannot read {}", folder.display()))?;
    let paths = entries.map(|entry| Ok(entry?.path())).collect::<Result<Vec<_>>>()?;
    let mut names: Vec<String> = paths
        .iter()
        .filter(|path| path.extension().is_some_and(|extension| extension == "py"))
        .filter_map(|path| Some(path.file_stem()?.to_string_lossy().into_owned()))
        .filter(|name| !NO_EXAMPLES.contains(&name.as_str()))
        .collect();
    names.sort();
    if names.is_empty() {
        bail!("{} contains no examples", folder.display());
    }
    Ok(names)
}

fn requirements_of(example: &str) -> &'static str {
    OTHER_REQUIREMENTS.iter().find(|(name, _)| *name == example).map_or("requirements.txt", |(_, file)| file)
}
