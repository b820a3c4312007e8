//! Axes that act between environment and controller, so that every environment has them: biases and disturbances of
//! observations and actions, delays, and explicit draws of the action noise.

use std::collections::VecDeque;
use std::ops::Range;

use crate::{Axis, RolloutError, Scenario, Seed, Space, Stream};

/// An axis and what its value does to the loop of observation and action.
#[derive(Clone, Debug, PartialEq)]
pub struct Disturbance {
    /// The axis. Its nominal value is 0, or absent for an explicit draw.
    pub axis: Axis,
    /// What its value does.
    pub effect: Effect,
}

/// What the value of an axis does to the loop of observation and action.
#[derive(Clone, Debug, PartialEq)]
pub enum Effect {
    /// Adds to one entry of the observation that the controller sees, in the observation's unit, before noise.
    Observation {
        /// Index of the entry.
        entry: usize,
        /// When, and with which weight.
        shape: Shape,
    },
    /// Adds to one entry of the action after it has been clipped and delayed, before noise.
    Action {
        /// Index of the entry.
        entry: usize,
        /// When, and with which weight.
        shape: Shape,
    },
    /// The controller sees what was observed so many control steps ago; before that, the first observation.
    ObservationDelay,
    /// The environment gets the action of so many control steps ago; before that, an action of 0.
    ActionDelay,
    /// Sets the mean of the action noise's draws for one entry over these control steps, in units of that mean's own
    /// standard deviation 1 / sqrt(n). The draws keep their deviations from the mean, which is independent of them, so a
    /// value drawn from a standard normal law leaves the law of the noise as it is.
    ActionDraw {
        /// Index of the entry.
        entry: usize,
        /// Control steps, from 0.
        steps: Range<usize>,
    },
}

/// The weight of a disturbance in each control step, counted from 0.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// 1 in these control steps: a segment of a piecewise-constant disturbance, or a bias.
    Constant(Range<usize>),
    /// 1 at the knot, falling linearly to 0 at the knots beside it: the sum over knots interpolates linearly.
    Linear {
        /// The knot before, or the same.
        before: usize,
        /// The knot.
        at: usize,
        /// The knot after, or the same.
        after: usize,
    },
}

impl Shape {
    /// The weight in a control step.
    pub fn weight(&self, step: usize) -> f64 {
        match self {
            Shape::Constant(steps) => f64::from(u8::from(steps.contains(&step))),
            Shape::Linear { at, .. } if step == *at => 1.0,
            Shape::Linear { before, at, .. } if (*before..*at).contains(&step) => {
                (step - before) as f64 / (at - before) as f64
            }
            Shape::Linear { at, after, .. } if (*at..*after).contains(&step) => {
                (after - step) as f64 / (after - at) as f64
            }
            Shape::Linear { .. } => 0.0,
        }
    }
}

/// Which value of a scenario goes where: to the environment, or to an effect in the loop.
#[derive(Clone, Debug)]
pub(crate) struct Wiring {
    /// For each axis of the environment its place in a scenario.
    environment: Vec<usize>,
    /// Places in a scenario and what is done with the values there.
    effects: Vec<(usize, Effect)>,
}

impl Wiring {
    /// Sends each axis of `space` to the environment's axis of that name, or else to the disturbance of that name.
    pub(crate) fn new(
        space: &Space,
        environment: &Space,
        disturbances: &[Disturbance],
    ) -> Result<Wiring, RolloutError> {
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
        Ok(Wiring {
            environment: environment.axes().iter().map(find).collect::<Result<_, _>>()?,
            effects: effects.collect(),
        })
    }

    /// Whether anything is to be done in the loop.
    pub(crate) fn has_effects(&self) -> bool {
        !self.effects.is_empty()
    }

    /// The environment's part of a scenario.
    pub(crate) fn environment(&self, scenario: &Scenario) -> Scenario {
        Scenario::new(self.environment.iter().map(|place| scenario.get(*place)).collect())
    }
}

/// The effects on one simulation, with the delayed observations and actions that belong to its state.
#[derive(Debug, Default)]
pub(crate) struct Disturbed {
    /// Entry, shape and value of what is added.
    observation: Vec<(usize, Shape, f64)>,
    action: Vec<(usize, Shape, f64)>,
    /// Entry, control steps and what is added to each draw.
    draws: Vec<(usize, Range<usize>, f64)>,
    observation_delay: usize,
    action_delay: usize,
    past_observations: VecDeque<Vec<f32>>,
    past_actions: VecDeque<Vec<f64>>,
}

impl Disturbed {
    /// The effects of a scenario; what is nominal has none.
    pub(crate) fn new(wiring: &Wiring, scenario: &Scenario, seed: Seed, action_size: usize) -> Disturbed {
        let mut disturbed = Disturbed::default();
        for (place, effect) in &wiring.effects {
            let Some(value) = scenario.get(*place) else { continue };
            match effect {
                Effect::ActionDraw { entry, steps } => {
                    let count = steps.len() as f64;
                    let mean = mean_draw(seed, *entry, steps, action_size);
                    disturbed.draws.push((*entry, steps.clone(), value / count.sqrt() - mean));
                }
                _ if value == 0.0 => {}
                Effect::Observation { entry, shape } => {
                    disturbed.observation.push((*entry, shape.clone(), value));
                }
                Effect::Action { entry, shape } => disturbed.action.push((*entry, shape.clone(), value)),
                Effect::ObservationDelay => disturbed.observation_delay = value as usize,
                Effect::ActionDelay => disturbed.action_delay = value as usize,
            }
        }
        disturbed
    }

    /// What the controller sees in control step `step` in place of `observation`.
    pub(crate) fn observe(&mut self, step: usize, observation: &mut [f32]) {
        if self.observation_delay > 0 {
            // The oldest one makes room for the newest, so that nothing is allocated once there are enough.
            let full = self.past_observations.len() > self.observation_delay;
            let oldest = if full { self.past_observations.pop_front() } else { None };
            let mut newest = oldest.unwrap_or_else(|| vec![0.0; observation.len()]);
            newest.copy_from_slice(observation);
            self.past_observations.push_back(newest);
            observation.copy_from_slice(&self.past_observations[0]);
        }
        for (entry, shape, value) in &self.observation {
            let added = value * shape.weight(step);
            if added != 0.0 {
                observation[*entry] += added as f32;
            }
        }
    }

    /// What the environment gets in control step `step` in place of the clipped `action`.
    pub(crate) fn act(&mut self, step: usize, action: &mut [f64]) {
        if self.action_delay > 0 {
            let full = self.past_actions.len() == self.action_delay;
            let oldest = if full { self.past_actions.pop_front() } else { None };
            let mut oldest = oldest.unwrap_or_else(|| vec![0.0; action.len()]);
            action.swap_with_slice(&mut oldest);
            self.past_actions.push_back(oldest);
        }
        for (entry, shape, value) in &self.action {
            let added = value * shape.weight(step);
            if added != 0.0 {
                action[*entry] += added;
            }
        }
    }

    /// Makes explicit what was drawn for control step `step`.
    pub(crate) fn draw(&self, step: usize, draws: &mut [f64]) {
        for (entry, steps, shift) in &self.draws {
            if steps.contains(&step) {
                draws[*entry] += shift;
            }
        }
    }
}

/// The mean of the action noise's draws for one entry over some control steps.
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
            (Shape::Linear { before: 0, at: 0, after: 10 }, 2.0),
            (Shape::Linear { before: 0, at: 10, after: 30 }, 4.0),
            (Shape::Linear { before: 10, at: 30, after: 30 }, 0.0),
        ];
        let at = |step| knots.iter().map(|(shape, value)| shape.weight(step) * value).sum::<f64>();
        assert_eq!([0, 5, 10, 20, 30, 31].map(at), [2.0, 3.0, 4.0, 2.0, 0.0, 0.0]);
        let segment = Shape::Constant(3..5);
        assert_eq!([2, 3, 4, 5].map(|step| segment.weight(step)), [0.0, 1.0, 1.0, 0.0]);
    }

    fn disturbed(effect: Effect, value: f64) -> Disturbed {
        let axis = Axis::new(AxisKind::Model, "a", "", [0.0, 9.0], Some(0.0));
        let space = Space::new("s", vec![axis.clone()]).unwrap();
        let none = Space::new("none", vec![]).unwrap();
        let wiring = Wiring::new(&space, &none, &[Disturbance { axis, effect }]).unwrap();
        Disturbed::new(&wiring, &[value].into(), Seed(4), 2)
    }

    #[test]
    fn a_delay_shows_the_first_observation_until_an_older_one_is_there() {
        let mut disturbed = disturbed(Effect::ObservationDelay, 2.0);
        let seen: Vec<f32> = (0..6)
            .map(|step| {
                let mut observation = [step as f32];
                disturbed.observe(step, &mut observation);
                observation[0]
            })
            .collect();
        assert_eq!(seen, [0.0, 0.0, 0.0, 1.0, 2.0, 3.0]);
    }

    #[test]
    fn a_delayed_action_is_zero_until_the_first_one_arrives() {
        let mut disturbed = disturbed(Effect::ActionDelay, 2.0);
        let done: Vec<f64> = (1..7)
            .map(|step| {
                let mut action = [f64::from(step), 0.0];
                disturbed.act(step as usize, &mut action);
                action[0]
            })
            .collect();
        assert_eq!(done, [0.0, 0.0, 1.0, 2.0, 3.0, 4.0]);
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
    fn an_axis_that_nothing_takes_is_refused() {
        let none = Space::new("none", vec![]).unwrap();
        let space = Space::new("s", vec![Axis::start("wind", "m/s", 0.0, 1.0)]).unwrap();
        let error = Wiring::new(&space, &none, &[]).unwrap_err().to_string();
        assert!(error.contains("wind"), "{error}");
        let missing = Wiring::new(&none, &space, &[]).unwrap_err().to_string();
        assert!(missing.contains("wind"), "{missing}");
    }
}
