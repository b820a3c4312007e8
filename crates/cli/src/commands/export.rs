use std::path::Path;

use anyhow::{Context, Result, bail};
use mishandle::files::AtomicFile;
use mishandle::plural;
use mishandle::store::{self, RunFile};

use crate::{ExitStatus, args, output, run};

/// Writes all simulations of a run.
type Writer = fn(&RunFile, &mut AtomicFile) -> store::Result<()>;

pub fn run(command: &args::Export) -> Result<ExitStatus> {
    let write = writer(&command.out)?;
    let file = run::read(&command.file, command.skip_check)?;
    let mut out = output::create(&command.out, command.force)?;
    let failed = || format!("cannot write {}", command.out.display());
    write(&file, &mut out).with_context(failed)?;
    out.persist().with_context(failed)?;
    let simulations = file.counts()?.simulations;
    output::message(&format!("wrote {} to {}", plural(simulations, "simulation"), command.out.display()));
    Ok(ExitStatus::Done)
}

/// Returns the writer for the extension of a file.
fn writer(out: &Path) -> Result<Writer> {
    match out.extension().and_then(|extension| extension.to_str()) {
        Some("csv") => Ok(store::export_csv),
        Some("parquet") => Ok(store::export_parquet),
        _ => bail!("--out is {}; it must end in .csv or .parquet", out.display()),
    }
}
