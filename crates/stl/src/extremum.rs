//! Sliding-window minimum and maximum, in time linear in the length of the signal for every window
//! length.
//!
//! Results replace the signal, so that long traces take little memory.
//!
//! # Reference
//! Van Herk, "A fast algorithm for local minimum and maximum filters on rectangular and octagonal
//! kernels", Pattern Recognition Letters 13, 1992: the block scans for long windows.

use crate::clock::Window;

/// Minimum or maximum: a binary operation with its neutral element.
pub(crate) trait Extremum {
    /// The extremum of an empty set.
    const NEUTRAL: f64;
    /// Maximum for minimum and vice versa.
    type Dual: Extremum;
    /// Returns the extremum of two values, neither of which may be NaN. −0.0 is less than +0.0,
    /// because the sign of a zero is a verdict.
    fn pick(a: f64, b: f64) -> f64;
}

/// The minimum.
pub(crate) struct Minimum;

/// The maximum.
pub(crate) struct Maximum;

impl Extremum for Minimum {
    const NEUTRAL: f64 = f64::INFINITY;
    type Dual = Maximum;
    #[inline(always)]
    fn pick(a: f64, b: f64) -> f64 {
        // Both picks differ for two zeros only. The least zero is the one with the sign bit.
        let first = if a < b { a } else { b };
        let last = if b < a { b } else { a };
        f64::from_bits(first.to_bits() | last.to_bits())
    }
}

impl Extremum for Maximum {
    const NEUTRAL: f64 = f64::NEG_INFINITY;
    type Dual = Minimum;
    #[inline(always)]
    fn pick(a: f64, b: f64) -> f64 {
        let first = if a > b { a } else { b };
        let last = if b > a { b } else { a };
        f64::from_bits(first.to_bits() & last.to_bits())
    }
}

/// Windows up to this length are computed by doubling, longer ones by block scans. Measured: for
/// windows of 5 samples block scans take 2.7 times as long, for windows of 31 samples the same
/// time.
const SHORT: usize = 16;

/// Outputs per tile of the doubling, so that its passes stay in the L1 cache.
const TILE: usize = 1024;

/// Returns the number of scratch values that [`ahead`] needs for this window and signals of `n`
/// samples, at most `n / 2 + 1` or a constant.
pub(crate) fn ahead_scratch_len(window: Window, n: usize) -> usize {
    match window.length() {
        length if length <= SHORT => 2 * (TILE + SHORT),
        // A window that is at least as long as the signal needs none.
        length => length.min((n + 1).saturating_sub(length)),
    }
}

/// Returns the number of scratch values that [`behind`] needs for this window and signals of `n`
/// samples, at most `n + 1` or a constant.
pub(crate) fn behind_scratch_len(window: Window, n: usize) -> usize {
    let cut = if window.length() < n { window.length() - 1 } else { 0 };
    cut + ahead_scratch_len(window, n)
}

/// Replaces `x[t]` by the extremum over `[t + begin, t + end]`, truncated at the end of the signal.
pub(crate) fn ahead<E: Extremum>(x: &mut [f64], window: Window, scratch: &mut [f64]) {
    let begin = window.begin.min(x.len());
    let available = x.len() - begin;
    if begin > 0 {
        x.copy_within(begin.., 0);
    }
    let (x, beyond) = x.split_at_mut(available);
    beyond.fill(E::NEUTRAL);
    let length = window.length();
    if length >= available {
        return scan_back::<E>(x);
    }
    slide::<E>(x, length, scratch);
    scan_back::<E>(&mut x[available + 1 - length..]);
}

/// Replaces `x[t]` by the extremum over `[t - end, t - begin]`, truncated at the beginning of the
/// signal.
pub(crate) fn behind<E: Extremum>(x: &mut [f64], window: Window, scratch: &mut [f64]) {
    let begin = window.begin.min(x.len());
    let available = x.len() - begin;
    let length = window.length();
    if length >= available {
        scan_forward::<E>(&mut x[..available]);
    } else {
        let (cut, scratch) = scratch.split_at_mut(length - 1);
        cut.copy_from_slice(&x[..length - 1]);
        scan_forward::<E>(cut);
        slide::<E>(&mut x[..available], length, scratch);
        x.copy_within(..available + 1 - length, length - 1);
        x[..length - 1].copy_from_slice(cut);
    }
    if begin > 0 {
        x.copy_within(..available, begin);
        x[..begin].fill(E::NEUTRAL);
    }
}

/// Replaces `x[i]` by the extremum of `x[i..i + length]` where that window is inside the signal.
/// The last `length - 1` values stay as they are.
fn slide<E: Extremum>(x: &mut [f64], length: usize, scratch: &mut [f64]) {
    let windows = x.len() + 1 - length;
    if length > SHORT {
        scan_blocks::<E>(x, length, scratch);
    } else if length > 1 {
        for begin in (0..windows).step_by(TILE) {
            let end = windows.min(begin + TILE);
            double::<E>(&mut x[begin..end + length - 1], length, scratch);
        }
    }
}

/// [`slide`] for short windows: computes windows of 2, 4, 8, … samples from pairs of half the
/// length, then merges two overlapping windows to the requested length. Each pass is vectorized;
/// there are at most log2([`SHORT`]) passes.
fn double<E: Extremum>(x: &mut [f64], length: usize, scratch: &mut [f64]) {
    let (mut from, mut to) = scratch.split_at_mut(TILE + SHORT);
    let mut span = 1;
    let mut count = x.len();
    while 2 * span <= length {
        count -= span;
        if span == 1 {
            merge::<E>(&x[..count], &x[1..], &mut to[..count]);
        } else {
            merge::<E>(&from[..count], &from[span..], &mut to[..count]);
        }
        (from, to) = (to, from);
        span *= 2;
    }
    let windows = x.len() + 1 - length;
    merge::<E>(from, &from[length - span..], &mut x[..windows]);
}

fn merge<E: Extremum>(a: &[f64], b: &[f64], out: &mut [f64]) {
    for ((out, a), b) in out.iter_mut().zip(a).zip(b) {
        *out = E::pick(*a, *b);
    }
}

/// [`slide`] for long windows (van Herk). The signal is split into blocks of the window's length. A
/// window then consists of a suffix of one block and a prefix of the next, so one scan in each
/// direction computes all extrema.
fn scan_blocks<E: Extremum>(x: &mut [f64], length: usize, scratch: &mut [f64]) {
    let windows = x.len() + 1 - length;
    for begin in (0..windows).step_by(length) {
        let (block, next) = x[begin..].split_at_mut(length);
        let (block, rest) = block.split_at_mut(length.min(windows - begin));
        let prefixes = &mut scratch[..block.len() - 1];
        let mut suffix = rest.iter().rev().fold(E::NEUTRAL, |best, x| E::pick(best, *x));
        for x in block.iter_mut().rev() {
            suffix = E::pick(suffix, *x);
            *x = suffix;
        }
        let mut prefix = E::NEUTRAL;
        for (out, x) in prefixes.iter_mut().zip(next) {
            prefix = E::pick(prefix, *x);
            *out = prefix;
        }
        block[1..].iter_mut().zip(prefixes).for_each(|(x, prefix)| *x = E::pick(*x, *prefix));
    }
}

/// Replaces `x[t]` by the extremum of `x[t..]`.
fn scan_back<E: Extremum>(x: &mut [f64]) {
    let mut best = E::NEUTRAL;
    for x in x.iter_mut().rev() {
        best = E::pick(best, *x);
        *x = best;
    }
}

/// Replaces `x[t]` by the extremum of `x[..=t]`.
fn scan_forward<E: Extremum>(x: &mut [f64]) {
    let mut best = E::NEUTRAL;
    for x in x {
        best = E::pick(best, *x);
        *x = best;
    }
}
