//! `until` in dense time, in time linear in the number of knots.
//!
//! ```text
//! U[a,b](t) = sup over t' in [t+a, t+b] of min(q(t'), inf p over [t, t'])
//! ```
//!
//! As in RTAMT's dense-time monitor the left operand is needed at t' itself. Since `[t, t']` is
//! `[t, t+a]` and `[t+a, t']`, `U[a,b](t) = min(inf p over [t, t+a], U[0,b-a](t+a))`. And `U[0,w] =
//! min(U, sup q over [t, t+w])`, where U is `until` without a bound: if p holds up to some t' with
//! q, and q holds at some t'' within w, then p holds up to the earlier one of them. `since` is
//! `until` with time reversed.
//!
//! # Reference
//! Donzé, Ferrère and Maler, "Efficient robust monitoring for STL", CAV 2013.

use super::pick::{aligned, pick};
use super::piecewise::{Knot, Piecewise};
use super::time::{Ticks, UNBOUNDED};
use super::window::window;
use crate::extremum::{Extremum, Maximum, Minimum};

/// Returns `p until[begin:end] q` for t in a domain. Windows are cut at the end of the operands.
pub(crate) fn until(p: &Piecewise, q: &Piecewise, [begin, end]: [Ticks; 2], domain: [Ticks; 2]) -> Piecewise {
    let mut from_now = unbounded(p, q);
    if end < UNBOUNDED
        && let Some((start, stop)) = from_now.domain()
    {
        let reached =
            window::<Maximum>(&q.clip(start, stop, f64::NEG_INFINITY), [0, end - begin], [start, stop]);
        from_now = pick::<Minimum>(&from_now, &reached);
    }
    let from_begin = window::<Maximum>(&from_now, [begin, begin], domain);
    match begin {
        0 => from_begin,
        _ => pick::<Minimum>(&window::<Minimum>(p, [0, begin], domain), &from_begin),
    }
}

/// Returns `p until q` on the common domain of both.
///
/// The scan goes from the end to the start. Let V be the result at the next knot, and let p and q
/// be lines up to there, with the limits p₁ and q₁, one of them nowhere below the other.
/// - If p does not fall, the least p on the way is the present one: the result is min(p, max(q, q₁,
///   V)).
/// - If p falls, the least p is that at t': the result is max(h, min(p₁, V)), where h is the
///   greatest min(p, q) on the rest of the cell. It is p if p is below q, else q₁ if q rises, else
///   q.
///
/// Both have the form min(P, max(Q, M)) of lines P, Q and a number M.
fn unbounded(p: &Piecewise, q: &Piecewise) -> Piecewise {
    let knots = aligned(p, q);
    let blank = |knot: &(Knot, Knot)| Knot::continuous(knot.0.time, f64::INFINITY);
    let mut outer: Vec<Knot> = knots.iter().map(blank).collect();
    let mut inner = outer.clone();
    let mut least = outer.clone();
    let mut next = f64::NEG_INFINITY;
    for index in (0..knots.len()).rev() {
        let (p, q) = knots[index];
        let mut after = f64::NEG_INFINITY;
        if let Some((p_next, q_next)) = knots.get(index + 1) {
            let [p0, p1] = [p.after, p_next.before];
            let [q0, q1] = [q.after, q_next.before];
            let (lines, number) = if p0 <= p1 {
                ([[p0, p1], [q0, q1]], Maximum::pick(q1, next))
            } else {
                let highest = match () {
                    () if p0 <= q0 && p1 <= q1 => [p0, p1],
                    () if q0 < q1 => [q1, q1],
                    () => [q0, q1],
                };
                ([[f64::INFINITY; 2], highest], Minimum::pick(p1, next))
            };
            (outer[index].after, outer[index + 1].before) = (lines[0][0], lines[0][1]);
            (inner[index].after, inner[index + 1].before) = (lines[1][0], lines[1][1]);
            (least[index].after, least[index + 1].before) = (number, number);
            after = Minimum::pick(lines[0][0], Maximum::pick(lines[1][0], number));
        }
        // The other two functions are +∞ at the knot.
        next = Minimum::pick(p.at, Maximum::pick(q.at, after));
        outer[index].at = next;
    }
    let [outer, inner, least] = [outer, inner, least].map(|knots| Piecewise { knots });
    pick::<Minimum>(&outer, &pick::<Maximum>(&inner, &least))
}
