//! The requirements of a file, checked on a target with one or several controllers: random
//! scenarios for all of them together, and a search for each one that they do not violate.

mod cell;
mod folder;

use std::fs;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use mishandle_requirements::{RequirementFile, WrittenRequirement};
use mishandle_results as results;
use mishandle_results::{Check, CheckRun, CheckedController, CheckedRequirement, Severity};
use mishandle_rollout::Target;
use mishandle_store::{RunFile, RunKind};
use mishandle_text::path_text;

use crate::error::MishandleError;
use crate::inspect::requirements;
use crate::plan::{EvaluatePlan, FalsifyPlan, Plan};
use crate::resolve::{ResolvedPlan, missing_signals, target};
use crate::run::{Engine, Progress, ask, continue_run};

use cell::Row;
use folder::{COUNTEREXAMPLES, labels, run_file};

pub use folder::{RESULT, file_digest, finished};

/// A controller whose target is checked: target, controller, space and seed of the plan count.
#[derive(Clone, Debug)]
pub struct CheckSubject {
    /// The plan, without a question.
    pub plan: Plan,
    /// The target, if this program cannot look it up.
    pub target: Option<Target>,
}

/// Requirements and the effort of their check.
#[derive(Clone, Debug)]
pub struct CheckSettings<'a> {
    /// The requirements.
    pub file: &'a RequirementFile,
    /// Path of the file.
    pub path: &'a Path,
    /// SHA-256 of the file.
    pub digest: &'a str,
    /// Number of random scenarios; `None`: that of the requirement, or 100.
    pub episodes: Option<u64>,
    /// Number of searches for each requirement; `None`: that of the requirement, or 1.
    pub trials: Option<u32>,
    /// Largest number of simulations of a search; `None`: that of the requirement, or 300.
    pub budget: Option<u32>,
    /// Name of the search.
    pub search: &'a str,
    /// Batch size.
    pub batch: u32,
    /// Least severity of a violation that fails.
    pub fail_on: Severity,
    /// Whether requirements are accepted whose signals the target lacks.
    pub allow_inapplicable: bool,
}

/// Progress of a check.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CheckProgress {
    /// The run: controller, and what it does.
    pub phase: String,
    /// Number of its finished simulations.
    pub done: u64,
    /// Number of all its simulations.
    pub all: u64,
}

/// Gets the progress now and then, and can end the check, which a later call continues.
pub type Watch<'w> = &'w mut (dyn FnMut(&CheckProgress) -> ControlFlow<()> + Send);

/// Checks the requirements of a file for each controller. All runs, the counterexamples and the
/// result are in `folder`; a second call with the same arguments continues it. Returns `None` if it
/// was interrupted.
///
/// # Errors
/// If a name or a number is wrong, the folder has runs of another check, or a simulation cannot be
/// run or stored.
pub fn check(
    subjects: &[CheckSubject],
    settings: &CheckSettings<'_>,
    folder: &Path,
    watch: Watch<'_>,
) -> Result<Option<Check>, MishandleError> {
    let labels = labels(subjects);
    // Every mistake is found before the first simulation.
    let checkers: Result<Vec<Checker<'_>>, MishandleError> = subjects
        .iter()
        .zip(labels)
        .map(|(subject, label)| Checker::new(subject, label, settings, folder))
        .collect();
    let checkers = checkers?;
    let _lock = folder::open(folder)?;
    let mut columns = Vec::new();
    for checker in &checkers {
        match checker.run(watch)? {
            Some(column) => columns.push(column),
            None => return Ok(None),
        }
    }
    let found = result(&checkers, settings, folder, columns);
    folder::write_result(folder, &found)?;
    Ok(Some(found))
}

/// A requirement of the file for a target.
struct Asked<'a> {
    written: &'a WrittenRequirement,
    /// Its formula, with units.
    formula: String,
    space: String,
    missing: Vec<String>,
    /// The search for a counterexample; `None` if random scenarios decide alone.
    search: Option<ResolvedPlan>,
    /// The plan of a counterexample.
    alone: Option<ResolvedPlan>,
}

/// The check of one controller.
struct Checker<'a> {
    label: String,
    settings: &'a CheckSettings<'a>,
    folder: &'a Path,
    target: Target,
    plan: Plan,
    asked: Vec<Asked<'a>>,
    /// Random scenarios in each space.
    random: Vec<ResolvedPlan>,
}

/// The runs and the cells of one controller.
struct Column {
    runs: Vec<CheckRun>,
    cells: Vec<results::CheckCell>,
}

impl<'a> Checker<'a> {
    fn new(
        subject: &CheckSubject,
        label: String,
        settings: &'a CheckSettings<'a>,
        folder: &'a Path,
    ) -> Result<Checker<'a>, MishandleError> {
        let others = subject.plan.clone().only(RunKind::Evaluate);
        let plan = Plan { evaluate: None, harden: None, screening: None, ..others };
        let target = match &subject.target {
            Some(target) => target.clone(),
            None => target(&plan)?,
        };
        let first_space = target.spaces.first().map_or("", |space| space.name()).to_string();
        let default_space = if plan.space.is_empty() { first_space } else { plan.space.clone() };
        let mut asked = Vec::new();
        for written in &settings.file.requirements {
            let formula = written.timed_formula();
            asked.push(Asked {
                missing: missing_signals(&formula, &target).map_err(|error| of(written, error))?,
                space: written.check.space.clone().unwrap_or_else(|| default_space.clone()),
                written,
                formula,
                search: None,
                alone: None,
            });
        }
        let mut checker = Checker { label, settings, folder, target, plan, asked, random: Vec::new() };
        checker.resolve()?;
        Ok(checker)
    }

    /// Looks up and checks the plans of all runs.
    fn resolve(&mut self) -> Result<(), MishandleError> {
        // The plans of one requirement are the first ones, so that an error names it.
        let mut plans = Vec::new();
        for asked in &self.asked {
            plans.push(match asked.missing.is_empty() {
                true => Some(self.alone(asked).map_err(|error| of(asked.written, error))?),
                false => None,
            });
        }
        for (asked, alone) in self.asked.iter_mut().zip(plans) {
            asked.alone = alone;
        }
        let mut spaces: Vec<&str> = Vec::new();
        for asked in self.applicable() {
            if !spaces.contains(&asked.space.as_str()) {
                spaces.push(&asked.space);
            }
        }
        let mut random = Vec::new();
        for space in spaces {
            let asked = self.applicable().filter(|asked| asked.space == space);
            // The simulations are shared, so that all requirements have the most of them.
            let episodes = asked.map(|asked| self.episodes(asked)).max().unwrap_or_default();
            random.push(self.resolved(&self.random_plan(episodes, self.in_space(space)))?);
        }
        let mut searches = Vec::new();
        for asked in &self.asked {
            let has_search = asked.missing.is_empty() && asked.written.check.max_failure_rate.is_none();
            let plan = has_search.then(|| self.search_plan(asked));
            searches.push(plan.map(|plan| self.resolved(&plan)).transpose()?);
        }
        for (asked, search) in self.asked.iter_mut().zip(searches) {
            asked.search = search;
        }
        self.random = random;
        Ok(())
    }

    /// Returns the number of random scenarios of a requirement.
    fn episodes(&self, asked: &Asked<'_>) -> u64 {
        let own = self.settings.episodes.or(asked.written.check.episodes);
        own.unwrap_or(EvaluatePlan::default().episodes)
    }

    /// Returns the plan of random scenarios.
    fn random_plan(&self, episodes: u64, plan: Plan) -> Plan {
        let evaluate = EvaluatePlan {
            episodes,
            // Corners are not a random sample, so no rate counts them.
            corners: false,
            batch: self.settings.batch,
            ..EvaluatePlan::default()
        };
        Plan { evaluate: Some(evaluate), ..plan }
    }

    /// Returns the plan of a counterexample of a requirement, which has no other one.
    fn alone(&self, asked: &Asked<'_>) -> Result<ResolvedPlan, MishandleError> {
        let plan = Plan { requirements: Default::default(), ..self.search_plan(asked) };
        self.resolved(&self.random_plan(self.episodes(asked), Plan { falsify: None, ..plan.clone() }))?;
        self.resolved(&plan)
    }

    /// Returns the plan of the search for a counterexample of a requirement.
    fn search_plan(&self, asked: &Asked<'_>) -> Plan {
        let (check, settings) = (&asked.written.check, self.settings);
        let falsify = FalsifyPlan {
            formula: Some(asked.formula.clone()),
            search: settings.search.to_string(),
            trials: settings.trials.or(check.trials).unwrap_or(1),
            budget: settings.budget.or(check.budget).unwrap_or(FalsifyPlan::default().budget),
            batch: settings.batch,
            ..FalsifyPlan::default()
        };
        Plan { falsify: Some(falsify), ..self.in_space(&asked.space) }
    }

    fn applicable(&self) -> impl Iterator<Item = &Asked<'a>> {
        self.asked.iter().filter(|asked| asked.missing.is_empty())
    }

    /// Returns the plan with all requirements of a space, which share their simulations.
    fn in_space(&self, space: &str) -> Plan {
        let named = self.applicable().filter(|asked| asked.space == space);
        let requirements = named.map(|asked| (asked.written.name.clone(), asked.formula.clone()));
        Plan { space: space.to_string(), requirements: requirements.collect(), ..self.plan.clone() }
    }

    fn resolved(&self, plan: &Plan) -> Result<ResolvedPlan, MishandleError> {
        ResolvedPlan::with_target(plan, self.target.clone())
    }

    /// Runs what is missing. Returns `None` if it was interrupted.
    fn run(&self, watch: Watch<'_>) -> Result<Option<Column>, MishandleError> {
        let mut rows: Vec<Row> = self.asked.iter().map(|_| Row::default()).collect();
        let mut runs = Vec::new();
        for resolved in &self.random {
            let path = run_file(self.folder, &self.label, "random", &resolved.plan.space);
            let Some(run) = self.ask(resolved, &path, "random scenarios", watch)? else { return Ok(None) };
            self.add(&mut rows, &resolved.plan.space, &run, true)?;
            runs.push(check_run(&run, "random", None)?);
        }
        for (index, asked) in self.asked.iter().enumerate() {
            let Some(resolved) = &asked.search else { continue };
            // A violation is known already, also from the search for another one.
            if rows[index].violated > 0 {
                continue;
            }
            let name = &asked.written.name;
            let path = run_file(self.folder, &self.label, "search", name);
            let Some(run) = self.ask(resolved, &path, &format!("search for {name}"), watch)? else {
                return Ok(None);
            };
            self.add(&mut rows, &asked.space, &run, false)?;
            runs.push(check_run(&run, "search", Some(name.clone()))?);
        }
        let cells: Result<Vec<_>, MishandleError> =
            self.asked.iter().zip(&rows).map(|(asked, row)| self.cell(asked, row)).collect();
        Ok(Some(Column { runs, cells: cells? }))
    }

    /// Adds what a run says about the requirements of its space.
    fn add(
        &self,
        rows: &mut [Row],
        space: &str,
        run: &RunFile,
        is_random: bool,
    ) -> Result<(), MishandleError> {
        let all = run.counts()?.simulations;
        let found = requirements(run)?.unwrap_or_default();
        for (asked, row) in self.asked.iter().zip(rows) {
            let own = found.iter().find(|found| found.name == asked.written.name);
            if let Some(found) = own.filter(|_| asked.space == space) {
                row.add(found, all, run, is_random);
            }
        }
        Ok(())
    }

    /// Asks the question of a plan, or continues its run. Returns `None` if it was interrupted.
    fn ask(
        &self,
        resolved: &ResolvedPlan,
        path: &Path,
        what: &str,
        watch: Watch<'_>,
    ) -> Result<Option<RunFile>, MishandleError> {
        let run = continue_run(resolved, path)?;
        let phase = format!("{}: {what}", self.label);
        let mut watch = |progress: &Progress| {
            let Progress { simulations: done, max_simulations: all, .. } = *progress;
            watch(&CheckProgress { phase: phase.clone(), done, all })
        };
        let answer = ask(resolved, run, Engine::Direct, &mut watch)?;
        match answer.is_complete() {
            true => Ok(Some(RunFile::open_unchecked(path)?)),
            false => Ok(None),
        }
    }
}

/// Names the requirement of an error.
fn of(written: &WrittenRequirement, source: MishandleError) -> MishandleError {
    MishandleError::OfRequirement { name: written.name.clone(), source: Box::new(source) }
}

/// Describes a run.
fn check_run(run: &RunFile, kind: &str, requirement: Option<String>) -> Result<CheckRun, MishandleError> {
    Ok(CheckRun {
        run: path_text(run.path()),
        kind: kind.to_string(),
        space: run.header().space.clone(),
        requirement,
        simulations: run.counts()?.simulations,
        digest: format!("{:032x}", run.content_digest()?),
    })
}

/// Returns the result of all controllers.
fn result(
    checkers: &[Checker<'_>],
    settings: &CheckSettings<'_>,
    folder: &Path,
    columns: Vec<Column>,
) -> Check {
    let first = checkers.first();
    let requirement = |asked: &Asked<'_>| CheckedRequirement {
        name: asked.written.name.clone(),
        text: asked.written.text.clone(),
        formula: asked.formula.clone(),
        severity: asked.written.severity,
        clauses: asked.written.clauses.clone(),
        source: asked.written.source.clone(),
        space: asked.space.clone(),
        max_failure_rate: asked.written.check.max_failure_rate,
    };
    let (mut controllers, mut by_controller) = (Vec::new(), Vec::new());
    for (checker, column) in checkers.iter().zip(columns) {
        let hash = checker.target.components.iter().find(|component| component.role == "controller");
        controllers.push(CheckedController {
            name: checker.plan.controller.clone(),
            hash: hash.map(|component| component.hash.clone()),
            target_hash: checker.target.identity.hash.clone(),
            runs: column.runs,
        });
        by_controller.push(column.cells.into_iter());
    }
    let count = settings.file.requirements.len();
    let cells =
        (0..count).flat_map(|_| by_controller.iter_mut().filter_map(Iterator::next).collect::<Vec<_>>());
    let cells = cells.collect();
    Check {
        folder: path_text(folder),
        requirements_file: path_text(settings.path),
        requirements_digest: settings.digest.to_string(),
        title: settings.file.title.clone(),
        notice: settings.file.notice.clone(),
        target: first.map_or(String::new(), |first| first.target.identity.name.clone()),
        target_kind: first.map_or(String::new(), |first| first.target.identity.kind.clone()),
        fail_on: settings.fail_on,
        allows_inapplicable: settings.allow_inapplicable,
        seed: results::Seed(first.map_or(0, |first| first.plan.seed)),
        search: settings.search.to_string(),
        program: crate::build::VERSION_AND_COMMIT.to_string(),
        requirements: first.map_or(Vec::new(), |first| first.asked.iter().map(requirement).collect()),
        controllers,
        cells,
    }
}

/// Creates a folder with those above it.
fn create_folder(path: &Path) -> Result<(), MishandleError> {
    fs::create_dir_all(path).map_err(|source| MishandleError::Write {
        what: "folder",
        path: path.to_path_buf(),
        source,
    })
}

/// Returns the path of the counterexample of a requirement.
fn counterexample_file(folder: &Path, label: &str, name: &str) -> PathBuf {
    folder.join(COUNTEREXAMPLES).join(format!("{name}@{label}.json"))
}
