use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clap::Args;
use mishandle::store::RunFile;
use mishandle_report::{RunReport, page};

use crate::progress::Bar;
use crate::{ExitStatus, args, numbers, output, run};

/// Write a page about runs: verdict, failure modes, robustness maps, traces, pictures
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle report runs/RUN.sqlite --out report.html
  mishandle report runs/A.sqlite runs/B.sqlite --out report.html     one section each, and a table
  mishandle report runs/RUN.sqlite --no-simulations --out report.html

The page is one HTML file that loads nothing and runs no script. docs/report.md explains its
charts. If the target of a run is available, scenarios around each failure mode are simulated,
corners, and repeats with other seeds. Otherwise the page has what the run file contains.")]
pub struct Arguments {
    /// Run files of `mishandle evaluate` or `mishandle falsify`
    #[arg(value_name = "RUN", required = true)]
    pub runs: Vec<PathBuf>,
    /// HTML file to create
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Overwrite FILE if it exists
    #[arg(long)]
    pub force: bool,
    /// Number of random scenarios around each failure mode, which estimate the size of the failing patch; 0 skips this
    #[arg(long, value_name = "N", default_value = "64", allow_negative_numbers = true)]
    #[arg(value_parser = numbers::integer::<u32>(args::SCENARIOS), conflicts_with = "no_simulations")]
    pub probes: u32,
    /// Show only what the run files contain
    #[arg(long)]
    pub no_simulations: bool,
    /// New path of the runs' controller, if the file was moved
    #[arg(long, value_name = "C")]
    pub controller: Option<String>,
    /// Do not check the whole run files before reading them; a record is still checked when it is read
    #[arg(long)]
    pub skip_check: bool,
    /// Number of threads; does not affect the page [default: number of cores]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<usize>(args::THREADS))]
    pub threads: Option<usize>,
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    run::set_threads(command.threads)?;
    // Fails before the simulations if the output cannot be written.
    drop(output::create(&command.out, command.force)?);
    let mut reports = Vec::new();
    for path in &command.runs {
        let file = run::read(path, command.skip_check)?;
        let report = report(&file, path, command).with_context(|| path.display().to_string())?;
        reports.push(report);
    }
    let page = page(&reports);
    output::write_atomically(&command.out, command.force, page.as_bytes())?;
    let size = page.len().div_ceil(1000);
    output::message(&format!("wrote {} ({size} kB)", command.out.display()));
    Ok(ExitStatus::Done)
}

fn report(file: &RunFile, path: &Path, command: &Arguments) -> Result<RunReport> {
    let mut report = RunReport::load(file, &path.to_string_lossy())?;
    if command.no_simulations {
        report.note_no_simulations("--no-simulations was given");
        return Ok(report);
    }
    let bar = Bar::new(0, "simulations");
    let skipped = report.measure(file, command.controller.as_deref(), command.probes, |done, total| {
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
