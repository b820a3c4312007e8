//! Formulas that ask about the first sample only.

use mishandle_stl::Formula;

use super::Found;
use crate::describe::Context;
use crate::tree::{Tree, is_temporal, looks_ahead};

pub(super) fn find(tree: &Tree<'_>, context: &Context, found: &mut Found<'_>) {
    // Operators that group otherwise than meant come first: with parentheses, other parts are left.
    if found.has_warning("precedence") {
        return;
    }
    if !context.at_every_sample {
        at_start(tree, found);
    }
    falls(tree, found);
}

/// Finds edges that the first sample has although nothing fell.
fn falls(tree: &Tree<'_>, found: &mut Found<'_>) {
    for node in (0..tree.nodes.len()).filter(|node| tree.operator(*node) == Some("fall")) {
        let operand = tree.text(tree.nodes[node].operands[0]);
        let text = tree.text(node);
        found.note(
            "fall-at-the-start",
            node,
            format!("`{text}` also holds at the first sample of a trace that begins without `{operand}`"),
            Some(format!("prev({operand}) and not ({operand}), which fails at the first sample")),
        );
    }
}

/// Finds the parts that are evaluated at sample 0 only: no operator looks ahead in them.
pub(super) fn at_start(tree: &Tree<'_>, found: &mut Found<'_>) {
    let root = tree.nodes.len() - 1;
    let is_ahead = tree.has(looks_ahead);
    let mut open = vec![root];
    while let Some(node) = open.pop() {
        let operands = &tree.nodes[node].operands;
        match tree.operator(node).unwrap_or_default() {
            // Of `p since q`, the first sample has only `q` behind it.
            "since" if !is_ahead[operands[1]] => past(tree, node, found),
            _ if looks_back(tree, node) && !is_ahead[node] => past(tree, node, found),
            "not" if is_ahead[node] || looks_back(tree, operands[0]) => open.extend(operands),
            _ if !is_ahead[node] => {
                let text = tree.text(node);
                let why = format!("no operator over time is around `{text}`: only the first sample counts");
                let instead = Some(format!("always({text}), or eventually({text})"));
                // Beside a part that looks further, it is often meant as a start condition.
                if node != root && tree.operator(root) == Some("and") {
                    found.note("first-sample-only", node, why, instead);
                } else {
                    found.warn("first-sample-only", node, why, instead);
                }
            }
            "implies" if !is_ahead[operands[0]] => {
                let [condition, consequence] = [operands[0], operands[1]].map(|node| tree.text(node));
                found.warn(
                    "first-sample-only",
                    operands[0],
                    format!(
                        "the condition `{condition}` is looked at once, at the first sample, and not each time it holds"
                    ),
                    Some(format!("always({condition} implies {consequence})")),
                );
            }
            "and" | "or" | "implies" | "iff" | "xor" => open.extend(operands.iter().rev()),
            _ => {}
        }
    }
}

/// Returns what has to hold at some sample and to fail at another one, so that a trace shows that
/// only the first one counts.
pub(crate) fn shown(tree: &Tree<'_>) -> Vec<Formula> {
    let mut found = Found::new(tree);
    at_start(tree, &mut found);
    let part = |node: usize| match tree.nodes[node].operands.last() {
        Some(operand) if looks_back(tree, node) => *operand,
        _ => node,
    };
    found.nodes.iter().map(|node| tree.formula.at_node(part(*node))).collect()
}

/// Returns whether the node is an operator over earlier samples.
fn looks_back(tree: &Tree<'_>, node: usize) -> bool {
    tree.operator(node).is_some_and(|name| is_temporal(name) && !looks_ahead(name))
}

/// Warns about an operator that looks back from sample 0.
fn past(tree: &Tree<'_>, node: usize, found: &mut Found<'_>) {
    let name = tree.operator(node).unwrap_or_default();
    let operand = tree.text(*tree.nodes[node].operands.last().unwrap_or(&node));
    let text = tree.text(node);
    let instead = match name {
        "historically" => format!("always({operand})"),
        "once" => format!("eventually({operand})"),
        _ => format!("always({text})"),
    };
    found.warn(
        "past-at-the-start",
        node,
        format!("`{name}` looks back from the first sample, before which nothing is: no later sample counts"),
        Some(instead),
    );
}
