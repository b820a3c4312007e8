//! `cargo xtask settings`: writes the page of all training settings.

use std::path::Path;

use anyhow::Result;

use crate::process::{cargo, run};

/// Writes the page. A test of the example compares it.
///
/// # Errors
/// If the example cannot be built, or the page cannot be written.
pub fn write(root: &Path) -> Result<()> {
    run(&mut cargo(root, &["run", "--quiet", "-p", "mishandle-training", "--example", "settings_page"]), &[0])
}
