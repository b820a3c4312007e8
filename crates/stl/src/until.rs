//! `until`, `release` and `since` over sliding windows, in time linear in the length of the signals
//! for every window.
//!
//! # Algorithm
//! With `max` as outer and `min` as inner extremum (for `release` the other way round), the value
//! at t is
//!
//! ```text
//! U[a,b](t) = max over t' in [t+a, t+b] of min(q(t'), min p over [t, t'))
//! ```
//!
//! **Lower bound.** Every t' is at least t + a, so `min p over [t, t')` is the minimum of
//! `min p over [t, t+a)` and `min p over [t+a, t')`. The first does not depend on t', so
//! `U[a,b](t) = min(min p over [t, t+a), U[0,b-a](t+a))`, and the first operand is a sliding-window
//! minimum.
//!
//! **Upper bound.** Let `f_i(v) = max(q(i), min(p(i), v))`. Since min distributes over max,
//! `f_s(f_{s+1}(… f_{s+w}(-∞)))` is the maximum over t' in [s, s+w] of
//! `min(q(t'), min p over [s, t'))`, which is `U[0,w](s)`. So `U[0,w]` is a composition of
//! functions over a sliding window. Functions of this form are closed under composition: with
//! `f(v) = max(q, min(p, v))` and `g(v) = max(q', min(p', v))`,
//!
//! ```text
//! f(g(v)) = max(q, min(p, q'), min(p, p', v)) = max(max(q, min(p, q')), min(min(p, p'), v))
//! ```
//!
//! so a pair (p, q) represents each function. Composition is associative, so the block scans of
//! `extremum` apply: the signals are split into blocks of w + 1 samples, and a window is a suffix
//! of one block followed by a prefix of the next. One backward scan computes the pairs of all
//! suffixes, one forward scan those of all prefixes, and
//! `U[0,w](s) = max(q_suffix, min(p_suffix, q_prefix))`. Windows are truncated at the end of the
//! trace by leaving out the functions of later samples.
//!
//! `since` is `until` with time reversed.

use crate::clock::Window;
use crate::extremum::{self, Extremum};

/// Returns the number of scratch values that the functions of this module need for this window and
/// signals of `n` samples, at most `n / 2 + 1` or a constant.
pub(crate) fn scratch_len(window: Window, n: usize) -> usize {
    let length = window.length();
    let reached = length.min(n.saturating_sub(length));
    reached.max(before(window).map_or(0, |held| extremum::ahead_scratch_len(held, n)))
}

/// Computes `until` (E is the maximum) or `release` (E is the minimum) into `q`. Windows are
/// truncated at the end of the signals. The values of `p` are lost.
pub(crate) fn until<E: Extremum>(p: &mut [f64], q: &mut [f64], window: Window, scratch: &mut [f64]) {
    let begin = window.begin.min(p.len());
    let available = p.len() - begin;
    from_now::<E>(&p[begin..], &mut q[begin..], window.length(), scratch);
    if let Some(held) = before(window) {
        q.copy_within(begin.., 0);
        q[available..].fill(E::NEUTRAL);
        extremum::ahead::<E::Dual>(p, held, scratch);
        for (q, p) in q[..available].iter_mut().zip(p) {
            *q = E::Dual::pick(*q, *p);
        }
    }
}

/// Returns the window of the samples before the begin of `window`.
fn before(window: Window) -> Option<Window> {
    (window.begin > 0).then(|| Window { begin: 0, end: window.begin - 1 })
}

/// Computes `since` into `q` as [`until`] on reversed signals. Windows are truncated at the
/// beginning of the signals. The values of `p` are lost.
pub(crate) fn since<E: Extremum>(p: &mut [f64], q: &mut [f64], window: Window, scratch: &mut [f64]) {
    p.reverse();
    q.reverse();
    until::<E>(p, q, window, scratch);
    q.reverse();
}

/// Computes `U[0, length - 1]` into `q` by compositions over blocks of `length` samples; see the
/// module documentation.
fn from_now<E: Extremum>(p: &[f64], q: &mut [f64], length: usize, scratch: &mut [f64]) {
    let n = p.len();
    for begin in (0..n).step_by(length) {
        let next = n.min(begin.saturating_add(length));
        // The window of sample `begin` stays in its block. The window of the k-th sample after it
        // contains the first k samples of the next block, or all of them.
        let reached = &mut scratch[..(n - next).min(length - 1)];
        prefixes::<E>(&p[next..], &q[next..], reached);
        suffixes::<E>(&p[begin..next], &mut q[begin..next], reached);
    }
}

/// Computes the `q` of the pairs of the first prefixes of a block.
fn prefixes<E: Extremum>(p: &[f64], q: &[f64], reached: &mut [f64]) {
    let mut best = E::NEUTRAL;
    let mut hold = E::Dual::NEUTRAL;
    for ((reached, p), q) in reached.iter_mut().zip(p).zip(q) {
        best = E::pick(best, E::Dual::pick(hold, *q));
        hold = E::Dual::pick(hold, *p);
        *reached = best;
    }
}

/// Computes the pairs of all suffixes of a block, and composes them with the prefixes of the next
/// block.
fn suffixes<E: Extremum>(p: &[f64], q: &mut [f64], reached: &[f64]) {
    let mut best = E::NEUTRAL;
    let mut hold = E::Dual::NEUTRAL;
    for (i, (p, q)) in p.iter().zip(q).enumerate().rev() {
        best = E::pick(*q, E::Dual::pick(*p, best));
        hold = E::Dual::pick(*p, hold);
        *q = match i.min(reached.len()) {
            0 => best,
            k => E::pick(best, E::Dual::pick(hold, reached[k - 1])),
        };
    }
}
