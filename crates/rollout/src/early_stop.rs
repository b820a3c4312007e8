use std::sync::Arc;

use mishandle_stl::{Clock, OnlineMonitor};

use crate::{RolloutError, Specification};

/// The requirement of one running episode, which ends the episode when the rest of it does not
/// matter: see [`Request::stop_threshold`](crate::Request::stop_threshold).
///
/// It evaluates each sample once.
///
/// # Example
/// ```
/// use mishandle_rollout::{EarlyStop, Specification};
/// use mishandle_stl::Formula;
///
/// let specification = Specification::new(Formula::parse("eventually[0:99](x >= 1)").unwrap());
/// let mut stop = EarlyStop::new(&specification, &["x".to_string()].into(), 0.1, 100).unwrap();
/// stop.push(&[0.0]);
/// assert!(!stop.can_stop(0.5));
/// stop.push(&[2.0]);
/// assert!(stop.can_stop(0.5)); // the robustness is at least 1
/// ```
#[derive(Clone, Debug)]
pub struct EarlyStop {
    monitor: OnlineMonitor,
    /// The number of samples of a whole episode.
    samples: usize,
    /// The number of samples pushed.
    len: usize,
    has_failed: bool,
}

impl EarlyStop {
    /// Compiles the requirement for episodes of `samples` samples of these signals, one every
    /// `control_dt` seconds.
    ///
    /// # Errors
    /// As for [`SpecificationMonitor::new`](crate::SpecificationMonitor::new).
    pub fn new(
        specification: &Specification,
        signals: &Arc<[String]>,
        control_dt: f64,
        samples: usize,
    ) -> Result<EarlyStop, RolloutError> {
        let requirement = &specification.requirement;
        let formulas = std::slice::from_ref(requirement);
        let monitor = OnlineMonitor::new(formulas, signals, Clock::steps(control_dt), Some(samples))
            .map_err(|source| RolloutError::Monitor { formula: requirement.to_string(), source })?;
        Ok(EarlyStop { monitor, samples, len: 0, has_failed: false })
    }

    /// Starts the next episode.
    pub fn start(&mut self) {
        self.monitor.reset();
        (self.len, self.has_failed) = (0, false);
    }

    /// Adds a sample. An error, such as a signal that is NaN, stops nothing: the verdict reports
    /// it.
    ///
    /// # Panics
    /// If the length of `sample` is not the number of signals.
    pub fn push(&mut self, sample: &[f64]) {
        self.len += 1;
        self.has_failed = self.has_failed || self.monitor.push(sample).is_err();
    }

    /// Returns whether the samples contain all bounded windows of the requirement at time 0. Then
    /// no later end of the episode cuts one.
    pub fn has_windows(&self) -> bool {
        self.len >= self.monitor.needed_samples(0).0
    }

    /// Returns the largest robustness that the requirement can still have, whatever follows.
    pub fn bound(&mut self) -> f64 {
        if self.has_failed || self.len == 0 { f64::INFINITY } else { self.monitor.bounds(0).high }
    }

    /// Returns whether the samples, which are not the whole episode, determine the robustness of
    /// the requirement at time 0, or show that it is above `threshold`, which is at least 0.
    pub fn can_stop(&mut self, threshold: f64) -> bool {
        let (needed, is_unbounded) = self.monitor.needed_samples(0);
        let is_determined = !is_unbounded && self.len >= needed;
        self.len < self.samples
            && (is_determined || (!self.has_failed && self.monitor.bounds(0).low > threshold))
    }
}
