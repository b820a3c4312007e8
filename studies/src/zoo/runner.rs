//! Runs trainings and measurements: in this process, or as a fake in tests.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use mishandle::build::build;
use mishandle::plan::{EvaluatePlan, FalsifyPlan, StartRegion, TrainPlan};
use mishandle::results::{Evaluation, Falsification};
use mishandle::run::{Engine, ask, create_run};
use mishandle::tasks::{Preset, TASKS, task_hash};
use mishandle::train::{TrainObserver, reward};
use mishandle::{MishandleError, Plan, ResolvedPlan};

use crate::zoo::folder::{create_parent, remove};
use crate::zoo::measure::{CAMPAIGN_TRIALS, EVALUATION_SEED, evaluation_episodes};
use crate::zoo::provenance::REWARD;
use crate::zoo::{EvaluationRecord, FalsificationRecord, ZooError};

/// Facts about a task of the benchmark.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BenchmarkTask {
    /// Name of the task.
    pub name: String,
    /// Success, strict success, safe condition, completion.
    pub formulas: [String; 4],
    /// Careful success.
    pub careful: String,
    /// Hash of physics, initial states, observations and reward.
    pub task_hash: String,
    /// Hash of the layout of observations and actions.
    pub layout_hash: String,
}

/// A controller to measure.
#[derive(Clone, Debug)]
pub struct ControllerUnderTest {
    /// Name of the task.
    pub task: String,
    /// Path of the controller's file, or `expert`.
    pub controller: String,
    /// Temporary run file.
    pub run: PathBuf,
}

/// Trains and measures controllers.
pub trait Runner: Sync {
    /// Returns the tasks of the benchmark, in their order.
    fn tasks(&self) -> &[BenchmarkTask];

    /// Returns the commit that this program was built from.
    fn commit(&self) -> String;

    /// Trains as planned, and returns whether the training run reached its end.
    ///
    /// # Errors
    /// If the training run fails, or one of its files cannot be written.
    fn train(&self, plan: &TrainPlan, observer: &mut dyn TrainObserver) -> Result<bool, ZooError>;

    /// Evaluates a controller; `stop` is asked after each batch.
    ///
    /// # Errors
    /// If the evaluation fails or was stopped.
    fn evaluate(
        &self,
        subject: &ControllerUnderTest,
        starts: StartRegion,
        action_noise: f64,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<EvaluationRecord, ZooError>;

    /// Falsifies a controller; `stop` is asked after each batch.
    ///
    /// # Errors
    /// If the falsification fails or was stopped.
    fn falsify(
        &self,
        subject: &ControllerUnderTest,
        action_noise: f64,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<FalsificationRecord, ZooError>;
}

/// Trains and measures in this process, on the threads of the current rayon pool.
#[derive(Clone, Debug)]
pub struct LocalRunner {
    tasks: Vec<BenchmarkTask>,
    /// Episodes per evaluation of a task.
    episodes: fn(&str) -> u64,
    trials: u32,
}

impl LocalRunner {
    /// Looks up the tasks and computes their hashes, which takes a few control steps of each.
    ///
    /// # Errors
    /// If a task cannot be built.
    pub fn new() -> Result<LocalRunner, ZooError> {
        let reward = reward(REWARD)?;
        let own = TASKS.iter().filter(|task| task.definition().variant_of.is_none());
        let tasks = own.map(|task| {
            let definition = task.definition();
            let formulas = definition.formulas(Preset::Paper);
            let careful = formulas.careful().unwrap_or_default();
            let formulas = [formulas.success, formulas.strict, formulas.safe, formulas.completion];
            Ok(BenchmarkTask {
                name: definition.name.to_string(),
                formulas: formulas.map(String::from),
                careful,
                task_hash: task_hash(*task, reward)?,
                layout_hash: definition.layout().hash(),
            })
        });
        Ok(LocalRunner {
            tasks: tasks.collect::<Result<_, ZooError>>()?,
            episodes: evaluation_episodes,
            trials: CAMPAIGN_TRIALS,
        })
    }

    fn plan(subject: &ControllerUnderTest, action_noise: f64) -> Plan {
        let plan = Plan::new(&subject.task, &subject.controller);
        Plan { action_noise, seed: EVALUATION_SEED, ..plan }
    }
}

/// Runs `work` with a path for its run file, and removes the file.
fn with_run_file<T>(path: &Path, work: impl FnOnce() -> Result<T, ZooError>) -> Result<T, ZooError> {
    remove(path)?;
    create_parent(path)?;
    let result = work();
    remove(path)?;
    result
}

fn flow(stop: &(dyn Fn() -> bool + Sync)) -> ControlFlow<()> {
    if stop() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
}

impl Runner for LocalRunner {
    fn tasks(&self) -> &[BenchmarkTask] {
        &self.tasks
    }

    fn commit(&self) -> String {
        build().git_commit
    }

    fn train(&self, plan: &TrainPlan, observer: &mut dyn TrainObserver) -> Result<bool, ZooError> {
        let report = mishandle::train::train(plan, None, observer)?;
        if !report.write_failures.is_empty() {
            let failures = report.write_failures.iter().map(ToString::to_string).collect();
            return Err(ZooError::Unwritten { failures });
        }
        Ok(report.is_finished())
    }

    fn evaluate(
        &self,
        subject: &ControllerUnderTest,
        starts: StartRegion,
        action_noise: f64,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<EvaluationRecord, ZooError> {
        let evaluate =
            EvaluatePlan { episodes: (self.episodes)(&subject.task), starts, ..EvaluatePlan::default() };
        let plan = Plan { evaluate: Some(evaluate), ..LocalRunner::plan(subject, action_noise) };
        let resolved = ResolvedPlan::new(&plan)?;
        with_run_file(&subject.run, || {
            let run = create_run(&resolved, Some(&subject.run))?;
            let answer = ask(&resolved, run, Engine::Direct, &mut |_| flow(stop))?;
            if answer.is_complete() {
                let found = Evaluation::try_from(answer).map_err(MishandleError::from)?;
                Ok(EvaluationRecord::from(&found))
            } else {
                Err(ZooError::Interrupted)
            }
        })
    }

    fn falsify(
        &self,
        subject: &ControllerUnderTest,
        action_noise: f64,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<FalsificationRecord, ZooError> {
        let falsify = FalsifyPlan { trials: self.trials, ..FalsifyPlan::default() };
        let plan = Plan { falsify: Some(falsify), ..LocalRunner::plan(subject, action_noise) };
        let resolved = ResolvedPlan::new(&plan)?;
        with_run_file(&subject.run, || {
            let run = create_run(&resolved, Some(&subject.run))?;
            let answer = ask(&resolved, run, Engine::Direct, &mut |_| flow(stop))?;
            if answer.is_complete() {
                let found = Falsification::try_from(answer).map_err(MishandleError::from)?;
                Ok(FalsificationRecord::from(&found))
            } else {
                Err(ZooError::Interrupted)
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn runner() -> LocalRunner {
        LocalRunner { episodes: |_| 3, trials: 1, ..LocalRunner::new().unwrap() }
    }

    fn subject(folder: &Path, controller: &str) -> ControllerUnderTest {
        let task = "ball-balancing".to_string();
        let controller = controller.to_string();
        ControllerUnderTest { task, controller, run: folder.join("new/run.sqlite") }
    }

    #[test]
    fn an_expert_is_evaluated_and_its_run_file_is_removed() {
        let folder = tempfile::tempdir().unwrap();
        let subject = subject(folder.path(), "expert");
        let found = runner().evaluate(&subject, StartRegion::Reachable, 0.0, &|| false).unwrap();
        assert_eq!((found.simulations, found.success_rate.value), (3, Some(1.0)));
        assert_eq!((found.plan.controller.as_str(), found.starts), ("expert", StartRegion::Reachable));
        assert!(!subject.run.exists());
    }

    #[test]
    fn a_stopped_measurement_is_an_error_and_leaves_no_run_file() {
        let folder = tempfile::tempdir().unwrap();
        let subject = subject(folder.path(), "ppo");
        let runner = runner();
        let evaluated = runner.evaluate(&subject, StartRegion::Whole, 0.0, &|| true);
        let falsified = runner.falsify(&subject, 0.5, &|| true);
        assert!(matches!(evaluated, Err(ZooError::Interrupted)));
        assert!(matches!(falsified, Err(ZooError::Interrupted)), "{falsified:?}");
        assert!(!subject.run.exists());
    }

    #[test]
    fn the_benchmark_has_eight_tasks_without_variants() {
        let runner = runner();
        let names: Vec<&str> = runner.tasks().iter().map(|task| task.name.as_str()).collect();
        assert_eq!((names.len(), names[0]), (8, "point-reaching"));
    }
}
