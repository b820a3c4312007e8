//! Policies in the formats of other tools as controllers of a task.

use std::path::Path;
use std::sync::Arc;

use mishandle_controllers::{ControllerFile, Header, JOINT_TARGETS, TrainingRecord};
use mishandle_files::{limits, read_bounded};
use mishandle_interchange::{
    ACTIVATIONS, ImportOptions, InterchangeError, Normalization, ObservationNormalizer, OnnxPolicy,
    TorchProblem, import,
};
use mishandle_network::Activation;
use mishandle_rollout::{Controller, RolloutError};
use mishandle_tasks::Definition;

use crate::error::MishandleError;
use crate::plan::{ImportSettings, Plan};
use crate::resolve::{camera_names, is_target_file, robot_file, task};
use crate::shipped::ShippedFile;

/// Imports a policy of Stable-Baselines3, skrl or PyTorch as a controller of the task `task_name`.
///
/// The header's algorithm is `imported`, and its command says where the policy is from.
///
/// # Errors
/// If the task is unknown, the file cannot be read or imported, or the policy's sizes are not those
/// of the task.
pub fn import_controller(
    path: &Path,
    task_name: &str,
    settings: &ImportSettings,
) -> Result<ControllerFile, MishandleError> {
    let options = options(settings)?;
    let definition = task(task_name)?.definition();
    let layout = definition.layout();
    let error = |problem| InterchangeError::Torch { problem, path: path.to_path_buf() };
    let bytes = read_bounded(path, limits::CONTROLLER)
        .map_err(|source| InterchangeError::Read { source, path: path.to_path_buf() })?;
    let imported = import(&bytes, &options).map_err(error)?;
    let network = imported.policy.network();
    for (side, found, expected) in [
        ("observation", network.input_size(), layout.observation_size()),
        ("action", network.output_size(), layout.action_size()),
    ] {
        if found != expected {
            let task = definition.name.to_string();
            return Err(error(TorchProblem::Size { task, side, found, expected }).into());
        }
    }
    let file = path.file_name().unwrap_or_default().to_string_lossy();
    let training = TrainingRecord {
        command: format!("imported from {file}, {}", imported.source),
        ..TrainingRecord::default()
    };
    let header = Header {
        task: definition.name.to_string(),
        algorithm: "imported".to_string(),
        preset: "unknown".to_string(),
        reward: "unknown".to_string(),
        layout,
        action_interface: None,
        task_hash: String::new(),
        training,
    };
    Ok(ControllerFile { header, policy: imported.policy })
}

/// Returns what the settings say about a policy.
fn options(settings: &ImportSettings) -> Result<ImportOptions, MishandleError> {
    let activation = |name: &str| {
        name.parse::<Activation>().map_err(|_| MishandleError::UnknownName {
            kind: "activation",
            name: name.to_string(),
            known: ACTIVATIONS.iter().map(ToString::to_string).collect(),
        })
    };
    let normalizer = match settings.normalizer.as_deref() {
        None => Normalization::OfFile,
        Some(ImportSettings::NO_NORMALIZER) => Normalization::Nothing,
        Some(path) => Normalization::Given(read_normalizer(Path::new(path))?),
    };
    Ok(ImportOptions {
        activation: settings.activation.as_deref().map(activation).transpose()?,
        output_activation: settings.output_activation.as_deref().map(activation).transpose()?,
        normalizer,
    })
}

/// Reads the statistics of a normalizer from a JSON file.
fn read_normalizer(path: &Path) -> Result<ObservationNormalizer, MishandleError> {
    let bytes = read_bounded(path, limits::SETTINGS)
        .map_err(|source| InterchangeError::Read { source, path: path.to_path_buf() })?;
    let invalid = |reason: String| InterchangeError::Normalizer { reason, path: path.to_path_buf() };
    let normalizer = ObservationNormalizer::from_json(&String::from_utf8_lossy(&bytes));
    let normalizer = normalizer.map_err(|error| invalid(error.to_string()))?;
    if normalizer.mean.len() != normalizer.variance.len() {
        let mean = normalizer.mean.len();
        let variance = normalizer.variance.len();
        return Err(invalid(format!("{mean} means and {variance} variances")).into());
    }
    Ok(normalizer)
}

/// Loads an ONNX model for `task_name`, a task or the path of a target file, or for the task that
/// it names itself. A model that names no task of ours has the sizes that it states.
///
/// # Errors
/// If the task is unknown, the target file is wrong, or the model cannot be used for it.
pub fn onnx_policy(file: &ShippedFile, task_name: Option<&str>) -> Result<OnnxController, MishandleError> {
    let path = file.path();
    if let Some(name) = task_name.filter(|name| is_target_file(name)) {
        let robot = robot_file(&Plan::new(name, ""))?;
        return with_cameras(OnnxPolicy::load(path, &[robot.name()], &robot.layout())?.into(), name);
    }
    if let Some(name) = task_name {
        return with_cameras(onnx_policy_of(file, task(name)?.definition())?, name);
    }
    let own = OnnxPolicy::description(path)?.task;
    match own.and_then(|name| mishandle_tasks::task(&name)) {
        Some(known) => {
            let definition = known.definition();
            with_cameras(onnx_policy_of(file, definition)?, definition.name)
        }
        None => Ok(OnnxPolicy::load_with_own_sizes(path)?.into()),
    }
}

/// An ONNX model as a controller.
pub struct OnnxController {
    /// The policy, with its action interface.
    pub controller: Arc<dyn Controller>,
    /// Hash of everything that determines the actions.
    pub hash: String,
    /// Hash of the model's bytes.
    pub file_hash: String,
    /// The task that the model names, if any.
    pub task: Option<String>,
}

impl From<OnnxPolicy> for OnnxController {
    fn from(policy: OnnxPolicy) -> OnnxController {
        let [hash, file_hash] = [policy.hash(), policy.file_hash()].map(String::from);
        let task = policy.task().map(String::from);
        OnnxController { controller: Arc::new(policy), hash, file_hash, task }
    }
}

/// Returns a policy that sees through cameras of the target only.
fn with_cameras(policy: OnnxController, target: &str) -> Result<OnnxController, MishandleError> {
    let known = camera_names(target)?;
    match policy.controller.sees().iter().find(|image| !known.contains(&image.camera)) {
        Some(image) => {
            let environment = target.to_string();
            let camera = image.camera.clone();
            Err(RolloutError::NoCamera { environment, camera, known }.into())
        }
        None => Ok(policy),
    }
}

/// Loads an ONNX model for a task. A variant accepts models of its own and of its base task.
pub(crate) fn onnx_policy_of(
    file: &ShippedFile,
    definition: &Definition,
) -> Result<OnnxController, MishandleError> {
    let tasks: Vec<&str> = std::iter::once(definition.name).chain(definition.variant_of).collect();
    let described = match file {
        ShippedFile::Path(path) => OnnxPolicy::description(path)?,
        ShippedFile::Embedded { name, bytes } => OnnxPolicy::description_of_bytes(bytes)
            .map_err(|problem| InterchangeError::Onnx { problem, path: name.into() })?,
    };
    let interface = described.action_interface.as_ref();
    let targets = interface.map(|_| JOINT_TARGETS.to_string());
    let layout = definition.layout_with(&described.parts.into_iter().chain(targets).collect::<Vec<_>>());
    let policy = match file {
        ShippedFile::Path(path) => OnnxPolicy::load(path, &tasks, &layout)?,
        ShippedFile::Embedded { name, bytes } => OnnxPolicy::from_bytes(bytes, None, &tasks, &layout)
            .map_err(|problem| InterchangeError::Onnx { problem, path: name.into() })?,
    };
    let policy = OnnxController::from(policy);
    let controller = definition.fit(policy.controller, &layout, interface)?;
    Ok(OnnxController { controller, ..policy })
}

/// Returns whether a path ends with `.onnx`, in any case.
pub fn is_onnx(path: &Path) -> bool {
    path.extension().is_some_and(|found| found.eq_ignore_ascii_case("onnx"))
}
