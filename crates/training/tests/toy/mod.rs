//! Toy environments for tests.

use std::sync::Arc;

use mishandle_rollout::{Axis, Environment, EnvironmentWorker, Space};

/// An environment with these properties; its episodes run in copies of `worker`.
pub struct Toy<W> {
    pub name: &'static str,
    pub space: Space,
    pub signals: Arc<[String]>,
    pub reward_terms: Arc<[String]>,
    pub observation_size: usize,
    pub action_size: usize,
    pub state_size: usize,
    pub episode_steps: usize,
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
    fn name(&self) -> &str {
        self.name
    }
    fn space(&self) -> &Space {
        &self.space
    }
    fn signals(&self) -> &Arc<[String]> {
        &self.signals
    }
    fn reward_terms(&self) -> &[String] {
        &self.reward_terms
    }
    fn observation_size(&self) -> usize {
        self.observation_size
    }
    fn action_size(&self) -> usize {
        self.action_size
    }
    fn action_limit(&self) -> f64 {
        1.0
    }
    fn state_size(&self) -> usize {
        self.state_size
    }
    fn control_dt(&self) -> f64 {
        0.1
    }
    fn episode_steps(&self) -> usize {
        self.episode_steps
    }
    fn worker(&self) -> Box<dyn EnvironmentWorker> {
        Box::new(self.worker.clone())
    }
}
