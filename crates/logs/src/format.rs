//! The format of a file: by its first bytes, then by the ending of its name.

use std::io::{self, Read};
use std::path::Path;

use crate::error::{Result, content};
use crate::options::Format;

/// Returns the format of a file, and a reader from its start.
pub(crate) fn of(
    path: &Path,
    mut file: impl Read + 'static,
    stated: Option<Format>,
) -> Result<(Format, Box<dyn Read>)> {
    let mut first = Vec::new();
    // The first line is enough for every format, and a pipe may have no more yet.
    while first.len() < 16 && !first.contains(&b'\n') {
        if file.by_ref().take(1).read_to_end(&mut first)? == 0 {
            break;
        }
    }
    let found = format(path, &first, stated);
    Ok((found?, Box::new(io::Cursor::new(first).chain(file))))
}

fn format(path: &Path, first: &[u8], stated: Option<Format>) -> Result<Format> {
    if let Some(stated) = stated {
        return Ok(stated);
    }
    match first {
        [b'P', b'A', b'R', b'1', ..] => return Ok(Format::Parquet),
        [b'P', b'K', 3, 4, ..] | [0x93, b'N', b'U', b'M', b'P', b'Y', ..] => {
            return Ok(Format::Numpy);
        }
        [0x89, b'M', b'C', b'A', b'P', ..] => return Err(in_python("an MCAP file")),
        [b'#', b'R', b'O', b'S', b'B', b'A', b'G', ..] => {
            return Err(in_python("a bag of ROS 1"));
        }
        [b'S', b'Q', b'L', b'i', b't', b'e', ..] => {
            return Err(in_python("an SQLite file, such as a bag of rosbag2"));
        }
        _ if is_object(first) => return Ok(Format::JsonLines),
        [0x1f, 0x8b, ..] => {
            return Err(content("the file is compressed with gzip; unpack it with gunzip"));
        }
        _ => {}
    }
    let ending = path.extension().map(|ending| ending.to_string_lossy().to_lowercase()).unwrap_or_default();
    match ending.as_str() {
        "jsonl" | "ndjson" | "json" => Ok(Format::JsonLines),
        "npz" | "npy" => Ok(Format::Numpy),
        "parquet" | "pq" => Ok(Format::Parquet),
        "mcap" => Err(in_python("an MCAP file")),
        "bag" | "db3" => Err(in_python("a bag of ROS")),
        "csv" | "tsv" | "txt" | "dat" | "log" => Ok(Format::Csv),
        _ if first.trim_ascii_start().starts_with(b"{") => Ok(Format::JsonLines),
        _ => Ok(Format::Csv),
    }
}

/// Returns whether bytes start an object of JSON with a field.
fn is_object(first: &[u8]) -> bool {
    let inside = first.trim_ascii_start().strip_prefix(b"{");
    inside.is_some_and(|inside| inside.trim_ascii_start().starts_with(b"\""))
}

/// Returns the error for a folder.
pub(crate) fn of_folder(path: &Path) -> crate::LogError {
    if path.join("metadata.yaml").is_file() {
        in_python("a folder of rosbag2")
    } else {
        content("expected a file, found a folder")
    }
}

/// Returns the error for a format that the Python package reads.
fn in_python(what: &str) -> crate::LogError {
    content(format!(
        "the file is {what}, which only the Python package reads: pip install '.[logs]' in a clone of Mishandle"
    ))
}
