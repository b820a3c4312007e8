//! The checksum in a file's header, which detects every changed bit.
//!
//! The JSON header of a file, a string in the safetensors metadata, has a field `sha256`: the
//! SHA-256 of the whole file in hexadecimal, computed while the field contains 64 zeros.

use sha2::{Digest, Sha256};

use crate::layout::hexadecimal;

/// The value of the field `sha256` before [`write_checksum`]: 64 zeros.
pub const EMPTY_CHECKSUM: &str = "0000000000000000000000000000000000000000000000000000000000000000";

/// The bytes before the checksum in the file.
const KEY: &[u8] = br#"sha256\":\""#;

/// Writes the checksum of a file's bytes into its header. Does nothing if the header has no field
/// `sha256`.
pub fn write_checksum(bytes: &mut [u8]) {
    if let Some(offset) = checksum_offset(bytes) {
        bytes[offset..][..EMPTY_CHECKSUM.len()].copy_from_slice(EMPTY_CHECKSUM.as_bytes());
        let hash = hexadecimal(&Sha256::digest(&*bytes));
        bytes[offset..][..EMPTY_CHECKSUM.len()].copy_from_slice(hash.as_bytes());
    }
}

/// Returns whether a file's bytes match the checksum in its header; `false` if the header has none.
pub fn has_valid_checksum(bytes: &[u8]) -> bool {
    let mut expected = bytes.to_vec();
    write_checksum(&mut expected);
    checksum_offset(bytes).is_some() && expected == bytes
}

/// Returns the offset of the checksum's first digit.
fn checksum_offset(bytes: &[u8]) -> Option<usize> {
    let offset = bytes.windows(KEY.len()).position(|window| window == KEY)? + KEY.len();
    (offset + EMPTY_CHECKSUM.len() <= bytes.len()).then_some(offset)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_is_the_hash_of_the_bytes_with_zeros_in_its_field() {
        let text = |hash: &str| format!(r#"{{\"sha256\":\"{hash}\"}} and 7 numbers"#);
        let mut bytes = text(&"x".repeat(64)).into_bytes();
        assert!(!has_valid_checksum(&bytes));
        write_checksum(&mut bytes);
        let hash = hexadecimal(&Sha256::digest(text(EMPTY_CHECKSUM)));
        assert_eq!(String::from_utf8(bytes.clone()).unwrap(), text(&hash));
        assert!(has_valid_checksum(&bytes));
        bytes[3] ^= 1;
        assert!(!has_valid_checksum(&bytes));
        assert!(!has_valid_checksum(b"no hash"));
    }
}
