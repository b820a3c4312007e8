//! Scenarios that are simulated with other seeds: the counterexamples of a falsification, or a
//! chosen one.

use std::collections::BTreeMap;
use std::ops::ControlFlow;

use mishandle_evaluation::Repeats;
use mishandle_falsification::{Repeated, measure_noise, repeat, repeat_seeds};
use mishandle_random::Seed;
use mishandle_results::{Estimate, Falsification, Simulation, Trial};
use mishandle_rollout::Scenario;
use mishandle_text::plural;

use crate::error::MishandleError;
use crate::resolve::{ResolvedPlan, depends_on_seed};
use crate::run::result::repeated_result;

/// Simulates each counterexample with other seeds, as often as [`Repeated::each_counterexample`]
/// says; `requested` replaces the default of [`Repeated::Counterexample`]. Returns the reports by
/// trial: none for a target without randomness, whose counterexamples always fail, and none for a
/// counterexample that has as many repeats.
///
/// `watch` gets the number of finished simulations and of all, and can end the repeats.
///
/// # Errors
/// If a simulation cannot be run.
pub fn counterexample_repeats(
    resolved: &ResolvedPlan,
    found: &Falsification,
    requested: Option<u64>,
    mut watch: impl FnMut(u64, u64) -> ControlFlow<()>,
) -> Result<BTreeMap<u32, Repeats>, MishandleError> {
    let minimum = |trial: &Trial| {
        let scenario = Scenario::new(trial.initial_configuration.clone()?);
        Some((trial.trial, scenario, Seed(trial.seed?.0)))
    };
    let mut counterexamples: Vec<(u32, Scenario, Seed)> = found
        .trials
        .iter()
        .filter(|trial| trial.falsified)
        .filter_map(minimum)
        .filter(|(_, scenario, _)| depends_on_seed(resolved, scenario))
        .collect();
    let requested = requested.unwrap_or(Repeated::Counterexample.simulations());
    let each = Repeated::each_counterexample(requested, found.simulations, counterexamples.len() as u64);
    let is_repeated = |trial: &Trial| trial.repeats.as_ref().is_some_and(|known| known.simulations == each);
    let repeated: Vec<u32> =
        found.trials.iter().filter(|trial| is_repeated(trial)).map(|trial| trial.trial).collect();
    counterexamples.retain(|(trial, ..)| !repeated.contains(trial));
    let number = counterexamples.len() as u64;
    let mut reports = BTreeMap::new();
    if counterexamples.is_empty() || each == 0 {
        return Ok(reports);
    }
    let mut system = resolved.system()?;
    let mut done = 0;
    let mut is_interrupted = false;
    for (trial, scenario, seed) in counterexamples {
        let report = repeat(&mut *system, &scenario, repeat_seeds(seed, each), |_| {
            done += 1;
            let flow = watch(done, each * number);
            is_interrupted |= flow.is_break();
            flow
        })?;
        reports.insert(trial, report);
        if is_interrupted {
            break;
        }
    }
    Ok(reports)
}

/// Repeated simulations of a scenario.
#[derive(Clone, Debug)]
pub struct RepeatedScenario {
    /// The result.
    pub result: Simulation,
    /// Number of finished simulations, also of those that measure the noise.
    pub simulations: u64,
    /// Number of simulations of the scenario that were planned, and of all simulations.
    pub planned: (u64, u64),
}

/// Simulates a scenario `repeats` times with other seeds than that of the plan, and `scenarios`
/// random scenarios to measure how much of the variance of the robustness is noise. The defaults
/// are those of [`Repeated`]. If nothing is random, the scenario is simulated once.
///
/// `watch` gets the number of finished simulations and of all, and can end the repeats.
///
/// # Errors
/// If a simulation cannot be run.
pub fn repeat_scenario(
    resolved: &ResolvedPlan,
    scenario: &Scenario,
    repeats: Option<u64>,
    scenarios: Option<u64>,
    mut watch: impl FnMut(u64, u64) -> ControlFlow<()>,
) -> Result<RepeatedScenario, MishandleError> {
    let (repeats, scenarios) = if depends_on_seed(resolved, scenario) {
        (
            repeats.unwrap_or(Repeated::Counterexample.simulations()),
            scenarios.unwrap_or(Repeated::NOISE_SCENARIOS),
        )
    } else {
        (1, 0)
    };
    let noise_repeats = Repeated::Noise.simulations();
    let total = repeats + scenarios * noise_repeats;
    let mut simulations = 0;
    let mut count = |_: &_| {
        simulations += 1;
        watch(simulations, total)
    };
    let mut system = resolved.system()?;
    let seed = Seed(resolved.plan.seed);
    let report = repeat(&mut *system, scenario, repeat_seeds(seed, repeats), &mut count)?;
    let noise = match scenarios {
        0 => None,
        _ if report.simulations < repeats => None,
        _ => measure_noise(&mut *system, seed, scenarios, noise_repeats, &mut count)?,
    };
    let result = repeated_result(resolved, scenario, report, noise);
    Ok(RepeatedScenario { result, simulations, planned: (repeats, total) })
}

/// Describes how often repeated simulations fail, such as `fails in 188 of 2,000 repeats: 9.4 %
/// [8.2, 10.8]`.
pub fn failure_text(report: &Repeats) -> String {
    let Estimate { value, low, high, n } = report.failure_rate;
    let percent = |value: Option<f64>| 100.0 * value.unwrap_or(f64::NAN);
    match value {
        None => "no repeat has a verdict".to_string(),
        Some(_) => format!(
            "fails in {} of {}: {:.1} % [{:.1}, {:.1}]",
            report.failures,
            plural(n, "repeat"),
            percent(value),
            percent(low),
            percent(high)
        ),
    }
}
