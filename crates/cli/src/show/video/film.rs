//! Checks that a file is a complete MP4 file.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;

/// Checks that a file consists of whole MP4 boxes, among them the type, the index and the data of a
/// video.
///
/// An encoder that is killed, or whose disk is full, writes no index or a part of the data. Not
/// every version of ffmpeg then ends with an error.
///
/// # Errors
/// The inner error describes an incomplete file. The outer error is that of reading it.
pub fn check(file: &File) -> io::Result<Result<(), String>> {
    let length = file.metadata()?.len();
    let mut offset = 0;
    let mut boxes = Vec::new();
    while offset < length {
        // The size in bytes and the name; a size of 1 is followed by a 64-bit size.
        let mut header = [0; 16];
        let available = header.len().min(usize::try_from(length - offset).unwrap_or(usize::MAX));
        file.read_exact_at(&mut header[..available], offset)?;
        let [a, b, c, d, name @ .., _, _, _, _, _, _, _, _] = header;
        let (_, large) = header.split_at(8);
        let large = large.try_into().map_or(0, u64::from_be_bytes);
        let size = match u32::from_be_bytes([a, b, c, d]) {
            0 => length - offset,
            1 => large,
            size => u64::from(size),
        };
        if size < 8 || size > length - offset {
            return Ok(Err(format!("its {length} bytes are not a whole MP4 file")));
        }
        boxes.push(name);
        offset += size;
    }
    let missing = [b"ftyp", b"moov", b"mdat"].into_iter().find(|name| !boxes.contains(*name));
    Ok(match missing {
        None => Ok(()),
        Some(_) if length == 0 => Err("the file is empty".to_string()),
        Some(name) => Err(format!("its {length} bytes have no MP4 box `{}`", String::from_utf8_lossy(name))),
    })
}
