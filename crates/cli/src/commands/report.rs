use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use mishandle::plan::{LogSettings, ReportSettings, Settings};
use mishandle::results::{Bisection, Check};
use mishandle::train::Curve;
use mishandle_report::{
    CheckFigures, LogSection, Samples, bisection_page, check_markdown, check_page, hardening_page,
    learning_curve_page, log_page, markdown, page,
};
use mishandle_text::{path_text, shell_path};

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::run::log_question::{self, Question};
use crate::run::path_kind::{self, PathKind};
use crate::run::{self, browser, pages};
use crate::show::output;
use crate::show::progress::Bar;
use crate::words::shell_command;

/// Write a page about runs (verdict, failure modes, robustness maps, traces, pictures), about a
/// learning curve, or about logs
#[derive(Clone, Debug, Args)]
#[command(after_help = "Examples:
  mishandle report runs/RUN.sqlite --out report.html
  mishandle report runs/RUN.sqlite --open               with a 3-D replay, in the browser
  mishandle report runs/A.sqlite runs/B.sqlite --out report.html     one section each, and a table
  mishandle report runs/campaign-1 --out pages          index and a page for each run of a campaign
  mishandle report runs/RUN.sqlite -k report.simulations=false --out report.html
  mishandle report better.harden --out report.html      a hardening, before and after
  mishandle report runs/RUN.sqlite --markdown run.md    the most important as Markdown
  mishandle report checked --out report.html            the requirements of `mishandle check`
  mishandle report runs/bisect --out bisection.html     the last `regress --first-bad` in a folder
  mishandle report curve.csv --out curve.html           the learning curve of `train --csv`
  mishandle report --log logs/*.csv --formula 'always(force <= 2)' --out logs.html

The page is one HTML file that loads nothing. It runs no script without --interactive and --open.
docs/guide/report.md explains its charts. If the target of a run is available, scenarios around each
failure mode are simulated, corners, and repeats with other seeds. Otherwise the page has what the
run file contains. docs/guide/logs.md describes logs.")]
#[command(mut_arg("runs", |runs| runs.conflicts_with_all(flags::OF_LOGS)))]
pub struct Arguments {
    /// Run files, the folder of a campaign, of a check, of a bisection or of a hardening, or the
    /// .csv file of `mishandle train --csv`
    #[arg(value_name = "RUN", required_unless_present_any = flags::OF_LOGS)]
    pub runs: Vec<PathBuf>,
    /// HTML file to create; for a campaign, a folder for the index and a page for each run
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Markdown file to create about run files or a check, for a pull request or a README: verdict,
    /// rates, failure modes, and success over the range of each axis. Without --out, nothing is
    /// simulated
    #[arg(long, value_name = "FILE", conflicts_with_all = flags::OF_LOGS)]
    pub markdown: Option<PathBuf>,
    /// Add a 3-D replay of the failures, which a script in the page draws
    #[arg(long, conflicts_with_all = flags::OF_LOGS)]
    pub interactive: bool,
    /// Open the page, with a 3-D replay, in the browser; without --out, the page is beside the run
    /// file and replaces an earlier one
    #[arg(long, conflicts_with_all = flags::OF_LOGS)]
    pub open: bool,
    /// Overwrite the files of --out and --markdown
    #[arg(long)]
    pub force: bool,
    /// Number of threads; does not affect the page [default: number of cores]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<usize>(flags::THREADS))]
    pub threads: Option<usize>,
    #[command(flatten)]
    pub keys: flags::Keys,
    #[command(flatten)]
    pub logs: flags::Logs,
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    let beside = command.runs.first().filter(|_| command.open && command.out.is_none());
    let Some(run) = beside else { return write_page(command) };
    let out = Some(browser::page_beside(run, ""));
    write_page(&Arguments { out, force: true, ..command.clone() })
}

fn write_page(command: &Arguments) -> Result<ExitStatus> {
    let (Settings { engine, report, log, .. }, _) = command.keys.settings("report")?;
    if command.runs.is_empty() {
        return write_logs(command, &log);
    }
    for path in &command.runs {
        refuse_log(path)?;
        path_kind::refuse_others(path, &[path_kind::RUN, path_kind::CURVE])?;
    }
    if command.out.is_none() && command.markdown.is_none() {
        // A missing run is the first mistake to correct.
        for run in command.runs.iter().filter(|run| !run.exists()) {
            drop(run::read(run, engine.skip_check)?);
        }
        page_file(command)?;
    }
    run::set_threads(command.threads)?;
    let controller = engine.controller.as_deref().map(Path::new);
    let files = [("--out", &command.out), ("--markdown", &command.markdown)];
    for (flag, file) in files {
        if let Some(file) = file {
            let inputs = command.runs.iter().map(PathBuf::as_path).chain(controller);
            output::refuse_inputs(file, flag, inputs)?;
        }
    }
    if let (Some(out), Some(markdown)) = (&command.out, &command.markdown) {
        ensure!(out != markdown, "--out and --markdown name the same file {}", out.display());
    }
    let bar = Bar::new(0, "simulations");
    run::stop_on_signals(&bar)?;
    let ReportSettings { probes, sensitivity, repeats, simulations, replay, .. } = report;
    let samples = Samples { probes, sensitivity, repeats };
    let options = pages::Options {
        simulations: (simulations && command.out.is_some()).then_some((samples, &bar)),
        controller: engine.controller.as_deref(),
        skip_check: engine.skip_check,
        has_replay: command.interactive || command.open || replay,
        force: command.force,
    };
    let is_alone = command.runs.len() == 1;
    for path in &command.runs {
        let shown = path.display();
        match path_kind::of(path)? {
            PathKind::Run
            | PathKind::Log
            | PathKind::Target
            | PathKind::Requirements
            | PathKind::Plan
            | PathKind::Other => {}
            PathKind::Check(found) if is_alone => return write_check(&found, command, &options),
            _ if command.markdown.is_some() => {
                bail!("--markdown writes about run files and checks; {shown} is neither")
            }
            PathKind::Curve if is_alone => return write_curve(path, command),
            PathKind::Curve => bail!("{shown} is a learning curve; name it alone"),
            PathKind::Counterexample | PathKind::Controller => {
                bail!("{shown} is no run; `mishandle show` explains counterexamples and controllers")
            }
            _ if !is_alone => {
                bail!("{shown} is a folder; name run files, or one folder of a campaign alone")
            }
            PathKind::Bisection(found) => return write_bisection(&found, command, &options),
            PathKind::Hardening => return write_hardening(path, command, &options),
            _ => return pages::write_campaign(path, page_file(command)?, &options),
        }
    }
    // Fails before the simulations if the output cannot be written.
    for (_, file) in files {
        if let Some(file) = file {
            drop(output::create(file, command.force)?);
        }
    }
    let mut reports = Vec::new();
    for path in &command.runs {
        let file = run::read(path, options.skip_check)?;
        let report = pages::report(&file, path, &options).with_context(|| path.display().to_string())?;
        let Some(report) = report else {
            bar.clear();
            let names = files.iter().filter_map(|(_, file)| file.as_deref());
            let names: Vec<String> = names.map(|file| file.display().to_string()).collect();
            let verb = if names.len() == 1 { "is" } else { "are" };
            output::message(&format!(
                "interrupted: {} {verb} not written; the simulations are kept in {}, and the same command continues",
                names.join(" and "),
                pages::kept_file(path).display()
            ));
            return Ok(ExitStatus::Interrupted);
        };
        reports.push(report);
    }
    bar.clear();
    if let Some(file) = &command.markdown {
        write_file(file, &markdown(&reports), command)?;
    }
    match command.out {
        Some(_) => write(&page(&reports), command),
        None => Ok(ExitStatus::Done),
    }
}

/// Checks that a file is not a log, which has flags of its own.
fn refuse_log(path: &Path) -> Result<()> {
    let is_log = path.is_file() && matches!(path_kind::of(path)?, PathKind::Log);
    ensure!(
        !is_log,
        "{} is a log, not a run file; its page is written with: mishandle report --log {} --formula FORMULA --out \
         page.html",
        path.display(),
        shell_path(path)
    );
    Ok(())
}

/// Writes the page about a hardening, with sections about the final simulations in its space.
fn write_hardening(folder: &Path, command: &Arguments, options: &pages::Options<'_>) -> Result<ExitStatus> {
    let Some((found, failures, reports)) = pages::hardening(folder, options)? else {
        options.clear();
        return interrupted(command);
    };
    options.clear();
    write(&hardening_page(&found, &failures, &reports, None, shell_command), command)
}

/// Writes the reports about the requirements of a file.
fn write_check(found: &Check, command: &Arguments, options: &pages::Options<'_>) -> Result<ExitStatus> {
    if let Some(file) = &command.markdown {
        write_file(file, &check_markdown(found), command)?;
    }
    if command.out.is_none() {
        return Ok(ExitStatus::Done);
    }
    let mut must_end = || run::control_flow().is_break();
    let figures = options.simulations.map(|_| CheckFigures::draw(found, options.has_replay, &mut must_end));
    options.clear();
    write(&check_page(found, &figures.unwrap_or_default()), command)
}

/// Writes the page about the last bisection in a folder.
fn write_bisection(
    found: &Bisection,
    command: &Arguments,
    options: &pages::Options<'_>,
) -> Result<ExitStatus> {
    ensure!(found.is_complete, "the bisection was interrupted; continue it with: {}", found.command);
    let evidence = pages::bisection(found, options)?;
    options.clear();
    match evidence {
        Some(evidence) => write(&bisection_page(found, &evidence, shell_command), command),
        None => interrupted(command),
    }
}

/// Says that the page is missing.
fn interrupted(command: &Arguments) -> Result<ExitStatus> {
    output::message(&format!("interrupted: {} is not written", page_file(command)?.display()));
    Ok(ExitStatus::Interrupted)
}

/// Writes the page about a learning curve.
fn write_curve(path: &Path, command: &Arguments) -> Result<ExitStatus> {
    let curve = Curve::load(path)?;
    if curve.is_truncated {
        let file = path.display();
        output::message(&format!("warning: the last line of {file} is incomplete and was ignored"));
    }
    write(&learning_curve_page(&curve, &path_text(path)), command)
}

/// Writes the page about verdicts on logs.
fn write_logs(command: &Arguments, log: &LogSettings) -> Result<ExitStatus> {
    let question = Question::new(&command.logs.question, log, &command.logs.paths)?;
    let out = page_file(command)?;
    output::refuse_inputs(out, "--out", question.inputs())?;
    drop(output::create(out, command.force)?);
    let mut sections = Vec::new();
    let without = question.ask(|asked| {
        // Dense time and logs without times have verdicts and charts, but no decisive sample.
        let explained = asked.explanation().ok();
        let decision = explained.as_ref().map(|(explained, _)| &explained.decision);
        sections.push(LogSection::new(
            asked.verdict,
            asked.requirement,
            &asked.evaluation,
            &asked.log.samples,
            decision,
        ));
        Ok(())
    })?;
    mishandle_logs::worst_first(&mut sections, LogSection::verdict);
    let status = write(&log_page(&sections, &without.list), command)?;
    log_question::check_all(without, question.sources.len())?;
    Ok(status)
}

fn write(page: &str, command: &Arguments) -> Result<ExitStatus> {
    let file = page_file(command)?;
    write_file(file, page, command)?;
    if command.open {
        browser::open(file)?;
    }
    Ok(ExitStatus::Done)
}

/// Returns the file of the page. Only a report about run files can do without it.
fn page_file(command: &Arguments) -> Result<&Path> {
    command.out.as_deref().context("--out must name the HTML file to create")
}

fn write_file(file: &Path, text: &str, command: &Arguments) -> Result<()> {
    output::write_atomically(file, command.force, text.as_bytes())?;
    let size = text.len().div_ceil(1000);
    output::message(&format!("wrote {} ({size} kB)", file.display()));
    Ok(())
}
