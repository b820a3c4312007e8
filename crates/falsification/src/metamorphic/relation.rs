//! Metamorphic relations: how a follow-up case differs from its source case, and what must hold
//! between their results.

use std::fmt;
use std::str::FromStr;

use mishandle_stl::{is_satisfied, is_violated};

use super::change::AxisChange;
use crate::FalsificationError;

/// A metamorphic relation of a space.
#[derive(Clone, Debug, PartialEq)]
pub struct Relation {
    /// Name.
    pub name: String,
    /// The changed axes, by their index in the space.
    pub changes: Vec<(usize, AxisChange)>,
    /// The relation of the results of the two cases.
    pub holds: OutputRelation,
}

/// A relation of the robustness of a source case and that of its follow-up case, which must hold.
///
/// # Example
/// ```
/// use mishandle_falsification::OutputRelation;
/// let relation: OutputRelation = "not-better".parse()?;
/// // The source case violates the requirement, and the follow-up case satisfies it.
/// assert!(relation.is_broken(-0.1, 0.2));
/// assert!(!relation.is_broken(0.1, 0.2));
/// assert!("not-better:0.05".parse::<OutputRelation>()?.is_broken(0.1, 0.2));
/// # Ok::<(), mishandle_falsification::FalsificationError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum OutputRelation {
    /// Both cases satisfy the requirement, or both violate it.
    SameVerdict,
    /// The follow-up case is not satisfied if the source case is violated; with a tolerance, its
    /// robustness is at most that of the source case plus the tolerance.
    NotBetter(Option<f64>),
    /// The follow-up case is not violated if the source case is satisfied; with a tolerance, its
    /// robustness is at least that of the source case minus the tolerance.
    NotWorse(Option<f64>),
    /// The two robustness values differ at most by this number.
    RobustnessWithin(f64),
}

impl OutputRelation {
    /// Forms of the names, for messages.
    pub const FORMS: [&'static str; 6] = [
        "same-verdict",
        "not-better",
        "not-worse",
        "not-better:TOLERANCE",
        "not-worse:TOLERANCE",
        "robustness-within:DISTANCE",
    ];

    /// Returns whether these robustness values break the relation.
    pub fn is_broken(self, source: f64, follow_up: f64) -> bool {
        let gain = difference(source, follow_up);
        match self {
            OutputRelation::SameVerdict => is_violated(source) != is_violated(follow_up),
            OutputRelation::NotBetter(None) => is_violated(source) && is_satisfied(follow_up),
            OutputRelation::NotWorse(None) => is_satisfied(source) && is_violated(follow_up),
            OutputRelation::NotBetter(Some(tolerance)) => gain > tolerance,
            OutputRelation::NotWorse(Some(tolerance)) => -gain > tolerance,
            OutputRelation::RobustnessWithin(distance) => gain.abs() > distance,
        }
    }
}

/// Returns the robustness of the follow-up case minus that of the source case. Equal infinities
/// have no difference.
pub(super) fn difference(source: f64, follow_up: f64) -> f64 {
    if source == follow_up { 0.0 } else { follow_up - source }
}

impl FromStr for OutputRelation {
    type Err = FalsificationError;

    fn from_str(text: &str) -> Result<OutputRelation, FalsificationError> {
        let (name, number) = match text.trim().split_once(':') {
            Some((name, number)) => (name, Some(number)),
            None => (text.trim(), None),
        };
        let parsed = number.map(|number| number.trim().parse::<f64>().ok());
        let found = match (name, parsed) {
            (_, Some(None)) => None,
            (_, Some(Some(number))) if !(number.is_finite() && number.is_sign_positive()) => None,
            ("same-verdict", None) => Some(OutputRelation::SameVerdict),
            ("not-better", tolerance) => Some(OutputRelation::NotBetter(tolerance.flatten())),
            ("not-worse", tolerance) => Some(OutputRelation::NotWorse(tolerance.flatten())),
            ("robustness-within", Some(Some(distance))) => Some(OutputRelation::RobustnessWithin(distance)),
            _ => None,
        };
        found.ok_or_else(|| FalsificationError::InvalidValue {
            what: "the text `holds` of a relation",
            value: text.to_string(),
            expected: "same-verdict, not-better, not-worse, not-better:TOLERANCE, not-worse:TOLERANCE or \
                       robustness-within:DISTANCE, with a finite number from 0 on",
        })
    }
}

impl fmt::Display for OutputRelation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (name, number) = match self {
            OutputRelation::SameVerdict => ("same-verdict", None),
            OutputRelation::NotBetter(tolerance) => ("not-better", *tolerance),
            OutputRelation::NotWorse(tolerance) => ("not-worse", *tolerance),
            OutputRelation::RobustnessWithin(distance) => ("robustness-within", Some(*distance)),
        };
        match number {
            None => f.write_str(name),
            Some(number) => write!(f, "{name}:{number}"),
        }
    }
}
