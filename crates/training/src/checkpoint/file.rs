//! Checkpoint files.

use std::collections::BTreeMap;
use std::io;
use std::path::Path;

use mishandle_controllers::{EMPTY_CHECKSUM, has_valid_checksum, parse_tensors, write_checksum};
use mishandle_files::{limits, read_bounded, write_atomically};
use safetensors::tensor::{Dtype, TensorView};

use super::{Checkpoint, CheckpointArray, Header};
use crate::TrainingError;

/// The format version of checkpoints that this program reads and writes.
pub(super) const FORMAT_VERSION: u64 = 2;
const HEADER_KEY: &str = "mishandle-checkpoint";

const TOO_LARGE: &str = "it would have more than 64 GiB; choose a smaller `replay.capacity`";

impl Checkpoint {
    /// Writes the checkpoint atomically.
    ///
    /// # Errors
    /// If the file cannot be written, or would be larger than [`limits::CHECKPOINT`]; an existing
    /// file is then unchanged.
    pub fn save(&self, path: &Path) -> Result<(), TrainingError> {
        let bytes = self.to_bytes();
        let written = if bytes.len() as u64 > limits::CHECKPOINT {
            Err(io::Error::new(io::ErrorKind::FileTooLarge, TOO_LARGE))
        } else {
            write_atomically(path, &bytes)
        };
        written.map_err(|source| TrainingError::File { verb: "write", source, path: path.to_path_buf() })
    }

    /// Reads a checkpoint, a regular file of at most [`limits::CHECKPOINT`] bytes.
    ///
    /// # Errors
    /// If the file cannot be read or is larger, is not a checkpoint, is damaged, or has another
    /// format version.
    pub fn load(path: &Path) -> Result<Checkpoint, TrainingError> {
        let bytes = read_bounded(path, limits::CHECKPOINT).map_err(|source| TrainingError::File {
            verb: "read",
            source,
            path: path.to_path_buf(),
        })?;
        Self::from_bytes(&bytes)
            .map_err(|reason| TrainingError::Checkpoint { reason: format!("{reason}: {}", path.display()) })
    }

    fn to_bytes(&self) -> Vec<u8> {
        let valid = "a header is plain data, and every tensor has one dimension, its length";
        let json = serde_json::to_string(&self.header).expect(valid);
        let tensors: Vec<(&str, Dtype, usize, Vec<u8>)> = self
            .arrays
            .iter()
            .map(|(name, array)| match array {
                CheckpointArray::F32(x) => {
                    (&**name, Dtype::F32, x.len(), x.iter().flat_map(|x| x.to_le_bytes()).collect())
                }
                CheckpointArray::F64(x) => {
                    (&**name, Dtype::F64, x.len(), x.iter().flat_map(|x| x.to_le_bytes()).collect())
                }
                CheckpointArray::U64(x) => {
                    (&**name, Dtype::U64, x.len(), x.iter().flat_map(|x| x.to_le_bytes()).collect())
                }
            })
            .collect();
        let views = tensors.iter().map(|(name, dtype, length, bytes)| {
            (*name, TensorView::new(*dtype, vec![*length], bytes).expect(valid))
        });
        let metadata = std::iter::once((HEADER_KEY.to_string(), json)).collect();
        let mut bytes = safetensors::serialize(views, Some(metadata)).expect(valid);
        write_checksum(&mut bytes);
        bytes
    }

    fn from_bytes(bytes: &[u8]) -> Result<Checkpoint, String> {
        let (file, json) = parse_tensors(bytes, HEADER_KEY).map_err(|error| error.to_string())?;
        let json = json.ok_or_else(|| format!("the header `{HEADER_KEY}` is missing"))?;
        let value: serde_json::Value = serde_json::from_str(&json).map_err(|error| error.to_string())?;
        match value.get("format_version").and_then(serde_json::Value::as_u64) {
            Some(FORMAT_VERSION) if has_valid_checksum(bytes) => {}
            Some(FORMAT_VERSION) => {
                return Err("the file is damaged: its hash does not match its content".to_string());
            }
            Some(other) => {
                let age = if other > FORMAT_VERSION { "newer" } else { "older" };
                return Err(format!(
                    "format version {other} is {age} than {FORMAT_VERSION}, the version that this program reads"
                ));
            }
            None => return Err("the header has no `format_version`".to_string()),
        }
        let found: Header = serde_json::from_value(value).map_err(|error| error.to_string())?;
        let header = Header { sha256: EMPTY_CHECKSUM.to_string(), ..found };
        let mut arrays = BTreeMap::new();
        for (name, view) in file.tensors() {
            let array = match view.dtype() {
                Dtype::F32 => CheckpointArray::F32(chunks(&view).map(f32::from_le_bytes).collect()),
                Dtype::F64 => CheckpointArray::F64(chunks(&view).map(f64::from_le_bytes).collect()),
                Dtype::U64 => CheckpointArray::U64(chunks(&view).map(u64::from_le_bytes).collect()),
                other => return Err(format!("`{name}` has the unsupported type {other}")),
            };
            arrays.insert(name, array);
        }
        Ok(Checkpoint { header, arrays })
    }
}

fn chunks<'a, const N: usize>(view: &TensorView<'a>) -> impl Iterator<Item = [u8; N]> + use<'a, N> {
    view.data().as_chunks::<N>().0.iter().copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn example() -> Checkpoint {
        let mut checkpoint = Checkpoint::new("ppo", "toy", 3, "gamma = 0.9");
        // A NaN with a payload, subnormal numbers, and numbers without a short decimal form.
        checkpoint.put("a", vec![f64::from_bits(0x7FF8_0000_0000_0123), 5e-324, 0.1]);
        checkpoint.put("b", vec![f32::MIN_POSITIVE / 2.0, 0.1]);
        checkpoint.put("c", vec![u64::MAX]);
        checkpoint
    }

    #[test]
    fn a_checkpoint_round_trips_bit_for_bit() {
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
    fn a_single_changed_bit_is_detected() {
        let mut bytes = example().to_bytes();
        for index in 0..bytes.len() {
            for bit in 0..8 {
                bytes[index] ^= 1 << bit;
                assert!(Checkpoint::from_bytes(&bytes).is_err(), "bit {bit} of byte {index}");
                bytes[index] ^= 1 << bit;
            }
        }
        assert!(Checkpoint::from_bytes(&bytes).is_ok());
    }

    #[test]
    fn only_regular_files_of_bounded_size_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let message = |path: &Path| match Checkpoint::load(path).unwrap_err() {
            TrainingError::File { source, .. } => source.to_string(),
            other => other.to_string(),
        };
        assert_eq!(message(Path::new("/dev/zero")), "expected a regular file, found a device");
        let sparse = folder.path().join("a.checkpoint");
        let file = std::fs::File::create(&sparse).unwrap();
        file.set_len(1 << 40).unwrap();
        assert_eq!(message(&sparse), "the file has 1099511627776 bytes; the limit is 68719476736");
    }

    #[test]
    fn damaged_files_and_those_of_other_versions_are_errors() {
        let bytes = example().to_bytes();
        for length in 0..bytes.len() {
            assert!(Checkpoint::from_bytes(&bytes[..length]).is_err(), "truncated to {length} bytes");
        }
        for (version, age) in [(1, "older"), (3, "newer")] {
            let mut other = example();
            other.header.format_version = version;
            let error = Checkpoint::from_bytes(&other.to_bytes()).unwrap_err();
            let expected =
                format!("format version {version} is {age} than 2, the version that this program reads");
            assert_eq!(error, expected);
        }
    }
}
