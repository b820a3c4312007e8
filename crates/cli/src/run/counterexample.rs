//! Files of exported counterexamples.

use std::path::Path;

use anyhow::{Context, Result};
use mishandle::counterexample::{Counterexample, CounterexampleReplay};
use mishandle::resolve::Moved;

use crate::show::output;

/// Reads an exported counterexample, simulates it again, and warns if another build made it.
/// `moved` has the present paths of its files.
pub fn replay(path: &Path, moved: Moved<'_>) -> Result<(Counterexample, CounterexampleReplay)> {
    let counterexample = read(path)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let replayed = counterexample.replay(&counterexample.resolve(folder, moved)?)?;
    for difference in &replayed.build_differences {
        output::message(&format!("warning: another build made the counterexample: {difference}"));
    }
    Ok((counterexample, replayed))
}

/// Reads an exported counterexample. Errors name its path.
fn read(path: &Path) -> Result<Counterexample> {
    match Counterexample::read(path) {
        // Names the path itself.
        Err(error @ mishandle::MishandleError::File { .. }) => Err(error.into()),
        read => read.with_context(|| path.display().to_string()),
    }
}
