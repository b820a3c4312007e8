//! Environments for tests: facts, and a worker.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::sync::Arc;

use mishandle_rollout::{Axis, Environment, InitialBox, Worker};

/// An environment with these facts, whose episodes run in copies of a worker.
pub struct Toy<W> {
    pub name: &'static str,
    pub initial_box: InitialBox,
    pub signals: Arc<[String]>,
    pub reward_terms: Arc<[String]>,
    pub observation_size: usize,
    pub action_size: usize,
    pub state_size: usize,
    pub episode_steps: usize,
    pub worker: W,
}

/// The box with these axes: name, low, high.
pub fn initial_box(axes: &[(&str, f64, f64)]) -> InitialBox {
    let axis = |(name, low, high): &(&str, f64, f64)| Axis {
        name: (*name).into(),
        unit: "m".into(),
        low: *low,
        high: *high,
    };
    InitialBox::new(axes.iter().map(axis).collect()).unwrap()
}

pub fn names(names: &[&str]) -> Arc<[String]> {
    names.iter().map(|name| (*name).to_string()).collect()
}

impl<W: Worker + Clone + Sync + 'static> Environment for Toy<W> {
    fn name(&self) -> &str {
        self.name
    }
    fn initial_box(&self) -> &InitialBox {
        &self.initial_box
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
    fn state_size(&self) -> usize {
        self.state_size
    }
    fn control_dt(&self) -> f64 {
        0.1
    }
    fn episode_steps(&self) -> usize {
        self.episode_steps
    }
    fn worker(&self) -> Box<dyn Worker> {
        Box::new(self.worker.clone())
    }
}
