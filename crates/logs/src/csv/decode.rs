//! Bytes of text files as UTF-8: byte order marks, UTF-16, cells that spaces separate.

use std::io::{self, Read};

use crate::table::retried;

/// Removes a byte order mark and converts UTF-16, which Excel writes as "Unicode text", to UTF-8.
pub(super) fn utf8(mut source: Box<dyn Read>) -> io::Result<Box<dyn Read>> {
    let mut first = Vec::new();
    source.by_ref().take(3).read_to_end(&mut first)?;
    let (skipped, is_big) = match first.as_slice() {
        [0xef, 0xbb, 0xbf] => (3, None),
        [0xff, 0xfe, ..] => (2, Some(false)),
        [0xfe, 0xff, ..] => (2, Some(true)),
        _ => (0, None),
    };
    let rest = Box::new(io::Cursor::new(first.split_off(skipped)).chain(source));
    Ok(match is_big {
        Some(is_big) => Box::new(Utf16 { source: rest, is_big, high: None, out: Vec::new(), given: 0 }),
        None => rest,
    })
}

/// Converts UTF-16 to UTF-8.
struct Utf16<R> {
    source: R,
    is_big: bool,
    /// The first half of a surrogate pair.
    high: Option<u16>,
    out: Vec<u8>,
    /// Number of bytes of `out` that were read.
    given: usize,
}

/// Number of bytes that are converted at once.
const BLOCK: usize = 8192;

impl<R: Read> Utf16<R> {
    fn fill(&mut self) -> io::Result<()> {
        self.out.clear();
        self.given = 0;
        let mut block = vec![0; BLOCK];
        let read = retried(|| self.source.read(&mut block))?;
        block.truncate(read);
        if !read.is_multiple_of(2) {
            self.source.by_ref().take(1).read_to_end(&mut block)?;
        }
        let is_end = block.is_empty();
        let units = block.chunks(2).map(|pair| match *pair {
            [a, b] if self.is_big => u16::from_be_bytes([a, b]),
            [a, b] => u16::from_le_bytes([a, b]),
            // Half a character at the end of the file.
            _ => char::REPLACEMENT_CHARACTER as u16,
        });
        let units: Vec<u16> = self.high.take().into_iter().chain(units).collect();
        let whole = match units.last() {
            Some(last @ 0xd800..0xdc00) if !is_end => {
                self.high = Some(*last);
                &units[..units.len() - 1]
            }
            _ => &units[..],
        };
        self.out.extend(String::from_utf16_lossy(whole).bytes());
        Ok(())
    }
}

impl<R: Read> Read for Utf16<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        while self.given == self.out.len() {
            self.fill()?;
            if self.out.is_empty() && self.high.is_none() {
                return Ok(0);
            }
        }
        let count = buffer.len().min(self.out.len() - self.given);
        buffer[..count].copy_from_slice(&self.out[self.given..self.given + count]);
        self.given += count;
        Ok(count)
    }
}

/// Replaces spaces and tabs between cells by one tab, and removes those at the ends of lines.
pub(super) struct Blanks<R> {
    pub(super) source: R,
    /// Whether a separator is due before the next cell.
    pub(super) is_due: bool,
    pub(super) is_quoted: bool,
    /// Whether the line has a cell so far.
    pub(super) is_in_line: bool,
}

impl<R: Read> Read for Blanks<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        // A separator comes with the byte after it.
        let half = (buffer.len() / 2).clamp(1, buffer.len().max(1));
        let mut block = vec![0; half.min(1 << 16)];
        loop {
            let count = self.source.read(&mut block)?;
            let mut written = 0;
            for byte in &block[..count] {
                match byte {
                    b' ' | b'\t' | b'\r' if !self.is_quoted => {
                        self.is_due = self.is_in_line;
                        continue;
                    }
                    b'\n' if !self.is_quoted => (self.is_due, self.is_in_line) = (false, false),
                    b'"' => self.is_quoted = !self.is_quoted,
                    _ => {}
                }
                if self.is_due {
                    buffer[written] = b'\t';
                    written += 1;
                    self.is_due = false;
                }
                self.is_in_line |= *byte != b'\n';
                buffer[written] = *byte;
                written += 1;
            }
            if written > 0 || count == 0 {
                return Ok(written);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(bytes: &[u8]) -> String {
        let mut text = String::new();
        let source = Box::new(io::Cursor::new(bytes.to_vec()));
        utf8(source).expect("a source").read_to_string(&mut text).expect("UTF-8");
        text
    }

    #[test]
    fn texts_with_a_byte_order_mark_are_read_alike() {
        // Pairs of surrogates cross the border of a block.
        let text = format!("zeit;kraft\n{}\n", "x𝄞".repeat(5000));
        let units: Vec<u16> = text.encode_utf16().collect();
        let little: Vec<u8> = [0xfeff].iter().chain(&units).flat_map(|unit| unit.to_le_bytes()).collect();
        let big: Vec<u8> = [0xfeff].iter().chain(&units).flat_map(|unit| unit.to_be_bytes()).collect();
        for bytes in [text.as_bytes().to_vec(), format!("\u{feff}{text}").into_bytes(), little, big] {
            assert!(read(&bytes) == text, "{:?}", &bytes[..4]);
        }
        assert_eq!(read(&[0xff, 0xfe, b'a', 0, b'b']), "a\u{fffd}");
        assert_eq!(read(&[0xff, 0xfe]), "");
        assert_eq!(read(b""), "");
    }

    #[test]
    fn spaces_between_cells_are_one_separator() {
        let source: &[u8] = b"  time   d \n 0\t 1.5\n\n\"a b\"  2  \r\n";
        let mut text = String::new();
        let mut blanks = Blanks { source, is_due: false, is_quoted: false, is_in_line: false };
        blanks.read_to_string(&mut text).expect("UTF-8");
        assert_eq!(text, "time\td\n0\t1.5\n\n\"a b\"\t2\n");
    }
}
