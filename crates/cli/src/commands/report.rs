use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clap::Args;
use mishandle::store::RunFile;
use mishandle::{CampaignRun, plural, shell_quote};
use mishandle_report::{Measurement, RunReport, RunSummary, campaign_page, page, run_page};

use super::reproduce;
use crate::progress::Bar;
use crate::{ExitStatus, args, numbers, output, run};

/// Write a page about runs: verdict, failure modes, robustness maps, traces, pictures
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle report runs/RUN.sqlite --out report.html
  mishandle report runs/A.sqlite runs/B.sqlite --out report.html     one section each, and a table
  mishandle report runs/campaign-1 --out pages          index and a page for each run of a campaign
  mishandle report runs/RUN.sqlite --no-simulations --out report.html

The page is one HTML file that loads nothing and runs no script. docs/guide/report.md explains its
charts. If the target of a run is available, scenarios around each failure mode are simulated,
corners, and repeats with other seeds. Otherwise the page has what the run file contains.")]
pub struct Arguments {
    /// Run files of `mishandle evaluate` or `mishandle falsify`, or the folder of a campaign
    #[arg(value_name = "RUN", required = true)]
    pub runs: Vec<PathBuf>,
    /// HTML file to create; for a campaign, a folder for the index and a page for each run
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

/// The page of a campaign that leads to all others.
const INDEX: &str = "index.html";

/// Folder of the pages of the runs, in that of a campaign's pages.
const RUNS: &str = "runs";

/// What pages contain.
pub struct Options<'a> {
    /// Random scenarios around each failure mode, and the progress bar; `None` to simulate nothing.
    pub simulations: Option<(u32, &'a Bar)>,
    /// Present path of the runs' controller, if the file was moved.
    pub controller: Option<&'a str>,
    pub skip_check: bool,
    /// Whether existing files are replaced.
    pub force: bool,
}

impl Options<'_> {
    /// Clears the progress bar.
    fn clear(&self) {
        if let Some((_, bar)) = self.simulations {
            bar.clear();
        }
    }
}

/// Why nothing is simulated.
const NO_SIMULATIONS: &str = "they were not requested (--no-simulations)";

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    run::set_threads(command.threads)?;
    let controller = command.controller.as_deref().map(Path::new);
    let inputs = command.runs.iter().map(PathBuf::as_path).chain(controller);
    output::refuse_inputs(&command.out, "--out", inputs)?;
    let bar = Bar::new(0, "simulations");
    run::stop_on_signals(&bar)?;
    let options = Options {
        simulations: (!command.no_simulations).then_some((command.probes, &bar)),
        controller: command.controller.as_deref(),
        skip_check: command.skip_check,
        force: command.force,
    };
    if let [folder] = &command.runs[..]
        && folder.is_dir()
    {
        return write_campaign(folder, &command.out, &options);
    }
    if let Some(folder) = command.runs.iter().find(|path| path.is_dir()) {
        bail!("{} is a folder; name run files, or one folder of a campaign alone", folder.display());
    }
    // Fails before the simulations if the output cannot be written.
    drop(output::create(&command.out, command.force)?);
    let mut reports = Vec::new();
    for path in &command.runs {
        let file = run::read(path, options.skip_check)?;
        let report = report(&file, path, &options).with_context(|| path.display().to_string())?;
        let Some(report) = report else {
            bar.clear();
            output::message(&format!(
                "interrupted: nothing is kept, {} is not written",
                command.out.display()
            ));
            return Ok(ExitStatus::Interrupted);
        };
        reports.push(report);
    }
    bar.clear();
    let page = page(&reports);
    output::write_atomically(&command.out, command.force, page.as_bytes())?;
    let size = page.len().div_ceil(1000);
    output::message(&format!("wrote {} ({size} kB)", command.out.display()));
    Ok(ExitStatus::Done)
}

/// Writes the pages of a campaign to the folder `out`: an index, the tables, and a page for each run.
pub fn write_campaign(campaign: &Path, out: &Path, options: &Options<'_>) -> Result<ExitStatus> {
    let runs = mishandle::campaign_runs(campaign)?;
    let index = out.join(INDEX);
    if index.exists() && !options.force {
        bail!("{} exists already; choose another --out, or overwrite it with --force", index.display());
    }
    let pages = out.join(RUNS);
    std::fs::create_dir_all(&pages).with_context(|| format!("cannot write {}", pages.display()))?;
    let mut size = 0;
    let mut write = |path: PathBuf, html: &str| {
        size += html.len();
        output::write_atomically(&path, true, html.as_bytes())
    };
    let mut summaries = Vec::new();
    for CampaignRun { name, path, .. } in &runs {
        let file = run::read(path, options.skip_check)?;
        let report = report(&file, path, options).with_context(|| path.display().to_string())?;
        let Some(report) = report else {
            options.clear();
            output::message(&format!(
                "interrupted: {} of {} are kept in {}, the others and the index are not written",
                summaries.len(),
                plural(runs.len() as u64, "page"),
                pages.display()
            ));
            return Ok(ExitStatus::Interrupted);
        };
        write(pages.join(format!("{name}.html")), &run_page(&report, &format!("../{INDEX}")))?;
        summaries.push(RunSummary::new(&report, name, &format!("{RUNS}/{name}.html")));
    }
    let tables = reproduce::write_tables(campaign, out)?;
    let name = campaign.canonicalize().unwrap_or_else(|_| campaign.to_path_buf());
    let name = name.file_name().map_or(String::new(), |name| name.to_string_lossy().into_owned());
    write(index.clone(), &campaign_page(&name, &summaries, &tables))?;
    options.clear();
    output::message(&format!(
        "Pages: {} ({} in {}, {} kB)",
        shell_quote(&index.to_string_lossy()),
        plural(runs.len() as u64, "run"),
        shell_quote(&pages.to_string_lossy()),
        size.div_ceil(1000)
    ));
    Ok(ExitStatus::Done)
}

/// Returns the report of a run; `None` after an interruption.
fn report(file: &RunFile, path: &Path, options: &Options<'_>) -> Result<Option<RunReport>> {
    let mut report = RunReport::load(file, &path.to_string_lossy())?;
    let Some((probes, bar)) = options.simulations else {
        report.note_no_simulations(NO_SIMULATIONS);
        return Ok(Some(report));
    };
    bar.set_note(path.display().to_string());
    let measured = report.measure(file, options.controller, probes, |done, total| {
        bar.set_length(total);
        bar.set_position(done);
        run::control_flow()
    })?;
    match measured {
        Measurement::Interrupted => return Ok(None),
        Measurement::Skipped { reason } => {
            report.note_no_simulations(&reason);
            let said = format!("{}: no simulations: {reason}", path.display());
            bar.line().suspend(|| output::message(&said));
        }
        Measurement::Done => {}
    }
    Ok(Some(report))
}
