//! Opens pages in the browser of the desktop.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::Result;
use mishandle_text::shell_path;

use crate::show::output;

/// Returns the file of a page about a run if none was named: beside the run, with the end of its
/// name.
pub fn page_beside(run: &Path, end: &str) -> PathBuf {
    let stem = run.file_stem().map_or("page".into(), |stem| stem.to_string_lossy().into_owned());
    run.with_file_name(format!("{stem}{end}.html"))
}

/// Opens a page where a display exists, and says otherwise where the page is.
pub fn open(page: &Path) -> Result<()> {
    let has_display = ["DISPLAY", "WAYLAND_DISPLAY"].iter().any(|name| std::env::var_os(name).is_some());
    let mut opener = Command::new("xdg-open");
    opener.arg(std::path::absolute(page)?).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    if !has_display || opener.spawn().is_err() {
        output::message(&format!("no browser can be opened here; open {} in one", shell_path(page)));
    }
    Ok(())
}
