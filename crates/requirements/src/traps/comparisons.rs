//! Comparisons that always or never hold, equality of measured numbers, and chained comparisons.

use mishandle_stl::SyntaxKind;

use super::Found;
use crate::describe::Context;
use crate::ranges::Analysis;
use crate::tree::{Tree, is_comparison};

/// Finds parts that always or never hold, whatever the values of the signals are. Only the
/// innermost one is reported.
pub(super) fn constant(tree: &Tree<'_>, analysis: &Analysis, found: &mut Found<'_>) {
    let always = |node: usize| analysis.fails[node].is_empty();
    let never = |node: usize| analysis.holds[node].is_empty();
    // Reported as conditions, with all parts of them.
    let mut is_reported = vec![false; tree.nodes.len()];
    tree.antecedents().filter(|node| always(*node) || never(*node)).for_each(|node| is_reported[node] = true);
    for node in (0..tree.nodes.len()).rev() {
        is_reported[node] |= tree.parents[node].is_some_and(|parent| is_reported[parent]);
    }
    for (index, node) in tree.nodes.iter().enumerate() {
        let SyntaxKind::Operator(name) = node.kind else { continue };
        if node.is_term || !(always(index) || never(index)) || is_reported[index] {
            continue;
        }
        let holds = always(index);
        let verb = if holds { "always holds" } else { "never holds" };
        if is_comparison(name) {
            let why = format!("`{}` {verb}, whatever the values of the signals are", tree.text(index));
            found.warn("constant-comparison", index, why, Some("a limit that some values exceed".to_owned()));
            continue;
        }
        let inner = node.operands.iter().any(|operand| always(*operand) || never(*operand));
        if inner {
            continue;
        }
        let why = match (name, holds) {
            ("and", false) => "its parts contradict each other, so it never holds".to_owned(),
            ("or", true) => "its parts cover all values, so it always holds".to_owned(),
            ("implies", true) => {
                "its condition is stronger than its consequence, so it always holds".to_owned()
            }
            _ => format!("it {verb}, whatever the values of the signals are"),
        };
        let name = if holds { "always-true" } else { "contradiction" };
        found.warn(
            name,
            index,
            why,
            Some("check the limits and the direction of the comparisons".to_owned()),
        );
    }
}

/// Finds `==` and `!=` of numbers that are measured.
pub(super) fn equality(tree: &Tree<'_>, context: &Context, found: &mut Found<'_>) {
    let is_number = numbers(tree);
    for (index, node) in tree.nodes.iter().enumerate() {
        let SyntaxKind::Operator(name @ ("==" | "!==")) = node.kind else { continue };
        let [left, right] = node.operands[..] else { continue };
        let is_whole = |node: usize| tree.number(node).is_some_and(|value| value.fract() == 0.0);
        let signal = |node: usize| match tree.nodes[node].kind {
            SyntaxKind::Signal(name) => Some(name),
            _ => None,
        };
        // A code such as a mode: the traces show that the signal has whole values only.
        let code = [(left, right), (right, left)]
            .into_iter()
            .find_map(|(code, value)| signal(code).filter(|_| is_whole(value)));
        if let Some(code) = code
            && is_code(context, code)
        {
            continue;
        }
        if tree.number(left).is_some() && tree.number(right).is_some() {
            continue;
        }
        let a = tree.text(left);
        let b = tree.text(right);
        let is_formula =
            |node: usize| tree.operator(node).is_some() && !tree.nodes[node].is_term && !is_number[node];
        if is_formula(left) && is_formula(right) {
            let shown = if name == "==" { "==" } else { "!=" };
            found.warn(
                "measured-equality",
                index,
                format!(
                    "`{shown}` compares the robustness of two formulas, which are almost never equal, and not whether both hold"
                ),
                Some(format!("({a}) {} ({b})", if name == "==" { "iff" } else { "xor" })),
            );
            continue;
        }
        let is_plain = tree.nodes[right].operands.is_empty() && !b.starts_with('-');
        let difference = match tree.number(right) {
            Some(0.0) => a.clone(),
            _ if is_plain => format!("{a} - {b}"),
            _ => format!("{a} - ({b})"),
        };
        let (shown, why, comparison) = match name {
            "==" => (
                "==",
                "measured numbers are almost never equal, so it almost never holds, and its robustness is at most 0",
                "<=",
            ),
            _ => ("!=", "measured numbers are almost never equal, so it almost always holds", ">"),
        };
        let if_code = match code {
            Some(code) => format!("; if {code} has whole values only, such as a mode, it is fine"),
            None => String::new(),
        };
        found.warn(
            "measured-equality",
            index,
            format!("`{shown}` compares exactly: {why}{if_code}"),
            Some(format!("abs({difference}) {comparison} 0.01, with the tolerance that is meant")),
        );
    }
}

/// Returns for each node whether it is a number, also one at another sample such as `prev x`.
fn numbers(tree: &Tree<'_>) -> Vec<bool> {
    let mut found: Vec<bool> = Vec::with_capacity(tree.nodes.len());
    for (index, node) in tree.nodes.iter().enumerate() {
        let moves = |name: &str| matches!(name, "next" | "prev" | "s_next" | "s_prev");
        let is_moved =
            tree.operator(index).is_some_and(moves) && node.operands.iter().all(|operand| found[*operand]);
        found.push(node.is_term || tree.operator(index).is_none() || is_moved);
    }
    found
}

/// Returns whether the traces have the signal and it has whole values only.
fn is_code(context: &Context, signal: &str) -> bool {
    let columns = context.traces.iter().filter_map(|(_, trace)| trace.signal(signal));
    let mut columns = columns.peekable();
    columns.peek().is_some() && columns.all(|values| values.iter().all(|value| value.fract() == 0.0))
}

/// Finds comparisons of comparisons.
pub(super) fn chained(tree: &Tree<'_>, found: &mut Found<'_>) {
    for (index, node) in tree.nodes.iter().enumerate() {
        let is_order =
            |node: usize| tree.operator(node).is_some_and(|name| is_comparison(name) && name != "!==");
        let [left, right] = node.operands[..] else { continue };
        // `(x >= 1) == (y >= 1)` is an equality of formulas.
        if !is_order(index) || !is_order(left) || is_order(right) {
            continue;
        }
        let [low, middle] = [0, 1].map(|n| tree.text(tree.nodes[left].operands[n]));
        let first = tree.operator(left).unwrap_or_default();
        let last = tree.operator(index).unwrap_or_default();
        found.warn(
            "chained-comparison",
            index,
            format!(
                "comparisons are not chained: this compares the robustness of `{}` with {}",
                tree.text(left),
                tree.text(right)
            ),
            Some(format!("{low} {first} {middle} and {middle} {last} {}", tree.text(right))),
        );
    }
}
