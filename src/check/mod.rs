//! The requirements of a file, checked on a target with one or several controllers: random
//! scenarios for all of them together, and a search for each one that they do not violate.

mod cell;
mod checker;
mod column;
mod folder;
mod row;
mod verify;
mod violation;

use std::collections::BTreeSet;
use std::ops::ControlFlow;
use std::path::Path;

use checker::{Asked, Checker};
use column::Column;
use folder::labels;
use mishandle_requirements::RequirementFile;
use mishandle_results as results;
use mishandle_results::{
    Check, CheckRunKind, CheckedController, CheckedRequirement, EndCounts, WithoutVerdict, Words,
};
use mishandle_rollout::Target;
use mishandle_text::path_text;

use crate::error::MishandleError;
use crate::plan::{CheckSettings, Plan};

pub use folder::{COUNTEREXAMPLES, REQUIREMENTS, RESULT, file_digest, moved, to_json};
pub use verify::{CheckDifferences, differences, verified};
pub use violation::replay;

/// A controller whose target is checked: target, controller, space and seed of the plan count.
#[derive(Clone, Debug)]
pub struct CheckSubject {
    /// The plan, without a question.
    pub plan: Plan,
    /// The target, if this program cannot look it up.
    pub target: Option<Target>,
}

/// A file of requirements.
#[derive(Clone, Copy, Debug)]
pub struct Requirements<'a> {
    /// The requirements.
    pub file: &'a RequirementFile,
    /// Path of the file.
    pub path: &'a Path,
    /// Text of the file.
    pub text: &'a str,
    /// How the result names the commands that replay counterexamples.
    pub words: Words,
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
    /// Largest number of simulations of all runs: in the first call alone, before any of them.
    pub largest: Option<CheckCost>,
}

/// The largest numbers of simulations of a check, without the probes before each run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CheckCost {
    /// Random scenarios, which the requirements in a space share.
    pub random: u64,
    /// Simulations of the searches for violations of the requirements that no random scenario
    /// violates.
    pub searched: u64,
    /// Further ones for each violation, which is simulated again, with other solvers of the
    /// physics.
    pub of_violation: u64,
}

impl CheckCost {
    /// Returns the largest number of simulations of all runs.
    pub fn simulations(self) -> u64 {
        self.random + self.searched
    }

    fn add(&mut self, other: CheckCost) {
        self.random += other.random;
        self.searched += other.searched;
        self.of_violation = self.of_violation.max(other.of_violation);
    }
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
    requirements: &Requirements<'_>,
    settings: &CheckSettings,
    folder: &Path,
    watch: Watch<'_>,
) -> Result<Option<Check>, MishandleError> {
    let labels = labels(subjects);
    // Every mistake is found before the first simulation.
    let checkers: Result<Vec<Checker<'_>>, MishandleError> = subjects
        .iter()
        .zip(labels)
        .map(|(subject, label)| Checker::new(subject, label, requirements, settings, folder))
        .collect();
    let checkers = checkers?;
    let _lock = folder::open(folder, requirements.text)?;
    let mut columns = Vec::new();
    let mut largest = CheckCost::default();
    for checker in &checkers {
        largest.add(checker.cost()?);
    }
    let start = CheckProgress { phase: String::new(), done: 0, all: 0, largest: Some(largest) };
    if watch(&start).is_break() {
        return Ok(None);
    }
    for checker in &checkers {
        match checker.run(watch)? {
            Some(column) => columns.push(column),
            None => return Ok(None),
        }
    }
    let found = result(&checkers, requirements, settings, folder, columns);
    folder::write_result(folder, &found, requirements.text)?;
    Ok(Some(found))
}

/// Returns the result of all controllers.
fn result(
    checkers: &[Checker<'_>],
    requirements: &Requirements<'_>,
    settings: &CheckSettings,
    folder: &Path,
    columns: Vec<Column>,
) -> Check {
    let first = checkers.first();
    let named = |formula: &str| {
        let mut known = first.iter().flat_map(|first| &first.target.formulas);
        known.find(|known| known.name == formula).map(|known| known.text.clone())
    };
    // A requirement that no target can have is in no space, unless the file names one.
    let is_run = |asked: &Asked<'_>| {
        let name = &asked.written.name;
        let mut same = checkers.iter().flat_map(|checker| &checker.asked);
        asked.written.check.space.is_some()
            || same.any(|other| other.written.name == *name && other.missing.is_empty())
    };
    let requirement = |asked: &Asked<'_>| CheckedRequirement {
        name: asked.written.name.clone(),
        text: asked.written.text.clone(),
        formula: asked.formula.clone(),
        named_formula: named(&asked.formula),
        severity: asked.written.severity,
        clauses: asked.written.clauses.clone(),
        source: asked.written.source.clone(),
        space: if is_run(asked) { asked.space.clone() } else { String::new() },
        max_failure_rate: asked.written.check.max_failure_rate,
    };
    let mut controllers = Vec::new();
    let mut by_controller = Vec::new();
    let mut ends = EndCounts::default();
    let mut programs = BTreeSet::new();
    for (checker, column) in checkers.iter().zip(columns) {
        let hash = checker.target.components.iter().find(|component| component.role == "controller");
        controllers.push(CheckedController {
            name: checker.plan.controller.clone(),
            hash: hash.map(|component| component.hash.clone()),
            target_hash: checker.target.identity.hash.clone(),
            runs: column.runs,
        });
        ends.add_all(column.ends);
        by_controller.push(column.cells.into_iter());
        programs.extend(column.programs);
    }
    let count = requirements.file.requirements.len();
    let cells =
        (0..count).flat_map(|_| by_controller.iter_mut().filter_map(Iterator::next).collect::<Vec<_>>());
    let cells = cells.collect();
    let mut runs = controllers.iter().flat_map(|controller| &controller.runs);
    let has_searched = runs.any(|run| run.kind == CheckRunKind::Search);
    Check {
        folder: path_text(folder),
        requirements_file: path_text(requirements.path),
        requirements_digest: file_digest(requirements.text),
        title: requirements.file.title.clone(),
        notice: requirements.file.notice.clone(),
        target: first.map_or(String::new(), |first| first.target.identity.name.clone()),
        target_kind: first.map_or(String::new(), |first| first.target.identity.kind.clone()),
        fail_on: settings.fail_on,
        allows_inapplicable: settings.allow_inapplicable,
        seed: results::Seed(first.map_or(0, |first| first.plan.seed)),
        search: if has_searched { settings.search.clone() } else { String::new() },
        without_verdict: WithoutVerdict::new(
            ends,
            first.map_or(Plan::MAX_WITHOUT_VERDICT, |first| first.plan.max_without_verdict),
        ),
        program: if programs.is_empty() {
            crate::build::VERSION_AND_COMMIT.to_string()
        } else {
            Vec::from_iter(programs).join(", ")
        },
        requirements: first.map_or(Vec::new(), |first| first.asked.iter().map(requirement).collect()),
        controllers,
        cells,
    }
}
