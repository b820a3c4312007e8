//! Parses untrusted safetensors files.

use mishandle_files::limits::TENSOR_HEADER;
use safetensors::tensor::{SafeTensorError, SafeTensors};
use serde_json::Value;

/// Bytes of the header's length, at the start of a file.
const LENGTH_BYTES: usize = 8;

/// Parses a safetensors file; returns its tensors and the text under `key` in its metadata.
///
/// The header may have at most [`TENSOR_HEADER`] bytes. Each tensor must lie inside the file, after
/// the tensor before it, and have the length of its shape, all without overflow.
///
/// # Errors
/// If the bytes are not such a file.
pub fn parse_tensors<'b>(
    bytes: &'b [u8],
    key: &str,
) -> Result<(SafeTensors<'b>, Option<String>), SafeTensorError> {
    check_offsets(bytes)?;
    let tensors = SafeTensors::deserialize(bytes)?;
    let (_, metadata) = SafeTensors::read_metadata(bytes)?;
    Ok((tensors, metadata.metadata().as_ref().and_then(|metadata| metadata.get(key).cloned())))
}

/// Checks the length of the header and that all offsets are inside the file. The library adds the
/// last offset to the length of the header before it compares them with the file; that sum can
/// overflow, which panics in builds with overflow checks.
fn check_offsets(bytes: &[u8]) -> Result<(), SafeTensorError> {
    let (length, rest) = bytes.split_first_chunk::<LENGTH_BYTES>().ok_or(SafeTensorError::HeaderTooSmall)?;
    let length = u64::from_le_bytes(*length);
    if length > TENSOR_HEADER {
        return Err(SafeTensorError::HeaderTooLarge);
    }
    let (header, data) =
        rest.split_at_checked(length as usize).ok_or(SafeTensorError::InvalidHeaderLength)?;
    let header: serde_json::Map<String, Value> =
        serde_json::from_slice(header).map_err(SafeTensorError::InvalidHeaderDeserialization)?;
    for (name, tensor) in header {
        let offsets = tensor.get("data_offsets").and_then(Value::as_array);
        let is_inside = |offset: &Value| offset.as_u64().is_some_and(|offset| offset <= data.len() as u64);
        if offsets.is_some_and(|offsets| !offsets.iter().all(is_inside)) {
            return Err(SafeTensorError::InvalidOffset(name));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a file with these entries in its header and this number of bytes of data.
    fn file(header: &str, data: usize) -> Vec<u8> {
        let length = (header.len() as u64).to_le_bytes();
        [&length[..], header.as_bytes(), &vec![0; data]].concat()
    }

    fn tensor(name: &str, shape: &str, from: u64, to: u64) -> String {
        format!(r#""{name}":{{"dtype":"U8","shape":{shape},"data_offsets":[{from},{to}]}}"#)
    }

    fn parse(entries: &[String], data: usize) -> Result<usize, SafeTensorError> {
        parse_tensors(&file(&format!("{{{}}}", entries.join(",")), data), "key").map(|(found, _)| found.len())
    }

    #[test]
    fn tensors_that_overlap_leave_the_file_or_contradict_their_shape_are_errors() {
        assert_eq!(parse(&[tensor("a", "[4]", 0, 4), tensor("b", "[2,2]", 4, 8)], 8).unwrap(), 2);
        for (entries, data) in [
            (vec![tensor("a", "[4]", 0, 4), tensor("b", "[4]", 2, 6)], 6),
            (vec![tensor("a", "[4]", 0, 4), tensor("b", "[4]", 5, 9)], 9),
            (vec![tensor("a", "[4]", 0, 4), tensor("b", "[4]", 0, 4)], 4),
            (vec![tensor("a", "[4]", 4, 0)], 4),
            (vec![tensor("a", "[5]", 0, 4)], 4),
            (vec![tensor("a", "[9]", 0, 9)], 4),
            (vec![tensor("a", "[4]", 0, 4)], 5),
            (vec![tensor("a", "[4294967296,4294967296]", 0, 0)], 0),
            (vec![tensor("a", "[18446744073709551615]", 0, u64::MAX)], 0),
            (vec![tensor("a", "[-1]", 0, 1)], 1),
        ] {
            assert!(parse(&entries, data).is_err(), "{entries:?}");
        }
    }

    #[test]
    fn offsets_near_the_largest_integer_do_not_overflow_the_length_of_the_file() {
        // Tensors of 2^60 bytes, which agree with their shapes; the last one ends at `end`.
        let part = 1_u64 << 60;
        for end in [u64::MAX, u64::MAX - 8, u64::MAX - 2000] {
            let entry = |i: u64| {
                let from = i * part;
                let to = if i == 15 { end } else { (i + 1) * part };
                tensor(&format!("{i:02}"), &format!("[{}]", to - from), from, to)
            };
            let entries: Vec<String> = (0..16).map(entry).collect();
            assert!(matches!(parse(&entries, 16), Err(SafeTensorError::InvalidOffset(_))), "{end}");
        }
    }

    #[test]
    fn a_header_above_the_limit_or_the_file_is_an_error() {
        let mut bytes = file(&format!("{{{}}}", tensor("a", "[4]", 0, 4)), 4);
        assert!(parse_tensors(&bytes, "key").is_ok());
        for length in [TENSOR_HEADER + 1, u64::MAX, 1 << 63] {
            bytes[..8].copy_from_slice(&length.to_le_bytes());
            assert!(matches!(parse_tensors(&bytes, "key"), Err(SafeTensorError::HeaderTooLarge)));
        }
        bytes[..8].copy_from_slice(&TENSOR_HEADER.to_le_bytes());
        assert!(matches!(parse_tensors(&bytes, "key"), Err(SafeTensorError::InvalidHeaderLength)));
        let deep = format!("{{\"a\":{}{}}}", "[".repeat(500_000), "]".repeat(500_000));
        assert!(parse_tensors(&file(&deep, 0), "key").is_err());
    }
}
