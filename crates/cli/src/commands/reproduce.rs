//! The paper's tables: runs their plans, and shows the results beside the published values.

mod verify;

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use clap::{Args, Subcommand};
use mishandle::files::{limits, read_text_bounded};
use mishandle::results;
use mishandle_paper::{Block, NamedPage, Results, RunResults, Table, pages};
use mishandle_text::plural;
use mishandle_text::shell_quote;

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::run::{self, grid, tables};
use crate::show::output;
use crate::show::progress::Bar;

/// Reproduce the paper's tables: run their plans, and show the results beside the published values
#[derive(Debug, Args)]
#[command(arg_required_else_help = true)]
#[command(after_help = "Examples:
  mishandle reproduce falsification --out runs/falsification
  mishandle reproduce performance --out runs/performance
  mishandle reproduce tables runs/performance runs/falsification --pages pages
  mishandle reproduce verify experiments/paper/results/DATE

docs/guide/reproduce.md explains the tables and how to read them.")]
pub struct Arguments {
    #[command(subcommand)]
    pub command: ReproduceCommand,
}

#[derive(Debug, Subcommand)]
pub enum ReproduceCommand {
    /// Evaluate the controllers of both generations and the experts, with and without noise
    Performance(ReproduceTable),
    /// Falsify the PPO and TRPO controllers of both generations with three searches
    Falsification(ReproduceTable),
    /// Show the tables of existing campaigns or results, without simulations
    #[command(after_help = "Examples:
  mishandle reproduce tables runs/falsification
  mishandle reproduce tables experiments/paper/results/DATE --pages docs/notebook/2026-11-28-paper

A campaign may be incomplete; its rows then say how far they are. Campaigns of `mishandle campaign`
get the same tables.")]
    Tables {
        /// Folders of campaigns or of collected results
        #[arg(value_name = "DIR", required = true)]
        folders: Vec<PathBuf>,
        /// Write the pages to this folder as Markdown and HTML instead of printing the tables
        #[arg(long, value_name = "DIR")]
        pages: Option<PathBuf>,
        /// Print one JSON document to stdout
        #[arg(long)]
        json: bool,
    },
    /// Store summaries and digests of complete runs as CSV files with a manifest
    #[command(after_help = "Examples:
  mishandle reproduce collect runs/performance runs/falsification --out results/2026-11-22
  mishandle reproduce collect results/2026-11-22 more/falsification --out results/2026-11-24

Incomplete runs are left out. Campaigns of the same name are merged, so a table can be run in parts.
Rows are not stored: the digest of each trial and of each hundred evaluated episodes stands for
them.")]
    Collect {
        /// Folders of campaigns or of collected results
        #[arg(value_name = "DIR", required = true)]
        folders: Vec<PathBuf>,
        /// Folder to create, named by the date of the results
        #[arg(long, value_name = "DIR")]
        out: PathBuf,
    },
    /// Run a random share of collected results again, and compare them to the bit
    #[command(after_help = "Examples:
  mishandle reproduce verify experiments/paper/results/DATE
  mishandle reproduce verify experiments/paper/results/DATE --share 0.05 --seed 1 --any-commit

A unit is a trial of a falsification or a hundred episodes of an evaluation. Exit code 0 means that
all chosen units agree; 2 that one differs, or that this program is of another commit.")]
    Verify(verify::Verify),
}

/// Flags of the commands that run the plan of a table.
#[derive(Debug, Args)]
pub struct ReproduceTable {
    /// Folder of the run files. If it exists, its campaign is resumed [default: runs/ and the name
    /// of the table]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Campaign file to run instead of that of the table
    #[arg(long, value_name = "FILE")]
    pub plan: Option<PathBuf>,
    /// Number of runs at the same time; does not affect the results [default: number of cores]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<usize>(flags::THREADS))]
    pub jobs: Option<usize>,
    /// Number of threads; does not affect the results [default: number of cores]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<usize>(flags::THREADS))]
    pub threads: Option<usize>,
    /// Continue runs that another build started: the header of each run file then names both
    #[arg(long)]
    pub any_build: bool,
    /// Wait after each batch until its records are on the disk
    #[arg(long)]
    pub durable: bool,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    match &command.command {
        ReproduceCommand::Performance(table) => reproduce("performance", table),
        ReproduceCommand::Falsification(table) => reproduce("falsification", table),
        ReproduceCommand::Tables { folders, pages, json } => {
            let results = tables::load(folders)?;
            show(&results, pages.as_deref(), *json)?;
            Ok(ExitStatus::Done)
        }
        ReproduceCommand::Collect { folders, out } => {
            let results = collect(folders, out)?;
            results.write(out).map_err(tables::converted)?;
            output::message(&format!("Results: {}", shell_quote(&out.to_string_lossy())));
            Ok(ExitStatus::Done)
        }
        ReproduceCommand::Verify(command) => verify::run(command),
    }
}

/// Runs or completes the campaign of a table, then shows it.
fn reproduce(name: &str, table: &ReproduceTable) -> Result<ExitStatus> {
    run::set_threads(table.threads)?;
    let bar = Bar::new(0, "simulations");
    run::stop_on_signals(&bar)?;
    let plan = match &table.plan {
        Some(path) => path.clone(),
        None => home()?.join("experiments/paper").join(format!("{name}.toml")),
    };
    let text = read_text_bounded(&plan, limits::PLAN).with_context(|| plan.display().to_string())?;
    let folder = table.out.clone().unwrap_or_else(|| Path::new("runs").join(name));
    let runs = if folder.exists() {
        let runs = mishandle::campaign::campaign_runs(&folder)?;
        let untrained = mishandle::campaign::untrained_runs(&folder)?;
        let mut planned = mishandle::plan::read_grid(&text).with_context(|| plan.display().to_string())?;
        let all = planned.len();
        planned.retain(|planned| !untrained.contains(planned));
        let is_same = planned.len() + untrained.len() == all
            && runs.len() == planned.len()
            && runs.iter().zip(&planned).all(|(run, planned)| run.plan == planned.plan);
        ensure!(
            is_same,
            "{} has the runs of another plan than {}; choose another --out",
            folder.display(),
            plan.display()
        );
        mishandle::campaign::add_trained_runs(&folder)?;
        mishandle::campaign::campaign_runs(&folder)?
    } else {
        mishandle::campaign::create_trained_campaign(&text, &folder)
            .with_context(|| plan.display().to_string())?
    };
    name_untrained(&folder)?;
    let all_cores = || std::thread::available_parallelism().map_or(1, usize::from);
    let jobs = table.jobs.unwrap_or_else(all_cores);
    let opening = mishandle::run::Opening { durable: table.durable, any_build: table.any_build };
    let grid::Ended { finished, stopped } = grid::run_all(&runs, &bar, opening, jobs, None)?;
    if let Some((name, why)) = stopped.first() {
        bail!("run {name}: {why}");
    }
    bar.clear();
    show(&tables::load(std::slice::from_ref(&folder))?, None, table.json)?;
    let quoted = shell_quote(&folder.to_string_lossy());
    if finished.len() < runs.len() {
        output::message(&format!("interrupted; {} of {} runs finished", finished.len(), runs.len()));
        let plan = table
            .plan
            .as_ref()
            .map_or(String::new(), |plan| format!(" --plan {}", shell_quote(&plan.to_string_lossy())));
        output::message(&format!(
            "The same command continues: mishandle reproduce {name} --out {quoted}{plan}"
        ));
        return Ok(ExitStatus::Interrupted);
    }
    output::message(&format!("Run files: {quoted}"));
    Ok(ExitStatus::Done)
}

/// Largest number of controllers that a message names.
const NAMED: usize = 8;

/// Names the controllers that are planned and not trained.
fn name_untrained(folder: &Path) -> Result<()> {
    let untrained = mishandle::campaign::untrained_runs(folder)?;
    let mut names: Vec<String> =
        untrained.iter().map(|run| format!("{}/{}", run.plan.target, run.plan.controller)).collect();
    names.dedup();
    if names.len() > NAMED {
        let more = names.len() - NAMED;
        names.truncate(NAMED);
        names.push(format!("{more} more"));
    }
    if !names.is_empty() {
        output::message(&format!(
            "{} left out, because no controller is shipped for: {}. The tables say `not trained`; the same command adds the runs \
             when the controllers are there",
            plural(untrained.len() as u64, "run"),
            names.join(", ")
        ));
    }
    Ok(())
}

fn home() -> Result<PathBuf> {
    mishandle::shipped::home().context(
        "expected a clone of the repository around the program; name one in the environment variable MISHANDLE_HOME, or give \
         --plan FILE",
    )
}

/// Shows the tables of the results, and writes their pages to a folder.
fn show(results: &Results, folder: Option<&Path>, as_json: bool) -> Result<()> {
    let pages = pages(results);
    ensure!(!pages.is_empty(), "there are no runs in these folders");
    if let Some(folder) = folder {
        tables::write_pages(&pages, folder)?;
    }
    if as_json {
        return output::json(&result(&pages));
    }
    let tables = pages.iter().flat_map(|(_, page)| tables(&page.blocks));
    let texts: Vec<String> = tables
        .map(|table| {
            let plain = |cells: &Vec<String>| cells.iter().map(|cell| cell.replace('`', "")).collect();
            let rows: Vec<Vec<String>> =
                std::iter::once(&table.columns).chain(&table.rows).map(plain).collect();
            format!("{}\n{}", table.caption, output::table(&rows))
        })
        .collect();
    if folder.is_none() {
        output::line(&texts.join("\n\n"))?;
    }
    Ok(())
}

fn tables(blocks: &[Block]) -> impl Iterator<Item = &Table> {
    blocks.iter().filter_map(|block| match block {
        Block::Table(table) => Some(table),
        _ => None,
    })
}

fn result(pages: &[NamedPage]) -> results::Tables {
    let table = |table: &Table| results::Table {
        caption: table.caption.clone(),
        columns: table.columns.clone(),
        rows: table.rows.clone(),
    };
    let page = |(name, page): &NamedPage| results::TablePage {
        name: name.to_string(),
        title: page.title.clone(),
        tables: tables(&page.blocks).map(table).collect(),
    };
    results::Tables { pages: pages.iter().map(page).collect() }
}

/// Reads the complete runs of campaigns, and results to add them to.
fn collect(folders: &[PathBuf], out: &Path) -> Result<Results> {
    ensure!(!out.exists(), "{} exists already; choose another --out", out.display());
    let date = out.file_name().map_or(String::new(), |name| name.to_string_lossy().into_owned());
    let is_date = date.len() == 10
        && date.split('-').map(str::len).eq([4, 2, 2])
        && date.bytes().all(|byte| byte.is_ascii_digit() || byte == b'-');
    ensure!(is_date, "the folder of results is named by its date, such as 2026-11-22; found `{date}`");
    let mut results = tables::load(folders)?;
    for campaign in &mut results.campaigns {
        let all = campaign.runs.len();
        campaign.runs.retain(RunResults::is_complete);
        let left_out = all - campaign.runs.len();
        if left_out > 0 {
            output::message(&format!(
                "{}: {left_out} of {} left out, because they are not complete",
                campaign.name,
                plural(all as u64, "run")
            ));
        }
    }
    results.campaigns.retain(|campaign| !campaign.runs.is_empty());
    ensure!(!results.campaigns.is_empty(), "no run is complete; resume the campaigns first");
    results.merge_campaigns().map_err(tables::converted)?;
    results.date = date;
    if !folders.iter().all(|folder| Results::is_in(folder)) {
        tables::add_machine(&mut results.machine, &machine());
    }
    Ok(results)
}

/// Describes the machine: processor, number of cores and operating system.
fn machine() -> String {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let facts = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = facts.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    let model = model.map_or("unknown processor", |(_, name)| name.trim());
    format!("{cores} cores, {model}, {} {}", std::env::consts::OS, std::env::consts::ARCH)
}
