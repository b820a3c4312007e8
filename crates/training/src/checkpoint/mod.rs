//! All that a training's future depends on, in one file.

mod file;
mod parts;

use std::collections::BTreeMap;

use mishandle_controllers::EMPTY_CHECKSUM;
use serde::{Deserialize, Serialize};

use crate::TrainingError;
use file::FORMAT_VERSION;

/// Numbers of one kind.
#[derive(Clone, Debug, PartialEq)]
pub enum Numbers {
    /// Weights and observations.
    F32(Vec<f32>),
    /// States, moments, rewards.
    F64(Vec<f64>),
    /// Counters.
    U64(Vec<u64>),
}

impl From<Vec<f32>> for Numbers {
    fn from(numbers: Vec<f32>) -> Numbers {
        Numbers::F32(numbers)
    }
}

impl From<Vec<f64>> for Numbers {
    fn from(numbers: Vec<f64>) -> Numbers {
        Numbers::F64(numbers)
    }
}

impl From<Vec<u64>> for Numbers {
    fn from(numbers: Vec<u64>) -> Numbers {
        Numbers::U64(numbers)
    }
}

/// All that a training's future depends on: named vectors of numbers, and which training it is.
///
/// Resumed, a training goes on to the same bits as if it had not been interrupted. The file is a safetensors file with
/// a JSON header under the key `mishandle-checkpoint`.
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
    numbers: BTreeMap<String, Numbers>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Header {
    format_version: u64,
    /// Hash of the file, where it was read; see [`write_checksum`](mishandle_controllers::write_checksum).
    #[serde(default)]
    sha256: String,
    algorithm: String,
    environment: String,
    seed: u64,
    settings: String,
}

impl Checkpoint {
    /// A checkpoint that holds no numbers yet; `settings` are TOML.
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
            numbers: BTreeMap::new(),
        }
    }

    /// The settings of the training, as TOML.
    pub fn settings(&self) -> &str {
        &self.header.settings
    }

    /// The seed of the training.
    pub fn seed(&self) -> u64 {
        self.header.seed
    }

    /// Checks that this is a checkpoint of the same training.
    ///
    /// # Errors
    /// If algorithm, environment or seed are others.
    pub fn check(&self, algorithm: &str, environment: &str, seed: u64) -> Result<(), TrainingError> {
        let Header { algorithm: found, environment: found_environment, seed: found_seed, .. } = &self.header;
        for (what, wanted, found) in [
            ("algorithm", algorithm, found.as_str()),
            ("environment", environment, found_environment),
            ("seed", &seed.to_string(), &found_seed.to_string()),
        ] {
            if wanted != found {
                return Err(TrainingError::OtherTraining {
                    what,
                    wanted: wanted.to_string(),
                    found: found.to_string(),
                });
            }
        }
        Ok(())
    }

    /// Puts in a vector of numbers.
    pub fn put(&mut self, name: &str, numbers: impl Into<Numbers>) {
        self.numbers.insert(name.to_string(), numbers.into());
    }

    /// The `f32` vector of that name.
    ///
    /// # Errors
    /// If there is none of that name and length.
    pub fn f32s(&self, name: &str, wanted: usize) -> Result<&[f32], TrainingError> {
        match self.numbers.get(name) {
            Some(Numbers::F32(numbers)) if numbers.len() == wanted => Ok(numbers),
            other => Err(unfit(name, "f32", wanted, other)),
        }
    }

    /// The `f64` vector of that name.
    ///
    /// # Errors
    /// If there is none of that name and length.
    pub fn f64s(&self, name: &str, wanted: usize) -> Result<&[f64], TrainingError> {
        match self.numbers.get(name) {
            Some(Numbers::F64(numbers)) if numbers.len() == wanted => Ok(numbers),
            other => Err(unfit(name, "f64", wanted, other)),
        }
    }

    /// The `u64` vector of that name.
    ///
    /// # Errors
    /// If there is none of that name and length.
    pub fn u64s(&self, name: &str, wanted: usize) -> Result<&[u64], TrainingError> {
        match self.numbers.get(name) {
            Some(Numbers::U64(numbers)) if numbers.len() == wanted => Ok(numbers),
            other => Err(unfit(name, "u64", wanted, other)),
        }
    }

    /// Whether there is a vector of that name.
    pub fn holds(&self, name: &str) -> bool {
        self.numbers.contains_key(name)
    }
}

fn unfit(name: &str, kind: &str, wanted: usize, found: Option<&Numbers>) -> TrainingError {
    let found = match found {
        None => "there are none".to_string(),
        Some(Numbers::F32(x)) => format!("it holds {} f32", x.len()),
        Some(Numbers::F64(x)) => format!("it holds {} f64", x.len()),
        Some(Numbers::U64(x)) => format!("it holds {} u64", x.len()),
    };
    TrainingError::Checkpoint {
        reason: format!("`{name}` has to be {wanted} numbers of the kind {kind}, {found}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn another_training_is_refused() {
        let checkpoint = Checkpoint::new("ppo", "toy", 3, "gamma = 0.9");
        assert!(checkpoint.check("ppo", "toy", 3).is_ok());
        let told = checkpoint.check("ppo", "toy", 4).unwrap_err().to_string();
        assert_eq!(told, "the checkpoint's seed is 3, this training's is 4");
    }
}
