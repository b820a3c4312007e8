//! Minimum and maximum over sliding windows, in time linear in the number of knots.
//!
//! The window `[t + begin, t + end]` contains the points `t + begin` and `t + end`, and the knots
//! between them. On a line the extremum is at an end. So the result at t is the extremum of three
//! numbers: the function at `t + begin`, the function at `t + end`, and the extremum of the values
//! and limits of the knots inside, which a monotone deque yields (Lemire's algorithm). The first
//! two are the function, shifted; the last one is constant between the times at which a knot enters
//! or leaves. The pointwise extremum of these three functions adds at most two crossings between
//! two such times.
//!
//! # Reference
//! Lemire, "Streaming maximum-minimum filter using no more than three comparisons per element",
//! Nordic Journal of Computing 13, 2006. Donzé, Ferrère and Maler, "Efficient robust monitoring for
//! STL", CAV 2013.

use super::pick::pick;
use super::piecewise::{Builder, Knot, Piecewise};
use super::time::Ticks;
use crate::extremum::Extremum;
use std::collections::VecDeque;

/// Returns the extremum over `[t + begin, t + end]` for every t in `[start, stop]`. A window is cut
/// at the ends of the domain of `x`; the extremum over an empty window is neutral. The bounds may
/// be negative.
pub(crate) fn window<E: Extremum>(
    x: &Piecewise,
    [begin, end]: [Ticks; 2],
    [start, stop]: [Ticks; 2],
) -> Piecewise {
    let last = x.knots.len().saturating_sub(1);
    if begin == end {
        return shifted::<E>(x, begin, [start, stop], |_, knot| knot.at);
    }
    // A window that begins at a knot contains the limit from the right, unless the domain ends
    // there.
    let at_begin = shifted::<E>(x, begin, [start, stop], |index, knot| {
        if index < last { E::pick(knot.at, knot.after) } else { knot.at }
    });
    let at_end =
        shifted::<E>(
            x,
            end,
            [start, stop],
            |index, knot| {
                if index > 0 { E::pick(knot.at, knot.before) } else { knot.at }
            },
        );
    let inside = inside::<E>(x, [begin, end]).clip(start, stop, E::NEUTRAL);
    pick::<E>(&pick::<E>(&at_begin, &at_end), &inside)
}

/// Returns the function at `t + offset` for t in a domain, with these values at knots.
fn shifted<E: Extremum>(
    x: &Piecewise,
    offset: Ticks,
    [start, stop]: [Ticks; 2],
    at: impl Fn(usize, &Knot) -> f64,
) -> Piecewise {
    let shift =
        |(index, knot): (usize, &Knot)| Knot { time: knot.time - offset, at: at(index, knot), ..*knot };
    let knots = x.knots.iter().enumerate().map(shift).collect();
    Piecewise { knots }.clip(start, stop, E::NEUTRAL)
}

/// Returns the extremum over the knots strictly inside the window, with their limits.
fn inside<E: Extremum>(x: &Piecewise, [begin, end]: [Ticks; 2]) -> Piecewise {
    let knots = &x.knots;
    let mut out = Builder::default();
    // Knots of the window with their extrema, each of which is more extreme than all later ones.
    let mut window: VecDeque<(usize, f64)> = VecDeque::new();
    let mut entering = 0;
    let mut leaving = 0;
    while leaving < knots.len() {
        let leave = knots[leaving].time - begin;
        let time = knots.get(entering).map_or(leave, |knot| leave.min(knot.time - end));
        let best = |window: &VecDeque<(usize, f64)>| window.front().map_or(E::NEUTRAL, |front| front.1);
        let before = best(&window);
        while leaving < knots.len() && knots[leaving].time - begin == time {
            if window.front().is_some_and(|front| front.0 == leaving) {
                window.pop_front();
            }
            leaving += 1;
        }
        let at = best(&window);
        while entering < knots.len() && knots[entering].time - end == time {
            let Knot { before, at, after, .. } = knots[entering];
            let value = E::pick(at, E::pick(before, after));
            while window.back().is_some_and(|back| E::pick(back.1, value).to_bits() == value.to_bits()) {
                window.pop_back();
            }
            window.push_back((entering, value));
            entering += 1;
        }
        out.push(Knot { time, before, at, after: best(&window) });
    }
    out.finish()
}
