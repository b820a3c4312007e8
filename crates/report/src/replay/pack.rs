//! Blocks of data of a page: a JSON head and numbers, compressed.

use std::io::Write;

use flate2::Compression;
use flate2::write::ZlibEncoder;
use serde_json::Value;

/// Columns of integers, each the difference from the one before, in as few bytes as it needs.
#[derive(Debug, Default)]
pub struct Columns {
    pub bytes: Vec<u8>,
}

impl Columns {
    /// Appends a column of multiples of `grid`.
    pub fn push(&mut self, values: impl IntoIterator<Item = f64>, grid: f64) {
        let mut before = 0;
        for value in values {
            // Beyond these bounds JavaScript's numbers are not exact.
            let value = (value / grid).round().clamp(-1e15, 1e15) as i64;
            let difference = value - before;
            before = value;
            // The sign is the last bit.
            let mut rest = ((difference << 1) ^ (difference >> 63)) as u64;
            while rest > 127 {
                self.bytes.push(rest as u8 | 128);
                rest >>= 7;
            }
            self.bytes.push(rest as u8);
        }
    }

    /// Ends the columns so that 32-bit numbers can follow. Returns the number of bytes.
    pub fn end(&mut self) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.bytes.len()
    }
}

/// Returns a block: the length of the head, the head, and the bytes, by zlib.
pub fn block(head: &Value, bytes: &[u8]) -> Vec<u8> {
    let head = head.to_string();
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::new(7));
    let parts = [&(head.len() as u32).to_le_bytes(), head.as_bytes(), bytes];
    // A vector takes everything that is written to it.
    parts.iter().for_each(|part| encoder.write_all(part).unwrap_or_default());
    encoder.finish().unwrap_or_default()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::io::Read;

    use super::*;

    #[test]
    fn columns_have_the_differences_as_the_script_reads_them() {
        let mut columns = Columns::default();
        columns.push([0.0, 0.5, -32.0, -32.0, f64::NAN], 0.5);
        // 0, +1 -> 2, -65 -> 129 = 1 + 128, 0, +64 -> 128.
        assert_eq!(columns.bytes, [0, 2, 129, 1, 0, 128, 1]);
        assert_eq!(columns.end(), 8);
    }

    #[test]
    fn a_block_is_zlib_of_length_head_and_bytes() {
        let packed = block(&serde_json::json!({"a": 1}), &[7, 8]);
        let mut plain = Vec::new();
        flate2::read::ZlibDecoder::new(&*packed).read_to_end(&mut plain).unwrap();
        assert_eq!(plain, [&[7, 0, 0, 0][..], br#"{"a":1}"#, &[7, 8]].concat());
    }
}
