//! Total effects of the axes, from a random sample that the report makes.

use std::ops::ControlFlow;

use mishandle::MishandleError;
use mishandle::evaluation::{AxisRateCounter, Estimate, SensitivitySample, total_effects};
use mishandle::results::AxisRates;
use mishandle::rollout::{Episode, Request, Scenario, Seed, Space, System};
use mishandle::stl::is_satisfied;
use mishandle_text::plural;

use crate::axis_rates;
use crate::html::{percent, short, table, text};
use crate::load::RunReport;

/// Number of simulations per batch.
const BATCH: usize = 64;

/// Largest number of axes in the table.
const MAX_ROWS: usize = 20;

/// Total effects of the axes on the robustness.
#[derive(Clone, Debug, PartialEq)]
pub struct Sensitivity {
    /// Index and effect of each axis that varies.
    pub effects: Vec<(usize, Estimate)>,
    /// Success over the values of the axes, of one simulation of each random scenario.
    pub rates: Option<AxisRates>,
    /// Number of random scenarios whose simulations all have a verdict.
    pub scenarios: u64,
    /// Number of simulations.
    pub simulations: u64,
}

/// Returns the number of simulations of a sample of `n` scenarios.
pub fn simulations(space: &Space, n: u32) -> u64 {
    u64::from(n) * (2 + varying(space).count() as u64)
}

fn varying(space: &Space) -> impl Iterator<Item = usize> {
    space.axes().iter().enumerate().filter(|(_, axis)| !axis.is_fixed()).map(|(index, _)| index)
}

/// Simulates `n` random scenarios, each twice and once with another value of each axis. Returns
/// `None` if `watch` ends it.
///
/// # Errors
/// If a simulation cannot be run.
pub fn measure(
    system: &mut dyn System,
    space: &Space,
    seed: Seed,
    n: u32,
    mut watch: impl FnMut(&Episode) -> ControlFlow<()>,
) -> Result<Option<Sensitivity>, MishandleError> {
    let axes: Vec<usize> = varying(space).collect();
    let mut sample =
        SensitivitySample { moved: vec![Vec::new(); axes.len()], ..SensitivitySample::default() };
    let mut rates = AxisRateCounter::new(space, n.into());
    let columns = axes.len() + 2;
    let mut simulations = 0;
    for first in (0..n).step_by((BATCH / columns).max(1)) {
        let rows = first..n.min(first + (BATCH / columns).max(1) as u32);
        let mut requests = Vec::new();
        for row in rows {
            // A value without an effect for the own kind of a fault may have one for another kind.
            let drawn = space.draw(seed, row.into());
            let other = space.draw(seed.child(1), row.into());
            let own = space.canonical(drawn.clone());
            let moved = axes.iter().map(|axis| {
                let mut values = drawn.values().to_vec();
                values[*axis] = other.get(*axis);
                space.canonical(Scenario::new(values))
            });
            let scenarios = [own.clone(), own.clone()].into_iter().chain(moved);
            // Each simulation has a seed of its own, so that the noise of all is alike.
            let seeds = (0_u64..).map(|column| seed.child(2).child(u64::from(row)).child(column));
            requests.extend(scenarios.zip(seeds).map(|(scenario, seed)| Request::new(scenario, seed)));
        }
        let numbered = (1..).zip(requests).map(|(number, request)| Request { number, ..request });
        let episodes = system.rollout(&numbered.collect::<Vec<_>>())?;
        simulations += episodes.len() as u64;
        for episode in &episodes {
            if watch(episode).is_break() {
                return Ok(None);
            }
        }
        for row in episodes.chunks(columns) {
            if let Some(own) = row.first().filter(|own| own.end.counts_in_rates()) {
                rates.add_verdict(&own.request.scenario, own.robustness().map(is_satisfied));
            }
            let values: Option<Vec<f64>> =
                row.iter().map(|episode| episode.robustness().filter(|rho| rho.is_finite())).collect();
            // A row with a gap would compare other scenarios.
            let Some([own, again, moved @ ..]) = values.as_deref() else { continue };
            sample.first.push(*own);
            sample.again.push(*again);
            sample.moved.iter_mut().zip(moved).for_each(|(column, value)| column.push(*value));
        }
    }
    let scenarios = sample.first.len() as u64;
    let mut effects: Vec<(usize, Estimate)> = axes.into_iter().zip(total_effects(&sample, seed)).collect();
    effects.sort_by(|a, b| b.1.value.unwrap_or(0.0).total_cmp(&a.1.value.unwrap_or(0.0)));
    Ok(Some(Sensitivity { effects, rates: rates.report(), scenarios, simulations }))
}

/// Returns the table of the effects as HTML.
pub fn section(report: &RunReport, found: &Sensitivity) -> String {
    let sample = format!(
        "{} from {} of the whole space, made for this page",
        plural(found.simulations, "simulation"),
        plural(found.scenarios, "random scenario")
    );
    if found.effects.is_empty() {
        return format!("<p>No axis changes the robustness ({sample}).</p>\n");
    }
    let rows: Vec<Vec<String>> = found
        .effects
        .iter()
        .take(MAX_ROWS)
        .map(|(axis, effect)| {
            let share = |value: Option<f64>| value.map_or("-".to_string(), percent);
            vec![
                text(&short(&report.axes[*axis].name, 40)).to_string(),
                share(effect.value),
                format!("{} to {}", share(effect.low), share(effect.high)),
            ]
        })
        .collect();
    let rest = found.effects.len().saturating_sub(MAX_ROWS);
    let rest = if rest > 0 { format!(" {rest} more axes have smaller effects.") } else { String::new() };
    // An evaluation has a larger sample of its own.
    let rates = found.rates.as_ref().filter(|_| report.axis_rates().is_none());
    let rates = rates.map_or(String::new(), |rates| {
        axis_rates::section(rates, &plural(found.scenarios, "random scenario"))
    });
    rates
        + &table(
            "Total effects of the axes on the robustness",
            &["axis", "total effect", "95 % interval"],
            &rows,
        )
        + &format!(
            "<p class=\"notes\">The share of the variance of the robustness that remains if all other axes are known ({sample}; noise of \
             seeds is subtracted). Effects of axes together count in each of them.{rest}</p>\n"
        )
}

#[cfg(test)]
mod tests {
    use mishandle::rollout::{Axis, AxisKind, AxisValues, Condition, Holds};
    use mishandle::toys::{FunctionSystem, SimulatedEnd};

    use super::*;

    #[test]
    fn the_axis_that_sets_the_result_has_the_whole_effect() {
        let axes = ["a", "b", "c"].map(|name| Axis::start(name, "", 0.0, 1.0)).to_vec();
        let space = Space::new("starts", axes).unwrap();
        let outcome = |request: &Request| SimulatedEnd::Robustness(0.5 - request.scenario.get(1).unwrap());
        let mut system = FunctionSystem::new(space.clone(), outcome);
        let found =
            measure(&mut system, &space, Seed(1), 256, |_| ControlFlow::Continue(())).unwrap().unwrap();
        assert_eq!((found.scenarios, found.simulations), (256, simulations(&space, 256)));
        assert_eq!(found.effects[0].0, 1);
        assert!((found.effects[0].1.value.unwrap() - 1.0).abs() < 0.2, "{found:?}");
        assert_eq!(found.effects[1].1.value, Some(0.0));
    }

    #[test]
    fn a_value_that_has_an_effect_with_another_kind_only_counts_for_both() {
        // The depth x of water has an effect on a wet road (k = 1), not on a dry one (k = 0). Of
        // f = k x, with k and x uniform, the variance is 5/48; E[Var(f | x)] is 1/12 and
        // E[Var(f | k)] is 1/24, so the total effects are 0.8 and 0.4.
        let names = ["dry", "wet"].map(String::from);
        let road = Axis::new(AxisKind::Model, "road", "", [0.0, 1.0], Some(0.0));
        let road = road.with_values(AxisValues::Categorical(names.into()));
        let wet = Condition { axis: "road".to_string(), nominal: 0.0, holds: Holds::OneOf([1.0].into()) };
        let depth = Axis::new(AxisKind::Model, "depth", "m", [0.0, 1.0], Some(0.0)).only_if([wet]);
        let space = Space::new("roads", vec![road, depth]).unwrap();
        let outcome = |request: &Request| SimulatedEnd::Robustness(request.scenario.get(1).unwrap() - 0.3);
        let mut system = FunctionSystem::new(space.clone(), outcome);
        let found =
            measure(&mut system, &space, Seed(1), 2000, |_| ControlFlow::Continue(())).unwrap().unwrap();
        let effect = |axis: usize| found.effects.iter().find(|(index, _)| *index == axis).unwrap().1.value;
        assert!((effect(0).unwrap() - 0.8).abs() < 0.06, "{found:?}");
        assert!((effect(1).unwrap() - 0.4).abs() < 0.06, "{found:?}");
    }
}
