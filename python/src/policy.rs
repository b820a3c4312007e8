//! A policy in Python as the controller of a task, or of a robot that a file describes.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, PoisonError};

use mishandle::resolve::{is_target_file, preset as task_preset, robot_file, task};
use mishandle::rollout::{
    Component, Controller, ControllerWorker, Episode, EpisodeEnd, Identity, Image, Noise, Request,
    RolloutError, Seed, Space, Specification, System, SystemFactory,
};
use mishandle::store::ComponentRecord;
use mishandle::tasks::TaskTarget;
use mishandle::{MishandleError, Plan, ResolvedPlan};
use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use serde::Deserialize;

use crate::call::Call;
use crate::target::{Pending, PyTarget, keep};
use crate::{InvalidValueError, plain, raised};

/// Number of simulations that the policy acts in at once: as many as a thread steps together.
const ROWS: usize = 16;

/// Returns the name of a task or of the robot of a file, and the lengths of observations and
/// actions.
#[pyfunction]
pub fn policy_interface(py: Python<'_>, target: &str) -> PyResult<(String, usize, usize)> {
    py.detach(|| interface(target)).map_err(raised)
}

fn interface(target: &str) -> Result<(String, usize, usize), MishandleError> {
    if is_target_file(target) {
        let robot = robot_file(&Plan::new(target, ""))?;
        return Ok((robot.name().to_string(), robot.observation_size(), robot.actions()));
    }
    let layout = task(target)?.definition().layout();
    Ok((target.to_string(), layout.observation_size(), layout.action_size()))
}

/// A policy in Python.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PolicyDocument {
    /// Name of the target.
    name: String,
    /// Name of the policy.
    policy: String,
    hash: String,
    /// Parts that the hash does not cover.
    not_covered: Vec<String>,
    /// Names of cameras, widths and heights.
    images: Vec<(String, usize, usize)>,
    versions: Vec<(String, String)>,
    is_deterministic: bool,
}

/// Returns the task, or the robot of a file, that a call names, with a policy that a document
/// describes. `policy` has the method `act(observations, images, rows, is_start)`, which returns
/// one action per row, or `None` after an exception that it has kept. The attribute `has_timed_out`
/// says whether that was a time limit.
#[pyfunction]
pub fn policy_target(py: Python<'_>, call: &str, policy: Py<PyAny>, document: &str) -> PyResult<PyTarget> {
    let call = Call::read(call)?;
    call.check_keys(&["target", "space", "preset", "action-noise", "observation-noise", "careful"])?;
    let PolicyDocument { name, policy: policy_name, hash, not_covered, images, versions, is_deterministic } =
        serde_json::from_str(document).map_err(plain)?;
    let pending = Pending::default();
    let given = &call.plan;
    let named = &*given.target;
    let component = |role: &str, name: String, hash: String| Component {
        role: role.to_string(),
        name,
        hash,
        file_hash: String::new(),
    };
    let noise = Noise { action_std: given.action_noise, observation_std: given.observation_noise };
    // The policy acts in all rows at once, and one after the other, whatever the machine.
    let pool = ThreadPoolBuilder::new().num_threads(1).build();
    let pool = Arc::new(pool.map_err(|error| PyRuntimeError::new_err(error.to_string()))?);
    let made = || {
        let (_, observation_size, action_size) = interface(named)?;
        let image = |(camera, width, height)| Image { camera, width, height };
        let shared = Arc::new(Shared {
            policy,
            images: images.into_iter().map(image).collect(),
            pending: pending.clone(),
            has_failed: AtomicBool::new(false),
            sizes: (observation_size, action_size),
        });
        let controller: Arc<dyn Controller> = Arc::new(PythonPolicy(shared.clone()));
        let components = vec![component("policy", policy_name, hash)];
        let mut target = if is_target_file(named) {
            robot_file(&Plan::new(named, ""))?.target(controller, components, noise)?
        } else {
            let preset = task_preset(&given.preset)?;
            TaskTarget::new(task(named)?, preset, controller, components, noise)?.target()?
        };
        let uncovered = not_covered.into_iter();
        target
            .components
            .extend(uncovered.map(|part| component(ComponentRecord::NOT_COVERED, part, String::new())));
        target.identity = Identity::new("python", &format!("python/{name}"), &target.identity.hash);
        target.is_deterministic = is_deterministic;
        target.depends_on_seed |= !is_deterministic;
        target.can_fail = true;
        target.versions.extend(versions);
        target.factory = together(target.factory, &pool, &shared);
        for variant in &mut target.solver_variants {
            variant.factory = together(variant.factory.clone(), &pool, &shared);
        }
        let preset = Plan::new("", "").preset;
        let plan = Plan { target: target.identity.name.clone(), preset, ..given.clone() };
        // Checks the space and the settings, which the axes then have.
        let checked = plan.clone().without_questions();
        let ResolvedPlan { target, space, plan: Plan { space: named, .. }, .. } =
            ResolvedPlan::with_target(&checked, target)?;
        Ok::<_, MishandleError>((target, space, Plan { space: named, ..plan }))
    };
    let (target, space, plan) = py.detach(made).map_err(raised)?;
    Ok(PyTarget::of_parts(target, plan, call.settings, space, pending))
}

/// Returns the factory of systems in which the policy acts in all rows of a batch at once.
fn together(inner: Arc<SystemFactory>, pool: &Arc<ThreadPool>, shared: &Arc<Shared>) -> Arc<SystemFactory> {
    let pool = pool.clone();
    let shared = shared.clone();
    Arc::new(move |space: &Space, specification: &Specification| {
        // Reports now what a simulation would report.
        inner(space, specification)?;
        Ok(Box::new(PolicySystem {
            space: space.clone(),
            specification: specification.clone(),
            factory: inner.clone(),
            pool: pool.clone(),
            shared: shared.clone(),
        }) as Box<dyn System>)
    })
}

/// The parts that the systems of a target share.
struct Shared {
    policy: Py<PyAny>,
    /// Images that the policy gets.
    images: Vec<Image>,
    pending: Pending,
    /// Whether the policy raised an exception in the running simulations.
    has_failed: AtomicBool,
    /// Lengths of an observation and an action.
    sizes: (usize, usize),
}

/// Memory of the policy is in Python, for all rows of a batch.
struct PythonPolicy(Arc<Shared>);

impl Controller for PythonPolicy {
    fn observation_size(&self) -> usize {
        self.0.sizes.0
    }

    fn action_size(&self) -> usize {
        self.0.sizes.1
    }

    fn sees(&self) -> &[Image] {
        &self.0.images
    }

    fn worker(&self) -> Box<dyn ControllerWorker> {
        Box::new(Worker { shared: self.0.clone(), is_start: true, images: Vec::new() })
    }
}

struct Worker {
    shared: Arc<Shared>,
    /// Whether the next actions are the first ones of their episodes.
    is_start: bool,
    /// Images of all rows.
    images: Vec<u8>,
}

impl ControllerWorker for Worker {
    fn reset(&mut self, _state: &mut [f64], _seed: Seed) {
        self.is_start = true;
    }

    fn look(&mut self, _rows: usize, images: &[u8]) {
        self.images.clear();
        self.images.extend_from_slice(images);
    }

    fn act(&mut self, rows: usize, observations: &[f32], _states: &mut [f64], actions: &mut [f32]) {
        let is_start = std::mem::take(&mut self.is_start);
        if self.shared.has_failed.load(Ordering::Relaxed) {
            return actions.fill(f32::NAN);
        }
        let acted =
            Python::attach(|py| self.shared.act(py, rows, is_start, observations, &self.images, actions));
        let has_acted = acted.unwrap_or_else(|exception| {
            keep(&self.shared.pending, exception);
            false
        });
        if !has_acted {
            self.shared.has_failed.store(true, Ordering::Relaxed);
            actions.fill(f32::NAN);
        }
    }
}

impl Shared {
    /// Writes the actions of the policy. Returns whether it has acted.
    fn act(
        &self,
        py: Python<'_>,
        rows: usize,
        is_start: bool,
        observations: &[f32],
        images: &[u8],
        actions: &mut [f32],
    ) -> PyResult<bool> {
        let observations = PyArray1::from_slice(py, observations).reshape([rows, self.sizes.0])?;
        let mut first = 0;
        let array = |image: &Image| {
            let place = first..first + image.bytes();
            first = place.end;
            let bytes: Vec<u8> =
                images.chunks(images.len() / rows).flat_map(|row| &row[place.clone()]).copied().collect();
            PyArray1::from_vec(py, bytes).reshape([rows, image.height, image.width, 3])
        };
        let images = self.images.iter().map(array).collect::<PyResult<Vec<_>>>()?;
        let given = self.policy.call_method1(py, "act", (observations, images, rows, is_start))?;
        let Some(given) = given.extract::<Option<PyReadonlyArray2<'_, f32>>>(py)? else {
            return Ok(false);
        };
        if given.shape() != [rows, self.sizes.1] {
            let message = format!("the actions have the shape {:?}", given.shape());
            return Err(InvalidValueError::new_err(message));
        }
        actions.iter_mut().zip(given.as_array()).for_each(|(action, given)| *action = *given);
        Ok(true)
    }
}

/// Simulates on one thread, so that the rows of a policy stay together.
struct PolicySystem {
    space: Space,
    specification: Specification,
    factory: Arc<SystemFactory>,
    pool: Arc<ThreadPool>,
    shared: Arc<Shared>,
}

impl System for PolicySystem {
    fn space(&self) -> &Space {
        &self.space
    }

    fn rollout(&mut self, requests: &[Request]) -> Result<Vec<Episode>, RolloutError> {
        let mut episodes = Vec::with_capacity(requests.len());
        for chunk in requests.chunks(ROWS) {
            match self.together(chunk)? {
                (found, false) => episodes.extend(found),
                // One by one, so that one scenario cannot spoil the others.
                (_, true) => {
                    for request in chunk {
                        let (mut found, has_failed) = self.together(std::slice::from_ref(request))?;
                        if has_failed {
                            let has_timed_out = self.has_timed_out()?;
                            found.iter_mut().for_each(|episode| fail(episode, has_timed_out));
                        }
                        episodes.extend(found);
                    }
                }
            }
        }
        Ok(episodes)
    }
}

impl PolicySystem {
    /// Returns whether the last exception of the policy was a time limit.
    fn has_timed_out(&self) -> Result<bool, RolloutError> {
        Python::attach(|py| {
            let found = self.shared.policy.getattr(py, "has_timed_out");
            let found = found.and_then(|value| value.extract::<bool>(py));
            found.map_err(|exception| keep(&self.shared.pending, exception))
        })
    }

    /// Simulates up to [`ROWS`] requests. Returns whether the policy raised an exception.
    fn together(&self, requests: &[Request]) -> Result<(Vec<Episode>, bool), RolloutError> {
        Python::attach(|py| py.check_signals().map_err(|exception| keep(&self.shared.pending, exception)))?;
        self.shared.has_failed.store(false, Ordering::Relaxed);
        let space = &self.space;
        let specification = &self.specification;
        let factory = &self.factory;
        let found = self.pool.install(|| factory(space, specification)?.rollout(requests))?;
        let pending = self.shared.pending.lock().unwrap_or_else(PoisonError::into_inner);
        match &*pending {
            Some(exception) => Err(RolloutError::System(exception.to_string())),
            None => Ok((found, self.shared.has_failed.load(Ordering::Relaxed))),
        }
    }
}

/// Says that the policy raised an exception, if that is why an episode ended.
fn fail(episode: &mut Episode, has_timed_out: bool) {
    if let EpisodeEnd::InvalidAction { step, .. } = episode.end {
        episode.end =
            if has_timed_out { EpisodeEnd::TimedOut { step } } else { EpisodeEnd::Crashed { step } };
    }
}
