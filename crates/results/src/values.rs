//! Values that JSON cannot hold as they are, or not in a way that every reader preserves.

use serde::de::Error;
use serde::ser::SerializeMap;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// A number. An infinity, which JSON lacks, is the string `inf` or `-inf`. It is never NaN.
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd)]
pub struct Number(pub f64);

impl From<f64> for Number {
    fn from(value: f64) -> Number {
        Number(value)
    }
}

impl Serialize for Number {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        if self.0.is_finite() { serializer.serialize_f64(self.0) } else { serializer.collect_str(&self.0) }
    }
}

impl<'de> Deserialize<'de> for Number {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Number, D::Error> {
        #[derive(Deserialize)]
        #[serde(untagged)]
        enum Written {
            Finite(f64),
            Other(String),
        }
        match Written::deserialize(deserializer)? {
            Written::Finite(value) => Ok(Number(value)),
            Written::Other(text) if text == "inf" => Ok(Number(f64::INFINITY)),
            Written::Other(text) if text == "-inf" => Ok(Number(f64::NEG_INFINITY)),
            Written::Other(text) => {
                Err(Error::custom(format!("expected a number, inf or -inf, not {text:?}")))
            }
        }
    }
}

/// Serializes a number as [`Number`].
pub(crate) fn number<S: Serializer>(value: &f64, serializer: S) -> Result<S::Ok, S::Error> {
    Number(*value).serialize(serializer)
}

/// An optional number that is written and read as [`Number`].
pub(crate) mod optional {
    use super::*;

    pub(crate) fn serialize<S: Serializer>(value: &Option<f64>, serializer: S) -> Result<S::Ok, S::Error> {
        value.map(Number).serialize(serializer)
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<f64>, D::Error> {
        Ok(Option::<Number>::deserialize(deserializer)?.map(|Number(value)| value))
    }
}

/// A random seed: a string of digits, because many JSON readers round integers above 2^53.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Seed(pub u64);

impl Serialize for Seed {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(&self.0)
    }
}

impl<'de> Deserialize<'de> for Seed {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Seed, D::Error> {
        String::deserialize(deserializer)?.parse().map(Seed).map_err(Error::custom)
    }
}

/// Values with names, in this order: an object whose keys are the names.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Named<T>(pub Vec<(String, T)>);

/// A scenario: value by axis name. A value that is drawn at random is `null`.
pub type Scenario = Named<Option<f64>>;

impl<T> Named<T> {
    /// Returns the value with this name.
    pub fn get(&self, name: &str) -> Option<&T> {
        self.0.iter().find(|(known, _)| known == name).map(|(_, value)| value)
    }

    /// Returns the values in order.
    pub fn values(&self) -> impl Iterator<Item = &T> {
        self.0.iter().map(|(_, value)| value)
    }
}

impl<T> Default for Named<T> {
    fn default() -> Named<T> {
        Named(Vec::new())
    }
}

impl<N: Into<String>, T> FromIterator<(N, T)> for Named<T> {
    fn from_iter<I: IntoIterator<Item = (N, T)>>(values: I) -> Named<T> {
        Named(values.into_iter().map(|(name, value)| (name.into(), value)).collect())
    }
}

impl<T: Serialize> Serialize for Named<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.0.len()))?;
        for (name, value) in &self.0 {
            map.serialize_entry(name, value)?;
        }
        map.end()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(value: &impl Serialize) -> String {
        serde_json::to_string(value).unwrap()
    }

    #[test]
    fn infinities_and_seeds_are_strings() {
        assert_eq!(text(&Number(f64::INFINITY)), "\"inf\"");
        assert_eq!(text(&Number(f64::NEG_INFINITY)), "\"-inf\"");
        assert_eq!(text(&[Number(1.0), Number(-0.25)]), "[1.0,-0.25]");
        assert_eq!(text(&Seed(u64::MAX)), "\"18446744073709551615\"");
    }

    #[test]
    fn written_numbers_and_seeds_are_read_as_they_were() {
        for value in [0.1, -0.0, f64::MAX, 5e-324, f64::INFINITY, f64::NEG_INFINITY] {
            let read: Number = serde_json::from_str(&text(&Number(value))).unwrap();
            assert_eq!(read.0.to_bits(), value.to_bits());
        }
        assert_eq!(serde_json::from_str::<Seed>(&text(&Seed(u64::MAX))).unwrap(), Seed(u64::MAX));
        for wrong in ["\"nan\"", "\"1\"", "true"] {
            assert!(serde_json::from_str::<Number>(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn named_values_keep_their_order() {
        let scenario: Scenario = [("b", Some(1.0)), ("a", None)].into_iter().collect();
        assert_eq!(text(&scenario), r#"{"b":1.0,"a":null}"#);
        assert_eq!((scenario.get("b"), scenario.get("c")), (Some(&Some(1.0)), None));
    }
}
