/// Life cycle of a fault in control steps, counted from 0: it begins, lasts, and recovers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LifeCycle {
    /// First control step of the fault.
    pub onset: usize,
    /// Number of control steps with the whole fault.
    pub duration: usize,
    /// Number of control steps after them in which the fault decreases linearly.
    pub recovery: usize,
}

impl LifeCycle {
    /// Makes a life cycle from times in s, rounded to whole control steps.
    pub fn from_seconds(onset: f64, duration: f64, recovery: f64, control_dt: f64) -> LifeCycle {
        let steps = |seconds: f64| (seconds / control_dt).round().max(0.0) as usize;
        LifeCycle { onset: steps(onset), duration: steps(duration), recovery: steps(recovery) }
    }

    /// Returns whether the fault is whole in a control step.
    pub fn is_whole(&self, step: usize) -> bool {
        (self.onset..self.onset.saturating_add(self.duration)).contains(&step)
    }

    /// Returns the share of the fault in a control step: 0 before and after it, 1 while it is
    /// whole, and between them during the recovery.
    pub fn share(&self, step: usize) -> f64 {
        let end = self.onset.saturating_add(self.duration);
        if step < self.onset || self.duration == 0 {
            0.0
        } else if step < end {
            1.0
        } else {
            let left = (end + self.recovery).saturating_sub(step);
            left as f64 / (self.recovery + 1) as f64
        }
    }

    /// Returns the fraction of the duration up to the end of a control step: from 0 to 1.
    pub fn elapsed(&self, step: usize) -> f64 {
        let steps = (step + 1).saturating_sub(self.onset).min(self.duration);
        steps as f64 / self.duration.max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_share_is_one_for_the_duration_and_falls_linearly_in_the_recovery() {
        let life = LifeCycle { onset: 2, duration: 3, recovery: 3 };
        let shares: Vec<f64> = (0..9).map(|step| life.share(step)).collect();
        assert_eq!(shares, [0.0, 0.0, 1.0, 1.0, 1.0, 0.75, 0.5, 0.25, 0.0]);
        assert!((0..9).all(|step| life.is_whole(step) == (2..5).contains(&step)));
        let elapsed = [1, 2, 3, 4, 5].map(|step| life.elapsed(step));
        assert_eq!(elapsed, [0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0, 1.0]);
    }

    #[test]
    fn a_fault_without_duration_has_no_share_whatever_its_recovery() {
        let life = LifeCycle::from_seconds(0.0, 0.008, 0.5, 1.0 / 60.0);
        assert_eq!((life.duration, life.recovery), (0, 30), "less than half a control step");
        assert!((0..60).all(|step| life.share(step) == 0.0));
    }

    #[test]
    fn times_are_rounded_to_whole_control_steps() {
        for steps in 0..400_usize {
            let life = LifeCycle::from_seconds(steps as f64 / 60.0, 1.0, 0.0, 1.0 / 60.0);
            assert_eq!(life.onset, steps, "a multiple of the control step is exact");
        }
    }
}
