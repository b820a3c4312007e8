//! The tensors of a checkpoint.

use std::collections::HashSet;
use std::rc::Rc;

use super::pickle::{self, Number, Reference, Value};
use super::zip::Archive;
use crate::TorchProblem;

/// Largest number of tensors of a module.
const MAX_TENSORS: usize = 10_000;

/// A checkpoint that `torch.save` wrote: an archive with a pickle, and the numbers of each storage
/// in an entry.
pub(super) struct Checkpoint<'b> {
    archive: Archive<'b>,
    prefix: &'b str,
    pub value: Value,
}

/// A tensor by name. The numbers of 64 bits are exact, those of 32 bits, too.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct NamedTensor {
    pub name: Rc<str>,
    pub shape: Vec<usize>,
    pub numbers: Vec<f64>,
}

impl<'b> Checkpoint<'b> {
    pub(super) fn read(bytes: &'b [u8]) -> Result<Checkpoint<'b>, TorchProblem> {
        Self::of_archive(Archive::read(bytes)?)
    }

    pub(super) fn of_archive(archive: Archive<'b>) -> Result<Checkpoint<'b>, TorchProblem> {
        let missing = |what: &str| TorchProblem::Archive { reason: format!("it has no entry `{what}`") };
        let prefix = archive.prefix_of("/data.pkl").ok_or_else(|| missing("data.pkl"))?;
        let pickle = archive.entry(&format!("{prefix}/data.pkl")).ok_or_else(|| missing("data.pkl"))?;
        if let Some(order) = archive.entry(&format!("{prefix}/byteorder")).filter(|order| *order != b"little")
        {
            let order = String::from_utf8_lossy(order);
            return Err(TorchProblem::Archive {
                reason: format!("its byte order is `{order}`; expected `little`"),
            });
        }
        Ok(Checkpoint { value: pickle::read(pickle)?, archive, prefix })
    }

    /// Returns the tensors of the root, which is a dictionary.
    pub(super) fn root_tensors(&self) -> Result<Vec<NamedTensor>, TorchProblem> {
        match &self.value {
            Value::Dictionary(root, _) => self.tensors(root),
            _ => Err(TorchProblem::Layers { reason: "the file has no dictionary of tensors".to_string() }),
        }
    }

    /// Returns the tensors of a dictionary, in its order.
    pub(super) fn tensors(&self, dictionary: &[(Rc<str>, Value)]) -> Result<Vec<NamedTensor>, TorchProblem> {
        let mut tensors = Vec::new();
        let mut names = HashSet::new();
        // Tensors may share a storage, but all of them together are not larger than the file.
        let mut left = self.archive.size() / size_of::<f32>();
        for (name, value) in dictionary {
            let Value::Tensor(reference) = value else { continue };
            match reference.number {
                Number::F32 | Number::F64 => {}
                Number::Half => return Err(TorchProblem::Precision { name: name.to_string() }),
                Number::Other => continue,
            }
            if tensors.len() == MAX_TENSORS {
                return Err(TorchProblem::Layers {
                    reason: format!("it has more than {MAX_TENSORS} tensors"),
                });
            }
            if !names.insert(name) {
                return Err(TorchProblem::Pickle { reason: format!("it has two tensors `{name}`") });
            }
            let outside = || TorchProblem::Tensor { name: name.to_string() };
            let numbers = self.numbers(reference, left).ok_or_else(outside)?;
            left -= numbers.len();
            tensors.push(NamedTensor { name: name.clone(), shape: reference.shape.clone(), numbers });
        }
        Ok(tensors)
    }

    /// Returns the numbers of a tensor, row-major; `None` if it is not inside its storage or has
    /// more than `limit`.
    fn numbers(&self, reference: &Reference, limit: usize) -> Option<Vec<f64>> {
        let storage = self.archive.entry(&format!("{}/data/{}", self.prefix, reference.storage))?;
        let shape = &reference.shape;
        let strides = &reference.strides;
        let width = if reference.number == Number::F64 { 8 } else { 4 };
        let count = shape.iter().try_fold(1_usize, |count, size| count.checked_mul(*size))?;
        // Memory is allocated for numbers that are in the file only.
        if shape.len() != strides.len() || count > (storage.len() / width).min(limit) {
            return None;
        }
        let mut numbers = Vec::with_capacity(count);
        for index in 0..count {
            let mut rest = index;
            let mut at = reference.offset;
            for (size, stride) in shape.iter().zip(strides).rev() {
                at = at.checked_add((rest % size).checked_mul(*stride)?)?;
                rest /= size;
            }
            let bytes = storage.get(at.checked_mul(width)?..)?;
            numbers.push(if width == 8 {
                f64::from_le_bytes(*bytes.first_chunk()?)
            } else {
                f64::from(f32::from_le_bytes(*bytes.first_chunk()?))
            });
        }
        Some(numbers)
    }
}
