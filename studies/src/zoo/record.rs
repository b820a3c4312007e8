//! The record of a controller: how it was trained and what was measured.
//!
//! The fields and their order are the format of `controllers/figures/TASK/CONTROLLER.json`: loading
//! and saving a record gives the same bytes.

use mishandle::plan::StartRegion;
use mishandle::results::{
    CornerPoint, Corners, Estimate, Evaluation, Falsification, Number, Seed, Subject, Trial, TrialEnd,
};
use serde::de::Error as _;
use serde::{Deserialize, Serialize};

use crate::zoo::folder::{ZooFolder, read, write};
use crate::zoo::{NOISE_LEVELS, TrainingSummary, ZooError};

/// One controller's record.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Record {
    /// Name of the task; the file's folder.
    #[serde(skip)]
    pub task: String,
    /// Name of the controller within its task: `ppo`, `expert`; the file's name.
    #[serde(skip)]
    pub controller: String,
    /// Commit of the program that measured.
    pub commit: String,
    /// Conditions of the measurement.
    pub conditions: Conditions,
    /// One evaluation per noise level, of starts from which the task can be done.
    pub evaluations: Vec<EvaluationRecord>,
    /// The same over the whole box, if that has more starts.
    pub whole_box: Option<Vec<EvaluationRecord>>,
    /// The falsification; `None` if there was none.
    pub falsification: Option<FalsificationRecord>,
    /// Commit of the program that falsified, if it differs from `commit`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub falsification_commit: Option<String>,
    /// How the controller was trained; `None` for an expert.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub training: Option<TrainingSummary>,
    /// SHA-256 of the controller's file; `None` for an expert.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file_hash: Option<String>,
}

/// Conditions of a measurement besides the controller. Under the same conditions it need not be
/// repeated.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Conditions {
    /// Hash of the task: physics, starts, observations, reward.
    pub task_hash: String,
    /// Success, strict success, safe condition, completion.
    pub formulas: [String; 4],
    /// Episodes per evaluation.
    pub episodes: u64,
    /// Random seed.
    pub seed: u64,
    /// Standard deviations of the action noise.
    pub noise: [f64; 2],
    /// Whether corners of the initial box were evaluated.
    pub corners: bool,
    /// Careful success.
    pub careful: String,
}

impl Conditions {
    /// Names of the formulas.
    const FORMULAS: [&str; 4] = ["success", "strict", "safe", "completion"];
}

/// Measurements of one controller.
#[derive(Clone, Debug, PartialEq)]
pub struct Measurement {
    /// Commit of the program that measured.
    pub commit: String,
    /// Conditions of the measurement.
    pub conditions: Conditions,
    /// One evaluation per noise level.
    pub evaluations: Vec<EvaluationRecord>,
    /// The same over the whole box, if that has more starts.
    pub whole_box: Option<Vec<EvaluationRecord>>,
    /// The falsification, if the plan has one.
    pub falsification: Option<FalsificationRecord>,
}

/// The controller and the settings of an evaluation or a falsification.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlanRecord {
    /// Name of the task.
    pub task: String,
    /// Task preset.
    pub preset: String,
    /// Name of the controller's file at the time of the measurement.
    pub controller: String,
    /// Hash of the policy.
    pub controller_hash: String,
    /// Whether actions were sampled.
    pub stochastic: bool,
    /// Standard deviation of the action noise.
    pub action_noise: f64,
    /// Standard deviation of the observation noise.
    pub observation_noise: f64,
    /// Random seed.
    pub seed: Seed,
}

impl From<&Subject> for PlanRecord {
    fn from(subject: &Subject) -> PlanRecord {
        PlanRecord {
            task: subject.task.clone(),
            preset: subject.preset.clone().unwrap_or_default(),
            controller: subject.controller.clone().unwrap_or_default(),
            controller_hash: subject.controller_hash.clone().unwrap_or_default(),
            stochastic: subject.stochastic,
            action_noise: subject.action_noise,
            observation_noise: subject.observation_noise,
            seed: subject.seed,
        }
    }
}

/// An evaluation, as `mishandle evaluate` reports it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EvaluationRecord {
    /// The controller and the settings.
    #[serde(flatten)]
    pub plan: PlanRecord,
    /// Part of the box that starts were drawn from.
    #[serde(rename = "box")]
    pub starts: StartRegion,
    /// Whether some starts of the box were left out.
    pub leaves_out_starts: bool,
    /// Number of simulations.
    pub simulations: u64,
    /// Simulations whose numbers stopped being finite.
    pub diverged: u64,
    /// Simulations that left success undecided.
    pub undecided: u64,
    /// Success rate.
    pub success_rate: Estimate,
    /// Strict success rate.
    pub strict_success_rate: Estimate,
    /// Careful success rate.
    pub careful_success_rate: Estimate,
    /// Dangerous behavior rate.
    pub dangerous_behavior_rate: Estimate,
    /// Fraction of simulations with any dangerous control step.
    pub dangerous_episode_rate: Estimate,
    /// Task completion time, control steps.
    pub task_completion_time: Estimate,
    /// Results at the corners and the center of the initial box.
    pub corners: CornersRecord,
}

impl From<&Evaluation> for EvaluationRecord {
    fn from(found: &Evaluation) -> EvaluationRecord {
        let report = &found.metrics;
        EvaluationRecord {
            plan: PlanRecord::from(&found.subject),
            starts: found.starts,
            leaves_out_starts: found.leaves_out_starts,
            simulations: report.simulations,
            diverged: report.diverged,
            undecided: report.undecided,
            success_rate: report.success_rate,
            strict_success_rate: report.strict_success_rate.unwrap_or_default(),
            careful_success_rate: report.careful_success_rate.unwrap_or_default(),
            dangerous_behavior_rate: report.dangerous_behavior_rate.unwrap_or_default(),
            dangerous_episode_rate: report.dangerous_episode_rate.unwrap_or_default(),
            task_completion_time: report.task_completion_time.unwrap_or_default(),
            corners: found.corners.as_ref().map(CornersRecord::from).unwrap_or_default(),
        }
    }
}

/// Results at the corners and the center of the initial box. Points that do not count are left out.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CornersRecord {
    /// Number of simulations per point.
    pub seeds: u32,
    /// Number of corners.
    pub n: u32,
    /// Number of corners at which all simulations succeed.
    pub succeeding: u32,
    /// Number of corners at which all simulations succeed strictly; `None` without a strict
    /// formula.
    pub strictly_succeeding: Option<u32>,
    /// Number of corners at which all simulations succeed carefully; `None` without a careful
    /// formula.
    pub carefully_succeeding: Option<u32>,
    /// Whether all simulations at the center succeed; `None` if the center does not count.
    pub center_succeeds: Option<bool>,
    /// Whether all simulations at the center succeed strictly.
    pub center_strictly_succeeds: Option<bool>,
    /// Whether all simulations at the center succeed carefully.
    pub center_carefully_succeeds: Option<bool>,
    /// The points at which a simulation fails or does not succeed strictly.
    pub failing: Vec<FailingPoint>,
}

/// A point of the initial box at which a simulation fails or does not succeed strictly.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FailingPoint {
    /// Values of the scenario's axes, in the task's units.
    pub values: Vec<Option<f64>>,
    /// Number of simulations with success.
    pub successes: u32,
    /// Number of simulations with strict success; `None` without a strict formula.
    pub strict_successes: Option<u32>,
}

impl CornersRecord {
    /// Returns whether all simulations at the corners and the center succeed.
    pub fn all_succeed(&self) -> bool {
        self.succeeding == self.n && self.center_succeeds != Some(false)
    }
}

impl From<&Corners> for CornersRecord {
    fn from(found: &Corners) -> CornersRecord {
        // A record has no third answer: a point without a verdict does not succeed.
        let succeeds = |point: &CornerPoint| point.has_verdict() && point.successes == point.started();
        let fails_strictly = |point: &CornerPoint| {
            point.has_verdict() && point.strict_successes.is_some_and(|strict| strict < point.started())
        };
        let fails = |point: &&CornerPoint| point.counts && (!succeeds(point) || fails_strictly(point));
        let failing = |point: &CornerPoint| FailingPoint {
            values: point.scenario.values().copied().collect(),
            successes: point.successes,
            strict_successes: point.strict_successes,
        };
        CornersRecord {
            seeds: found.seeds,
            n: found.n as u32,
            succeeding: found.succeeding as u32,
            strictly_succeeding: found.strictly_succeeding.map(|count| count as u32),
            carefully_succeeding: found.carefully_succeeding.map(|count| count as u32),
            center_succeeds: found.points.last().filter(|center| center.counts).map(succeeds),
            center_strictly_succeeds: found.center_strictly_succeeds,
            center_carefully_succeeds: found.center_carefully_succeeds,
            failing: found.points.iter().filter(fails).map(failing).collect(),
        }
    }
}

/// A falsification, as `mishandle falsify` reports it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FalsificationRecord {
    /// The controller and the settings.
    #[serde(flatten)]
    pub plan: PlanRecord,
    /// Name of the search.
    pub search: String,
    /// The formula to violate.
    pub formula: String,
    /// Simulations per trial.
    pub budget: u32,
    /// Trials that found a violation.
    pub falsified_trials: u32,
    /// Their share of the trials.
    pub falsification_rate: Estimate,
    /// Mean number of simulations over the falsified trials.
    pub mean_simulations: Option<f64>,
    /// Simulations after which half of the trials have found a violation.
    pub median_simulations: Option<u32>,
    /// Mean number of simulations to the first violation; trials without one count their budget.
    pub restricted_mean_simulations: Option<f64>,
    /// The trials.
    pub trials: Vec<TrialMeasurement>,
}

impl From<&Falsification> for FalsificationRecord {
    fn from(found: &Falsification) -> FalsificationRecord {
        FalsificationRecord {
            plan: PlanRecord::from(&found.subject),
            search: found.search.clone(),
            formula: found.formula.clone(),
            budget: found.budget,
            falsified_trials: found.falsified_trials,
            falsification_rate: found.falsification_rate,
            mean_simulations: found.mean_simulations,
            median_simulations: found.median_simulations,
            restricted_mean_simulations: found.restricted_mean_simulations,
            trials: found.trials.iter().map(TrialMeasurement::from).collect(),
        }
    }
}

/// One trial of a falsification. The simulation is the one with the least robustness.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrialMeasurement {
    /// Number of the trial, from 1.
    pub trial: u32,
    /// Whether it found a violation.
    pub falsified: bool,
    /// Number of simulations.
    pub simulations: u32,
    /// Least robustness; `None` if no simulation has one.
    pub minimum_robustness: Option<Number>,
    /// Values of the scenario's axes, in the task's units.
    pub initial_configuration: Option<Vec<Option<f64>>>,
    /// Number of the simulation within the trial, from 1.
    pub simulation: Option<u32>,
    /// Its seed.
    pub seed: Option<Seed>,
    /// `falsified`, `budget spent` or `search ended`.
    pub end: Option<TrialEnd>,
    /// Simulations whose numbers stopped being finite.
    pub diverged: u32,
    /// Simulations that were undecided.
    pub undecided: u32,
}

impl From<&Trial> for TrialMeasurement {
    fn from(found: &Trial) -> TrialMeasurement {
        TrialMeasurement {
            trial: found.trial,
            falsified: found.falsified,
            simulations: found.simulations,
            minimum_robustness: found.minimum_robustness,
            initial_configuration: found.initial_configuration.clone(),
            simulation: found.simulation,
            seed: found.seed,
            end: found.end,
            diverged: found.diverged,
            undecided: found.undecided,
        }
    }
}

impl Record {
    /// Returns the record of a trained controller.
    pub fn trained(
        task: &str,
        controller: &str,
        training: &TrainingSummary,
        file_hash: &str,
        measurement: Measurement,
    ) -> Record {
        Record {
            training: Some(training.clone()),
            file_hash: Some(file_hash.to_string()),
            ..Record::untrained(task, controller, measurement)
        }
    }

    /// Returns the record of a controller that was not trained: an expert.
    pub fn untrained(task: &str, controller: &str, measurement: Measurement) -> Record {
        let Measurement { commit, conditions, evaluations, whole_box, falsification } = measurement;
        Record {
            task: task.to_string(),
            controller: controller.to_string(),
            commit,
            conditions,
            evaluations,
            whole_box,
            falsification,
            falsification_commit: None,
            training: None,
            file_hash: None,
        }
    }

    /// Reads a record; `None` if the file does not exist.
    ///
    /// # Errors
    /// If the file cannot be read or is not a record.
    pub fn load(folder: &ZooFolder, task: &str, controller: &str) -> Result<Option<Record>, ZooError> {
        let path = folder.record(task, controller);
        if !path.is_file() {
            return Ok(None);
        }
        let record: Record = serde_json::from_slice(&read(&path)?)
            .and_then(|record: Record| record.check().map(|()| record))
            .map_err(|source| ZooError::Record { path: path.clone(), source })?;
        Ok(Some(Record { task: task.to_string(), controller: controller.to_string(), ..record }))
    }

    /// Checks that there is one evaluation per noise level, and that rates are between 0 and 1.
    fn check(&self) -> Result<(), serde_json::Error> {
        let error = |text: String| Err(serde_json::Error::custom(text));
        let found = self.evaluations.len();
        if found != NOISE_LEVELS.len() {
            return error(format!("expected {} evaluations, found {found}", NOISE_LEVELS.len()));
        }
        let rates =
            self.evaluations.iter().flat_map(|found| [&found.success_rate, &found.strict_success_rate]);
        match rates.filter_map(|rate| rate.value).find(|rate| !(0.0..=1.0).contains(rate)) {
            Some(rate) => error(format!("expected success rates from 0 to 1, found {rate}")),
            None => Ok(()),
        }
    }

    /// Writes the record.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn save(&self, folder: &ZooFolder) -> Result<(), ZooError> {
        let path = folder.record(&self.task, &self.controller);
        let text = serde_json::to_string_pretty(self);
        let text = text.map_err(|source| ZooError::Record { path: path.clone(), source })?;
        write(&path, (text + "\n").as_bytes())
    }

    /// Describes how the conditions of the measurement differ from these.
    pub(crate) fn differences(&self, conditions: &Conditions) -> Vec<String> {
        let own = &self.conditions;
        let mut changed: Vec<&str> =
            (Conditions::FORMULAS.into_iter().zip(&own.formulas).zip(&conditions.formulas))
                .filter(|((_, own), now)| own != now)
                .map(|((name, _), _)| name)
                .collect();
        let mut differences = Vec::new();
        if own.task_hash != conditions.task_hash {
            differences.push("task changed".to_string());
        }
        if own.careful != conditions.careful {
            changed.push("careful");
        }
        if !changed.is_empty() {
            differences.push(format!("formulas changed: {}", changed.join(", ")));
        }
        let sampled = |of: &Conditions| (of.episodes, of.seed, of.noise, of.corners);
        if sampled(own) != sampled(conditions) {
            differences.push("number of episodes, seed, noise or corners changed".to_string());
        }
        differences
    }

    /// Returns the evaluation at a noise level, counted from 0.
    pub fn evaluation(&self, noise: usize) -> Option<&EvaluationRecord> {
        self.evaluations.get(noise)
    }

    /// Returns the evaluation over the whole box at a noise level, if there is one.
    pub fn whole_box_evaluation(&self, noise: usize) -> Option<&EvaluationRecord> {
        self.whole_box.as_ref()?.get(noise)
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    #[test]
    fn every_record_in_the_repository_is_saved_with_the_bytes_that_were_loaded() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        let repository = ZooFolder::new(&root);
        let copy = tempfile::tempdir().unwrap();
        let copy = ZooFolder::new(copy.path());
        let mut count = 0;
        for task in std::fs::read_dir(root.join("controllers/figures")).unwrap().flatten() {
            let name = |path: &Path| path.file_stem().unwrap().to_str().unwrap().to_string();
            for file in std::fs::read_dir(task.path()).unwrap().flatten() {
                let task = name(&task.path());
                let controller = name(&file.path());
                let record = Record::load(&repository, &task, &controller).unwrap().unwrap();
                record.save(&copy).unwrap();
                let saved = std::fs::read(copy.record(&task, &controller)).unwrap();
                assert!(saved == std::fs::read(file.path()).unwrap(), "{task}/{controller} has other bytes");
                count += 1;
            }
        }
        assert!(count >= 40, "{count} records");
    }

    #[test]
    fn infinite_robustness_and_large_seeds_survive_json() {
        let text = r#"{"trial":1,"falsified":false,"simulations":2,"minimum_robustness":"-inf","initial_configuration":[0.5,null],"simulation":1,"seed":"18446744073709551615","end":null,"diverged":0,"undecided":0}"#;
        let trial: TrialMeasurement = serde_json::from_str(text).unwrap();
        assert_eq!(
            (trial.minimum_robustness, trial.seed),
            (Some(Number(f64::NEG_INFINITY)), Some(Seed(u64::MAX)))
        );
        assert_eq!(serde_json::to_string(&trial).unwrap(), text);
    }
}
