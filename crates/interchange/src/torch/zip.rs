//! Reads entries of a zip archive that are stored without compression, as PyTorch and
//! Stable-Baselines3 write them.
//!
//! An entry is then a part of the file, so that no archive is larger inside than outside.

use std::collections::BTreeMap;

use crate::TorchProblem;

/// Signatures of the end of the archive, of an entry in its directory, and of an entry.
const END: &[u8] = b"PK\x05\x06";
const DIRECTORY: &[u8] = b"PK\x01\x02";
const LOCAL: &[u8] = b"PK\x03\x04";

const END_BYTES: usize = 22;
const DIRECTORY_BYTES: usize = 46;
const LOCAL_BYTES: usize = 30;

/// The entries of an archive: name and content.
#[derive(Debug)]
pub(super) struct Archive<'b> {
    entries: BTreeMap<&'b str, &'b [u8]>,
    size: usize,
}

impl<'b> Archive<'b> {
    /// Reads the directory of an archive.
    pub(super) fn read(bytes: &'b [u8]) -> Result<Archive<'b>, TorchProblem> {
        let problem = |reason: String| TorchProblem::Archive { reason };
        let damaged = || problem("it is damaged or not complete".to_string());
        if !bytes.starts_with(LOCAL) {
            return Err(problem("it is no zip archive; save it with PyTorch 1.6 or newer".to_string()));
        }
        // A comment of at most 65535 bytes may follow the end record.
        let tail = bytes.len().saturating_sub(END_BYTES + usize::from(u16::MAX));
        let end = bytes[tail..].windows(END.len()).rposition(|window| window == END).ok_or_else(damaged)?;
        let end = &bytes[tail + end..];
        let (count, start) = u16_at(end, 10).zip(u32_at(end, 16)).ok_or_else(damaged)?;
        // Otherwise the file was cut off, and this is the end of an archive inside it.
        if u16_at(end, 20).is_none_or(|comment| END_BYTES + comment != end.len()) {
            return Err(damaged());
        }
        let mut rest = bytes.get(start..).ok_or_else(damaged)?;
        let mut entries = BTreeMap::new();
        let mut left = bytes.len();
        for _entry in 0..count {
            let (Entry { name, content, checksum }, length) =
                directory_entry(bytes, rest).ok_or_else(damaged)??;
            // Otherwise a small file could have any number of large entries, whose checksums take
            // any time.
            left =
                left.checked_sub(content.len()).ok_or_else(|| problem("its entries overlap".to_string()))?;
            if crc32(content) != checksum {
                return Err(problem(format!(
                    "the checksum of its entry `{name}` is wrong, so the file is damaged; save or copy it again"
                )));
            }
            if entries.insert(name, content).is_some() {
                return Err(problem(format!("it has two entries `{name}`")));
            }
            rest = rest.get(length..).ok_or_else(damaged)?;
        }
        Ok(Archive { entries, size: bytes.len() })
    }

    /// Returns the size of the file in bytes.
    pub(super) fn size(&self) -> usize {
        self.size
    }

    /// Returns the content of the entry with this name.
    pub(super) fn entry(&self, name: &str) -> Option<&'b [u8]> {
        self.entries.get(name).copied()
    }

    /// Returns the part before `suffix` of the name of the entry that ends with it.
    pub(super) fn prefix_of(&self, suffix: &str) -> Option<&'b str> {
        self.entries.keys().find_map(|name| name.strip_suffix(suffix))
    }
}

struct Entry<'b> {
    name: &'b str,
    content: &'b [u8],
    checksum: u32,
}

/// Reads the first entry of a directory; returns it with its length in the directory. `None` if it
/// is damaged.
fn directory_entry<'b>(bytes: &'b [u8], entry: &'b [u8]) -> Option<Result<(Entry<'b>, usize), TorchProblem>> {
    if !entry.starts_with(DIRECTORY) {
        return None;
    }
    let method = u16_at(entry, 10)?;
    let size = u32_at(entry, 20)?;
    let length = u32_at(entry, 24)?;
    let name_length = u16_at(entry, 28)?;
    let extra = u16_at(entry, 30)?;
    let comment = u16_at(entry, 32)?;
    let name = std::str::from_utf8(entry.get(DIRECTORY_BYTES..)?.get(..name_length)?).ok()?;
    if method != 0 || size != length {
        let reason = format!(
            "its entry `{name}` is compressed; save the model again with `model.save` or `torch.save`"
        );
        return Some(Err(TorchProblem::Archive { reason }));
    }
    let local = bytes.get(u32_at(entry, 42)?..)?;
    if !local.starts_with(LOCAL) {
        return None;
    }
    let own_name = u16_at(local, 26)?;
    let own_extra = u16_at(local, 28)?;
    if local.get(LOCAL_BYTES..)?.get(..own_name)? != name.as_bytes() {
        return None;
    }
    let content = local.get(LOCAL_BYTES + own_name + own_extra..)?.get(..size)?;
    let checksum = u32::try_from(u32_at(entry, 16)?).ok()?;
    Some(Ok((Entry { name, content, checksum }, DIRECTORY_BYTES + name_length + extra + comment)))
}

fn u16_at(bytes: &[u8], offset: usize) -> Option<usize> {
    let (number, _) = bytes.get(offset..)?.split_first_chunk()?;
    Some(usize::from(u16::from_le_bytes(*number)))
}

fn u32_at(bytes: &[u8], offset: usize) -> Option<usize> {
    let (number, _) = bytes.get(offset..)?.split_first_chunk()?;
    usize::try_from(u32::from_le_bytes(*number)).ok()
}

/// Returns the checksum of an entry: CRC-32 with the reflected polynomial 0xEDB88320.
fn crc32(bytes: &[u8]) -> u32 {
    let step = |crc: u32, byte: &u8| CRC_TABLE[usize::from(crc as u8 ^ byte)] ^ crc >> 8;
    !bytes.iter().fold(!0, step)
}

/// The remainders of all bytes.
const CRC_TABLE: [u32; 256] = {
    let mut table = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        let mut crc = byte as u32;
        let mut bit = 0;
        while bit < 8 {
            crc = if crc & 1 == 0 { crc >> 1 } else { crc >> 1 ^ 0xEDB8_8320 };
            bit += 1;
        }
        table[byte] = crc;
        byte += 1;
    }
    table
};
