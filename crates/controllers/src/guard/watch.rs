use mishandle_stl::{Clock, Formula, OnlineMonitor};

use crate::guard::GuardError;

/// Numbers of a state before the samples of the monitor: whether the monitor has failed.
const FAILED: usize = 0;

/// The formula of a guard over quantities that arrive one sample at a time.
#[derive(Clone, Debug)]
pub struct Watch {
    formula: String,
    monitor: OnlineMonitor,
    /// The quantities that the formula reads, in the order of its samples.
    columns: Vec<usize>,
    /// Whether the formula reads no sample after the present one.
    is_past: bool,
    /// Length of the part of a state that the monitor writes.
    monitor_size: usize,
    sample: Vec<f64>,
}

impl Watch {
    /// Compiles a formula over quantities with these names, sampled with the period `control_dt`
    /// (s), in episodes of `episode_steps` control steps.
    ///
    /// # Errors
    /// If the formula reads an unknown quantity or none, its bounds do not fit the period, or it
    /// reads further ahead than an episode reaches.
    pub fn new(
        formula: &Formula,
        names: &[String],
        control_dt: f64,
        episode_steps: usize,
    ) -> Result<Watch, GuardError> {
        let error = |problem| GuardError::Formula { formula: formula.to_string(), problem };
        let clock = Clock::steps(control_dt);
        // All names, so that an unknown one is an error that lists them.
        OnlineMonitor::new(std::slice::from_ref(formula), names, clock, None).map_err(error)?;
        let read: Vec<String> = formula.signals().iter().map(ToString::to_string).collect();
        let columns = read.iter().filter_map(|name| names.iter().position(|known| known == name)).collect();
        let samples = episode_steps + 1;
        let monitor = OnlineMonitor::new(std::slice::from_ref(formula), &read, clock, Some(samples));
        let monitor = monitor.map_err(error)?;
        let (needed, is_unbounded) = monitor.needed_samples(0);
        if needed > samples {
            return Err(GuardError::TooLong {
                formula: formula.to_string(),
                needed: needed - 1,
                steps: episode_steps,
            });
        }
        let monitor_size = monitor.row_size(samples);
        let is_past = needed == 1 && !is_unbounded;
        let formula = formula.to_string();
        Ok(Watch { formula, columns, is_past, monitor_size, sample: vec![0.0; read.len()], monitor })
    }

    /// Returns the text of the formula.
    pub fn formula(&self) -> &str {
        &self.formula
    }

    /// Returns whether the formula reads no sample after the present one.
    pub fn is_past(&self) -> bool {
        self.is_past
    }

    /// Returns the length of a state.
    pub fn state_size(&self) -> usize {
        1 + self.columns.len() + self.monitor_size
    }

    /// Writes the state before the first sample.
    pub fn reset(&mut self, state: &mut [f64]) {
        self.monitor.reset();
        let (own, monitor) = state.split_at_mut(1 + self.columns.len());
        own.fill(0.0);
        self.monitor.save(monitor);
    }

    /// Adds a sample of all quantities to a trace, and returns the robustness that a guard compares
    /// with its threshold: that at the sample if the formula reads the past, otherwise the greatest
    /// robustness at time 0 over all continuations.
    ///
    /// A quantity that is NaN or infinite says nothing: the robustness is then -∞, and the last
    /// known sample takes the place of this one. So it is where arithmetic has no finite value.
    pub fn push(&mut self, state: &mut [f64], quantity: impl Fn(usize) -> f64) -> f64 {
        let (own, row) = state.split_at_mut(1 + self.columns.len());
        let (failed, last) = own.split_at_mut(1);
        if failed[FAILED] != 0.0 {
            return f64::NEG_INFINITY;
        }
        for (value, column) in self.sample.iter_mut().zip(&self.columns) {
            *value = quantity(*column);
        }
        self.monitor.restore(row);
        let before = self.monitor.len();
        let is_known = self.sample.iter().all(|value| value.is_finite());
        let is_pushed = is_known && self.monitor.push(&self.sample).is_ok();
        if is_pushed {
            last.copy_from_slice(&self.sample);
        } else if self.monitor.len() > before {
            // Arithmetic over time has no value any more.
            failed[FAILED] = 1.0;
            return f64::NEG_INFINITY;
        } else if before > 0 && self.monitor.push(last).is_err() {
            failed[FAILED] = 1.0;
            return f64::NEG_INFINITY;
        }
        let robustness = if self.is_past {
            self.monitor.decided(0).map_or(f64::NEG_INFINITY, |(_, value)| value)
        } else {
            self.monitor.bounds(0).high
        };
        self.monitor.save(row);
        if is_pushed { robustness } else { f64::NEG_INFINITY }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn watch(text: &str, steps: usize) -> Result<Watch, GuardError> {
        let formula = Formula::parse(text).expect("a formula");
        Watch::new(&formula, &["x".to_string(), "`y[1]`".to_string(), "y[1]".to_string()], 0.5, steps)
    }

    fn robustness(text: &str, samples: &[f64]) -> Vec<f64> {
        let mut watch = watch(text, 10).expect("a watch");
        let mut state = vec![f64::NAN; watch.state_size()];
        watch.reset(&mut state);
        samples.iter().map(|x| watch.push(&mut state, |column| if column == 0 { *x } else { 0.0 })).collect()
    }

    #[test]
    fn a_formula_of_the_past_has_its_present_robustness() {
        assert_eq!(robustness("x >= 1", &[3.0, 0.0]), [2.0, -1.0]);
        assert_eq!(
            robustness("historically[0:1s](x >= 1)", &[3.0, 0.0, 5.0, 5.0, 5.0]),
            [2.0, -1.0, -1.0, -1.0, 4.0]
        );
    }

    #[test]
    fn a_formula_of_the_future_has_the_best_that_is_possible() {
        // The window has three samples; each can only lower the bound.
        assert_eq!(robustness("always[0:2](x >= 1)", &[3.0, 2.0, 5.0, 0.0]), [2.0, 1.0, 1.0, 1.0]);
        assert_eq!(robustness("eventually[0:1](x >= 1)", &[0.0, 0.5]), [f64::INFINITY, -0.5]);
    }

    #[test]
    fn an_unknown_quantity_is_an_alarm_and_keeps_the_time() {
        let found = robustness("once[0:1](x >= 1)", &[3.0, f64::NAN, 0.0, 0.0]);
        // The unknown sample counts as 3, so that the window of the third one still has it.
        assert_eq!(found, [2.0, f64::NEG_INFINITY, 2.0, -1.0]);
    }

    #[test]
    fn arithmetic_without_a_value_is_an_alarm() {
        let found = robustness("10 / x >= 1", &[5.0, 0.0, 5.0]);
        assert_eq!(found, [1.0, f64::NEG_INFINITY, 1.0]);
    }

    #[test]
    fn mistakes_are_found_before_the_first_sample() {
        assert!(watch("z >= 1", 10).is_err_and(|error| error.to_string().contains("`z`")));
        assert!(watch("1 >= 0", 10).is_err());
        assert!(watch("always[0:11](x >= 1)", 10).is_err());
        assert!(watch("always[0:10](x >= 1)", 10).is_ok());
    }
}
