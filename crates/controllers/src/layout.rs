//! Layouts of observations and actions.

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

/// A named part of an observation or an action.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Entry {
    /// The name, for example `ball_velocity`.
    pub name: String,
    /// The unit; empty for dimensionless numbers.
    pub unit: String,
    /// The number of components.
    pub size: usize,
}

/// The order, names, units and sizes of the parts of observations and actions.
///
/// # Example
/// ```
/// use mishandle_controllers::{Entry, Layout};
/// let entry = |name: &str, unit: &str, size| Entry { name: name.into(), unit: unit.into(), size };
/// let expected = Layout { observation: vec![entry("ball", "m", 3)], action: vec![entry("arm", "", 7)] };
/// let found = Layout { observation: vec![entry("cube", "m", 3)], action: vec![entry("arm", "", 7)] };
/// assert_eq!(expected.observation_size(), 3);
/// assert_eq!(
///     expected.differences(&found),
///     ["part 0 of the observation is `ball` (3 numbers, m), but the controller expects `cube` (3 numbers, m)"],
/// );
/// ```
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Layout {
    /// Parts of an observation, in order.
    pub observation: Vec<Entry>,
    /// Parts of an action, in order.
    pub action: Vec<Entry>,
}

impl Layout {
    /// Returns the number of components of an observation.
    pub fn observation_size(&self) -> usize {
        total_size(&self.observation)
    }

    /// Returns the number of components of an action.
    pub fn action_size(&self) -> usize {
        total_size(&self.action)
    }

    /// Returns the first 16 bytes of the SHA-256 of all names, units and sizes, in hexadecimal.
    pub fn hash(&self) -> String {
        let mut digest = Sha256::new();
        for (side, entries) in [("observation", &self.observation), ("action", &self.action)] {
            for Entry { name, unit, size } in entries {
                digest.update(format!("{side}\0{name}\0{unit}\0{size}\n"));
            }
        }
        hexadecimal(&digest.finalize()[..16])
    }

    /// Returns the differences between this layout of an environment and the layout `found` of a
    /// controller, one sentence per part that differs.
    pub fn differences(&self, found: &Layout) -> Vec<String> {
        let sides = [
            ("observation", "expects", &self.observation, &found.observation),
            ("action", "outputs", &self.action, &found.action),
        ];
        let mut differences = Vec::new();
        for (side, verb, expected, found) in sides {
            for i in 0..expected.len().max(found.len()) {
                let expected = expected.get(i);
                let found = found.get(i);
                if expected != found {
                    differences.push(format!(
                        "part {i} of the {side} is {}, but the controller {verb} {}",
                        describe(expected),
                        describe(found)
                    ));
                }
            }
        }
        differences
    }
}

/// Returns the sum of the sizes. Sizes of a damaged file that overflow match no network.
fn total_size(entries: &[Entry]) -> usize {
    entries.iter().fold(0, |sum, entry| sum.saturating_add(entry.size))
}

fn describe(entry: Option<&Entry>) -> String {
    match entry {
        None => "nothing".to_string(),
        Some(Entry { name, unit, size }) => {
            let numbers = if *size == 1 { "number" } else { "numbers" };
            let unit = if unit.is_empty() { String::new() } else { format!(", {unit}") };
            format!("`{name}` ({size} {numbers}{unit})")
        }
    }
}

pub(crate) fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layout(parts: &[(&str, usize)]) -> Layout {
        let entry = |&(name, size): &(&str, usize)| Entry { name: name.into(), unit: "m".into(), size };
        Layout { observation: parts.iter().map(entry).collect(), action: vec![] }
    }

    #[test]
    fn the_hash_depends_on_names_sizes_and_order() {
        let base = layout(&[("a", 1), ("b", 2)]);
        assert_eq!(base.hash(), layout(&[("a", 1), ("b", 2)]).hash());
        for other in [layout(&[("b", 2), ("a", 1)]), layout(&[("a", 2), ("b", 1)]), layout(&[("a", 1)])] {
            assert_ne!(base.hash(), other.hash());
        }
    }

    #[test]
    fn a_missing_part_is_reported() {
        let differences = layout(&[("a", 1), ("b", 2)]).differences(&layout(&[("a", 1)]));
        assert_eq!(
            differences,
            ["part 1 of the observation is `b` (2 numbers, m), but the controller expects nothing"]
        );
    }
}
