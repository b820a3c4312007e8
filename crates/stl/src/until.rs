//! `until`, `release` and `since` over sliding windows, in time linear in the length of the signals for every window.
//!
//! # Algorithm
//! With `max` as outer and `min` as inner extremum (for `release` the other way round), the value at t is
//!
//! ```text
//! U[a,b](t) = max over t' in [t+a, t+b] of min(q(t'), min p over [t, t'))
//! ```
//!
//! **Lower bound.** Every t' is at least t + a, so `min p over [t, t')` is the minimum of `min p over [t, t+a)` and
//! `min p over [t+a, t')`. The first does not depend on t', so
//! `U[a,b](t) = min(min p over [t, t+a), U[0,b-a](t+a))`, and the first operand is a sliding-window minimum.
//!
//! **Upper bound.** Let `f_i(v) = max(q(i), min(p(i), v))`. Since min distributes over max,
//! `f_s(f_{s+1}(… f_{s+w}(-∞)))` is the maximum over t' in [s, s+w] of `min(q(t'), min p over [s, t'))`, which is
//! `U[0,w](s)`. So `U[0,w]` is a composition of functions over a sliding window. Functions of this form are closed
//! under composition: with `f(v) = max(q, min(p, v))` and `g(v) = max(q', min(p', v))`,
//!
//! ```text
//! f(g(v)) = max(q, min(p, q'), min(p, p', v)) = max(max(q, min(p, q')), min(min(p, p'), v))
//! ```
//!
//! so a pair (p, q) represents each function. Composition is associative, so the block scans of `extremum` apply: the
//! signals are split into blocks of w + 1 samples, and a window is a suffix of one block followed by a prefix of the
//! next. One backward scan computes the pairs of all suffixes, one forward scan those of all prefixes, and
//! `U[0,w](s) = max(q_suffix, min(p_suffix, q_prefix))`. Windows are truncated at the end of the trace by leaving out
//! the functions of later samples.
//!
//! `since` is `until` with time reversed.

use crate::clock::Window;
use crate::extremum::{self, Extremum};

/// Returns the number of scratch values that the functions of this module need for signals of `n` samples.
pub(crate) fn scratch_len(n: usize) -> usize {
    3 * n + extremum::longest_scratch_len(n)
}

/// Computes `until` (E is the maximum) or `release` (E is the minimum). Windows are truncated at the end of the
/// signals.
pub(crate) fn until<E: Extremum>(p: &[f64], q: &[f64], window: Window, out: &mut [f64], scratch: &mut [f64]) {
    let n = p.len();
    let begin = window.begin.min(n);
    let available = n - begin;
    let (reach, beyond) = out.split_at_mut(available);
    beyond.fill(E::NEUTRAL);
    let length = (window.end - window.begin).saturating_add(1);
    from_now::<E>(&p[begin..], &q[begin..], length, reach, scratch);
    if begin > 0 && available > 0 {
        let (held, scratch) = scratch.split_at_mut(n);
        extremum::ahead::<E::Dual>(p, Window { begin: 0, end: begin - 1 }, held, scratch);
        for (out, held) in reach.iter_mut().zip(held) {
            *out = E::Dual::pick(*out, *held);
        }
    }
}

/// Computes `since` as [`until`] on reversed signals. Windows are truncated at the beginning of the signals.
pub(crate) fn since<E: Extremum>(p: &[f64], q: &[f64], window: Window, out: &mut [f64], scratch: &mut [f64]) {
    let (p_reversed, scratch) = scratch.split_at_mut(p.len());
    let (q_reversed, scratch) = scratch.split_at_mut(q.len());
    p_reversed.iter_mut().zip(p.iter().rev()).for_each(|(to, from)| *to = *from);
    q_reversed.iter_mut().zip(q.iter().rev()).for_each(|(to, from)| *to = *from);
    until::<E>(p_reversed, q_reversed, window, out, scratch);
    out.reverse();
}

/// Computes `U[0, length - 1]` by compositions over blocks of `length` samples; see the module documentation.
fn from_now<E: Extremum>(p: &[f64], q: &[f64], length: usize, out: &mut [f64], scratch: &mut [f64]) {
    let n = p.len();
    let (held, scratch) = scratch.split_at_mut(n);
    let reached = &mut scratch[..n];
    let mut end = n;
    while end > 0 {
        let begin = (end - 1) / length * length;
        let (p, q) = (&p[begin..end], &q[begin..end]);
        suffixes::<E>(p, q, &mut out[begin..end], &mut held[begin..end]);
        if begin > 0 {
            // The windows that extend into this block start in the previous one, at most `length - 1` samples back.
            prefixes::<E>(p, q, &mut reached[begin..end]);
        }
        end = begin;
    }
    for begin in (0..n).step_by(length) {
        let next = begin.saturating_add(length);
        if next >= n {
            break;
        }
        // The window of sample `begin` stays in its block. The window of the k-th sample after it contains the first k
        // samples of the next block, or all of them.
        let next_block = &reached[next..n.min(next + length - 1)];
        let (out, held) = (&mut out[begin + 1..next], &held[begin + 1..next]);
        let all = reached[n - 1];
        let (whole, cut) = out.split_at_mut(next_block.len());
        let (held_whole, held_cut) = held.split_at(next_block.len());
        for ((out, held), prefix) in whole.iter_mut().zip(held_whole).zip(next_block) {
            *out = E::pick(*out, E::Dual::pick(*held, *prefix));
        }
        for (out, held) in cut.iter_mut().zip(held_cut) {
            *out = E::pick(*out, E::Dual::pick(*held, all));
        }
    }
}

/// Computes the pairs of all suffixes of a block: `q` into `out`, `p` into `held`.
fn suffixes<E: Extremum>(p: &[f64], q: &[f64], out: &mut [f64], held: &mut [f64]) {
    let (mut best, mut hold) = (E::NEUTRAL, E::Dual::NEUTRAL);
    for i in (0..p.len()).rev() {
        best = E::pick(q[i], E::Dual::pick(p[i], best));
        hold = E::Dual::pick(p[i], hold);
        (out[i], held[i]) = (best, hold);
    }
}

/// Computes the `q` of the pairs of all prefixes of a block.
fn prefixes<E: Extremum>(p: &[f64], q: &[f64], reached: &mut [f64]) {
    let (mut best, mut hold) = (E::NEUTRAL, E::Dual::NEUTRAL);
    for i in 0..p.len() {
        best = E::pick(best, E::Dual::pick(hold, q[i]));
        hold = E::Dual::pick(hold, p[i]);
        reached[i] = best;
    }
}
