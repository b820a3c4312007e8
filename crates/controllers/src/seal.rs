//! A file's hash of itself, by which a changed bit is found out.
//!
//! The file's JSON header, itself a text in the JSON of safetensors, has a field `sha256`: the SHA-256 of the whole file
//! in hexadecimal, taken while 64 zeros stand in that field.

use sha2::{Digest, Sha256};

use crate::layout::hexadecimal;

/// What stands in the field `sha256` until the file is sealed.
pub const UNSEALED: &str = "0000000000000000000000000000000000000000000000000000000000000000";

/// What comes before the hash in the bytes of the file.
const KEY: &[u8] = br#"sha256\":\""#;

/// Puts the hash of a file's bytes in its place, if the file has one.
pub fn seal(bytes: &mut [u8]) {
    if let Some(place) = place(bytes) {
        bytes[place..][..UNSEALED.len()].copy_from_slice(UNSEALED.as_bytes());
        let hash = hexadecimal(&Sha256::digest(&*bytes));
        bytes[place..][..UNSEALED.len()].copy_from_slice(hash.as_bytes());
    }
}

/// Whether a file's bytes are those that were sealed; no, if they have no hash.
pub fn is_sealed(bytes: &[u8]) -> bool {
    let mut sealed = bytes.to_vec();
    seal(&mut sealed);
    place(bytes).is_some() && sealed == bytes
}

fn place(bytes: &[u8]) -> Option<usize> {
    let place = bytes.windows(KEY.len()).position(|window| window == KEY)? + KEY.len();
    (place + UNSEALED.len() <= bytes.len()).then_some(place)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hash_is_that_of_the_bytes_with_zeros_in_its_place() {
        let text = |hash: &str| format!(r#"{{\"sha256\":\"{hash}\"}} and 7 numbers"#);
        let mut bytes = text(&"x".repeat(64)).into_bytes();
        assert!(!is_sealed(&bytes));
        seal(&mut bytes);
        let hash = hexadecimal(&Sha256::digest(text(UNSEALED)));
        assert_eq!(String::from_utf8(bytes.clone()).unwrap(), text(&hash));
        assert!(is_sealed(&bytes));
        bytes[3] ^= 1;
        assert!(!is_sealed(&bytes));
        assert!(!is_sealed(b"no hash"));
    }
}
