//! Zip archives as NumPy writes them: entries that are stored or deflated, also of more than 4 GB
//! (ZIP64).

use std::io::{Read, Seek, SeekFrom};

use flate2::read::DeflateDecoder;
use mishandle_text::visible;

use crate::error::{Result, content};

const END: &[u8] = b"PK\x05\x06";
const END_64: &[u8] = b"PK\x06\x06";
const LOCATOR_64: &[u8] = b"PK\x06\x07";
const ENTRY: &[u8] = b"PK\x01\x02";
const LOCAL: &[u8] = b"PK\x03\x04";

const END_BYTES: usize = 22;
const LOCATOR_BYTES: usize = 20;
const ENTRY_BYTES: usize = 46;
const LOCAL_BYTES: usize = 30;

/// Largest size of the directory of an archive.
const MAX_DIRECTORY: u64 = 64 << 20;

/// An archive whose directory was read.
pub(super) struct Archive<R> {
    file: R,
    entries: Vec<Entry>,
}

struct Entry {
    name: String,
    is_deflated: bool,
    stored_bytes: u64,
    bytes: u64,
    /// Position of its header.
    at: u64,
}

fn damaged() -> crate::LogError {
    content("the archive is damaged or not complete")
}

impl<R: Read + Seek> Archive<R> {
    pub(super) fn open(mut file: R) -> Result<Archive<R>> {
        let length = file.seek(SeekFrom::End(0))?;
        // A comment of at most 65,535 bytes may follow the end record.
        let tail = read_at(&mut file, length.saturating_sub(END_BYTES as u64 + u64::from(u16::MAX)), length)?;
        let at = tail.windows(END.len()).rposition(|window| window == END).ok_or_else(damaged)?;
        let end = &tail[at..];
        let mut size: u64 = u32_at(end, 12).ok_or_else(damaged)?.into();
        let mut start: u64 = u32_at(end, 16).ok_or_else(damaged)?.into();
        if let Some(locator) = at.checked_sub(LOCATOR_BYTES).map(|start| &tail[start..at])
            && locator.starts_with(LOCATOR_64)
        {
            let at = u64_at(locator, 8).ok_or_else(damaged)?;
            let end = read_at(&mut file, at, at.saturating_add(56))?;
            if !end.starts_with(END_64) {
                return Err(damaged());
            }
            (size, start) = u64_at(&end, 40).zip(u64_at(&end, 48)).ok_or_else(damaged)?;
        }
        if size > MAX_DIRECTORY || start.checked_add(size).is_none_or(|end| end > length) {
            return Err(damaged());
        }
        let directory = read_at(&mut file, start, start + size)?;
        let mut entries = Vec::new();
        let mut rest = &directory[..];
        while rest.starts_with(ENTRY) {
            let (entry, after) = Entry::read(rest).ok_or_else(damaged)?;
            entries.push(entry?);
            rest = after;
        }
        Ok(Archive { file, entries })
    }

    pub(super) fn names(&self) -> Vec<String> {
        self.entries.iter().map(|entry| entry.name.clone()).collect()
    }

    /// Returns a reader of an entry. It reads at most as many bytes as the directory states.
    pub(super) fn entry(&mut self, name: &str) -> Result<Box<dyn Read + '_>> {
        let entry = self.entries.iter().find(|entry| entry.name == name).ok_or_else(damaged)?;
        let header = read_at(&mut self.file, entry.at, entry.at.saturating_add(LOCAL_BYTES as u64))?;
        let lengths = u16_at(&header, 26).zip(u16_at(&header, 28)).filter(|_| header.starts_with(LOCAL));
        let (name, extra) = lengths.ok_or_else(damaged)?;
        let skipped = LOCAL_BYTES as u64 + u64::from(name) + u64::from(extra);
        self.file.seek(SeekFrom::Start(entry.at.checked_add(skipped).ok_or_else(damaged)?))?;
        let stored = self.file.by_ref().take(entry.stored_bytes);
        Ok(if entry.is_deflated {
            Box::new(DeflateDecoder::new(stored).take(entry.bytes))
        } else {
            Box::new(stored.take(entry.bytes))
        })
    }
}

impl Entry {
    /// Reads an entry of the directory, and returns the bytes after it.
    fn read(bytes: &[u8]) -> Option<(Result<Entry>, &[u8])> {
        let [name, extra, comment] = [28, 30, 32].map(|at| u16_at(bytes, at).map(usize::from));
        let name = name?;
        let extra = extra?;
        let comment = comment?;
        let text = bytes.get(ENTRY_BYTES..ENTRY_BYTES + name)?;
        let extra = bytes.get(ENTRY_BYTES + name..ENTRY_BYTES + name + extra)?;
        let after = bytes.get(ENTRY_BYTES + name + extra.len() + comment..)?;
        let name = String::from_utf8_lossy(text).into_owned();
        let [stored, size, at] = [20, 24, 42].map(|at| u32_at(bytes, at));
        let mut large = extra_64(extra).unwrap_or_default();
        // Numbers that do not fit are in the extra field, in this order.
        let mut number = |small: u32| match small {
            u32::MAX => {
                let found = u64_at(large, 0)?;
                large = &large[8..];
                Some(found)
            }
            small => Some(small.into()),
        };
        let bytes_of = number(size?)?;
        let stored_bytes = number(stored?)?;
        let at = number(at?)?;
        let method = u16_at(bytes, 10)?;
        let is_encrypted = u16_at(bytes, 8)? & 1 == 1;
        if !matches!(method, 0 | 8) || is_encrypted {
            let message = format!("the entry `{}` is neither stored nor deflated", visible(&name));
            return Some((Err(content(message)), after));
        }
        Some((Ok(Entry { name, is_deflated: method == 8, stored_bytes, bytes: bytes_of, at }), after))
    }
}

/// Returns the content of the extra field with large numbers.
fn extra_64(mut extra: &[u8]) -> Option<&[u8]> {
    loop {
        let kind = u16_at(extra, 0)?;
        let length = usize::from(u16_at(extra, 2)?);
        let body = extra.get(4..4 + length)?;
        if kind == 1 {
            return Some(body);
        }
        extra = &extra[4 + length..];
    }
}

fn read_at<R: Read + Seek>(file: &mut R, start: u64, end: u64) -> Result<Vec<u8>> {
    file.seek(SeekFrom::Start(start))?;
    let mut bytes = Vec::new();
    file.by_ref().take(end.saturating_sub(start)).read_to_end(&mut bytes)?;
    Ok(bytes)
}

fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    Some(u16::from_le_bytes(bytes.get(at..at + 2)?.try_into().ok()?))
}

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?))
}

fn u64_at(bytes: &[u8], at: usize) -> Option<u64> {
    Some(u64::from_le_bytes(bytes.get(at..at + 8)?.try_into().ok()?))
}
