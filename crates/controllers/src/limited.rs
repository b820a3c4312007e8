use std::sync::Arc;

use mishandle_rollout::{Seed, Supervised, Supervisor, SupervisorWorker};

use crate::ActionLimiter;

/// An action interface as the supervisor of a policy in training, with another supervisor after it,
/// such as a guard.
///
/// The state of a simulation begins with the state of the other supervisor. The memory of the
/// limiter follows.
pub struct LimitedPolicy {
    limiter: ActionLimiter,
    next: Option<Arc<dyn Supervisor>>,
    identity: String,
}

impl LimitedPolicy {
    /// Limits the actions of a policy before the next supervisor sees them.
    pub fn new(limiter: ActionLimiter, next: Option<Arc<dyn Supervisor>>) -> LimitedPolicy {
        let after = next.as_ref().map_or(String::new(), |next| format!(", then {}", next.identity()));
        let identity = format!("{limiter:?}{after}");
        LimitedPolicy { limiter, next, identity }
    }
}

impl Supervisor for LimitedPolicy {
    fn identity(&self) -> &str {
        &self.identity
    }

    fn state_size(&self) -> usize {
        self.next.as_ref().map_or(0, |next| next.state_size()) + self.limiter.memory_size()
    }

    fn worker(&self) -> Box<dyn SupervisorWorker> {
        Box::new(Worker {
            limiter: self.limiter.clone(),
            next: self.next.as_ref().map(|next| next.worker()),
            next_size: self.next.as_ref().map_or(0, |next| next.state_size()),
        })
    }
}

struct Worker {
    limiter: ActionLimiter,
    next: Option<Box<dyn SupervisorWorker>>,
    /// Length of the state of the next supervisor.
    next_size: usize,
}

impl SupervisorWorker for Worker {
    fn reset(&mut self, state: &mut [f64], seed: Seed) {
        let (own, memory) = state.split_at_mut(self.next_size);
        self.limiter.reset(memory);
        if let Some(next) = &mut self.next {
            next.reset(own, seed);
        }
    }

    fn supervise(&mut self, rows: usize, supervised: Supervised<'_>, is_usable: &dyn Fn(usize) -> bool) {
        if rows == 0 {
            return;
        }
        let Supervised { observations, states, stride, actions } = supervised;
        let observation_size = observations.len() / rows;
        let action_size = actions.len() / rows;
        for row in 0..rows {
            let memory = &mut states[row * stride + self.next_size..][..self.limiter.memory_size()];
            let action = &mut actions[row * action_size..][..action_size];
            self.limiter.limit(&observations[row * observation_size..][..observation_size], memory, action);
        }
        if let Some(next) = &mut self.next {
            next.supervise(rows, Supervised { observations, states, stride, actions }, is_usable);
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use mishandle_rollout::{Controller, ControllerWorker};

    use super::*;
    use crate::{ActionInterface, Fitted, JointTargets};

    /// A policy whose action is the first number of the observation.
    struct First;

    impl Controller for First {
        fn observation_size(&self) -> usize {
            3
        }

        fn action_size(&self) -> usize {
            1
        }

        fn worker(&self) -> Box<dyn ControllerWorker> {
            Box::new(First)
        }
    }

    impl ControllerWorker for First {
        fn act(&mut self, _rows: usize, observations: &[f32], _states: &mut [f64], actions: &mut [f32]) {
            actions.iter_mut().zip(observations.chunks(3)).for_each(|(action, seen)| *action = seen[0]);
        }
    }

    #[test]
    fn training_limits_actions_as_an_evaluation_does() {
        let numbers = |number: f64| vec![number];
        let interface = ActionInterface {
            velocity: numbers(2.0),
            acceleration: numbers(8.0),
            target_velocity: numbers(3.0),
            margin: 0.1,
            lead: 0.2,
        };
        let targets = JointTargets {
            positions: 1,
            targets: 2,
            ranges: vec![[-1.0, 1.0]],
            step: 0.125,
            control_dt: 0.0625,
        };
        let limiter = ActionLimiter::new(&interface, targets).unwrap();
        let fitted = Fitted::new(Arc::new(First), Vec::new(), Some(limiter.clone()));
        let trained = LimitedPolicy::new(limiter, None);
        let (mut evaluation, mut training) = (fitted.worker(), trained.worker());
        let stride = fitted.state_size();
        assert_eq!(trained.state_size(), stride);
        let mut states = [vec![0.0; 2 * stride], vec![0.0; 2 * stride]];
        for row in 0..2 {
            evaluation.reset(&mut states[0][row * stride..][..stride], Seed(0));
            training.reset(&mut states[1][row * stride..][..stride], Seed(0));
        }
        let mut moved = 0;
        for step in 0..50_u32 {
            let wave = |phase: f32| (0.7 * step as f32 + phase).sin();
            let observations = [2.0 * wave(0.0), 0.3, 0.5 * wave(1.0), wave(2.0), -0.2, 0.1];
            let mut expected = [0.0; 2];
            evaluation.act(2, &observations, &mut states[0], &mut expected);
            let mut actions = [observations[0], observations[3]];
            let supervised = Supervised {
                observations: &observations,
                states: &mut states[1],
                stride,
                actions: &mut actions,
            };
            training.supervise(2, supervised, &|_| true);
            assert_eq!(actions, expected);
            moved += u32::from(actions != [observations[0], observations[3]]);
        }
        assert_eq!(moved, 50, "the limiter changes the actions");
    }
}
