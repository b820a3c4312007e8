//! Checkpoint: the state of a training run in one file.

mod file;
mod state;

use std::collections::BTreeMap;

use mishandle_controllers::EMPTY_CHECKSUM;
use serde::{Deserialize, Serialize};

use crate::TrainingError;
use file::FORMAT_VERSION;

/// Array of a checkpoint.
#[derive(Clone, Debug, PartialEq)]
pub enum CheckpointArray {
    /// Weights and observations.
    F32(Vec<f32>),
    /// States, moments, rewards.
    F64(Vec<f64>),
    /// Counters.
    U64(Vec<u64>),
}

impl From<Vec<f32>> for CheckpointArray {
    fn from(numbers: Vec<f32>) -> CheckpointArray {
        CheckpointArray::F32(numbers)
    }
}

impl From<Vec<f64>> for CheckpointArray {
    fn from(numbers: Vec<f64>) -> CheckpointArray {
        CheckpointArray::F64(numbers)
    }
}

impl From<Vec<u64>> for CheckpointArray {
    fn from(numbers: Vec<u64>) -> CheckpointArray {
        CheckpointArray::U64(numbers)
    }
}

/// State of a training run: named arrays, and the identity of the run.
///
/// A resumed run produces the same bits as an uninterrupted one. The file is a safetensors file
/// with a JSON header under the key `mishandle-checkpoint`.
///
/// # Example
/// ```
/// use mishandle_training::Checkpoint;
/// let mut checkpoint = Checkpoint::new("ppo", "point-reaching", 7, "gamma = 0.99");
/// checkpoint.put("weights", vec![0.5_f32, 0.25]);
/// assert_eq!(checkpoint.f32s("weights", 2)?, [0.5, 0.25]);
/// assert!(checkpoint.f32s("weights", 3).is_err());
/// # Ok::<(), mishandle_training::TrainingError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Checkpoint {
    header: Header,
    arrays: BTreeMap<String, CheckpointArray>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Header {
    format_version: u64,
    /// Hash of the file; see [`write_checksum`](mishandle_controllers::write_checksum).
    sha256: String,
    algorithm: String,
    environment: String,
    seed: u64,
    settings: String,
}

impl Checkpoint {
    /// Creates a checkpoint without arrays; `settings` is TOML.
    pub fn new(algorithm: &str, environment: &str, seed: u64, settings: &str) -> Checkpoint {
        Checkpoint {
            header: Header {
                format_version: FORMAT_VERSION,
                sha256: EMPTY_CHECKSUM.to_string(),
                algorithm: algorithm.to_string(),
                environment: environment.to_string(),
                seed,
                settings: settings.to_string(),
            },
            arrays: BTreeMap::new(),
        }
    }

    /// Returns the settings of the training run, as TOML.
    pub fn settings(&self) -> &str {
        &self.header.settings
    }

    /// Returns the seed of the training run.
    pub fn seed(&self) -> u64 {
        self.header.seed
    }

    /// Checks that this checkpoint belongs to the same training run.
    ///
    /// # Errors
    /// If algorithm, environment or seed differ.
    pub fn check(&self, algorithm: &str, environment: &str, seed: u64) -> Result<(), TrainingError> {
        let Header { algorithm: found, environment: found_environment, seed: found_seed, .. } = &self.header;
        for (what, expected, found) in [
            ("algorithm", algorithm, found.as_str()),
            ("environment", environment, found_environment),
            ("seed", &seed.to_string(), &found_seed.to_string()),
        ] {
            if expected != found {
                return Err(TrainingError::CheckpointMismatch {
                    what,
                    expected: expected.to_string(),
                    found: found.to_string(),
                });
            }
        }
        Ok(())
    }

    /// Adds an array.
    pub fn put(&mut self, name: &str, array: impl Into<CheckpointArray>) {
        self.arrays.insert(name.to_string(), array.into());
    }

    /// Returns the `f32` array `name` of length `length`.
    ///
    /// # Errors
    /// If the checkpoint has no such array.
    pub fn f32s(&self, name: &str, length: usize) -> Result<&[f32], TrainingError> {
        match self.arrays.get(name) {
            Some(CheckpointArray::F32(numbers)) if numbers.len() == length => Ok(numbers),
            other => Err(wrong_array(name, "f32", length, other)),
        }
    }

    /// Returns the `f64` array `name` of length `length`.
    ///
    /// # Errors
    /// If the checkpoint has no such array.
    pub fn f64s(&self, name: &str, length: usize) -> Result<&[f64], TrainingError> {
        match self.arrays.get(name) {
            Some(CheckpointArray::F64(numbers)) if numbers.len() == length => Ok(numbers),
            other => Err(wrong_array(name, "f64", length, other)),
        }
    }

    /// Returns the `u64` array `name` of length `length`.
    ///
    /// # Errors
    /// If the checkpoint has no such array.
    pub fn u64s(&self, name: &str, length: usize) -> Result<&[u64], TrainingError> {
        match self.arrays.get(name) {
            Some(CheckpointArray::U64(numbers)) if numbers.len() == length => Ok(numbers),
            other => Err(wrong_array(name, "u64", length, other)),
        }
    }

    /// Returns whether the checkpoint has an array of this name.
    pub fn contains(&self, name: &str) -> bool {
        self.arrays.contains_key(name)
    }
}

fn wrong_array(name: &str, kind: &str, length: usize, found: Option<&CheckpointArray>) -> TrainingError {
    let found = match found {
        None => "no such array".to_string(),
        Some(CheckpointArray::F32(x)) => format!("{} f32 numbers", x.len()),
        Some(CheckpointArray::F64(x)) => format!("{} f64 numbers", x.len()),
        Some(CheckpointArray::U64(x)) => format!("{} u64 numbers", x.len()),
    };
    TrainingError::Checkpoint {
        reason: format!("`{name}` must contain {length} {kind} numbers, found {found}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_checkpoint_of_another_training_run_is_an_error() {
        let checkpoint = Checkpoint::new("ppo", "toy", 3, "gamma = 0.9");
        assert!(checkpoint.check("ppo", "toy", 3).is_ok());
        let error = checkpoint.check("ppo", "toy", 4).unwrap_err().to_string();
        assert_eq!(error, "the checkpoint's seed is 3, this training's is 4");
    }
}
