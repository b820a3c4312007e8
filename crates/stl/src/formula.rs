//! A formula: its operators and operands in postfix order, and the text that it prints as.

use crate::clock::Interval;
use crate::error::ParseError;
use crate::operator::{Operator, Shape};
use crate::parser;
use std::fmt;
use std::str::FromStr;

/// An operand, or an operator that applies to the values before it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Node {
    /// A number; `true` is +∞ and `false` −∞.
    Constant(f64),
    /// A signal, by its place among the formula's signals.
    Signal(u32),
    Apply(Operator, Option<Interval>),
}

/// A temporal-logic formula, read from RTAMT's syntax.
///
/// # Syntax
/// Operators from the tightest to the loosest; those between two operands group to the left:
///
/// | operator | written |
/// |---|---|
/// | functions | `abs(x)` `sqrt(x)` `exp(x)` `ln(x)` `pow(x, y)` `rise(p)` `fall(p)` |
/// | sign | `-x` |
/// | arithmetic | `*` `/`, then `+` `-` |
/// | comparison | `<=` `>=` `<` `>` `==` `!==` (or `!=`) |
/// | negation | `not` `!` |
/// | future | `always` `G`, `eventually` `F`, `next` `X`, `s_next` `sX` |
/// | past | `historically` `H`, `once` `O`, `prev` `Y`, `s_prev` `sY` |
/// | two operands | `until` `U` and `release` `R`, then `unless` `W`, then `since` `S` |
/// | logic | `and` `&`, then `or` `\|`, then `implies` `->`, then `iff` `<->`, then `xor` |
///
/// `always`, `eventually`, `historically`, `once`, `until`, `release`, `unless` and `since` take an interval, `[a:b]` or
/// `[a,b]`: bounds are numbers with or without a unit (`s`, `ms`, `us`, `ns`), or constants; the end may be `inf`. A begin
/// without a unit before an end with one takes that unit. What a bare bound means is the [`Clock`](crate::Clock)'s
/// business.
///
/// Numbers may have exponents and underscores. `true` is +∞ and `false` −∞. Comments are `// …` and `/* … */`. A text
/// may declare (`input float d`), define constants (`const float limit = 0.3`) and name sub-formulas
/// (`near = d <= limit`) before the last formula, which is the one that counts and may have a name, too (`out = d <= 1`);
/// semicolons between them are optional. A definition that bears the name of a signal of the trace is refused by the
/// [`Monitor`](crate::Monitor): most often `=` was typed for `==`. So is a last statement that names a number.
///
/// **Comparisons are not chained**: as in RTAMT, `0.2 <= v <= 0.3` is `(0.2 <= v) <= 0.3`, which bounds `v - 0.2`. Write
/// `0.2 <= v and v <= 0.3`. [`Formula::chains_comparisons`] finds it.
///
/// # Where the reading is not RTAMT's
/// RTAMT 0.4.10 lets `+` bind tighter than `-` and `*` tighter than `/`: **it reads `a - b + c` as `a - (b + c)`** and
/// `a / b * c` as `a / (b * c)`. Here they are `(a - b) + c` and `(a / b) * c`, as in arithmetic. A formula prints with
/// these parentheses, so that both read what it prints alike. All other operators bind as they do there.
///
/// What RTAMT refuses or misreads besides is read the usual way: `!=`, `-x`, `a - 1` (refused there at first), `x/y` (one
/// name there), `ln`, `release`, `true`, `unless` without an interval, trailing semicolons, constants as bounds. Refused
/// here: annotations (`@topic`) and imports, which belong to ROS; and a begin with a unit before an end without one.
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
/// # Reference
/// Nickovic and Yamaguchi, "RTAMT: Online Robustness Monitors from STL", ATVA 2020.
///
/// Two formulas are equal if they mean the same tree; what their texts define on the way to it does not count.
#[derive(Clone, Debug)]
pub struct Formula {
    /// Distinct, in the order of their first appearance.
    pub(crate) signals: Vec<String>,
    /// In postfix order, so that no depth of nesting can exhaust the call stack.
    pub(crate) nodes: Vec<Node>,
    /// The names that the text defines, used or not.
    pub(crate) defined: Vec<String>,
}

impl PartialEq for Formula {
    fn eq(&self, other: &Formula) -> bool {
        self.signals == other.signals && self.nodes == other.nodes
    }
}

impl Formula {
    /// Reads a formula.
    ///
    /// # Errors
    /// Where the text is not a formula: the place, what was expected there and what was found.
    pub fn parse(text: &str) -> Result<Formula, ParseError> {
        parser::parse(text)
    }

    /// The names of the signals in the formula, distinct, in the order of their first appearance.
    pub fn signals(&self) -> Vec<&str> {
        self.signals.iter().map(String::as_str).collect()
    }

    /// Whether the value at a sample depends on that sample alone: no temporal operator, no `next`, `prev`, `rise` or
    /// `fall`.
    pub fn is_state_predicate(&self) -> bool {
        !self.nodes.iter().any(|node| matches!(node, Node::Apply(operator, _) if operator.is_temporal()))
    }

    /// Whether the outcome of a comparison is compared again, as in `0.2 <= v <= 0.3`: that is `(0.2 <= v) <= 0.3`, a
    /// bound on `v - 0.2`, and hardly ever what was meant.
    pub fn chains_comparisons(&self) -> bool {
        let starts = self.starts();
        let compares =
            |node: usize| matches!(self.nodes[node], Node::Apply(operator, _) if operator.is_order());
        (0..self.nodes.len()).any(|node| compares(node) && compares(starts[node - 1] - 1))
    }

    /// For each node the index where its operands begin.
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

/// What is still to be printed.
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

/// How an operator is written.
pub(crate) type Spelling = fn(Operator) -> &'static str;

impl Formula {
    /// Writes the formula with operators spelled in this way.
    pub(crate) fn write(&self, f: &mut fmt::Formatter<'_>, spelling: Spelling) -> fmt::Result {
        self.write_node(f, spelling, self.nodes.len() - 1, &self.starts())
    }

    /// Writes the sub-formula that ends in this node.
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
                    Node::Signal(signal) => f.write_str(&self.signals[signal as usize])?,
                    Node::Apply(operator, interval) => {
                        self.unfold(operator, spelling(operator), interval, index, starts, &mut pieces);
                    }
                },
            }
        }
        Ok(())
    }

    /// Pushes the pieces of an operator and its operands, the last piece first.
    fn unfold(
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

    /// An operand of `parent`, in parentheses where it would otherwise be read differently. An operator before its
    /// operand reaches as far right as it can, so it stays outside tighter ones; and what stands between two operands
    /// is set off behind such an operator for the reader's sake.
    fn operand(&self, parent: Operator, index: usize, is_left: bool) -> Piece {
        use Operator::{Add, Divide, Multiply, Subtract};
        let Node::Apply(child, _) = self.nodes[index] else { return Piece::Node(index) };
        let set_off = match (parent.shape(), child.shape()) {
            (_, Shape::Call(_)) | (Shape::Call(_), _) => false,
            (Shape::Prefix, Shape::Infix) => true,
            (Shape::Prefix, Shape::Prefix) => parent == Operator::Negate && child != Operator::Negate,
            // Not needed, but RTAMT 0.4.10 reads these the other way.
            _ if is_left && matches!((parent, child), (Add, Subtract) | (Multiply, Divide)) => true,
            (Shape::Infix, _) if is_left => child.power() < parent.power(),
            (Shape::Infix, _) => child.power() <= parent.power(),
        };
        if set_off { Piece::InParentheses(index) } else { Piece::Node(index) }
    }
}

/// The shortest text that reads back as the same number; infinities are the truth values.
pub(crate) fn write_number(f: &mut fmt::Formatter<'_>, value: f64) -> fmt::Result {
    match value {
        f64::INFINITY => f.write_str("true"),
        f64::NEG_INFINITY => f.write_str("false"),
        _ if value == 0.0 || (1e-5..1e16).contains(&value.abs()) => write!(f, "{value}"),
        _ => write!(f, "{value:e}"),
    }
}
