//! Units that do not fit, truth values that are numbers, and definitions that nothing reads.

use std::collections::BTreeMap;

use mishandle_stl::SyntaxKind;

use super::Found;
use crate::describe::Context;
use crate::tree::{Tree, is_comparison};
use crate::units::{Unit, common, units as units_of};

/// Limits of an angle in radians beyond which it was probably written in degrees.
const WHOLE_TURN: f64 = std::f64::consts::TAU;

/// Finds sums and comparisons of different units, and conjunctions of predicates with different
/// units.
pub(super) fn units(tree: &Tree<'_>, context: &Context, found: &mut Found<'_>) {
    let units = units_of(tree, &context.units);
    for (index, node) in tree.nodes.iter().enumerate() {
        let (SyntaxKind::Operator(name), [left, right]) = (node.kind, &node.operands[..]) else {
            continue;
        };
        let is_sum = matches!(name, "+" | "-");
        if !is_sum && !is_comparison(name) {
            continue;
        }
        match (&units[*left], &units[*right]) {
            (Unit::Known(a), Unit::Known(b)) if a != b => {
                let verb = if is_sum { "adds" } else { "compares" };
                found.warn(
                    "unit-mismatch",
                    index,
                    format!("it {verb} {} in {a} with {} in {b}", tree.text(*left), tree.text(*right)),
                    Some(format!(
                        "a factor that converts one of them, such as {} * factor",
                        tree.text(*left)
                    )),
                );
            }
            (Unit::Known(unit), Unit::Any) | (Unit::Any, Unit::Known(unit)) if unit == "rad" && !is_sum => {
                let limit = tree.number(*left).or_else(|| tree.number(*right));
                if let Some(limit) = limit.filter(|limit| limit.is_finite() && limit.abs() > WHOLE_TURN) {
                    found.warn(
                        "degrees-as-radians",
                        index,
                        format!("{limit} rad is more than a whole turn"),
                        Some(format!("{:.4}, if {limit} degrees are meant", limit.to_radians())),
                    );
                }
            }
            _ => {}
        }
    }
    mixed(tree, &units, found);
}

/// Finds the outermost conjunctions and disjunctions whose predicates have different units.
fn mixed(tree: &Tree<'_>, units: &[Unit], found: &mut Found<'_>) {
    let is_joint = |node: usize| matches!(tree.operator(node), Some("and" | "or"));
    // The units of the predicates below each node, each with one of them.
    let mut below: Vec<BTreeMap<String, usize>> = Vec::with_capacity(tree.nodes.len());
    let mut last = None;
    for (index, node) in tree.nodes.iter().enumerate() {
        let mut own = BTreeMap::new();
        match node.kind {
            SyntaxKind::Operator(name) if is_comparison(name) => {
                if let Unit::Known(unit) = common(&units[node.operands[0]], &units[node.operands[1]]) {
                    own.insert(unit, index);
                }
            }
            SyntaxKind::Operator(_) if !node.is_term => {
                for operand in &node.operands {
                    own.extend(std::mem::take(&mut below[*operand]));
                }
            }
            _ => {}
        }
        if is_joint(index) && own.len() > 1 {
            last = Some((index, own.clone()));
        }
        below.push(own);
    }
    if let Some((node, units)) = last {
        let name = tree.operator(node).unwrap_or_default();
        let list: Vec<String> =
            units.iter().map(|(unit, predicate)| format!("{} ({unit})", tree.text(*predicate))).collect();
        found.note(
            "mixed-units",
            node,
            format!(
                "the robustness of `{name}` is the number of one part, whatever its unit is: {}; a part with small numbers \
                 can hide the others from a search",
                list.join(", ")
            ),
            Some("divide each part by its scale, such as (20 - force) / 20 >= 0".to_owned()),
        );
    }
}

/// Finds signals that are formulas on their own.
pub(super) fn truth_values(tree: &Tree<'_>, context: &Context, found: &mut Found<'_>) {
    let is_number = tree.inside_numbers();
    for (index, node) in tree.nodes.iter().enumerate() {
        let SyntaxKind::Signal(name) = node.kind else { continue };
        if is_number[index] {
            continue;
        }
        let text = tree.text(index);
        let why = if is_flag(context, name) {
            format!("a signal alone holds from 0 on, and {text} is 0 or 1: it always holds")
        } else {
            "a signal alone holds from 0 on: a flag with the values 0 and 1 always holds".to_owned()
        };
        found.warn(
            "flag-always-holds",
            index,
            why,
            Some(format!("{text} >= 0.5 for a flag, {text} > 0 for a number")),
        );
    }
}

/// Finds flags that are compared with one of their two values, at which the robustness is 0.
pub(super) fn flags_at_limits(tree: &Tree<'_>, context: &Context, found: &mut Found<'_>) {
    for (index, node) in tree.nodes.iter().enumerate() {
        let SyntaxKind::Operator(name) = node.kind else { continue };
        let [left, right] = node.operands[..] else { continue };
        let SyntaxKind::Signal(signal) = tree.nodes[left].kind else { continue };
        let half = match (name, tree.number(right)) {
            (">=" | "==", Some(1.0)) => ">= 0.5",
            ("<=" | "==", Some(0.0)) => "<= 0.5",
            _ => continue,
        };
        if is_flag(context, signal) {
            let text = tree.text(left);
            found.note(
                "flag-at-its-limit",
                index,
                format!(
                    "{text} is 0 or 1, so the robustness of `{}` is 0 where it holds; that of an implication or `and` with it is \
                     then 0, too, and says nothing about the other parts",
                    tree.text(index)
                ),
                Some(format!("{text} {half}")),
            );
        }
    }
}

/// Returns whether the traces have the signal, with the values 0 and 1 only.
fn is_flag(context: &Context, signal: &str) -> bool {
    let mut columns = context.traces.iter().filter_map(|(_, trace)| trace.signal(signal)).peekable();
    columns.peek().is_some() && columns.all(|values| values.iter().all(|value| [0.0, 1.0].contains(value)))
}

/// Finds definitions that no statement reads.
pub(super) fn unused(tree: &Tree<'_>, found: &mut Found<'_>) {
    let root = tree.nodes.len() - 1;
    for name in tree.formula.unused_definitions() {
        found.warn(
            "unused-definition",
            root,
            format!("no statement reads `{name}`: the last statement alone is the formula"),
            Some(format!("an operator between the statements, or no definition of `{name}`")),
        );
    }
}
