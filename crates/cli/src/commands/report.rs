use std::path::Path;

use anyhow::{Context, Result};
use mishandle::store::RunFile;
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
    let skipped = match command.no_simulations {
        true => Some("--no-simulations was given".to_string()),
        false => measure(&mut report, &file, command)?,
    };
    if let Some(reason) = skipped {
        report.add_note(format!(
            "Sizes of failing patches, repeats with other seeds, corners, the share of noise and pictures are missing, because \
             they take simulations: {reason}."
        ));
        if !command.no_simulations {
            output::message(&format!("{}: no simulations: {reason}", path.display()));
        }
    }
    Ok(report)
}

/// Adds what takes simulations. Returns why there are none.
fn measure(report: &mut RunReport, file: &RunFile, command: &args::Report) -> Result<Option<String>> {
    let controller = command.controller.as_deref();
    let resolved = match mishandle::recorded_plan(file.header(), controller) {
        Ok(resolved) => resolved,
        Err(error) => return Ok(Some(error.to_string())),
    };
    let (then, now) = (&file.header().target, &resolved.target.identity);
    // A file of format version 1 has no hash.
    if then.kind != now.kind || (then.hash != now.hash && !then.hash.is_empty()) {
        return Ok(Some(format!("the target {} is not the one of the run any more", then.name)));
    }
    let bar = Bar::new(0, "simulations");
    report.measure(file, &resolved, controller, command.probes, |done, total| {
        bar.set_length(total);
        bar.set_position(done);
    })?;
    bar.clear();
    Ok(None)
}
