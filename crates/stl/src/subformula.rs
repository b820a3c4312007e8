//! Sub-formulas: their definition, their order, and the samples at which a trace covers them.

use crate::clock::{Clock, Window};
use crate::error::MonitorError;
use crate::formula::{Formula, Node};
use crate::operator::Operator;

/// A sub-formula as a node of the syntax tree.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SubformulaNode {
    /// The operator, such as `always` or `<=`; `None` for a signal or a constant.
    pub operator: Option<&'static str>,
    /// First and last sample of the operator's window, relative to the sample of evaluation; the
    /// last one is `None` if the window is unbounded. `None` for an operator that takes no
    /// interval.
    pub window: Option<(usize, Option<usize>)>,
    /// Positions of the operands in the list of [`Formula::subformulas`], left before right. Terms
    /// of a comparison are not in the list.
    pub operands: Vec<usize>,
    /// Texts of the two sides of a comparison.
    pub sides: Option<[String; 2]>,
}

/// The samples around t that a formula's value at t depends on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Reach {
    /// The number of samples before t that a trace must have so that no bounded window is cut at
    /// its start.
    pub behind: usize,
    /// The number of samples after t that a trace must have so that no bounded window is cut at its
    /// end and no unbounded window is empty.
    pub ahead: usize,
    /// Whether the value depends on all samples up to the end of the trace.
    pub is_unbounded: bool,
}

impl Reach {
    /// Returns the number of samples at which a trace with `samples` samples decides the formula.
    pub(crate) fn decided(self, samples: usize) -> usize {
        samples.saturating_sub(self.ahead)
    }

    /// Returns the reach of an operator given the reach of its operands (`first` equals `last` for
    /// a unary operator).
    ///
    /// Only the first sample of an unbounded window counts, since the window extends to the end of
    /// every trace.
    pub(crate) fn of(operator: Operator, window: Window, first: Reach, last: Reach) -> Reach {
        let begin = window.begin;
        let end = if window.is_unbounded() { begin } else { window.end };
        match operator {
            Operator::Always | Operator::Eventually => last.later(begin, end).over(window),
            Operator::Historically | Operator::Once => last.earlier(begin, end),
            Operator::Next | Operator::StrongNext => last.later(1, 1),
            Operator::Previous | Operator::StrongPrevious => last.earlier(1, 1),
            Operator::Rise | Operator::Fall => last.earlier(0, 1),
            // The left operand is not evaluated at the far end of the window.
            Operator::Until | Operator::Release | Operator::Since if window.end == 0 => last,
            Operator::Until | Operator::Release => {
                first.later(0, end.saturating_sub(1)).and(last.later(begin, end)).over(window)
            }
            Operator::Since => first.earlier(0, end.saturating_sub(1)).and(last.earlier(begin, end)),
            // `(always[0:end] first) or (first until[begin:end] last)`
            Operator::Unless => {
                let held = if window.is_unbounded() { begin.saturating_sub(1) } else { end };
                first.later(0, held).and(last.later(begin, end)).over(window)
            }
            _ => first.and(last),
        }
    }

    /// Marks the reach of an operator with a window after t.
    fn over(self, window: Window) -> Reach {
        Reach { is_unbounded: self.is_unbounded || window.is_unbounded(), ..self }
    }

    fn later(self, begin: usize, end: usize) -> Reach {
        Reach { behind: self.behind.saturating_sub(begin), ahead: self.ahead.saturating_add(end), ..self }
    }

    fn earlier(self, begin: usize, end: usize) -> Reach {
        Reach { behind: self.behind.saturating_add(end), ahead: self.ahead.saturating_sub(begin), ..self }
    }

    fn and(self, other: Reach) -> Reach {
        Reach {
            behind: self.behind.max(other.behind),
            ahead: self.ahead.max(other.ahead),
            is_unbounded: self.is_unbounded || other.is_unbounded,
        }
    }
}

/// The texts of [`Formula::subformulas`].
struct Texts<'a> {
    formula: &'a Formula,
    starts: Vec<usize>,
    nodes: std::vec::IntoIter<usize>,
}

impl Texts<'_> {
    fn text(&self, node: usize) -> String {
        std::fmt::from_fn(|f| self.formula.write_node(f, Operator::name, node, &self.starts)).to_string()
    }
}

impl Iterator for Texts<'_> {
    type Item = String;

    fn next(&mut self) -> Option<String> {
        self.nth(0)
    }

    fn nth(&mut self, n: usize) -> Option<String> {
        let node = self.nodes.nth(n)?;
        Some(self.text(node))
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        self.nodes.size_hint()
    }
}

impl ExactSizeIterator for Texts<'_> {}

impl Formula {
    /// Returns the texts of all sub-formulas, the formula itself among them.
    ///
    /// The order is fixed: root first, depth first, left operand before right.
    ///
    /// A sub-formula has a truth value: it is a comparison, a logical or temporal operator, or an
    /// operand of a logical or temporal operator. The terms of a comparison (`distance`, `0.12`,
    /// `abs(a - b)`) are numbers and are not listed. A sub-formula that occurs twice is listed
    /// twice. Each text parses to its sub-formula.
    ///
    /// A text is written when the iterator returns it, and `nth` writes none of those before. The
    /// texts of a long formula together have a length that is quadratic in its own; `len` returns
    /// their number in linear time.
    ///
    /// # Example
    /// ```
    /// use mishandle_stl::Formula;
    /// let formula = Formula::parse("always[50:300](abs(d) <= 0.12 and v < 1) or safe").unwrap();
    /// let texts: Vec<String> = formula.subformulas().collect();
    /// assert_eq!(
    ///     texts,
    ///     [
    ///         "always[50:300](abs(d) <= 0.12 and v < 1) or safe",
    ///         "always[50:300](abs(d) <= 0.12 and v < 1)",
    ///         "abs(d) <= 0.12 and v < 1",
    ///         "abs(d) <= 0.12",
    ///         "v < 1",
    ///         "safe",
    ///     ]
    /// );
    /// assert_eq!(formula.subformulas().nth(4).unwrap(), "v < 1");
    /// ```
    pub fn subformulas(&self) -> impl ExactSizeIterator<Item = String> {
        Texts { formula: self, starts: self.starts(), nodes: self.listed_nodes().into_iter() }
    }

    /// Returns the syntax tree of the sub-formulas, in the order of
    /// [`subformulas`](Self::subformulas).
    ///
    /// # Errors
    /// If the sampling period is not positive and finite, or an interval bound is not a whole
    /// number of samples.
    ///
    /// # Example
    /// ```
    /// use mishandle_stl::{Clock, Formula};
    /// let formula = Formula::parse("always[0:2s](d <= 0.12 or safe)").unwrap();
    /// let nodes = formula.subformula_nodes(&Clock::steps(0.5)).unwrap();
    /// assert_eq!((nodes[0].operator, nodes[0].window), (Some("always"), Some((0, Some(4)))));
    /// assert_eq!(nodes[1].operands, [2, 3]);
    /// assert_eq!(nodes[2].sides, Some(["d".to_string(), "0.12".to_string()]));
    /// ```
    pub fn subformula_nodes(&self, clock: &Clock) -> Result<Vec<SubformulaNode>, MonitorError> {
        clock.check()?;
        let starts = self.starts();
        let listed = self.listed_nodes();
        let mut positions = vec![None; self.nodes.len()];
        for (position, node) in listed.iter().enumerate() {
            positions[*node] = Some(position);
        }
        let text = |node: usize| {
            std::fmt::from_fn(|f| self.write_node(f, Operator::name, node, &starts)).to_string()
        };
        let describe = |node: &usize| {
            let Node::Apply(operator, interval) = self.nodes[*node] else {
                return Ok(SubformulaNode::default());
            };
            let last = node - 1;
            let operands = if operator.arity() == 2 { vec![starts[last] - 1, last] } else { vec![last] };
            let window = if operator.takes_interval() {
                let window = clock.window(operator.name(), interval)?;
                Some((window.begin, (!window.is_unbounded()).then_some(window.end)))
            } else {
                None
            };
            Ok(SubformulaNode {
                operator: Some(operator.name()),
                window,
                sides: operator.is_comparison().then(|| [text(operands[0]), text(last)]),
                operands: operands.into_iter().filter_map(|operand| positions[operand]).collect(),
            })
        };
        listed.iter().map(describe).collect()
    }

    /// Returns the formula that the node multiplies or divides by a positive number: the scale
    /// changes the size of the robustness and no verdict.
    pub(crate) fn scaled(&self, node: usize, starts: &[usize]) -> Option<usize> {
        let Node::Apply(Operator::Multiply | Operator::Divide, _) = self.nodes[node] else {
            return None;
        };
        let left = starts[node - 1] - 1;
        let is_positive =
            matches!(self.nodes[node - 1], Node::Constant(scale) if scale > 0.0 && scale.is_finite());
        let is_formula = matches!(self.nodes[left], Node::Apply(operator, _) if !operator.is_term());
        (is_positive && is_formula).then_some(left)
    }

    /// Returns the nodes of the sub-formulas, root first, depth first.
    pub(crate) fn listed_nodes(&self) -> Vec<usize> {
        let starts = self.starts();
        let mut listed = Vec::new();
        // A node, and whether it is the root or the operand of a logical or temporal operator.
        let mut open = vec![(self.nodes.len() - 1, true)];
        while let Some((node, in_formula)) = open.pop() {
            let Node::Apply(operator, _) = self.nodes[node] else {
                if in_formula {
                    listed.push(node);
                }
                continue;
            };
            if in_formula || !operator.is_term() {
                listed.push(node);
            }
            let has_formulas = !operator.is_term() && !operator.is_comparison();
            let last = node - 1;
            open.push((last, has_formulas));
            if operator.arity() == 2 {
                open.push((starts[last] - 1, has_formulas || self.scaled(node, &starts).is_some()));
            }
        }
        listed
    }
}
