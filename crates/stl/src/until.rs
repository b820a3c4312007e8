//! `until`, `release` and `since` over windows that slide along two signals, in time linear in their length whatever
//! the window.
//!
//! # How
//! With an outer extremum `max` and an inner one `min` (for `release` the other way round), wanted is
//!
//! ```text
//! U[a,b](t) = max over t' in [t+a, t+b] of min(q(t'), min p over [t, t'))
//! ```
//!
//! **The begin.** Every t' is at least t + a, so `min p over [t, t')` is the lesser of `min p over [t, t+a)` and
//! `min p over [t+a, t')`; the first does not depend on t' and can be taken out:
//! `U[a,b](t) = min(min p over [t, t+a), U[0,b-a](t+a))`, where the first is a sliding minimum.
//!
//! **The end.** Let `f_i(v) = max(q(i), min(p(i), v))`. Since min distributes over max,
//! `f_s(f_{s+1}(… f_{s+w}(-∞)))` is the maximum over t' in [s, s+w] of `min(q(t'), min p over [s, t'))`, which is
//! `U[0,w](s)`. So `U[0,w]` is a composition of functions over a sliding window. Functions of this form are closed under
//! composition: with `f(v) = max(q, min(p, v))` and `g(v) = max(q', min(p', v))`,
//!
//! ```text
//! f(g(v)) = max(q, min(p, q'), min(p, p', v)) = max(max(q, min(p, q')), min(min(p, p'), v))
//! ```
//!
//! so a pair (p, q) stands for each. Composition is associative, so blocks work as they do for a sliding extremum: cut
//! the signals into blocks of w + 1 samples; a window is a suffix of one block followed by a prefix of the next, one
//! backward scan gives the pairs of all suffixes, one forward scan those of all prefixes, and
//! `U[0,w](s) = max(q_suffix, min(p_suffix, q_prefix))`. At the end of the trace windows are cut, which is what leaving
//! out the functions past it means.
//!
//! `since` is `until` with time reversed.

use crate::clock::Window;
use crate::extremum::{self, Extremum};

/// The scratch, in values, that the functions of this module need for signals of `n` samples.
pub(crate) fn scratch_len(n: usize) -> usize {
    3 * n + extremum::scratch_len(n)
}

/// `until` (E the maximum) or `release` (E the minimum), windows cut at the end of the signals.
pub(crate) fn until<E: Extremum>(p: &[f64], q: &[f64], window: Window, out: &mut [f64], scratch: &mut [f64]) {
    let n = p.len();
    let begin = window.begin.min(n);
    let left = n - begin;
    let (reach, beyond) = out.split_at_mut(left);
    beyond.fill(E::NEUTRAL);
    let length = (window.end - window.begin).saturating_add(1);
    from_now::<E>(&p[begin..], &q[begin..], length, reach, scratch);
    if begin > 0 && left > 0 {
        let (held, scratch) = scratch.split_at_mut(n);
        extremum::ahead::<E::Dual>(p, Window { begin: 0, end: begin - 1 }, held, scratch);
        for (out, held) in reach.iter_mut().zip(held) {
            *out = E::Dual::pick(*out, *held);
        }
    }
}

/// `since`, windows cut at the begin of the signals. Reverses both and takes [`until`].
pub(crate) fn since<E: Extremum>(p: &[f64], q: &[f64], window: Window, out: &mut [f64], scratch: &mut [f64]) {
    let (p_reversed, scratch) = scratch.split_at_mut(p.len());
    let (q_reversed, scratch) = scratch.split_at_mut(q.len());
    p_reversed.iter_mut().zip(p.iter().rev()).for_each(|(to, from)| *to = *from);
    q_reversed.iter_mut().zip(q.iter().rev()).for_each(|(to, from)| *to = *from);
    until::<E>(p_reversed, q_reversed, window, out, scratch);
    out.reverse();
}

/// `U[0, length - 1]` by compositions over blocks of `length` samples; see the top of this file.
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
            // The windows that reach into this block begin in the one before, at most `length - 1` samples back.
            prefixes::<E>(p, q, &mut reached[begin..end]);
        }
        end = begin;
    }
    for begin in (0..n).step_by(length) {
        let next = begin.saturating_add(length);
        if next >= n {
            break;
        }
        // Sample `begin` sees its own block only; the k-th after it sees k samples of the next one, or all there are.
        let seen = &reached[next..n.min(next + length - 1)];
        let (out, held) = (&mut out[begin + 1..next], &held[begin + 1..next]);
        let all = reached[n - 1];
        let (whole, cut) = out.split_at_mut(seen.len());
        let (held_whole, held_cut) = held.split_at(seen.len());
        for ((out, held), seen) in whole.iter_mut().zip(held_whole).zip(seen) {
            *out = E::pick(*out, E::Dual::pick(*held, *seen));
        }
        for (out, held) in cut.iter_mut().zip(held_cut) {
            *out = E::pick(*out, E::Dual::pick(*held, all));
        }
    }
}

/// Pairs of all suffixes of a block: `q` into `out`, `p` into `held`.
fn suffixes<E: Extremum>(p: &[f64], q: &[f64], out: &mut [f64], held: &mut [f64]) {
    let (mut best, mut hold) = (E::NEUTRAL, E::Dual::NEUTRAL);
    for i in (0..p.len()).rev() {
        best = E::pick(q[i], E::Dual::pick(p[i], best));
        hold = E::Dual::pick(p[i], hold);
        (out[i], held[i]) = (best, hold);
    }
}

/// The `q` of the pairs of all prefixes of a block.
fn prefixes<E: Extremum>(p: &[f64], q: &[f64], reached: &mut [f64]) {
    let (mut best, mut hold) = (E::NEUTRAL, E::Dual::NEUTRAL);
    for i in 0..p.len() {
        best = E::pick(best, E::Dual::pick(hold, q[i]));
        hold = E::Dual::pick(hold, p[i]);
        reached[i] = best;
    }
}
