//! Labels: the actions of another controller in the states of an episode.

use std::sync::Arc;

use mishandle_results::{Choice, Key, Remedy};
use mishandle_rollout::{Controller, Seed};

use crate::error::{MishandleError, invalid};
use crate::plan::Plan;
use crate::resolve::{ResolvedPlan, is_target_file, scene_target};
use crate::shipped::EXPERT;

/// Returns the controller of a target that labels the states, by its name or its path.
pub(super) fn labeler(resolved: &ResolvedPlan, name: &str) -> Result<Arc<dyn Controller>, MishandleError> {
    let plan = &resolved.plan;
    if is_target_file(&plan.target) && name == EXPERT {
        let expected = "the path of a controller, because only tasks have an expert";
        return Err(invalid("the controller of the labels", name, expected)
            .with(Remedy::set(Key::RELABEL, Choice::FILE)));
    }
    let plan = Plan { controller: name.to_string(), guard: None, stochastic: false, ..plan.clone() };
    let controller = scene_target(&ResolvedPlan::new(&plan)?)?.controller().clone();
    if controller.sees().is_empty() {
        Ok(controller)
    } else {
        Err(invalid(
            "the controller of the labels",
            name,
            "one that sees no images: a label is a function of the state",
        ))
    }
}

/// Returns the actions of a controller in states with these observations. It is reset before each
/// of them, so that an action is a function of the state.
pub(super) fn labels(
    controller: &dyn Controller,
    seed: Seed,
    observations: &[f32],
) -> Result<Vec<f32>, MishandleError> {
    let rows = observations.len() / controller.observation_size();
    let size = controller.state_size();
    let mut worker = controller.worker();
    let mut states = vec![0.0; rows * size];
    (0..rows).for_each(|row| worker.reset(&mut states[row * size..][..size], seed));
    let mut actions = vec![0.0; rows * controller.action_size()];
    worker.act(rows, observations, &mut states, &mut actions);
    match (0..rows).find_map(|row| worker.failure(row)) {
        Some(failure) => Err(invalid(
            "the controller of the labels",
            &failure.reason,
            "one that has an action in each state",
        )),
        None => Ok(actions),
    }
}
