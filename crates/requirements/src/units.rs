//! Units of signals and terms, from declarations and from the endings of names.

use std::collections::BTreeMap;

use mishandle_stl::SyntaxKind;

use crate::tree::Tree;

/// Endings of names that are units.
const ENDINGS: [(&str, &str); 20] = [
    ("_deg", "deg"),
    ("_rad", "rad"),
    ("_mm", "mm"),
    ("_cm", "cm"),
    ("_m", "m"),
    ("_ms", "ms"),
    ("_sec", "s"),
    ("_s", "s"),
    ("_us", "us"),
    ("_ns", "ns"),
    ("_N", "N"),
    ("_Nm", "N m"),
    ("_nm", "N m"),
    ("_newton", "N"),
    ("_kg", "kg"),
    ("_Hz", "Hz"),
    ("_hz", "Hz"),
    ("_mps", "m/s"),
    ("_rpm", "1/min"),
    ("_percent", "%"),
];

/// The unit of a term.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Unit {
    /// A number takes any unit.
    Any,
    Known(String),
    Unknown,
}

/// Returns the unit of a signal: the declared one, otherwise that of the ending of its name.
pub fn unit_of(signal: &str, declared: &BTreeMap<String, String>) -> Option<String> {
    let by_name =
        || ENDINGS.iter().find(|(ending, _)| signal.ends_with(ending)).map(|(_, unit)| (*unit).to_owned());
    let own = declared.get(signal).map(|unit| match unit.trim() {
        "°" | "degree" | "degrees" => "deg".to_owned(),
        unit => unit.replace('·', " "),
    });
    own.filter(|unit| !unit.is_empty()).or_else(by_name)
}

/// Returns the unit of each node; those of formulas are unknown.
pub(crate) fn units(tree: &Tree<'_>, declared: &BTreeMap<String, String>) -> Vec<Unit> {
    let mut units: Vec<Unit> = Vec::with_capacity(tree.nodes.len());
    for node in &tree.nodes {
        let unit = match node.kind {
            SyntaxKind::Number(_) => Unit::Any,
            SyntaxKind::Signal(name) => unit_of(name, declared).map_or(Unit::Unknown, Unit::Known),
            SyntaxKind::Operator("-" | "+") if node.operands.len() == 2 => {
                common(&units[node.operands[0]], &units[node.operands[1]])
            }
            SyntaxKind::Operator("-" | "abs") => units[node.operands[0]].clone(),
            SyntaxKind::Operator(_) => Unit::Unknown,
        };
        units.push(unit);
    }
    units
}

/// Returns the unit of a sum.
pub(crate) fn common(a: &Unit, b: &Unit) -> Unit {
    match (a, b) {
        (Unit::Any, other) | (other, Unit::Any) => other.clone(),
        (a, b) if a == b => a.clone(),
        _ => Unit::Unknown,
    }
}
