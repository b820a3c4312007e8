//! All that a training's future depends on, in one file.

use std::collections::BTreeMap;
use std::path::Path;

use mishandle_controllers::{Policy, UNSEALED, is_sealed, seal, write_atomically};
use mishandle_network::{Adam, Mlp, Moments};
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde::{Deserialize, Serialize};

use crate::TrainingError;

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
    /// Hash of the file, where it was read; see [`seal`].
    #[serde(default)]
    sha256: String,
    algorithm: String,
    environment: String,
    seed: u64,
    settings: String,
}

/// Version 1 had no hash of itself.
const FORMAT_VERSION: u64 = 2;
const HEADER_KEY: &str = "mishandle-checkpoint";

impl Checkpoint {
    /// A checkpoint that holds no numbers yet; `settings` are TOML.
    pub fn new(algorithm: &str, environment: &str, seed: u64, settings: &str) -> Checkpoint {
        Checkpoint {
            header: Header {
                format_version: FORMAT_VERSION,
                sha256: UNSEALED.to_string(),
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

    /// Checks that the settings it began with are those wanted now, both as TOML.
    ///
    /// # Errors
    /// If they are not.
    pub(crate) fn check_settings(&self, began: &str, wanted: &str) -> Result<(), TrainingError> {
        if began == wanted {
            return Ok(());
        }
        Err(TrainingError::OtherTraining {
            what: "settings",
            wanted: without(wanted, began),
            found: without(began, wanted),
        })
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

    /// Puts in an optimiser.
    pub fn put_adam(&mut self, name: &str, adam: &Adam<f32>) {
        self.put(&format!("{name}.first_moments"), adam.first_moments().to_vec());
        self.put(&format!("{name}.second_moments"), adam.second_moments().to_vec());
        self.put(&format!("{name}.learning_rate"), vec![adam.learning_rate]);
        self.put(&format!("{name}.steps"), vec![adam.steps()]);
    }

    /// The optimiser of that name, of `count` parameters.
    ///
    /// # Errors
    /// If there is none, or it is another's.
    pub fn adam(&self, name: &str, count: usize) -> Result<Adam<f32>, TrainingError> {
        let first = self.f32s(&format!("{name}.first_moments"), count)?.to_vec();
        let second = self.f32s(&format!("{name}.second_moments"), count)?.to_vec();
        let learning_rate = self.f64s(&format!("{name}.learning_rate"), 1)?[0];
        Ok(Adam::resume(learning_rate, first, second, self.u64s(&format!("{name}.steps"), 1)?[0])?)
    }

    /// Puts in the moments of a normaliser.
    pub fn put_moments(&mut self, name: &str, moments: &Moments) {
        self.put(&format!("{name}.count"), vec![moments.count()]);
        self.put(&format!("{name}.mean"), moments.mean().to_vec());
        self.put(&format!("{name}.squares"), moments.squares().to_vec());
    }

    /// The moments of that name, of `columns` columns.
    ///
    /// # Errors
    /// If there are none, or they are another's.
    pub fn moments(&self, name: &str, columns: usize) -> Result<Moments, TrainingError> {
        let count = self.f64s(&format!("{name}.count"), 1)?[0];
        let mean = self.f64s(&format!("{name}.mean"), columns)?.to_vec();
        Ok(Moments::resume(count, mean, self.f64s(&format!("{name}.squares"), columns)?.to_vec())?)
    }

    /// Puts in a policy.
    pub fn put_policy(&mut self, name: &str, policy: &Policy) {
        self.put(&format!("{name}.mean"), policy.mean().to_vec());
        self.put(&format!("{name}.variance"), policy.variance().to_vec());
        self.put(&format!("{name}.parameters"), policy.network().parameters().to_vec());
        self.put(&format!("{name}.log_std"), policy.log_std().to_vec());
    }

    /// The policy of that name, with the sizes of `like`.
    ///
    /// # Errors
    /// If there is none, or it has other sizes.
    pub fn policy(&self, name: &str, like: &Mlp<f32>) -> Result<Policy, TrainingError> {
        let mut network = Mlp::new(like.sizes(), like.hidden_activation(), like.output_activation())?;
        let parameters = self.f32s(&format!("{name}.parameters"), network.parameter_count())?;
        network.update(|own| own.copy_from_slice(parameters));
        let mean = self.f64s(&format!("{name}.mean"), like.input_size())?.to_vec();
        let variance = self.f64s(&format!("{name}.variance"), like.input_size())?.to_vec();
        let log_std = format!("{name}.log_std");
        if self.f32s(&log_std, 0).is_ok() {
            return Ok(Policy::squashed(mean, variance, network)?);
        }
        let log_std = self.f32s(&log_std, like.output_size())?.to_vec();
        Ok(Policy::new(mean, variance, network, log_std)?)
    }

    /// Writes the checkpoint, whole or not at all.
    ///
    /// # Errors
    /// If the file cannot be written; one that was there is then as it was.
    pub fn save(&self, path: &Path) -> Result<(), TrainingError> {
        write_atomically(path, &self.to_bytes()).map_err(|source| TrainingError::File {
            verb: "write",
            source,
            path: path.to_path_buf(),
        })
    }

    /// Reads a checkpoint.
    ///
    /// # Errors
    /// If the file cannot be read, is something else, is damaged, or was written by a newer program.
    pub fn load(path: &Path) -> Result<Checkpoint, TrainingError> {
        let bytes = std::fs::read(path).map_err(|source| TrainingError::File {
            verb: "read",
            source,
            path: path.to_path_buf(),
        })?;
        Self::from_bytes(&bytes)
            .map_err(|reason| TrainingError::Checkpoint { reason: format!("{reason}: {}", path.display()) })
    }

    fn to_bytes(&self) -> Vec<u8> {
        let right = "a header is plain data, and every tensor has one dimension, its length";
        let json = serde_json::to_string(&self.header).expect(right);
        let tensors: Vec<(&str, Dtype, usize, Vec<u8>)> = self
            .numbers
            .iter()
            .map(|(name, numbers)| match numbers {
                Numbers::F32(x) => {
                    (&**name, Dtype::F32, x.len(), x.iter().flat_map(|x| x.to_le_bytes()).collect())
                }
                Numbers::F64(x) => {
                    (&**name, Dtype::F64, x.len(), x.iter().flat_map(|x| x.to_le_bytes()).collect())
                }
                Numbers::U64(x) => {
                    (&**name, Dtype::U64, x.len(), x.iter().flat_map(|x| x.to_le_bytes()).collect())
                }
            })
            .collect();
        let views = tensors.iter().map(|(name, dtype, length, bytes)| {
            (*name, TensorView::new(*dtype, vec![*length], bytes).expect(right))
        });
        let metadata = std::iter::once((HEADER_KEY.to_string(), json)).collect();
        let mut bytes = safetensors::serialize(views, Some(metadata)).expect(right);
        seal(&mut bytes);
        bytes
    }

    fn from_bytes(bytes: &[u8]) -> Result<Checkpoint, String> {
        let file = SafeTensors::deserialize(bytes).map_err(|error| error.to_string())?;
        let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(|error| error.to_string())?;
        let json = metadata.metadata().as_ref().and_then(|metadata| metadata.get(HEADER_KEY));
        let json = json.ok_or_else(|| format!("it has no header `{HEADER_KEY}`"))?;
        let value: serde_json::Value = serde_json::from_str(json).map_err(|error| error.to_string())?;
        match value.get("format_version").and_then(serde_json::Value::as_u64) {
            Some(1) if value.get("sha256").is_none() => {}
            Some(0..=FORMAT_VERSION) if is_sealed(bytes) => {}
            Some(0..=FORMAT_VERSION) => {
                return Err("it is damaged, its bytes are not those that were written".to_string());
            }
            Some(newer) => {
                return Err(format!(
                    "it has format version {newer}, this program reads up to {FORMAT_VERSION}"
                ));
            }
            None => return Err("its header has no `format_version`".to_string()),
        }
        let found: Header = serde_json::from_value(value).map_err(|error| error.to_string())?;
        // What is written again is written in the present format.
        let header = Header { format_version: FORMAT_VERSION, sha256: UNSEALED.to_string(), ..found };
        let mut numbers = BTreeMap::new();
        for (name, view) in file.tensors() {
            let numbers_of_tensor = match view.dtype() {
                Dtype::F32 => Numbers::F32(chunks(&view).map(f32::from_le_bytes).collect()),
                Dtype::F64 => Numbers::F64(chunks(&view).map(f64::from_le_bytes).collect()),
                Dtype::U64 => Numbers::U64(chunks(&view).map(u64::from_le_bytes).collect()),
                other => return Err(format!("`{name}` holds numbers of the kind {other}")),
            };
            numbers.insert(name, numbers_of_tensor);
        }
        Ok(Checkpoint { header, numbers })
    }
}

/// The lines of `settings` that `others` lack.
fn without(settings: &str, others: &str) -> String {
    let differs = |line: &&str| !others.lines().any(|other| other == *line);
    let lines: Vec<&str> = settings.lines().filter(differs).collect();
    if lines.is_empty() { "the default".to_string() } else { lines.join(", ") }
}

fn chunks<'a, const N: usize>(view: &TensorView<'a>) -> impl Iterator<Item = [u8; N]> + use<'a, N> {
    view.data().as_chunks::<N>().0.iter().copied()
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

    fn example() -> Checkpoint {
        let mut checkpoint = Checkpoint::new("ppo", "toy", 3, "gamma = 0.9");
        // A NaN with a payload, a subnormal and numbers that text would round.
        checkpoint.put("a", vec![f64::from_bits(0x7FF8_0000_0000_0123), 5e-324, 0.1]);
        checkpoint.put("b", vec![f32::MIN_POSITIVE / 2.0, 0.1]);
        checkpoint.put("c", vec![u64::MAX]);
        checkpoint
    }

    #[test]
    fn a_checkpoint_comes_back_to_the_bit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("checkpoint.safetensors");
        example().save(&path).unwrap();
        let loaded = Checkpoint::load(&path).unwrap();
        let bits = |checkpoint: &Checkpoint| -> Vec<u64> {
            checkpoint.f64s("a", 3).unwrap().iter().map(|x| x.to_bits()).collect()
        };
        assert_eq!(bits(&loaded), bits(&example()));
        assert_eq!(loaded.to_bytes(), example().to_bytes());
    }

    #[test]
    fn another_training_is_refused() {
        assert!(example().check("ppo", "toy", 3).is_ok());
        let told = example().check("ppo", "toy", 4).unwrap_err().to_string();
        assert_eq!(told, "the checkpoint's seed is 3, this training's is 4");
    }

    #[test]
    fn a_single_changed_bit_is_found_out() {
        let mut bytes = example().to_bytes();
        for place in 0..bytes.len() {
            for bit in 0..8 {
                bytes[place] ^= 1 << bit;
                assert!(Checkpoint::from_bytes(&bytes).is_err(), "bit {bit} of byte {place}");
                bytes[place] ^= 1 << bit;
            }
        }
        assert!(Checkpoint::from_bytes(&bytes).is_ok());
    }

    #[test]
    fn damaged_and_newer_files_are_refused() {
        let bytes = example().to_bytes();
        for length in 0..bytes.len() {
            assert!(Checkpoint::from_bytes(&bytes[..length]).is_err(), "cut to {length} bytes");
        }
        let mut newer = example();
        newer.header.format_version = 3;
        let told = Checkpoint::from_bytes(&newer.to_bytes()).unwrap_err();
        assert_eq!(told, "it has format version 3, this program reads up to 2");
    }
}
