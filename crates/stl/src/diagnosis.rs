//! Diagnoses: the sub-formulas and samples that determine the robustness of a trace.

use crate::clock::Clock;
use crate::decisive::Tree;
use crate::error::MonitorError;
use crate::formula::{Formula, Node};
use crate::monitor::Windows;
use crate::operator::Operator;
use crate::trace::Trace;
use std::ops::RangeInclusive;

/// The chain of sub-formulas that determines the robustness of a trace at sample 0, from the
/// formula to a predicate.
///
/// The value of `min` and `max` is that of one operand, at one sample. The chain follows these
/// operands: from `always` to the sample of the least robustness in its window, from `eventually`
/// to the sample of the greatest, from `and` to the operand with the smaller robustness, and so on.
/// If several operands or samples have the same value, it follows the first. It ends at a
/// comparison, at a bare signal or number, or at an operator whose value depends on no operand (an
/// empty window).
///
/// # Example
/// ```
/// use std::sync::Arc;
/// use mishandle_stl::{Clock, Formula, Trace};
///
/// let formula = Formula::parse("always[1:2](distance <= 0.5 and speed < 2)").unwrap();
/// let mut trace = Trace::new(Arc::from(["distance".to_owned(), "speed".to_owned()]));
/// for sample in [[0.75, 0.0], [0.25, 1.0], [0.25, 3.0]] {
///     trace.push(&sample);
/// }
/// let diagnosis = formula.diagnose(&trace, &Clock::steps(0.1)).unwrap();
/// assert_eq!(diagnosis.robustness(), -1.0);
/// let predicate = diagnosis.predicate.unwrap();
/// assert_eq!((predicate.text.as_str(), predicate.sample), ("speed < 2", 2));
/// assert_eq!((predicate.values, predicate.robustness), ([3.0, 2.0], -1.0));
/// ```
///
/// # Reference
/// Ferrère, Maler and Nickovic, "Trace Diagnostics Using Temporal Implicants", ATVA 2015, for
/// formulas with truth values; here a chain of single samples, because the robustness is the value
/// of one predicate at one sample.
#[derive(Clone, Debug, PartialEq)]
pub struct Diagnosis {
    /// The sub-formulas of the chain, the formula itself first.
    pub path: Vec<DecisiveSubformula>,
    /// The predicate at the end of the chain; `None` if the chain does not end at a comparison.
    pub predicate: Option<DecisivePredicate>,
}

impl Diagnosis {
    /// Returns the robustness of the formula at sample 0.
    pub fn robustness(&self) -> f64 {
        self.path.first().map_or(f64::NAN, |first| first.robustness)
    }
}

/// A sub-formula of a [`Diagnosis`].
#[derive(Clone, Debug, PartialEq)]
pub struct DecisiveSubformula {
    /// Position in the list of [`Formula::subformulas`].
    pub position: usize,
    /// The text.
    pub text: String,
    /// The operator, such as `always`; `None` for a signal or a number.
    pub operator: Option<&'static str>,
    /// Texts of the operands of a logical or temporal operator, the left one first; empty
    /// otherwise.
    pub operands: Vec<String>,
    /// The sample at which it is evaluated.
    pub sample: usize,
    /// First and last sample of the operator's window, cut at the ends of the trace; `None` for an
    /// operator without an interval, and if the window is empty.
    pub window: Option<(usize, usize)>,
    /// The robustness at the sample.
    pub robustness: f64,
}

/// The predicate of a [`Diagnosis`].
#[derive(Clone, Debug, PartialEq)]
pub struct DecisivePredicate {
    /// Position in the list of [`Formula::subformulas`].
    pub position: usize,
    /// The text.
    pub text: String,
    /// The sample at which it is evaluated.
    pub sample: usize,
    /// The comparison, such as `<=`.
    pub comparison: &'static str,
    /// Texts of the two sides.
    pub sides: [String; 2],
    /// Values of the two sides at the sample.
    pub values: [f64; 2],
    /// The robustness at the sample.
    pub robustness: f64,
    /// Whether an odd number of negations encloses the predicate, so that the formula requires it
    /// to be false.
    pub is_negated: bool,
}

impl Formula {
    /// Returns which sub-formula, predicate and sample determine the robustness of `trace` at
    /// sample 0. Windows are cut at the end of the trace.
    ///
    /// It reads the samples that the robustness depends on. Memory is needed for windows inside
    /// other windows only: it depends on the inner ones, and on the length of the trace if one of
    /// these has no end.
    ///
    /// # Errors
    /// As for [`Monitor::new`] and [`Monitor::robustness`](crate::Monitor::robustness).
    ///
    /// [`Monitor::new`]: crate::Monitor::new
    pub fn diagnose(&self, trace: &Trace, clock: &Clock) -> Result<Diagnosis, MonitorError> {
        self.chain(&Tree::new(self, trace, clock, Windows::Cut)?)
    }

    /// Returns the diagnosis of the first value of
    /// [`Monitor::decided_robustness_signal`](crate::Monitor::decided_robustness_signal); `None` if
    /// the trace does not decide the formula at sample 0.
    ///
    /// # Errors
    /// As for [`Formula::diagnose`].
    pub fn diagnose_decided(&self, trace: &Trace, clock: &Clock) -> Result<Option<Diagnosis>, MonitorError> {
        let tree = Tree::new(self, trace, clock, Windows::Whole)?;
        if tree.known(self.nodes.len() - 1) == 0 {
            return Ok(None);
        }
        self.chain(&tree).map(Some)
    }

    fn chain(&self, tree: &Tree<'_>) -> Result<Diagnosis, MonitorError> {
        let mut positions = vec![0; self.nodes.len()];
        for (position, node) in self.listed_nodes().into_iter().enumerate() {
            positions[node] = position;
        }
        let mut diagnosis = Diagnosis { path: Vec::new(), predicate: None };
        let mut node = self.nodes.len() - 1;
        let mut sample = 0;
        let mut is_negated = false;
        let mut values = tree.values(node, sample)?;
        loop {
            let position = positions[node];
            let robustness = values.of(node);
            let mut found = DecisiveSubformula {
                position,
                text: tree.text(node),
                operator: None,
                operands: Vec::new(),
                sample,
                window: None,
                robustness,
            };
            let Node::Apply(operator, _) = self.nodes[node] else {
                diagnosis.path.push(found);
                return Ok(diagnosis);
            };
            found.operator = Some(operator.name());
            found.window = tree.window(node, sample).map(RangeInclusive::into_inner);
            let operands = tree.operands(node);
            if !operator.is_term() && !operator.is_comparison() {
                found.operands = operands.iter().map(|operand| tree.text(*operand)).collect();
            }
            let text = found.text.clone();
            diagnosis.path.push(found);
            if let Some(left) = self.scaled(node, tree.starts()) {
                node = left;
                continue;
            }
            if operator.is_term() {
                return Ok(diagnosis);
            }
            if operator.is_comparison() {
                diagnosis.predicate = Some(DecisivePredicate {
                    position,
                    text,
                    sample,
                    comparison: operator.name(),
                    sides: [operands[0], operands[1]].map(|side| tree.text(side)),
                    values: [values.of(operands[0]), values.of(operands[1])],
                    robustness,
                    is_negated,
                });
                return Ok(diagnosis);
            }
            let Some(choice) = values.choice(self, tree.starts(), node) else {
                return Ok(diagnosis);
            };
            node = operands[choice.operand];
            is_negated ^= choice.is_negated;
            if operator.is_temporal() {
                sample = choice.time;
                values = tree.values(node, sample)?;
            }
        }
    }

    /// Returns the positions of the conjuncts in the list of [`subformulas`](Self::subformulas):
    /// the operands of each `and` that is reached from the formula through `and`, `always`,
    /// `eventually`, `next` and their past forms. The formula is violated if one of them fails on
    /// its own, see [`conjunct`](Self::conjunct). If there is no such `and`, the only conjunct is
    /// the operand below these operators.
    ///
    /// # Example
    /// ```
    /// use mishandle_stl::Formula;
    /// let formula = Formula::parse("always[0:30](d <= 0.1 and (near or v < 1)) and eventually(d < 0)").unwrap();
    /// let texts: Vec<String> = formula.subformulas().collect();
    /// let conjuncts: Vec<&str> = formula.conjuncts().into_iter().map(|position| texts[position].as_str()).collect();
    /// assert_eq!(conjuncts, ["d <= 0.1", "near or v < 1", "d < 0"]);
    /// ```
    pub fn conjuncts(&self) -> Vec<usize> {
        let listed = self.listed_nodes();
        let starts = self.starts();
        let mut found = Vec::new();
        let mut open = vec![self.nodes.len() - 1];
        while let Some(node) = open.pop() {
            match self.nodes[node] {
                // The left operand is on top.
                Node::Apply(Operator::And, _) => open.extend([node - 1, starts[node - 1] - 1]),
                Node::Apply(
                    Operator::Always
                    | Operator::Historically
                    | Operator::Eventually
                    | Operator::Once
                    | Operator::Next
                    | Operator::StrongNext
                    | Operator::Previous
                    | Operator::StrongPrevious,
                    _,
                ) => open.push(node - 1),
                _ if self.scaled(node, &starts).is_some() => open.extend(self.scaled(node, &starts)),
                _ => found.extend(listed.iter().position(|listed| *listed == node)),
            }
        }
        found
    }

    /// Returns the formula without the other conjuncts: of each `and` above the sub-formula at
    /// `position` in the list of [`subformulas`](Self::subformulas), only the operand that contains
    /// it remains. Returns `None` if `position` is not in the list.
    ///
    /// The robustness of the result is at least that of the formula. It is negative if this
    /// sub-formula fails on its own, whatever the others do. An `and` under an operator that can
    /// negate it (`not`, `implies`, `iff`, `xor`, `rise`, `fall`) remains whole.
    ///
    /// # Example
    /// ```
    /// use mishandle_stl::Formula;
    /// let formula = Formula::parse("eventually(always[0:30](d <= 0.1 and v < 1 and near))").unwrap();
    /// let position = formula.subformulas().position(|text| text == "v < 1").unwrap();
    /// assert_eq!(formula.conjunct(position).unwrap().to_string(), "eventually always[0:30](v < 1)");
    /// ```
    pub fn conjunct(&self, position: usize) -> Option<Formula> {
        let target = *self.listed_nodes().get(position)?;
        let starts = self.starts();
        let mut kept = vec![true; self.nodes.len()];
        let mut node = self.nodes.len() - 1;
        while node != target {
            let Node::Apply(operator, _) = self.nodes[node] else { return None };
            let last = node - 1;
            let left = if operator.arity() == 2 { starts[last] - 1 } else { last };
            let is_left = target <= left && operator.arity() == 2;
            match operator {
                Operator::And => {
                    kept[node] = false;
                    let dropped = if is_left { starts[last]..=last } else { starts[left]..=left };
                    kept[dropped].fill(false);
                }
                Operator::Not
                | Operator::Implies
                | Operator::Iff
                | Operator::Xor
                | Operator::Rise
                | Operator::Fall => break,
                _ => {}
            }
            node = if is_left { left } else { last };
        }
        let kept = self.nodes.iter().zip(kept).filter(|(_, kept)| *kept);
        Some(self.of_nodes(kept.map(|(node, _)| *node)))
    }

    /// Returns the formula of some nodes of this one, with the signals that they read.
    pub(crate) fn of_nodes(&self, nodes: impl Iterator<Item = Node>) -> Formula {
        let mut signals: Vec<String> = Vec::new();
        let mut renumbered = |node| match node {
            Node::Signal(signal) => {
                let name = &self.signals[signal as usize];
                let index = signals.iter().position(|known| known == name).unwrap_or_else(|| {
                    signals.push(name.clone());
                    signals.len() - 1
                });
                Node::Signal(index as u32)
            }
            other => other,
        };
        let nodes = nodes.map(&mut renumbered).collect();
        Formula { signals, nodes, origins: Vec::new(), defined: Vec::new() }
    }
}
