//! Results as files: `manifest.json`, and per campaign one CSV file for each run with a line per
//! unit, and `evaluations.csv`.

use std::fs;
use std::path::{Component, Path};

use mishandle::Plan;
use mishandle::evaluation::Estimate;
use mishandle::files::{limits, read_bounded, read_text_bounded, write_atomically};
use mishandle::store::TrialStatus;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::paper::PaperError;
use crate::paper::results::{CampaignResults, EvaluationSummary, Results, RunFacts, RunResults};
use crate::paper::unit::{Evaluated, UNIT_OF_EVALUATION, Unit};

/// Version of the files.
const FORMAT: u32 = 2;

const MANIFEST: &str = "manifest.json";
const EVALUATIONS: &str = "evaluations.csv";

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Manifest {
    format: u32,
    date: String,
    machine: String,
    commit: Option<String>,
    campaigns: Vec<CampaignEntry>,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct CampaignEntry {
    name: String,
    command: String,
    runs: Vec<RunFacts>,
}

/// A line of the file of a run: a [`Unit`]. A CSV row cannot contain a structure.
#[derive(Debug, Serialize, Deserialize)]
struct UnitRow {
    trial: u32,
    first: u32,
    simulations: u32,
    seed: u64,
    status: String,
    violations: u32,
    stopped: u32,
    lowest: Option<f64>,
    highest: Option<f64>,
    started: Option<u64>,
    successes: Option<u64>,
    dangerous_n: Option<u64>,
    dangerous_sum: Option<f64>,
    completed: Option<u64>,
    completion_sum: Option<f64>,
    sha256: String,
}

/// A line of `evaluations.csv`: an [`EvaluationSummary`]. The units have the numbers of
/// simulations.
#[derive(Debug, Serialize, Deserialize)]
struct EvaluationRow {
    run: String,
    dangerous_rate: Option<f64>,
    dangerous_low: Option<f64>,
    dangerous_high: Option<f64>,
    completion_time: Option<f64>,
    completion_low: Option<f64>,
    completion_high: Option<f64>,
    failing_corners: u32,
    corners: u32,
}

impl Results {
    /// Writes the results to a folder.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), PaperError> {
        for campaign in &self.campaigns {
            let folder = folder.join(&campaign.name);
            for run in &campaign.runs {
                let rows = run.units.iter().map(UnitRow::of);
                write_rows(&folder.join(format!("{}.csv", run.facts.name)), rows)?;
            }
            let evaluations: Vec<EvaluationRow> =
                campaign.runs.iter().filter_map(EvaluationRow::of).collect();
            if !evaluations.is_empty() {
                write_rows(&folder.join(EVALUATIONS), evaluations)?;
            }
        }
        self.write_manifest(folder)
    }

    /// Writes the manifest to the folder of the results.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write_manifest(&self, folder: &Path) -> Result<(), PaperError> {
        let entry = |campaign: &CampaignResults| CampaignEntry {
            name: campaign.name.clone(),
            command: campaign.command.clone(),
            runs: campaign.runs.iter().map(|run| run.facts.clone()).collect(),
        };
        let manifest = Manifest {
            format: FORMAT,
            date: self.date.clone(),
            machine: self.machine.clone(),
            commit: self.commit.clone(),
            campaigns: self.campaigns.iter().map(entry).collect(),
        };
        let path = folder.join(MANIFEST);
        // Compact: indentation is a third of it.
        let text = serde_json::to_string(&manifest);
        let text = text.map_err(|error| PaperError::results(&path, &error))?;
        write(&path, (text + "\n").as_bytes())
    }

    /// Reads results that [`write`](Self::write) wrote.
    ///
    /// # Errors
    /// If a file cannot be read, or contains something else.
    pub fn read(folder: &Path) -> Result<Results, PaperError> {
        let path = folder.join(MANIFEST);
        let text = read_text_bounded(&path, limits::CONTROLLER).map_err(PaperError::file(&path))?;
        let manifest: Manifest =
            serde_json::from_str(&text).map_err(|error| PaperError::results(&path, &error))?;
        if manifest.format != FORMAT {
            let problem = format!("format {}, this program reads format {FORMAT}", manifest.format);
            return Err(PaperError::results(&path, &problem));
        }
        let campaigns = manifest.campaigns.into_iter().map(|entry| read_campaign(folder, entry));
        let campaigns = campaigns.collect::<Result<Vec<CampaignResults>, PaperError>>()?;
        let Manifest { date, machine, commit, .. } = manifest;
        Ok(Results { date, machine, commit, campaigns })
    }

    /// Returns whether a folder contains results, and not a campaign.
    pub fn is_in(folder: &Path) -> bool {
        folder.join(MANIFEST).is_file()
    }
}

fn read_campaign(folder: &Path, entry: CampaignEntry) -> Result<CampaignResults, PaperError> {
    let manifest = folder.join(MANIFEST);
    let names: Vec<&str> = entry.runs.iter().map(|facts| facts.name.as_str()).collect();
    if let Some(name) = names.iter().chain([&entry.name.as_str()]).find(|name| !is_inside(name)) {
        return Err(PaperError::results(&manifest, &format!("`{name}` is not in the folder of the results")));
    }
    if let Some(name) =
        names.iter().enumerate().find_map(|(i, name)| names[..i].contains(name).then_some(*name))
    {
        return Err(PaperError::results(&manifest, &format!("the manifest lists the run `{name}` twice")));
    }
    let folder = folder.join(&entry.name);
    let path = folder.join(EVALUATIONS);
    let evaluations: Vec<EvaluationRow> = if path.is_file() { read_rows(&path)? } else { Vec::new() };
    let runs = entry.runs.into_iter().map(|facts| read_run(&folder, facts, &evaluations));
    let runs = runs.collect::<Result<Vec<RunResults>, PaperError>>()?;
    Ok(CampaignResults { name: entry.name, command: entry.command, runs })
}

fn read_run(folder: &Path, facts: RunFacts, evaluations: &[EvaluationRow]) -> Result<RunResults, PaperError> {
    let path = folder.join(format!("{}.csv", facts.name));
    let plan = Plan::from_toml(&facts.plan)?;
    let mut units: Vec<Unit> = Vec::new();
    for (line, row) in (2..).zip(read_rows::<UnitRow>(&path)?) {
        let checked = row.unit(&plan).and_then(|unit| match contradiction(&plan, units.last(), &unit) {
            None => Ok(unit),
            Some(problem) => Err(problem),
        });
        units
            .push(checked.map_err(|problem| PaperError::results(&path, &format!("line {line}: {problem}")))?);
    }
    let mut run = RunResults { facts, plan, units, evaluation: None };
    if run.plan.evaluate.is_some() {
        let path = folder.join(EVALUATIONS);
        let row = evaluations.iter().find(|row| row.run == run.facts.name);
        let missing = || PaperError::results(&path, &format!("it has no line for `{}`", run.facts.name));
        run.evaluation = Some(row.ok_or_else(missing)?.summary(&run));
    }
    Ok(run)
}

/// Returns why a unit cannot be the next one after `previous`.
fn contradiction(plan: &Plan, previous: Option<&Unit>, unit: &Unit) -> Option<String> {
    let same_trial = previous.filter(|previous| previous.trial == unit.trial);
    let expected = same_trial.map_or(1, |previous| previous.first.saturating_add(previous.simulations));
    if previous.is_some_and(|previous| previous.trial > unit.trial) {
        return Some(format!("trial {} after a later one", unit.trial));
    }
    if unit.first != expected || (same_trial.is_some() && plan.evaluate.is_none()) {
        return Some(format!(
            "expected simulation {expected} of trial {}, found {}; units are missing or repeated",
            unit.trial, unit.first
        ));
    }
    let budget = plan.falsify.as_ref().map(|falsify| falsify.budget);
    let largest = if plan.evaluate.is_some() { Some(UNIT_OF_EVALUATION) } else { budget };
    if let Some(largest) = largest.filter(|largest| unit.simulations > *largest) {
        return Some(format!("{} simulations, expected at most {largest}", unit.simulations));
    }
    let violates = unit.violations > 0;
    let is_ended = unit.status != TrialStatus::Running;
    let is_falsification = plan.falsify.is_some();
    if is_falsification && is_ended && violates != (unit.status == TrialStatus::Falsified) {
        let status = status_name(unit.status);
        return Some(format!("the trial has {} violations and the status `{status}`", unit.violations));
    }
    None
}

impl UnitRow {
    fn of(unit: &Unit) -> UnitRow {
        let found = unit.evaluated;
        UnitRow {
            trial: unit.trial,
            first: unit.first,
            simulations: unit.simulations,
            seed: unit.seed,
            status: status_name(unit.status).to_string(),
            violations: unit.violations,
            stopped: unit.stopped,
            lowest: unit.lowest,
            highest: unit.highest,
            started: found.map(|found| found.started),
            successes: found.map(|found| found.successes),
            dangerous_n: found.map(|found| found.dangerous_n),
            dangerous_sum: found.map(|found| found.dangerous_sum),
            completed: found.map(|found| found.completed),
            completion_sum: found.map(|found| found.completion_sum),
            sha256: unit.sha256.clone(),
        }
    }

    fn unit(self, plan: &Plan) -> Result<Unit, String> {
        let evaluated = || {
            Some(Evaluated {
                started: self.started?,
                successes: self.successes?,
                dangerous_n: self.dangerous_n?,
                dangerous_sum: self.dangerous_sum?,
                completed: self.completed?,
                completion_sum: self.completion_sum?,
            })
        };
        let evaluated = evaluated();
        if evaluated.is_some() != plan.evaluate.is_some() {
            return Err("the counts of an evaluation do not fit the plan".to_string());
        }
        Ok(Unit {
            trial: self.trial,
            first: self.first,
            simulations: self.simulations,
            seed: self.seed,
            status: status(&self.status).ok_or_else(|| format!("trial status `{}`", self.status))?,
            violations: self.violations,
            stopped: self.stopped,
            lowest: self.lowest,
            highest: self.highest,
            evaluated,
            sha256: self.sha256,
        })
    }
}

impl EvaluationRow {
    fn of(run: &RunResults) -> Option<EvaluationRow> {
        let EvaluationSummary { dangerous_behavior_rate, task_completion_time, failing_corners, corners } =
            run.evaluation?;
        let danger = dangerous_behavior_rate.unwrap_or_default();
        let completion = task_completion_time.unwrap_or_default();
        Some(EvaluationRow {
            run: run.facts.name.clone(),
            dangerous_rate: danger.value,
            dangerous_low: danger.low,
            dangerous_high: danger.high,
            completion_time: completion.value,
            completion_low: completion.low,
            completion_high: completion.high,
            failing_corners,
            corners,
        })
    }

    fn summary(&self, run: &RunResults) -> EvaluationSummary {
        let sum = |count: fn(&Evaluated) -> u64| run.random_units().map(|(_, found)| count(found)).sum();
        let danger = Estimate {
            value: self.dangerous_rate,
            low: self.dangerous_low,
            high: self.dangerous_high,
            n: sum(|found| found.dangerous_n),
        };
        let completion = Estimate {
            value: self.completion_time,
            low: self.completion_low,
            high: self.completion_high,
            n: sum(|found| found.completed),
        };
        EvaluationSummary {
            dangerous_behavior_rate: run.facts.has_formula("safe").then_some(danger),
            task_completion_time: run.facts.has_formula("completion").then_some(completion),
            failing_corners: self.failing_corners,
            corners: self.corners,
        }
    }
}

/// Returns whether a name from the manifest leads into the folder of the results.
fn is_inside(name: &str) -> bool {
    !name.is_empty() && Path::new(name).components().all(|part| matches!(part, Component::Normal(_)))
}

/// Writes a file atomically, and creates its folder.
fn write(path: &Path, bytes: &[u8]) -> Result<(), PaperError> {
    let folder = path.parent().unwrap_or(Path::new("."));
    fs::create_dir_all(folder).map_err(PaperError::file(folder))?;
    write_atomically(path, bytes).map_err(PaperError::file(path))
}

/// Writes rows as CSV. Numbers have enough digits to be read back exactly.
fn write_rows<T: Serialize>(path: &Path, rows: impl IntoIterator<Item = T>) -> Result<(), PaperError> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for row in rows {
        writer.serialize(row).map_err(|error| PaperError::results(path, &error))?;
    }
    let bytes = writer.into_inner().map_err(|error| PaperError::results(path, &error))?;
    write(path, &bytes)
}

fn read_rows<T: DeserializeOwned>(path: &Path) -> Result<Vec<T>, PaperError> {
    let bytes = read_bounded(path, limits::CONTROLLER).map_err(PaperError::file(path))?;
    let rows = csv::Reader::from_reader(&bytes[..]).into_deserialize().collect::<Result<_, _>>();
    rows.map_err(|error| PaperError::results(path, &error))
}

const STATUSES: [(TrialStatus, &str); 4] = [
    (TrialStatus::Running, "running"),
    (TrialStatus::Falsified, "falsified"),
    (TrialStatus::BudgetSpent, "budget spent"),
    (TrialStatus::Converged, "converged"),
];

fn status_name(status: TrialStatus) -> &'static str {
    STATUSES.iter().find(|(known, _)| *known == status).map_or("running", |(_, name)| name)
}

fn status(name: &str) -> Option<TrialStatus> {
    STATUSES.iter().find(|(_, known)| *known == name).map(|(status, _)| *status)
}
