//! A recorded simulation: in a run file, or an exported counterexample.

use std::path::Path;

use anyhow::{Result, ensure};
use mishandle::plan::{TraceColumns, TraceSettings};

/// Checks that no flag selects a simulation of an exported counterexample, which holds one.
pub fn check_flags(trial: Option<u32>, simulation: Option<u32>) -> Result<()> {
    ensure!(
        trial.is_none() && simulation.is_none(),
        "the file is one counterexample: --trial and --simulation select a simulation of a run file"
    );
    Ok(())
}

/// Returns whether the trace that goes to a file has more than the signals.
pub fn is_full_trace(settings: &TraceSettings, file: Option<&Path>) -> Result<bool> {
    let is_full = settings.columns == TraceColumns::Full;
    ensure!(!is_full || file.is_some(), "trace.columns has no effect without --trace FILE");
    Ok(is_full)
}
