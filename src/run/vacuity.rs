//! Formulas that hold in simulations and ask nothing of the controller.

use mishandle_requirements::{certainty, start_traps};
use mishandle_results::{TrapSeverity, Vacuous};
use mishandle_stl::{Formula, Vacuity, is_violated};
use mishandle_store::{RunFile, Simulation, SimulationEnd};
use mishandle_text::plural;

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
    if simulations == 0 {
        return None;
    }
    let formula = Formula::parse(formula).ok()?;
    if let Some(reason) = certainty(&formula) {
        return Some(reason.to_string());
    }
    if vacuous.total() < simulations {
        return None;
    }
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

/// Whether simulations of different scenarios all have one trace: then they say no more than one of
/// them.
#[derive(Clone, Debug, Default)]
pub(crate) struct OneTrace {
    first: Option<Simulation>,
    simulations: u64,
    varies: bool,
    differs: bool,
}

impl OneTrace {
    /// Adds a simulation. One that ends without a verdict differs from the others.
    pub fn add(&mut self, row: &Simulation, has_verdict: bool) {
        if !has_verdict {
            self.differs |= row.end != SimulationEnd::InvalidScenario;
            return;
        }
        self.simulations += 1;
        match &self.first {
            None => {
                self.differs |= row.trace_digest.is_none();
                self.first = Some(row.clone());
            }
            Some(first) => {
                self.varies |= first.scenario != row.scenario;
                self.differs |= first.trace_digest != row.trace_digest;
            }
        }
    }

    /// Returns why the simulations ask nothing; `None` if two of them differ.
    pub fn reason(&self) -> Option<String> {
        let all = plural(self.simulations, "simulation");
        (self.varies && !self.differs)
            .then(|| format!("nothing that was varied changes any signal in {all}: they are one simulation"))
    }
}

/// Returns why no simulation of a run asks anything with the formula of its question.
pub(super) fn of_question(run: &RunFile) -> Result<Option<String>, MishandleError> {
    let header = run.header();
    let column = header.verdicts.iter().position(|name| name == SEARCH_VACUITY);
    let (mut vacuous, mut simulations, mut one) = (Vacuous::default(), 0, OneTrace::default());
    let is_certain = Formula::parse(&header.formula).is_ok_and(|formula| certainty(&formula).is_some());
    for row in run.simulations() {
        let row = row?;
        if row.robustness.is_some_and(is_violated) {
            return Ok(None);
        }
        simulations += u64::from(row.robustness.is_some());
        one.add(&row, row.robustness.is_some());
        count(&mut vacuous, &row, column);
        if vacuous.total() < simulations && one.differs && !is_certain {
            return Ok(None);
        }
    }
    Ok(asks_nothing(&header.formula, vacuous, simulations).or_else(|| one.reason()))
}
