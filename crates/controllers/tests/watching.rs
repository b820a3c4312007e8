//! A guard that only watches changes nothing, also where the controller has no action.

use std::sync::Arc;

use mishandle_controllers::guard::{Fallback, Guard, Guarded, Meaning, Motion, Switch, Watch};
use mishandle_rollout::{Controller, ControllerFailure, ControllerWorker, Seed};
use mishandle_stl::Formula;

/// Its action is NaN where the observation is 1, and it has failed where the observation is 2.
struct Broken(Option<ControllerFailure>);

impl Controller for Broken {
    fn observation_size(&self) -> usize {
        1
    }

    fn action_size(&self) -> usize {
        1
    }

    fn worker(&self) -> Box<dyn ControllerWorker> {
        Box::new(Broken(None))
    }
}

impl ControllerWorker for Broken {
    fn act(&mut self, _rows: usize, observations: &[f32], _states: &mut [f64], actions: &mut [f32]) {
        let failure = ControllerFailure { is_timeout: false, reason: "it ended".to_string() };
        self.0 = (observations[0] == 2.0).then_some(failure);
        actions[0] = if observations[0] == 1.0 { f32::NAN } else { 0.5 };
    }

    fn failure(&self, _row: usize) -> Option<&ControllerFailure> {
        self.0.as_ref()
    }
}

/// Returns the action and whether the controller failed, for an observation.
fn act(threshold: f64, observation: f32) -> (f32, bool) {
    let formula = Formula::parse("x <= 0").expect("a formula");
    let watch = Watch::new(&formula, &["x".to_string()], 0.1, 10).expect("a watch");
    let switch = Switch::new(threshold, None, 0).expect("a switch");
    let hold = Fallback::Hold(Motion { meanings: vec![Meaning::Increment], limit: 1.0 });
    let guard = Guard::new(String::new(), watch, switch, hold, false, 1, 1).expect("a guard");
    let guarded = Guarded::new(Arc::new(Broken(None)), guard);
    let mut worker = guarded.worker();
    let mut state = vec![0.0; guarded.state_size()];
    worker.reset(&mut state, Seed(0));
    let mut action = [9.0];
    worker.act(1, &[observation], &mut state, &mut action);
    (action[0], worker.failure(0).is_some())
}

#[test]
fn a_watching_guard_leaves_a_missing_action_and_another_one_replaces_it() {
    for observation in [-1.0, 0.0] {
        assert_eq!(act(f64::NEG_INFINITY, observation), (0.5, false));
    }
    let (action, has_failed) = act(f64::NEG_INFINITY, 1.0);
    assert!(action.is_nan() && !has_failed);
    assert_eq!(act(f64::NEG_INFINITY, 2.0), (0.5, true));
    // The threshold is never reached, but the controller has no action.
    for observation in [1.0, 2.0] {
        assert_eq!(act(-100.0, observation), (0.0, false));
    }
}
