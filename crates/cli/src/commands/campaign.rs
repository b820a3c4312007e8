use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use mishandle::evaluation::Estimate;
use mishandle::falsification::CampaignOutcome;
use mishandle::files::{limits, read_text_bounded};
use mishandle::store::RunKind;
use mishandle::{CampaignRun, EvaluationOutcome, ResolvedPlan, decimal, plural, shell_quote};
use serde_json::{Value, json};

use super::{evaluate, falsify, report};
use crate::progress::Bar;
use crate::{ExitStatus, args, interrupt, numbers, output, run};

/// Run a grid of evaluations and falsifications: targets, controllers, spaces, formulas, searches, seeds
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle campaign campaign.toml --out runs/controllers
  mishandle campaign --resume runs/controllers
  mishandle campaign campaign.toml --ray auto         on this machine's Ray cluster

The campaign file is a plan in which keys may have lists of values: see docs/guide/campaigns.md. Each
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
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<usize>(args::THREADS))]
    #[arg(conflicts_with = "ray")]
    pub jobs: Option<usize>,
    /// Number of threads; does not affect the results [default: number of cores]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<usize>(args::THREADS))]
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
        results = run_all(&runs, &bar, command.durable, command.jobs.unwrap_or(1))?;
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
        let documents: Vec<Value> = results.iter().map(Finished::document).collect();
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
        let options = report::Options { simulations: None, controller: None, skip_check: false, force: true };
        report::write_campaign(&folder, pages, &options)?;
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

/// A finished run.
pub struct Finished {
    name: String,
    path: PathBuf,
    resolved: ResolvedPlan,
    outcome: Outcome,
}

enum Outcome {
    Evaluation(Box<EvaluationOutcome>),
    Falsification(Box<CampaignOutcome>),
}

impl Finished {
    fn document(&self) -> Value {
        let path = self.path.to_string_lossy();
        let (kind, own) = match &self.outcome {
            Outcome::Evaluation(found) => ("evaluate", evaluate::document(&self.resolved, found, &path)),
            Outcome::Falsification(found) => {
                ("falsify", falsify::document(&self.resolved, found, &falsify::Repeats::new(), &path))
            }
        };
        json!({ "name": self.name, "kind": kind, "result": own })
    }
}

/// Runs or completes all runs in order, `jobs` at a time. Returns the finished ones, which are fewer if a signal interrupts them.
pub fn run_all(runs: &[CampaignRun], bar: &Bar, is_durable: bool, jobs: usize) -> Result<Vec<Finished>> {
    let progress = Progress::new(runs, bar);
    let (next, failed) = (AtomicUsize::new(0), AtomicBool::new(false));
    let work = || {
        let mut finished = Vec::new();
        while !failed.load(Ordering::Relaxed) && !interrupt::requested() {
            let index = next.fetch_add(1, Ordering::Relaxed);
            let Some(run) = runs.get(index) else { break };
            let watch = |done, planned| {
                progress.report(index, done, planned);
                // A failure ends the other jobs like a signal: what they have done is stored.
                if failed.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { run::control_flow() }
            };
            let result = run_one(run, is_durable, watch).with_context(|| format!("run {}", run.name));
            failed.fetch_or(result.is_err(), Ordering::Relaxed);
            finished.extend(result.transpose().map(|result| (index, result)));
        }
        finished
    };
    let mut finished = match jobs.min(runs.len()) {
        0 | 1 => work(),
        jobs => std::thread::scope(|scope| {
            let workers: Vec<_> = (0..jobs).map(|_| scope.spawn(work)).collect();
            let joined = workers.into_iter().flat_map(|worker| match worker.join() {
                Ok(finished) => finished,
                Err(panic) => std::panic::resume_unwind(panic),
            });
            joined.collect()
        }),
    };
    finished.sort_by_key(|(index, _)| *index);
    finished.into_iter().map(|(_, result)| result).collect()
}

/// Progress of all runs, on one bar.
struct Progress<'a> {
    runs: &'a [CampaignRun],
    bar: &'a Bar,
    /// Number of finished simulations of each run, and of those that its plan asks for.
    counts: Mutex<Vec<(u64, u64)>>,
}

impl Progress<'_> {
    fn new<'a>(runs: &'a [CampaignRun], bar: &'a Bar) -> Progress<'a> {
        Progress { runs, bar, counts: Mutex::new(vec![(0, 0); runs.len()]) }
    }

    fn report(&self, index: usize, done: u64, planned: u64) {
        let Ok(mut counts) = self.counts.lock() else { return };
        counts[index] = (done, planned);
        self.bar.set_length(counts.iter().map(|(_, planned)| planned).sum());
        self.bar.set_position(counts.iter().map(|(done, _)| done).sum());
        self.bar.set_note(format!("run {} of {}: {}", index + 1, self.runs.len(), self.runs[index].name));
    }
}

/// Runs or completes one run. Returns `None` if it was interrupted.
fn run_one(
    run: &CampaignRun,
    is_durable: bool,
    mut watch: impl FnMut(u64, u64) -> ControlFlow<()>,
) -> Result<Option<Finished>> {
    let (mut file, resolved) = run.resume()?;
    if is_durable {
        file.set_durable()?;
    }
    run::report_build_differences("started", &mishandle::build_differences(file.file().header(), &resolved));
    let outcome = match file.file().header().kind {
        RunKind::Evaluate => {
            let planned = mishandle::evaluation_simulations(&resolved);
            let found = mishandle::evaluate(&resolved, file, |done| watch(done, planned))?;
            found.is_complete.then(|| Outcome::Evaluation(Box::new(found)))
        }
        RunKind::Falsify => {
            let found = mishandle::falsify(&resolved, file, |progress| {
                watch(progress.simulations, progress.max_simulations)
            })?;
            falsify::is_complete(&resolved, &found).then(|| Outcome::Falsification(Box::new(found)))
        }
    };
    let CampaignRun { name, path, .. } = run.clone();
    Ok(outcome.map(|outcome| Finished { name, path, resolved, outcome }))
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
