//! Compressed traces in run files.

use std::path::Path;

use mishandle::store::{IfExists, RunFile, RunWriter, Simulation, StoredTrace, trace_digest};
use rusqlite::Connection;

use crate::run;
use crate::scratch::Scratch;

/// Largest number of samples times columns that the reference decoder reads.
const LARGEST: usize = 1 << 16;

/// Largest number of columns of a trace that is written again.
const COLUMNS: usize = 8;

/// Checks the laws, with the blob beside a row whose trace digest is that of the reference
/// decoder's result:
/// - a blob that the reference decoder rejects is an error;
/// - a blob that is read has the bits of the reference decoder;
/// - a trace that is read and written reads as the same trace, also by the reference decoder.
pub fn check(blob: &[u8]) {
    let reference = decode(blob);
    let scratch = Scratch::new();
    let signals = reference.as_ref().map_or(0, Vec::len).min(COLUMNS);
    let digest = trace_digest(reference.iter().flatten().map(Vec::as_slice));
    let row = Simulation { trace_digest: Some(digest), ..run::simulation(1, 1, None) };
    let path = write(&scratch, "blob.sqlite", signals, &row);
    let sql = "INSERT INTO trace (trial, number, blob) VALUES (1, 1, ?1)";
    open(&path).execute(sql, [blob]).expect("a new trace");

    let Ok(run) = RunFile::open(&path) else { return };
    let Ok(row) = run.simulation(1, 1) else { return };
    let trace = row.trace.expect("a stored trace");
    let reference = reference.expect("the reference decoder accepts what is read");
    assert_eq!(bits(&trace.columns), bits(&reference));
    if trace.columns.len() == signals {
        check_encoding(&scratch, trace);
    }
}

fn check_encoding(scratch: &Scratch, trace: StoredTrace) {
    let expected = bits(&trace.columns);
    let signals = trace.columns.len();
    let path = write(scratch, "again.sqlite", signals, &run::simulation(1, 1, Some(trace)));
    let row = RunFile::open(&path).and_then(|run| run.simulation(1, 1)).expect("a valid run");
    assert_eq!(bits(&row.trace.expect("a stored trace").columns), expected);
    let columns = decode(&blob_of(&path)).expect("a valid blob");
    assert_eq!(bits(&columns), expected);
}

/// Writes a run with one simulation.
fn write(scratch: &Scratch, name: &str, signals: usize, row: &Simulation) -> std::path::PathBuf {
    let path = scratch.path(name);
    let mut writer = RunWriter::create(&path, &run::header(signals), IfExists::Refuse).expect("a new file");
    writer.start_trial(1, 0).expect("a new trial");
    writer.record(std::slice::from_ref(row)).expect("a new simulation");
    writer.close().expect("a complete run");
    path
}

fn open(path: &Path) -> Connection {
    Connection::open(path).expect("a database")
}

fn blob_of(path: &Path) -> Vec<u8> {
    open(path).query_row("SELECT blob FROM trace", [], |row| row.get(0)).expect("a stored trace")
}

fn bits(columns: &[Vec<f64>]) -> Vec<Vec<u64>> {
    columns.iter().map(|column| column.iter().map(|value| value.to_bits()).collect()).collect()
}

/// The reference decoder, written from the description of the format and not from the code of
/// `store`.
fn decode(blob: &[u8]) -> Option<Vec<Vec<f64>>> {
    let number = |at: usize| Some(u32::from_le_bytes(blob.get(at..at + 4)?.try_into().ok()?) as usize);
    let samples = number(1)?;
    let columns = number(5)?;
    let orders = blob.get(9..9_usize.checked_add(columns)?)?;
    let residuals = samples.checked_mul(columns).filter(|count| *count <= LARGEST)?;
    if blob[0] != 1 || orders.iter().any(|order| *order > 3) {
        return None;
    }
    let planes = decompress(&blob[9 + columns..], residuals * 8)?;
    let column = |column: usize| {
        let mut x1 = 0_u64;
        let mut x2 = 0_u64;
        let mut x3 = 0_u64;
        let next = |sample: usize| {
            let byte = |plane: usize| u64::from(planes[plane * residuals + column * samples + sample]);
            let folded = (0..8).map(|plane| byte(plane) << (8 * plane)).sum::<u64>();
            let residual = (folded / 2) ^ if folded % 2 == 1 { u64::MAX } else { 0 };
            let predicted = match orders[column] {
                0 => 0,
                1 => x1,
                2 => x1.wrapping_add(x1).wrapping_sub(x2),
                _ => x1.wrapping_mul(3).wrapping_sub(x2.wrapping_mul(3)).wrapping_add(x3),
            };
            (x3, x2, x1) = (x2, x1, residual.wrapping_add(predicted));
            f64::from_bits(x1)
        };
        (0..samples).map(next).collect()
    };
    Some((0..columns).map(column).collect())
}

/// Decompresses an LZ4 block of exactly `length` bytes.
fn decompress(block: &[u8], length: usize) -> Option<Vec<u8>> {
    let mut bytes = block.iter().copied();
    let mut out = Vec::new();
    // A length of 15 is continued by bytes up to the first that is not 255.
    let extend = |bytes: &mut dyn Iterator<Item = u8>, nibble: u8| {
        let mut length = usize::from(nibble);
        let mut last = if nibble == 15 { 255 } else { 0 };
        while last == 255 {
            last = bytes.next()?;
            length += usize::from(last);
        }
        Some(length)
    };
    while let Some(token) = bytes.next() {
        let literals = extend(&mut bytes, token >> 4)?;
        out.extend(bytes.by_ref().take(literals));
        let Some(low) = bytes.next() else { break };
        let offset = usize::from(u16::from_le_bytes([low, bytes.next()?]));
        for _ in 0..extend(&mut bytes, token & 15)? + 4 {
            let from = out.len().checked_sub(offset).filter(|_| offset > 0)?;
            out.push(out[from]);
            if out.len() > length {
                return None;
            }
        }
    }
    (out.len() == length).then_some(out)
}

pub fn seeds() -> Vec<Vec<u8>> {
    let smooth = |c: u32| (0..40).map(|k| 2.0 + f64::from(c * k).sin() * 0.1).collect::<Vec<f64>>();
    let traces = [
        vec![],
        vec![vec![], vec![]],
        vec![vec![1.5]],
        vec![vec![0.1; 300]; 3],
        vec![vec![0.0, -0.0, f64::NAN, f64::INFINITY, 5e-324, f64::MAX], vec![1.0; 6]],
        vec![smooth(1), smooth(2), (0..40).map(f64::from).collect()],
    ];
    let scratch = Scratch::new();
    let encode = |columns: &Vec<Vec<f64>>| {
        let trace = StoredTrace { columns: columns.clone() };
        let name = format!("{}.sqlite", trace.digest());
        blob_of(&write(&scratch, &name, columns.len(), &run::simulation(1, 1, Some(trace))))
    };
    traces.iter().map(encode).collect()
}
