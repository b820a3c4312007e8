//! Formulas that ask about the first sample only, and formulas that a missing sample decides.

use std::sync::Arc;

use mishandle_stl::{Formula, Monitor, Trace};

use super::Found;
use crate::describe::Context;
use crate::tree::{Tree, is_comparison, is_temporal, looks_ahead};

pub(super) fn find(tree: &Tree<'_>, context: &Context, found: &mut Found<'_>) {
    // Operators that group otherwise than meant come first: with parentheses, other parts are left.
    if found.has_warning("precedence") {
        return;
    }
    if !context.at_every_sample {
        at_start(tree, found);
    }
    neighbors(tree, context, found);
}

/// Finds the parts that are evaluated at sample 0 only: no operator looks ahead in them.
pub(super) fn at_start(tree: &Tree<'_>, found: &mut Found<'_>) {
    let root = tree.nodes.len() - 1;
    let is_ahead = tree.has(looks_ahead);
    let mut open = vec![root];
    while let Some(node) = open.pop() {
        let operands = &tree.nodes[node].operands;
        match tree.operator(node).unwrap_or_default() {
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

/// Finds comparisons of a number with its neighbor outside of the trace, which is infinite: where
/// that fails the comparison, it decides the formula at the first or the last sample.
fn neighbors(tree: &Tree<'_>, context: &Context, found: &mut Found<'_>) {
    let is_number = tree.inside_numbers();
    let is_negated = tree.negated();
    let ends = Ends::new(tree);
    let mut is_reported = vec![false; tree.nodes.len()];
    for node in 0..tree.nodes.len() {
        let Some(name @ ("prev" | "s_prev" | "next" | "s_next")) = tree.operator(node) else { continue };
        let mut comparison = node;
        while let Some(parent) = tree.parents[comparison].filter(|_| is_number[comparison]) {
            comparison = parent;
        }
        let is_first = name.ends_with("prev");
        let is_reached = if is_first { ends.first[comparison] } else { ends.last[comparison] };
        let is_compared = is_number[node] && tree.operator(comparison).is_some_and(is_comparison);
        if !is_compared || !is_reached || std::mem::replace(&mut is_reported[comparison], true) {
            continue;
        }
        let fails = if is_negated[comparison] { f64::INFINITY } else { f64::NEG_INFINITY };
        if infinite_value(tree, context, comparison, is_first) != Some(fails) {
            continue;
        }
        let text = tree.text(comparison);
        let decides =
            format!("is infinite there: this decides `{text}`, whatever the values of the signals are");
        if is_first {
            found.warn(
                "no-neighbor",
                node,
                format!("`{name}` has no sample before the first one, and {decides}"),
                Some(format!("a window from the second sample on, such as always[1:inf]({text})")),
            );
        } else {
            found.note(
                "no-neighbor",
                node,
                format!("`{name}` has no sample after the last one, and {decides}"),
                Some(
                    "`prev` in a window from the second sample on, or the setting `log.strict-horizon`"
                        .to_owned(),
                ),
            );
        }
    }
}

/// Returns the value of a comparison at the first or last sample, if it is the same infinity on
/// several traces.
fn infinite_value(tree: &Tree<'_>, context: &Context, comparison: usize, is_first: bool) -> Option<f64> {
    let formula = tree.formula.at_node(comparison);
    let names: Arc<[String]> = formula.signals().into_iter().map(str::to_owned).collect();
    let mut monitor = Monitor::new(&formula, &names, context.clock()).ok()?;
    let mut value = |level: f64| {
        let column = |signal: usize| vec![level + signal as f64; 3];
        let trace = Trace::from_columns(Arc::clone(&names), (0..names.len()).map(column).collect());
        let values = monitor.robustness_signal(&trace).ok()?;
        let value = if is_first { values.first() } else { values.last() };
        value.copied().filter(|value| value.is_infinite())
    };
    let found = value(1.0)?;
    [-7.5, 30.0].into_iter().all(|level| value(level) == Some(found)).then_some(found)
}

/// Whether each node is evaluated at the first and at the last sample of each trace, under
/// operators that require all samples.
struct Ends {
    first: Vec<bool>,
    last: Vec<bool>,
}

impl Ends {
    fn new(tree: &Tree<'_>) -> Ends {
        let is_negated = tree.negated();
        let mut first = vec![true; tree.nodes.len()];
        let mut last = vec![false; tree.nodes.len()];
        for node in (0..tree.nodes.len()).rev() {
            let Some(parent) = tree.parents[node] else { continue };
            let name = tree.operator(parent).unwrap_or_default();
            let begins_now = tree.nodes[parent].interval.is_none_or(|[begin, _]| begin.value == 0.0);
            let requires_all = if is_negated[parent] {
                matches!(name, "eventually" | "once")
            } else {
                matches!(name, "always" | "historically")
            };
            (first[node], last[node]) = match name {
                "always" | "eventually" if requires_all => {
                    (first[parent] && begins_now, tree.is_unbounded(parent))
                }
                "historically" | "once" if requires_all => {
                    (first[parent] && begins_now, last[parent] && begins_now)
                }
                _ if is_temporal(name) || matches!(name, "iff" | "xor") => (false, false),
                _ => (first[parent], last[parent]),
            };
        }
        Ends { first, last }
    }
}
