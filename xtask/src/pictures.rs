//! `cargo xtask pictures`: draws the start of every task of the benchmark to `picture.png` in its
//! folder.
//!
//! The pixels depend on the OpenGL driver, so people look at the pictures and no test compares
//! them.

use std::path::Path;

use anyhow::Result;
use serde_json::Value;

use crate::process::{cargo, output, run};

const PROGRAM: &[&str] = &["run", "--quiet", "-p", "mishandle-cli", "--bin", "mishandle", "--"];
const TASKS: &str = "crates/tasks/src";
const SIZE: &str = "640x480";

/// Draws every task.
///
/// # Errors
/// If the program cannot be built or cannot draw.
pub fn draw(root: &Path) -> Result<()> {
    let program = |arguments: &[&str]| cargo(root, &[PROGRAM, arguments].concat());
    let tasks: Value = serde_json::from_str(&output(&mut program(&["list", "tasks", "--json"]))?)?;
    let own = tasks["tasks"].as_array().into_iter().flatten().filter(|task| task["variant_of"].is_null());
    let names = own.filter_map(|task| task["name"].as_str());
    for name in names {
        let path = format!("{TASKS}/{}/picture.png", name.replace('-', "_"));
        run(&mut program(&["render", name, "--size", SIZE, "--force", "--out", &path]), &[0])?;
    }
    Ok(())
}
