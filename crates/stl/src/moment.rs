//! The values of a formula at one time, down to the operators over time, and what determines them:
//! in discrete time and in dense time.

use crate::formula::{Formula, Node};
use crate::operator::Operator;
use std::cmp::Ordering;
use std::collections::HashMap;

/// The operand and its time that determine the value of an operator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Choice<Time> {
    /// 0 is the left operand, or the only one.
    pub operand: usize,
    pub time: Time,
    /// Whether the value is the operand's with the opposite sign.
    pub is_negated: bool,
}

impl<Time> Choice<Time> {
    pub(crate) fn at(operand: usize, time: Time) -> Choice<Time> {
        Choice { operand, time, is_negated: false }
    }

    pub(crate) fn negated(operand: usize, time: Time) -> Choice<Time> {
        Choice { operand, time, is_negated: true }
    }
}

/// The value of an operator over time, and what determines it; nothing does if the window is empty.
pub(crate) type Found<Time> = (f64, Option<Choice<Time>>);

/// The least value of a left operand, and the greatest minimum of a right operand and the left one
/// before it.
pub(crate) type Held<Time> = (Least<Time>, Option<(f64, Choice<Time>)>);

/// The signals of a formula, and its operators over time.
pub(crate) trait Moments {
    type Time: Copy + Ord;
    type Error;

    /// Returns the value of a signal of the formula.
    fn signal(&self, signal: usize, time: Self::Time) -> Result<f64, Self::Error>;

    /// Returns the value of a pointwise operator; `x` equals `y` for a unary one.
    fn pointwise(&self, operator: Operator, x: f64, y: f64, time: Self::Time) -> Result<f64, Self::Error>;

    /// Returns the value of an operator over time, and what determines it.
    fn temporal(
        &self,
        operator: Operator,
        node: usize,
        time: Self::Time,
    ) -> Result<Found<Self::Time>, Self::Error>;
}

/// The values of the sub-formulas of a node at a time, down to the operators over time.
pub(crate) struct Values<Time> {
    time: Time,
    /// The first node.
    first: usize,
    values: Vec<f64>,
    /// The choice of each of these operators over time.
    choices: HashMap<usize, Option<Choice<Time>>>,
}

impl<Time: Copy + Ord> Values<Time> {
    pub(crate) fn new<M: Moments<Time = Time>>(
        moments: &M,
        formula: &Formula,
        starts: &[usize],
        node: usize,
        time: Time,
    ) -> Result<Values<Time>, M::Error> {
        let nodes = &formula.nodes;
        // The topmost operators over time, by the first node below them.
        let mut temporal = HashMap::new();
        let mut open = vec![node];
        while let Some(node) = open.pop() {
            match nodes[node] {
                Node::Apply(operator, _) if operator.is_temporal() => {
                    temporal.insert(starts[node], node);
                }
                _ => open.extend(formula.operands(node, starts)),
            }
        }
        let first = starts[node];
        let values = vec![f64::NAN; node - first + 1];
        let mut found = Values { time, first, values, choices: HashMap::new() };
        let is_bare = formula.bare_numbers();
        let mut next = first;
        while next <= node {
            let skipped = temporal.get(&next).copied();
            let node = skipped.unwrap_or(next);
            found.values[node - first] = match nodes[node] {
                Node::Constant(value) => value,
                Node::Signal(signal) => moments.signal(signal as usize, time)?,
                Node::Apply(operator, _) if skipped.is_some() => {
                    let (value, choice) = moments.temporal(operator, node, time)?;
                    found.choices.insert(node, choice);
                    value
                }
                Node::Apply(operator, _) => {
                    let left = formula.operands(node, starts)[0];
                    moments.pointwise(operator, found.of(left), found.of(node - 1), time)?
                }
            };
            if is_bare[node] {
                // −0.0 + 0.0 is 0.0; other numbers stay.
                found.values[node - first] += 0.0;
            }
            next = node + 1;
        }
        Ok(found)
    }

    pub(crate) fn of(&self, node: usize) -> f64 {
        self.values[node - self.first]
    }

    /// Returns what determines the value of an operator that is not arithmetic.
    pub(crate) fn choice(&self, formula: &Formula, starts: &[usize], node: usize) -> Option<Choice<Time>> {
        let Node::Apply(operator, _) = formula.nodes[node] else { return None };
        if operator.is_temporal() {
            return self.choices.get(&node).copied().flatten();
        }
        let x = self.of(formula.operands(node, starts)[0]);
        let y = self.of(node - 1);
        let time = self.time;
        Some(match operator {
            Operator::Not => Choice::negated(0, time),
            Operator::And => Choice::at(usize::from(is_less(y, x)), time),
            Operator::Or => Choice::at(usize::from(is_less(x, y)), time),
            Operator::Implies if !is_less(-x, y) => Choice::negated(0, time),
            Operator::Implies => Choice::at(1, time),
            // The distance is that of the operand that is nearer to its border.
            Operator::Iff | Operator::Xor => {
                let operand = usize::from(y.abs() < x.abs());
                let agree = x.is_sign_negative() == y.is_sign_negative();
                let holds = agree == (operator == Operator::Iff);
                let is_negated = holds == [x, y][operand].is_sign_negative();
                Choice { operand, time, is_negated }
            }
            _ => return None,
        })
    }
}

impl Formula {
    /// Returns the operands of a node, left before right.
    pub(crate) fn operands(&self, node: usize, starts: &[usize]) -> Vec<usize> {
        let Node::Apply(operator, _) = self.nodes[node] else { return Vec::new() };
        let last = node - 1;
        if operator.arity() == 2 { vec![starts[last] - 1, last] } else { vec![last] }
    }
}

/// The least value so far, with its first time.
#[derive(Clone, Copy)]
pub(crate) struct Least<Time> {
    pub found: Option<(f64, Time)>,
}

impl<Time> Default for Least<Time> {
    fn default() -> Self {
        Least { found: None }
    }
}

impl<Time: Copy + Ord> Least<Time> {
    pub(crate) fn add(&mut self, value: f64, time: Time) {
        let is_first = |(least, at): (f64, Time)| match value.total_cmp(&least) {
            Ordering::Less => true,
            Ordering::Equal => time < at,
            Ordering::Greater => false,
        };
        if self.found.is_none_or(is_first) {
            self.found = Some((value, time));
        }
    }
}

/// Replaces the greatest value so far by the value of the right operand, or the least one of the
/// left operand before it if that is less.
pub(crate) fn offer<Time>(
    best: &mut Option<(f64, Choice<Time>)>,
    held: Option<(f64, Time)>,
    value: f64,
    time: Time,
) {
    let (value, choice) = match held {
        Some((held, at)) if is_less(held, value) => (held, Choice::at(0, at)),
        _ => (value, Choice::at(1, time)),
    };
    if best.as_ref().is_none_or(|(known, _)| is_less(*known, value)) {
        *best = Some((value, choice));
    }
}

/// Returns whether `x` is less than `y`, with −0.0 less than +0.0.
pub(crate) fn is_less(x: f64, y: f64) -> bool {
    x.total_cmp(&y).is_lt()
}
