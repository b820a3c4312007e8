//! Compares the result of a check with its runs, its file of requirements and its counterexamples:
//! each of its statements follows from them.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use mishandle_files::{limits, read_text_bounded};
use mishandle_requirements::{RequirementFile, WrittenRequirement};
use mishandle_results::{
    Check, CheckCell, CheckRun, CheckRunKind, CheckedController, CheckedRequirement, EndCounts,
    WithoutVerdict, Words,
};
use mishandle_stl::Formula;
use mishandle_store::{RunFile, RunKind};

use super::cell::NOT_REPRODUCED;
use super::column::program;
use super::folder::{REQUIREMENTS, RESULT, file_digest, finished, is_path_of};
use super::row::{self, Row, StatedEpisodes};
use super::violation::{self, normal};
use crate::error::{MishandleError, problem};
use crate::plan::Plan;
use crate::run::rows::REQUIREMENT;

/// The problems of the result of a check.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CheckDifferences {
    /// Statements that differ from what the files of the check say.
    pub problems: Vec<String>,
    /// Statements that no file of the check shows.
    pub unverified: Vec<String>,
}

/// Returns the result of the check in a folder, which follows from the requirements and the runs
/// there; `None` if the folder has no result. Nothing is simulated.
///
/// # Errors
/// If a file cannot be read, or the result does not follow from the others.
pub fn verified(folder: &Path, words: Words) -> Result<Option<Check>, MishandleError> {
    let Some(mut found) = finished(folder)? else { return Ok(None) };
    let path = folder.join(REQUIREMENTS);
    let text = read_text_bounded(&path, limits::PLAN);
    let text = text.map_err(|source| MishandleError::File { path, source })?;
    let mut runs = BTreeMap::new();
    for run in found.controllers.iter().flat_map(|controller| &controller.runs) {
        if Path::new(&run.run).exists() {
            runs.insert(run.run.clone(), RunFile::open_unchecked(Path::new(&run.run))?);
        }
    }
    let CheckDifferences { problems, .. } =
        differences(&found, &text, |name| runs.get(name), |file| Path::new(file).to_path_buf())?;
    if !problems.is_empty() {
        return Err(problem(format!(
            "{} does not follow from the runs of the check: {}",
            folder.join(RESULT).display(),
            problems.join("; ")
        )));
    }
    // The recorded commands are text of a file that anybody can change.
    violation::name_replays(&mut found, &|name| runs.get(name), words)?;
    Ok(Some(found))
}

/// Compares the result of a check with the text of its requirements, its runs and its
/// counterexamples: `run` returns the file of a run, `place` the path of a counterexample. Nothing
/// is simulated. The caller names the commands of replays, the folder and the file of the
/// requirements.
///
/// # Errors
/// If a run cannot be read.
pub fn differences<'r>(
    found: &Check,
    requirements: &str,
    run: impl Fn(&str) -> Option<&'r RunFile>,
    place: impl Fn(&str) -> PathBuf,
) -> Result<CheckDifferences, MishandleError> {
    let mut all = CheckDifferences::default();
    let file = RequirementFile::from_toml(requirements).ok();
    let file =
        file.filter(|file| file_digest(requirements) == found.requirements_digest && is_about(found, file));
    if file.is_none() {
        all.problems.push("it is about other requirements than its file".to_string());
    }
    let written = file.map_or(Vec::new(), |file| file.requirements);
    let mut programs = BTreeSet::new();
    let mut searched = "";
    let (mut ends, mut max_share) = (EndCounts::default(), Plan::MAX_WITHOUT_VERDICT);
    for (index, controller) in found.controllers.iter().enumerate() {
        let mut files = Vec::new();
        for named in &controller.runs {
            match run(&named.run) {
                Some(file) => files.push((named, file, Plan::from_toml(&file.header().plan)?)),
                None => all.problems.push(format!("{}: the run is missing", named.run)),
            }
        }
        for (named, file, plan) in &files {
            let facts = facts(found, controller, named, file, plan)?;
            all.problems.extend(facts.into_iter().map(|fact| format!("{}: another {fact}", named.run)));
            programs.insert(program(&file.header().build));
            max_share = plan.max_without_verdict;
            if named.kind == CheckRunKind::Search {
                searched = &found.search;
            }
        }
        let is_run = |requirement: &CheckedRequirement| {
            files.iter().any(|(_, _, plan)| plan.requirements.contains_key(&requirement.name))
        };
        let (rows, of_runs) = rows(found, &written, &files, is_run, &mut all.problems)?;
        ends.add_all(of_runs);
        if files.is_empty() {
            let name = &controller.name;
            all.unverified
                .push(format!("no run shows what the target with the controller `{name}` is and lacks"));
        }
        for (number, (requirement, row)) in found.requirements.iter().zip(&rows).enumerate() {
            let name = &requirement.name;
            let Some(cell) = found.cells.get(number * found.controllers.len() + index) else {
                all.problems.push(format!("{name}: it has no verdict"));
                continue;
            };
            if !is_missing(cell, requirement, is_run(requirement), &files) {
                all.problems.push(format!("{name}: its target lacks other signals"));
            }
            let mut again = row.cell(&controller.name, &cell.missing_signals, requirement.max_failure_rate);
            if cell.counterexample.as_ref().is_some_and(|violation| violation.file.is_none()) {
                again.evidence += NOT_REPRODUCED;
                all.unverified.push(format!("{name}: its counterexample was not reproduced"));
            }
            if !is_same(cell, row, &again) {
                let CheckCell { verdict, evidence, .. } = again;
                all.problems.push(format!("{name}: the runs give another result: {verdict}, {evidence}"));
            }
            if let Some(violation) = &cell.counterexample {
                let problem = violation::problem(requirement, violation, row, &run, &place);
                all.problems.extend(problem.map(|problem| format!("{name}: {problem}")));
            }
        }
    }
    if found.cells.len() != found.requirements.len() * found.controllers.len() {
        all.problems.push("the matrix has another number of verdicts".to_string());
    }
    let programs = Vec::from_iter(programs).join(", ");
    if found.search != searched || (!programs.is_empty() && found.program != programs) {
        all.problems.push("it names another search or program than its runs".to_string());
    }
    if found.without_verdict != WithoutVerdict::new(ends, max_share) {
        all.problems.push("its runs have other numbers of simulations without a verdict".to_string());
    }
    Ok(all)
}

/// A run of a result with its file and its plan.
type Named<'f, 'r> = (&'f CheckRun, &'r RunFile, Plan);

/// Returns what the runs of a controller say about each requirement, and how their simulations
/// ended. They must be the runs that a check makes, in its order: none can be left out.
fn rows(
    found: &Check,
    written: &[WrittenRequirement],
    files: &[Named<'_, '_>],
    is_run: impl Fn(&CheckedRequirement) -> bool,
    problems: &mut Vec<String>,
) -> Result<(Vec<Row>, EndCounts), MishandleError> {
    let mut ends = EndCounts::default();
    let asked: Vec<(usize, &CheckedRequirement)> =
        found.requirements.iter().enumerate().filter(|(_, requirement)| is_run(requirement)).collect();
    let stated = |requirement: &CheckedRequirement| {
        let is_in_space = |(_, other): &&(usize, &CheckedRequirement)| other.space == requirement.space;
        let same_space = asked.iter().filter(is_in_space).filter_map(|(index, _)| written.get(*index));
        let own = written.iter().find(|own| own.name == requirement.name);
        own.map_or(StatedEpisodes::default(), |own| StatedEpisodes::new(own, same_space))
    };
    let row = |requirement: &CheckedRequirement| Row::new(&requirement.name, stated(requirement));
    let mut rows: Vec<Row> = found.requirements.iter().map(row).collect();
    let mut left = files.iter();
    let mut next = |rows: &mut [Row], asked: (CheckRunKind, &str, Option<&str>)| {
        let (kind, space, requirement) = asked;
        match left.next() {
            Some((named, file, _))
                if (named.kind, named.space.as_str(), named.requirement.as_deref()) == asked =>
            {
                let found = crate::run::requirements(file)?.unwrap_or_default();
                ends.add_all(row::add(rows, &found, file, kind == CheckRunKind::Random)?);
            }
            _ => {
                let of = requirement.map_or(String::new(), |name| format!(" for {name}"));
                problems.push(format!("its next run is not the {kind} run{of} in the space {space}"));
            }
        }
        Ok::<(), MishandleError>(())
    };
    let mut spaces: Vec<&str> = Vec::new();
    for (_, requirement) in &asked {
        if !spaces.contains(&requirement.space.as_str()) {
            spaces.push(&requirement.space);
            next(&mut rows, (CheckRunKind::Random, requirement.space.as_str(), None))?;
        }
    }
    for (index, requirement) in asked {
        if requirement.max_failure_rate.is_none() && rows[index].violated() == 0 {
            let name = Some(requirement.name.as_str());
            next(&mut rows, (CheckRunKind::Search, requirement.space.as_str(), name))?;
        }
    }
    if left.next().is_some() {
        problems.push("it has runs that the check did not ask for".to_string());
    }
    Ok((rows, ends))
}

/// Returns whether a result is about the requirements of a file.
fn is_about(found: &Check, file: &RequirementFile) -> bool {
    let is_same = |(known, written): (&CheckedRequirement, &WrittenRequirement)| {
        known.name == written.name
            && known.text == written.text
            && known.formula == written.timed_formula()
            && known.severity == written.severity
            && known.clauses == written.clauses
            && known.source == written.source
            && known.max_failure_rate == written.check.max_failure_rate
            && written.check.space.as_ref().is_none_or(|space| *space == known.space)
            && known.space.is_empty() == (written.check.space.is_none() && is_never_run(found, known))
    };
    (&found.title, &found.notice) == (&file.title, &file.notice)
        && found.requirements.len() == file.requirements.len()
        && found.requirements.iter().zip(&file.requirements).all(is_same)
}

/// Returns whether a requirement applies to the target with no controller.
fn is_never_run(found: &Check, requirement: &CheckedRequirement) -> bool {
    let mut cells = found.cells.iter().filter(|cell| cell.requirement == requirement.name);
    cells.all(|cell| !cell.missing_signals.is_empty())
}

/// Lists the facts about a run that differ from its file.
fn facts(
    found: &Check,
    controller: &CheckedController,
    named: &CheckRun,
    file: &RunFile,
    plan: &Plan,
) -> Result<Vec<&'static str>, MishandleError> {
    let header = file.header();
    let part = header.components.iter().find(|component| component.role == "controller");
    let has_formula = |stated: &mishandle_store::FormulaRecord| {
        let name = stated.name.strip_prefix(REQUIREMENT);
        let known = name.and_then(|name| found.requirements.iter().find(|known| known.name == name));
        name.is_none() || known.is_some_and(|known| normal(known.formula_text()) == normal(&stated.text))
    };
    // A requirement is asked in its space only, with the formula or the name of the file.
    let is_asked = |(name, formula): (&String, &String)| {
        let known = found.requirements.iter().find(|known| known.name == *name);
        known.is_some_and(|known| known.formula == *formula && known.space == header.space)
    };
    let is_named = |known: &CheckedRequirement| {
        let recorded = header.formulas.iter().find(|recorded| recorded.name == known.formula);
        let is_it = match recorded {
            Some(recorded) => Some(&recorded.text) == known.named_formula.as_ref(),
            // A run leaves this one out if nothing else reads its signals.
            None => known.named_formula.is_none() || known.formula == "careful",
        };
        is_it || !plan.requirements.contains_key(&known.name)
    };
    let is_kind = match named.kind {
        CheckRunKind::Random => {
            let corners = plan.evaluate.as_ref().is_some_and(|evaluate| evaluate.corners);
            header.kind == RunKind::Evaluate && !corners
        }
        CheckRunKind::Search => {
            let known =
                found.requirements.iter().find(|known| Some(&known.name) == named.requirement.as_ref());
            let formula = plan.falsify.as_ref().and_then(|falsify| falsify.formula.as_ref());
            header.kind == RunKind::Falsify
                && header.search == found.search
                && known.is_some_and(|known| Some(&known.formula) == formula)
        }
    };
    let facts = [
        (
            "target",
            header.target.name == found.target
                && header.target.kind == found.target_kind
                && header.target.hash == controller.target_hash,
        ),
        (
            "controller",
            part.map(|part| &part.hash) == controller.hash.as_ref()
                && is_path_of(&controller.name, &plan.controller),
        ),
        ("space", header.space == named.space),
        ("seed", header.seed == found.seed.0),
        ("kind, search or formula", is_kind),
        (
            "formula of a requirement",
            header.formulas.iter().all(has_formula)
                && plan.requirements.iter().all(is_asked)
                && found.requirements.iter().all(is_named),
        ),
        ("number of simulations", file.counts()?.simulations == named.simulations),
        ("digest", format!("{:032x}", file.content_digest()?) == named.digest),
    ];
    Ok(facts.into_iter().filter(|(_, is_same)| !is_same).map(|(fact, _)| fact).collect())
}

/// Returns whether the signals that a cell calls missing are signals of the formula that no trace
/// of the controller's runs has: none if the requirement was run.
fn is_missing(
    cell: &CheckCell,
    requirement: &CheckedRequirement,
    is_run: bool,
    files: &[Named<'_, '_>],
) -> bool {
    if is_run || cell.missing_signals.is_empty() {
        return is_run == cell.missing_signals.is_empty();
    }
    let Ok(formula) = Formula::parse(requirement.formula_text()) else { return false };
    let read = formula.signals();
    let traced: BTreeSet<&str> = files
        .iter()
        .flat_map(|(_, file, _)| file.header().signals.iter().map(|signal| &*signal.name))
        .collect();
    cell.missing_signals.iter().all(|name| read.contains(&name.as_str()) && !traced.contains(name.as_str()))
}

/// A counterexample is compared for itself.
fn is_same(cell: &CheckCell, row: &Row, again: &CheckCell) -> bool {
    CheckCell { counterexample: None, ..cell.clone() } == *again
        && cell.counterexample.is_some() == (row.violated() > 0)
}
