//! Controllers that are functions.

use std::sync::Arc;

use mishandle_rollout::{Controller, ControllerWorker, Seed};

/// Writes the action for an observation. It may change the state, which starts with zeros.
type Act = dyn Fn(&[f32], &mut [f64], &mut [f32]) + Send + Sync;

#[derive(Clone)]
struct Function {
    sizes: [usize; 3],
    act: Arc<Act>,
}

/// Returns a controller with these sizes of observation, action and state.
pub fn controller(
    sizes: [usize; 3],
    act: impl Fn(&[f32], &mut [f64], &mut [f32]) + Send + Sync + 'static,
) -> Arc<dyn Controller> {
    Arc::new(Function { sizes, act: Arc::new(act) })
}

impl Controller for Function {
    fn observation_size(&self) -> usize {
        self.sizes[0]
    }

    fn action_size(&self) -> usize {
        self.sizes[1]
    }

    fn state_size(&self) -> usize {
        self.sizes[2]
    }

    fn worker(&self) -> Box<dyn ControllerWorker> {
        Box::new(self.clone())
    }
}

impl ControllerWorker for Function {
    fn reset(&mut self, state: &mut [f64], _seed: Seed) {
        state.fill(0.0);
    }

    fn act(&mut self, rows: usize, observations: &[f32], states: &mut [f64], actions: &mut [f32]) {
        let [seen, done, kept] = self.sizes;
        for row in 0..rows {
            let observation = &observations[row * seen..][..seen];
            let state = &mut states[row * kept..][..kept];
            (self.act)(observation, state, &mut actions[row * done..][..done]);
        }
    }
}
