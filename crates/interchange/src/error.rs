use std::fmt;
use std::path::PathBuf;

/// The error of reading a policy in the format of another tool.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum InterchangeError {
    /// The file cannot be read.
    #[error("cannot read {}", path.display())]
    Read {
        /// The error of the operating system.
        source: std::io::Error,
        /// The file.
        path: PathBuf,
    },
    /// The ONNX model cannot be used.
    #[error("{problem}: {}", path.display())]
    Onnx {
        /// Problem of the model.
        problem: OnnxProblem,
        /// The file.
        path: PathBuf,
    },
    /// The checkpoint cannot be imported.
    #[error("{problem}: {}", path.display())]
    Torch {
        /// Problem of the checkpoint.
        problem: TorchProblem,
        /// The file.
        path: PathBuf,
    },
    /// The statistics of the normalizer are invalid.
    #[error("the normalizer is invalid, {reason}; docs/guide/import.md shows how to write it: {}", path.display())]
    Normalizer {
        /// Problem of the file.
        reason: String,
        /// The file.
        path: PathBuf,
    },
}

/// The problem of a checkpoint of PyTorch.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TorchProblem {
    /// The archive is damaged, or is none.
    #[error("not an archive of PyTorch or Stable-Baselines3: {reason}")]
    Archive {
        /// Problem of the file.
        reason: String,
    },
    /// The pickle in the archive is damaged or too large.
    #[error("the pickle in the archive cannot be read as data: {reason}")]
    Pickle {
        /// Problem of the file.
        reason: String,
    },
    /// The pickle in the archive contains more than tensors.
    #[error(
        "the pickle in the archive refers to `{name}`, which is not part of a state dictionary; nothing was executed; save \
         `model.state_dict()` instead of the model"
    )]
    Code {
        /// The name of the class or function.
        name: String,
    },
    /// A tensor is not inside its storage, or its storage is missing.
    #[error("the archive is damaged: the numbers of the tensor `{name}` are not inside it")]
    Tensor {
        /// The name of the tensor.
        name: String,
    },
    /// A tensor has numbers of 16 bits.
    #[error(
        "the tensor `{name}` has 16-bit numbers; expected 32 or 64 bits: save `model.float().state_dict()`"
    )]
    Precision {
        /// The name of the tensor.
        name: String,
    },
    /// The tensors are not those of a multi-layer perceptron.
    #[error(
        "the policy is not a multi-layer perceptron: {reason}; export it as ONNX instead (docs/guide/onnx.md)"
    )]
    Layers {
        /// The part that does not fit.
        reason: String,
    },
    /// The file does not say how the policy acts.
    #[error("the file does not say which {what} the policy has{because}")]
    Unknown {
        /// The missing part.
        what: PolicyPart,
        /// The reason, in parentheses, or nothing.
        because: String,
    },
    /// The observations are normalized in a way that a controller cannot follow.
    #[error("its preprocessor of observations is not a RunningStandardScaler")]
    Preprocessor,
    /// The user says something else than the file.
    #[error("the file says that the {what} is {found}, not {given}")]
    Contradiction {
        /// The part.
        what: PolicyPart,
        /// The value in the file.
        found: String,
        /// The value that the user gave.
        given: String,
    },
    /// The policy acts in a way that a controller cannot follow.
    #[error("an import would not act as the policy does: {reason}; {way_out}")]
    Differs {
        /// The part that a controller lacks.
        reason: String,
        /// Advice to the user.
        way_out: String,
    },
    /// The policy does not fit the task.
    #[error("the policy does not fit {task}: it has {found} numbers per {side}, but the task has {expected}")]
    Size {
        /// The task.
        task: String,
        /// `observation` or `action`.
        side: &'static str,
        /// The numbers of the policy.
        found: usize,
        /// The numbers of the task.
        expected: usize,
    },
    /// A number is not finite, or a statistic is invalid.
    #[error(transparent)]
    Controller(#[from] mishandle_controllers::ControllerError),
}

/// A part of a policy that the user can state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PolicyPart {
    /// The activation of the hidden layers.
    HiddenActivation,
    /// The activation of the last layer.
    OutputActivation,
    /// The statistics of the observations.
    Normalizer,
}

impl fmt::Display for PolicyPart {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            PolicyPart::HiddenActivation => "activation of the hidden layers",
            PolicyPart::OutputActivation => "activation of the last layer",
            PolicyPart::Normalizer => "statistics of VecNormalize",
        })
    }
}

/// The problem of an ONNX model.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OnnxProblem {
    /// The program was built without the feature `onnx`.
    #[error("this program was built without its feature `onnx`")]
    NotBuilt,
    /// The bytes are not an ONNX model, or a damaged one.
    #[error("not a valid ONNX model: {reason}")]
    Format {
        /// Problem of the bytes.
        reason: String,
    },
    /// The model has something that is not supported.
    #[error("the ONNX model has {found}, which is not supported; {hint}")]
    Unsupported {
        /// The unsupported part.
        found: String,
        /// Advice to the user.
        hint: String,
    },
    /// The model would need too much memory or time.
    #[error("the ONNX model is too large: {reason}")]
    Size {
        /// The size and the limit.
        reason: String,
    },
    /// An operator fails on an observation of zeros.
    #[error("the ONNX model cannot be computed: {reason}")]
    Run {
        /// The error of the operator.
        reason: String,
    },
    /// The description of inputs and outputs is invalid.
    #[error("the description of the ONNX model's inputs and outputs ({place}) is invalid: {reason}")]
    Interface {
        /// The side file or the metadata.
        place: String,
        /// Problem of the file.
        reason: String,
    },
    /// The model is for another task.
    #[error("the ONNX model is for {found}, not for {expected}")]
    Task {
        /// The task to run.
        expected: String,
        /// The task of the model.
        found: String,
    },
    /// The layout of observations or actions differs from that of the task.
    #[error("the ONNX model does not fit {task}: {}", differences.join("; "))]
    Layout {
        /// The task to run.
        task: String,
        /// The differences, one sentence each.
        differences: Vec<String>,
    },
    /// The shape of an input or output does not fit the task.
    #[error(
        "the ONNX model does not fit {task}: its {side} `{name}` has the shape {found}, but the task has {expected} numbers per {side}; expected the shape [N, {expected}]"
    )]
    Shape {
        /// The task to run.
        task: String,
        /// `observation` or `action`.
        side: &'static str,
        /// The name of the input or output.
        name: String,
        /// Its shape.
        found: String,
        /// The numbers of the task.
        expected: usize,
    },
    /// An input or output of a model without a task is not a vector of a fixed size.
    #[error(
        "the {side} `{name}` of the ONNX model has the shape {found}; expected [N, SIZE] with a fixed SIZE, of 32-bit floating-point numbers"
    )]
    NoVector {
        /// `observation` or `action`.
        side: &'static str,
        /// The name of the input or output.
        name: String,
        /// Its shape.
        found: String,
    },
}
