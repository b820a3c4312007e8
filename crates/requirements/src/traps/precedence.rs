//! Operators that bind tighter or looser than a reader expects.

use super::Found;
use crate::tree::Tree;

pub(super) fn find(tree: &Tree<'_>, found: &mut Found<'_>) {
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
                let window = tree.nodes[left].interval.map_or(String::new(), |_| {
                    let text = tree.text(left);
                    text.find('[').zip(text.find(']')).map_or(String::new(), |(a, b)| text[a..=b].to_owned())
                });
                let (p, q) = (tree.text(operand), tree.text(right));
                found.warn(
                    "precedence",
                    left,
                    format!(
                        "`{prefix}` binds tighter than `{name}`: this is ({}) {name} ({q}), and {q} is only looked at once, \
                         not inside of `{prefix}`",
                        tree.text(left)
                    ),
                    Some(format!("{prefix}{window}({p} {name} {q})")),
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
