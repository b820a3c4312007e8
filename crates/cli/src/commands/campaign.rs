use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use mishandle::evaluation::Estimate;
use mishandle::falsification::CampaignOutcome;
use mishandle::files::{limits, read_text_bounded};
use mishandle::{CampaignRun, EvaluationOutcome, decimal, plural, shell_quote};
use serde_json::{Value, json};

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::interrupt;
use crate::run::grid::{self, Finished, Outcome};
use crate::run::{self, pages};
use crate::show::progress::Bar;
use crate::show::{evaluation, falsification, output};

/// Run a grid of evaluations and falsifications: targets, controllers, spaces, formulas, searches, seeds
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle campaign campaign.toml --out runs/controllers
  mishandle campaign --resume runs/controllers
  mishandle campaign campaign.toml --ray auto         on this machine's Ray cluster

The campaign file is a plan in which keys may have lists of values: see docs/campaigns.md. Each
combination is a run with a run file in the folder. Exit code 1 means that a counterexample was
found.")]
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
    /// Simulate on a Ray cluster: its address, `auto` for the one that runs on this machine, or `local` to start one; needs
    /// the Python package with Ray
    #[arg(long, value_name = "ADDRESS")]
    pub ray: Option<String>,
    /// Wait after each batch until its records are on the disk
    #[arg(long)]
    pub durable: bool,
    /// Number of runs at the same time; does not affect the results. Several keep all cores busy when searches propose few
    /// simulations at a time [default: 1]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<usize>(flags::THREADS))]
    #[arg(conflicts_with = "ray")]
    pub jobs: Option<usize>,
    /// Number of threads; does not affect the results [default: number of cores]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<usize>(flags::THREADS))]
    pub threads: Option<usize>,
    /// Write pages to this folder: an index, a page for each run, and the tables of `mishandle reproduce` with statistics, also as
    /// Markdown
    #[arg(long, value_name = "DIR")]
    pub pages: Option<PathBuf>,
    /// Print one JSON document to stdout
    #[arg(long)]
    pub json: bool,
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    run::set_threads(command.threads)?;
    if command.ray.is_some() {
        check_ray()?;
    }
    let bar = Bar::new(0, "simulations");
    run::stop_on_signals(&bar)?;
    let (folder, runs) = open(command)?;
    let status = match &command.ray {
        Some(address) => simulate_on_ray(&folder, address, command.durable)?,
        None => ExitStatus::Done,
    };
    let mut results = Vec::new();
    if status == ExitStatus::Done {
        results = grid::run_all(&runs, &bar, command.durable, command.jobs.unwrap_or(1))?;
    }
    bar.clear();
    let name = shell_quote(&folder.to_string_lossy());
    if results.len() < runs.len() {
        output::message(&format!(
            "interrupted; {} of {} finished",
            results.len(),
            plural(runs.len() as u64, "run")
        ));
        output::message(&format!("Resume with: mishandle campaign --resume {name}"));
    }
    if command.json {
        let documents: Vec<Value> = results.iter().map(document).collect();
        output::json(json!({
            "folder": folder.to_string_lossy(),
            "is_complete": results.len() == runs.len(),
            "runs": documents,
        }))?;
    } else if !results.is_empty() {
        output::line(&text(&results))?;
    }
    if results.len() < runs.len() {
        return Ok(ExitStatus::Interrupted);
    }
    if let Some(pages) = &command.pages {
        let options = pages::Options { simulations: None, controller: None, skip_check: false, force: true };
        pages::write_campaign(&folder, pages, &options)?;
        output::message(&format!(
            "To add what takes simulations: mishandle report {name} --out {} --force",
            shell_quote(&pages.to_string_lossy())
        ));
    }
    output::message(&format!("Run files: {name}"));
    let is_falsified = |finished: &Finished| matches!(&finished.outcome, Outcome::Falsification(found) if found.falsified_trials > 0);
    Ok(if results.iter().any(is_falsified) { ExitStatus::Violated } else { ExitStatus::Done })
}

/// Opens the campaign to resume, or else creates a new one.
fn open(command: &Arguments) -> Result<(PathBuf, Vec<CampaignRun>)> {
    if let Some(folder) = &command.resume {
        return Ok((folder.clone(), mishandle::campaign_runs(folder)?));
    }
    let Some(path) = &command.campaign else { bail!("there is no campaign: name its file") };
    let folder = command.out.clone().unwrap_or_else(mishandle::free_campaign_folder);
    ensure!(
        !folder.exists(),
        "{} exists already; choose another --out, or resume it with --resume",
        folder.display()
    );
    let text = read_text_bounded(path, limits::PLAN).with_context(|| path.display().to_string())?;
    let runs = mishandle::create_campaign(&text, &folder).with_context(|| path.display().to_string())?;
    Ok((folder, runs))
}

/// Program and module that simulate a campaign on Ray.
const PYTHON: &str = "python3";

const MODULE: &str = "mishandle.ray";

/// Checks that the Python package and Ray are installed.
fn check_ray() -> Result<()> {
    let found = Command::new(PYTHON)
        .args(["-c", "import ray, mishandle.ray"])
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

/// Simulates the runs of the folder on a Ray cluster. The run files are then complete, so that this program only reads them.
fn simulate_on_ray(folder: &Path, address: &str, is_durable: bool) -> Result<ExitStatus> {
    let mut command = Command::new(PYTHON);
    command.args(["-m", MODULE, "--resume"]).arg(folder).args(["--address", address]);
    if is_durable {
        command.arg("--durable");
    }
    // Ctrl-C reaches the other program as well, which saves its finished work.
    let status = command.status().with_context(|| format!("cannot start {PYTHON} -m {MODULE}"))?;
    match status.code() {
        Some(0) if !interrupt::requested() => Ok(ExitStatus::Done),
        Some(0) => Ok(ExitStatus::Interrupted),
        Some(code) if code == i32::from(interrupt::EXIT_CODE) => Ok(ExitStatus::Interrupted),
        _ => bail!(
            "{PYTHON} -m {MODULE} failed ({status}); everything recorded is kept: mishandle campaign --resume {}",
            shell_quote(&folder.to_string_lossy())
        ),
    }
}

/// Returns a table of the falsifications and a table of the evaluations.
fn text(results: &[Finished]) -> String {
    let mut falsifications = vec![
        ["run", "falsified", "rate", "95 % interval", "mean simulations", "min robustness", "no verdict"]
            .map(String::from)
            .to_vec(),
    ];
    let mut evaluations = vec![
        ["run", "success rate", "95 % interval", "strict", "dangerous", "failing corners", "n", "no verdict"]
            .map(String::from)
            .to_vec(),
    ];
    for finished in results {
        match &finished.outcome {
            Outcome::Falsification(found) => falsifications.push(falsification_row(&finished.name, found)),
            Outcome::Evaluation(found) => evaluations.push(evaluation_row(&finished.name, found)),
        }
    }
    let tables = [falsifications, evaluations];
    let filled: Vec<String> =
        tables.iter().filter(|rows| rows.len() > 1).map(|rows| output::table(rows)).collect();
    filled.join("\n\n")
}

fn falsification_row(name: &str, found: &CampaignOutcome) -> Vec<String> {
    let minimum =
        found.trials.iter().filter_map(|trial| trial.minimum.as_ref()).map(|found| found.robustness);
    let minimum = minimum.reduce(f64::min);
    vec![
        name.to_string(),
        format!("{} of {}", found.falsified_trials, found.falsification_rate.n),
        percent(&found.falsification_rate),
        interval(&found.falsification_rate),
        found.mean_simulations.map_or("-".to_string(), |mean| format!("{mean:.1}")),
        minimum.map_or("-".to_string(), |minimum| decimal(minimum, 4)),
        (found.diverged + found.invalid + found.failed + found.undecided).to_string(),
    ]
}

fn evaluation_row(name: &str, found: &EvaluationOutcome) -> Vec<String> {
    let report = &found.report;
    let optional = |rate: &Option<Estimate>| rate.as_ref().map_or("-".to_string(), percent);
    let corners = found.corners.as_ref().map(|corners| {
        let failing = corners.points.iter().filter(|point| point.successes < point.n).count();
        format!("{failing} of {}", corners.points.len())
    });
    vec![
        name.to_string(),
        percent(&report.success_rate),
        interval(&report.success_rate),
        optional(&report.strict_success_rate),
        optional(&report.dangerous_behavior_rate),
        corners.unwrap_or("-".to_string()),
        report.success_rate.n.to_string(),
        (report.diverged + report.invalid + report.failed + report.undecided).to_string(),
    ]
}

fn percent(rate: &Estimate) -> String {
    rate.value.map_or("-".to_string(), |rate| format!("{:.2} %", 100.0 * rate))
}

fn interval(rate: &Estimate) -> String {
    let ends = rate.low.zip(rate.high);
    ends.map_or("-".to_string(), |(low, high)| format!("[{:.2}, {:.2}]", 100.0 * low, 100.0 * high))
}

/// Returns the JSON of a finished run.
fn document(finished: &Finished) -> Value {
    let path = finished.path.to_string_lossy();
    let (kind, own) = match &finished.outcome {
        Outcome::Evaluation(found) => ("evaluate", evaluation::document(&finished.resolved, found, &path)),
        Outcome::Falsification(found) => (
            "falsify",
            falsification::document(&finished.resolved, found, &falsification::Repeats::new(), &path),
        ),
    };
    json!({ "name": finished.name, "kind": kind, "result": own })
}
