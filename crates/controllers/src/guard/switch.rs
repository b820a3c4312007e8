use mishandle_stl::{is_satisfied, is_violated};

use crate::guard::GuardError;

/// When a guard hands over to the fallback and back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Switch {
    threshold: f64,
    return_threshold: Option<f64>,
    dwell_steps: usize,
}

impl Switch {
    /// Makes a switch that hands over below `threshold`, and back from `return_threshold` on, but
    /// not before the fallback has acted for `dwell_steps` control steps. Without a
    /// `return_threshold`, the fallback keeps the control.
    ///
    /// The thresholds are robustness, in the unit of the formula. A robustness that equals the
    /// threshold has the sign of its zero, as every verdict.
    ///
    /// # Errors
    /// If a threshold is NaN, or the way back begins below the hand-over. An infinite threshold is
    /// allowed: `-inf` never hands over.
    ///
    /// # Example
    /// ```
    /// use mishandle_controllers::guard::Switch;
    /// let switch = Switch::new(0.1, Some(0.3), 2).unwrap();
    /// assert!(!switch.is_active(0, 0.1, true) && switch.is_active(0, 0.09, true)); // hands over below 0.1
    /// assert!(switch.is_active(1, 0.5, true)); // acts for two steps
    /// assert!(switch.is_active(2, 0.2, true)); // hysteresis
    /// assert!(!switch.is_active(2, 0.3, true)); // back
    /// ```
    pub fn new(
        threshold: f64,
        return_threshold: Option<f64>,
        dwell_steps: usize,
    ) -> Result<Switch, GuardError> {
        if threshold.is_nan() {
            return Err(GuardError::Number { key: "threshold", value: threshold, expected: "a number" });
        }
        match return_threshold {
            Some(value) if value.is_nan() || value < threshold => Err(GuardError::Number {
                key: "return-threshold",
                value,
                expected: "at least the threshold, so that the guard does not hand back while it would hand over",
            }),
            _ => Ok(Switch { threshold, return_threshold, dwell_steps }),
        }
    }

    /// Returns whether the fallback acts in this control step. It has acted in the `steps` control
    /// steps before; 0 while the controller acts. A controller without a usable action gets no
    /// control, whatever the robustness is.
    pub fn is_active(&self, steps: usize, robustness: f64, is_usable: bool) -> bool {
        if !is_usable && !self.only_watches() {
            return true;
        }
        match (steps, self.return_threshold) {
            (0, _) => is_violated(above(robustness, self.threshold)),
            (_, Some(threshold)) if steps >= self.dwell_steps => !is_satisfied(above(robustness, threshold)),
            _ => true,
        }
    }

    /// Returns whether it never hands over, also if the controller has no action.
    pub fn only_watches(&self) -> bool {
        self.threshold == f64::NEG_INFINITY
    }

    /// Returns whether the controller can get the control back.
    pub fn has_way_back(&self) -> bool {
        self.return_threshold.is_some()
    }
}

/// Returns how far a robustness is above a threshold. Equal infinities are not below each other.
fn above(robustness: f64, threshold: f64) -> f64 {
    if robustness == threshold && threshold != 0.0 { 0.0 } else { robustness - threshold }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sign_of_a_zero_is_the_verdict() {
        let switch = Switch::new(0.0, None, 0).expect("thresholds");
        assert!(switch.is_active(0, -0.0, true));
        assert!(!switch.is_active(0, 0.0, true));
    }

    #[test]
    fn an_infinite_threshold_never_or_always_hands_over() {
        let never = Switch::new(f64::NEG_INFINITY, None, 0).expect("thresholds");
        assert!(
            [f64::NEG_INFINITY, -1.0, f64::INFINITY].iter().all(|value| !never.is_active(0, *value, true))
        );
        let always = Switch::new(f64::INFINITY, None, 0).expect("thresholds");
        assert!(always.is_active(0, 1e300, true));
    }

    #[test]
    fn a_way_back_below_the_threshold_is_an_error() {
        assert!(Switch::new(0.1, Some(0.0), 0).is_err());
        assert!(Switch::new(f64::NAN, None, 0).is_err());
        assert!(Switch::new(0.1, Some(f64::NAN), 0).is_err());
    }
}
