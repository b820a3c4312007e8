//! Pages about runs and campaigns.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use mishandle::campaign::campaign_runs;
use mishandle::harden::{FinalRun, final_runs, is_hardening};
use mishandle::resolve::plan_without_program;
use mishandle::results::{BisectedCandidate, Bisection, Hardening};
use mishandle::run::needs_target;
use mishandle::store::RunFile;
use mishandle_report::{
    BisectionEvidence, GridRun, HardenedModes, HardeningSummary, Measurement, Recording, RunReport,
    RunSummary, Samples, ViolatedCounterexamples, campaign_page, hardening_page, run_page, statistics_page,
};
use mishandle_text::{path_text, plural, shell_path};

use super::{ExitStatus, file, path_kind};
use crate::interrupt::control_flow;
use crate::show::output;
use crate::show::progress::Bar;
use crate::words::shell_command;

/// The page of a campaign that leads to all others.
const INDEX: &str = "index.html";

/// Name of the page that compares the runs, without its ending.
const STATISTICS: &str = "statistics";

/// Folder of the pages of the runs, in that of a campaign's pages.
const RUNS: &str = "runs";

/// Contents of pages.
pub struct Options<'a> {
    /// Random scenarios around each failure mode, and the progress bar; `None` to simulate nothing.
    pub simulations: Option<(Samples, &'a Bar)>,
    /// Present path of the runs' controller, if the file was moved.
    pub controller: Option<&'a str>,
    pub skip_check: bool,
    /// Whether a page of a run has a 3-D replay.
    pub has_replay: bool,
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

/// Time from which on the simulations of a finished page are kept for the next one.
const WORTH_KEEPING: Duration = Duration::from_secs(10);

/// Why nothing is simulated.
pub const NO_SIMULATIONS: &str = "they were not requested (report.simulations = false)";

/// Writes the pages of a campaign to the folder `out`: an index, a page for each run, and the
/// statistics of all runs, also as Markdown.
pub fn write_campaign(campaign: &Path, out: &Path, options: &Options<'_>) -> Result<ExitStatus> {
    let runs = campaign_runs(campaign)?;
    let index = out.join(INDEX);
    if index.exists() && !options.force {
        bail!("{} exists already; choose another --out, or overwrite it with --force", index.display());
    }
    let pages = out.join(RUNS);
    std::fs::create_dir_all(&pages).with_context(|| format!("cannot write {}", pages.display()))?;
    let mut size = 0;
    let mut written = 0;
    let mut write = |path: PathBuf, html: &str| {
        size += html.len();
        written += 1;
        output::write_atomically(&path, true, html.as_bytes())
    };
    let up = format!("../{INDEX}");
    let mut summaries = Vec::new();
    let mut hardenings = Vec::new();
    let mut compared = Vec::new();
    for run in &runs {
        let name = &run.name;
        let href = format!("{RUNS}/{}.html", run.name);
        let page = if run.is_hardening() && is_hardening(&run.path) != Some(true) {
            hardenings.push(HardeningSummary { name: name.clone(), href, found: None });
            continue;
        } else if run.is_hardening() {
            hardening(&run.path, options)?.map(|(found, failures, reports)| {
                let page = hardening_page(&found, &failures, &reports, Some(&up), shell_command);
                hardenings.push(HardeningSummary { name: name.clone(), href, found: Some(found) });
                page
            })
        } else {
            let file = file::read(&run.path, options.skip_check)?;
            let report = report(&file, &run.path, options).with_context(|| run.path.display().to_string())?;
            report.map(|report| {
                summaries.push(RunSummary::new(&report, name, &href));
                compared.extend(GridRun::new(&report));
                run_page(&report, &up)
            })
        };
        let Some(page) = page else {
            options.clear();
            output::message(&format!(
                "interrupted: {} of {} are kept in {}, the others and the index are not written",
                written,
                plural(runs.len() as u64, "page"),
                pages.display()
            ));
            return Ok(ExitStatus::Interrupted);
        };
        write(pages.join(format!("{name}.html")), &page)?;
    }
    let name = campaign.canonicalize().unwrap_or_else(|_| campaign.to_path_buf());
    let name = name.file_name().map_or(String::new(), |name| name.to_string_lossy().into_owned());
    let statistics = statistics_page(&name, &compared);
    if let Some(page) = &statistics {
        for (ending, text) in [("md", page.markdown()), ("html", page.html())] {
            let path = out.join(format!("{STATISTICS}.{ending}"));
            output::write_atomically(&path, true, text.as_bytes())?;
            output::message(&format!("Page: {}", shell_path(&path)));
        }
    }
    let link = statistics.map(|_| format!("{STATISTICS}.html"));
    write(index.clone(), &campaign_page(&name, &summaries, &hardenings, link.as_deref()))?;
    options.clear();
    output::message(&format!(
        "Pages: {} ({} in {}, {} kB)",
        shell_path(&index),
        plural(written - 1, "run"),
        shell_path(&pages),
        size.div_ceil(1000)
    ));
    Ok(ExitStatus::Done)
}

/// Result, failures of its modes, and reports of the final simulations of a hardening.
type HardeningParts = (Hardening, HardenedModes, Vec<RunReport>);

/// Returns the parts of the page of a finished hardening; `None` after an interruption.
pub fn hardening(folder: &Path, options: &Options<'_>) -> Result<Option<HardeningParts>> {
    let found = path_kind::hardening(folder)?;
    let failures = match options.simulations {
        None => Some(HardenedModes::skipped(NO_SIMULATIONS)),
        Some(_) => HardenedModes::simulate(folder, &found, options.has_replay, || control_flow().is_break()),
    };
    let Some(failures) = failures else { return Ok(None) };
    let mut reports = Vec::new();
    for FinalRun { run, controller } in final_runs(folder, &found) {
        let file = file::read(&run, options.skip_check)?;
        let options = Options { controller: Some(&path_text(&controller)), ..*options };
        match report(&file, &run, &options).with_context(|| run.display().to_string())? {
            Some(report) => reports.push(report),
            None => return Ok(None),
        }
    }
    Ok(Some((found, failures, reports)))
}

/// Returns what the page about a bisection shows of the last passing and the first failing
/// candidate; `None` after an interruption.
pub fn bisection(found: &Bisection, options: &Options<'_>) -> Result<Option<BisectionEvidence>> {
    let violated = |neighbors: [&BisectedCandidate; 2]| match options.simulations {
        None => Some(ViolatedCounterexamples::skipped(neighbors[1], NO_SIMULATIONS)),
        Some(_) => {
            ViolatedCounterexamples::simulate(neighbors, options.has_replay, || control_flow().is_break())
        }
    };
    let read = |path: &Path| {
        let file = file::read(path, options.skip_check)?;
        let report = report(&file, path, options).with_context(|| path.display().to_string())?;
        Ok(report.map(|report| (file, report)))
    };
    BisectionEvidence::collect(found, violated, read, shell_command)
}

/// Returns the file that keeps the simulations of a page, beside the run.
pub fn kept_file(run: &Path) -> PathBuf {
    let mut name = run.as_os_str().to_owned();
    name.push(".report");
    name.into()
}

/// Returns the report of a run; `None` after an interruption.
pub fn report(file: &RunFile, path: &Path, options: &Options<'_>) -> Result<Option<RunReport>> {
    let header = file.header();
    let resolved = needs_target(header).then(|| plan_without_program(header, options.controller)).flatten();
    let mut report = RunReport::load(file, &path.to_string_lossy(), resolved.as_ref(), shell_command)?;
    let Some((samples, bar)) = options.simulations else {
        report.note_no_simulations(NO_SIMULATIONS);
        return Ok(Some(report));
    };
    let kept = kept_file(path);
    report.keep_in(kept.clone());
    let began = Instant::now();
    let measured = report.measure(file, options.controller, samples, |done, total| {
        bar.set_part(&format!("page of {}", path.display()), total);
        bar.set_position(done);
        control_flow()
    })?;
    // What took a moment is not worth a file.
    if measured != Measurement::Interrupted && began.elapsed() < WORTH_KEEPING {
        let _ = std::fs::remove_file(&kept);
    }
    match measured {
        Measurement::Interrupted => return Ok(None),
        Measurement::Skipped { reason } => {
            report.note_no_simulations(&reason);
            let said = format!("{}: the page has no further simulations: {reason}", path.display());
            bar.line().suspend(|| output::message(&said));
        }
        Measurement::Done if options.has_replay => {
            let open = |(trial, simulation)| {
                let run = shell_path(path);
                format!("mishandle replay {run} --trial {trial} --simulation {simulation} --open")
            };
            let replay = report.record_replay(file, options.controller, None, open, |done, total| {
                if done == 0 {
                    let simulations = plural(total, "simulation");
                    bar.line().suspend(|| output::message(&format!("the 3-D replay takes {simulations}")));
                }
                bar.set_length(total);
                bar.set_position(done);
                control_flow()
            });
            match replay {
                Ok(Recording::Interrupted) => return Ok(None),
                Ok(Recording::Done | Recording::Nothing) => {}
                Err(error) => report.note_no_replay(&error),
            }
        }
        Measurement::Done => {}
    }
    Ok(Some(report))
}
