use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, Result, bail, ensure};
use mishandle::evaluation::Estimate;
use mishandle::falsification::CampaignOutcome;
use mishandle::files::{limits, read_text_bounded};
use mishandle::store::RunKind;
use mishandle::{CampaignRun, EvaluationOutcome, ResolvedPlan, plural, shell_quote};
use serde_json::{Value, json};

use super::{evaluate, falsify};
use crate::progress::Bar;
use crate::{ExitStatus, args, interrupt, output, run};

pub fn run(command: &args::Campaign) -> Result<ExitStatus> {
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
        results = run_all(&runs, &bar, command.durable)?;
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
    output::message(&format!("Run files: {name}"));
    let is_falsified = |finished: &Finished| matches!(&finished.outcome, Outcome::Falsification(found) if found.falsified_trials > 0);
    Ok(if results.iter().any(is_falsified) { ExitStatus::Violated } else { ExitStatus::Done })
}

/// Opens the campaign to resume, or else creates a new one.
fn open(command: &args::Campaign) -> Result<(PathBuf, Vec<CampaignRun>)> {
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
struct Finished {
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

/// Runs or completes all runs in order. Returns fewer if a signal interrupts them.
fn run_all(runs: &[CampaignRun], bar: &Bar, is_durable: bool) -> Result<Vec<Finished>> {
    let mut finished = Vec::new();
    for (number, run) in (1..).zip(runs) {
        let note = format!("run {number} of {}: {}", runs.len(), run.name);
        let Some(found) =
            run_one(run, bar, &note, is_durable).with_context(|| format!("run {}", run.name))?
        else {
            break;
        };
        finished.push(found);
    }
    Ok(finished)
}

/// Runs or completes one run. Returns `None` if a signal interrupts it.
fn run_one(run: &CampaignRun, bar: &Bar, note: &str, is_durable: bool) -> Result<Option<Finished>> {
    let (mut file, resolved) = run.resume()?;
    if is_durable {
        file.set_durable()?;
    }
    run::report_build_differences("started", &mishandle::build_differences(file.file().header(), &resolved));
    bar.set_note(note.to_string());
    let outcome = match file.file().header().kind {
        RunKind::Evaluate => {
            bar.set_length(mishandle::evaluation_simulations(&resolved));
            let found = mishandle::evaluate(&resolved, file, |done| {
                bar.set_position(done);
                run::control_flow()
            })?;
            found.is_complete.then(|| Outcome::Evaluation(Box::new(found)))
        }
        RunKind::Falsify => {
            let found = mishandle::falsify(&resolved, file, |progress| {
                bar.set_length(progress.max_simulations);
                bar.set_position(progress.simulations);
                run::control_flow()
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
        minimum.map_or("-".to_string(), |minimum| format!("{minimum:.4}")),
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
