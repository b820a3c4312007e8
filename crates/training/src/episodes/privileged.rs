//! Privileged inputs of critics: what the environment knows and the policy does not see.

use mishandle_rollout::{Axis, AxisValues, Scenario, Space, StepStatus};

use crate::{Checkpoint, TrainingError};

/// Privileged inputs of all rows: the observation of the environment, without noise and
/// disturbances, and the values of the scenario.
pub(super) struct Privileged {
    axes: Vec<Scale>,
    observation_size: usize,
    /// Values of the scenario of each row, `[rows, ..]`.
    scenarios: Vec<f32>,
    /// Inputs before the last control step, `[rows, size]`.
    pub before: Vec<f32>,
    /// Current inputs; after a reset, those of the new episode.
    pub current: Vec<f32>,
    /// Inputs after the last control step and before any reset.
    pub last: Vec<f32>,
}

/// The numbers of an axis.
enum Scale {
    /// A number from -1 to 1 between the bounds, linear or logarithmic.
    Number { low: f64, high: f64, is_logarithmic: bool },
    /// 1 for the category of the episode, 0 for all others. Categories have no order, so that a
    /// scaled index would make those with near numbers alike.
    Category { low: f64, count: usize },
}

impl Scale {
    fn new(axis: &Axis) -> Scale {
        // An axis without an effect is nominal, and so is every axis in a nominal episode: also if
        // the bounds exclude it.
        let nominal = axis.nominal.unwrap_or(axis.low);
        match &axis.values {
            AxisValues::Categorical(_) => {
                Scale::Category { low: axis.low, count: axis.levels().unwrap_or(1) }
            }
            values => Scale::Number {
                low: axis.low.min(nominal),
                high: axis.high.max(nominal),
                is_logarithmic: *values == AxisValues::Logarithmic && nominal > 0.0,
            },
        }
    }

    /// Returns how many numbers [`write`](Self::write) writes.
    fn size(&self) -> usize {
        match self {
            Scale::Number { .. } => 1,
            Scale::Category { count, .. } => *count,
        }
    }

    /// Writes a value; a random one, which is `None`, as 0.
    fn write(&self, value: Option<f64>, out: &mut [f32]) {
        out.fill(0.0);
        let Some(value) = value else { return };
        match *self {
            Scale::Number { low, high, .. } if low == high => {}
            Scale::Number { low, high, is_logarithmic } => {
                let position = if is_logarithmic { f64::ln } else { |x: f64| x };
                let share = (position(value) - position(low)) / (position(high) - position(low));
                // A given initial state may be outside of its bounds.
                out[0] = (2.0 * share - 1.0).clamp(-1.0, 1.0) as f32;
            }
            Scale::Category { low, .. } => {
                if let Some(own) = out.get_mut((value - low).max(-1.0) as usize).filter(|_| value >= low) {
                    *own = 1.0;
                }
            }
        }
    }
}

impl Privileged {
    /// Makes the inputs of `rows` rows that have no episode yet.
    pub fn new(space: &Space, rows: usize, observation_size: usize) -> Privileged {
        let axes: Vec<Scale> = space.axes().iter().map(Scale::new).collect();
        let of_scenario = axes.iter().map(Scale::size).sum::<usize>();
        let inputs = vec![0.0; rows * (observation_size + of_scenario)];
        Privileged {
            axes,
            observation_size,
            scenarios: vec![0.0; rows * of_scenario],
            before: inputs.clone(),
            current: inputs.clone(),
            last: inputs,
        }
    }

    /// Returns the length of a row.
    pub fn size(&self) -> usize {
        self.observation_size + self.scenario_size()
    }

    fn scenario_size(&self) -> usize {
        self.axes.iter().map(Scale::size).sum()
    }

    /// Starts an episode in a row.
    pub fn start(&mut self, row: usize, scenario: &Scenario) {
        let size = self.scenario_size();
        let mut rest = &mut self.scenarios[row * size..][..size];
        for (axis, value) in self.axes.iter().zip(scenario.values()) {
            let (own, others) = rest.split_at_mut(axis.size());
            axis.write(*value, own);
            rest = others;
        }
    }

    /// Keeps the inputs before a control step.
    pub fn begin_step(&mut self) {
        self.before.copy_from_slice(&self.current);
    }

    /// Sets the inputs after a control step from the observations of the environment. A row that
    /// diverged keeps those from before the step.
    pub fn end_step(&mut self, observations: &[f32], statuses: &[StepStatus]) {
        let size = self.size();
        self.show(observations);
        let rows = self.last.chunks_exact_mut(size).zip(self.current.chunks_exact(size));
        for (((last, current), before), status) in rows.zip(self.before.chunks_exact(size)).zip(statuses) {
            last.copy_from_slice(if *status == StepStatus::Diverged { before } else { current });
        }
    }

    /// Sets the current inputs from the observations of the environment.
    pub fn show(&mut self, observations: &[f32]) {
        let size = self.size();
        let own = self.scenario_size();
        let rows = self.current.chunks_exact_mut(size).zip(observations.chunks_exact(self.observation_size));
        for (index, (current, observation)) in rows.enumerate() {
            let (seen, scenario) = current.split_at_mut(self.observation_size);
            seen.copy_from_slice(observation);
            scenario.copy_from_slice(&self.scenarios[index * own..][..own]);
        }
    }

    /// Saves the scenarios to a checkpoint.
    pub fn save(&self, checkpoint: &mut Checkpoint) {
        checkpoint.put("privileged.scenarios", self.scenarios.clone());
    }

    /// Restores the inputs from a checkpoint and the observations of the environment.
    ///
    /// # Errors
    /// If the checkpoint contains an array of another size.
    pub fn load(&mut self, checkpoint: &Checkpoint, observations: &[f32]) -> Result<(), TrainingError> {
        let saved = checkpoint.f32s("privileged.scenarios", self.scenarios.len())?;
        self.scenarios.copy_from_slice(saved);
        self.show(observations);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mishandle_rollout::AxisKind;

    fn written(axis: &Axis, value: Option<f64>) -> Vec<f32> {
        let scale = Scale::new(axis);
        let mut out = vec![9.0; scale.size()];
        scale.write(value, &mut out);
        out
    }

    #[test]
    fn values_are_scaled_by_their_bounds_and_categories_have_a_number_each() {
        let axis = |values, bounds, nominal| {
            Axis::new(AxisKind::Model, "a", "", bounds, nominal).with_values(values)
        };
        let number = axis(AxisValues::Continuous, [0.5, 2.5], Some(1.0));
        assert_eq!([0.5, 1.0, 2.5].map(|x| written(&number, Some(x))[0]), [-1.0, -0.5, 1.0]);
        assert_eq!(written(&number, Some(7.0)), [1.0]);
        assert_eq!(written(&number, None), [0.0]);
        let delay = axis(AxisValues::Integer, [0.0, 4.0], Some(0.0));
        assert_eq!([0.0, 1.0, 4.0].map(|x| written(&delay, Some(x))[0]), [-1.0, -0.5, 1.0]);
        let factor = axis(AxisValues::Logarithmic, [0.25, 4.0], Some(1.0));
        assert_eq!([0.25, 1.0, 2.0].map(|x| written(&factor, Some(x))[0]), [-1.0, 0.0, 0.5]);
        // The bounds exclude the nominal value.
        let narrow = axis(AxisValues::Integer, [2.0, 4.0], Some(0.0));
        assert_eq!([0.0, 2.0, 4.0].map(|x| written(&narrow, Some(x))[0]), [-1.0, 0.0, 1.0]);
        let fixed = axis(AxisValues::Continuous, [2.0, 2.0], Some(2.0));
        assert_eq!(written(&fixed, Some(2.0)), [0.0]);
        let names = ["none", "freeze", "bias"].map(String::from);
        let kind = axis(AxisValues::Categorical(names.into()), [0.0, 2.0], Some(0.0));
        assert_eq!(written(&kind, Some(1.0)), [0.0, 1.0, 0.0]);
        let part = Axis { low: 1.0, ..kind };
        assert_eq!(written(&part, Some(2.0)), [0.0, 1.0]);
        assert_eq!(written(&part, Some(0.0)), [0.0, 0.0], "nominal, which the bounds exclude");
    }
}
