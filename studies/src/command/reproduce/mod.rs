//! The paper's tables: runs their plans, and shows the results beside the published values.

mod verify;

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, ensure};
use clap::{Args, Subcommand};
use mishandle::campaign::create_campaign;
use mishandle::files::write_atomically;
use mishandle_report::{Block, Table};
use mishandle_studies::paper::{CampaignResults, NamedPage, Results, RunResults, pages};
use mishandle_text::{plural, shell_quote};
use serde_json::{Value, json};

use super::{message, print, repository};

/// Reproduce the paper's tables: run their plans, and show the results beside the published values
#[derive(Debug, Args)]
#[command(arg_required_else_help = true)]
#[command(after_help = "Examples:
  studies reproduce falsification --out runs/falsification
  studies reproduce performance --out runs/performance
  studies reproduce tables runs/performance runs/falsification --pages pages
  studies reproduce verify studies/experiments/paper/results/DATE

studies/README.md explains the tables and how to read them.")]
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
  studies reproduce tables runs/falsification
  studies reproduce tables studies/experiments/paper/results/DATE \\
      --pages studies/notebook/2026-11-28-paper

A campaign may be incomplete; its rows then say how far they are. Campaigns of `mishandle run`
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
  studies reproduce collect runs/performance runs/falsification --out results/2026-11-22
  studies reproduce collect results/2026-11-22 more/falsification --out results/2026-11-24

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
  studies reproduce verify studies/experiments/paper/results/DATE
  studies reproduce verify studies/experiments/paper/results/DATE --share 0.05 --seed 1 --any-commit

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
    out: Option<PathBuf>,
    /// Campaign file to run instead of that of the table
    #[arg(long, value_name = "FILE")]
    plan: Option<PathBuf>,
    /// Number of runs at the same time; does not affect the results [default: number of cores]
    #[arg(long, value_name = "N")]
    jobs: Option<u16>,
}

pub fn run(command: &ReproduceCommand) -> Result<ExitCode> {
    match command {
        ReproduceCommand::Performance(table) => return reproduce("performance", table),
        ReproduceCommand::Falsification(table) => return reproduce("falsification", table),
        ReproduceCommand::Tables { folders, pages, json } => show(&load(folders)?, pages.as_deref(), *json)?,
        ReproduceCommand::Collect { folders, out } => {
            collect(folders, out)?.write(out)?;
            message(&format!("Results: {}", shell_quote(&out.to_string_lossy())));
        }
        ReproduceCommand::Verify(command) => return verify::run(command),
    }
    Ok(ExitCode::SUCCESS)
}

/// Runs or completes the campaign of a table with `mishandle run`, then shows it.
fn reproduce(name: &str, table: &ReproduceTable) -> Result<ExitCode> {
    let plan = match &table.plan {
        Some(path) => path.clone(),
        None => repository()?.join("studies/experiments/paper").join(format!("{name}.toml")),
    };
    let folder = table.out.clone().unwrap_or_else(|| Path::new("runs").join(name));
    let read = |path: &Path| fs::read_to_string(path).with_context(|| path.display().to_string());
    if folder.exists() {
        ensure!(
            read(&folder.join("campaign.toml"))? == read(&plan)?,
            "{} has the runs of another plan than {}; choose another --out",
            folder.display(),
            plan.display()
        );
    } else {
        create_campaign(&read(&plan)?, &folder).with_context(|| plan.display().to_string())?;
    }
    let mut words: Vec<OsString> = ["mishandle", "run", "--resume"].map(OsString::from).to_vec();
    words.push(folder.clone().into());
    let all_cores = || std::thread::available_parallelism().map_or(1, usize::from);
    let jobs = table.jobs.map_or_else(all_cores, usize::from);
    words.extend(["-k".into(), format!("engine.jobs={jobs}").into()]);
    match mishandle_cli::exit_code_of(words, None) {
        // 1: a trial was falsified.
        0 | 1 => show(&load(&[folder])?, None, false).map(|()| ExitCode::SUCCESS),
        code => Ok(ExitCode::from(code)),
    }
}

/// Reads campaigns and results.
fn load(folders: &[PathBuf]) -> Result<Results> {
    let mut all = Results::default();
    let mut commits = Vec::new();
    for folder in folders {
        if Results::is_in(folder) {
            let Results { date, machine, commit, campaigns } = Results::read(folder)?;
            commits.push(commit);
            all.date = date;
            add_machine(&mut all.machine, &machine);
            all.campaigns.extend(campaigns);
        } else {
            let root = mishandle::shipped::home().unwrap_or_default();
            let campaign = CampaignResults::read(folder, &root)?;
            commits.extend(campaign.runs.iter().map(|run| named_commit(&run.facts.commit)));
            all.campaigns.push(campaign);
        }
    }
    commits.dedup();
    all.commit = commits.pop().flatten().filter(|_| commits.is_empty());
    Ok(all)
}

/// Returns a commit if it names the sources of a program.
fn named_commit(commit: &str) -> Option<String> {
    (commit != "unknown" && !commit.ends_with("-changed")).then(|| commit.to_string())
}

/// Adds a machine to a list, once.
fn add_machine(list: &mut String, machine: &str) {
    if list.split("; ").any(|known| known == machine) {
        return;
    }
    if !list.is_empty() {
        list.push_str("; ");
    }
    list.push_str(machine);
}

/// Shows the tables of the results, or writes their pages to a folder.
fn show(results: &Results, folder: Option<&Path>, as_json: bool) -> Result<()> {
    let pages = pages(results);
    ensure!(!pages.is_empty(), "there are no runs in these folders");
    if let Some(folder) = folder {
        write_pages(&pages, folder)?;
    }
    if as_json {
        return print(&serde_json::to_string_pretty(&document(&pages))?);
    }
    if folder.is_none() {
        let tables = pages.iter().flat_map(|(_, page)| tables(&page.blocks));
        print(&tables.map(Table::markdown).collect::<Vec<_>>().join("\n"))?;
    }
    Ok(())
}

/// Writes each page as Markdown and as HTML. Existing pages are replaced, because they contain
/// nothing but results.
fn write_pages(pages: &[NamedPage], folder: &Path) -> Result<()> {
    fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    for (name, page) in pages {
        for (ending, text) in [("md", page.markdown()), ("html", page.html())] {
            let path = folder.join(format!("{name}.{ending}"));
            write_atomically(&path, text.as_bytes()).with_context(|| path.display().to_string())?;
            message(&format!("Page: {}", shell_quote(&path.to_string_lossy())));
        }
    }
    Ok(())
}

fn tables(blocks: &[Block]) -> impl Iterator<Item = &Table> {
    blocks.iter().filter_map(|block| match block {
        Block::Table(table) => Some(table),
        _ => None,
    })
}

/// Returns the tables of the pages as a JSON document.
fn document(pages: &[NamedPage]) -> Value {
    let table = |Table { caption, columns, rows, .. }: &Table| json!({ "caption": caption, "columns": columns, "rows": rows });
    let page = |(name, page): &NamedPage| json!({ "name": name, "title": page.title, "tables": tables(&page.blocks).map(table).collect::<Vec<_>>() });
    json!({ "pages": pages.iter().map(page).collect::<Vec<_>>() })
}

/// Reads the complete runs of campaigns, and results to add them to.
fn collect(folders: &[PathBuf], out: &Path) -> Result<Results> {
    ensure!(!out.exists(), "{} exists already; choose another --out", out.display());
    let date = out.file_name().map_or(String::new(), |name| name.to_string_lossy().into_owned());
    let is_date = date.len() == 10
        && date.split('-').map(str::len).eq([4, 2, 2])
        && date.bytes().all(|byte| byte.is_ascii_digit() || byte == b'-');
    ensure!(is_date, "the folder of results is named by its date, such as 2026-11-22; found `{date}`");
    let mut results = load(folders)?;
    for campaign in &mut results.campaigns {
        let all = campaign.runs.len();
        campaign.runs.retain(RunResults::is_complete);
        let left_out = all - campaign.runs.len();
        if left_out > 0 {
            message(&format!(
                "{}: {left_out} of {} left out, because they are not complete",
                campaign.name,
                plural(all as u64, "run")
            ));
        }
    }
    results.campaigns.retain(|campaign| !campaign.runs.is_empty());
    ensure!(!results.campaigns.is_empty(), "no run is complete; resume the campaigns first");
    results.merge_campaigns()?;
    results.date = date;
    if !folders.iter().all(|folder| Results::is_in(folder)) {
        add_machine(&mut results.machine, &machine());
    }
    Ok(results)
}

/// Describes the machine: processor, number of cores and operating system.
fn machine() -> String {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let facts = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = facts.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    let model = model.map_or("unknown processor", |(_, name)| name.trim());
    format!("{cores} cores, {model}, {} {}", std::env::consts::OS, std::env::consts::ARCH)
}
