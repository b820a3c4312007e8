//! Units of signals and terms, from declarations and from the endings of names.

use std::collections::BTreeMap;

use mishandle_stl::SyntaxKind;

use crate::tree::Tree;

/// Endings of names that are units, longer ones first.
const ENDINGS: [(&str, &str); 29] = [
    ("_m_s", "m/s"),
    ("_m_per_s", "m/s"),
    ("_mm_s", "mm/s"),
    ("_mm_per_s", "mm/s"),
    ("_rad_s", "rad/s"),
    ("_rad_per_s", "rad/s"),
    ("_deg_s", "deg/s"),
    ("_deg_per_s", "deg/s"),
    ("_N_m", "N m"),
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
    let by_name = || {
        let (ending, unit) = ENDINGS.iter().find(|(ending, _)| signal.ends_with(ending))?;
        // Another unit before it: a product or a quotient that the table does not have.
        let rest = signal.strip_suffix(ending)?;
        let is_part = rest.ends_with("_per") || ENDINGS.iter().any(|(ending, _)| rest.ends_with(ending));
        (!is_part).then(|| (*unit).to_owned())
    };
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ending_of_a_name_is_a_whole_unit() {
        let unit = |name: &str| unit_of(name, &BTreeMap::new());
        for (name, expected) in [
            ("speed_m_s", Some("m/s")),
            ("rate_deg_per_s", Some("deg/s")),
            ("torque_N_m", Some("N m")),
            ("time_s", Some("s")),
            ("force_N", Some("N")),
            ("flow_kg_per_s", None),
            ("stiffness_N_mm", None),
            ("speed", None),
        ] {
            assert_eq!(unit(name).as_deref(), expected, "{name}");
        }
    }
}
