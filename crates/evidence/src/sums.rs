//! The list of hashes, in the format of `sha256sum`.

use std::collections::BTreeMap;
use std::io::Read;
use std::ops::ControlFlow;
use std::path::Path;

use mishandle::files::open_for_reading;
use sha2::{Digest, Sha256};

use crate::error::EvidenceError;
use crate::layout::{SIGNATURE, SUMS, is_name};

/// Largest size of a list, in bytes.
pub const MAX_SIZE: u64 = 16 << 20;

/// Size and hash of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Hashed {
    /// Size in bytes.
    pub size: u64,
    /// SHA-256 in lower-case hexadecimal digits.
    pub sha256: String,
}

/// Asks after each piece of a file whether to continue.
pub type Watch<'w> = &'w mut dyn FnMut() -> ControlFlow<()>;

/// Hashes a file piece by piece, so that its size does not matter.
///
/// # Errors
/// If it is not a regular file, cannot be read, or `watch` stops it.
pub fn hash(path: &Path, watch: Watch<'_>) -> Result<Hashed, EvidenceError> {
    let mut file = open_for_reading(path).map_err(EvidenceError::file(path))?;
    let mut digest = Sha256::new();
    let mut size = 0;
    let mut buffer = vec![0; 1 << 20];
    loop {
        let n = file.read(&mut buffer).map_err(EvidenceError::file(path))?;
        if n == 0 {
            let sha256 = digest.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
            return Ok(Hashed { size, sha256 });
        }
        if watch().is_break() {
            return Err(EvidenceError::Interrupted);
        }
        digest.update(&buffer[..n]);
        size += n as u64;
    }
}

/// Returns the list of these files as text.
pub fn text<'a>(files: impl Iterator<Item = (&'a str, &'a str)>) -> String {
    files.map(|(name, sha256)| format!("{sha256}  {name}\n")).collect()
}

/// Reads a list: hash by name.
///
/// # Errors
/// The first line that is not one of [`text`], or names a file twice or outside the folder.
pub fn parse(text: &str) -> Result<BTreeMap<&str, &str>, String> {
    let mut files = BTreeMap::new();
    for (index, line) in text.split_terminator('\n').enumerate() {
        let problem = |what: &str| format!("line {} of {SUMS}: {what}", index + 1);
        let (sha256, name) = line.split_once("  ").ok_or_else(|| problem("it is not a hash and a name"))?;
        let is_hex = sha256.len() == 64 && sha256.bytes().all(|c| matches!(c, b'0'..=b'9' | b'a'..=b'f'));
        if !is_hex {
            return Err(problem("the hash is not that of SHA-256"));
        }
        if !is_name(name) || [SUMS, SIGNATURE].contains(&name) {
            return Err(problem("no such file can be listed"));
        }
        if files.insert(name, sha256).is_some() {
            return Err(problem("the file is listed twice"));
        }
    }
    Ok(files)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hash_is_that_of_the_standard() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("a");
        // The first example of FIPS 180-2, appendix B.
        std::fs::write(&path, "abc").expect("a file");
        let expected = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        let found = hash(&path, &mut || ControlFlow::Continue(())).expect("a hash");
        assert_eq!((found.size, found.sha256.as_str()), (3, expected));
        let list = text([("a b", expected)].into_iter());
        assert_eq!(parse(&list), Ok(BTreeMap::from([("a b", expected)])));
        for (from, to) in
            [("a b", "../a"), ("a b", "/a"), ("a b", SUMS), ("ba78", "BA78"), ("  ", " "), ("ba78", "")]
        {
            assert!(parse(&list.replacen(from, to, 1)).is_err(), "{from} {to}");
        }
        assert!(parse(&(list.clone() + &list)).is_err());
    }
}
