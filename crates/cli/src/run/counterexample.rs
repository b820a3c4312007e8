//! Files of exported counterexamples.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use mishandle::{Counterexample, CounterexampleReplay, ResolvedPlan};

use crate::flags::is_file;
use crate::show::output;

/// Checks the file of `--out`, in which one counterexample will be written, before the simulations.
pub fn check_out(out: Option<&Path>, resolved: &ResolvedPlan, force: bool) -> Result<()> {
    let Some(out) = out else { return Ok(()) };
    ensure!(is_file(out), "--out is {}; it must end with .json", out.display());
    output::refuse_inputs(out, "--out", [Path::new(&resolved.plan.controller)])?;
    drop(output::create(out, force)?);
    Ok(())
}

/// Reads an exported counterexample, simulates it again, and warns if another build made it. `controller` is the present path of its controller.
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
pub fn read(path: &Path) -> Result<Counterexample> {
    match Counterexample::read(path) {
        // Names the path itself.
        Err(error @ mishandle::MishandleError::File { .. }) => Err(error.into()),
        read => read.with_context(|| path.display().to_string()),
    }
}
