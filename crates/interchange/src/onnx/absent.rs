//! The policy of a build without the feature `onnx`.

use std::convert::Infallible;
use std::path::Path;

use mishandle_controllers::Layout;
use mishandle_rollout::{Controller, ControllerWorker};

use super::{OnnxDescription, OnnxSummary};
use crate::{InterchangeError, OnnxProblem};

impl OnnxSummary {
    /// Returns the error that names the feature.
    ///
    /// # Errors
    /// Always.
    pub fn read(path: &Path) -> Result<OnnxSummary, InterchangeError> {
        Err(InterchangeError::Onnx { problem: OnnxProblem::NotBuilt, path: path.to_path_buf() })
    }
}

/// A policy in an ONNX model, which this build cannot read.
#[derive(Debug)]
pub struct OnnxPolicy {
    never: Infallible,
}

impl OnnxPolicy {
    /// Returns the error that names the feature.
    ///
    /// # Errors
    /// Always.
    pub fn load(path: &Path, _tasks: &[&str], _layout: &Layout) -> Result<OnnxPolicy, InterchangeError> {
        Err(InterchangeError::Onnx { problem: OnnxProblem::NotBuilt, path: path.to_path_buf() })
    }

    /// Returns the error that names the feature.
    ///
    /// # Errors
    /// Always.
    pub fn load_named(
        path: &Path,
        tasks: &[&str],
        layout: &Layout,
        _names: [Option<&str>; 2],
    ) -> Result<OnnxPolicy, InterchangeError> {
        Self::load(path, tasks, layout)
    }

    /// Returns the error that names the feature.
    ///
    /// # Errors
    /// Always.
    pub fn load_with_own_sizes(path: &Path) -> Result<OnnxPolicy, InterchangeError> {
        Err(InterchangeError::Onnx { problem: OnnxProblem::NotBuilt, path: path.to_path_buf() })
    }

    /// Returns the error that names the feature.
    ///
    /// # Errors
    /// Always.
    pub fn from_bytes(
        _bytes: &[u8],
        _interface: Option<Infallible>,
        _tasks: &[&str],
        _layout: &Layout,
    ) -> Result<OnnxPolicy, OnnxProblem> {
        Err(OnnxProblem::NotBuilt)
    }

    /// Returns the error that names the feature.
    ///
    /// # Errors
    /// Always.
    pub fn description(path: &Path) -> Result<OnnxDescription, InterchangeError> {
        Err(InterchangeError::Onnx { problem: OnnxProblem::NotBuilt, path: path.to_path_buf() })
    }

    /// Returns the error that names the feature.
    ///
    /// # Errors
    /// Always.
    pub fn description_of_bytes(_bytes: &[u8]) -> Result<OnnxDescription, OnnxProblem> {
        Err(OnnxProblem::NotBuilt)
    }

    /// Returns the hash of what the policy computes.
    pub fn hash(&self) -> &str {
        match self.never {}
    }

    /// Returns the hash of the file.
    pub fn file_hash(&self) -> &str {
        match self.never {}
    }

    /// Returns the task that the model names.
    pub fn task(&self) -> Option<&str> {
        match self.never {}
    }
}

impl Controller for OnnxPolicy {
    fn observation_size(&self) -> usize {
        match self.never {}
    }

    fn action_size(&self) -> usize {
        match self.never {}
    }

    fn worker(&self) -> Box<dyn ControllerWorker> {
        match self.never {}
    }
}
