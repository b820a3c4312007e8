//! Options of searches: values by name, and the specifications of the accepted options.
//!
//! A search declares its options once, as the fields of its option structure, with the macro
//! [`options!`].

use std::collections::BTreeMap;
use std::fmt;

use crate::free::is_free;
use crate::{Coordinate, SearchError};

/// The value of an option. With the feature `serde`, the first variant that fits is read.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(untagged))]
pub enum OptionValue {
    /// True or false.
    Boolean(bool),
    /// An integer. Also accepted where a number is expected.
    Integer(i64),
    /// A number.
    Float(f64),
    /// A text.
    Text(String),
    /// A point of the search space: one number per coordinate.
    Point(Vec<f64>),
    /// A list of points.
    Points(Vec<Vec<f64>>),
}

impl fmt::Display for OptionValue {
    /// Writes the value as in a plan (TOML).
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            OptionValue::Float(value) => write!(f, "{value:?}"),
            OptionValue::Integer(value) => write!(f, "{value}"),
            OptionValue::Boolean(value) => write!(f, "{value}"),
            OptionValue::Text(value) => write!(f, "{value:?}"),
            OptionValue::Point(value) => write!(f, "{value:?}"),
            OptionValue::Points(value) => write!(f, "{value:?}"),
        }
    }
}

macro_rules! option_value_from {
    ($($from:ty => $variant:ident),*) => {
        $(impl From<$from> for OptionValue {
            fn from(value: $from) -> Self {
                OptionValue::$variant(value.into())
            }
        })*
    };
}

option_value_from!(f64 => Float, i64 => Integer, i32 => Integer, u32 => Integer, bool => Boolean);
option_value_from!(String => Text, &str => Text, Vec<f64> => Point, Vec<Vec<f64>> => Points);

/// Options of a search by name. An absent option has its default.
///
/// Names have hyphens, as in plans; `_` is converted to `-`. Options are checked when the search is
/// created: [`by_name`](crate::by_name) returns an error for unknown names, wrong types and values
/// out of range.
///
/// # Example
/// ```
/// use mishandle_search::{Coordinate, SearchOptions, by_name};
///
/// let plane = [Coordinate::Continuous; 2];
/// let options = SearchOptions::new().with("xatol", 1e-6).with("max_evaluations", 50);
/// assert!(by_name("nelder-mead", &plane, 0, &options).is_ok());
///
/// let options = SearchOptions::new().with("xatol", -1.0);
/// let error = by_name("nelder-mead", &plane, 0, &options).err().expect("out of range");
/// assert_eq!(error.to_string(), "option `xatol` of nelder-mead is -1.0; it must be at least 0");
/// ```
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SearchOptions {
    values: BTreeMap<String, OptionValue>,
}

impl SearchOptions {
    /// Creates options with all defaults.
    pub fn new() -> Self {
        Self::default()
    }

    /// Sets an option and returns the options.
    #[must_use]
    pub fn with(mut self, name: &str, value: impl Into<OptionValue>) -> Self {
        self.set(name, value);
        self
    }

    /// Sets an option.
    pub fn set(&mut self, name: &str, value: impl Into<OptionValue>) {
        self.values.insert(hyphenated(name), value.into());
    }

    /// Returns the value of an option, if it is set.
    pub fn get(&self, name: &str) -> Option<&OptionValue> {
        self.values.get(&hyphenated(name))
    }

    /// Returns all options that are set, sorted by name.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &OptionValue)> {
        self.values.iter().map(|(name, value)| (name.as_str(), value))
    }

    /// Returns the same options with points of the free coordinates. Points of another dimension
    /// stay, so that their search refuses them.
    pub(crate) fn projected(&self, coordinates: &[Coordinate]) -> Self {
        let free = |point: &Vec<f64>| {
            if point.len() == coordinates.len() {
                point.iter().zip(coordinates).filter(|(_, of)| is_free(of)).map(|(x, _)| *x).collect()
            } else {
                point.clone()
            }
        };
        let projected = |value: &OptionValue| match value {
            OptionValue::Point(point) => OptionValue::Point(free(point)),
            OptionValue::Points(points) => OptionValue::Points(points.iter().map(free).collect()),
            value => value.clone(),
        };
        Self { values: self.values.iter().map(|(name, value)| (name.clone(), projected(value))).collect() }
    }

    /// Returns whether no option is set.
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }
}

impl<N: AsRef<str>, V: Into<OptionValue>> FromIterator<(N, V)> for SearchOptions {
    fn from_iter<I: IntoIterator<Item = (N, V)>>(values: I) -> Self {
        let mut options = Self::new();
        values.into_iter().for_each(|(name, value)| options.set(name.as_ref(), value));
        options
    }
}

/// Returns the name of an option with hyphens, as in plans.
fn hyphenated(name: &str) -> String {
    name.replace('_', "-")
}

/// The type of an option.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OptionType {
    /// [`OptionValue::Float`], or an integer.
    Float,
    /// [`OptionValue::Integer`].
    Integer,
    /// [`OptionValue::Boolean`].
    Boolean,
    /// [`OptionValue::Text`].
    Text,
    /// [`OptionValue::Point`].
    Point,
    /// [`OptionValue::Points`].
    Points,
}

impl OptionType {
    /// Returns the name of the type.
    pub fn name(self) -> &'static str {
        match self {
            OptionType::Float => "float",
            OptionType::Integer => "integer",
            OptionType::Boolean => "boolean",
            OptionType::Text => "text",
            OptionType::Point => "point",
            OptionType::Points => "list of points",
        }
    }

    /// Returns a description of the type for error messages.
    fn expected(self) -> &'static str {
        match self {
            OptionType::Float => "a number",
            OptionType::Integer => "an integer",
            OptionType::Boolean => "true or false",
            OptionType::Text => "a text",
            OptionType::Point => "a point (a list of numbers)",
            OptionType::Points => "a list of points",
        }
    }
}

/// The specification of an option.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OptionSpec {
    /// The name, with hyphens.
    pub name: String,
    /// The type.
    pub kind: OptionType,
    /// The default as in a plan, or the behavior without a value.
    pub default: String,
    /// The range in words; empty if every value of the type is accepted.
    pub range: &'static str,
    /// The meaning, in one or more sentences.
    pub meaning: String,
}

/// A range of numbers.
pub(crate) struct Range {
    /// A description, for example "at least 0".
    pub words: &'static str,
    pub holds: fn(f64) -> bool,
}

impl Range {
    /// Creates a range with a description only, because its check needs the dimension.
    pub(crate) const fn described(words: &'static str) -> Self {
        Self { words, holds: |_| true }
    }
}

/// Every value of the type.
pub(crate) const ANY: Range = Range::described("");
pub(crate) const NOT_NEGATIVE: Range = Range { words: "at least 0", holds: |x| x >= 0.0 };
pub(crate) const FROM_0_TO_1: Range = Range { words: "in [0, 1]", holds: |x| (0.0..=1.0).contains(&x) };
pub(crate) const AT_LEAST_1: Range = Range { words: "at least 1", holds: |x| x >= 1.0 };
/// The most points that a search makes at once: more need gigabytes of memory.
pub(crate) const MOST_POINTS: f64 = 100_000.0;
pub(crate) const POINTS: Range =
    Range { words: "from 1 to 100000", holds: |x| (1.0..=MOST_POINTS).contains(&x) };
/// For [`check_start`].
pub(crate) const POINT_OF_THE_BOX: Range = Range::described("d numbers in [0, 1]");

/// A field type of option structures.
pub(crate) trait OptionField: Sized {
    const TYPE: OptionType;

    /// Converts an option value to the field type; `None` if the type differs.
    fn read(value: &OptionValue) -> Option<Self>;

    /// Converts the field to an option value; `None` if the field is `None`.
    fn value(&self) -> Option<OptionValue>;

    /// Returns the number that a [`Range`] applies to, if the field is a number.
    fn number(&self) -> Option<f64> {
        None
    }
}

impl OptionField for f64 {
    const TYPE: OptionType = OptionType::Float;

    fn read(value: &OptionValue) -> Option<Self> {
        match value {
            OptionValue::Float(value) => Some(*value),
            OptionValue::Integer(value) => Some(*value as f64),
            _ => None,
        }
    }

    fn value(&self) -> Option<OptionValue> {
        Some(OptionValue::Float(*self))
    }

    fn number(&self) -> Option<f64> {
        Some(*self)
    }
}

impl OptionField for usize {
    const TYPE: OptionType = OptionType::Integer;

    fn read(value: &OptionValue) -> Option<Self> {
        match value {
            OptionValue::Integer(value) => usize::try_from(*value).ok(),
            _ => None,
        }
    }

    fn value(&self) -> Option<OptionValue> {
        Some(OptionValue::Integer(i64::try_from(*self).unwrap_or(i64::MAX)))
    }

    fn number(&self) -> Option<f64> {
        Some(*self as f64)
    }
}

/// Fields without a range of numbers: one variant of [`OptionValue`] each.
macro_rules! option_field {
    ($($field:ty => $variant:ident),*) => {
        $(impl OptionField for $field {
            const TYPE: OptionType = OptionType::$variant;

            fn read(value: &OptionValue) -> Option<Self> {
                match value {
                    OptionValue::$variant(value) => Some(value.clone()),
                    _ => None,
                }
            }

            fn value(&self) -> Option<OptionValue> {
                Some(OptionValue::$variant(self.clone()))
            }
        })*
    };
}

option_field!(bool => Boolean, String => Text, Vec<f64> => Point, Vec<Vec<f64>> => Points);

impl<T: OptionField> OptionField for Option<T> {
    const TYPE: OptionType = T::TYPE;

    fn read(value: &OptionValue) -> Option<Self> {
        T::read(value).map(Some)
    }

    fn value(&self) -> Option<OptionValue> {
        self.as_ref()?.value()
    }

    fn number(&self) -> Option<f64> {
        self.as_ref()?.number()
    }
}

impl OptionSpec {
    pub(crate) fn new<T: OptionField>(
        field: &str,
        docs: &[&str],
        default: &T,
        without: Option<&str>,
        range: &Range,
    ) -> Self {
        let default = match (default.value(), without) {
            (Some(value), _) => value.to_string(),
            (None, without) => without.unwrap_or("none").to_owned(),
        };
        let meaning = docs.iter().map(|line| line.trim()).collect::<Vec<_>>().join(" ");
        Self { name: hyphenated(field), kind: T::TYPE, default, range: range.words, meaning }
    }
}

/// Reads an option and checks its type and range; returns the default if it is not set.
pub(crate) fn read_option<T: OptionField>(
    search: &'static str,
    field: &str,
    options: &SearchOptions,
    default: T,
    range: &Range,
) -> Result<T, SearchError> {
    let Some(given) = options.get(field) else { return Ok(default) };
    let wrong = |expected: String| SearchError::Option {
        search,
        option: hyphenated(field),
        found: given.to_string(),
        expected,
    };
    let Some(value) = T::read(given) else {
        let separator = if range.words.is_empty() { "" } else { ", " };
        return Err(wrong(format!("{}{separator}{}", T::TYPE.expected(), range.words)));
    };
    match value.number() {
        Some(number) if !(range.holds)(number) => Err(wrong(range.words.to_owned())),
        _ => Ok(value),
    }
}

/// Checks that a field is in its range.
pub(crate) fn check_option<T: OptionField>(
    search: &'static str,
    field: &str,
    value: &T,
    range: &Range,
) -> Result<(), SearchError> {
    match value.number() {
        Some(number) if !(range.holds)(number) => Err(SearchError::Option {
            search,
            option: hyphenated(field),
            found: value.value().map(|value| value.to_string()).unwrap_or_default(),
            expected: range.words.to_owned(),
        }),
        _ => Ok(()),
    }
}

/// Checks that all names of `options` are among `known`.
pub(crate) fn check_names(
    search: &'static str,
    options: &SearchOptions,
    known: &[OptionSpec],
) -> Result<(), SearchError> {
    let is_known = |name: &str| known.iter().any(|spec| spec.name == name);
    match options.iter().find(|(name, _)| !is_known(name)) {
        None => Ok(()),
        Some((name, _)) => Err(SearchError::UnknownOption {
            search,
            name: name.to_owned(),
            known: known.iter().map(|spec| spec.name.clone()).collect(),
        }),
    }
}

/// Checks that an initial point is in `[0,1]^d`.
pub(crate) fn check_start(
    search: &'static str,
    start: Option<&Vec<f64>>,
    dimension: usize,
) -> Result<(), SearchError> {
    match start {
        Some(start) if start.len() != dimension || !start.iter().all(|x| (0.0..=1.0).contains(x)) => {
            Err(SearchError::Option {
                search,
                option: "start".to_owned(),
                found: format!("{start:?}"),
                expected: format!("{dimension} number{} in [0, 1]", if dimension == 1 { "" } else { "s" }),
            })
        }
        _ => Ok(()),
    }
}

/// Declares the options of a search as a structure: each field has a meaning, a type, a default and
/// a range.
///
/// A field that is `None` by default has a description of the behavior in that case. The macro
/// implements `Default`, the [`OptionSpec`]s (`specs`), the conversion from [`SearchOptions`]
/// (`read`) and a check of all ranges (`check_ranges`).
macro_rules! options {
    (
        $(#[$about:meta])*
        pub struct $name:ident of $search:ident {
            $(
                $(#[doc = $doc:literal])*
                pub $field:ident: $type:ty = $default:expr $(, or $without:literal)?, in $range:expr;
            )*
        }
    ) => {
        $(#[$about])*
        #[derive(Debug, Clone, PartialEq)]
        pub struct $name {
            $($(#[doc = $doc])* pub $field: $type,)*
        }

        impl Default for $name {
            fn default() -> Self {
                Self { $($field: $default,)* }
            }
        }

        impl $name {
            /// Returns the specifications of all options.
            pub fn specs() -> Vec<$crate::OptionSpec> {
                let defaults = Self::default();
                vec![$({
                    let without: Option<&str> = None;
                    $(let without = without.or(Some($without));)?
                    $crate::OptionSpec::new(
                        stringify!($field), &[$($doc),*], &defaults.$field, without, &$range,
                    )
                }),*]
            }

            /// Converts options by name; absent options have their defaults.
            ///
            /// # Errors
            /// [`SearchError::UnknownOption`](crate::SearchError::UnknownOption) for a name that is
            /// not listed in `specs`, [`SearchError::Option`](crate::SearchError::Option) for a
            /// wrong type or a value out of range.
            pub fn read(options: &$crate::SearchOptions) -> Result<Self, $crate::SearchError> {
                $crate::options::check_names($search, options, &Self::specs())?;
                let defaults = Self::default();
                Ok(Self {
                    $($field: $crate::options::read_option(
                        $search, stringify!($field), options, defaults.$field, &$range,
                    )?,)*
                })
            }

            /// Checks that every number is in its range.
            fn check_ranges(&self) -> Result<(), $crate::SearchError> {
                $($crate::options::check_option($search, stringify!($field), &self.$field, &$range)?;)*
                Ok(())
            }
        }
    };
}

pub(crate) use options;

#[cfg(test)]
mod tests {
    use super::*;

    const NAME: &str = "probe";

    options! {
        /// Options of every type.
        pub struct ProbeOptions of NAME {
            /// A tolerance,
            /// in two lines.
            pub tolerance: f64 = 1e-4, in NOT_NEGATIVE;
            /// A limit.
            pub max_steps: Option<usize> = None, or "no limit", in AT_LEAST_1;
            /// A switch.
            pub adaptive: bool = false, in ANY;
            /// A word.
            pub model: String = "linear".to_owned(), in ANY;
            /// A point.
            pub start: Option<Vec<f64>> = None, or "a random point", in POINT_OF_THE_BOX;
            /// Points.
            pub simplex: Vec<Vec<f64>> = Vec::new(), in ANY;
        }
    }

    #[test]
    fn a_declaration_defines_the_specifications() {
        let specs = ProbeOptions::specs();
        let columns: Vec<[&str; 5]> = specs
            .iter()
            .map(|spec| [spec.name.as_str(), spec.kind.name(), &spec.default, spec.range, &spec.meaning])
            .collect();
        assert_eq!(
            columns,
            [
                ["tolerance", "float", "0.0001", "at least 0", "A tolerance, in two lines."],
                ["max-steps", "integer", "no limit", "at least 1", "A limit."],
                ["adaptive", "boolean", "false", "", "A switch."],
                ["model", "text", "\"linear\"", "", "A word."],
                ["start", "point", "a random point", "d numbers in [0, 1]", "A point."],
                ["simplex", "list of points", "[]", "", "Points."],
            ]
        );
    }

    #[test]
    fn options_are_read_by_name_and_absent_options_have_their_defaults() {
        assert_eq!(ProbeOptions::read(&SearchOptions::new()), Ok(ProbeOptions::default()));
        let given = SearchOptions::new()
            .with("tolerance", 2)
            .with("max_steps", 9)
            .with("adaptive", true)
            .with("model", "cubic")
            .with("start", vec![0.5, 1.0])
            .with("simplex", vec![vec![0.0], vec![1.0]]);
        let expected = ProbeOptions {
            tolerance: 2.0,
            max_steps: Some(9),
            adaptive: true,
            model: "cubic".to_owned(),
            start: Some(vec![0.5, 1.0]),
            simplex: vec![vec![0.0], vec![1.0]],
        };
        assert_eq!(ProbeOptions::read(&given), Ok(expected));
    }

    #[track_caller]
    fn check_error(name: &str, value: impl Into<OptionValue>, message: &str) {
        let error = ProbeOptions::read(&SearchOptions::new().with(name, value)).expect_err("wrong");
        assert_eq!(error.to_string(), message);
    }

    #[test]
    fn an_invalid_option_is_reported_with_the_allowed_values() {
        let all = "tolerance, max-steps, adaptive, model, start, simplex";
        check_error("maxsteps", 3, &format!("probe has no option `maxsteps`; its options are: {all}"));
        check_error("tolerance", -1.0, "option `tolerance` of probe is -1.0; it must be at least 0");
        check_error("tolerance", f64::NAN, "option `tolerance` of probe is NaN; it must be at least 0");
        check_error(
            "tolerance",
            "a",
            "option `tolerance` of probe is \"a\"; it must be a number, at least 0",
        );
        check_error("max_steps", 0, "option `max-steps` of probe is 0; it must be at least 1");
        check_error("max_steps", -7, "option `max-steps` of probe is -7; it must be an integer, at least 1");
        check_error(
            "max_steps",
            1.5,
            "option `max-steps` of probe is 1.5; it must be an integer, at least 1",
        );
        check_error("adaptive", 1, "option `adaptive` of probe is 1; it must be true or false");
        check_error(
            "start",
            0.5,
            "option `start` of probe is 0.5; it must be a point (a list of numbers), d numbers in [0, 1]",
        );
    }

    #[test]
    fn a_structure_with_public_fields_is_checked_too() {
        assert_eq!(ProbeOptions::default().check_ranges(), Ok(()));
        let error = ProbeOptions { max_steps: Some(0), ..ProbeOptions::default() }.check_ranges();
        let expected = "option `max-steps` of probe is 0; it must be at least 1";
        assert_eq!(error.expect_err("out of range").to_string(), expected);
    }

    #[test]
    fn values_are_formatted_as_in_a_plan() {
        let written = |value: OptionValue| value.to_string();
        assert_eq!(written(2e-5.into()), "2e-5");
        assert_eq!(written(3.0.into()), "3.0");
        assert_eq!(written(vec![vec![0.1, 1.0]].into()), "[[0.1, 1.0]]");
        assert_eq!(written("a\"b".into()), r#""a\"b""#);
    }
}
