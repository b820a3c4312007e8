//! The predicates of a formula, and the formula over their values.

use crate::formula::{Formula, Node};

impl Formula {
    /// Returns the formula with a signal in place of each predicate, and the predicates in the same
    /// order: comparisons, and signals or terms that are operands of a logical or temporal
    /// operator. The values of the predicates are the signals `predicate_1`, `predicate_2` and so
    /// on. A predicate that occurs twice is listed twice.
    ///
    /// Over the values of the predicates, the robustness is made of minima, maxima and changes of
    /// sign only. So it changes at most as much as the predicate that changes most, at the sample
    /// where it does, and its sign does not depend on positive factors of the predicates.
    ///
    /// # Example
    /// ```
    /// use mishandle_stl::Formula;
    /// let formula = Formula::parse("always(a <= 1 and eventually[0:2] (a + b >= 0 or safe))").unwrap();
    /// let (skeleton, predicates) = formula.skeleton();
    /// assert_eq!(
    ///     skeleton.to_string(),
    ///     "always(predicate_1 and eventually[0:2](predicate_2 or predicate_3))"
    /// );
    /// let texts: Vec<String> = predicates.iter().map(Formula::to_string).collect();
    /// assert_eq!(texts, ["a <= 1", "a + b >= 0", "safe"]);
    /// ```
    pub fn skeleton(&self) -> (Formula, Vec<Formula>) {
        let starts = self.starts();
        // Whether a node is the last one of a predicate, found from the root.
        let mut ends = vec![false; self.nodes.len()];
        let mut open = vec![self.nodes.len() - 1];
        while let Some(node) = open.pop() {
            match self.nodes[node] {
                Node::Apply(operator, _) if !operator.is_term() && !operator.is_comparison() => {
                    let last = node - 1;
                    open.push(last);
                    if operator.arity() == 2 {
                        open.push(starts[last] - 1);
                    }
                }
                Node::Constant(_) => {}
                _ => ends[node] = true,
            }
        }
        let mut nodes = Vec::new();
        let mut predicates = Vec::new();
        let mut node = 0;
        while node < self.nodes.len() {
            // The outermost predicate that begins here, if any.
            let end = (node..self.nodes.len()).rev().find(|end| ends[*end] && starts[*end] == node);
            match end {
                Some(end) => {
                    nodes.push(Node::Signal(predicates.len() as u32));
                    predicates.push(self.part(node, end));
                    node = end + 1;
                }
                None => {
                    nodes.push(self.nodes[node]);
                    node += 1;
                }
            }
        }
        let signals = (1..=predicates.len()).map(|number| format!("predicate_{number}")).collect();
        (Formula { signals, nodes, origins: Vec::new(), defined: Vec::new() }, predicates)
    }

    /// Returns the sub-formula of these nodes.
    pub(crate) fn part(&self, first: usize, last: usize) -> Formula {
        let mut signals: Vec<String> = Vec::new();
        let mut own = |node: &Node| match node {
            Node::Signal(signal) => {
                let name = &self.signals[*signal as usize];
                let index = signals.iter().position(|known| known == name).unwrap_or_else(|| {
                    signals.push(name.clone());
                    signals.len() - 1
                });
                Node::Signal(index as u32)
            }
            other => *other,
        };
        let nodes = self.nodes[first..=last].iter().map(&mut own).collect();
        Formula { signals, nodes, origins: Vec::new(), defined: Vec::new() }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::{Clock, Monitor, Trace};

    /// The robustness of the skeleton over the values of the predicates is that of the formula;
    /// with positive factors it has the same sign.
    #[test]
    fn a_skeleton_over_its_predicates_has_the_robustness_of_the_formula() {
        let names = vec!["a".to_string(), "b".to_string()];
        let mut trace = Trace::new(names.clone().into());
        for step in 0..12 {
            let t = f64::from(step);
            trace.push(&[(1.3 * t).sin(), 0.2 * t - 1.0]);
        }
        for text in [
            "a >= 0",
            "b",
            "always(a + b <= 1 and b >= -3)",
            "eventually[1:4](a >= 0.9 and not (b >= 0))",
            "(a <= 0.5) until[0:6] (b >= -0.2 or abs(a) <= 0.1)",
            "always(a >= 0.9 implies eventually[0:3] (b >= a)) or true",
            "(a >= 0 iff b >= 0) xor (once (a <= b))",
            "next (rise(a >= 0.5)) release b",
            "0.2 <= a <= 0.3",
        ] {
            let formula = Formula::parse(text).unwrap();
            let (skeleton, predicates) = formula.skeleton();
            let values = |formula: &Formula, names: &[String], trace: &Trace| {
                let mut monitor = Monitor::new(formula, names, Clock::steps(1.0)).unwrap();
                monitor.robustness_signal(trace).unwrap().to_vec()
            };
            let columns: Vec<Vec<f64>> =
                predicates.iter().map(|predicate| values(predicate, &names, &trace)).collect();
            let expected = values(&formula, &names, &trace);
            for factor in [1.0, 3.0] {
                let mut parts = Trace::new(skeleton.signals.clone().into());
                for step in 0..trace.len() {
                    let of = |(index, column): (usize, &Vec<f64>)| {
                        column[step] * if index == 0 { factor } else { 1.0 }
                    };
                    parts.push(&columns.iter().enumerate().map(of).collect::<Vec<_>>());
                }
                let found = values(&skeleton, &skeleton.signals, &parts);
                if factor == 1.0 {
                    assert_eq!(found, expected, "{text}");
                }
                let signs = |values: &[f64]| values.iter().map(|x| x.is_sign_negative()).collect::<Vec<_>>();
                assert_eq!(signs(&found), signs(&expected), "{text}");
            }
        }
    }
}
