//! Implications whose condition says nothing.

use mishandle_stl::{Formula, Monitor, is_satisfied};

use super::Found;
use crate::describe::Context;
use crate::ranges::Analysis;
use crate::tree::Tree;

pub(super) fn find(tree: &Tree<'_>, context: &Context, analysis: &Analysis, found: &mut Found<'_>) {
    once(tree, found);
    for node in tree.antecedents() {
        let condition = tree.text(node);
        let is_impossible = analysis.holds[node].is_empty();
        let is_certain = analysis.fails[node].is_empty();
        if is_impossible {
            found.warn(
                "vacuous-implication",
                node,
                format!("the condition `{condition}` can never hold, so the implication always does"),
                Some("a condition that some trace satisfies".to_owned()),
            );
        } else if is_certain {
            found.warn(
                "condition-always-holds",
                node,
                format!("the condition `{condition}` always holds, so it can be left out"),
                tree.parents[node].map(|parent| tree.text(tree.nodes[parent].operands[1])),
            );
        } else {
            unmet(tree, context, node, found);
        }
        if let Some(eventually) = eventually(tree, node) {
            found.warn(
                "eventually-as-condition",
                eventually,
                "the condition looks ahead: the consequence is required already before it holds, at every sample from \
                 which it still comes"
                    .to_owned(),
                Some(format!(
                    "once({0}) implies ..., or rise({0}) implies ...",
                    tree.text(*tree.nodes[eventually].operands.last().unwrap_or(&eventually))
                )),
            );
        }
    }
}

/// Returns condition and consequence of an implication. `not p or q` is one; `q or not p` names
/// what may come instead, as "the response or the end of the scope".
fn implication(tree: &Tree<'_>, node: usize) -> Option<[usize; 2]> {
    let &[left, right] = &tree.nodes[node].operands[..] else { return None };
    match tree.operator(node)? {
        "implies" => Some([left, right]),
        "or" if tree.operator(left) == Some("not") => Some([tree.nodes[left].operands[0], right]),
        _ => None,
    }
}

/// Returns the operators whose operand is an implication that has to hold once, with its condition
/// and consequence.
fn of_once(tree: &Tree<'_>) -> Vec<(usize, [usize; 2])> {
    let is_negated = tree.negated();
    let of_one = |node: usize| {
        let is_once = matches!(tree.operator(node)?, "eventually" | "once" | "until" | "since");
        let operand = *tree.nodes[node].operands.last()?;
        let found = implication(tree, operand).filter(|_| is_once && !is_negated[node])?;
        Some((node, found))
    };
    (0..tree.nodes.len()).filter_map(of_one).collect()
}

/// Returns what has to hold at some sample and to fail at another one, so that a trace shows an
/// implication that has to hold once.
pub(crate) fn shown(tree: &Tree<'_>) -> Vec<Formula> {
    let failing = |(_, implication): (usize, [usize; 2])| {
        let [condition, consequence] = implication.map(|node| tree.text(node));
        Formula::parse(&format!("({condition}) and not ({consequence})")).ok()
    };
    of_once(tree).into_iter().filter_map(failing).collect()
}

/// Finds implications that have to hold once: a sample at which the condition fails is enough.
fn once(tree: &Tree<'_>, found: &mut Found<'_>) {
    for (node, implication) in of_once(tree) {
        let name = tree.operator(node).unwrap_or_default();
        let [condition, consequence] = implication.map(|node| tree.text(node));
        let window = tree.window(node);
        let instead = match name {
            "eventually" => {
                format!(
                    "eventually{window}({condition} and {consequence}), or always({condition} implies eventually{window}({consequence}))"
                )
            }
            _ => format!("({condition} and {consequence}) in place of the implication"),
        };
        found.warn(
            "eventually-implies",
            node,
            format!(
                "a sample at which `{condition}` fails satisfies `{name}`: the consequence is never required"
            ),
            Some(instead),
        );
    }
}

/// Returns an `eventually` or `until` on which a condition depends.
fn eventually(tree: &Tree<'_>, condition: usize) -> Option<usize> {
    let mut open = vec![condition];
    while let Some(node) = open.pop() {
        match tree.operator(node) {
            Some("eventually" | "until") => return Some(node),
            Some("and" | "or") => open.extend(&tree.nodes[node].operands),
            _ => {}
        }
    }
    None
}

/// Warns about a condition that holds at no sample of the traces.
fn unmet(tree: &Tree<'_>, context: &Context, node: usize, found: &mut Found<'_>) {
    let unmet: Vec<&str> = context
        .traces
        .iter()
        .filter(|(_, trace)| {
            let formula = tree.formula.at_node(node);
            let monitor = Monitor::new(&formula, trace.names(), context.clock());
            let values = monitor.and_then(|mut monitor| {
                Ok(monitor.robustness_signal(trace)?.iter().any(|value| is_satisfied(*value)))
            });
            matches!(values, Ok(false))
        })
        .map(|(name, _)| name.as_str())
        .collect();
    if unmet.is_empty() {
        return;
    }
    let condition = tree.text(node);
    let all = unmet.len() == context.traces.len();
    let whose = match (all, unmet.len()) {
        (true, 1) => format!("at no sample of {}", unmet[0]),
        (true, n) => format!("at no sample of any of the {n} traces"),
        (false, n) => format!("at no sample of {n} of {} traces", context.traces.len()),
    };
    let why = format!(
        "the condition `{condition}` holds {whose}, which therefore satisfies the implication without a test"
    );
    let instead =
        Some("a trace in which the condition holds, or a condition that these traces meet".to_owned());
    if all {
        found.warn("vacuous-implication", node, why, instead);
    } else {
        found.note("vacuous-implication", node, why, instead);
    }
}
