//! Results as files: `manifest.json`, and per campaign `trials.csv` and one compressed CSV file per run.

use std::fs;
use std::io::{Read, Write};
use std::path::{Component, Path};

use flate2::read::GzDecoder;
use flate2::{Compression, GzBuilder};
use mishandle::Plan;
use mishandle::files::{limits, read_bounded, read_text_bounded, write_atomically};
use mishandle::store::{Simulation, SimulationEnd, TrialRecord, TrialStatus};
use serde::{Deserialize, Serialize};

use crate::PaperError;
use crate::results::{CampaignResults, Results, RunFacts, RunResults};

/// Version of the files.
const FORMAT: u32 = 1;

const MANIFEST: &str = "manifest.json";
const TRIALS: &str = "trials.csv";

/// Largest size of the uncompressed rows of a run.
const MAX_ROWS: u64 = 1 << 30;

/// Largest number of characters of a cell: the smallest numbers have more than 300 decimals.
const MAX_CELL: usize = 400;

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

/// Writes a file atomically, and creates its folder.
fn write(path: &Path, bytes: &[u8]) -> Result<(), PaperError> {
    let folder = path.parent().unwrap_or(Path::new("."));
    fs::create_dir_all(folder).map_err(PaperError::file(folder))?;
    write_atomically(path, bytes).map_err(PaperError::file(path))
}

fn read(path: &Path) -> Result<Vec<u8>, PaperError> {
    read_bounded(path, limits::CONTROLLER).map_err(PaperError::file(path))
}

impl Results {
    /// Writes the results to a folder.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), PaperError> {
        for campaign in &self.campaigns {
            let folder = folder.join(&campaign.name);
            let mut trials = csv::Writer::from_writer(Vec::new());
            for run in &campaign.runs {
                let path = folder.join(format!("{}.csv.gz", run.facts.name));
                write(&path, &compressed(&rows_text(run)?).map_err(PaperError::file(&path))?)?;
                for trial in &run.trials {
                    trials
                        .serialize(TrialRow {
                            run: run.facts.name.clone(),
                            trial: trial.number,
                            seed: trial.seed,
                            status: status_name(trial.status).to_string(),
                            simulations: run.simulations_of(trial.number).count(),
                        })
                        .map_err(|error| PaperError::results(&folder.join(TRIALS), &error))?;
                }
            }
            let path = folder.join(TRIALS);
            let bytes = trials.into_inner().map_err(|error| PaperError::results(&path, &error))?;
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
        Ok(Results { date: manifest.date, machine: manifest.machine, campaigns })
    }

    /// Returns whether a folder contains results, and not a campaign.
    pub fn is_in(folder: &Path) -> bool {
        folder.join(MANIFEST).is_file()
    }
}

fn read_campaign(folder: &Path, entry: CampaignEntry) -> Result<CampaignResults, PaperError> {
    if !is_inside(&entry.name) {
        let problem = format!("the campaign `{}` has no name of a folder", entry.name);
        return Err(PaperError::results(&folder.join(MANIFEST), &problem));
    }
    let folder = folder.join(&entry.name);
    let path = folder.join(TRIALS);
    let bytes = read(&path)?;
    let trials: Vec<TrialRow> = csv::Reader::from_reader(&bytes[..])
        .deserialize()
        .collect::<Result<_, _>>()
        .map_err(|error| PaperError::results(&path, &error))?;
    let names: Vec<&str> = entry.runs.iter().map(|facts| facts.name.as_str()).collect();
    if let Some(name) =
        names.iter().enumerate().find_map(|(i, name)| names[..i].contains(name).then_some(*name))
    {
        return Err(PaperError::results(&path, &format!("the manifest lists the run `{name}` twice")));
    }
    let runs = entry.runs.into_iter().map(|facts| read_run(&folder, facts, &trials));
    Ok(CampaignResults { name: entry.name, command: entry.command, runs: runs.collect::<Result<_, _>>()? })
}

fn read_run(folder: &Path, facts: RunFacts, trials: &[TrialRow]) -> Result<RunResults, PaperError> {
    let path = folder.join(format!("{}.csv.gz", facts.name));
    let wrong = |problem: String| PaperError::results(&path, &problem);
    if !is_inside(&facts.name) {
        return Err(wrong("it is not in the folder of the results".to_string()));
    }
    let plan = Plan::from_toml(&facts.plan)?;
    let of_run: Vec<&TrialRow> = trials.iter().filter(|trial| trial.run == facts.name).collect();
    let record = |row: &TrialRow| {
        let status = status(&row.status).ok_or_else(|| wrong(format!("trial status `{}`", row.status)))?;
        Ok(TrialRecord { number: row.trial, seed: row.seed, status })
    };
    let trial_records =
        of_run.iter().copied().map(record).collect::<Result<Vec<TrialRecord>, PaperError>>()?;
    for (i, trial) in of_run.iter().enumerate() {
        if of_run[..i].iter().any(|other| other.trial == trial.trial) {
            return Err(wrong(format!("{TRIALS} lists trial {} twice", trial.trial)));
        }
        let budget = plan.falsify.as_ref().map(|falsify| falsify.budget as usize);
        if let Some(budget) = budget.filter(|budget| trial.simulations > *budget) {
            let problem = format!(
                "trial {} has {} simulations, its budget is {budget}",
                trial.trial, trial.simulations
            );
            return Err(wrong(problem));
        }
    }
    // A small file can decompress to gigabytes, so nothing is read that the list of trials does not promise.
    let listed = of_run.iter().fold(0_usize, |sum, trial| sum.saturating_add(trial.simulations));
    let columns = FIXED.len() + facts.axes.len() + VERDICTS.len();
    let names = facts.axes.iter().fold(0, |sum, (name, _)| sum + 2 * name.len());
    let limit =
        (listed as u64).saturating_mul((columns * MAX_CELL) as u64).saturating_add((names + 1000) as u64);
    let bytes = read(&path)?;
    let decoder = GzDecoder::new(&bytes[..]).take(limit.min(MAX_ROWS));
    let mut run = RunResults { facts, plan, trials: trial_records, simulations: Vec::new() };
    let mut reader = csv::Reader::from_reader(decoder);
    for (line, row) in (2..).zip(reader.records()) {
        let row = row.map_err(|error| wrong(error.to_string()))?;
        if run.simulations.len() == listed {
            return Err(wrong(format!("it has more simulations than the {listed} that {TRIALS} lists")));
        }
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

/// Returns whether a name from the manifest leads into the folder of the results.
fn is_inside(name: &str) -> bool {
    !name.is_empty() && Path::new(name).components().all(|part| matches!(part, Component::Normal(_)))
}

/// Returns the rows of a run as CSV. Numbers have enough digits to be read back exactly.
fn rows_text(run: &RunResults) -> Result<Vec<u8>, PaperError> {
    let is_evaluation = run.plan.falsify.is_none();
    let mut names: Vec<String> = FIXED.map(String::from).to_vec();
    names.extend(run.facts.axes.iter().map(|(name, _)| name.clone()));
    if is_evaluation {
        names.extend(VERDICTS[..KEPT_VERDICTS].iter().map(ToString::to_string));
    }
    let mut header = csv::Writer::from_writer(Vec::new());
    header.write_record(&names).map_err(|error| PaperError::results(Path::new(&run.facts.name), &error))?;
    let header = header.into_inner();
    let header = header.map_err(|error| PaperError::results(Path::new(&run.facts.name), &error))?;
    let mut text = String::from_utf8_lossy(&header).into_owned();
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
            text => text.parse().ok().filter(|value: &f64| !value.is_nan()).map(Some),
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
        robustness_low: None,
        robustness_high: None,
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the results of a campaign with one run of three simulations in two trials.
    fn results() -> Results {
        let falsify =
            mishandle::plan::FalsifyPlan { budget: 2, trials: 2, ..mishandle::plan::FalsifyPlan::default() };
        let plan = Plan { falsify: Some(falsify), ..Plan::new("toy/sphere-2d", "") };
        let facts = RunFacts {
            name: "run".to_string(),
            plan: plan.to_toml(),
            formula: "always(distance >= 0.1)".to_string(),
            formulas: vec!["success".to_string()],
            axes: vec![("x, \"y\"".to_string(), "m".to_string())],
            target_hash: String::new(),
            controller_hash: String::new(),
            commit: String::new(),
            build: String::new(),
            versions: Vec::new(),
            training_steps: None,
        };
        let simulation = |(trial, number, robustness): (u32, u32, f64)| Simulation {
            trial,
            number,
            seed: 1,
            unit_point: Vec::new(),
            scenario: vec![Some(0.5)],
            robustness: Some(robustness),
            robustness_low: None,
            robustness_high: None,
            stop_threshold: None,
            end: SimulationEnd::Completed,
            steps: 1,
            verdicts: Vec::new(),
            trace_digest: None,
            trace: None,
        };
        let simulations = [(1, 1, 5e-324), (1, 2, f64::MAX), (2, 1, -1.0)].map(simulation).to_vec();
        let trial = |(number, status)| TrialRecord { number, seed: 0, status };
        let trials = [(1, TrialStatus::BudgetSpent), (2, TrialStatus::Falsified)].map(trial).to_vec();
        let run = RunResults { facts, plan, trials, simulations };
        let campaign = CampaignResults { name: "c".to_string(), command: String::new(), runs: vec![run] };
        Results { date: String::new(), machine: String::new(), campaigns: vec![campaign] }
    }

    /// Writes the results, changes a file, and returns the error of reading them.
    fn error(change: impl Fn(&Path)) -> String {
        let folder = tempfile::tempdir().unwrap();
        results().write(folder.path()).unwrap();
        change(folder.path());
        Results::read(folder.path()).unwrap_err().to_string()
    }

    fn replace(path: &Path, from: &str, to: &str) {
        let text = fs::read_to_string(path).unwrap();
        assert!(text.contains(from), "{text}");
        fs::write(path, text.replace(from, to)).unwrap();
    }

    fn rows(folder: &Path, change: impl Fn(String) -> String) {
        let text = String::from_utf8(rows_text(&results().campaigns[0].runs[0]).unwrap()).unwrap();
        fs::write(folder.join("c/run.csv.gz"), compressed(change(text).as_bytes()).unwrap()).unwrap();
    }

    #[test]
    fn rows_with_an_axis_of_any_name_and_the_longest_numbers_are_read_back() {
        let folder = tempfile::tempdir().unwrap();
        results().write(folder.path()).unwrap();
        assert_eq!(Results::read(folder.path()).unwrap(), results());
    }

    #[test]
    fn rows_beyond_the_listed_ones_are_not_read() {
        // 100 MB of rows in a file of 100 kB.
        let many =
            error(|folder| rows(folder, |text| text + &"2,2,1,-1,completed,,,1,0.5\n".repeat(4_000_000)));
        assert!(many.contains("more simulations than the 3 that trials.csv lists"), "{many}");
        let long = error(|folder| rows(folder, |text| text + &"1".repeat(50_000_000)));
        assert!(long.contains("run.csv.gz"), "{long}");
    }

    #[test]
    fn contradictions_are_errors() {
        let nan = error(|folder| rows(folder, |text| text.replace("-1,completed", "NaN,completed")));
        assert!(nan.contains("line 4 is no simulation"), "{nan}");
        let budget = error(|folder| replace(&folder.join("c/trials.csv"), "spent,2", "spent,3"));
        assert!(budget.contains("trial 1 has 3 simulations, its budget is 2"), "{budget}");
        let trial = error(|folder| replace(&folder.join("c/trials.csv"), "run,2,", "run,1,"));
        assert!(trial.contains("lists trial 1 twice"), "{trial}");
        let mut twice = results();
        let run = twice.campaigns[0].runs[0].clone();
        twice.campaigns[0].runs.push(run);
        let twice = error(|folder| twice.write(folder).unwrap());
        assert!(twice.contains("the manifest lists the run `run` twice"), "{twice}");
        let outside =
            error(|folder| replace(&folder.join(MANIFEST), "\"name\": \"run\"", "\"name\": \"../run\""));
        assert!(outside.contains("not in the folder"), "{outside}");
    }
}
