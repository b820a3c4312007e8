//! Disturbances between environment and controller, which every environment supports: biases and
//! offsets of observations and actions, delays, faults, and explicit draws of the action noise.

use std::ops::Range;
use std::sync::Arc;

use crate::delay::{DelayLine, Lateness};
use crate::fault::{ActiveFault, FaultSite, Fill, Parameter, Side};
use crate::memory::Memory;
use crate::real::Real;
use crate::{Axis, Noise, RolloutError, Scenario, Seed, Space, Stream};

/// An axis whose value disturbs observations or actions.
#[derive(Clone, Debug, PartialEq)]
pub struct Disturbance {
    /// The axis. Its value has no effect if it is nominal.
    pub axis: Axis,
    /// The effect of its value.
    pub effect: Effect,
}

/// Effect of the value of an axis on observations or actions.
#[derive(Clone, Debug, PartialEq)]
pub enum Effect {
    /// Adds the value to one entry of the controller's observation before the noise.
    Observation {
        /// Index of the entry.
        entry: usize,
        /// Factor from the unit of the value to that of the entry.
        factor: f64,
        /// Weight of the value in each control step.
        profile: TimeProfile,
    },
    /// Adds white noise to entries of the controller's observation. The value is the standard
    /// deviation.
    ObservationNoise {
        /// Index of each entry, and the factor from the unit of the value to that of the entry.
        entries: Vec<(usize, f64)>,
    },
    /// Adds the value to one entry of the clipped and delayed action, before the noise.
    Action {
        /// Index of the entry.
        entry: usize,
        /// Weight of the value in each control step.
        profile: TimeProfile,
    },
    /// Delays observations by this number of control steps. The first observation fills the gap at
    /// the start.
    ObservationDelay,
    /// Largest additional delay of observations, control steps, drawn in each control step.
    ObservationJitter,
    /// Number of control steps between two observations. Each is repeated until the next one.
    ObservationPeriod,
    /// Delays actions by this number of control steps. Actions of 0 fill the gap at the start.
    ActionDelay,
    /// Largest additional delay of actions, control steps, drawn in each control step.
    ActionJitter,
    /// Sets the mean of the action noise of one entry over these n control steps.
    ///
    /// The value is in units of the standard deviation of that mean, 1 / sqrt(n). The draws keep
    /// their deviations from the mean. The mean of independent normal draws is independent of the
    /// deviations, so a standard normal value leaves the distribution of the noise unchanged.
    ActionDraw {
        /// Index of the entry.
        entry: usize,
        /// Control steps, from 0.
        steps: Range<usize>,
    },
    /// Sets a parameter of a fault.
    Fault {
        /// Place of the fault.
        site: Arc<FaultSite>,
        /// The parameter.
        parameter: Parameter,
    },
}

impl Effect {
    /// Returns whether an episode depends on its seed if the value is not nominal.
    pub fn is_random(&self) -> bool {
        match self {
            Effect::ObservationNoise { .. } | Effect::ObservationJitter | Effect::ActionJitter => true,
            Effect::Fault { parameter, .. } => parameter.is_random(),
            _ => false,
        }
    }

    /// Returns the control step before which no value has an effect.
    pub fn first_step(&self) -> usize {
        match self {
            Effect::Observation { profile, .. } | Effect::Action { profile, .. } => profile.begin(),
            Effect::ActionDraw { steps, .. } => steps.start,
            _ => 0,
        }
    }

    /// Returns the lowest value of the axis under which the controller can see NaN; `None` if it
    /// never does.
    pub(crate) fn first_not_a_number(&self) -> Option<f64> {
        let Effect::Fault { site, parameter: Parameter::Filling } = self else { return None };
        site.fills().iter().position(|(fill, _)| *fill == Fill::NotANumber).map(|number| number as f64)
    }
}

/// Weight of a disturbance in each control step, counted from 0.
#[derive(Clone, Debug, PartialEq)]
pub enum TimeProfile {
    /// 1 in these control steps: a bias, or a segment of a piecewise-constant disturbance.
    Constant(Range<usize>),
    /// 1 at a knot, linear to 0 at the adjacent knots. The sum over all knots interpolates linearly
    /// between their values.
    Linear {
        /// Control step of the previous knot; equals `at` for the first knot.
        before: usize,
        /// Control step of the knot.
        at: usize,
        /// Control step of the next knot; equals `at` for the last knot.
        after: usize,
    },
}

impl TimeProfile {
    /// Returns the first control step with a weight above 0.
    pub(crate) fn begin(&self) -> usize {
        match self {
            TimeProfile::Constant(steps) => steps.start,
            TimeProfile::Linear { before, at, .. } => (before + 1).min(*at),
        }
    }

    /// Returns the weight in a control step.
    pub fn weight(&self, step: usize) -> f64 {
        match self {
            TimeProfile::Constant(steps) => f64::from(u8::from(steps.contains(&step))),
            TimeProfile::Linear { at, .. } if step == *at => 1.0,
            TimeProfile::Linear { before, at, .. } if (*before..*at).contains(&step) => {
                (step - before) as f64 / (at - before) as f64
            }
            TimeProfile::Linear { at, after, .. } if (*at..*after).contains(&step) => {
                (after - step) as f64 / (after - at) as f64
            }
            TimeProfile::Linear { .. } => 0.0,
        }
    }
}

/// Routes each value of a scenario to the environment or to a disturbance.
#[derive(Clone, Debug)]
pub(crate) struct AxisRouting {
    /// Index in the scenario of each axis of the environment.
    environment: Vec<usize>,
    /// Index in the scenario and effect of each disturbance.
    effects: Vec<(usize, Effect)>,
}

impl AxisRouting {
    /// Routes each axis of `space` to the axis of the environment or the disturbance of the same
    /// name.
    ///
    /// # Errors
    /// If the name of an axis is unknown, or an axis of the environment is missing from `space`.
    pub(crate) fn new(
        space: &Space,
        environment: &Space,
        disturbances: &[Disturbance],
    ) -> Result<AxisRouting, RolloutError> {
        let place = |name: &str| space.axes().iter().position(|axis| axis.name == name);
        let missing =
            |axis: &str| RolloutError::Axis { axis: axis.to_string(), what: "the system has no such axis" };
        let known = |name: &str| {
            environment
                .axes()
                .iter()
                .chain(disturbances.iter().map(|d| &d.axis))
                .any(|axis| axis.name == name)
        };
        if let Some(axis) = space.axes().iter().find(|axis| !known(&axis.name)) {
            return Err(missing(&axis.name));
        }
        let find = |axis: &Axis| place(&axis.name).ok_or_else(|| missing(&axis.name));
        let effects = disturbances.iter().filter_map(|d| Some((place(&d.axis.name)?, d.effect.clone())));
        Ok(AxisRouting {
            environment: environment.axes().iter().map(find).collect::<Result<_, _>>()?,
            effects: effects.collect(),
        })
    }

    /// Returns the index in the scenario and the effect of each disturbance, in the order in which
    /// they are added.
    pub(crate) fn effects(&self) -> &[(usize, Effect)] {
        &self.effects
    }

    /// Returns whether the environment also reads the value at this index of a scenario.
    pub(crate) fn is_of_environment(&self, place: usize) -> bool {
        self.environment.contains(&place)
    }

    /// Returns whether the space has an axis of a disturbance.
    pub(crate) fn has_effects(&self) -> bool {
        !self.effects.is_empty()
    }

    /// Returns the environment's part of a scenario.
    pub(crate) fn environment(&self, scenario: &Scenario) -> Scenario {
        Scenario::new(self.environment.iter().map(|place| scenario.get(*place)).collect())
    }
}

/// Disturbances of one simulation, with its delayed observations and actions.
#[derive(Debug)]
pub(crate) struct ActiveDisturbances {
    observation: Vec<Offset>,
    action: Vec<Offset>,
    /// Entry and standard deviation of the sensor noise.
    sensor_noise: Vec<(usize, f64)>,
    /// Scratch buffer of the draws of the sensor noise.
    sensor_draws: Vec<f64>,
    seed: Seed,
    draws: Vec<Shift>,
    observation_lateness: Lateness,
    action_lateness: Lateness,
    past_observations: DelayLine,
    past_actions: DelayLine,
    /// Faults in the order of their application.
    faults: Vec<ActiveFault>,
}

/// An offset of an entry of the observation or of the action.
#[derive(Debug, Clone, PartialEq)]
struct Offset {
    /// Index in the scenario of its axis.
    place: usize,
    entry: usize,
    profile: TimeProfile,
    value: f64,
}

/// A shift of the draws of the action noise of an entry in some control steps.
#[derive(Debug, Clone, PartialEq)]
struct Shift {
    /// Index in the scenario of its axis.
    place: usize,
    entry: usize,
    steps: Range<usize>,
    shift: f64,
}

/// Indices of the random numbers of late observations and actions in [`Stream::Delay`].
const LATE_OBSERVATIONS: u32 = 0;
const LATE_ACTIONS: u32 = 1;

impl Offset {
    fn acts(&self) -> bool {
        self.value != 0.0
    }
}

impl ActiveDisturbances {
    /// Returns the disturbances of a scenario. Nominal values have no effect.
    pub(crate) fn new(
        routing: &AxisRouting,
        scenario: &Scenario,
        seed: Seed,
        action_size: usize,
    ) -> ActiveDisturbances {
        let mut disturbed = ActiveDisturbances {
            observation: Vec::new(),
            action: Vec::new(),
            sensor_noise: Vec::new(),
            sensor_draws: Vec::new(),
            seed,
            draws: Vec::new(),
            observation_lateness: Lateness::default(),
            action_lateness: Lateness::default(),
            past_observations: DelayLine::default(),
            past_actions: DelayLine::default(),
            faults: Vec::new(),
        };
        let mut faults: Vec<(&Arc<FaultSite>, [f64; Parameter::COUNT])> = Vec::new();
        for (place, effect) in &routing.effects {
            let Some(value) = scenario.get(*place) else { continue };
            match effect {
                Effect::ActionDraw { entry, steps } => {
                    let shift = draw_shift(seed, *entry, steps, value, action_size);
                    let place = *place;
                    let entry = *entry;
                    let steps = steps.clone();
                    disturbed.draws.push(Shift { place, entry, steps, shift });
                }
                Effect::Fault { site, parameter } => {
                    let index = faults.iter().position(|(known, _)| Arc::ptr_eq(known, site));
                    let index = index.unwrap_or_else(|| {
                        faults.push((site, Parameter::nominal_values()));
                        faults.len() - 1
                    });
                    faults[index].1[*parameter as usize] = value;
                }
                // An offset of 0 may be replaced while the simulation runs.
                Effect::Action { entry, profile } => {
                    let place = *place;
                    let entry = *entry;
                    let profile = profile.clone();
                    disturbed.action.push(Offset { place, entry, profile, value });
                }
                _ if value == 0.0 => {}
                Effect::Observation { entry, factor, profile } => {
                    let place = *place;
                    let entry = *entry;
                    let profile = profile.clone();
                    disturbed.observation.push(Offset { place, entry, profile, value: factor * value });
                }
                Effect::ObservationNoise { entries } => {
                    disturbed
                        .sensor_noise
                        .extend(entries.iter().map(|(entry, factor)| (*entry, factor * value)));
                }
                Effect::ObservationDelay => disturbed.observation_lateness.delay = value as usize,
                Effect::ObservationJitter => disturbed.observation_lateness.jitter = value as usize,
                Effect::ObservationPeriod => disturbed.observation_lateness.skipped = value as usize - 1,
                Effect::ActionDelay => disturbed.action_lateness.delay = value as usize,
                Effect::ActionJitter => disturbed.action_lateness.jitter = value as usize,
            }
        }
        faults.sort_by_key(|(site, _)| site.number);
        let active = |(site, values): &(&Arc<FaultSite>, _)| ActiveFault::new(Arc::clone(site), values, seed);
        disturbed.faults = faults.iter().filter_map(active).collect();
        disturbed
    }

    /// Replaces the value at index `place` of the scenario, which offsets actions or shifts draws,
    /// from this control step on.
    pub(crate) fn set(&mut self, place: usize, value: f64, action_size: usize) {
        let offsets = self.action.iter_mut().filter(|offset| offset.place == place);
        offsets.for_each(|offset| offset.value = value);
        for Shift { entry, steps, shift, .. } in self.draws.iter_mut().filter(|draw| draw.place == place) {
            *shift = draw_shift(self.seed, *entry, steps, value, action_size);
        }
    }

    /// Replaces `observation` by the observation of control step `step` with its disturbances, but
    /// without faults.
    pub(crate) fn observe<T: Real>(&mut self, step: usize, observation: &mut [T]) {
        if !self.observation_lateness.is_none() {
            let line = &mut self.past_observations;
            let lateness = &self.observation_lateness;
            line.push(lateness, observation.iter().map(|value| value.to_f64()));
            let arrival = lateness.arrival(step, self.seed, Stream::Delay, LATE_OBSERVATIONS);
            let late = if line.show(arrival).is_some() { line.show(arrival) } else { line.oldest() };
            for (value, late) in observation.iter_mut().zip(late.unwrap_or_default()) {
                *value = T::nearest(*late);
            }
        }
        for Offset { entry, profile, value, .. } in &self.observation {
            let added = value * profile.weight(step);
            if added != 0.0 {
                observation[*entry] = observation[*entry].plus(added);
            }
        }
        if !self.sensor_noise.is_empty() {
            self.sensor_draws.resize(observation.len(), 0.0);
            self.seed.normals(Stream::SensorNoise, step as u64, &mut self.sensor_draws);
            for (entry, deviation) in &self.sensor_noise {
                observation[*entry] = observation[*entry].plus(deviation * self.sensor_draws[*entry]);
            }
        }
    }

    /// Replaces the clipped `action` by the action of control step `step` with its disturbances,
    /// but without faults. Returns whether an action has arrived; before the first one, it is 0.
    pub(crate) fn act(&mut self, step: usize, action: &mut [f64]) -> bool {
        let mut has_arrived = true;
        if !self.action_lateness.is_none() {
            self.past_actions.push(&self.action_lateness, action.iter().copied());
            let arrival = self.action_lateness.arrival(step, self.seed, Stream::Delay, LATE_ACTIONS);
            match self.past_actions.show(arrival) {
                Some(late) => action.copy_from_slice(late),
                None => {
                    action.fill(0.0);
                    has_arrived = false;
                }
            }
        }
        for Offset { entry, profile, value, .. } in self.action.iter().filter(|offset| offset.acts()) {
            let added = value * profile.weight(step);
            if added != 0.0 {
                action[*entry] += added;
            }
        }
        has_arrived
    }

    /// Applies the faults of one side in control step `step`, which come after everything else.
    /// Returns whether any acts in this step.
    pub(crate) fn fail<T: Real>(&mut self, side: Side, step: usize, values: &mut [T]) -> bool {
        let faults = self.faults.iter_mut().filter(|fault| fault.site().side == side);
        faults.fold(false, |acts, fault| fault.apply(step, values) | acts)
    }

    /// Returns whether actions are late or have offsets.
    pub(crate) fn disturbs_actions(&self) -> bool {
        !self.action_lateness.is_none() || self.action.iter().any(Offset::acts)
    }

    /// Returns whether the controller can pause in any control step.
    pub(crate) fn has_pause(&self) -> bool {
        self.faults.iter().any(ActiveFault::is_pause)
    }

    /// Returns whether a fault pauses the controller in a control step.
    pub(crate) fn is_paused(&self, step: usize) -> bool {
        self.faults.iter().any(|fault| fault.is_pausing(step))
    }

    /// Saves or restores what depends on earlier control steps.
    pub(crate) fn visit_memory(&mut self, memory: &mut dyn Memory) {
        self.past_observations.visit_memory(memory);
        self.past_actions.visit_memory(memory);
        self.faults.iter_mut().for_each(|fault| fault.visit_memory(memory));
    }

    /// Shifts the standard normal draws of control step `step` to their explicit mean.
    fn draw(&self, step: usize, draws: &mut [f64]) {
        for Shift { entry, steps, shift, .. } in &self.draws {
            if steps.contains(&step) {
                draws[*entry] += shift;
            }
        }
    }
}

/// Replaces the clipped `action` by the one that the environment gets in a control step: with its
/// disturbances, then noise, then faults. `draws` is a scratch buffer of the same length. Returns
/// whether an action has arrived.
pub(crate) fn command(
    mut disturbed: Option<&mut ActiveDisturbances>,
    noise: Noise,
    seed: Seed,
    step: usize,
    action: &mut [f64],
    draws: &mut [f64],
) -> bool {
    let has_arrived = disturbed.as_mut().is_none_or(|disturbed| disturbed.act(step, action));
    noise.on_action(seed, step as u64, action, draws, |draws| {
        if let Some(disturbed) = &disturbed {
            disturbed.draw(step, draws);
        }
    });
    if let Some(disturbed) = disturbed {
        disturbed.fail(Side::Actuation, step, action);
    }
    has_arrived
}

/// Returns what is added to the action noise's standard normal draws of one entry over some control
/// steps, so that their mean is `value` standard deviations of a mean.
fn draw_shift(seed: Seed, entry: usize, steps: &Range<usize>, value: f64, action_size: usize) -> f64 {
    let count = steps.len() as f64;
    value / count.sqrt() - mean_draw(seed, entry, steps, action_size)
}

/// Returns the mean of the action noise's standard normal draws of one entry over some control
/// steps.
fn mean_draw(seed: Seed, entry: usize, steps: &Range<usize>, action_size: usize) -> f64 {
    let mut draws = vec![0.0; action_size];
    let mut sum = 0.0;
    for step in steps.clone() {
        seed.normals(Stream::ActionNoise, step as u64, &mut draws);
        sum += draws[entry];
    }
    sum / steps.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::AxisKind;

    #[test]
    fn linear_knots_interpolate_between_their_values() {
        // Knots at 0, 10 and 30 with the values 2, 4 and 0.
        let knots = [
            (TimeProfile::Linear { before: 0, at: 0, after: 10 }, 2.0),
            (TimeProfile::Linear { before: 0, at: 10, after: 30 }, 4.0),
            (TimeProfile::Linear { before: 10, at: 30, after: 30 }, 0.0),
        ];
        let at = |step| knots.iter().map(|(profile, value)| profile.weight(step) * value).sum::<f64>();
        assert_eq!([0, 5, 10, 20, 30, 31].map(at), [2.0, 3.0, 4.0, 2.0, 0.0, 0.0]);
        let segment = TimeProfile::Constant(3..5);
        assert_eq!([2, 3, 4, 5].map(|step| segment.weight(step)), [0.0, 1.0, 1.0, 0.0]);
    }

    fn disturbed(effect: Effect, value: f64) -> ActiveDisturbances {
        let axis = Axis::new(AxisKind::Model, "a", "", [0.0, 9.0], Some(0.0));
        let space = Space::new("s", vec![axis.clone()]).unwrap();
        let none = Space::new("none", vec![]).unwrap();
        let routing = AxisRouting::new(&space, &none, &[Disturbance { axis, effect }]).unwrap();
        ActiveDisturbances::new(&routing, &[value].into(), Seed(4), 2)
    }

    #[test]
    fn an_observation_delay_repeats_the_first_observation_at_the_start() {
        let mut disturbed = disturbed(Effect::ObservationDelay, 2.0);
        let observed: Vec<f32> = (0..6)
            .map(|step| {
                let mut observation = [step as f32];
                disturbed.observe(step, &mut observation);
                observation[0]
            })
            .collect();
        assert_eq!(observed, [0.0, 0.0, 0.0, 1.0, 2.0, 3.0]);
    }

    #[test]
    fn an_action_delay_fills_the_start_with_zeros() {
        let mut disturbed = disturbed(Effect::ActionDelay, 2.0);
        let applied: Vec<f64> = (0..6)
            .map(|step| {
                let mut action = [f64::from(step + 1), 0.0];
                disturbed.act(step as usize, &mut action);
                action[0]
            })
            .collect();
        assert_eq!(applied, [0.0, 0.0, 1.0, 2.0, 3.0, 4.0]);
    }

    #[test]
    fn an_explicit_draw_sets_the_mean_and_keeps_the_deviations_from_it() {
        let disturbed = disturbed(Effect::ActionDraw { entry: 1, steps: 10..19 }, 1.5);
        let draws = |step: usize| {
            let mut draws = [0.0; 2];
            Seed(4).normals(Stream::ActionNoise, step as u64, &mut draws);
            let drawn = draws;
            disturbed.draw(step, &mut draws);
            assert_eq!(draws[0].to_bits(), drawn[0].to_bits(), "the other entry is untouched");
            (drawn[1], draws[1])
        };
        let segment: Vec<(f64, f64)> = (10..19).map(draws).collect();
        let mean = segment.iter().map(|(_, after)| after).sum::<f64>() / 9.0;
        assert!((mean - 1.5 / 3.0).abs() < 1e-12, "1.5 standard deviations of 1 / sqrt(9): {mean}");
        let shift = segment[0].1 - segment[0].0;
        assert!(segment.iter().all(|(before, after)| (after - before - shift).abs() < 1e-12));
        let (before, after) = draws(19);
        assert_eq!(before.to_bits(), after.to_bits());
    }

    #[test]
    fn a_value_that_is_set_later_is_that_of_the_scenario() {
        let profile = TimeProfile::Constant(10..19);
        for effect in [Effect::ActionDraw { entry: 1, steps: 10..19 }, Effect::Action { entry: 1, profile }] {
            let mut set = disturbed(effect.clone(), 0.0);
            let given = disturbed(effect.clone(), 1.5);
            set.set(0, 1.5, 2);
            assert_eq!((&set.action, &set.draws), (&given.action, &given.draws), "{effect:?}");
            assert_eq!(set.disturbs_actions(), given.disturbs_actions());
        }
    }

    #[test]
    fn an_unknown_and_a_missing_axis_are_errors() {
        let none = Space::new("none", vec![]).unwrap();
        let space = Space::new("s", vec![Axis::start("wind", "m/s", 0.0, 1.0)]).unwrap();
        let error = AxisRouting::new(&space, &none, &[]).unwrap_err().to_string();
        assert!(error.contains("wind"), "{error}");
        let missing = AxisRouting::new(&none, &space, &[]).unwrap_err().to_string();
        assert!(missing.contains("wind"), "{missing}");
    }
}
