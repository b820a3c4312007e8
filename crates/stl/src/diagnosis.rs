//! Diagnoses: the sub-formulas and samples that determine the robustness of a trace.

use crate::clock::{Clock, Window};
use crate::error::MonitorError;
use crate::formula::{Formula, Node};
use crate::monitor::Monitor;
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
    /// # Errors
    /// As for [`Monitor::new`] and [`Monitor::robustness_signal`].
    pub fn diagnose(&self, trace: &Trace, clock: &Clock) -> Result<Diagnosis, MonitorError> {
        let tree = Tree { formula: self, starts: self.starts(), trace, clock };
        let mut positions = vec![0; self.nodes.len()];
        for (position, node) in self.listed_nodes().into_iter().enumerate() {
            positions[node] = position;
        }
        let mut diagnosis = Diagnosis { path: Vec::new(), predicate: None };
        let (mut node, mut sample, mut is_negated) = (self.nodes.len() - 1, 0, false);
        let mut values = tree.values(node)?;
        loop {
            let (position, robustness) = (positions[node], values[sample]);
            let mut found = DecisiveSubformula {
                position,
                text: tree.text(node),
                operator: None,
                operands: Vec::new(),
                sample,
                window: None,
                robustness,
            };
            let Node::Apply(operator, interval) = self.nodes[node] else {
                diagnosis.path.push(found);
                return Ok(diagnosis);
            };
            let window = match operator.takes_interval() {
                true => clock.window(operator.name(), interval)?,
                false => Window { begin: 0, end: 0 },
            };
            found.operator = Some(operator.name());
            let range = samples(operator, window, sample, trace.len());
            found.window =
                range.clone().filter(|_| operator.takes_interval()).map(RangeInclusive::into_inner);
            let operands = tree.operands(node);
            if !operator.is_term() && !operator.is_comparison() {
                found.operands = operands.iter().map(|operand| tree.text(*operand)).collect();
            }
            let text = found.text.clone();
            diagnosis.path.push(found);
            if let Some(left) = self.scaled(node, &tree.starts) {
                (node, values) = (left, tree.values(left)?);
                continue;
            }
            if operator.is_term() {
                return Ok(diagnosis);
            }
            let mut of_operands =
                operands.iter().map(|operand| tree.values(*operand)).collect::<Result<Vec<_>, _>>()?;
            if operator.is_comparison() {
                diagnosis.predicate = Some(DecisivePredicate {
                    position,
                    text,
                    sample,
                    comparison: operator.name(),
                    sides: [operands[0], operands[1]].map(|side| tree.text(side)),
                    values: [of_operands[0][sample], of_operands[1][sample]],
                    robustness,
                    is_negated,
                });
                return Ok(diagnosis);
            }
            let (x, y) = (&of_operands[0], &of_operands[of_operands.len() - 1]);
            let Some(choice) = decisive(operator, range, sample, x, y) else { return Ok(diagnosis) };
            node = operands[choice.operand.min(operands.len() - 1)];
            values = of_operands.swap_remove(choice.operand.min(operands.len() - 1));
            sample = choice.sample;
            is_negated ^= choice.is_negated;
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
        let mut signals: Vec<String> = Vec::new();
        let mut nodes = Vec::new();
        for (node, _) in self.nodes.iter().zip(kept).filter(|(_, kept)| *kept) {
            nodes.push(match *node {
                Node::Signal(signal) => {
                    let name = &self.signals[signal as usize];
                    let index = signals.iter().position(|known| known == name).unwrap_or_else(|| {
                        signals.push(name.clone());
                        signals.len() - 1
                    });
                    Node::Signal(index as u32)
                }
                other => other,
            });
        }
        Some(Formula { signals, nodes, defined: Vec::new() })
    }
}

/// The syntax tree of a formula, with the trace and clock that its nodes are evaluated with.
struct Tree<'a> {
    formula: &'a Formula,
    starts: Vec<usize>,
    trace: &'a Trace,
    clock: &'a Clock,
}

impl Tree<'_> {
    fn text(&self, node: usize) -> String {
        std::fmt::from_fn(|f| self.formula.write_node(f, Operator::name, node, &self.starts)).to_string()
    }

    /// Returns the operands of a node, left before right.
    fn operands(&self, node: usize) -> Vec<usize> {
        let Node::Apply(operator, _) = self.formula.nodes[node] else { return Vec::new() };
        let last = node - 1;
        if operator.arity() == 2 { vec![self.starts[last] - 1, last] } else { vec![last] }
    }

    /// Returns the robustness of a node at each sample.
    fn values(&self, node: usize) -> Result<Vec<f64>, MonitorError> {
        let Formula { signals, nodes, .. } = self.formula;
        let nodes = nodes[self.starts[node]..=node].to_vec();
        let formula = Formula { signals: signals.clone(), nodes, defined: Vec::new() };
        let mut monitor = Monitor::new(&formula, self.trace.names(), *self.clock)?;
        Ok(monitor.robustness_signal(self.trace)?.to_vec())
    }
}

/// The operand and sample that determine the value of an operator.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Choice {
    /// 0 is the left operand, or the only one.
    operand: usize,
    sample: usize,
    /// Whether the value is the operand's with the opposite sign.
    is_negated: bool,
}

/// Returns the samples of an operator's window at `sample`, cut at the ends of the trace; `None` if
/// there are none.
fn samples(operator: Operator, window: Window, sample: usize, len: usize) -> Option<RangeInclusive<usize>> {
    let Window { begin, end } = window;
    let range = match operator {
        Operator::Historically | Operator::Once | Operator::Since => {
            sample.saturating_sub(end)..=sample.checked_sub(begin)?
        }
        _ => sample.checked_add(begin)?..=sample.saturating_add(end).min(len - 1),
    };
    (!range.is_empty()).then_some(range)
}

/// Returns what determines the value of an operator at sample `t`; `x` and `y` are the robustness
/// of its operands (the same for a unary one).
fn decisive(
    operator: Operator,
    range: Option<RangeInclusive<usize>>,
    t: usize,
    x: &[f64],
    y: &[f64],
) -> Option<Choice> {
    let at = |operand, sample| Choice { operand, sample, is_negated: false };
    let negated = |operand, sample| Choice { operand, sample, is_negated: true };
    Some(match operator {
        Operator::Always | Operator::Historically => at(0, least(range?, |s| x[s])),
        Operator::Eventually | Operator::Once => at(0, least(range?, |s| -x[s])),
        Operator::Next | Operator::StrongNext => at(0, (t + 1 < x.len()).then_some(t + 1)?),
        Operator::Previous | Operator::StrongPrevious => at(0, t.checked_sub(1)?),
        Operator::Rise if t > 0 && is_less(-x[t - 1], x[t]) => negated(0, t - 1),
        Operator::Rise => at(0, t),
        Operator::Fall if t > 0 && is_less(x[t - 1], -x[t]) => at(0, t - 1),
        Operator::Fall => negated(0, t),
        Operator::Not => negated(0, t),
        Operator::And => at(usize::from(is_less(y[t], x[t])), t),
        Operator::Or => at(usize::from(is_less(x[t], y[t])), t),
        Operator::Implies if !is_less(-x[t], y[t]) => negated(0, t),
        Operator::Implies => at(1, t),
        Operator::Until => until(range?, t, x, y, 1.0)?.1,
        Operator::Release => until(range?, t, x, y, -1.0)?.1,
        Operator::Unless => {
            let end = range.as_ref().map_or(x.len() - 1, |range| *range.end());
            let held = least(t..=end, |s| x[s]);
            match range.and_then(|range| until(range, t, x, y, 1.0)) {
                Some((value, choice)) if is_less(x[held], value) => choice,
                _ => at(0, held),
            }
        }
        Operator::Since => until(range?, t, x, y, 1.0)?.1,
        // The distance is that of the operand that is nearer to its border.
        Operator::Iff | Operator::Xor => {
            let operand = usize::from(y[t].abs() < x[t].abs());
            let agree = x[t].is_sign_negative() == y[t].is_sign_negative();
            let holds = agree == (operator == Operator::Iff);
            let is_negated = holds == [x[t], y[t]][operand].is_sign_negative();
            Choice { operand, sample: t, is_negated }
        }
        _ => return None,
    })
}

/// Returns whether `x` is less than `y`, with −0.0 less than +0.0.
fn is_less(x: f64, y: f64) -> bool {
    x.total_cmp(&y).is_lt()
}

/// Returns the first sample at which `value` is least.
fn least(range: RangeInclusive<usize>, value: impl Fn(usize) -> f64) -> usize {
    let first = *range.start();
    range.fold(first, |best, sample| if is_less(value(sample), value(best)) { sample } else { best })
}

/// Returns the value of `until` (`sign` 1) or `release` (`sign` -1) at `t`, and what determines it.
/// In a `range` before `t`, that of `since`.
fn until(range: RangeInclusive<usize>, t: usize, x: &[f64], y: &[f64], sign: f64) -> Option<(f64, Choice)> {
    let value = |values: &[f64], sample: usize| sign * values[sample];
    let candidates: Vec<usize> = if *range.end() < t || (*range.end() == t && *range.start() < t) {
        range.rev().collect()
    } else {
        range.collect()
    };
    let mut best: Option<(f64, Choice)> = None;
    for until in candidates {
        // The samples from t up to `until`, without the latter.
        let held = if until < t { Some(until + 1..=t) } else { (until > t).then(|| t..=until - 1) };
        let weakest = held.map(|held| least(held, |sample| value(x, sample)));
        let choice = match weakest {
            Some(weakest) if is_less(value(x, weakest), value(y, until)) => (value(x, weakest), 0, weakest),
            _ => (value(y, until), 1, until),
        };
        if best.is_none_or(|(known, _)| is_less(known, choice.0)) {
            let (found, operand, sample) = choice;
            best = Some((found, Choice { operand, sample, is_negated: false }));
        }
    }
    best.map(|(found, choice)| (sign * found, choice))
}
