//! Measurements: evaluations with and without noise, and a falsification.

use std::path::Path;

use mishandle::plan::StartRegion;

use crate::zoo::folder::ZooFolder;
use crate::zoo::provenance::file_hash;
use crate::zoo::{
    BenchmarkTask, Conditions, ControllerUnderTest, Measurement, Record, Runner, Training, TrainingSummary,
    ZooError,
};

/// Episodes per evaluation.
pub const EVALUATION_EPISODES: u64 = 1000;

/// Tasks with fewer episodes per evaluation: a step of a cloth takes ten times as long.
pub const FEWER_EPISODES: [(&str, u64); 1] = [("cloth-placing", 300)];

/// Returns the number of episodes per evaluation of a task.
pub fn evaluation_episodes(task: &str) -> u64 {
    let fewer = FEWER_EPISODES.iter().find(|(name, _)| *name == task);
    fewer.map_or(EVALUATION_EPISODES, |(_, episodes)| *episodes)
}

/// Random seed of all measurements. No training run and no validation draws a start or noise from
/// it.
pub const EVALUATION_SEED: u64 = 1;

/// Trials of a falsification.
pub const CAMPAIGN_TRIALS: u32 = 10;

/// Standard deviations of the action noise: none, and the paper's. Falsifications use the second.
pub const NOISE_LEVELS: [f64; 2] = [0.0, 0.5];

impl Conditions {
    /// Returns the present conditions of measurements in a task with this hash.
    pub fn new(task: &BenchmarkTask, task_hash: &str) -> Conditions {
        Conditions {
            task_hash: task_hash.to_string(),
            formulas: task.formulas.clone(),
            episodes: evaluation_episodes(&task.name),
            seed: EVALUATION_SEED,
            noise: NOISE_LEVELS,
            corners: true,
            careful: task.careful.clone(),
        }
    }
}

/// Inputs of a measurement besides the controller.
#[derive(Clone, Copy)]
pub(crate) struct Bench<'a> {
    pub folder: &'a ZooFolder,
    pub runner: &'a dyn Runner,
    pub stop: &'a (dyn Fn() -> bool + Sync),
}

impl Bench<'_> {
    /// Measures the controller of a training run in this file.
    pub fn record(
        &self,
        task: &BenchmarkTask,
        training: &Training,
        summary: &TrainingSummary,
        file: &Path,
    ) -> Result<Record, ZooError> {
        let hash = file_hash(file)?;
        let subject = self.subject(training, file);
        let falsifies = training.is_falsified();
        let found = self.measure(task, &summary.task_hash, &subject, falsifies)?;
        Ok(Record::trained(&training.task, &training.algorithm, summary, &hash, found))
    }

    /// Measures the expert of a task.
    pub fn expert_record(&self, task: &BenchmarkTask) -> Result<Record, ZooError> {
        let subject = ControllerUnderTest {
            task: task.name.clone(),
            controller: "expert".to_string(),
            run: self.folder.work_file(&format!("{}-expert.measure.sqlite", task.name)),
        };
        let found = self.measure(task, &task.task_hash, &subject, false)?;
        Ok(Record::untrained(&task.name, "expert", found))
    }

    /// Adds a falsification to a record whose evaluations are up to date.
    pub fn falsified(&self, training: &Training, record: &Record) -> Result<Record, ZooError> {
        let subject = self.subject(training, &self.folder.controller(training));
        let found = self.runner.falsify(&subject, NOISE_LEVELS[1], self.stop)?;
        let commit = Some(self.runner.commit()).filter(|commit| *commit != record.commit);
        Ok(Record { falsification: Some(found), falsification_commit: commit, ..record.clone() })
    }

    fn subject(&self, training: &Training, file: &Path) -> ControllerUnderTest {
        ControllerUnderTest {
            task: training.task.clone(),
            controller: file.to_string_lossy().into_owned(),
            run: self.folder.work(training, ".measure.sqlite"),
        }
    }

    fn measure(
        &self,
        task: &BenchmarkTask,
        task_hash: &str,
        subject: &ControllerUnderTest,
        falsifies: bool,
    ) -> Result<Measurement, ZooError> {
        let evaluate = |starts| {
            let at = |noise| self.runner.evaluate(subject, starts, noise, self.stop);
            NOISE_LEVELS.into_iter().map(at).collect::<Result<Vec<_>, _>>()
        };
        let evaluations = evaluate(StartRegion::Reachable)?;
        let leaves_out_starts = evaluations.first().is_some_and(|evaluation| evaluation.leaves_out_starts);
        let whole_box = if leaves_out_starts { Some(evaluate(StartRegion::Whole)?) } else { None };
        let falsification =
            if falsifies { Some(self.runner.falsify(subject, NOISE_LEVELS[1], self.stop)?) } else { None };
        Ok(Measurement {
            commit: self.runner.commit(),
            conditions: Conditions::new(task, task_hash),
            evaluations,
            whole_box,
            falsification,
        })
    }
}
