//! Operators that bind tighter or looser than a reader expects.

use mishandle_stl::{Formula, SyntaxKind};

use super::Found;
use crate::tree::{Tree, is_comparison, is_temporal};

pub(super) fn find(tree: &Tree<'_>, found: &mut Found<'_>) {
    calls(tree, found);
    let has_time = tree.has_time();
    for (index, node) in tree.nodes.iter().enumerate() {
        let Some(name) = tree.operator(index) else { continue };
        let [left, right] = node.operands[..] else { continue };
        if !matches!(
            name,
            "and" | "or" | "implies" | "iff" | "xor" | "until" | "unless" | "since" | "release"
        ) {
            continue;
        }
        let is_bare = |operand: usize| !tree.nodes[operand].in_parentheses;
        let left_name = tree.operator(left);
        // `always p implies q`
        let over_time = left_name.filter(|name| matches!(*name, "always" | "eventually"));
        if let Some(prefix) = over_time.filter(|_| is_bare(left) && !has_time[right]) {
            let operand = tree.nodes[left].operands[0];
            let is_written_around = tree.nodes[operand].in_parentheses;
            // `always(p) and q` reads as it is meant, `always(p) implies q` rarely.
            let is_rule = prefix == "always" && name == "implies";
            if is_rule || !is_written_around {
                let window = tree.window(left);
                let p = tree.text(operand);
                let q = tree.text(right);
                let around = tree.ancestors(index).any(|node| tree.operator(node).is_some_and(is_temporal));
                let once = if around { "only looked at at the same sample" } else { "only looked at once" };
                // An implication that has to hold once is a trap of its own.
                let instead = (prefix == "always" || name != "implies")
                    .then(|| format!("{prefix}{window}({p} {name} {q})"));
                found.warn(
                    "precedence",
                    left,
                    format!(
                        "`{prefix}` binds tighter than `{name}`: this is ({}) {name} ({q}), and {q} is {once}, not inside of \
                         `{prefix}`",
                        tree.text(left)
                    ),
                    Some(instead.unwrap_or_else(|| format!("parentheses: ({}) {name} ({q})", tree.text(left)))),
                );
            }
        }
        // `a implies b implies c`
        if name == "implies" && left_name == Some("implies") && is_bare(left) {
            let [a, b] =
                [tree.nodes[left].operands[0], tree.nodes[left].operands[1]].map(|node| tree.text(node));
            let c = tree.text(right);
            found.warn(
                "precedence",
                index,
                format!("`implies` groups from the left: this is ({a} implies {b}) implies {c}"),
                Some(format!("{a} implies ({b} implies {c}), or {a} and {b} implies {c}")),
            );
        }
        // `a and b or c`
        let mixed = [left, right]
            .into_iter()
            .find(|operand| name == "or" && tree.operator(*operand) == Some("and") && is_bare(*operand));
        if let Some(operand) = mixed {
            found.warn(
                "precedence",
                operand,
                format!("`and` binds tighter than `or`: this is {}", grouped(tree, index)),
                Some("parentheses around the part that is meant".to_owned()),
            );
        }
    }
}

/// Returns an `or` with parentheses around its operands.
fn grouped(tree: &Tree<'_>, node: usize) -> String {
    let [left, right] = [0, 1].map(|n| tree.text(tree.nodes[node].operands[n]));
    format!("({left}) or ({right})")
}

/// Finds operators over time that are written like functions, such as `x - prev(x) <= 0.1`, whose
/// operand continues after the closing parenthesis.
fn calls(tree: &Tree<'_>, found: &mut Found<'_>) {
    // The operator that each number in parentheses after one is meant for.
    let mut written = vec![None; tree.nodes.len()];
    for node in 0..tree.nodes.len() {
        if let Some(argument) = argument(tree, node) {
            written[argument] = Some(node);
        }
    }
    let mut is_reported = vec![false; tree.nodes.len()];
    // From the outside, so that a comparison of two of them is reported once.
    for number in (0..tree.nodes.len()).rev() {
        let Some(operator) = written[number] else { continue };
        let mut top = operator;
        while let Some(parent) = tree.parents[top]
            .filter(|parent| is_arithmetic(tree, *parent) || argument(tree, *parent).is_some())
        {
            top = parent;
        }
        let name = tree.operator(operator).unwrap_or_default();
        let meant = as_written(tree, top, &written);
        let is_meant = Formula::parse(&meant).is_ok_and(|formula| {
            let root = formula.syntax().pop();
            tree.nodes[top].is_term
                || root.is_some_and(
                    |root| matches!(root.kind, SyntaxKind::Operator(name) if is_comparison(name)),
                )
        });
        if std::mem::replace(&mut is_reported[top], true) || !is_meant {
            continue;
        }
        let around = tree.text(tree.nodes[operator].operands[0]);
        let why = format!(
            "`{name}` is not a function: what it applies to continues after `{}`, so this is {name}({around})",
            tree.text(number)
        );
        // `always (x + y) <= 3` is often meant as it is.
        if top == operator && !matches!(name, "next" | "prev" | "s_next" | "s_prev") {
            found.note(
                "precedence",
                operator,
                why,
                Some(format!(
                    "{name}{}({around}) if this is meant, otherwise {meant}",
                    tree.window(operator)
                )),
            );
        } else {
            found.warn("precedence", operator, why, Some(meant));
        }
    }
}

/// Returns the number right after an operator over time whose operand continues: in parentheses, or
/// where the operator stands inside of arithmetic, in which a truth value is never meant.
fn argument(tree: &Tree<'_>, operator: usize) -> Option<usize> {
    let is_prefix = matches!(
        tree.operator(operator)?,
        "next" | "prev" | "s_next" | "s_prev" | "always" | "eventually" | "historically" | "once"
    );
    let mut node = *tree.nodes[operator].operands.first()?;
    while !tree.nodes[node].in_parentheses && is_arithmetic(tree, node) {
        node = tree.nodes[node].operands[0];
    }
    let is_number = tree.nodes[node].is_term || matches!(tree.nodes[node].kind, SyntaxKind::Signal(_));
    let goes_on = Some(operator) != tree.parents[node];
    let is_written = tree.nodes[node].in_parentheses
        || tree.parents[operator].is_some_and(|parent| tree.nodes[parent].is_term);
    // A name for a term counts as one in parentheses; the term is before the operator.
    let mut first = node;
    while let Some(operand) = tree.nodes[first].operands.first() {
        first = *operand;
    }
    let place = |node: usize| tree.at(node).map(|at| (at.line, at.column));
    let is_after = place(first) > place(operator);
    (is_prefix && is_written && is_number && goes_on && is_after).then_some(node)
}

/// Returns whether the node is a comparison, or arithmetic with an operator between two operands.
fn is_arithmetic(tree: &Tree<'_>, node: usize) -> bool {
    let between = |name: &str| is_comparison(name) || matches!(name, "+" | "-" | "*" | "/");
    tree.nodes[node].operands.len() == 2 && tree.operator(node).is_some_and(between)
}

/// Returns the text in which each operator over time applies to the number in parentheses after it.
fn as_written(tree: &Tree<'_>, node: usize, written: &[Option<usize>]) -> String {
    if argument(tree, node).is_some() {
        return part_as_written(tree, tree.nodes[node].operands[0], written);
    }
    match tree.nodes[node].operands[..] {
        [left, right] if is_arithmetic(tree, node) => {
            let name = tree.operator(node).unwrap_or_default();
            let [left, right] = [left, right].map(|operand| part_as_written(tree, operand, written));
            format!("{left} {name} {right}")
        }
        _ => tree.text(node),
    }
}

/// Returns the same with the parentheses of the node.
fn part_as_written(tree: &Tree<'_>, node: usize, written: &[Option<usize>]) -> String {
    let has_operator = tree.operator(node).is_some();
    if let Some(operator) = written[node] {
        let name = tree.operator(operator).unwrap_or_default();
        let window = tree.window(operator);
        let number = tree.text(node);
        return if has_operator {
            format!("({name}{window} ({number}))")
        } else {
            format!("({name}{window} {number})")
        };
    }
    let text = as_written(tree, node, written);
    if tree.nodes[node].in_parentheses && has_operator { format!("({text})") } else { text }
}
