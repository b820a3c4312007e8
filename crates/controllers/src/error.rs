use std::path::PathBuf;

use mishandle_network::NetworkError;

/// The error of creating, reading, writing or checking a controller.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ControllerError {
    /// The file is not a valid controller.
    #[error("{problem}: {}", path.display())]
    File {
        /// Problem of the file.
        problem: FileProblem,
        /// The file.
        path: PathBuf,
    },
    /// The file cannot be read.
    #[error("cannot read the controller {}", path.display())]
    Read {
        /// The error of the operating system.
        source: std::io::Error,
        /// The file.
        path: PathBuf,
    },
    /// The file cannot be written.
    #[error("cannot write the controller {}", path.display())]
    Write {
        /// The error of the operating system.
        source: std::io::Error,
        /// The file.
        path: PathBuf,
    },
    /// The controller was trained for another task.
    #[error("the controller was trained for {found}, not for {expected}")]
    Task {
        /// The task to run.
        expected: String,
        /// The task it was trained for.
        found: String,
    },
    /// The observations or actions of the controller differ from those of the task.
    #[error("the controller does not fit {task}: {}", differences.join("; "))]
    Layout {
        /// The task to run.
        task: String,
        /// The differences, one sentence each.
        differences: Vec<String>,
    },
    /// The length of a part of a policy does not match its network.
    #[error("the policy's {what} has {found} numbers; its network needs {expected}")]
    Size {
        /// The part.
        what: &'static str,
        /// The length that the network needs.
        expected: usize,
        /// The length of the part.
        found: usize,
    },
    /// The logarithm of a standard deviation is NaN or infinite.
    #[error("number {index} of the policy's `log_std` is {found}; it must be finite")]
    LogStd {
        /// Its index, from 0.
        index: usize,
        /// Its value.
        found: f32,
    },
    /// The limit of normalized observations is not a positive number.
    #[error("normalized observations cannot be clipped to ±{found}; give a positive number, or none")]
    Clip {
        /// The limit.
        found: f64,
    },
    /// The layout of a controller with an action interface does not have the joint targets.
    #[error(
        "an action interface needs the part `joint_targets` of the observation; the layout does not name it"
    )]
    NoJointTargets,
    /// A limit of the action interface is not a positive number.
    #[error("one of the {what} of the action interface is {found}; expected positive numbers")]
    InterfaceLimit {
        /// The limits.
        what: &'static str,
        /// The number.
        found: f64,
    },
    /// The action interface has another number of joints than the arm.
    #[error("the action interface has {found} {what}; the arm has {expected} joints")]
    InterfaceJoints {
        /// The limits.
        what: &'static str,
        /// The number of joints of the arm.
        expected: usize,
        /// The number of limits.
        found: usize,
    },
    /// The target of a joint may not move as fast as its acceleration and lead demand.
    #[error("the target of joint {} may move at {found} rad/s; with its acceleration and lead, it needs {least} rad/s", joint + 1)]
    TargetVelocity {
        /// Index of the joint.
        joint: usize,
        /// Its largest velocity.
        found: f64,
        /// The velocity that it needs.
        least: f64,
    },
    /// A number of the action interface is out of its range.
    #[error(
        "the {what} of the action interface is {found} {unit}; expected a number from 0 to below {below} {unit}"
    )]
    InterfaceNumber {
        /// The number.
        what: &'static str,
        /// Its value.
        found: f64,
        /// Bound of the range.
        below: f64,
        /// Unit.
        unit: &'static str,
    },
    /// The network or the normalizer is invalid.
    #[error(transparent)]
    Network(#[from] NetworkError),
}

/// The problem of an invalid controller file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FileProblem {
    /// The file has another format.
    #[error(
        "not a controller ({reason}); expected a .safetensors file that a training or an import wrote, or an .onnx file"
    )]
    NotAController {
        /// How this was detected.
        reason: String,
    },
    /// The file is an archive, as those of PyTorch and Stable-Baselines3.
    #[error(
        "this is a zip archive, such as a model of Stable-Baselines3 (.zip) or a checkpoint of PyTorch or skrl (.pt), \
         which an import converts"
    )]
    Archive,
    /// The file is an ONNX model.
    #[error("this is an ONNX model, which runs as it is and has no record of a training")]
    Onnx,
    /// The file is a pickle.
    #[error(
        "this is a pickle, which can run any code when it is loaded, so this program does not read it; if you trust it, load it \
         with its own library and save the policy with `model.save`, `torch.save` or `torch.onnx.export` (docs/guide/onnx.md)"
    )]
    Pickle,
    /// The file was truncated or extended.
    #[error("the controller is damaged: its length of {found} bytes does not match its header")]
    Length {
        /// The length of the file in bytes.
        found: usize,
    },
    /// The checksum does not match the bytes.
    #[error("the controller is damaged: its checksum does not match; restore the file from a copy")]
    ChecksumMismatch,
    /// The header is invalid although its format version is supported.
    #[error("the controller's header is invalid: {reason}")]
    Header {
        /// Problem of the header.
        reason: String,
    },
    /// The file was written by a newer version of the program.
    #[error(
        "the controller has format version {found}, but this program supports versions up to {supported}; use a newer \
     version of the program"
    )]
    NewerVersion {
        /// The version of the file.
        found: u64,
        /// The newest supported version.
        supported: u64,
    },
    /// The file has a format that this program no longer supports.
    #[error(
        "the controller has format version {found}, but this program supports versions from {supported} on; train or convert \
     it again"
    )]
    OlderVersion {
        /// The version of the file.
        found: u64,
        /// The oldest supported version.
        supported: u64,
    },
    /// The tensors do not form a policy.
    #[error("the controller is damaged: {source}")]
    Policy {
        /// Problem of the tensors.
        source: Box<ControllerError>,
    },
}
