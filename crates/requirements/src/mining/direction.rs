//! Whether a greater value of a parameter makes a formula easier or harder to satisfy.

use mishandle_results::Tightest;
use mishandle_stl::{Formula, Position, SyntaxBound, SyntaxKind};
use mishandle_text::number_text;

use crate::error::{RequirementError, Result};
use crate::tree::Tree;

/// The effect of a parameter on the value of a node: the places at which a greater parameter makes
/// it greater, and less.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Effect {
    up: Option<usize>,
    down: Option<usize>,
}

impl Effect {
    fn flipped(self) -> Effect {
        Effect { up: self.down, down: self.up }
    }

    fn and(self, other: Effect) -> Effect {
        Effect { up: self.up.or(other.up), down: self.down.or(other.down) }
    }

    fn is_some(self) -> bool {
        self.up.is_some() || self.down.is_some()
    }

    /// Returns the effect through an operator that is not monotone.
    fn through(self, node: usize) -> Effect {
        if self.is_some() { Effect { up: Some(node), down: Some(node) } } else { self }
    }
}

/// Returns the tightest end of a parameter. `shown` is the formula with the names of parameters
/// that are not a bound, for messages.
///
/// # Errors
/// If the formula does not read the parameter, or a greater value can make it both easier and
/// harder to satisfy.
pub(super) fn tightest(formula: &Formula, shown: &Formula, parameter: usize, name: &str) -> Result<Tightest> {
    let tree = Tree::new(formula);
    let mut effects: Vec<Effect> = Vec::with_capacity(tree.nodes.len());
    let mut is_nonnegative: Vec<bool> = Vec::with_capacity(tree.nodes.len());
    for index in 0..tree.nodes.len() {
        let effect = effect(&tree, index, parameter, &effects, &is_nonnegative);
        effects.push(effect);
        let of = |n: usize| is_nonnegative[tree.nodes[index].operands[n]];
        is_nonnegative.push(match tree.nodes[index].kind {
            // The sign of a parameter is that of its range, which the formula does not know.
            SyntaxKind::Number(value) => value >= 0.0 && tree.nodes[index].parameter.is_none(),
            SyntaxKind::Operator("abs" | "sqrt" | "exp") => true,
            SyntaxKind::Operator("+" | "*" | "/") => of(0) && of(1),
            _ => false,
        });
    }
    let place = |node: usize| {
        let at = tree.at(node).map_or(String::new(), |at: Position| format!(" ({at})"));
        let is_own = |bound: &SyntaxBound| bound.parameter == Some(parameter);
        let text = match &tree.nodes[node].interval {
            Some(bounds) if bounds.iter().any(is_own) => {
                let bound = |bound: &SyntaxBound| {
                    if is_own(bound) { name.to_owned() } else { number_text(bound.value) }
                };
                format!(
                    "{}[{}:{}]",
                    tree.operator(node).unwrap_or_default(),
                    bound(&bounds[0]),
                    bound(&bounds[1])
                )
            }
            _ => shown.at_node(node).to_string(),
        };
        format!("`{text}`{at}")
    };
    match effects.last().copied().unwrap_or_default() {
        Effect { up: None, down: None } => {
            Err(RequirementError::Question(format!("the formula does not depend on the parameter `{name}`")))
        }
        Effect { up: Some(_), down: None } => Ok(Tightest::Low),
        Effect { up: None, down: Some(_) } => Ok(Tightest::High),
        Effect { up: Some(up), down: Some(down) } if up == down => Err(RequirementError::Question(format!(
            "a greater `{name}` can make {} both greater and less: its tightest value is not at one end of what holds",
            place(up)
        ))),
        Effect { up: Some(up), down: Some(down) } => Err(RequirementError::Question(format!(
            "a greater `{name}` makes the formula easier to satisfy at {} and harder at {}; use two parameters",
            place(up),
            place(down)
        ))),
    }
}

fn effect(
    tree: &Tree<'_>,
    index: usize,
    parameter: usize,
    effects: &[Effect],
    is_nonnegative: &[bool],
) -> Effect {
    let node = &tree.nodes[index];
    let name = match node.kind {
        SyntaxKind::Number(_) if node.parameter == Some(parameter) => {
            return Effect { up: Some(index), down: None };
        }
        SyntaxKind::Number(_) | SyntaxKind::Signal(_) => return Effect::default(),
        SyntaxKind::Operator(name) => name,
    };
    let first = effects[node.operands[0]];
    let last = effects[node.operands[node.operands.len() - 1]];
    let is_unary = node.operands.len() == 1;
    let operands = match name {
        "-" if is_unary => first.flipped(),
        "-" | ">=" | ">" => first.and(last.flipped()),
        "<=" | "<" => first.flipped().and(last),
        "not" => first.flipped(),
        "implies" => first.flipped().and(last),
        "*" | "/" => scaled(tree, index, name, [first, last], is_nonnegative),
        "abs" | "pow" | "==" | "!==" | "iff" | "xor" | "rise" | "fall" => first.and(last).through(index),
        // Sums, logic, windows over operands, and increasing functions.
        _ => first.and(last),
    };
    let Some([begin, end]) = node.interval else { return operands };
    let is_own = |bound: Option<usize>| bound == Some(parameter);
    // A longer window of `always` has more samples to fail, one of `eventually` more to succeed.
    let is_universal = matches!(name, "always" | "historically" | "release" | "unless");
    let at = |is_one: bool| is_one.then_some(index);
    let mut found = operands;
    if is_own(end.parameter) {
        found = found.and(Effect { up: at(!is_universal), down: at(is_universal) });
    }
    if is_own(begin.parameter) {
        // `unless` waits for its right operand like `until`.
        let is_relaxed = is_universal && name != "unless";
        found = found.and(Effect { up: at(is_relaxed), down: at(!is_relaxed) });
    }
    found
}

/// Returns the effect through a product or quotient.
fn scaled(
    tree: &Tree<'_>,
    index: usize,
    name: &str,
    [first, last]: [Effect; 2],
    is_nonnegative: &[bool],
) -> Effect {
    let [left, right] = [tree.nodes[index].operands[0], tree.nodes[index].operands[1]];
    let by = |effect: Effect, factor: usize| match tree.number(factor) {
        Some(factor) if factor < 0.0 => effect.flipped(),
        _ if is_nonnegative[factor] => effect,
        _ => effect.through(index),
    };
    match (first.is_some(), last.is_some()) {
        (false, false) => Effect::default(),
        (true, false) => by(first, right),
        (false, true) if name == "*" => by(last, left),
        _ => first.and(last).through(index),
    }
}
