//! The syntax tree of a formula, for programs that analyze it, and parameters.

use crate::clock::{Bound, Interval, TimeUnit};
use crate::error::{ParseError, Position};
use crate::formula::{Formula, Node};
use crate::operator::{Operator, Shape};
use crate::parser;
use std::fmt;

/// Where a node of a formula comes from.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Origin {
    pub at: Option<Position>,
    /// Whether the text has parentheses around it, or a name in its place.
    pub in_parentheses: bool,
    /// Whether the text abbreviates the operator by a letter.
    pub is_letter: bool,
    /// The parameter that a constant is.
    pub parameter: Option<u32>,
    /// The parameters that are the bounds of the interval.
    pub bounds: [Option<u32>; 2],
}

impl Origin {
    pub(crate) fn at(at: Position) -> Origin {
        Origin { at: Some(at), ..Origin::default() }
    }
}

/// A name that stands for a number in the text of a formula.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameter<'a> {
    /// The name.
    pub name: &'a str,
    /// The value.
    pub value: f64,
    /// The unit of the value where it is a bound of an interval and the text has none there.
    pub unit: Option<TimeUnit>,
}

/// The kind of a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SyntaxKind<'a> {
    /// A number; `true` is +∞, `false` is −∞.
    Number(f64),
    /// A signal.
    Signal(&'a str),
    /// An operator or function, by its printed spelling, such as `always` or `<=`.
    Operator(&'static str),
}

/// A bound of an interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SyntaxBound {
    /// The number as written.
    pub value: f64,
    /// Its unit, if it has one.
    pub unit: Option<TimeUnit>,
    /// The parameter that it is, by its index.
    pub parameter: Option<usize>,
}

/// A node of a syntax tree.
#[derive(Clone, Debug, PartialEq)]
pub struct SyntaxNode<'a> {
    /// Whether it is a number, a signal or an operator.
    pub kind: SyntaxKind<'a>,
    /// The operands by their index, left before right.
    pub operands: Vec<usize>,
    /// Begin and end of the interval, if the text has one.
    pub interval: Option<[SyntaxBound; 2]>,
    /// Where the text has the operator, the signal or the number.
    pub at: Option<Position>,
    /// Whether the text has parentheses around the node, or a name for it.
    pub in_parentheses: bool,
    /// Whether it is arithmetic: a number without a truth value. Signals and numbers are not.
    pub is_term: bool,
    /// The parameter that a number is, by its index.
    pub parameter: Option<usize>,
}

/// A piece of output that is not printed yet.
enum Piece {
    Node(usize),
    Text(&'static str),
    Interval(Option<Interval>),
}

impl Formula {
    /// Parses a formula in which the names of the parameters are constants, also as bounds of
    /// intervals.
    ///
    /// # Errors
    /// As for [`Formula::parse`], or if a statement defines the name of a parameter.
    ///
    /// # Example
    /// ```
    /// use mishandle_stl::{Formula, Parameter, TimeUnit};
    /// let limit = Parameter { name: "limit", value: 20.0, unit: None };
    /// let time = Parameter { name: "T", value: 1.5, unit: Some(TimeUnit::Seconds) };
    /// let formula = Formula::parse_with("always[0:T](force <= limit)", &[limit, time]).unwrap();
    /// assert_eq!(formula.to_string(), "always[0s:1.5s](force <= 20)");
    /// ```
    pub fn parse_with(text: &str, parameters: &[Parameter<'_>]) -> Result<Formula, ParseError> {
        parser::parse(text, parameters)
    }

    /// Returns the formula in which the bounds of intervals that have no unit have this one.
    ///
    /// # Example
    /// ```
    /// use mishandle_stl::{Formula, TimeUnit};
    /// let formula = Formula::parse("always[0:0.5] eventually[0:200ms] closed").unwrap();
    /// let timed = formula.with_unit(TimeUnit::Seconds);
    /// assert_eq!(timed.to_string(), "always[0s:0.5s] eventually[0ms:200ms] closed");
    /// ```
    pub fn with_unit(&self, unit: TimeUnit) -> Formula {
        let mut formula = self.clone();
        for node in &mut formula.nodes {
            if let Node::Apply(_, Some(interval)) = node {
                for bound in [&mut interval.begin, &mut interval.end] {
                    bound.unit.get_or_insert(unit);
                }
            }
        }
        formula
    }

    /// Returns the syntax tree: operands come before their operator, the last node is the root.
    ///
    /// # Example
    /// ```
    /// use mishandle_stl::{Formula, SyntaxKind};
    /// let formula = Formula::parse("always(force <= 20)").unwrap();
    /// let nodes = formula.syntax();
    /// assert_eq!(nodes[0].kind, SyntaxKind::Signal("force"));
    /// assert_eq!((nodes[2].kind, nodes[2].operands.as_slice()), (SyntaxKind::Operator("<="), &[0, 1][..]));
    /// assert_eq!(nodes[2].at.unwrap().column, 14);
    /// assert_eq!(nodes[3].operands, [2]);
    /// ```
    pub fn syntax(&self) -> Vec<SyntaxNode<'_>> {
        let starts = self.starts();
        let describe = |(index, node): (usize, &Node)| {
            let origin = self.origins.get(index).copied().unwrap_or_default();
            let number = |parameter: Option<u32>| parameter.map(|index| index as usize);
            let plain = SyntaxNode {
                kind: SyntaxKind::Number(0.0),
                operands: Vec::new(),
                interval: None,
                at: origin.at,
                in_parentheses: origin.in_parentheses,
                is_term: false,
                parameter: number(origin.parameter),
            };
            match *node {
                Node::Constant(value) => SyntaxNode { kind: SyntaxKind::Number(value), ..plain },
                Node::Signal(signal) => {
                    SyntaxNode { kind: SyntaxKind::Signal(&self.signals[signal as usize]), ..plain }
                }
                Node::Apply(operator, interval) => {
                    let last = index - 1;
                    let bound = |bound: Bound, parameter| SyntaxBound {
                        value: bound.value,
                        unit: bound.unit,
                        parameter: number(parameter),
                    };
                    SyntaxNode {
                        kind: SyntaxKind::Operator(operator.name()),
                        operands: match operator.arity() {
                            2 => vec![starts[last] - 1, last],
                            _ => vec![last],
                        },
                        interval: interval.map(|interval| {
                            let [begin, end] = origin.bounds;
                            [bound(interval.begin, begin), bound(interval.end, end)]
                        }),
                        is_term: operator.is_term(),
                        ..plain
                    }
                }
            }
        };
        self.nodes.iter().enumerate().map(describe).collect()
    }

    /// Returns the sub-formula or term whose last node is `node` of [`Formula::syntax`].
    ///
    /// # Panics
    /// If there is no such node.
    pub fn at_node(&self, node: usize) -> Formula {
        let first = self.starts()[node];
        let origins = self.origins.get(first..=node).unwrap_or_default().to_vec();
        Formula { origins, ..self.part(first, node) }
    }

    /// Returns the text with parentheses around each operand that is an operator, so that the
    /// precedence is visible.
    ///
    /// # Example
    /// ```
    /// use mishandle_stl::Formula;
    /// let formula = Formula::parse("always p >= 1 implies q >= 2 * r").unwrap();
    /// assert_eq!(formula.parenthesized(), "(always (p >= 1)) implies (q >= (2 * r))");
    /// ```
    pub fn parenthesized(&self) -> String {
        fmt::from_fn(|f| self.write_parenthesized(f)).to_string()
    }

    fn write_parenthesized(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let starts = self.starts();
        let mut pieces = vec![Piece::Node(self.nodes.len() - 1)];
        while let Some(piece) = pieces.pop() {
            let node = match piece {
                Piece::Text(text) => {
                    f.write_str(text)?;
                    continue;
                }
                Piece::Interval(interval) => {
                    interval.map_or(Ok(()), |interval| write!(f, "{interval}"))?;
                    continue;
                }
                Piece::Node(node) => node,
            };
            let Node::Apply(operator, interval) = self.nodes[node] else {
                self.write_node(f, Operator::name, node, &starts)?;
                continue;
            };
            let last = node - 1;
            let operand = |node: usize| {
                let is_leaf = match self.nodes[node] {
                    Node::Apply(operator, _) => matches!(operator.shape(), Shape::Call(_)),
                    _ => true,
                };
                let around = |text| Piece::Text(if is_leaf { "" } else { text });
                [around(")"), Piece::Node(node), around("(")]
            };
            match operator.shape() {
                Shape::Prefix => {
                    let space = if operator == Operator::Negate { "" } else { " " };
                    pieces.extend(operand(last));
                    let head = Piece::Text(operator.name());
                    pieces.extend([Piece::Text(space), Piece::Interval(interval), head]);
                }
                Shape::Infix => {
                    pieces.extend(operand(last));
                    pieces.push(Piece::Text(" "));
                    pieces.extend([
                        Piece::Interval(interval),
                        Piece::Text(operator.name()),
                        Piece::Text(" "),
                    ]);
                    pieces.extend(operand(starts[last] - 1));
                }
                Shape::Call(1) => {
                    write!(f, "{}(", operator.name())?;
                    pieces.extend([Piece::Text(")"), Piece::Node(last)]);
                }
                Shape::Call(_) => {
                    write!(f, "{}(", operator.name())?;
                    let left = Piece::Node(starts[last] - 1);
                    pieces.extend([Piece::Text(")"), Piece::Node(last), Piece::Text(", "), left]);
                }
            }
        }
        Ok(())
    }
}
