//! How a follow-up case changes one axis of its source case.

use std::fmt;
use std::str::FromStr;

use mishandle_rollout::{Axis, AxisValues};

use crate::FalsificationError;

/// Share of the range of an axis by which a rounding error may leave it.
const ROUNDING: f64 = 1e-12;

/// The change of an axis: an offset, a factor, a value or a category.
///
/// # Example
/// ```
/// use mishandle_falsification::AxisChange;
/// assert_eq!("+0.02".parse::<AxisChange>()?, AxisChange::Offset(0.02));
/// assert_eq!("*0.8".parse::<AxisChange>()?, AxisChange::Factor(0.8));
/// assert_eq!("-50%".parse::<AxisChange>()?, AxisChange::Factor(0.5));
/// assert_eq!("=-0.3".parse::<AxisChange>()?, AxisChange::Value(-0.3));
/// assert_eq!("ice".parse::<AxisChange>()?, AxisChange::Category("ice".to_string()));
/// assert!("+much".parse::<AxisChange>().is_err());
/// # Ok::<(), mishandle_falsification::FalsificationError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub enum AxisChange {
    /// Adds a number.
    Offset(f64),
    /// Multiplies by a number.
    Factor(f64),
    /// Sets a number.
    Value(f64),
    /// Sets a category.
    Category(String),
}

impl FromStr for AxisChange {
    type Err = FalsificationError;

    fn from_str(text: &str) -> Result<AxisChange, FalsificationError> {
        let text = text.trim();
        let number = |text: &str| text.trim().parse::<f64>().ok().filter(|number| number.is_finite());
        let found = match text.as_bytes().first() {
            Some(b'*') => number(&text[1..]).map(AxisChange::Factor),
            Some(b'+' | b'-') => match text.strip_suffix('%') {
                // As one division, +5 % is the number nearest to 1.05.
                Some(share) => number(share).map(|share| AxisChange::Factor((100.0 + share) / 100.0)),
                None => number(text).map(AxisChange::Offset),
            },
            _ => {
                let value = text.strip_prefix('=').unwrap_or(text).trim();
                let category = || (!value.is_empty()).then(|| AxisChange::Category(value.to_string()));
                number(value).map(AxisChange::Value).or_else(category)
            }
        };
        found.ok_or_else(|| FalsificationError::InvalidValue {
            what: "the change of an axis",
            value: text.to_string(),
            expected: "an offset such as +0.02 or -0.02, a factor such as *0.8 or -20%, a value such as =0.3, or a category",
        })
    }
}

impl fmt::Display for AxisChange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            AxisChange::Offset(offset) => write!(f, "{offset:+}"),
            AxisChange::Factor(factor) => write!(f, "*{factor}"),
            AxisChange::Value(value) => write!(f, "={value}"),
            AxisChange::Category(name) => write!(f, "={name}"),
        }
    }
}

impl AxisChange {
    /// Checks that an axis can be changed so.
    pub(super) fn check(&self, axis: &Axis) -> Result<(), FalsificationError> {
        let is_whole = |number: f64| axis.levels().is_none() || number.fract() == 0.0;
        let expected = match (self, &axis.values) {
            (AxisChange::Category(name), AxisValues::Categorical(names)) if names.contains(name) => {
                return Ok(());
            }
            (_, AxisValues::Categorical(names)) => {
                format!("one of its categories: {}", names.join(", "))
            }
            (AxisChange::Category(_), _) => {
                "an offset, a factor or a value, because the axis is numeric".to_string()
            }
            (AxisChange::Offset(number) | AxisChange::Value(number), _) if !is_whole(*number) => {
                "a whole number, as the values of the axis".to_string()
            }
            (AxisChange::Value(value), _) if !(axis.low..=axis.high).contains(value) => {
                format!("a value from {} to {}", axis.low, axis.high)
            }
            _ => return Ok(()),
        };
        Err(FalsificationError::Change { axis: axis.name.clone(), change: self.to_string(), expected })
    }

    /// Returns whether a share of the change is a smaller change.
    pub(super) fn can_shrink(&self) -> bool {
        !matches!(self, AxisChange::Category(_))
    }

    /// Returns the value of the follow-up case, with a share from 0 to 1 of the change; `None` if
    /// it is outside of the bounds of the axis. On an axis of whole numbers, it is rounded.
    pub(super) fn apply(&self, axis: &Axis, source: f64, share: f64) -> Option<f64> {
        let part = |whole: f64| if share < 1.0 { source + share * (whole - source) } else { whole };
        let changed = match self {
            AxisChange::Offset(offset) => source + share * offset,
            AxisChange::Factor(factor) => part(source * factor),
            AxisChange::Value(value) => part(*value),
            AxisChange::Category(name) => {
                let AxisValues::Categorical(names) = &axis.values else { return None };
                axis.low + names.iter().position(|known| known == name)? as f64
            }
        };
        let changed = if axis.levels().is_some() { changed.round() } else { changed };
        let rounding = ROUNDING * (axis.high - axis.low);
        let is_within = (axis.low - rounding..=axis.high + rounding).contains(&changed);
        is_within.then(|| changed.clamp(axis.low, axis.high))
    }
}
