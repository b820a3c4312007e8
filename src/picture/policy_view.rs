//! The images that a policy saw in a simulation, and the parts of them on which its action depends.

use std::ops::Range;
use std::sync::Arc;

use mishandle_rollout::{Controller, Environment, Episode, Image, Request, Space, System};

use crate::error::{MishandleError, RunError};
use crate::picture::{Decisions, RecordedController, SharedDecisions};
use crate::plan::Plan;
use crate::resolve::{ResolvedPlan, SceneTarget, has_scene, is_target_file, scene_target, task_target};
use crate::run::ControlArm;

/// Number of patches along each side of an image.
const PATCHES: usize = 8;

/// The images and actions of a policy in a simulation.
pub struct PolicyView {
    /// The simulation.
    pub episode: Episode,
    /// The images of a control step, in their order.
    pub images: Vec<Image>,
    decisions: Decisions,
    /// The policy, also if a guard was around it.
    policy: Arc<dyn Controller>,
    action_limit: f32,
}

/// How much the action of one control step changes if patches of its images are covered.
#[derive(Clone, Debug, PartialEq)]
pub struct Occlusion {
    /// Euclidean norm of the action.
    pub action: f64,
    /// For each image, the changes.
    pub images: Vec<PatchChanges>,
}

/// Changes of an action by covered patches of one image.
#[derive(Clone, Debug, PartialEq)]
pub struct PatchChanges {
    /// Numbers of patches from left to right and from top to bottom.
    pub patches: [usize; 2],
    /// Euclidean norm of the change of the action, row by row.
    pub changes: Vec<f64>,
}

/// Simulates a request and returns what the policy saw in it; then, with the same start and seed,
/// what it saw with all other axes at nominal: `None` if no other axis is varied. `None` for both
/// if the controller sees nothing.
///
/// # Errors
/// If a simulation cannot be run.
pub fn policy_views(
    resolved: &ResolvedPlan,
    request: &Request,
) -> Result<Option<(PolicyView, Option<PolicyView>)>, MishandleError> {
    if !has_scene(&resolved.target.identity.kind) || is_target_file(&resolved.plan.target) {
        return Ok(None);
    }
    let target = scene_target(resolved)?;
    if target.controller().sees().is_empty() {
        return Ok(None);
    }
    let view = |space: &Space, request: &Request| policy_view(resolved, &target, space, request);
    let seen = view(&resolved.space, request)?;
    let arm = ControlArm::of_space(resolved)?;
    let nominal = arm.map(|arm| view(&arm.space, &arm.request(request)));
    Ok(Some((seen, nominal.transpose()?)))
}

fn policy_view(
    resolved: &ResolvedPlan,
    target: &SceneTarget,
    space: &Space,
    request: &Request,
) -> Result<PolicyView, MishandleError> {
    let environment = target.environment(space, &resolved.specification, false)?;
    let action_limit = environment.action_limit() as f32;
    let environment: Arc<dyn Environment> = environment;
    let shared = SharedDecisions::default();
    let mut system = target
        .system_in(environment, space, &resolved.specification)?
        .map_controller(|controller| Arc::new(RecordedController::new(controller, shared.clone(), true)));
    let episode = system
        .rollout(std::slice::from_ref(request))?
        .pop()
        .ok_or(MishandleError::Run(RunError::NoEpisode))?;
    let decisions = shared.take().pop().ok_or(MishandleError::Run(RunError::NoEpisode))?;
    // A guard would answer with the action of its fallback.
    let unguarded = Plan { guard: None, ..resolved.plan.clone() };
    let policy = Arc::clone(task_target(&unguarded)?.controller());
    Ok(PolicyView { episode, images: policy.sees().to_vec(), decisions, policy, action_limit })
}

impl PolicyView {
    /// Returns the number of control steps in which the policy saw images.
    pub fn steps(&self) -> usize {
        self.decisions.images.len() / self.bytes().max(1)
    }

    fn bytes(&self) -> usize {
        self.images.iter().map(Image::bytes).sum()
    }

    /// Returns an image as the policy saw it in a control step: red, green and blue of each pixel.
    ///
    /// # Panics
    /// If there is no such image or step.
    pub fn image(&self, image: usize, step: usize) -> &[u8] {
        &self.decisions.images[step * self.bytes()..][self.place(image)]
    }

    /// Returns where an image is among those of a control step.
    fn place(&self, image: usize) -> Range<usize> {
        let first = self.images[..image].iter().map(Image::bytes).sum();
        first..first + self.images[image].bytes()
    }

    /// Asks the policy again for its action in a control step, with each of 8 x 8 patches of each
    /// image covered by the mean color of that image; Zeiler and Fergus (2014) cover with gray. The
    /// policy sees all earlier images as they were. `None` without such a step, or if an action is
    /// not finite.
    pub fn occlusion(&self, step: usize) -> Option<Occlusion> {
        if step >= self.steps() {
            return None;
        }
        let mut worker = self.policy.worker();
        let observations = self.decisions.observations.chunks_exact(self.policy.observation_size());
        let observations: Vec<&[f32]> = observations.collect();
        let mut state = vec![0.0; self.policy.state_size()];
        worker.reset(&mut state, self.decisions.seed);
        let bytes = self.bytes();
        let mut act = |step: usize, images: &[u8], state: &mut [f64]| {
            let mut action = vec![0.0; self.policy.action_size()];
            worker.look(1, images);
            worker.act(1, observations.get(step)?, state, &mut action);
            // As the target executes it.
            let limit = self.action_limit;
            let is_finite = worker.failure(0).is_none() && action.iter().all(|x| x.is_finite());
            is_finite.then(|| action.iter().map(|x| x.clamp(-limit, limit)).collect::<Vec<f32>>())
        };
        let images = |step: usize| &self.decisions.images[step * bytes..][..bytes];
        let earlier = if state.is_empty() { 0..0 } else { 0..step };
        for earlier in earlier {
            act(earlier, images(earlier), &mut state)?;
        }
        let whole = act(step, images(step), &mut state.clone())?;
        let mut occlusion = Occlusion { action: norm(whole.iter().copied()), images: Vec::new() };
        for (index, image) in self.images.iter().enumerate() {
            let patches = [image.width, image.height].map(|side| side.min(PATCHES));
            let mut changes = Vec::new();
            for patch in 0..patches[0] * patches[1] {
                let mut covered = images(step).to_vec();
                cover(&mut covered[self.place(index)], image, patches, patch);
                let action = act(step, &covered, &mut state.clone())?;
                changes.push(norm(action.iter().zip(&whole).map(|(a, b)| a - b)));
            }
            occlusion.images.push(PatchChanges { patches, changes });
        }
        Some(occlusion)
    }
}

fn norm(values: impl Iterator<Item = f32>) -> f64 {
    values.map(|x| f64::from(x).powi(2)).sum::<f64>().sqrt()
}

/// Covers a patch of an image with the mean color of the image.
fn cover(rgb: &mut [u8], image: &Image, [across, down]: [usize; 2], patch: usize) {
    let pixels = image.width * image.height;
    let mean: [u8; 3] = std::array::from_fn(|channel| {
        let sum: usize = rgb.iter().skip(channel).step_by(3).map(|x| usize::from(*x)).sum();
        ((sum + pixels / 2) / pixels) as u8
    });
    let range = |index: usize, count: usize, side: usize| index * side / count..(index + 1) * side / count;
    for y in range(patch / across, down, image.height) {
        for x in range(patch % across, across, image.width) {
            rgb[3 * (y * image.width + x)..][..3].copy_from_slice(&mean);
        }
    }
}
