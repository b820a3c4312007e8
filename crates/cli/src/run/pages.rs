//! Pages about runs and campaigns.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use mishandle::run::CampaignRun;
use mishandle::store::RunFile;
use mishandle_report::{Measurement, RunReport, RunSummary, Samples, campaign_page, run_page};
use mishandle_text::plural;
use mishandle_text::shell_quote;

use super::{ExitStatus, file, tables};
use crate::interrupt::control_flow;
use crate::show::output;
use crate::show::progress::Bar;

/// The page of a campaign that leads to all others.
const INDEX: &str = "index.html";

/// Folder of the pages of the runs, in that of a campaign's pages.
const RUNS: &str = "runs";

/// Contents of pages.
pub struct Options<'a> {
    /// Random scenarios around each failure mode, and the progress bar; `None` to simulate nothing.
    pub simulations: Option<(Samples, &'a Bar)>,
    /// Present path of the runs' controller, if the file was moved.
    pub controller: Option<&'a str>,
    pub skip_check: bool,
    /// Whether existing files are replaced.
    pub force: bool,
}

impl Options<'_> {
    /// Clears the progress bar.
    pub fn clear(&self) {
        if let Some((_, bar)) = self.simulations {
            bar.clear();
        }
    }
}

/// Why nothing is simulated.
pub const NO_SIMULATIONS: &str = "they were not requested (--no-simulations)";

/// Writes the pages of a campaign to the folder `out`: an index, the tables, and a page for each
/// run.
pub fn write_campaign(campaign: &Path, out: &Path, options: &Options<'_>) -> Result<ExitStatus> {
    let runs = mishandle::run::campaign_runs(campaign)?;
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
        let file = file::read(path, options.skip_check)?;
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
    let tables = tables::write(campaign, out)?;
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
pub fn report(file: &RunFile, path: &Path, options: &Options<'_>) -> Result<Option<RunReport>> {
    let mut report = RunReport::load(file, &path.to_string_lossy())?;
    report.add_answer(file, options.controller)?;
    let Some((samples, bar)) = options.simulations else {
        report.note_no_simulations(NO_SIMULATIONS);
        return Ok(Some(report));
    };
    bar.set_note(path.display().to_string());
    let measured = report.measure(file, options.controller, samples, |done, total| {
        bar.set_length(total);
        bar.set_position(done);
        control_flow()
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
