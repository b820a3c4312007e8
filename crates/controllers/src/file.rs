//! Controller files: safetensors with a JSON header.
//!
//! The tensors are `normalizer.mean` and `normalizer.variance` (`F64`), `policy.log_std` (`F32`,
//! not in a squashed policy) and `policy.layers.0.weight`, `policy.layers.0.bias`, … (`F32`, in
//! PyTorch's layout). The header is JSON text under the key `mishandle` of the file's metadata. A
//! file is written in the oldest version that supports its policy:
//! docs/reference/controller_format.md describes all of them.

use std::path::Path;

use mishandle_files::{limits, read_bounded, write_atomically};
use mishandle_network::{Activation, Mlp, Tensor};
use mishandle_rollout::Controller;
use safetensors::tensor::{Dtype, SafeTensorError, SafeTensors, TensorView};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::checksum::{EMPTY_CHECKSUM, has_valid_checksum, write_checksum};
use crate::interface::interface_hash;
use crate::layout::hexadecimal;
use crate::policy::{DEFAULT_CLIP, GAUSSIAN, SQUASHED};
use crate::{ActionInterface, ControllerError, FileProblem, Layout, Policy, parse_tensors};

/// The newest supported format version. Version 2 has no squashed policies, version 3 no layer
/// normalization, no clip of observations but 5, and of activations only elu, tanh, relu and
/// identity, version 4 no history, version 5 no action interface.
pub const FORMAT_VERSION: u64 = 6;

/// The oldest supported format version.
const OLDEST_VERSION: u64 = 2;

/// The key of the header in the file's metadata.
const HEADER_KEY: &str = "mishandle";

/// The header of a controller file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// The name of the task.
    pub task: String,
    /// The name of the training algorithm.
    pub algorithm: String,
    /// The name of the task's preset.
    pub preset: String,
    /// The name of the reward function.
    pub reward: String,
    /// The layout of observations and actions.
    pub layout: Layout,
    /// How actions become joint targets; `None` if they move the targets directly.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub action_interface: Option<ActionInterface>,
    /// The hash of everything that affects training: physics, initial states, observations, reward.
    /// Empty if unknown.
    pub task_hash: String,
    /// The training record.
    pub training: TrainingRecord,
}

/// The record of how a controller was trained.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainingRecord {
    /// The random seed.
    pub seed: u64,
    /// Environment steps (control steps times environments) up to these weights.
    pub environment_steps: u64,
    /// Wall-clock time, s.
    pub wall_clock_secs: f64,
    /// The Git commit of the program; empty if unknown.
    pub git_commit: String,
    /// The command line.
    pub command: String,
    /// The training settings as TOML.
    pub settings: String,
    /// The last validation of these weights, if any.
    pub validation: Option<ValidationRecord>,
}

/// The result of a validation during training.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ValidationRecord {
    /// The number of episodes.
    pub episodes: usize,
    /// The fraction of episodes that satisfy the success formula.
    pub success_rate: f64,
    /// The fraction of episodes that satisfy the strict formula.
    pub strict_success_rate: f64,
}

/// A controller with its header.
#[derive(Clone, Debug)]
pub struct ControllerFile {
    /// The header.
    pub header: Header,
    /// The controller.
    pub policy: Policy,
}

/// The JSON header as stored, with the fields that are checked before the others.
#[derive(Serialize, Deserialize)]
struct StoredHeader {
    format_version: u64,
    /// The checksum of the file; see [`write_checksum`].
    sha256: String,
    #[serde(flatten)]
    header: Header,
    layout_hash: String,
    policy: StoredPolicy,
}

#[derive(Serialize, Deserialize)]
struct StoredPolicy {
    /// `gaussian` or `squashed-gaussian`.
    kind: String,
    sizes: Vec<usize>,
    hidden_activation: String,
    output_activation: String,
    /// Layer normalization of the hidden layers: `plain`, or `affine` with a gain and a shift per
    /// output.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    layer_norm: Option<String>,
    /// The limit of normalized observations; `null` if they are not clipped.
    #[serde(default = "default_clip", skip_serializing_if = "is_default_clip")]
    observation_clip: Option<f64>,
    /// Number of earlier observations and actions in the input; see [`History`](crate::History).
    #[serde(default, skip_serializing_if = "is_zero")]
    history: usize,
}

fn is_zero(number: &usize) -> bool {
    *number == 0
}

fn default_clip() -> Option<f64> {
    DEFAULT_CLIP
}

fn is_default_clip(clip: &Option<f64>) -> bool {
    *clip == DEFAULT_CLIP
}

/// The kinds of layer normalization in files.
const PLAIN: &str = "plain";
const AFFINE: &str = "affine";

/// The kinds of policies, and the format version written for each: the oldest version that supports
/// it.
pub const WRITTEN_VERSIONS: [(&str, u64); 2] = [(GAUSSIAN, 2), (SQUASHED, 3)];

/// Returns the format version for a kind of policy; `None` if there is no such kind.
fn version_of(kind: &str) -> Option<u64> {
    WRITTEN_VERSIONS.iter().find(|(known, _)| *known == kind).map(|(_, version)| *version)
}

/// Returns the oldest format version that supports a controller.
fn written_version(header: &Header, policy: &Policy) -> u64 {
    if header.action_interface.is_some() {
        return 6;
    }
    if policy.history().length() > 0 {
        return 5;
    }
    let network = policy.network();
    let is_old = |activation| {
        matches!(activation, Activation::Elu | Activation::Tanh | Activation::Relu | Activation::Identity)
    };
    let is_old = policy.observation_clip() == DEFAULT_CLIP
        && !network.has_layer_norm()
        && is_old(network.hidden_activation())
        && is_old(network.output_activation());
    version_of(policy.kind()).filter(|_| is_old).unwrap_or(4)
}

/// Largest number of layers. Training settings allow 100 hidden layers.
const MAX_LAYERS: usize = 101;

/// Largest number of inputs of a network. Layers are padded to whole vectors in memory, which
/// multiplies the size of layers that are long and thin.
const MAX_INPUTS: usize = 1_000_000;

/// Largest number of outputs of a layer, as in training settings.
const MAX_OUTPUTS: usize = 10_000;

impl StoredPolicy {
    /// Checks the bounds of the network's sizes.
    fn has_allowed_sizes(&self) -> bool {
        let is_allowed = |(i, size): (usize, &usize)| *size <= if i == 0 { MAX_INPUTS } else { MAX_OUTPUTS };
        self.sizes.len() <= MAX_LAYERS + 1 && self.sizes.iter().enumerate().all(is_allowed)
    }

    /// Returns the number of parameters; `None` on overflow. Checked before memory is allocated for
    /// them.
    fn parameter_count(&self) -> Option<usize> {
        self.sizes.windows(2).try_fold(0_usize, |count, layer| {
            layer[0].checked_add(1)?.checked_mul(layer[1])?.checked_add(count)
        })
    }
}

impl ControllerFile {
    /// Reads a controller file, a regular file of at most [`limits::CONTROLLER`] bytes.
    ///
    /// # Errors
    /// If the file cannot be read or is larger, is not a controller, is damaged, contains NaN, or
    /// has a format version that this program does not support.
    pub fn load(path: &Path) -> Result<ControllerFile, ControllerError> {
        let bytes = read_bounded(path, limits::CONTROLLER)
            .map_err(|source| ControllerError::Read { source, path: path.to_path_buf() })?;
        Self::from_bytes(&bytes)
            .map_err(|problem| ControllerError::File { problem, path: path.to_path_buf() })
    }

    /// Writes the controller file atomically.
    ///
    /// # Errors
    /// If the file cannot be written. An existing file is then unchanged.
    pub fn save(&self, path: &Path) -> Result<(), ControllerError> {
        write_atomically(path, &self.to_bytes())
            .map_err(|source| ControllerError::Write { source, path: path.to_path_buf() })
    }

    /// Checks that the controller was trained for `task` with this `layout` of observations and
    /// actions.
    ///
    /// # Errors
    /// If it was trained for another task, or with another layout; the message lists the
    /// differences.
    pub fn check(&self, task: &str, layout: &Layout) -> Result<(), ControllerError> {
        if self.header.task != task {
            return Err(ControllerError::Task {
                expected: task.to_string(),
                found: self.header.task.clone(),
            });
        }
        let differences = layout.differences(&self.header.layout);
        if !differences.is_empty() {
            return Err(ControllerError::Layout { task: task.to_string(), differences });
        }
        Ok(())
    }

    /// Returns the hash of everything that determines the actions of the environment: the
    /// [policy](Policy::hash) and, if there is one, the action interface.
    pub fn hash(&self) -> String {
        interface_hash(self.policy.hash(), self.header.action_interface.as_ref())
    }

    /// Returns the bytes of the file. The same controller and header give the same bytes.
    ///
    /// # Panics
    /// Never: the length of every tensor is the product of its shape.
    pub fn to_bytes(&self) -> Vec<u8> {
        let network = self.policy.network();
        let stored = StoredHeader {
            format_version: written_version(&self.header, &self.policy),
            sha256: EMPTY_CHECKSUM.to_string(),
            header: self.header.clone(),
            layout_hash: self.header.layout.hash(),
            policy: StoredPolicy {
                kind: self.policy.kind().to_string(),
                sizes: network.sizes().to_vec(),
                hidden_activation: network.hidden_activation().to_string(),
                output_activation: network.output_activation().to_string(),
                layer_norm: network
                    .has_layer_norm()
                    .then(|| if network.has_affine_layer_norm() { AFFINE } else { PLAIN }.to_string()),
                observation_clip: self.policy.observation_clip(),
                history: self.policy.history().length(),
            },
        };
        let mut tensors = vec![
            stored_f64("normalizer.mean", self.policy.mean()),
            stored_f64("normalizer.variance", self.policy.variance()),
        ];
        if !self.policy.is_squashed() {
            tensors.push(stored_f32("policy.log_std", vec![network.output_size()], self.policy.log_std()));
        }
        for Tensor { name, shape, values } in network.tensors() {
            tensors.push(stored_f32(&format!("policy.{name}"), shape, values));
        }
        let valid = "a header is plain data, and the length of every tensor is the product of its shape";
        let json = serde_json::to_string(&stored).expect(valid);
        let views = tensors.iter().map(|tensor| {
            let view = TensorView::new(tensor.dtype, tensor.shape.clone(), &tensor.bytes).expect(valid);
            (tensor.name.as_str(), view)
        });
        let metadata = std::iter::once((HEADER_KEY.to_string(), json)).collect();
        let mut bytes = safetensors::serialize(views, Some(metadata)).expect(valid);
        write_checksum(&mut bytes);
        bytes
    }

    /// Parses the bytes of a controller file.
    ///
    /// # Errors
    /// If they are not a controller, are damaged, contain NaN, or have a format version that this
    /// program does not support.
    pub fn from_bytes(bytes: &[u8]) -> Result<ControllerFile, FileProblem> {
        if let Some(problem) = foreign_format(bytes) {
            return Err(problem);
        }
        let (tensors, json) =
            parse_tensors(bytes, HEADER_KEY).map_err(|error| file_problem(&error, bytes))?;
        let Some(json) = json else {
            return Err(FileProblem::NotAController { reason: format!("it has no header `{HEADER_KEY}`") });
        };
        let stored = read_header(&json, bytes)?;
        if !stored.policy.has_allowed_sizes() {
            return Err(FileProblem::Header {
                reason: format!(
                    "its network has more than {MAX_LAYERS} layers, {MAX_INPUTS} inputs or {MAX_OUTPUTS} outputs of a layer"
                ),
            });
        }
        if stored.policy.parameter_count().is_none_or(|count| count > bytes.len() / size_of::<f32>()) {
            return Err(FileProblem::Header {
                reason: "its network has more parameters than the file has numbers".to_string(),
            });
        }
        let policy = read_policy(&stored.policy, &tensors)
            .map_err(|source| FileProblem::Policy { source: Box::new(source) })?;
        let StoredHeader { header, .. } = stored;
        let sizes = (policy.observation_size(), policy.action_size());
        if sizes != (header.layout.observation_size(), header.layout.action_size()) {
            return Err(FileProblem::Header { reason: "its layout does not match its network".to_string() });
        }
        Ok(ControllerFile { header, policy })
    }
}

/// Returns the first 16 bytes of the SHA-256 of a file's bytes, in hexadecimal.
pub fn bytes_hash(bytes: &[u8]) -> String {
    hexadecimal(&Sha256::digest(bytes)[..16])
}

struct StoredTensor {
    name: String,
    dtype: Dtype,
    shape: Vec<usize>,
    bytes: Vec<u8>,
}

fn stored_f64(name: &str, values: &[f64]) -> StoredTensor {
    let bytes = values.iter().flat_map(|x| x.to_le_bytes()).collect();
    StoredTensor { name: name.to_string(), dtype: Dtype::F64, shape: vec![values.len()], bytes }
}

fn stored_f32(name: &str, shape: Vec<usize>, values: &[f32]) -> StoredTensor {
    let bytes = values.iter().flat_map(|x| x.to_le_bytes()).collect();
    StoredTensor { name: name.to_string(), dtype: Dtype::F32, shape, bytes }
}

/// Recognizes the formats of other tools by their first bytes.
fn foreign_format(bytes: &[u8]) -> Option<FileProblem> {
    // The first field of an ONNX model is its version, below 64; that of a safetensors file is the
    // length of its header, and its ninth byte is a brace.
    let is_onnx = matches!(bytes, [8, 1..64, 0x12 | 0x1A | 0x3A | 0x42, ..]) && bytes.get(8) != Some(&b'{');
    match bytes {
        [b'P', b'K', 3, 4, ..] => Some(FileProblem::Archive),
        [0x80, 2..=5, ..] if bytes.get(8) != Some(&b'{') => Some(FileProblem::Pickle),
        _ if is_onnx => Some(FileProblem::Onnx),
        _ => None,
    }
}

/// Converts an error of the safetensors parser. A file that starts like a safetensors file is
/// reported as damaged.
fn file_problem(error: &SafeTensorError, bytes: &[u8]) -> FileProblem {
    let starts_like_safetensors = bytes.get(8) == Some(&b'{');
    match error {
        SafeTensorError::MetadataIncompleteBuffer | SafeTensorError::InvalidHeaderLength
            if starts_like_safetensors =>
        {
            FileProblem::Length { found: bytes.len() }
        }
        other => FileProblem::NotAController { reason: other.to_string() },
    }
}

fn read_header(json: &str, bytes: &[u8]) -> Result<StoredHeader, FileProblem> {
    let invalid = |reason: String| FileProblem::Header { reason };
    let value: serde_json::Value = serde_json::from_str(json).map_err(|error| invalid(error.to_string()))?;
    let Some(found) = value.get("format_version").and_then(serde_json::Value::as_u64) else {
        return Err(invalid("it has no `format_version`".to_string()));
    };
    if found > FORMAT_VERSION {
        return Err(FileProblem::NewerVersion { found, supported: FORMAT_VERSION });
    }
    if found < OLDEST_VERSION {
        return Err(FileProblem::OlderVersion { found, supported: OLDEST_VERSION });
    }
    if !has_valid_checksum(bytes) {
        return Err(FileProblem::ChecksumMismatch);
    }
    let stored: StoredHeader = serde_json::from_value(value).map_err(|error| invalid(error.to_string()))?;
    if stored.layout_hash != stored.header.layout.hash() {
        return Err(invalid("its layout does not match its `layout_hash`".to_string()));
    }
    if version_of(&stored.policy.kind).is_none() {
        return Err(invalid(format!(
            "the policy's kind is `{}`; known kinds: `{GAUSSIAN}`, `{SQUASHED}`",
            stored.policy.kind
        )));
    }
    if let Some(found) = stored.policy.layer_norm.as_deref().filter(|found| ![PLAIN, AFFINE].contains(found))
    {
        return Err(invalid(format!("its `layer_norm` is `{found}`; expected `{PLAIN}` or `{AFFINE}`")));
    }
    Ok(stored)
}

fn read_policy(stored: &StoredPolicy, file: &SafeTensors<'_>) -> Result<Policy, ControllerError> {
    let hidden_activation: Activation = stored.hidden_activation.parse()?;
    let mut network = Mlp::new(&stored.sizes, hidden_activation, stored.output_activation.parse()?)?;
    match stored.layer_norm.as_deref() {
        Some(AFFINE) => network = network.with_affine_layer_norm(),
        Some(_) => network = network.with_layer_norm(),
        None => {}
    }
    let mut mean = vec![];
    let mut variance = vec![];
    let mut log_std = vec![];
    let mut layers = vec![];
    let mut tensors = file.tensors();
    tensors.sort_by(|(a, _), (b, _)| a.cmp(b));
    for (name, view) in tensors {
        match name.as_str() {
            "normalizer.mean" => mean = f64s(&view),
            "normalizer.variance" => variance = f64s(&view),
            "policy.log_std" => log_std = f32s(&view),
            _ => {
                let name = name.strip_prefix("policy.").unwrap_or(&name).to_string();
                layers.push((name, view.shape().to_vec(), f32s(&view)));
            }
        }
    }
    let layers: Vec<_> = layers
        .iter()
        .map(|(name, shape, values)| Tensor { name: name.clone(), shape: shape.clone(), values })
        .collect();
    network.set_tensors(&layers)?;
    let log_std = (stored.kind != SQUASHED).then_some(log_std);
    let policy = Policy::with_history(stored.history, mean, variance, network, log_std)?;
    policy.with_observation_clip(stored.observation_clip)
}

/// Returns the numbers of a tensor; an empty vector if its type differs, which later fails the
/// check of its length.
fn f64s(view: &TensorView<'_>) -> Vec<f64> {
    let (numbers, _) = view.data().as_chunks();
    if view.dtype() == Dtype::F64 { numbers.iter().map(|x| f64::from_le_bytes(*x)).collect() } else { vec![] }
}

fn f32s(view: &TensorView<'_>) -> Vec<f32> {
    let (numbers, _) = view.data().as_chunks();
    if view.dtype() == Dtype::F32 { numbers.iter().map(|x| f32::from_le_bytes(*x)).collect() } else { vec![] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Entry;

    fn example() -> ControllerFile {
        let mut network = Mlp::new(&[2, 3, 1], Activation::Elu, Activation::Identity).unwrap();
        network.update(|parameters| {
            for (i, parameter) in parameters.iter_mut().enumerate() {
                *parameter = (i as f32 * 0.37).sin();
            }
        });
        let entry = |name: &str, size| Entry { name: name.into(), unit: "m".into(), size };
        let layout = Layout { observation: vec![entry("ball", 2)], action: vec![entry("push", 1)] };
        let header = Header {
            task: "ball-pushing".into(),
            algorithm: "ppo".into(),
            preset: "paper".into(),
            reward: "shaped".into(),
            layout,
            action_interface: None,
            task_hash: "0123".into(),
            training: TrainingRecord { seed: u64::MAX, wall_clock_secs: 1.5, ..TrainingRecord::default() },
        };
        // 0.1 and 0.7 have no short binary form: a round trip through text could change them.
        let policy = Policy::new(vec![0.1, -3.0], vec![0.7, 0.2], network, vec![-0.3]).unwrap();
        ControllerFile { header, policy }
    }

    /// Returns the error message for these bytes.
    fn error_message(bytes: &[u8]) -> String {
        ControllerFile::from_bytes(bytes).unwrap_err().to_string()
    }

    /// Returns the example's bytes with `from` replaced by `to`, of the same length, in the header,
    /// and a new checksum.
    fn with_header(from: &str, to: &str) -> Vec<u8> {
        assert_eq!(from.len(), to.len());
        let mut bytes = example().to_bytes();
        let at = bytes.windows(from.len()).position(|window| window == from.as_bytes()).unwrap();
        bytes[at..][..to.len()].copy_from_slice(to.as_bytes());
        write_checksum(&mut bytes);
        bytes
    }

    #[test]
    fn a_controller_survives_a_round_trip_bit_for_bit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("ppo.safetensors");
        let saved = example();
        saved.save(&path).unwrap();
        let loaded = ControllerFile::load(&path).unwrap();
        assert_eq!(loaded.header, saved.header);
        assert_eq!(loaded.policy.hash(), saved.policy.hash());
        assert_eq!(loaded.to_bytes(), saved.to_bytes());
        let mut a = [0.0];
        let mut b = [0.0];
        saved.policy.worker().act(1, &[0.3, 0.9], &mut [], &mut a);
        loaded.policy.worker().act(1, &[0.3, 0.9], &mut [], &mut b);
        assert_eq!(a, b);
    }

    #[test]
    fn a_squashed_controller_survives_a_round_trip_bit_for_bit() {
        let mut saved = example();
        let mut network = Mlp::new(&[2, 3, 2], Activation::Elu, Activation::Identity).unwrap();
        network.update(|parameters| {
            parameters.iter_mut().zip(0..).for_each(|(parameter, i)| *parameter = (0.7 * i as f32).sin());
        });
        saved.policy = Policy::squashed(vec![0.1, -3.0], vec![0.7, 0.2], network).unwrap();
        let loaded = ControllerFile::from_bytes(&saved.to_bytes()).unwrap();
        assert!(loaded.policy.is_squashed());
        assert_eq!(loaded.policy.hash(), saved.policy.hash());
        assert_eq!(loaded.to_bytes(), saved.to_bytes());
        let version =
            |file: &ControllerFile| String::from_utf8_lossy(&file.to_bytes()).contains("version\\\":3");
        assert_eq!((version(&saved), version(&example())), (true, false));
    }

    #[test]
    fn activations_layer_normalization_and_clip_survive_a_round_trip_as_version_4() {
        let mut saved = example();
        let mut network =
            Mlp::new(&[2, 3, 1], Activation::Silu, Activation::Identity).unwrap().with_affine_layer_norm();
        let gain = [1.5, -2.0, 0.25];
        let zeros = [0.0; 6];
        let tensor =
            |name: &str, shape: &[usize], values| Tensor { name: name.into(), shape: shape.to_vec(), values };
        network
            .set_tensors(&[
                tensor("layers.0.weight", &[3, 2], &zeros),
                tensor("layers.0.bias", &[3], &gain),
                tensor("layers.0.norm.weight", &[3], &gain),
                tensor("layers.0.norm.bias", &[3], &zeros[..3]),
                tensor("layers.1.weight", &[1, 3], &gain),
                tensor("layers.1.bias", &[1], &zeros[..1]),
            ])
            .unwrap();
        let policy = Policy::new(vec![0.1, -3.0], vec![0.7, 0.2], network, vec![-0.3]).unwrap();
        for clip in [None, Some(10.0)] {
            saved.policy = policy.clone().with_observation_clip(clip).unwrap();
            let loaded = ControllerFile::from_bytes(&saved.to_bytes()).unwrap();
            assert_eq!(loaded.policy.observation_clip(), clip);
            assert!(loaded.policy.network().has_affine_layer_norm());
            assert_eq!(loaded.policy.hash(), saved.policy.hash());
            assert_eq!(loaded.to_bytes(), saved.to_bytes());
            assert!(String::from_utf8_lossy(&saved.to_bytes()).contains("version\\\":4"));
        }
    }

    #[test]
    fn a_history_survives_a_round_trip_as_version_5_and_older_files_have_none() {
        let mut saved = example();
        // Two numbers, and two more with an action.
        let mut network = Mlp::new(&[5, 3, 1], Activation::Elu, Activation::Identity).unwrap();
        network.update(|parameters| parameters.fill(0.3));
        let mean = vec![0.1, -3.0];
        let variance = vec![0.7, 0.2];
        saved.policy = Policy::with_history(1, mean, variance, network, Some(vec![-0.3])).unwrap();
        let bytes = saved.to_bytes();
        let loaded = ControllerFile::from_bytes(&bytes).unwrap();
        assert_eq!(loaded.policy.history(), saved.policy.history());
        assert_eq!((loaded.policy.hash(), loaded.to_bytes()), (saved.policy.hash(), bytes.clone()));
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        assert!(text(&bytes).contains("version\\\":5") && text(&bytes).contains("history\\\":1"));
        let old = example().to_bytes();
        assert!(!text(&old).contains("history"));
        assert_eq!(ControllerFile::from_bytes(&old).unwrap().policy.history().length(), 0);

        // A history that the network does not have.
        let mut damaged = bytes;
        let at = damaged.windows(11).position(|window| window == b"history\\\":1").unwrap();
        damaged[at + 10] = b'2';
        write_checksum(&mut damaged);
        let message = "the controller is damaged: the policy's observation with its history has 8 numbers; its network needs 5";
        assert_eq!(error_message(&damaged), message);
    }

    #[test]
    fn an_action_interface_survives_a_round_trip_as_version_6_and_older_files_have_none() {
        let mut saved = example();
        let old = saved.to_bytes();
        assert_eq!(ControllerFile::from_bytes(&old).unwrap().header.action_interface, None);
        assert_eq!(saved.hash(), saved.policy.hash());
        let interface = ActionInterface {
            velocity: vec![2.175],
            acceleration: vec![0.1],
            target_velocity: vec![3.0],
            margin: 0.05,
            lead: 0.2,
        };
        saved.header.action_interface = Some(interface.clone());
        let bytes = saved.to_bytes();
        let loaded = ControllerFile::from_bytes(&bytes).unwrap();
        assert_eq!(loaded.header.action_interface, Some(interface.clone()));
        assert_eq!((loaded.hash(), loaded.to_bytes()), (saved.hash(), bytes.clone()));
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        assert!(text(&bytes).contains("version\\\":6") && !text(&old).contains("action_interface"));
        // Each number belongs to the hash.
        let other = |change: fn(&mut ActionInterface)| {
            let mut interface = interface.clone();
            change(&mut interface);
            interface_hash(saved.policy.hash(), Some(&interface))
        };
        let hashes = [
            other(|_| {}),
            other(|interface| interface.velocity[0] = 2.0),
            other(|interface| interface.acceleration[0] = 0.2),
            other(|interface| interface.target_velocity[0] = 4.0),
            other(|interface| interface.margin = 0.0),
            other(|interface| interface.lead = 0.0),
            saved.policy.hash(),
        ];
        assert_eq!(hashes[0], saved.hash());
        assert!(hashes.iter().enumerate().all(|(i, hash)| !hashes[..i].contains(hash)));

        // An unknown number.
        let mut damaged = bytes;
        let at = damaged.windows(8).position(|window| window == b"\"margin\\").unwrap();
        damaged[at + 1] = b'M';
        write_checksum(&mut damaged);
        assert!(error_message(&damaged).contains("unknown field `Margin`"), "{}", error_message(&damaged));
    }

    #[test]
    fn the_header_does_not_change_the_hash_of_the_policy() {
        let mut later = example();
        later.header.training.wall_clock_secs = 99.0;
        assert_eq!(later.policy.hash(), example().policy.hash());
        assert_ne!(bytes_hash(&later.to_bytes()), bytes_hash(&example().to_bytes()));
    }

    #[test]
    fn other_files_are_errors() {
        for (bytes, advice) in [
            (&b"PK\x03\x04 an archive of some kind"[..], "which an import converts"),
            (b"\x80\x04\x95\x10\0\0\0\0\0\0\0}", "is a pickle, which can run any code"),
            (b"\x08\x08\x12\x09mishandle\x3a", "an ONNX model, which runs as it is"),
        ] {
            assert!(error_message(bytes).contains(advice), "{}", error_message(bytes));
        }
        for bytes in [&b""[..], b"short", &[0xFF; 64]] {
            assert!(error_message(bytes).starts_with("not a controller ("), "{}", error_message(bytes));
        }
        let foreign = TensorView::new(Dtype::F32, vec![1], &[0; 4]).unwrap();
        let bytes = safetensors::serialize([("weight", foreign)], None).unwrap();
        assert!(error_message(&bytes).contains("it has no header `mishandle`"), "{}", error_message(&bytes));
    }

    #[test]
    fn a_truncated_or_extended_file_is_an_error() {
        let bytes = example().to_bytes();
        for length in 0..bytes.len() {
            assert!(ControllerFile::from_bytes(&bytes[..length]).is_err(), "cut to {length} bytes");
        }
        let half = &bytes[..bytes.len() / 2];
        let expected = format!(
            "the controller is damaged: its length of {} bytes does not match its header",
            half.len()
        );
        assert_eq!(error_message(half), expected);
        assert!(error_message(&[&bytes[..], b"more"].concat()).contains("does not match its header"));
    }

    #[test]
    fn a_single_changed_bit_is_detected() {
        let mut bytes = example().to_bytes();
        for index in 0..bytes.len() {
            for bit in 0..8 {
                bytes[index] ^= 1 << bit;
                assert!(ControllerFile::from_bytes(&bytes).is_err(), "bit {bit} of byte {index}");
                bytes[index] ^= 1 << bit;
            }
        }
        let last = bytes.len() - 1;
        bytes[last] ^= 1;
        assert_eq!(
            error_message(&bytes),
            "the controller is damaged: its checksum does not match; restore the file from a copy"
        );
    }

    #[test]
    fn an_invalid_header_or_one_of_another_version_is_an_error() {
        let version = "format_version\\\":";
        assert_eq!(
            error_message(&with_header(&format!("{version}2"), &format!("{version}7"))),
            "the controller has format version 7, but this program supports versions up to 6; use a newer version of the \
             program"
        );
        assert_eq!(
            error_message(&with_header(&format!("{version}2"), &format!("{version}1"))),
            "the controller has format version 1, but this program supports versions from 2 on; train or convert it again"
        );
        for (from, to, expected) in [
            ("ball\\\",", "bull\\\",", "its layout does not match its `layout_hash`"),
            ("gaussian", "caussian", "the policy's kind is `caussian`; known kinds: `gaussian`, "),
            ("[2,3,1]", "[9e9,3]", "invalid type: floating point"),
            ("[2,3,1]", "[2,4,1]", "tensor `layers.0.weight` must have the shape [4, 2]"),
            ("[2,3,1]", "[999,9]", "its network has more parameters than the file has numbers"),
            ("[2,3,1]", "[2,0,1]", "sizes"),
            ("\\\"elu\\\"", "\\\"elv\\\"", "activation `elv` is not known"),
        ] {
            let message = error_message(&with_header(from, to));
            assert!(message.contains(expected), "{from} -> {to}: {message}");
            assert!(!message.contains('\n'));
        }
    }

    #[test]
    fn sizes_that_overflow_are_an_error() {
        let half = usize::MAX / 2 + 1;
        let mut file = example();
        file.header.layout.observation = ["a", "b", "c", "d"]
            .map(|name| Entry { name: name.into(), unit: "m".into(), size: half })
            .to_vec();
        // The sum of the sizes is 0 modulo 2^64.
        assert!(error_message(&file.to_bytes()).contains("its layout does not match its network"));
        for (sizes, expected) in [
            (
                format!("[2,{half},{half},1]"),
                "its network has more than 101 layers, 1000000 inputs or 10000 outputs",
            ),
            (format!("[{half},1]"), "1000000 inputs"),
            (format!("[{}1]", "1,".repeat(102)), "more than 101 layers"),
            (format!("[2,{}1]", "10000,".repeat(100)), "more parameters than the file has numbers"),
            (format!("[{}1]", "1,".repeat(100)), "tensor"),
        ] {
            let message = error_message(&with_sizes(&sizes));
            assert!(message.contains(expected), "{sizes}: {message}");
        }
    }

    /// Returns the example's bytes with other sizes in the header, and a new checksum.
    fn with_sizes(sizes: &str) -> Vec<u8> {
        let bytes = example().to_bytes();
        let at = bytes.windows(7).position(|window| window == b"[2,3,1]").unwrap();
        let mut changed = [&bytes[..at], sizes.as_bytes(), &bytes[at + 7..]].concat();
        let header = u64::from_le_bytes(bytes[..8].try_into().unwrap()) + sizes.len() as u64 - 7;
        changed[..8].copy_from_slice(&header.to_le_bytes());
        write_checksum(&mut changed);
        changed
    }

    #[test]
    fn only_regular_files_of_bounded_size_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let message = |path: &Path| {
            let error = ControllerFile::load(path).unwrap_err();
            std::error::Error::source(&error).unwrap().to_string()
        };
        assert_eq!(message(Path::new("/dev/zero")), "expected a regular file, found a device");
        assert_eq!(message(folder.path()), "expected a regular file, found a directory");
        let sparse = folder.path().join("a.safetensors");
        std::fs::File::create(&sparse).unwrap().set_len(1 << 40).unwrap();
        assert_eq!(message(&sparse), "the file has 1099511627776 bytes; the limit is 268435456");
    }

    #[test]
    fn nan_weights_are_an_error() {
        let mut bytes = example().to_bytes();
        let last = bytes.len() - 4;
        bytes[last..].copy_from_slice(&f32::NAN.to_le_bytes());
        write_checksum(&mut bytes);
        assert!(error_message(&bytes).contains("is NaN; it must be finite"), "{}", error_message(&bytes));
    }

    #[test]
    fn a_controller_for_another_task_or_layout_is_an_error() {
        let file = example();
        assert!(file.check("ball-pushing", &file.header.layout).is_ok());
        let message = file.check("ball-catching", &file.header.layout).unwrap_err().to_string();
        assert_eq!(message, "the controller was trained for ball-pushing, not for ball-catching");
        let mut other = file.header.layout.clone();
        other.observation[0].name = "cube".to_string();
        let message = file.check("ball-pushing", &other).unwrap_err().to_string();
        assert_eq!(
            message,
            "the controller does not fit ball-pushing: part 0 of the observation is `cube` (2 numbers, m), \
             but the controller expects `ball` (2 numbers, m)"
        );
    }

    #[test]
    fn a_missing_file_is_reported_with_its_path() {
        let error = ControllerFile::load(Path::new("/nowhere/ppo.safetensors")).unwrap_err();
        assert_eq!(error.to_string(), "cannot read the controller /nowhere/ppo.safetensors");
        assert!(std::error::Error::source(&error).is_some());
    }
}
