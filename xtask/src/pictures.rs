//! `cargo xtask pictures`: draws the start of every task of the benchmark, into `docs/tasks/TASK.png`, and shows them in README.md.
//!
//! A picture's bits depend on the OpenGL that draws it, so they are looked at, not compared.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result};
use serde_json::Value;

use crate::marks::replace;
use crate::process::{cargo, output, run};

const PROGRAM: &[&str] = &["run", "--quiet", "-p", "mishandle-cli", "--bin", "mishandle", "--"];
const FOLDER: &str = "docs/tasks";
const SIZE: &str = "640x480";

/// How wide each picture is shown: four stand side by side.
const SHOWN: &str = "24%";

/// Draws every task.
///
/// # Errors
/// If the program cannot be built, or cannot draw.
pub fn draw(root: &Path) -> Result<()> {
    let program = |arguments: &[&str]| cargo(root, &[PROGRAM, arguments].concat());
    let tasks: Value = serde_json::from_str(&output(&mut program(&["tasks", "--json"]))?)?;
    let own = tasks.as_array().into_iter().flatten().filter(|task| task["variant_of"].is_null());
    let names: Vec<&str> = own.filter_map(|task| task["name"].as_str()).collect();
    fs::create_dir_all(root.join(FOLDER)).context(FOLDER)?;
    for name in &names {
        let path = format!("{FOLDER}/{name}.png");
        run(&mut program(&["render", name, "--size", SIZE, "--force", "--out", &path]), &[0])?;
    }
    replace(&root.join("README.md"), "pictures", &gallery(&names))
}

fn gallery(names: &[&str]) -> String {
    let picture =
        |name: &&str| format!("<img src=\"{FOLDER}/{name}.png\" width=\"{SHOWN}\" alt=\"{name}\">\n");
    names.iter().map(picture).collect()
}
