//! Compares the result of a check with its runs.

use std::collections::BTreeMap;
use std::path::Path;

use mishandle_files::{limits, read_text_bounded};
use mishandle_requirements::{RequirementFile, WrittenRequirement};
use mishandle_results::{
    Check, CheckCell, CheckCounterexample, CheckRun, CheckRunKind, CheckedController, CheckedRequirement,
    Words,
};
use mishandle_stl::Formula;
use mishandle_store::RunFile;

use super::folder::{REQUIREMENTS, RESULT, file_digest, finished};
use super::row::{self, Row};
use crate::error::{MishandleError, problem};
use crate::run::rows::REQUIREMENT;

/// Returns the result of the check in a folder, which follows from the requirements and the runs
/// there; `None` if the folder has no result. Nothing is simulated.
///
/// # Errors
/// If a file cannot be read, or the result does not follow from the others.
pub fn verified(folder: &Path, words: Words) -> Result<Option<Check>, MishandleError> {
    let Some(found) = finished(folder, words)? else { return Ok(None) };
    let path = folder.join(REQUIREMENTS);
    let text = read_text_bounded(&path, limits::PLAN);
    let text = text.map_err(|source| MishandleError::File { path, source })?;
    let mut runs = BTreeMap::new();
    for run in found.controllers.iter().flat_map(|controller| &controller.runs) {
        if Path::new(&run.run).exists() {
            runs.insert(run.run.clone(), RunFile::open_unchecked(Path::new(&run.run))?);
        }
    }
    let problems = differences(&found, &text, |name| runs.get(name))?;
    if problems.is_empty() {
        Ok(Some(found))
    } else {
        Err(problem(format!(
            "{} does not follow from the runs of the check: {}",
            folder.join(RESULT).display(),
            problems.join("; ")
        )))
    }
}

/// Lists how the result of a check differs from what follows from the text of its requirements and
/// its runs: `run` returns the file of a run. Nothing is simulated.
///
/// # Errors
/// If a run cannot be read.
pub fn differences<'r>(
    found: &Check,
    requirements: &str,
    run: impl Fn(&str) -> Option<&'r RunFile>,
) -> Result<Vec<String>, MishandleError> {
    let mut differences = Vec::new();
    let stated = RequirementFile::from_toml(requirements);
    if file_digest(requirements) != found.requirements_digest
        || !stated.is_ok_and(|file| is_about(found, &file))
    {
        differences.push("it is about other requirements than its file".to_string());
    }
    for controller in &found.controllers {
        let mut rows: Vec<Row> =
            found.requirements.iter().map(|requirement| Row::new(&requirement.name)).collect();
        for named in &controller.runs {
            let Some(file) = run(&named.run) else {
                differences.push(format!("{}: the run is missing", named.run));
                continue;
            };
            let facts = facts(found, controller, named, file)?;
            differences.extend(facts.into_iter().map(|fact| format!("{}: another {fact}", named.run)));
            let found = crate::run::requirements(file)?.unwrap_or_default();
            row::add(&mut rows, &found, file, named.kind == CheckRunKind::Random)?;
        }
        for (requirement, row) in found.requirements.iter().zip(&rows) {
            let name = &requirement.name;
            let is_own = |cell: &&CheckCell| cell.controller == controller.name && cell.requirement == *name;
            let Some(cell) = found.cells.iter().find(is_own) else {
                differences.push(format!("{name}: it has no verdict"));
                continue;
            };
            let again = row.cell(&controller.name, &cell.missing_signals, requirement.max_failure_rate);
            if !is_same(cell, &again) {
                let CheckCell { verdict, evidence, .. } = again;
                differences.push(format!("{name}: the runs give another result: {verdict}, {evidence}"));
            }
            if let Some(violation) = &cell.counterexample
                && !run(&violation.run).is_some_and(|file| is_recorded(name, violation, file))
            {
                differences.push(format!("{name}: its counterexample is not in {}", violation.run));
            }
        }
    }
    if found.cells.len() != found.requirements.len() * found.controllers.len() {
        differences.push("the matrix has another number of verdicts".to_string());
    }
    Ok(differences)
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
    };
    (&found.title, &found.notice) == (&file.title, &file.notice)
        && found.requirements.len() == file.requirements.len()
        && found.requirements.iter().zip(&file.requirements).all(is_same)
}

/// Lists the facts about a run that differ from its file.
fn facts(
    found: &Check,
    controller: &CheckedController,
    named: &CheckRun,
    file: &RunFile,
) -> Result<Vec<&'static str>, MishandleError> {
    let header = file.header();
    let part = header.components.iter().find(|component| component.role == "controller");
    let text = |text: &str| Formula::parse(text).map(|formula| formula.to_string()).ok();
    let has_formula = |stated: &mishandle_store::FormulaRecord| {
        let name = stated.name.strip_prefix(REQUIREMENT);
        let known = name.and_then(|name| found.requirements.iter().find(|known| known.name == name));
        name.is_none() || known.is_some_and(|known| text(known.formula_text()) == text(&stated.text))
    };
    let facts = [
        ("target", header.target.name == found.target && header.target.hash == controller.target_hash),
        ("controller", part.map(|part| &part.hash) == controller.hash.as_ref()),
        ("space", header.space == named.space),
        ("seed", header.seed == found.seed.0),
        ("formula of a requirement", header.formulas.iter().all(has_formula)),
        ("number of simulations", file.counts()?.simulations == named.simulations),
        ("digest", format!("{:032x}", file.content_digest()?) == named.digest),
    ];
    Ok(facts.into_iter().filter(|(_, is_same)| !is_same).map(|(fact, _)| fact).collect())
}

/// A counterexample takes a simulation, so only its presence is compared, and a note about it in
/// the evidence is ignored.
fn is_same(cell: &CheckCell, again: &CheckCell) -> bool {
    let is_violated = again.random.violated + again.searched.violated > 0;
    let plain = CheckCell { counterexample: None, evidence: again.evidence.clone(), ..cell.clone() };
    plain == *again
        && cell.evidence.starts_with(&again.evidence)
        && cell.counterexample.is_some() == is_violated
        && cell.counterexample.as_ref().is_none_or(|found| Some(found.robustness) == cell.minimum_robustness)
}

/// Returns whether a violation of a requirement is a recorded simulation.
fn is_recorded(name: &str, violation: &CheckCounterexample, file: &RunFile) -> bool {
    let axes = &file.header().axes;
    let is_own = |verdict: &String| verdict.strip_prefix(REQUIREMENT) == Some(name);
    let column = file.header().verdicts.iter().position(is_own);
    file.simulation(violation.trial, violation.simulation).is_ok_and(|recorded| {
        let values = axes.iter().zip(&recorded.scenario);
        let robustness = column.and_then(|column| recorded.verdicts.get(column).copied().flatten());
        recorded.seed == violation.seed.0
            && robustness == Some(violation.robustness.0)
            && axes.len() == violation.scenario.len()
            && values.zip(&violation.scenario).all(|((axis, value), stated)| {
                axis.name == stated.axis && *value == stated.value && axis.nominal == stated.nominal
            })
    })
}
