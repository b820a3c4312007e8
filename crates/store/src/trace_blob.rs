//! Compression of traces.
//!
//! A blob consists of
//!
//! ```text
//! 1 byte               version of the encoding, 1
//! 4 bytes              n, samples of a column, little-endian
//! 4 bytes              m, columns, little-endian
//! m bytes              order of each column's predictor, 0 to 3
//! the rest             an LZ4 block of the residuals' bytes: first the lowest byte of every residual, column by
//!                      column, then the next higher one, up to the eighth
//! ```
//!
//! A sample's bits are read as an unsigned integer x and predicted from the three before it (0
//! where there are none), modulo 2⁶⁴:
//!
//! ```text
//! order 0: 0      order 1: x₁      order 2: 2 x₁ − x₂      order 3: 3 x₁ − 3 x₂ + x₃
//! ```
//!
//! The residual is x minus the prediction, with the sign moved to the lowest bit. The motion of a
//! robot is smooth, so the high bytes of the residuals are mostly 0. The low bytes are rounding
//! noise, which does not compress. The encoding is lossless for every bit pattern, including NaN.

use crate::digest::Digest;

const ENCODING: u8 = 1;
const ORDERS: u8 = 4;
const FIXED_BYTES: usize = 9;
/// Upper bound of LZ4's compression ratio, which is at most 255. A blob that claims a higher ratio
/// is damaged; no memory is allocated for it.
const LARGEST_RATIO: usize = 256;

/// Largest size of a trace, in bytes before compression.
const MAX_TRACE_BYTES: usize = 256 << 20;
/// Largest size of a blob: LZ4 adds at most one byte to 255.
pub(crate) const MAX_BLOB_BYTES: usize = MAX_TRACE_BYTES + MAX_TRACE_BYTES / 128;

/// The trace of an episode: one column per signal of the header, one sample per control step, from
/// step 0.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct StoredTrace {
    /// The columns, all of the same length, in the order of
    /// [`RunHeader::signals`](crate::RunHeader::signals).
    pub columns: Vec<Vec<f64>>,
}

impl StoredTrace {
    /// Returns the [`trace_digest`] of the columns.
    pub fn digest(&self) -> u128 {
        trace_digest(self.columns.iter().map(Vec::as_slice))
    }

    /// Returns the number of samples per column.
    pub(crate) fn samples(&self) -> usize {
        self.columns.first().map_or(0, Vec::len)
    }

    /// Returns whether the trace is larger than a file may contain.
    pub(crate) fn is_too_large(&self) -> bool {
        residuals(self.samples(), self.columns.len()).is_none()
    }
}

/// Returns a digest of the bits of a trace. Two traces have the same digest if and, for practical
/// purposes, only if all their samples have the same bits.
///
/// The digest is the first 128 bits of the SHA-256 of the text `trace`, preceded by its length, and
/// of the columns in order, each preceded by its length. Lengths and samples have 8 bytes,
/// little-endian. The digest does not depend on the storage format.
///
/// # Example
/// ```
/// use mishandle_store::trace_digest;
///
/// let trace = trace_digest([[0.1, 0.2].as_slice(), &[0.3, 0.4]]);
/// assert_eq!(trace, trace_digest([[0.1, 0.2].as_slice(), &[0.3, 0.4]]));
/// assert_ne!(trace, trace_digest([[0.1, 0.2].as_slice(), &[0.3, 0.4000000000000001]]));
/// ```
pub fn trace_digest<'a>(columns: impl IntoIterator<Item = &'a [f64]>) -> u128 {
    let mut digest = Digest::of("trace");
    for column in columns {
        digest.floats(column);
    }
    digest.finish()
}

/// Returns the number of residuals of a trace; `None` if the trace is larger than a file may
/// contain.
fn residuals(samples: usize, columns: usize) -> Option<usize> {
    samples.checked_mul(columns).filter(|&residuals| residuals <= MAX_TRACE_BYTES / 8)
}

/// Encodes a trace as a blob. Its columns have the same length.
pub(crate) fn encode(trace: &StoredTrace) -> Vec<u8> {
    let samples = trace.samples();
    let columns = trace.columns.len();
    let residuals = samples * columns;
    let mut blob =
        Vec::with_capacity(FIXED_BYTES + columns + lz4_flex::block::get_maximum_output_size(residuals * 8));
    blob.push(ENCODING);
    blob.extend((samples as u32).to_le_bytes());
    blob.extend((columns as u32).to_le_bytes());
    let mut planes = vec![0; residuals * 8];
    for (column, values) in trace.columns.iter().enumerate() {
        let order = best_order(values);
        blob.push(order);
        let mut past = [0; 3];
        for (sample, value) in values.iter().enumerate() {
            let residual = fold_sign(value.to_bits().wrapping_sub(predict(order, past)));
            past = [value.to_bits(), past[0], past[1]];
            for (plane, byte) in residual.to_le_bytes().into_iter().enumerate() {
                planes[plane * residuals + column * samples + sample] = byte;
            }
        }
    }
    blob.extend(lz4_flex::block::compress(&planes));
    blob
}

/// Decodes a blob of a trace with this number of columns. The error describes the damage.
pub(crate) fn decode(blob: &[u8], expected_columns: usize) -> Result<StoredTrace, String> {
    let (fixed, rest) = blob.split_at_checked(FIXED_BYTES).ok_or("it ends within its header")?;
    let [encoding, s0, s1, s2, s3, c0, c1, c2, c3] = *fixed else {
        return Err("it ends early".into());
    };
    if encoding != ENCODING {
        return Err(format!("its encoding is {encoding}, this program reads {ENCODING}"));
    }
    let samples = u32::from_le_bytes([s0, s1, s2, s3]) as usize;
    let columns = u32::from_le_bytes([c0, c1, c2, c3]) as usize;
    let (orders, block) = rest.split_at_checked(columns).ok_or("it ends within its orders")?;
    if columns != expected_columns {
        return Err(format!("it has {columns} columns, the header has {expected_columns} signals"));
    }
    let residuals = residuals(samples, columns)
        .filter(|&residuals| residuals <= block.len().saturating_mul(LARGEST_RATIO))
        .ok_or_else(|| {
            format!("{} bytes cannot contain {columns} columns of {samples} samples", block.len())
        })?;
    let planes = lz4_flex::block::decompress(block, residuals * 8).map_err(|error| error.to_string())?;
    if planes.len() != residuals * 8 {
        return Err(format!("it has {} bytes of residuals, expected {}", planes.len(), residuals * 8));
    }
    let column_of = |(column, &order): (usize, &u8)| {
        let mut past = [0; 3];
        let next = |sample| {
            let bytes = std::array::from_fn(|plane| planes[plane * residuals + column * samples + sample]);
            let bits = unfold_sign(u64::from_le_bytes(bytes)).wrapping_add(predict(order, past));
            past = [bits, past[0], past[1]];
            f64::from_bits(bits)
        };
        (0..samples).map(next).collect()
    };
    if let Some(order) = orders.iter().find(|&&order| order >= ORDERS) {
        return Err(format!("the order of a predictor is {order}, expected 0 to 3"));
    }
    Ok(StoredTrace { columns: orders.iter().enumerate().map(column_of).collect() })
}

/// Predicts the next sample by polynomial extrapolation of degree `order` - 1 from `past`, the
/// latest sample first.
fn predict(order: u8, past: [u64; 3]) -> u64 {
    let [x1, x2, x3] = past;
    match order {
        0 => 0,
        1 => x1,
        2 => x1.wrapping_mul(2).wrapping_sub(x2),
        _ => x1.wrapping_sub(x2).wrapping_mul(3).wrapping_add(x3),
    }
}

/// Returns the order with the smallest residuals.
fn best_order(values: &[f64]) -> u8 {
    let mut bits = [0; ORDERS as usize];
    let mut past = [0; 3];
    for value in values {
        for (order, bits) in (0..).zip(&mut bits) {
            let residual = fold_sign(value.to_bits().wrapping_sub(predict(order, past)));
            *bits += u64::BITS - residual.leading_zeros();
        }
        past = [value.to_bits(), past[0], past[1]];
    }
    (0..ORDERS).min_by_key(|&order| bits[usize::from(order)]).unwrap_or(0)
}

/// Zigzag encoding: maps 0, −1, 1, −2, … to 0, 1, 2, 3, …
fn fold_sign(x: u64) -> u64 {
    x << 1 ^ (x.cast_signed() >> 63).cast_unsigned()
}

fn unfold_sign(x: u64) -> u64 {
    x >> 1 ^ (x & 1).wrapping_neg()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bits(trace: &StoredTrace) -> Vec<Vec<u64>> {
        trace.columns.iter().map(|column| column.iter().map(|x| x.to_bits()).collect()).collect()
    }

    #[track_caller]
    fn check(columns: Vec<Vec<f64>>) {
        let trace = StoredTrace { columns };
        assert_eq!(bits(&decode(&encode(&trace), trace.columns.len()).unwrap()), bits(&trace));
    }

    #[test]
    fn decoding_restores_every_bit() {
        check(vec![]);
        check(vec![vec![], vec![]]);
        check(vec![vec![1.5]]);
        check(vec![vec![0.0, -0.0, f64::INFINITY, f64::NEG_INFINITY, f64::MIN_POSITIVE, 5e-324, f64::MAX]]);
        check(vec![vec![f64::NAN, f64::from_bits(0x7ff0_0000_0000_0001), f64::from_bits(u64::MAX), 1.0]]);
        check(
            (0..7)
                .map(|c| (0..301).map(|k| f64::from(c * k).sin() * 10f64.powi(c * 20 - 60)).collect())
                .collect(),
        );
    }

    #[test]
    fn the_digest_equals_a_computation_in_python() {
        // Python: b = struct.pack('<Q', 5) + b'trace'
        //         for c in [[1.0, -0.0], [0.1, inf]]: b += struct.pack('<Qdd', 2, *c)
        //         hashlib.sha256(b).hexdigest()[:32]
        let trace = StoredTrace { columns: vec![vec![1.0, -0.0], vec![0.1, f64::INFINITY]] };
        assert_eq!(format!("{:032x}", trace.digest()), "cf047e2b102f4a1bd97202808264f47b");
    }

    #[test]
    fn unfolding_inverts_folding_the_sign() {
        assert_eq!([0, u64::MAX, 1, u64::MAX - 1].map(fold_sign), [0, 1, 2, 3]);
        for x in [0, 1, u64::MAX, 1 << 63, (1 << 63) - 1, 0x1234_5678_9abc_def0] {
            assert_eq!(unfold_sign(fold_sign(x)), x);
        }
    }

    #[test]
    fn constant_and_smooth_signals_compress() {
        let constant = StoredTrace { columns: vec![vec![0.1; 301]; 6] };
        assert!(encode(&constant).len() < 200, "{}", encode(&constant).len());
        let smooth =
            StoredTrace { columns: vec![(0..301).map(|k| 2.0 + (0.02 * f64::from(k)).sin()).collect(); 6] };
        assert!(encode(&smooth).len() < 301 * 6 * 8 * 6 / 10, "{}", encode(&smooth).len());
    }

    #[test]
    fn decoding_a_damaged_blob_never_panics() {
        let trace = StoredTrace { columns: vec![(0..50).map(f64::from).collect(); 3] };
        let blob = encode(&trace);
        for length in 0..blob.len() {
            assert!(decode(&blob[..length], 3).is_err(), "cut to {length} bytes");
        }
        for place in 0..blob.len() {
            for change in 1..=255 {
                let mut damaged = blob.clone();
                damaged[place] ^= change;
                if let Ok(read) = decode(&damaged, 3) {
                    assert_eq!(read.columns.len(), 3);
                }
            }
        }
    }

    #[test]
    fn a_blob_that_claims_a_huge_trace_is_rejected_before_memory_is_allocated() {
        // 1 KiB of zeros decompresses to 256 KiB at most.
        let claims = |samples: u32, columns: u32, bytes: usize| {
            let mut blob = vec![ENCODING];
            blob.extend(samples.to_le_bytes());
            blob.extend(columns.to_le_bytes());
            blob.resize(blob.len() + columns as usize + bytes, 0);
            decode(&blob, columns as usize).unwrap_err()
        };
        for (samples, columns) in [(u32::MAX, 1), (32_769, 1024), (1 << 25, 2), (300_000, 1)] {
            let error = claims(samples, columns, 1024);
            assert!(error.contains("cannot contain"), "{error}");
        }
        let blob = encode(&StoredTrace { columns: vec![vec![1.0; 4]; 2] });
        assert_eq!(decode(&blob, 3).unwrap_err(), "it has 2 columns, the header has 3 signals");
    }
}
