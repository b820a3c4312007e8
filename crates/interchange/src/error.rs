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
        /// What is wrong with the model.
        problem: OnnxProblem,
        /// The file.
        path: PathBuf,
    },
}

/// The problem of an ONNX model.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OnnxProblem {
    /// The bytes are not an ONNX model, or a damaged one.
    #[error("not a valid ONNX model: {reason}")]
    Format {
        /// What is wrong with the bytes.
        reason: String,
    },
    /// The model has something that is not supported.
    #[error("the ONNX model has {found}, which is not supported; {hint}")]
    Unsupported {
        /// The unsupported part.
        found: String,
        /// What to do.
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
        /// What is wrong with it.
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
}
