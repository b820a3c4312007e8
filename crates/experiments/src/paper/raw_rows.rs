//! Results as files: `manifest.json`, and per campaign `trials.csv` and one compressed CSV file per run.

use std::io::{Read, Write};
use std::path::Path;

use flate2::read::GzDecoder;
use flate2::{Compression, GzBuilder};
use mishandle::Plan;
use mishandle::files::{limits, read_text_bounded};
use mishandle::store::{Simulation, SimulationEnd, TrialRecord, TrialStatus};
use serde::{Deserialize, Serialize};

use super::results::{CampaignResults, Results, RunFacts, RunResults};
use crate::ExperimentError;
use crate::folder::{read, write};

/// Version of the files.
const FORMAT: u32 = 1;

const MANIFEST: &str = "manifest.json";
const TRIALS: &str = "trials.csv";

/// Largest size of the uncompressed rows of a run.
const MAX_ROWS: u64 = 1 << 30;

/// Columns of the rows of a run, before those of the axes. Those of the verdicts are at the end.
const FIXED: [&str; 8] =
    ["trial", "simulation", "seed", "robustness", "end", "end_step", "end_index", "steps"];

/// The verdicts of an evaluation, as in run files.
const VERDICTS: [&str; 5] = ["success", "strict", "dangerous_steps", "completion_step", "total_reward"];

/// Number of those that the files keep: the total reward is left out.
const KEPT_VERDICTS: usize = 4;

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Manifest {
    format: u32,
    date: String,
    machine: String,
    campaigns: Vec<CampaignEntry>,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct CampaignEntry {
    name: String,
    command: String,
    runs: Vec<RunFacts>,
}

#[derive(Debug, Serialize, Deserialize)]
struct TrialRow {
    run: String,
    trial: u32,
    seed: u64,
    status: String,
    simulations: usize,
}

impl Results {
    /// Writes the results to a folder.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), ExperimentError> {
        for campaign in &self.campaigns {
            let folder = folder.join(&campaign.name);
            let mut trials = csv::Writer::from_writer(Vec::new());
            for run in &campaign.runs {
                let path = folder.join(format!("{}.csv.gz", run.facts.name));
                write(&path, &compressed(&rows_text(run)?).map_err(ExperimentError::file(&path))?)?;
                for trial in &run.trials {
                    trials
                        .serialize(TrialRow {
                            run: run.facts.name.clone(),
                            trial: trial.number,
                            seed: trial.seed,
                            status: status_name(trial.status).to_string(),
                            simulations: run.simulations_of(trial.number).count(),
                        })
                        .map_err(|error| ExperimentError::results(&folder.join(TRIALS), &error))?;
                }
            }
            let path = folder.join(TRIALS);
            let bytes = trials.into_inner().map_err(|error| ExperimentError::results(&path, &error))?;
            write(&path, &bytes)?;
        }
        let entry = |campaign: &CampaignResults| CampaignEntry {
            name: campaign.name.clone(),
            command: campaign.command.clone(),
            runs: campaign.runs.iter().map(|run| run.facts.clone()).collect(),
        };
        let manifest = Manifest {
            format: FORMAT,
            date: self.date.clone(),
            machine: self.machine.clone(),
            campaigns: self.campaigns.iter().map(entry).collect(),
        };
        let path = folder.join(MANIFEST);
        let text = serde_json::to_string_pretty(&manifest);
        let text = text.map_err(|error| ExperimentError::results(&path, &error))?;
        write(&path, (text + "\n").as_bytes())
    }

    /// Reads results that [`write`](Self::write) wrote.
    ///
    /// # Errors
    /// If a file cannot be read, or contains something else.
    pub fn read(folder: &Path) -> Result<Results, ExperimentError> {
        let path = folder.join(MANIFEST);
        let text = read_text_bounded(&path, limits::CONTROLLER).map_err(ExperimentError::file(&path))?;
        let manifest: Manifest =
            serde_json::from_str(&text).map_err(|error| ExperimentError::results(&path, &error))?;
        if manifest.format != FORMAT {
            let problem = format!("format {}, this program reads format {FORMAT}", manifest.format);
            return Err(ExperimentError::results(&path, &problem));
        }
        let campaigns = manifest.campaigns.into_iter().map(|entry| read_campaign(folder, entry));
        let campaigns = campaigns.collect::<Result<Vec<CampaignResults>, ExperimentError>>()?;
        Ok(Results { date: manifest.date, machine: manifest.machine, campaigns })
    }

    /// Returns whether a folder contains results, and not a campaign.
    pub fn is_in(folder: &Path) -> bool {
        folder.join(MANIFEST).is_file()
    }
}

fn read_campaign(folder: &Path, entry: CampaignEntry) -> Result<CampaignResults, ExperimentError> {
    let folder = folder.join(&entry.name);
    let path = folder.join(TRIALS);
    let bytes = read(&path)?;
    let trials: Vec<TrialRow> = csv::Reader::from_reader(&bytes[..])
        .deserialize()
        .collect::<Result<_, _>>()
        .map_err(|error| ExperimentError::results(&path, &error))?;
    let runs = entry.runs.into_iter().map(|facts| read_run(&folder, facts, &trials));
    Ok(CampaignResults { name: entry.name, command: entry.command, runs: runs.collect::<Result<_, _>>()? })
}

fn read_run(folder: &Path, facts: RunFacts, trials: &[TrialRow]) -> Result<RunResults, ExperimentError> {
    let path = folder.join(format!("{}.csv.gz", facts.name));
    let wrong = |problem: String| ExperimentError::results(&path, &problem);
    let plan = Plan::from_toml(&facts.plan)?;
    let of_run: Vec<&TrialRow> = trials.iter().filter(|trial| trial.run == facts.name).collect();
    let record = |row: &TrialRow| {
        let status = status(&row.status).ok_or_else(|| wrong(format!("trial status `{}`", row.status)))?;
        Ok(TrialRecord { number: row.trial, seed: row.seed, status })
    };
    let trial_records =
        of_run.iter().copied().map(record).collect::<Result<Vec<TrialRecord>, ExperimentError>>()?;
    let mut text = String::new();
    let bytes = read(&path)?;
    let mut decoder = GzDecoder::new(&bytes[..]).take(MAX_ROWS);
    decoder.read_to_string(&mut text).map_err(ExperimentError::file(&path))?;
    let mut run = RunResults { facts, plan, trials: trial_records, simulations: Vec::new() };
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    for (line, row) in (2..).zip(reader.records()) {
        let row = row.map_err(|error| wrong(error.to_string()))?;
        let found = simulation(&run, &row).ok_or_else(|| wrong(format!("line {line} is no simulation")))?;
        run.simulations.push(found);
    }
    for trial in of_run {
        let found = run.simulations_of(trial.trial).count();
        if found != trial.simulations {
            let problem =
                format!("trial {} has {found} simulations, {TRIALS} says {}", trial.trial, trial.simulations);
            return Err(wrong(problem));
        }
    }
    Ok(run)
}

/// Returns the rows of a run as CSV. Numbers have enough digits to be read back exactly.
fn rows_text(run: &RunResults) -> Result<Vec<u8>, ExperimentError> {
    let is_evaluation = run.plan.falsify.is_none();
    let mut names: Vec<String> = FIXED.map(String::from).to_vec();
    names.extend(run.facts.axes.iter().map(|(name, _)| name.clone()));
    if is_evaluation {
        names.extend(VERDICTS[..KEPT_VERDICTS].iter().map(ToString::to_string));
    }
    let mut text = names.join(",") + "\n";
    let optional = |value: Option<String>| value.unwrap_or_default();
    for row in &run.simulations {
        let planned = run
            .trials
            .iter()
            .find(|trial| trial.number == row.trial)
            .map(|trial| run.planned_seed(trial, row.number));
        let (step, index) = step_and_index(row.end);
        let mut cells = vec![
            row.trial.to_string(),
            row.number.to_string(),
            // A seed that follows from that of the trial has 20 digits that do not compress.
            if planned == Some(row.seed) { String::new() } else { row.seed.to_string() },
            optional(row.robustness.map(|rho| rho.to_string())),
            row.end.name().to_string(),
            optional(step.map(|step| step.to_string())),
            optional(index.map(|index| index.to_string())),
            row.steps.to_string(),
        ];
        cells.extend(row.scenario.iter().map(|value| optional(value.map(|value| value.to_string()))));
        if is_evaluation {
            let verdicts = row.verdicts.iter().take(KEPT_VERDICTS);
            cells.extend(verdicts.map(|value| optional(value.map(|value| value.to_string()))));
        }
        text += &(cells.join(",") + "\n");
    }
    Ok(text.into_bytes())
}

/// Reads a row of [`rows_text`].
fn simulation(run: &RunResults, row: &csv::StringRecord) -> Option<Simulation> {
    let number = |index: usize| -> Option<u32> { row.get(index)?.parse().ok() };
    let optional = |index: usize| -> Option<Option<f64>> {
        match row.get(index)? {
            "" => Some(None),
            text => text.parse().ok().map(Some),
        }
    };
    let (trial, simulation) = (number(0)?, number(1)?);
    let seed = match row.get(2)? {
        "" => {
            let record = run.trials.iter().find(|record| record.number == trial)?;
            run.planned_seed(record, simulation)
        }
        text => text.parse().ok()?,
    };
    let robustness = optional(3)?;
    let axes = run.facts.axes.len();
    let scenario = (0..axes).map(|i| optional(FIXED.len() + i)).collect::<Option<Vec<_>>>()?;
    let verdicts = match run.plan.falsify {
        Some(_) => Vec::new(),
        None => {
            let kept = (0..KEPT_VERDICTS).map(|i| optional(FIXED.len() + axes + i));
            kept.chain([Some(None)]).collect::<Option<Vec<_>>>()?
        }
    };
    Some(Simulation {
        trial,
        number: simulation,
        seed,
        unit_point: Vec::new(),
        scenario,
        robustness,
        robustness_low: robustness,
        robustness_high: robustness,
        stop_threshold: None,
        end: SimulationEnd::from_name(row.get(4)?, number(5), number(6))?,
        steps: number(7)?,
        verdicts,
        trace_digest: None,
        trace: None,
    })
}

fn step_and_index(end: SimulationEnd) -> (Option<u32>, Option<u32>) {
    use SimulationEnd as End;
    let index = match end {
        End::InvalidAction { index, .. }
        | End::InvalidObservation { index, .. }
        | End::InvalidReward { index, .. }
        | End::InvalidSignal { index, .. } => Some(index),
        _ => None,
    };
    (end.step(), index)
}

/// Compresses with gzip. The same bytes give the same file: it has no time.
fn compressed(bytes: &[u8]) -> std::io::Result<Vec<u8>> {
    let mut encoder = GzBuilder::new().mtime(0).write(Vec::new(), Compression::best());
    encoder.write_all(bytes)?;
    encoder.finish()
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
