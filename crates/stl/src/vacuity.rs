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
    /// Each operand of its `and` asks nothing, for reasons that differ.
    Parts,
}

impl Vacuity {
    /// Returns the number that records a finding: 0 if the formula asks something.
    pub fn code(found: Option<Vacuity>) -> u8 {
        found.map_or(0, |found| 1 + found as u8)
    }

    /// Returns the finding with a number.
    pub fn from_code(code: u8) -> Option<Vacuity> {
        let all = [Vacuity::FirstSample, Vacuity::Premise, Vacuity::NoSample, Vacuity::Parts];
        all.into_iter().find(|found| Vacuity::code(Some(*found)) == code)
    }

    /// Returns the reason in words, without a final period.
    pub fn reason(self, formula: &Formula) -> String {
        match (self, &formula.roles().1[..]) {
            (Vacuity::FirstSample, _) => "the first sample alone satisfies it, whatever follows".to_owned(),
            (Vacuity::Parts, _) => {
                let parts: Vec<String> = formula.demands().iter().map(|part| format!("`{part}`")).collect();
                format!(
                    "each of its parts {} is satisfied by the first sample, or lacks a premise that holds, or a sample",
                    parts.join(" and ")
                )
            }
            (Vacuity::NoSample, _) => {
                "no sample decides it, because its windows lie outside of the trace".to_owned()
            }
            (Vacuity::Premise, [premise]) => {
                let premise = formula.at_node(*premise);
                format!("its premise `{premise}` does not hold where what it requires could fail")
            }
            (Vacuity::Premise, _) => "its premises do not hold where what it requires could fail".to_owned(),
        }
    }
}

impl Formula {
    /// Returns the formula in which all fails that it requires beside its premises: comparisons are
    /// `false`, or `true` where they are negated. Where this holds, the formula holds and asks
    /// nothing: no consequence of an implication matters, or it lies outside of the trace. `None`
    /// without an implication outside of operators such as `not` and `until`.
    ///
    /// # Example
    /// ```
    /// use mishandle_stl::Formula;
    /// let vacuous = |text: &str| Formula::parse(text).unwrap().vacuous().map(|found| found.to_string());
    /// assert_eq!(vacuous("always(p > 0 implies q > 0)").unwrap(), "always(p > 0 implies false)");
    /// assert_eq!(vacuous("always(q > 0)"), None);
    /// // It requires that p is never positive.
    /// assert_eq!(vacuous("always(p > 0 implies false)"), None);
    /// ```
    pub fn vacuous(&self) -> Option<Formula> {
        let (roles, premises) = self.roles();
        let nodes = roles.into_iter().flatten().collect();
        // The names of signals stay, so that their numbers do.
        let found =
            Formula { signals: self.signals.clone(), nodes, origins: Vec::new(), defined: Vec::new() };
        (!premises.is_empty()).then_some(found)
    }

    /// Returns the operands of the `and` of the formula, which all have to hold; without one, the
    /// formula itself.
    ///
    /// # Example
    /// ```
    /// use mishandle_stl::Formula;
    /// let formula = Formula::parse("p > 0 and always(q > 0) and r > 0").unwrap();
    /// let parts: Vec<String> = formula.demands().iter().map(Formula::to_string).collect();
    /// assert_eq!(parts, ["p > 0", "always(q > 0)", "r > 0"]);
    /// ```
    pub fn demands(&self) -> Vec<Formula> {
        let starts = self.starts();
        let mut found = Vec::new();
        let mut open = vec![self.nodes.len() - 1];
        while let Some(node) = open.pop() {
            match self.nodes[node] {
                Node::Apply(Operator::And, _) => open.extend(self.operands(node, &starts).into_iter().rev()),
                _ => found.push(self.at_node(node)),
            }
        }
        found
    }

    /// Returns what stands for each node, `None` for a node that is left out, and the last node of
    /// each premise.
    fn roles(&self) -> (Vec<Option<Node>>, Vec<usize>) {
        use Operator::{
            Always, And, Eventually, Historically, Next, Not, Once, Or, Previous, Release, Since, StrongNext,
            StrongPrevious, Unless, Until,
        };
        let starts = self.starts();
        let reads =
            |node: usize| self.nodes[starts[node]..=node].iter().any(|node| matches!(node, Node::Signal(_)));
        let mut roles = vec![None; self.nodes.len()];
        let mut premises = Vec::new();
        // With whether it is negated, and whether its implications have premises.
        let mut open = vec![(self.nodes.len() - 1, false, true)];
        while let Some((node, is_negated, has_premises)) = open.pop() {
            let keep = |roles: &mut Vec<Option<Node>>, node: usize| {
                let part = starts[node]..=node;
                roles[part.clone()]
                    .iter_mut()
                    .zip(&self.nodes[part])
                    .for_each(|(role, node)| *role = Some(*node));
            };
            if !reads(node) {
                keep(&mut roles, node);
                continue;
            }
            let implication = self.implication(node, &starts);
            if let Some([kept, premise, consequence]) =
                implication.filter(|[.., consequence]| has_premises && reads(*consequence))
            {
                keep(&mut roles, kept);
                roles[node] = Some(self.nodes[node]);
                premises.push(premise);
                open.push((consequence, false, true));
                continue;
            }
            let (flips, goes_on) = match self.nodes[node] {
                Node::Apply(And | Or | Always | Eventually | Historically | Once, _) => (false, has_premises),
                Node::Apply(Not, _) => (true, false),
                Node::Apply(
                    Next | StrongNext | Previous | StrongPrevious | Until | Release | Unless | Since,
                    _,
                ) => (false, false),
                // No value of these operands is worst.
                _ => {
                    roles[node] =
                        Some(Node::Constant(if is_negated { f64::INFINITY } else { f64::NEG_INFINITY }));
                    continue;
                }
            };
            roles[node] = Some(self.nodes[node]);
            let operands = self.operands(node, &starts).into_iter();
            open.extend(operands.map(|operand| (operand, is_negated != flips, goes_on)));
        }
        (roles, premises)
    }

    /// Returns the operand with the premise of an implication, the premise, and the consequence.
    /// `not p or q` is one with the premise `p`.
    fn implication(&self, node: usize, starts: &[usize]) -> Option<[usize; 3]> {
        let is_negated = |node: usize| matches!(self.nodes[node], Node::Apply(Operator::Not, _));
        match (self.nodes[node], &self.operands(node, starts)[..]) {
            (Node::Apply(Operator::Implies, _), &[premise, consequence]) => {
                Some([premise, premise, consequence])
            }
            (Node::Apply(Operator::Or, _), &[left, right]) if is_negated(left) => {
                Some([left, left - 1, right])
            }
            (Node::Apply(Operator::Or, _), &[left, right]) if is_negated(right) => {
                Some([right, right - 1, left])
            }
            _ => None,
        }
    }
}
