//! The control arm of an evaluation: the same starts and seeds with every other axis at nominal.

use mishandle_evaluation::{
    PairedCounts, count_end, decides_success, paired_rates, paired_rates_at_any_time,
};
use mishandle_results::{Control, EndCounts, Estimate, PairedRates};
use mishandle_rollout::{Axis, AxisKind, Episode, Request, Scenario, Space, System};
use mishandle_store::{MAX_TRIALS, RunFile, Simulation};

use crate::error::MishandleError;
use crate::plan::Plan;
use crate::resolve::{ResolvedPlan, depends_on_seed_at_nominal};
use crate::run::header;

/// Number of the trial that holds the arm. It is above those of the question, so that no count or
/// rate of a run includes the arm by mistake: see [`MAX_TRIALS`].
pub const TRIAL: u32 = MAX_TRIALS + 1;

/// The simulations of the arm.
#[derive(Clone, Debug)]
pub(crate) struct ControlArm {
    /// The space with all bounds of the target, so that it contains the nominal values, also if the
    /// plan narrows an axis to other values.
    pub(crate) space: Space,
    /// Names of the axes that the arm fixes.
    nominal: Vec<String>,
    /// Whether all simulations of the arm are the same.
    is_single: bool,
}

impl ControlArm {
    /// Returns the control arm of a plan; `None` if nothing but initial states is varied, the plan
    /// switches it off, or a device screens.
    pub(crate) fn new(resolved: &ResolvedPlan) -> Result<Option<ControlArm>, MishandleError> {
        let plan = &resolved.plan;
        let is_off = plan.evaluate.as_ref().is_none_or(|evaluate| !evaluate.control);
        if is_off || plan.screening.is_some() { Ok(None) } else { ControlArm::of_space(resolved) }
    }

    /// As [`new`](Self::new), whatever the question of the plan.
    pub(crate) fn of_space(resolved: &ResolvedPlan) -> Result<Option<ControlArm>, MishandleError> {
        let ResolvedPlan { target, space, .. } = resolved;
        let mut axes = Vec::new();
        let mut nominal = Vec::new();
        for axis in space.axes() {
            if axis.kind == AxisKind::Start {
                axes.push(axis.clone());
                continue;
            }
            let whole = target.axes.iter().find(|known| known.name == axis.name).unwrap_or(axis);
            if !(axis.is_fixed() && Some(axis.low) == whole.nominal) {
                nominal.push(axis.name.clone());
            }
            axes.push(whole.clone());
        }
        if nominal.is_empty() {
            return Ok(None);
        }
        let is_varied = |axis: &Axis| axis.kind == AxisKind::Start && !axis.is_fixed();
        let space = Space::new(space.name(), axes)?;
        let is_single = !space.axes().iter().any(is_varied)
            && !depends_on_seed_at_nominal(resolved)
            && !space.nominal().values().contains(&None);
        Ok(Some(ControlArm { space, nominal, is_single }))
    }

    /// Returns the simulation of the arm that is paired with a simulation of the space.
    pub(crate) fn request(&self, random: &Request) -> Request {
        let values = self.space.axes().iter().zip(random.scenario.values());
        let value = |(axis, value): (&Axis, &Option<f64>)| match axis.kind {
            AxisKind::Start => *value,
            _ => axis.nominal,
        };
        let scenario = Scenario::new(values.map(value).collect());
        Request { trial: TRIAL, number: random.number, ..Request::new(scenario, random.seed) }
    }

    /// Returns the number of simulations for this number of simulations of the space.
    pub(crate) fn simulations(&self, random: u64) -> u64 {
        if self.is_single { random.min(1) } else { random }
    }

    /// Returns the names of the axes that the arm fixes.
    pub(crate) fn nominal(&self) -> &[String] {
        &self.nominal
    }

    /// Returns whether all simulations of the arm are the same.
    pub(crate) fn is_single(&self) -> bool {
        self.is_single
    }

    /// Returns the system that runs the simulations of the arm.
    pub(crate) fn system(&self, resolved: &ResolvedPlan) -> Result<Box<dyn System>, MishandleError> {
        Ok(resolved.target.system(&self.space, &resolved.specification)?)
    }
}

/// Returns the system of a recorded simulation and the space that contains its scenario: those of
/// the control arm for a simulation of the arm.
///
/// # Errors
/// If the components of the target are incompatible.
pub fn system_of(resolved: &ResolvedPlan, trial: u32) -> Result<(Box<dyn System>, Space), MishandleError> {
    let arm = if trial == TRIAL { ControlArm::new(resolved)? } else { None };
    match arm {
        Some(arm) => Ok((arm.system(resolved)?, arm.space)),
        None => Ok((resolved.system()?, resolved.space.clone())),
    }
}

/// Verdict of a simulation on success.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Outcome {
    counts: bool,
    succeeds: bool,
    decides: bool,
    /// The end.
    without_verdict: EndCounts,
}

impl Outcome {
    pub(crate) fn of(episode: &Episode) -> Outcome {
        let mut without_verdict = EndCounts::default();
        count_end(&mut without_verdict, episode.end, decides_success(episode), 1);
        Outcome {
            without_verdict,
            counts: episode.end.counts_in_rates(),
            succeeds: episode.is_success(),
            decides: decides_success(episode),
        }
    }
}

/// The outcomes of the pairs.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Pairs {
    /// Simulations of the space.
    pub random: Vec<Outcome>,
    /// Simulations of the arm.
    pub control: Vec<Outcome>,
}

impl Pairs {
    /// Returns the result of the arm; `None` before its first simulation.
    ///
    /// `nominal` are the axes that the arm fixes. With `is_single`, its one simulation is paired
    /// with each of the space.
    pub(crate) fn result(&self, nominal: &[String], is_single: bool, is_any_time: bool) -> Option<Control> {
        let first = *self.control.first()?;
        let paired = |index: usize| if is_single { Some(first) } else { self.control.get(index).copied() };
        let mut counts = PairedCounts::default();
        let mut left_out = 0;
        // An end without a verdict is not a success, in the space as in the arm: what only one of a
        // pair does is a difference. An arm without any verdict shows nothing.
        let is_tested = self.control.iter().any(|control| control.decides);
        for (index, random) in self.random.iter().enumerate() {
            let Some(control) = paired(index) else { break };
            if is_tested && control.counts && random.counts {
                counts.add(control.succeeds, random.succeeds);
            } else {
                left_out += 1;
            }
        }
        let mut without_verdict = EndCounts::default();
        self.control.iter().for_each(|control| without_verdict.add_all(control.without_verdict));
        let rates = if is_any_time { paired_rates_at_any_time } else { paired_rates };
        let PairedRates { first, difference, first_only, second_only, p_value, .. } =
            rates(counts, [counts.n(); 2]);
        // One simulation has an outcome, and no rate whose interval would say more.
        let success_rate = match (is_single, first.value) {
            (true, Some(_)) => Estimate { value: first.value, low: None, high: None, n: 1 },
            _ => first,
        };
        Some(Control {
            trial: TRIAL,
            nominal: nominal.to_vec(),
            simulations: self.control.len() as u64,
            success_rate,
            difference,
            fails_only_in_space: first_only,
            fails_only_in_control: second_only,
            p_value,
            left_out,
            without_verdict,
        })
    }
}

/// Returns whether a run has a control arm that may stand in for that of `resolved`: target,
/// controller, formulas, noise, seed and build are the same, so simulations with the same starts
/// and seeds are, too. Spaces and settings of the axes may differ.
pub(crate) fn shares_arm(resolved: &ResolvedPlan, other: &RunFile) -> Result<bool, MishandleError> {
    let Ok(recorded) = Plan::from_toml(&other.header().plan) else { return Ok(false) };
    if other.last_simulation_number(TRIAL)? == 0 {
        return Ok(false);
    }
    let common = |plan: &Plan| Plan {
        space: String::new(),
        axes: Default::default(),
        evaluate: None,
        is_typed: false,
        ..plan.clone()
    };
    let mine = header::header(resolved);
    let theirs = other.header();
    // With absolute paths, as the other.
    let planned = Plan::from_toml(&mine.plan)?;
    Ok(common(&recorded) == common(&planned)
        && (&mine.target, &mine.components, &mine.build)
            == (&theirs.target, &theirs.components, &theirs.build)
        && (&mine.versions, &mine.verdicts) == (&theirs.versions, &theirs.verdicts)
        && mine.signals == theirs.signals)
}

/// Returns the recorded simulation of another arm that is the one of `request`; `None` if it has
/// another one.
pub(crate) fn copied(
    arm: &ControlArm,
    request: &Request,
    other: &RunFile,
) -> Result<Option<Simulation>, MishandleError> {
    let Some(_) = other.recorded(TRIAL, request.number)? else { return Ok(None) };
    let row = other.simulation(TRIAL, request.number)?;
    let axes = &other.header().axes;
    let value = |name: &str| {
        let place = axes.iter().position(|axis| axis.name == name)?;
        row.scenario.get(place).copied()
    };
    // An axis that one of the spaces lacks is nominal there.
    let is_same = arm.space.axes().iter().zip(request.scenario.values()).all(|(axis, expected)| {
        value(&axis.name).map_or(axis.kind != AxisKind::Start, |found| bits(found) == bits(*expected))
    });
    let theirs = axes.iter().filter(|axis| axis.kind == AxisKind::Start.name()).count();
    let mine = arm.space.axes().iter().filter(|axis| axis.kind == AxisKind::Start).count();
    if !is_same || theirs != mine || row.seed != request.seed.0 {
        return Ok(None);
    }
    let scenario = request.scenario.values().to_vec();
    Ok(Some(Simulation { scenario, ..row }))
}

fn bits(value: Option<f64>) -> Option<u64> {
    value.map(f64::to_bits)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outcome(verdict: Option<bool>) -> Outcome {
        let without_verdict =
            EndCounts { simulations: 1, failed: u64::from(verdict.is_none()), ..EndCounts::default() };
        let succeeds = verdict == Some(true);
        Outcome { counts: true, succeeds, decides: verdict.is_some(), without_verdict }
    }

    fn control(space: &[Option<bool>], arm: &[Option<bool>]) -> Control {
        let outcomes = |verdicts: &[Option<bool>]| verdicts.iter().map(|verdict| outcome(*verdict)).collect();
        let pairs = Pairs { random: outcomes(space), control: outcomes(arm) };
        pairs.result(&[], false, false).expect("the arm has simulations")
    }

    #[test]
    fn an_end_that_only_one_simulation_of_a_pair_has_is_a_difference() {
        let space = [Some(true), Some(false), Some(true), None, Some(true)];
        let found = control(&space, &[Some(true), Some(true), None, Some(true), Some(true)]);
        assert_eq!((found.left_out, found.without_verdict.failed), (0, 1));
        // Pairs 2 and 4 against pair 3.
        assert_eq!((found.fails_only_in_space, found.fails_only_in_control), (2, 1));
        assert_eq!((found.success_rate.value, found.success_rate.n), (Some(0.8), 5));
        assert!(found.difference.value.is_some_and(|found| (found + 0.2).abs() < 1e-12));
        // The same end in both is none: 2 of 5 fail, in one pair only.
        let found = control(&[Some(true), None, None], &[Some(true), Some(true), None]);
        assert_eq!((found.fails_only_in_space, found.fails_only_in_control), (1, 0));
        assert_eq!(found.difference.n, 3);
        // 35 of 100 have no verdict with the perturbation and nothing else fails: McNemar's test of
        // 35 against 0.
        let space: Vec<Option<bool>> = (0..100).map(|index| (index >= 35).then_some(true)).collect();
        let found = control(&space, &[Some(true); 100]);
        assert_eq!((found.difference.value, found.fails_only_in_space), (Some(-0.35), 35));
        assert!((found.p_value - 2.0 * 0.5_f64.powi(35)).abs() < 1e-15);
    }

    #[test]
    fn one_simulation_is_no_sample_of_its_pairs() {
        let pairs = Pairs { random: vec![outcome(Some(true)); 60], control: vec![outcome(Some(true))] };
        let found = pairs.result(&[], true, false).expect("the arm has a simulation");
        let Estimate { value, low, high, n } = found.success_rate;
        assert_eq!((value, low, high, n), (Some(1.0), None, None, 1));
        assert_eq!(found.difference.n, 60);
    }

    #[test]
    fn an_arm_without_any_verdict_shows_nothing() {
        let found = control(&[Some(true), Some(false), None, Some(true), Some(true)], &[None; 5]);
        assert_eq!((found.success_rate.value, found.difference.value, found.left_out), (None, None, 5));
    }

    #[test]
    fn a_pair_whose_scenario_cannot_start_is_left_out() {
        let start = Outcome { counts: false, ..outcome(None) };
        let pairs = Pairs {
            random: vec![outcome(Some(true)), start, outcome(Some(false))],
            control: vec![outcome(Some(true)); 3],
        };
        let found = pairs.result(&[], false, false).expect("the arm has simulations");
        assert_eq!((found.left_out, found.difference.n, found.fails_only_in_space), (1, 2, 1));
    }

    #[test]
    fn the_first_simulation_of_an_unfinished_arm_is_paired_with_its_own_only() {
        assert_eq!(control(&[Some(true); 5], &[Some(true)]).difference.n, 1);
    }
}
