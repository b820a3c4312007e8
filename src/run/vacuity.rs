//! Formulas that hold in simulations and ask nothing of the controller.

use mishandle_requirements::start_traps;
use mishandle_results::{Number, TrapSeverity, Vacuous};
use mishandle_stl::{Formula, Vacuity, is_satisfied};
use mishandle_store::{RunFile, Simulation};
use mishandle_text::{number_text, plural};

use crate::error::MishandleError;
use crate::run::rows::SEARCH_VACUITY;

/// Adds the finding of a simulation, which a verdict of its row has.
pub(super) fn count(vacuous: &mut Vacuous, row: &Simulation, column: Option<usize>) {
    let code = column.and_then(|column| row.verdicts.get(column).copied().flatten()).unwrap_or(0.0);
    match Vacuity::from_code(code as u8) {
        Some(Vacuity::FirstSample) => vacuous.first_sample += 1,
        Some(Vacuity::Premise) => vacuous.premise += 1,
        Some(Vacuity::Parts) => vacuous.parts += 1,
        // A simulation that no sample decides has no verdict.
        Some(Vacuity::NoSample) | None => {}
    }
}

/// Returns why all simulations with a verdict of a formula ask nothing; `None` if one asks
/// something, and without any.
pub(crate) fn asks_nothing(formula: &str, vacuous: Vacuous, simulations: u64) -> Option<String> {
    if simulations == 0 || vacuous.total() < simulations {
        return None;
    }
    let formula = Formula::parse(formula).ok()?;
    let given = [
        (vacuous.first_sample, Vacuity::FirstSample),
        (vacuous.premise, Vacuity::Premise),
        (vacuous.parts, Vacuity::Parts),
    ];
    let given = given.into_iter().filter(|(count, _)| *count > 0);
    let reasons: Vec<String> = given.map(|(_, found)| found.reason(&formula)).collect();
    let traps = start_traps(&formula).into_iter().filter(|trap| trap.severity == TrapSeverity::Warning);
    let instead = traps.filter(|_| vacuous.first_sample > 0).find_map(|trap| trap.instead);
    let instead = instead.map_or(String::new(), |text| format!("; for other samples, write {text}"));
    Some(reasons.join(", or ") + &instead)
}

/// Returns why simulations that violate nothing say nothing about the controller, if nothing that
/// was varied changes their robustness: `least` and `most` are the same, and all have a verdict.
pub(crate) fn unchanged(
    simulations: u64,
    least: Option<Number>,
    most: Option<Number>,
    varies: bool,
) -> Option<String> {
    let (least, most) = least.zip(most).filter(|(least, _)| is_satisfied(least.0))?;
    let is_same = varies && simulations > 1 && least.0.total_cmp(&most.0).is_eq();
    let robustness = number_text(least.0);
    let all = plural(simulations, "simulation");
    is_same.then(|| format!("nothing that was varied changes the robustness, {robustness} in all {all}"))
}

/// Returns whether the scenarios of a run can differ.
pub(crate) fn varies(run: &RunFile) -> bool {
    run.header().axes.iter().any(|axis| axis.low < axis.high)
}

/// Returns why no simulation of a run asks anything with the formula of its question.
pub(super) fn of_question(run: &RunFile) -> Result<Option<String>, MishandleError> {
    let header = run.header();
    let column = header.verdicts.iter().position(|name| name == SEARCH_VACUITY);
    let (mut vacuous, mut simulations) = (Vacuous::default(), 0);
    for row in run.simulations() {
        let row = row?;
        simulations += u64::from(row.robustness.is_some());
        count(&mut vacuous, &row, column);
        if vacuous.total() < simulations {
            return Ok(None);
        }
    }
    Ok(asks_nothing(&header.formula, vacuous, simulations))
}
