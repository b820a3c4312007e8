//! A checkpoint as a file.

use std::collections::BTreeMap;
use std::path::Path;

use mishandle_controllers::{EMPTY_CHECKSUM, has_valid_checksum, write_checksum};
use mishandle_files::write_atomically;
use safetensors::tensor::{Dtype, SafeTensors, TensorView};

use super::{Checkpoint, Header, Numbers};
use crate::TrainingError;

/// Version 1 had no hash of itself.
pub(super) const FORMAT_VERSION: u64 = 2;
const HEADER_KEY: &str = "mishandle-checkpoint";

impl Checkpoint {
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
        write_checksum(&mut bytes);
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
            Some(0..=FORMAT_VERSION) if has_valid_checksum(bytes) => {}
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
        let header = Header { format_version: FORMAT_VERSION, sha256: EMPTY_CHECKSUM.to_string(), ..found };
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

fn chunks<'a, const N: usize>(view: &TensorView<'a>) -> impl Iterator<Item = [u8; N]> + use<'a, N> {
    view.data().as_chunks::<N>().0.iter().copied()
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
