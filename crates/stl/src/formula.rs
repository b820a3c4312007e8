//! Formulas: operators and operands in postfix order, and their text.

use crate::clock::{Bound, Interval};
use crate::error::{MonitorError, ParseError};
use crate::name::spelled;
use crate::number::write_number;
use crate::operator::{Operator, Shape};
use crate::parser;
use crate::program::columns;
use crate::syntax::Origin;
use std::fmt;
use std::str::FromStr;

/// An operand, or an operator that applies to the values before it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Node {
    /// A number; `true` is +∞, `false` is −∞.
    Constant(f64),
    /// A signal, by its index among the formula's signals.
    Signal(u32),
    Apply(Operator, Option<Interval>),
}

/// A formula of signal temporal logic, in RTAMT's syntax.
///
/// The reference page `docs/reference/formulas.md` has all operators with examples, their
/// precedence, statements, names, limits and the differences from RTAMT. In short:
/// - Precedence, decreasing: functions, sign, `*` `/`, `+` `-`, comparisons, `not`, `always` and
///   other temporal operators, `until` and its relatives, `and`, `or`, `implies`, `iff`, `xor`.
///   Infix operators are left-associative.
/// - Bounds are numbers with an optional unit (`s`, `ms`, `us`, `ns`), or constants; the end may be
///   `inf`. The [`Clock`](crate::Clock) defines the meaning of bounds without a unit.
/// - A text may declare signals, define constants and name sub-formulas, separated by semicolons or
///   line breaks. The last statement is the formula. The [`Monitor`](crate::Monitor) rejects a
///   definition with the name of a signal of the trace, since `=` is often a typo for `==`.
/// - A name that is not a plain word stands in backquotes: `` `a/b[0]` ``.
///   [`spelled`](crate::spelled) writes names this way.
/// - **Comparisons are not chained**: as in RTAMT, `0.2 <= v <= 0.3` is `(0.2 <= v) <= 0.3`, which
///   bounds `v - 0.2`. [`Formula::chains_comparisons`] detects such formulas.
///
/// A printed formula parses to the same formula, and RTAMT parses it alike if it has no names in
/// backquotes: `a - b + c`, which is `a - (b + c)` in RTAMT, is printed as `(a - b) + c`.
///
/// # Example
/// ```
/// use mishandle_stl::Formula;
///
/// let formula: Formula = "G[0,30] d<=0.3 & v<1".parse().unwrap();
/// assert_eq!(formula.to_string(), "always[0:30](d <= 0.3) and v < 1");
/// assert_eq!(formula.signals(), ["d", "v"]);
/// assert_eq!(Formula::parse(&formula.to_string()).unwrap(), formula);
///
/// let error = Formula::parse("always[0:30](d <= )").unwrap_err();
/// assert_eq!(error.column(), 19);
/// ```
///
/// Two formulas are equal if their syntax trees are equal, whatever constants and sub-formulas
/// their texts define.
#[derive(Clone, Debug)]
pub struct Formula {
    /// Distinct, in the order of their first appearance.
    pub(crate) signals: Vec<String>,
    /// In postfix order, so that deep nesting cannot overflow the call stack.
    pub(crate) nodes: Vec<Node>,
    /// Where each node is in the text; empty for a formula without one.
    pub(crate) origins: Vec<Origin>,
    /// All names that the text defines, whether used or not.
    pub(crate) defined: Vec<Definition>,
}

/// A name that the text of a formula defines.
#[derive(Clone, Debug)]
pub(crate) struct Definition {
    pub name: String,
    /// Whether another statement reads it, or it is the formula itself.
    pub is_used: bool,
}

impl PartialEq for Formula {
    fn eq(&self, other: &Formula) -> bool {
        self.signals == other.signals && self.nodes == other.nodes
    }
}

impl Formula {
    /// Parses a formula.
    ///
    /// # Errors
    /// [`ParseError`] with the position, what is allowed there and what was found.
    pub fn parse(text: &str) -> Result<Formula, ParseError> {
        parser::parse(text, &[])
    }

    /// Returns the distinct names of the signals in the formula, in the order of first appearance.
    pub fn signals(&self) -> Vec<&str> {
        self.signals.iter().map(String::as_str).collect()
    }

    /// Returns whether the value at a sample depends on that sample only: the formula has no
    /// temporal operator and no `next`, `prev`, `rise` or `fall`.
    pub fn is_state_predicate(&self) -> bool {
        !self.nodes.iter().any(|node| matches!(node, Node::Apply(operator, _) if operator.is_temporal()))
    }

    /// Returns whether the result depends on the sampling period: a bound is a time other than 0
    /// and `inf`. Bounds without a unit are times with a clock that has RTAMT's convention.
    pub fn needs_period(&self, has_rtamt_clock: bool) -> bool {
        let is_time = |bound: Bound| {
            (bound.unit.is_some() || has_rtamt_clock) && bound.value > 0.0 && bound.value.is_finite()
        };
        self.nodes.iter().any(|node| match *node {
            Node::Apply(_, Some(interval)) => is_time(interval.begin) || is_time(interval.end),
            _ => false,
        })
    }

    /// Checks that a trace of the signals `names` has what the formula reads.
    ///
    /// # Errors
    /// If the formula reads no signal, or `names` lacks a signal of the formula, contains a name
    /// that the formula defines, or a letter that is an operator in its text.
    ///
    /// # Example
    /// ```
    /// use mishandle_stl::Formula;
    /// let names = ["X".to_owned()];
    /// let check = |text: &str| Formula::parse(text).unwrap().check_names(&names);
    /// assert!(check("always(`X` - 1 <= 2)").is_ok());
    /// assert!(check("always(X(`X` <= 2))").is_err()); // `next` or the signal?
    /// assert!(check("always(1 <= 2)").is_err());
    /// ```
    pub fn check_names(&self, names: &[String]) -> Result<(), MonitorError> {
        if self.signals.is_empty() {
            return Err(MonitorError::NoSignal);
        }
        columns(self, names).map(drop)
    }

    /// Returns for each node whether it is a number in the place of a formula: a signal, or
    /// arithmetic on signals and constants. It holds if it is not negative, so a zero of it is
    /// +0.0.
    pub(crate) fn bare_numbers(&self) -> Vec<bool> {
        let starts = self.starts();
        let mut is_number: Vec<bool> = Vec::with_capacity(self.nodes.len());
        let mut is_bare = vec![false; self.nodes.len()];
        for (index, node) in self.nodes.iter().enumerate() {
            let operands = self.operands(index, &starts);
            is_number.push(match node {
                Node::Apply(operator, _) => {
                    operator.is_term() && operands.iter().all(|node| is_number[*node])
                }
                _ => true,
            });
            if matches!(node, Node::Apply(operator, _) if !operator.is_term() && !operator.is_comparison()) {
                operands.into_iter().for_each(|operand| is_bare[operand] = true);
            }
        }
        if let Some(root) = is_bare.last_mut() {
            *root = true;
        }
        let is_signed = |index: usize| is_number[index] && !matches!(self.nodes[index], Node::Constant(_));
        is_bare.iter().enumerate().map(|(index, is_bare)| *is_bare && is_signed(index)).collect()
    }

    /// Returns the prefix operators that the text abbreviates by a letter.
    pub(crate) fn letters(&self) -> impl Iterator<Item = (Operator, &'static str)> {
        self.nodes.iter().zip(&self.origins).filter_map(|(node, origin)| match node {
            Node::Apply(operator, _) if origin.is_letter => Some((*operator, operator.letter()?)),
            _ => None,
        })
    }

    /// Returns the names that the text defines and no later statement reads. A statement that is
    /// missing an operator at its end loses its next line this way.
    pub fn unused_definitions(&self) -> Vec<&str> {
        self.defined.iter().filter(|found| !found.is_used).map(|found| found.name.as_str()).collect()
    }

    /// Returns whether the result of a comparison is compared again, as in `0.2 <= v <= 0.3`. This
    /// is `(0.2 <= v) <= 0.3`, a bound on `v - 0.2`, which is rarely intended.
    pub fn chains_comparisons(&self) -> bool {
        let starts = self.starts();
        let compares =
            |node: usize| matches!(self.nodes[node], Node::Apply(operator, _) if operator.is_order());
        (0..self.nodes.len()).any(|node| compares(node) && compares(starts[node - 1] - 1))
    }

    /// Returns for each node the index of the first node of its operands.
    pub(crate) fn starts(&self) -> Vec<usize> {
        let mut operands = Vec::new();
        let mut starts = Vec::with_capacity(self.nodes.len());
        for (index, node) in self.nodes.iter().enumerate() {
            let arity = if let Node::Apply(operator, _) = node { operator.arity() } else { 0 };
            let first = operands.len() - arity;
            let start = operands.get(first).copied().unwrap_or(index);
            operands.truncate(first);
            operands.push(start);
            starts.push(start);
        }
        starts
    }
}

impl FromStr for Formula {
    type Err = ParseError;

    fn from_str(text: &str) -> Result<Formula, ParseError> {
        Formula::parse(text)
    }
}

/// A piece of output that is not printed yet.
enum Piece {
    Node(usize),
    InParentheses(usize),
    Text(&'static str),
    Interval(Option<Interval>),
}

impl fmt::Display for Formula {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.write(f, Operator::name)
    }
}

/// A function from operators to their spelling.
pub(crate) type Spelling = fn(Operator) -> &'static str;

impl Formula {
    /// Writes the formula with this spelling of operators.
    pub(crate) fn write(&self, f: &mut fmt::Formatter<'_>, spelling: Spelling) -> fmt::Result {
        self.write_node(f, spelling, self.nodes.len() - 1, &self.starts())
    }

    /// Writes the sub-formula whose last node is `node`.
    pub(crate) fn write_node(
        &self,
        f: &mut fmt::Formatter<'_>,
        spelling: Spelling,
        node: usize,
        starts: &[usize],
    ) -> fmt::Result {
        let mut pieces = vec![Piece::Node(node)];
        while let Some(piece) = pieces.pop() {
            match piece {
                Piece::Text(text) => f.write_str(text)?,
                Piece::Interval(interval) => interval.map_or(Ok(()), |interval| write!(f, "{interval}"))?,
                Piece::InParentheses(index) => {
                    f.write_str("(")?;
                    pieces.extend([Piece::Text(")"), Piece::Node(index)]);
                }
                Piece::Node(index) => match self.nodes[index] {
                    Node::Constant(value) => write_number(f, value)?,
                    Node::Signal(signal) => f.write_str(&spelled(&self.signals[signal as usize]))?,
                    Node::Apply(operator, interval) => {
                        self.push_pieces(operator, spelling(operator), interval, index, starts, &mut pieces);
                    }
                },
            }
        }
        Ok(())
    }

    /// Pushes the pieces of an operator and its operands in reverse order.
    fn push_pieces(
        &self,
        operator: Operator,
        name: &'static str,
        interval: Option<Interval>,
        index: usize,
        starts: &[usize],
        pieces: &mut Vec<Piece>,
    ) {
        let last = index - 1;
        match operator.shape() {
            Shape::Prefix => {
                let operand = self.operand(operator, last, false);
                let tight = operator == Operator::Negate || matches!(operand, Piece::InParentheses(_));
                pieces.extend([
                    operand,
                    Piece::Text(if tight { "" } else { " " }),
                    Piece::Interval(interval),
                    Piece::Text(name),
                ]);
            }
            Shape::Infix => {
                let left = starts[last] - 1;
                pieces.extend([
                    self.operand(operator, last, false),
                    Piece::Text(" "),
                    Piece::Interval(interval),
                    Piece::Text(name),
                    Piece::Text(" "),
                    self.operand(operator, left, true),
                ]);
            }
            Shape::Call(1) => pieces.extend([Piece::InParentheses(last), Piece::Text(name)]),
            Shape::Call(_) => {
                let left = starts[last] - 1;
                pieces.extend([Piece::Text(")"), Piece::Node(last), Piece::Text(", "), Piece::Node(left)]);
                pieces.extend([Piece::Text("("), Piece::Text(name)]);
            }
        }
    }

    /// Returns an operand of `parent`, in parentheses if the text would otherwise parse
    /// differently. An infix operand of a prefix operator always gets parentheses, for readability.
    fn operand(&self, parent: Operator, index: usize, is_left: bool) -> Piece {
        use Operator::{Add, Divide, Multiply, Subtract};
        let Node::Apply(child, _) = self.nodes[index] else { return Piece::Node(index) };
        let needs_parentheses = match (parent.shape(), child.shape()) {
            (_, Shape::Call(_)) | (Shape::Call(_), _) => false,
            (Shape::Prefix, Shape::Infix) => true,
            (Shape::Prefix, Shape::Prefix) => parent == Operator::Negate && child != Operator::Negate,
            // Redundant here, but RTAMT 0.4.10 parses these differently.
            _ if is_left && matches!((parent, child), (Add, Subtract) | (Multiply, Divide)) => true,
            (Shape::Infix, _) if is_left => child.precedence() < parent.precedence(),
            (Shape::Infix, _) => child.precedence() <= parent.precedence(),
        };
        if needs_parentheses { Piece::InParentheses(index) } else { Piece::Node(index) }
    }
}
