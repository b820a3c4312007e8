//! A formula as a tree of operators, with what the analyses of this crate ask about it.

use mishandle_stl::{Formula, Position, SyntaxBound, SyntaxKind, SyntaxNode, TimeUnit};

/// The syntax tree of a formula. Operands come before their operator.
pub(crate) struct Tree<'a> {
    pub formula: &'a Formula,
    pub nodes: Vec<SyntaxNode<'a>>,
    /// The operator of which each node is an operand; `None` for the root.
    pub parents: Vec<Option<usize>>,
}

impl<'a> Tree<'a> {
    pub fn new(formula: &'a Formula) -> Tree<'a> {
        let nodes = formula.syntax();
        let mut parents = vec![None; nodes.len()];
        for (index, node) in nodes.iter().enumerate() {
            node.operands.iter().for_each(|operand| parents[*operand] = Some(index));
        }
        Tree { formula, nodes, parents }
    }

    /// Returns the operator of a node, such as `always`.
    pub fn operator(&self, node: usize) -> Option<&'static str> {
        match self.nodes[node].kind {
            SyntaxKind::Operator(name) => Some(name),
            _ => None,
        }
    }

    pub fn number(&self, node: usize) -> Option<f64> {
        match self.nodes[node].kind {
            SyntaxKind::Number(value) => Some(value),
            _ => None,
        }
    }

    /// Returns the text of a sub-formula or term.
    pub fn text(&self, node: usize) -> String {
        self.formula.at_node(node).to_string()
    }

    /// Returns the window of an operator as the formula prints it, such as `[0s:2s]`.
    pub fn window(&self, node: usize) -> String {
        let text = self.nodes[node].interval.map_or(String::new(), |_| self.text(node));
        text.find('[').zip(text.find(']')).map_or(String::new(), |(a, b)| text[a..=b].to_owned())
    }

    pub fn at(&self, node: usize) -> Option<Position> {
        self.nodes[node].at
    }

    /// Returns for each node whether its value is a number for a comparison or for arithmetic above
    /// it, also through an operator such as `prev`.
    pub fn inside_numbers(&self) -> Vec<bool> {
        let mut found = vec![false; self.nodes.len()];
        for node in (0..self.nodes.len()).rev() {
            if let Some(parent) = self.parents[node] {
                let is_one = self.nodes[parent].is_term || self.operator(parent).is_some_and(is_comparison);
                found[node] = found[parent] || is_one;
            }
        }
        found
    }

    /// Returns for each node whether a temporal operator is in it.
    pub fn has_time(&self) -> Vec<bool> {
        self.has(is_temporal)
    }

    /// Returns for each node whether an operator of this kind is in it.
    pub fn has(&self, is_one: impl Fn(&str) -> bool) -> Vec<bool> {
        let mut found = vec![false; self.nodes.len()];
        for node in 0..self.nodes.len() {
            let own = self.operator(node).is_some_and(&is_one);
            found[node] = own || self.nodes[node].operands.iter().any(|operand| found[*operand]);
        }
        found
    }

    /// Returns for each node whether `not` and conditions of implications negate it in all.
    pub fn negated(&self) -> Vec<bool> {
        let mut found = vec![false; self.nodes.len()];
        for node in (0..self.nodes.len()).rev() {
            let Some(parent) = self.parents[node] else { continue };
            let flips = match self.operator(parent) {
                Some("not") => true,
                Some("implies") => self.nodes[parent].operands[0] == node,
                _ => false,
            };
            found[node] = found[parent] != flips;
        }
        found
    }

    /// Returns the operators around a node, the nearest one first.
    pub fn ancestors(&self, node: usize) -> impl Iterator<Item = usize> {
        std::iter::successors(self.parents[node], |parent| self.parents[*parent])
    }

    /// Returns the conditions of implications.
    pub fn antecedents(&self) -> impl Iterator<Item = usize> {
        (0..self.nodes.len())
            .filter(|node| self.operator(*node) == Some("implies"))
            .map(|node| self.nodes[node].operands[0])
    }

    /// Returns whether the node has a window ahead without an end.
    pub fn is_unbounded(&self, node: usize) -> bool {
        self.nodes[node].interval.is_none_or(|[_, end]| end.value.is_infinite())
    }
}

pub(crate) fn is_comparison(name: &str) -> bool {
    matches!(name, "<=" | ">=" | "<" | ">" | "==" | "!==")
}

/// Returns whether the value at a sample depends on other samples.
pub(crate) fn is_temporal(name: &str) -> bool {
    takes_interval(name) || matches!(name, "next" | "prev" | "s_next" | "s_prev" | "rise" | "fall")
}

pub(crate) fn takes_interval(name: &str) -> bool {
    matches!(
        name,
        "always" | "eventually" | "historically" | "once" | "until" | "release" | "unless" | "since"
    )
}

/// Returns whether the operator is one over the future with an interval.
pub(crate) fn is_ahead(name: &str) -> bool {
    matches!(name, "always" | "eventually" | "until" | "release" | "unless")
}

/// Returns whether the value at a sample depends on later samples.
pub(crate) fn looks_ahead(name: &str) -> bool {
    is_ahead(name) || matches!(name, "next" | "s_next")
}

/// Returns the seconds of a bound; `None` if it counts samples.
pub(crate) fn seconds(bound: SyntaxBound, unit: Option<TimeUnit>) -> Option<f64> {
    let per_second = match bound.unit.or(unit)? {
        TimeUnit::Seconds => 1.0,
        TimeUnit::Milliseconds => 1e3,
        TimeUnit::Microseconds => 1e6,
        TimeUnit::Nanoseconds => 1e9,
    };
    Some(bound.value / per_second)
}
