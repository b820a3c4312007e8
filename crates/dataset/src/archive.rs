//! NumPy archives: uncompressed ZIP files of arrays, as `numpy.savez` writes them.

use std::fs::File;
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::Path;

use flate2::Crc;

/// Records of the ZIP format (PKWARE's APPNOTE, 4.3) of this version: with 64-bit sizes.
const VERSION: u16 = 45;
const LOCAL: u32 = 0x0403_4b50;
const CENTRAL: u32 = 0x0201_4b50;
const END: u32 = 0x0605_4b50;
const END_64: u32 = 0x0606_4b50;
const LOCATOR_64: u32 = 0x0706_4b50;

/// The 1st of January 1980, the first date of the format: equal data give equal bytes.
const DATE: u16 = (1 << 5) | 1;

/// Name and size of an array in the archive, and where it is.
struct Entry {
    name: String,
    size: u64,
    crc: u32,
    offset: u64,
}

/// An archive that is written.
pub(crate) struct Archive {
    file: BufWriter<File>,
    entries: Vec<Entry>,
}

impl Archive {
    pub(crate) fn create(path: &Path) -> io::Result<Archive> {
        Ok(Archive { file: BufWriter::new(File::create_new(path)?), entries: Vec::new() })
    }

    /// Adds an array. `kind` is its type in NumPy's notation, such as `<f4`.
    pub(crate) fn add(
        &mut self,
        name: &str,
        kind: &str,
        shape: &[usize],
        data: &mut dyn Read,
    ) -> io::Result<()> {
        let name = format!("{name}.npy");
        let offset = self.file.stream_position()?;
        // Size and checksum follow when they are known.
        self.local_header(&name, 0, 0)?;
        let header = header(kind, shape);
        let mut crc = Crc::new();
        crc.update(&header);
        self.file.write_all(&header)?;
        let mut size = header.len() as u64;
        let mut buffer = vec![0; 1 << 16];
        loop {
            let read = data.read(&mut buffer)?;
            if read == 0 {
                break;
            }
            crc.update(&buffer[..read]);
            self.file.write_all(&buffer[..read])?;
            size += read as u64;
        }
        let end = self.file.stream_position()?;
        self.file.seek(SeekFrom::Start(offset))?;
        self.local_header(&name, crc.sum(), size)?;
        self.file.seek(SeekFrom::Start(end))?;
        self.entries.push(Entry { name, size, crc: crc.sum(), offset });
        Ok(())
    }

    fn local_header(&mut self, name: &str, crc: u32, size: u64) -> io::Result<()> {
        let mut bytes = Vec::new();
        bytes.extend(LOCAL.to_le_bytes());
        common(&mut bytes, crc, name);
        bytes.extend(20_u16.to_le_bytes());
        bytes.extend(name.as_bytes());
        extra(&mut bytes, &[size, size]);
        self.file.write_all(&bytes)
    }

    /// Writes the directory of the archive.
    pub(crate) fn finish(mut self) -> io::Result<()> {
        let start = self.file.stream_position()?;
        let mut bytes = Vec::new();
        for Entry { name, size, crc, offset } in &self.entries {
            bytes.extend(CENTRAL.to_le_bytes());
            bytes.extend(VERSION.to_le_bytes());
            common(&mut bytes, *crc, name);
            // Length of the extra field; no comment, first disk, no attributes.
            bytes.extend(28_u16.to_le_bytes());
            bytes.extend([0; 10]);
            bytes.extend(u32::MAX.to_le_bytes());
            bytes.extend(name.as_bytes());
            extra(&mut bytes, &[*size, *size, *offset]);
        }
        let count = self.entries.len() as u64;
        let length = bytes.len() as u64;
        bytes.extend(END_64.to_le_bytes());
        bytes.extend(44_u64.to_le_bytes());
        bytes.extend([VERSION, VERSION].map(u16::to_le_bytes).concat());
        bytes.extend([0; 8]);
        bytes.extend([count, count, length, start].map(u64::to_le_bytes).concat());
        bytes.extend(LOCATOR_64.to_le_bytes());
        bytes.extend([0; 4]);
        bytes.extend((start + length).to_le_bytes());
        bytes.extend(1_u32.to_le_bytes());
        // The end of the 32-bit format says that the 64-bit one is valid.
        bytes.extend(END.to_le_bytes());
        bytes.extend([0; 4]);
        bytes.extend([0xff; 12]);
        bytes.extend([0; 2]);
        self.file.write_all(&bytes)?;
        self.file.flush()
    }
}

/// Appends the fields that both headers of an entry have: from the version to the length of the
/// name. The sizes are in the extra field.
fn common(bytes: &mut Vec<u8>, crc: u32, name: &str) {
    // No compression.
    bytes.extend([VERSION, 0, 0, 0, DATE].map(u16::to_le_bytes).concat());
    bytes.extend([crc, u32::MAX, u32::MAX].map(u32::to_le_bytes).concat());
    bytes.extend((name.len() as u16).to_le_bytes());
}

/// Appends the extra field with 64-bit sizes.
fn extra(bytes: &mut Vec<u8>, values: &[u64]) {
    bytes.extend([1, 8 * values.len() as u16].map(u16::to_le_bytes).concat());
    values.iter().for_each(|value| bytes.extend(value.to_le_bytes()));
}

/// Returns the header of a `.npy` file of version 1.0, padded so that the data are aligned.
fn header(kind: &str, shape: &[usize]) -> Vec<u8> {
    let sizes: String = shape.iter().map(|size| format!("{size}, ")).collect();
    let text = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({}), }}", sizes.trim_end());
    let length = (10 + text.len() + 1).next_multiple_of(64) - 10;
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((length as u16).to_le_bytes());
    bytes.extend(format!("{text:<0$}\n", length - 1).as_bytes());
    bytes
}
