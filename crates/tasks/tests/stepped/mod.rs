//! One simulation of a task that a test steps by hand.

use mishandle_rollout::{Environment, EnvironmentWorker, Sample, Scenario, Seed};
use mishandle_tasks::TaskEnvironment;

/// One simulation with the last sample of its control steps.
pub struct Run {
    pub environment: TaskEnvironment,
    pub worker: Box<dyn EnvironmentWorker>,
    pub state: Vec<f64>,
    pub observation: Vec<f32>,
    pub signals: Vec<f64>,
    pub rewards: Vec<f64>,
}

impl Run {
    /// Resets an environment. The state before is NaN, so that a reset that reads it is found.
    pub fn new(environment: TaskEnvironment, scenario: &Scenario) -> Run {
        let mut run = Run {
            worker: environment.worker(),
            state: vec![f64::NAN; environment.state_size()],
            observation: vec![0.0; environment.observation_size()],
            signals: vec![0.0; environment.signals().len()],
            rewards: vec![0.0; environment.reward_terms().len()],
            environment,
        };
        let Run { worker, state, observation, signals, rewards, .. } = &mut run;
        worker.reset(scenario, Seed(1), state, Sample { observation, signals, rewards });
        run
    }

    pub fn step(&mut self, action: &[f64]) {
        let Run { worker, state, observation, signals, rewards, .. } = self;
        worker.step(action, state, Sample { observation, signals, rewards });
    }

    /// Returns a signal of the last sample.
    pub fn signal(&self, name: &str) -> f64 {
        self.signals[self.environment.signals().iter().position(|known| known == name).unwrap()]
    }
}
