use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use mishandle::campaign::{CampaignRun, campaign_runs, create_campaign, free_campaign_folder};
use mishandle::files::{limits, read_text_bounded};
use mishandle::results::Campaign;
use mishandle::run::{Device, Opening};
use mishandle_text::{path_text, plural, shell_quote};

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::interrupt;
use crate::run::grid::Ended;
use crate::run::{self, grid, pages};
use crate::show::progress::Bar;
use crate::show::{campaign, escape, output};

/// Run a grid of questions (evaluate, falsify, margin, risk, metamorphic relations) and hardenings:
/// targets, controllers, spaces, formulas, searches, seeds
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle campaign campaign.toml --out runs/controllers
  mishandle campaign --resume runs/controllers
  mishandle campaign campaign.toml --ray auto         on this machine's Ray cluster

The campaign file is a plan in which keys may have lists of values: see docs/guide/campaigns.md.
Each combination is a run with a run file in the folder; one of [harden] has a folder there, and
beside it the accepted controller. Exit code 1 means that a violation was found by falsify, margin
or risk, that a pair breaks a metamorphic relation, or that a hardening accepted no controller; 2
also that no simulation has a verdict.")]
pub struct Arguments {
    /// Campaign file (TOML)
    #[arg(value_name = "FILE", required_unless_present = "resume")]
    pub campaign: Option<PathBuf>,
    /// Folder to create for the run files [default: a new folder in runs/]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Resume the stopped campaign in this folder
    #[arg(long, value_name = "DIR", conflicts_with_all = ["campaign", "out"])]
    pub resume: Option<PathBuf>,
    /// Simulate on a Ray cluster: its address, `auto` for the one that runs on this machine, or
    /// `local` to start one; needs the Python package with Ray
    #[arg(long, value_name = "ADDRESS")]
    pub ray: Option<String>,
    /// Resume runs that another build started: the header of each run file then names both
    #[arg(long, requires = "resume")]
    pub any_build: bool,
    /// Wait after each batch until its records are on the disk
    #[arg(long)]
    pub durable: bool,
    /// Number of runs at the same time; does not affect the results. Several keep all cores busy
    /// when searches propose few simulations at a time [default: 1]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<usize>(flags::THREADS))]
    #[arg(conflicts_with = "ray")]
    pub jobs: Option<usize>,
    /// Number of threads; does not affect the results [default: number of cores]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<usize>(flags::THREADS))]
    pub threads: Option<usize>,
    /// Write pages to this folder: an index, a page for each run, and the statistics of all runs
    /// side by side, also as Markdown
    #[arg(long, value_name = "DIR")]
    pub pages: Option<PathBuf>,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
}

pub fn run(command: &Arguments, gpu: Option<&Device>) -> Result<ExitStatus> {
    run::set_threads(command.threads)?;
    if command.ray.is_some() {
        check_ray()?;
    }
    let bar = Bar::new(0, "simulations");
    run::stop_on_signals(&bar)?;
    let (folder, runs) = open(command)?;
    let opening = Opening { durable: command.durable, any_build: command.any_build };
    let status = match &command.ray {
        Some(address) => simulate_on_ray(&folder, address, opening)?,
        None => ExitStatus::Done,
    };
    let mut ended = Ended::default();
    if status == ExitStatus::Done {
        ended = grid::run_all(&runs, &bar, opening, command.jobs.unwrap_or(1), gpu)?;
    }
    bar.clear();
    let Ended { finished, stopped } = ended;
    let is_complete = finished.len() + stopped.len() == runs.len();
    let found = Campaign { folder: path_text(&folder), is_complete, runs: finished };
    let name = shell_quote(&found.folder);
    if !found.is_complete {
        output::message(&format!(
            "interrupted; {} of {} finished",
            found.runs.len(),
            plural(runs.len() as u64, "run")
        ));
        output::message(&format!("Resume with: mishandle campaign --resume {name}"));
    }
    if command.json {
        output::json(&found)?;
    } else if !found.runs.is_empty() {
        output::line(&campaign::text(&found))?;
    }
    if !found.is_complete {
        return Ok(ExitStatus::Interrupted);
    }
    if let Some(pages) = &command.pages {
        let options = pages::Options { simulations: None, controller: None, skip_check: false, force: true };
        pages::write_campaign(&folder, pages, &options)?;
        output::message(&format!(
            "To add what takes simulations: mishandle report {name} --out {} --force",
            shell_quote(&path_text(pages))
        ));
    }
    output::message(&format!("Run files: {name}"));
    for (run, why) in &stopped {
        output::message(&format!("error: run {}: {}", escape::name(run), escape::name(why)));
    }
    ensure!(stopped.is_empty(), "{} without a result", plural(stopped.len() as u64, "run"));
    // Exit code 0 would say that the controllers were tested.
    ensure!(
        found.runs.is_empty() || found.runs.iter().any(|run| run.result.has_verdict()),
        "no simulation has a verdict, so nothing was tested; the run files contain the end of each simulation"
    );
    let has_failed = found.runs.iter().any(|run| run.result.is_violated());
    Ok(if has_failed { ExitStatus::Violated } else { ExitStatus::Done })
}

/// Opens the campaign to resume, or else creates a new one.
fn open(command: &Arguments) -> Result<(PathBuf, Vec<CampaignRun>)> {
    if let Some(folder) = &command.resume {
        return Ok((folder.clone(), campaign_runs(folder)?));
    }
    let Some(path) = &command.campaign else { bail!("there is no campaign: name its file") };
    let folder = command.out.clone().unwrap_or_else(free_campaign_folder);
    ensure!(
        !folder.exists(),
        "{} exists already; choose another --out, or resume it with --resume",
        folder.display()
    );
    let text = read_text_bounded(path, limits::PLAN).with_context(|| path.display().to_string())?;
    let runs = create_campaign(&text, &folder).with_context(|| path.display().to_string())?;
    Ok((folder, runs))
}

/// Program and module that simulate a campaign on Ray.
const PYTHON: &str = "python3";
const MODULE: &str = "mishandle.cluster";

/// Checks that the Python package and Ray are installed.
fn check_ray() -> Result<()> {
    let found = Command::new(PYTHON)
        .args(["-c", "import ray, mishandle.cluster"])
        .stdin(Stdio::null())
        .output()
        .with_context(|| format!("--ray needs {PYTHON}"))?;
    ensure!(
        found.status.success(),
        "--ray needs the Python package with Ray: run `{PYTHON} -m pip install '.[ray]'` in a clone of Mishandle ({PYTHON} says: {})",
        String::from_utf8_lossy(&found.stderr).lines().last().unwrap_or("nothing")
    );
    Ok(())
}

/// Simulates the runs of the folder on a Ray cluster. The run files are then complete, so that this
/// program only reads them.
fn simulate_on_ray(folder: &Path, address: &str, opening: Opening) -> Result<ExitStatus> {
    let mut command = Command::new(PYTHON);
    command.args(["-m", MODULE, "--resume"]).arg(folder).args(["--address", address]);
    if opening.durable {
        command.arg("--durable");
    }
    if opening.any_build {
        command.arg("--any-build");
    }
    // Ctrl-C reaches the other program as well, which saves its finished work.
    let status = command.status().with_context(|| format!("cannot start {PYTHON} -m {MODULE}"))?;
    match status.code() {
        Some(0) if !interrupt::requested() => Ok(ExitStatus::Done),
        Some(0) => Ok(ExitStatus::Interrupted),
        Some(code) if code == i32::from(interrupt::EXIT_CODE) => Ok(ExitStatus::Interrupted),
        _ => bail!(
            "{PYTHON} -m {MODULE} failed ({status}); everything recorded is kept: mishandle campaign --resume {}",
            shell_quote(&path_text(folder))
        ),
    }
}
