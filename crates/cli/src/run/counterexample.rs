//! Files of exported counterexamples.

use std::path::Path;

use anyhow::{Context, Result};
use mishandle::counterexample::{Counterexample, CounterexampleReplay};

use crate::show::output;

/// Reads an exported counterexample, simulates it again, and warns if another build made it.
/// `controller` is the present path of its controller.
pub fn replay(path: &Path, controller: Option<&str>) -> Result<(Counterexample, CounterexampleReplay)> {
    let counterexample = read(path)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let replayed = counterexample.replay(&counterexample.resolve(folder, controller)?)?;
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
