//! Input signals of the competition: piecewise constant on pieces of equal duration (instance 2),
//! or piecewise continuous (instance 1).
//!
//! Instance 1 allows any piecewise continuous signal and leaves its parameters to the tool. Here it
//! has the knots of instance 2 and one number more, the ramp: the share of each piece in which the
//! signal changes linearly from the value of the piece before. 0 gives steps, 1 a continuous signal
//! of straight lines.

use mishandle_rollout::{Axis, AxisKind};

/// Name of the space of the constrained inputs, the first of every problem.
pub(crate) const CONSTRAINED: &str = "instance-2";
/// Name of the space that also has the ramp.
pub(crate) const FREE: &str = "instance-1";

/// An input signal as a target declares it.
pub(crate) struct Input {
    pub name: &'static str,
    pub unit: &'static str,
    pub bounds: [f64; 2],
    pub pieces: usize,
    pub meaning: &'static str,
}

impl Input {
    /// Returns one axis per piece, with these nominal values from the first piece on; the last one
    /// also counts for the pieces after it.
    pub fn axes(&self, nominal: &[f64]) -> Vec<Axis> {
        let value = |piece: usize| nominal.get(piece).or(nominal.last()).copied();
        (0..self.pieces)
            .map(|piece| {
                let name = if self.pieces == 1 {
                    self.name.to_string()
                } else {
                    format!("{}_{}", self.name, piece + 1)
                };
                let place = match self.pieces {
                    1 => ", constant".to_string(),
                    pieces => format!(" in piece {} of {pieces}", piece + 1),
                };
                Axis::new(AxisKind::Input, &name, self.unit, self.bounds, value(piece))
                    .meaning(&format!("{}{place}", self.meaning))
                    .acting_from(piece, self.pieces)
            })
            .collect()
    }
}

/// Returns the axis of the ramp.
pub(crate) fn ramp() -> Axis {
    Axis::new(AxisKind::Model, "ramp", "", [0.0, 1.0], Some(0.0)).meaning(
        "share of each piece in which an input changes linearly from the value of the piece before; 0 makes steps",
    )
}

/// The spaces of a problem whose last axis is the ramp.
pub(crate) fn spaces(axes: Vec<Axis>) -> Vec<(&'static str, Vec<Axis>)> {
    let constrained = axes[..axes.len() - 1].to_vec();
    vec![(CONSTRAINED, constrained), (FREE, axes)]
}

/// An input signal of one episode, at steps of the integrator. Borrows its knots, so that it
/// allocates nothing.
pub(crate) struct Signal<'a> {
    knots: &'a [Option<f64>],
    /// Steps of a piece, and of a ramp. Ramps have whole steps, so that no step contains a bend.
    piece: usize,
    ramp: usize,
}

impl<'a> Signal<'a> {
    /// Makes a signal for an episode of `steps` steps.
    pub fn new(knots: &'a [Option<f64>], steps: usize, ramp: Option<f64>) -> Signal<'a> {
        let piece = steps / knots.len().max(1);
        Signal { knots, piece, ramp: (ramp.unwrap_or_default() * piece as f64).round() as usize }
    }

    /// Returns the value at the share `part` in \[0, 1\] of step `step`. At its end a step still
    /// has the input of its own piece.
    pub fn at(&self, step: usize, part: f64) -> f64 {
        let index = (step / self.piece.max(1)).min(self.knots.len().saturating_sub(1));
        let knot = |index: usize| self.knots.get(index).copied().flatten().unwrap_or_default();
        let since = step - index * self.piece;
        if since >= self.ramp {
            return knot(index);
        }
        let share = (since as f64 + part) / self.ramp as f64;
        (1.0 - share) * knot(index.saturating_sub(1)) + share * knot(index)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KNOTS: [Option<f64>; 3] = [Some(1.0), Some(3.0), Some(2.0)];

    #[test]
    fn a_signal_without_ramp_is_constant_on_each_piece() {
        let signal = Signal::new(&KNOTS, 12, Some(0.0));
        let found =
            [(0, 0.0), (3, 1.0), (4, 0.0), (7, 1.0), (8, 0.0), (11, 1.0)].map(|(k, p)| signal.at(k, p));
        assert_eq!(found, [1.0, 1.0, 3.0, 3.0, 2.0, 2.0]);
    }

    #[test]
    fn a_full_ramp_joins_the_knots_and_half_a_ramp_holds_them() {
        let signal = Signal::new(&KNOTS, 12, Some(1.0));
        let found =
            [(3, 1.0), (4, 0.0), (5, 1.0), (7, 1.0), (8, 0.0), (11, 1.0)].map(|(k, p)| signal.at(k, p));
        assert_eq!(found, [1.0, 1.0, 2.0, 3.0, 3.0, 2.0]);
        let half = Signal::new(&KNOTS, 12, Some(0.5));
        assert_eq!([half.at(5, 0.0), half.at(6, 0.0), half.at(7, 1.0)], [2.0, 3.0, 3.0]);
    }

    #[test]
    fn names_say_the_piece_unless_the_input_is_constant() {
        let input = |pieces| Input { name: "u", unit: "m", bounds: [0.0, 1.0], pieces, meaning: "input" };
        let names =
            |pieces| input(pieces).axes(&[0.5]).iter().map(|axis| axis.name.clone()).collect::<Vec<_>>();
        assert_eq!((names(1), names(2)), (vec!["u".into()], vec!["u_1".into(), "u_2".into()]));
        assert!(input(3).axes(&[0.0, 1.0]).iter().map(|axis| axis.nominal).eq([
            Some(0.0),
            Some(1.0),
            Some(1.0)
        ]));
    }
}
