//! `cargo xtask results`: writes what is made from the result types: the reference page, the JSON
//! Schemas, the Python classes.

use std::path::Path;

use anyhow::Result;

use crate::process::{cargo, output};

/// Writes the files. A test of the example compares them.
///
/// # Errors
/// If the example cannot be built, or a file cannot be written.
pub fn write(root: &Path) -> Result<()> {
    let arguments = ["run", "--quiet", "-p", "mishandle-results", "--example", "generate"];
    output(&mut cargo(root, &arguments)).map(drop)
}
