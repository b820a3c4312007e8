//! The predicate and the time that determine the robustness at the first time.
//!
//! An extremum in dense time can be a limit, next to a jump. So a chain leads through points: a
//! time, and whether the value there or one of the limits counts.

use super::error::DenseError;
use super::evaluation::Evaluation;
use super::pick::aligned;
use super::piecewise::{Piecewise, Point, Side};
use super::time::{Ticks, seconds};
use crate::formula::Node;
use crate::moment::{Choice, Found, Held, Least, Moments, Values, is_less, offer};
use crate::operator::Operator;
use crate::pointwise::{Undefined, apply_once};

/// The predicate that determines the robustness at the first time.
#[derive(Clone, Debug, PartialEq)]
pub struct DenseDiagnosis {
    /// The robustness of the formula.
    pub robustness: f64,
    /// The predicate; `None` if the value comes from no comparison, as that of an empty window.
    pub predicate: Option<DensePredicate>,
}

/// The predicate of a [`DenseDiagnosis`].
#[derive(Clone, Debug, PartialEq)]
pub struct DensePredicate {
    /// The text.
    pub text: String,
    /// The time at which it has the value, or its limit, s.
    pub time: f64,
    /// Values of the two sides.
    pub values: [f64; 2],
    /// The robustness of the predicate.
    pub robustness: f64,
    /// Whether an odd number of negations encloses the predicate, so that the formula requires it
    /// to be false.
    pub is_negated: bool,
}

impl Evaluation<'_> {
    /// Returns whether the formula has a value at the first time.
    pub(crate) fn is_decided(&self) -> bool {
        self.extents[self.formula.nodes.len() - 1].end >= self.log.first
    }

    fn first(&self) -> Point {
        Point { time: self.log.first, side: Side::At }
    }

    /// Returns the robustness at the first time.
    pub(crate) fn robustness(&self) -> Result<f64, DenseError> {
        let root = self.formula.nodes.len() - 1;
        Ok(Values::new(self, self.formula, &self.starts, root, self.first())?.of(root))
    }

    /// Follows the chain of decisive operands from the formula to a predicate.
    pub(crate) fn diagnosis(&self) -> Result<DenseDiagnosis, DenseError> {
        let mut node = self.formula.nodes.len() - 1;
        let mut is_negated = false;
        let mut point = self.first();
        let mut values = Values::new(self, self.formula, &self.starts, node, point)?;
        let robustness = values.of(node);
        while let Node::Apply(operator, _) = self.formula.nodes[node] {
            let operands = self.formula.operands(node, &self.starts);
            if let Some(left) = self.formula.scaled(node, &self.starts) {
                node = left;
                continue;
            }
            if operator.is_comparison() {
                let text = |f: &mut std::fmt::Formatter<'_>| {
                    self.formula.write_node(f, Operator::name, node, &self.starts)
                };
                let predicate = DensePredicate {
                    text: std::fmt::from_fn(text).to_string(),
                    time: seconds(point.time),
                    values: [values.of(operands[0]), values.of(operands[1])],
                    robustness: values.of(node),
                    is_negated,
                };
                return Ok(DenseDiagnosis { robustness, predicate: Some(predicate) });
            }
            let Some(choice) = values.choice(self.formula, &self.starts, node) else { break };
            node = operands[choice.operand];
            is_negated ^= choice.is_negated;
            if operator.is_temporal() {
                point = choice.time;
                values = Values::new(self, self.formula, &self.starts, node, point)?;
            }
        }
        Ok(DenseDiagnosis { robustness, predicate: None })
    }

    /// Returns the least value (`sign` 1) or the greatest (`sign` -1) of the operand between two
    /// points.
    fn extreme(&self, node: usize, [from, to]: [Point; 2], sign: f64) -> Result<Found<Point>, DenseError> {
        let x = self.function(node - 1)?;
        let mut least = Least::default();
        x.points(from, to).for_each(|(point, next)| least.add(sign * x.value(point, next), point));
        Ok(least.found.map_or((sign * f64::INFINITY, None), |(value, point)| {
            (sign * value, Some(Choice::at(0, point)))
        }))
    }

    /// Returns the greatest minimum of the right operand at a point of the window, and the left one
    /// from `start` up to that point; and the least value of the left operand in all.
    fn held(
        &self,
        node: usize,
        start: Point,
        window: [Point; 2],
        sign: f64,
    ) -> Result<Held<Point>, DenseError> {
        let left = self.formula.operands(node, &self.starts)[0];
        let (p, q): (Vec<_>, Vec<_>) =
            aligned(&self.function(left)?, &self.function(node - 1)?).into_iter().unzip();
        let p = Piecewise { knots: p };
        let q = Piecewise { knots: q };
        let [from, to] = window;
        let mut held = Least::default();
        let mut best = None;
        let mut add = |(point, next): (Point, usize)| {
            held.add(sign * p.value(point, next), point);
            if from <= point && point <= to {
                offer(&mut best, held.found, sign * q.value(point, next), point);
            }
        };
        // The bound of the window that is nearer to the start is a point of its own.
        if start <= from {
            p.points(start, from).chain(p.points(from, to)).for_each(&mut add);
        } else {
            p.points(to, start).rev().chain(p.points(from, to).rev()).for_each(&mut add);
        }
        Ok((held, best))
    }
}

/// Returns the point a duration later.
fn later(point: Point, by: Ticks) -> Point {
    Point { time: point.time.saturating_add(by), ..point }
}

impl Moments for Evaluation<'_> {
    type Time = Point;
    type Error = DenseError;

    fn signal(&self, signal: usize, point: Point) -> Result<f64, DenseError> {
        let function = self.log.signals[signal].around(self.log.end, point.time);
        let found = function.points(point, point).next();
        Ok(found.map_or(f64::NAN, |(point, next)| function.value(point, next)))
    }

    fn pointwise(&self, operator: Operator, x: f64, y: f64, point: Point) -> Result<f64, DenseError> {
        apply_once(operator, x, y).map_err(|Undefined { operation, .. }| DenseError::Undefined {
            operation,
            time: seconds(point.time),
        })
    }

    fn temporal(&self, operator: Operator, node: usize, point: Point) -> Result<Found<Point>, DenseError> {
        let [begin, end] = self.windows[node];
        let ahead = [later(point, begin), later(point, end)];
        let behind = [later(point, -end), later(point, -begin)];
        let none = |sign: f64| (-sign * f64::INFINITY, None);
        Ok(match operator {
            Operator::Always => self.extreme(node, ahead, 1.0)?,
            Operator::Eventually => self.extreme(node, ahead, -1.0)?,
            Operator::Historically => self.extreme(node, behind, 1.0)?,
            Operator::Once => self.extreme(node, behind, -1.0)?,
            Operator::Until | Operator::Release => {
                let sign = if operator == Operator::Until { 1.0 } else { -1.0 };
                let (_, best) = self.held(node, point, ahead, sign)?;
                best.map_or(none(sign), |(value, choice)| (sign * value, Some(choice)))
            }
            Operator::Since => {
                let (_, best) = self.held(node, point, behind, 1.0)?;
                best.map_or(none(1.0), |(value, choice)| (value, Some(choice)))
            }
            _ => {
                let (held, best) = self.held(node, point, ahead, 1.0)?;
                match (held.found, best) {
                    (Some((held, at)), best) if best.is_none_or(|(value, _)| !is_less(held, value)) => {
                        (held, Some(Choice::at(0, at)))
                    }
                    (_, best) => best.map_or((f64::INFINITY, None), |(value, choice)| (value, Some(choice))),
                }
            }
        })
    }
}
