//! Named requirements over the simulations of a run.

use mishandle_evaluation::{Corners, failure_rate};
use mishandle_results::{Requirement, Vacuous};
use mishandle_stl::is_violated;
use mishandle_store::{RunFile, RunKind, SimulationEnd};

use crate::error::MishandleError;
use crate::run::rows::{REQUIREMENT, VACUITY};
use crate::run::vacuity;
use crate::run::{OneTrace, asks_nothing, has_random_rows};

/// Returns the findings about each named requirement of a run; `None` if it has none.
///
/// # Errors
/// If the run cannot be read.
pub fn requirements(run: &RunFile) -> Result<Option<Vec<Requirement>>, MishandleError> {
    let header = run.header();
    let text = |name: &str| {
        let formula = header.formulas.iter().find(|formula| formula.name == name);
        formula.map_or(String::new(), |formula| formula.text.clone())
    };
    let named = header.verdicts.iter().enumerate().filter_map(|(column, verdict)| {
        let name = verdict.strip_prefix(REQUIREMENT)?.to_string();
        let formula = text(verdict);
        let vacuity = format!("{VACUITY}{name}");
        let vacuity = header.verdicts.iter().position(|verdict| *verdict == vacuity);
        let empty = Requirement {
            name,
            formula,
            started: 0,
            simulations: 0,
            violated: 0,
            violation_rate: None,
            minimum_robustness: None,
            trial: None,
            simulation: None,
            vacuous: Vacuous::default(),
            asks_nothing: None,
        };
        Some((column, vacuity, empty, OneTrace::default()))
    });
    let mut found: Vec<_> = named.collect();
    if found.is_empty() {
        return Ok(None);
    }
    for simulation in run.simulations() {
        let simulation = simulation?;
        if header.kind == RunKind::Evaluate && simulation.trial == Corners::TRIAL {
            continue;
        }
        for (column, vacuity, requirement, one) in &mut found {
            requirement.started += u64::from(simulation.end != SimulationEnd::InvalidScenario);
            let robustness = simulation.verdicts.get(*column).copied().flatten();
            one.add(&simulation, robustness.is_some());
            let Some(robustness) = robustness else { continue };
            requirement.simulations += 1;
            requirement.violated += u64::from(is_violated(robustness));
            vacuity::count(&mut requirement.vacuous, &simulation, *vacuity);
            if requirement.minimum_robustness.is_none_or(|least| robustness.total_cmp(&least.0).is_lt()) {
                requirement.minimum_robustness = Some(robustness.into());
                requirement.trial = Some(simulation.trial);
                requirement.simulation = Some(simulation.number);
            }
        }
    }
    // A trial that ends at its first violation has a biased share of violations, too.
    let is_rate = header.kind == RunKind::Evaluate && has_random_rows(header);
    let with_rate = |(_, _, requirement, one): (_, _, Requirement, OneTrace)| {
        let Requirement { started, simulations, violated, .. } = requirement;
        let reason = match simulations {
            0 if started > 0 => Some("no simulation has a verdict about it".to_string()),
            _ => asks_nothing(&requirement.formula, requirement.vacuous, simulations),
        };
        Requirement {
            asks_nothing: reason.or_else(|| one.reason()).filter(|_| violated == 0),
            violation_rate: is_rate.then(|| failure_rate(violated, started - simulations, started)),
            ..requirement
        }
    };
    Ok(Some(found.into_iter().map(with_rate).collect()))
}
