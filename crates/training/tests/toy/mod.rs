//! Toy environments for tests.

use std::sync::Arc;

use mishandle_rollout::{Axis, Environment, EnvironmentFacts, EnvironmentWorker, Space};

/// An environment with these facts; its episodes run in copies of `worker`.
pub struct Toy<W> {
    pub facts: EnvironmentFacts,
    pub worker: W,
}

/// Returns a scenario space with these axes: name, low, high.
pub fn space(axes: &[(&str, f64, f64)]) -> Space {
    let axis = |(name, low, high): &(&str, f64, f64)| Axis::start(name, "m", *low, *high);
    Space::new("starts", axes.iter().map(axis).collect()).unwrap()
}

pub fn names(names: &[&str]) -> Arc<[String]> {
    names.iter().map(|name| (*name).to_string()).collect()
}

impl<W: EnvironmentWorker + Clone + Sync + 'static> Environment for Toy<W> {
    fn facts(&self) -> &EnvironmentFacts {
        &self.facts
    }
    fn worker(&self) -> Box<dyn EnvironmentWorker> {
        Box::new(self.worker.clone())
    }
}
