//! SHA-256 of values in a canonical encoding, so that a digest does not depend on the storage
//! format.

use sha2::{Digest as _, Sha256};

/// A SHA-256 of values. Numbers are encoded as 8 little-endian bytes, floats by their bits; the
/// length of a text or list precedes its content.
pub(crate) struct Digest(Sha256);

impl Digest {
    /// Creates a digest. Different kinds of values use different `subject`s, so that their digests
    /// differ.
    pub(crate) fn of(subject: &str) -> Self {
        let mut digest = Self(Sha256::new());
        digest.text(subject);
        digest
    }

    pub(crate) fn integer(&mut self, value: u64) {
        self.0.update(value.to_le_bytes());
    }

    pub(crate) fn float(&mut self, value: f64) {
        self.integer(value.to_bits());
    }

    pub(crate) fn optional(&mut self, value: Option<f64>) {
        self.integer(value.is_some().into());
        self.float(value.unwrap_or(0.0));
    }

    pub(crate) fn optionals(&mut self, values: &[Option<f64>]) {
        self.integer(values.len() as u64);
        values.iter().for_each(|&value| self.optional(value));
    }

    pub(crate) fn floats(&mut self, values: &[f64]) {
        self.integer(values.len() as u64);
        let mut bytes = [0; 512];
        for chunk in values.chunks(bytes.len() / 8) {
            for (slot, value) in bytes.chunks_exact_mut(8).zip(chunk) {
                slot.copy_from_slice(&value.to_le_bytes());
            }
            self.0.update(&bytes[..chunk.len() * 8]);
        }
    }

    pub(crate) fn bytes(&mut self, bytes: &[u8]) {
        self.integer(bytes.len() as u64);
        self.0.update(bytes);
    }

    pub(crate) fn text(&mut self, text: &str) {
        self.integer(text.len() as u64);
        self.0.update(text);
    }

    /// Returns the first 16 bytes of the SHA-256 as a big-endian number, so that its hexadecimal
    /// digits are those of the hash.
    pub(crate) fn finish(self) -> u128 {
        let bytes: [u8; 32] = self.0.finalize().into();
        bytes[..16].iter().fold(0, |number, &byte| number << 8 | u128::from(byte))
    }

    /// Returns the first 8 bytes of the SHA-256 as a signed integer, the integer type of SQLite.
    pub(crate) fn finish_row(self) -> i64 {
        ((self.finish() >> 64) as u64).cast_signed()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_digest_is_a_prefix_of_sha_256() {
        // printf '\1\0\0\0\0\0\0\0a' | sha256sum: the length 1, then the text.
        assert_eq!(format!("{:032x}", Digest::of("a").finish()), "ae6121c88ba555f64c3d812123eb799d");
    }

    #[test]
    fn lists_longer_than_the_buffer_are_hashed_completely() {
        let values: Vec<f64> = (0..1000).map(f64::from).collect();
        let mut whole = Digest::of("list");
        whole.floats(&values);
        let mut single = Digest::of("list");
        single.integer(1000);
        values.iter().for_each(|&value| single.float(value));
        assert_eq!(whole.finish(), single.finish());
    }
}
