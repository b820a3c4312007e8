//! Formulas that hold on a trace and ask nothing of it.

use crate::formula::{Formula, Node};
use crate::operator::Operator;

/// Why a formula that holds on a trace asks nothing of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Vacuity {
    /// The first sample alone satisfies it, whatever follows.
    FirstSample,
    /// It holds whatever its implications require, because their premises do not hold.
    Premise,
    /// Its windows lie outside of the trace: no sample decides it.
    NoSample,
}

impl Vacuity {
    /// Returns the number that records a finding: 0 if the formula asks something.
    pub fn code(found: Option<Vacuity>) -> u8 {
        found.map_or(0, |found| 1 + found as u8)
    }

    /// Returns the finding with a number.
    pub fn from_code(code: u8) -> Option<Vacuity> {
        let all = [Vacuity::FirstSample, Vacuity::Premise, Vacuity::NoSample];
        all.into_iter().find(|found| Vacuity::code(Some(*found)) == code)
    }

    /// Returns the reason in words, without a final period.
    pub fn reason(self, formula: &Formula) -> String {
        match (self, &formula.roles().1[..]) {
            (Vacuity::FirstSample, _) => "the first sample alone satisfies it, whatever follows".to_owned(),
            (Vacuity::NoSample, _) => {
                "no sample decides it, because its windows lie outside of the trace".to_owned()
            }
            (Vacuity::Premise, [premise]) => {
                let premise = formula.at_node(*premise);
                format!("its premise `{premise}` does not hold, so what it requires then is never asked")
            }
            (Vacuity::Premise, _) => {
                "its premises do not hold, so what it requires then is never asked".to_owned()
            }
        }
    }
}

/// The part of a node in the formula without its conclusions.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Role {
    Kept,
    False,
    LeftOut,
}

impl Formula {
    /// Returns the formula with `false` instead of all that it requires beside its premises. Where
    /// this holds, the formula holds and asks nothing: no consequence of an implication matters.
    /// `None` without an implication outside of operators such as `not` and `until`.
    ///
    /// # Example
    /// ```
    /// use mishandle_stl::Formula;
    /// let vacuous = |text: &str| Formula::parse(text).unwrap().vacuous().map(|found| found.to_string());
    /// assert_eq!(vacuous("always(p > 0 implies q > 0)").unwrap(), "always(p > 0 implies false)");
    /// assert_eq!(vacuous("always(q > 0)"), None);
    /// ```
    pub fn vacuous(&self) -> Option<Formula> {
        let (roles, premises) = self.roles();
        let node = |(node, role): (&Node, &Role)| match role {
            Role::Kept => Some(*node),
            Role::False => Some(Node::Constant(f64::NEG_INFINITY)),
            Role::LeftOut => None,
        };
        let nodes = self.nodes.iter().zip(&roles).filter_map(node).collect();
        // The names of signals stay, so that their numbers do.
        let found =
            Formula { signals: self.signals.clone(), nodes, origins: Vec::new(), defined: Vec::new() };
        (!premises.is_empty()).then_some(found)
    }

    /// Returns the role of each node, and the last node of each premise.
    fn roles(&self) -> (Vec<Role>, Vec<usize>) {
        let starts = self.starts();
        let mut roles = vec![Role::LeftOut; self.nodes.len()];
        let mut premises = Vec::new();
        let mut open = vec![self.nodes.len() - 1];
        while let Some(node) = open.pop() {
            use Operator::{Always, And, Eventually, Historically, Implies, Once, Or};
            roles[node] = match self.nodes[node] {
                Node::Apply(Implies, _) => {
                    let consequence = node - 1;
                    let premise = starts[consequence] - 1;
                    roles[starts[premise]..=premise].fill(Role::Kept);
                    premises.push(premise);
                    open.push(consequence);
                    Role::Kept
                }
                // `not p or q` is `p implies q`.
                Node::Apply(Or, _) if self.negation(node, &starts).is_some() => {
                    let [negated, consequence] = self.negation(node, &starts).unwrap_or_default();
                    roles[starts[negated]..=negated].fill(Role::Kept);
                    premises.push(negated - 1);
                    open.push(consequence);
                    Role::Kept
                }
                Node::Apply(And | Or | Always | Eventually | Historically | Once, _) => {
                    open.extend(self.operands(node, &starts));
                    Role::Kept
                }
                _ => Role::False,
            };
        }
        (roles, premises)
    }
    /// Returns the negated operand of an `or`, the left one if both are, and the other one.
    fn negation(&self, node: usize, starts: &[usize]) -> Option<[usize; 2]> {
        let is_negated = |node: usize| matches!(self.nodes[node], Node::Apply(Operator::Not, _));
        match self.operands(node, starts)[..] {
            [left, right] if is_negated(left) => Some([left, right]),
            [left, right] if is_negated(right) => Some([right, left]),
            _ => None,
        }
    }
}
