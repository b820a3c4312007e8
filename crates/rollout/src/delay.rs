//! Late observations and actions.

use std::collections::VecDeque;

use crate::memory::Memory;
use crate::{Axis, AxisKind, AxisValues, Disturbance, Effect, Seed, Stream};

/// Maximum delay, control steps: 50 ms at 60 control steps a second.
const MAX_DELAY: f64 = 3.0;

/// Largest number of control steps between two observations: 10 observations of 60 a second.
const MAX_PERIOD: f64 = 6.0;

/// Returns the axes of constant delays, of delays that vary during an episode, and of rare
/// observations.
pub fn delays() -> Vec<Disturbance> {
    let jitter = |value: &str| format!("largest additional delay of {value}, drawn in each control step");
    let axes = [
        ("action_delay", "delay between controller and robot".to_string(), Effect::ActionDelay),
        ("observation_delay", "delay between sensors and controller".to_string(), Effect::ObservationDelay),
        ("action_jitter", jitter("actions"), Effect::ActionJitter),
        ("observation_jitter", jitter("observations"), Effect::ObservationJitter),
        (
            "observation_period",
            "control steps between two observations".to_string(),
            Effect::ObservationPeriod,
        ),
    ];
    let disturbance = |(name, meaning, effect): (&str, String, Effect)| {
        let bounds = if effect == Effect::ObservationPeriod { [1.0, MAX_PERIOD] } else { [0.0, MAX_DELAY] };
        let axis = Axis::new(AxisKind::Model, name, "control steps", bounds, Some(bounds[0]));
        Disturbance { axis: axis.with_values(AxisValues::Integer).meaning(&meaning), effect }
    };
    axes.map(disturbance).into()
}

/// How late and how rarely values arrive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Lateness {
    /// Delay of every value, control steps.
    pub delay: usize,
    /// Largest additional delay, drawn in each control step.
    pub jitter: usize,
    /// Control steps between two values, minus 1.
    pub skipped: usize,
}

impl Lateness {
    pub(crate) fn is_none(&self) -> bool {
        *self == Lateness::default()
    }

    /// Returns the control step whose value arrives in control step `step`; `None` before the first
    /// one. `draw` is the index of the random numbers in their stream.
    pub(crate) fn arrival(&self, step: usize, seed: Seed, stream: Stream, draw: u32) -> Option<usize> {
        let jitter = match self.jitter {
            0 => 0,
            // A draw is below 1, but its product with a large number can be rounded up.
            most => ((seed.uniform(stream, step as u64, draw) * (most + 1) as f64) as usize).min(most),
        };
        let arrived = step.checked_sub(self.delay + jitter)?;
        Some(arrived - arrived % (self.skipped + 1))
    }

    /// Returns the largest age of a value that arrives.
    fn largest_age(&self) -> usize {
        self.delay + self.jitter + self.skipped
    }
}

/// The values of past control steps, of which one is shown. An older value is never shown after a
/// newer one.
#[derive(Debug, Default)]
pub(crate) struct DelayLine {
    past: VecDeque<Vec<f64>>,
    /// Number of control steps so far.
    count: usize,
    /// Control step of the value that is shown.
    shown: Option<usize>,
}

impl DelayLine {
    /// Keeps the values of the next control step. Buffers are reused, so that a full line does not
    /// allocate.
    pub(crate) fn push(&mut self, lateness: &Lateness, values: impl Iterator<Item = f64>) {
        let full = self.past.len() > lateness.largest_age();
        let mut newest = if full { self.past.pop_front() } else { None }.unwrap_or_default();
        newest.clear();
        newest.extend(values);
        self.past.push_back(newest);
        self.count += 1;
    }

    /// Returns the values of a control step, or of a newer one that was shown before; `None` if
    /// none has arrived.
    pub(crate) fn show(&mut self, arrival: Option<usize>) -> Option<&[f64]> {
        self.shown = self.shown.max(arrival);
        let first = self.count - self.past.len();
        self.past.get(self.shown?.saturating_sub(first)).map(Vec::as_slice)
    }

    /// Saves or restores the kept values.
    pub(crate) fn visit_memory(&mut self, memory: &mut dyn Memory) {
        memory.count(&mut self.count);
        let mut shown = self.shown.map_or(0, |step| step + 1);
        memory.count(&mut shown);
        self.shown = shown.checked_sub(1);
        let mut kept = self.past.len();
        memory.count(&mut kept);
        self.past.resize(kept, Vec::new());
        self.past.iter_mut().for_each(|values| memory.numbers(values));
    }

    /// Returns the oldest values that are kept.
    pub(crate) fn oldest(&self) -> Option<&[f64]> {
        self.past.front().map(Vec::as_slice)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Control step whose value is shown in each control step; `None` at the gap at the start.
    fn shown(lateness: Lateness, steps: usize) -> Vec<Option<usize>> {
        let mut line = DelayLine::default();
        let show = |step: usize| {
            line.push(&lateness, [step as f64].into_iter());
            let arrival = lateness.arrival(step, Seed(8), Stream::Delay, 0);
            line.show(arrival).map(|values| values[0] as usize)
        };
        (0..steps).map(show).collect()
    }

    #[test]
    fn a_lower_rate_repeats_each_value() {
        let third = shown(Lateness { skipped: 2, ..Lateness::default() }, 8);
        assert_eq!(third, [0, 0, 0, 3, 3, 3, 6, 6].map(Some));
        let late = shown(Lateness { delay: 1, skipped: 1, ..Lateness::default() }, 7);
        assert_eq!(late, [None, Some(0), Some(0), Some(2), Some(2), Some(4), Some(4)]);
    }

    #[test]
    fn jitter_delays_within_its_bounds_and_never_shows_an_older_value_again() {
        let lateness = Lateness { delay: 1, jitter: 3, skipped: 0 };
        let found = shown(lateness, 500);
        let ages: Vec<usize> = (4..500).map(|step| step - found[step].unwrap()).collect();
        assert!(ages.iter().all(|age| (1..=4).contains(age)));
        assert!((1..=4).all(|age| ages.contains(&age)), "all delays occur");
        assert!(found.windows(2).all(|pair| pair[0] <= pair[1]));
        assert_eq!(found, shown(lateness, 500), "the seed decides");
    }
}
