use std::path::Path;

use mishandle::MishandleError;
use mishandle::files::FileLock;
use mishandle::training::TrainingProgress;

use crate::zoo::folder::{ZooFolder, create_parent};
use crate::zoo::jobs::run_side_by_side;
use crate::zoo::measure::Bench;
use crate::zoo::plan_entry::{entry, expected};
use crate::zoo::{
    BenchmarkTask, Conditions, PlanEntry, Record, Runner, Selection, TrainingInputs, TrainingState, ZooError,
    curve_charts, import, plan, tables, train,
};

/// Receives the events of a [`Zoo`], from several threads.
pub trait ZooObserver: Sync {
    /// Called once, with the number of jobs and of jobs that run at a time.
    fn begins(&self, _jobs: usize, _workers: usize) {}

    /// Called when a job starts, with its reason.
    fn started(&self, _name: &str, _reason: &str) {}

    /// Called after each iteration of a training run.
    fn progress(&self, _name: &str, _progress: &TrainingProgress) {}

    /// Called when a training run cannot write a file; it tries again.
    fn warning(&self, _name: &str, _failure: &MishandleError) {}

    /// Called when an import skips or takes in a training run.
    fn note(&self, _name: &str, _words: &str) {}

    /// Called when a job ends, unless it was interrupted.
    fn ended(&self, _name: &str, _result: &Result<(), ZooError>) {}
}

/// The controllers of a repository, their training runs and measurements.
pub struct Zoo<'a> {
    folder: ZooFolder,
    runner: &'a dyn Runner,
    observer: &'a dyn ZooObserver,
    stop: &'a (dyn Fn() -> bool + Sync),
    selection: Selection,
    adopts: bool,
    workers: usize,
}

/// One thing to do.
enum Job<'a> {
    Train(&'a BenchmarkTask, &'a PlanEntry),
    Measure(&'a BenchmarkTask, &'a PlanEntry),
    Falsify(&'a PlanEntry, &'a Record),
    MeasureExpert(&'a BenchmarkTask),
}

impl Job<'_> {
    fn name(&self) -> String {
        match self {
            Job::Train(_, entry) | Job::Measure(_, entry) | Job::Falsify(entry, _) => entry.training.name(),
            Job::MeasureExpert(task) => format!("{}-expert", task.name),
        }
    }

    fn reason(&self) -> String {
        match self {
            Job::Measure(_, entry) if entry.state.is_measured() => "measured again".to_string(),
            Job::Train(_, entry) | Job::Measure(_, entry) | Job::Falsify(entry, _) => entry.state.to_string(),
            Job::MeasureExpert(_) => "needs measurement".to_string(),
        }
    }
}

impl<'a> Zoo<'a> {
    /// Returns the zoo of a repository. `stop` is asked often; once it returns true, work in
    /// progress is saved and ends.
    pub fn new(
        folder: ZooFolder,
        runner: &'a dyn Runner,
        observer: &'a dyn ZooObserver,
        stop: &'a (dyn Fn() -> bool + Sync),
    ) -> Zoo<'a> {
        let selection = Selection::default();
        Zoo { folder, runner, observer, stop, selection, adopts: false, workers: 1 }
    }

    /// Returns the zoo restricted to a part of the plan.
    pub fn with_selection(self, selection: Selection) -> Zoo<'a> {
        Zoo { selection, ..self }
    }

    /// Returns the zoo in which selected controllers that differ in their task alone count as
    /// trained on the present one.
    pub fn with_adoption(self, adopts: bool) -> Zoo<'a> {
        Zoo { adopts, ..self }
    }

    /// Returns the zoo with this many jobs at a time.
    pub fn with_workers(self, workers: usize) -> Zoo<'a> {
        Zoo { workers, ..self }
    }

    /// Returns the selected training runs with their states. Changes no file.
    ///
    /// # Errors
    /// If a file cannot be read, or the selection names nothing that exists.
    pub fn entries(&self) -> Result<Vec<PlanEntry>, ZooError> {
        let tasks = self.runner.tasks();
        self.selection.check(tasks.iter().map(|task| task.name.as_str()))?;
        let mut entries = self.all_entries()?;
        entries.retain(|entry| self.selection.includes(&entry.training));
        Ok(entries)
    }

    /// Returns the thresholds that a controller misses, as the tables show them: `SR 95`,
    /// `corners`. A training run without a record misses none.
    pub fn missed_thresholds(&self, entry: &PlanEntry) -> Vec<String> {
        entry
            .record
            .as_ref()
            .map(|record| tables::missed(record, &entry.training.algorithm))
            .unwrap_or_default()
    }

    /// Returns whether the repository keeps the learning curve of a training run.
    pub fn has_curve(&self, entry: &PlanEntry) -> bool {
        self.folder.curve(&entry.training).is_file()
    }

    fn all_entries(&self) -> Result<Vec<PlanEntry>, ZooError> {
        let tasks = self.runner.tasks();
        let names: Vec<String> = tasks.iter().map(|task| task.name.clone()).collect();
        let mut found = Vec::new();
        for training in plan(&names) {
            let Some(task) = tasks.iter().find(|task| task.name == training.task) else { continue };
            let is_selected = self.selection.includes(&training);
            let expected = match expected(&self.folder, task, &training) {
                // A settings file that is not selected must not keep others from being trained.
                Err(_) if !is_selected => TrainingInputs::without_settings(task),
                found => found?,
            };
            found.push(entry(&self.folder, task, &training, expected, self.adopts && is_selected)?);
        }
        Ok(found)
    }

    /// Trains and measures everything selected that is missing, then writes the
    /// pages.
    ///
    /// # Errors
    /// If a job failed or was interrupted, or a file cannot be read or written. The other jobs are
    /// done then.
    pub fn train(&self) -> Result<(), ZooError> {
        self.with_pages(|entries| self.work(entries, true, false))
    }

    /// Measures selected controllers and trains nothing, then writes the pages. Without `again`,
    /// only missing measurements are made.
    ///
    /// # Errors
    /// As [`train`](Self::train).
    pub fn measure(&self, again: bool) -> Result<(), ZooError> {
        self.with_pages(|entries| self.work(entries, false, again))
    }

    /// Takes in the selected training runs that ended elsewhere, as `NAME.safetensors` and
    /// `NAME.csv` in `source`, then writes the pages.
    ///
    /// # Errors
    /// If a training run is refused, or a file cannot be read or written.
    pub fn import(&self, source: &Path) -> Result<(), ZooError> {
        let tasks = self.runner.tasks();
        self.with_pages(|entries| import::import(&self.bench(), source, tasks, entries, self.observer))
    }

    /// Writes the tables and the charts from the records and the curves alone.
    ///
    /// # Errors
    /// If a file cannot be read or written.
    pub fn write_pages(&self) -> Result<(), ZooError> {
        self.with_pages(|_| Ok(()))
    }

    fn bench(&self) -> Bench<'_> {
        Bench { folder: &self.folder, runner: self.runner, stop: self.stop }
    }

    /// Does `work` on the selected entries while no other process does, then writes the pages,
    /// whatever `work` returned.
    fn with_pages(&self, work: impl FnOnce(&[PlanEntry]) -> Result<(), ZooError>) -> Result<(), ZooError> {
        let path = self.folder.work_file("lock");
        create_parent(&path)?;
        let lock = FileLock::try_acquire(&path).map_err(ZooError::file(&path))?;
        let _lock = lock.ok_or(ZooError::Busy)?;
        let entries = self.entries()?;
        let result = work(&entries);
        let entries = self.all_entries()?;
        for entry in entries.iter().filter(|entry| entry.record_is_stale) {
            entry.record.as_ref().map_or(Ok(()), |record| record.save(&self.folder))?;
        }
        let tasks = self.runner.tasks();
        let mut experts = Vec::new();
        for task in tasks {
            let record = Record::load(&self.folder, &task.name, "expert")?;
            let conditions = Conditions::new(task, &task.task_hash);
            experts.extend(record.filter(|record| record.conditions == conditions));
        }
        let drawn = curve_charts::write(&self.folder, tasks)?;
        let shown = tables::Shown { folder: &self.folder, tasks, entries: &entries, experts: &experts };
        tables::write(&shown, &drawn).and(result)
    }

    fn work(&self, entries: &[PlanEntry], trains: bool, again: bool) -> Result<(), ZooError> {
        let jobs = self.jobs(entries, trains, again)?;
        self.observer.begins(jobs.len(), self.workers.min(jobs.len()));
        let work = |job: &Job<'_>| {
            self.observer.started(&job.name(), &job.reason());
            self.run(job)
        };
        let ended = |job: &Job<'_>, result: &Result<(), ZooError>| {
            self.observer.ended(&job.name(), result);
        };
        let outcome = run_side_by_side(&jobs, self.workers, self.stop, work, ended)?;
        let total = jobs.len();
        match outcome {
            _ if outcome.done + outcome.failed < total => {
                Err(ZooError::InterruptedWith { done: outcome.done, total })
            }
            outcome if outcome.failed > 0 => Err(ZooError::Failed { failed: outcome.failed, total }),
            _ => Ok(()),
        }
    }

    fn jobs<'b>(
        &'b self,
        entries: &'b [PlanEntry],
        trains: bool,
        again: bool,
    ) -> Result<Vec<Job<'b>>, ZooError> {
        let mut jobs = Vec::new();
        let experts = self.runner.tasks().iter();
        for task in experts.filter(|task| self.selection.includes_expert(&task.name)) {
            let record = Record::load(&self.folder, &task.name, "expert")?;
            let is_done =
                record.is_some_and(|record| record.conditions == Conditions::new(task, &task.task_hash));
            if again || !is_done {
                jobs.push(Job::MeasureExpert(task));
            }
        }
        let mut in_order: Vec<&PlanEntry> = entries.iter().collect();
        // Long and unknown ones first, so that no long one runs alone at the end.
        in_order.sort_by(|a, b| b.wall_clock_secs().total_cmp(&a.wall_clock_secs()));
        for entry in in_order {
            let mut tasks = self.runner.tasks().iter();
            let Some(task) = tasks.find(|task| task.name == entry.training.task) else { continue };
            let has_controller = || self.folder.controller(&entry.training).is_file();
            match (&entry.state, &entry.record) {
                (TrainingState::NeedsMeasurement { .. }, _) => jobs.push(Job::Measure(task, entry)),
                (TrainingState::NeedsFalsification, Some(record)) if !again => {
                    jobs.push(Job::Falsify(entry, record));
                }
                (TrainingState::Done | TrainingState::NeedsFalsification, _) if again && has_controller() => {
                    jobs.push(Job::Measure(task, entry));
                }
                (TrainingState::NeedsTraining { .. } | TrainingState::Interrupted { .. }, _) if trains => {
                    jobs.push(Job::Train(task, entry));
                }
                _ => {}
            }
        }
        Ok(jobs)
    }

    fn run(&self, job: &Job<'_>) -> Result<(), ZooError> {
        let bench = self.bench();
        match job {
            Job::Train(task, entry) => train::train(&bench, task, entry, self.observer),
            Job::Measure(task, entry) => import::measure_again(&bench, task, entry),
            Job::Falsify(entry, record) => bench.falsified(&entry.training, record)?.save(&self.folder),
            Job::MeasureExpert(task) => bench.expert_record(task)?.save(&self.folder),
        }
    }
}
