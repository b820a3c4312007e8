use std::path::Path;

use anyhow::{Context, Result};
use mishandle_report::{RunReport, page};

use crate::progress::Bar;
use crate::{ExitStatus, args, output, run};

pub fn run(command: &args::Report) -> Result<ExitStatus> {
    run::set_threads(command.threads)?;
    // Fails before the simulations if the output cannot be written.
    drop(output::create(&command.out, command.force)?);
    let mut reports = Vec::new();
    for path in &command.runs {
        reports.push(report(path, command).with_context(|| path.display().to_string())?);
    }
    let page = page(&reports);
    output::write_atomically(&command.out, command.force, page.as_bytes())?;
    let size = page.len().div_ceil(1000);
    output::message(&format!("wrote {} ({size} kB)", command.out.display()));
    Ok(ExitStatus::Done)
}

fn report(path: &Path, command: &args::Report) -> Result<RunReport> {
    let file = run::read(path, command.skip_check)?;
    let mut report = RunReport::load(&file, &path.to_string_lossy())?;
    if command.no_simulations {
        report.note_no_simulations("--no-simulations was given");
        return Ok(report);
    }
    let bar = Bar::new(0, "simulations");
    let skipped = report.measure(&file, command.controller.as_deref(), command.probes, |done, total| {
        bar.set_length(total);
        bar.set_position(done);
    })?;
    bar.clear();
    if let Some(reason) = skipped {
        report.note_no_simulations(&reason);
        output::message(&format!("{}: no simulations: {reason}", path.display()));
    }
    Ok(report)
}
