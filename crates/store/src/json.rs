//! Lists of numbers as JSON text. Finite numbers are read back with the same bits, infinities are
//! the strings `"inf"` and `"-inf"`, and a missing value is `null`.

use std::fmt;

use serde::de::{Deserialize, Deserializer, MapAccess, Visitor};
use serde_json::{Result, Value};

const INFINITY: &str = "inf";
const MINUS_INFINITY: &str = "-inf";

/// Returns a JSON object that maps each name to its value. `names` and `values` have the same
/// length.
pub(crate) fn object<'a>(names: impl Iterator<Item = &'a str>, values: &[Option<f64>]) -> Result<String> {
    let mut text = Vec::with_capacity(2 + values.len() * 40);
    text.push(b'{');
    for (name, value) in names.zip(values) {
        if text.len() > 1 {
            text.push(b',');
        }
        serde_json::to_writer(&mut text, name)?;
        text.push(b':');
        match *value {
            Some(f64::INFINITY) => serde_json::to_writer(&mut text, INFINITY)?,
            Some(f64::NEG_INFINITY) => serde_json::to_writer(&mut text, MINUS_INFINITY)?,
            value => serde_json::to_writer(&mut text, &value)?,
        }
    }
    text.push(b'}');
    Ok(String::from_utf8(text).unwrap_or_default())
}

/// Returns a JSON array of finite numbers.
pub(crate) fn array(values: &[f64]) -> Result<String> {
    serde_json::to_string(values)
}

/// The entries of an object in their order. A map would drop an entry with a repeated key: it keeps
/// the last value, but SQLite reads the first.
struct Entries(Vec<(String, Value)>);

impl<'de> Deserialize<'de> for Entries {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        struct EntriesVisitor;
        impl<'de> Visitor<'de> for EntriesVisitor {
            type Value = Entries;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("an object")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> std::result::Result<Entries, A::Error> {
                let mut entries = Vec::new();
                while let Some(entry) = map.next_entry()? {
                    entries.push(entry);
                }
                Ok(Entries(entries))
            }
        }
        deserializer.deserialize_map(EntriesVisitor)
    }
}

/// Parses an [`object`] with exactly these names in this order. Returns `None` for other text.
pub(crate) fn parse_object<'a>(
    text: &str,
    names: impl ExactSizeIterator<Item = &'a str>,
) -> Option<Vec<Option<f64>>> {
    let Entries(entries) = serde_json::from_str(text).ok()?;
    if entries.len() != names.len() {
        return None;
    }
    let value = |(name, (key, value)): (&str, (String, Value))| match value {
        _ if key != name => None,
        Value::Null => Some(None),
        Value::String(text) if text == INFINITY => Some(Some(f64::INFINITY)),
        Value::String(text) if text == MINUS_INFINITY => Some(Some(f64::NEG_INFINITY)),
        value => value.as_f64().map(Some),
    };
    names.zip(entries).map(value).collect()
}

/// Parses an [`array`]. Returns `None` for other text.
pub(crate) fn parse_array(text: &str) -> Option<Vec<f64>> {
    serde_json::from_str(text).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_object_is_standard_json() {
        let names = ["x", "say \"hi\"", "ρ", "high", "low"];
        let values = [Some(0.1), None, Some(-0.0), Some(f64::INFINITY), Some(f64::NEG_INFINITY)];
        let text = object(names.into_iter(), &values).unwrap();
        assert_eq!(text, r#"{"x":0.1,"say \"hi\"":null,"ρ":-0.0,"high":"inf","low":"-inf"}"#);
        assert_eq!(parse_object(&text, names.into_iter()).unwrap(), values);
        assert_eq!(object([].into_iter(), &[]).unwrap(), "{}");
        assert_eq!(parse_object("{}", [].into_iter()).unwrap(), []);
    }

    #[test]
    fn every_finite_number_is_read_back_with_the_same_bits() {
        // Bit patterns of every exponent, and difficult numbers.
        let patterns = (0..200_000_u64).map(|k| f64::from_bits(k.wrapping_mul(0x9e37_79b9_7f4a_7c15)));
        let hard = [
            0.0,
            -0.0,
            5e-324,
            f64::MIN_POSITIVE,
            f64::MAX,
            f64::MIN,
            1e15,
            1e16,
            1e22,
            9_007_199_254_740_993.0,
        ];
        let values: Vec<f64> = patterns.chain(hard).filter(|value| value.is_finite()).collect();
        let read = parse_array(&array(&values).unwrap()).unwrap();
        assert!(values.iter().map(|value| value.to_bits()).eq(read.iter().map(|value| value.to_bits())));
    }

    #[test]
    fn other_text_is_rejected() {
        let read = |text| parse_object(text, ["a", "b"].into_iter());
        assert_eq!(read(r#"{"a":2.5, "b":1}"#).unwrap(), [Some(2.5), Some(1.0)]);
        for text in [
            "",
            "{}",
            "null",
            "[1,2]",
            r#"{"a":1}"#,
            r#"{"a":1,"c":2}"#,
            // SQLite would read the first value of a repeated key.
            r#"{"a":1,"a":2,"b":3}"#,
            r#"{"a":1,"a":2}"#,
            r#"{"b":1,"a":2}"#,
            r#"{"a":1,"b":2,"c":3}"#,
            r#"{"a":1,"b":"nan"}"#,
            r#"{"a":1,"b":true}"#,
            r#"{"a":1,"b":1e999}"#,
            r#"{"a":1,"b":2"#,
        ] {
            assert_eq!(read(text), None, "{text}");
        }
        for text in ["", "{}", "[null]", "[1,", r#"["inf"]"#] {
            assert_eq!(parse_array(text), None, "{text}");
        }
    }
}
