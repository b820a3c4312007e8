//! Answers about a simulation, read into columns as they stand in the text.

use std::fmt;

use serde::de::{DeserializeSeed, Deserializer, Error, MapAccess, SeqAccess, Visitor};

use crate::words::in_words;

/// Largest length of a reason that is kept, bytes.
const LONGEST_REASON: usize = 2000;

/// How a simulator ended a simulation by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum End {
    Terminated,
    Diverged,
    Invalid,
}

const ENDS: [(&str, End); 3] =
    [("terminated", End::Terminated), ("diverged", End::Diverged), ("invalid", End::Invalid)];

/// A question, with the sizes of its answer.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Asked<'a> {
    /// Number of the question.
    pub id: u64,
    /// Names of the signals.
    pub signals: &'a [String],
    pub kind: AskedKind,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum AskedKind {
    /// A trace of at most this number of samples.
    Trace { samples: usize },
    /// One sample with an observation of this length, if there is a policy.
    Sample { observation: Option<usize> },
}

/// An answer.
#[derive(Debug, Default)]
pub(crate) struct Answer {
    pub error: Option<String>,
    pub end: Option<End>,
    pub reason: String,
    /// One column per signal, in the order of the names.
    pub trace: Option<Vec<Vec<f64>>>,
    pub signals: Option<Vec<f64>>,
    pub observation: Option<Vec<f64>>,
}

/// Reads an answer, and checks its sizes.
///
/// # Errors
/// Returns what the program wrote, for a message.
pub(crate) fn read(text: &str, asked: Asked<'_>) -> Result<Answer, String> {
    let mut deserializer = serde_json::Deserializer::from_str(text);
    let answer = asked.deserialize(&mut deserializer).and_then(|answer| deserializer.end().map(|()| answer));
    let answer = answer.map_err(|error| {
        let start: String = text.chars().take(200).collect();
        let example = match asked.kind {
            AskedKind::Trace { .. } => "{\"id\": 2, \"trace\": {\"level\": [0.5, 0.4]}}",
            AskedKind::Sample { observation: None } => "{\"id\": 2, \"signals\": [0.5]}",
            AskedKind::Sample { .. } => "{\"id\": 2, \"signals\": [0.5], \"observation\": [0.5]}",
        };
        format!("`{start}`, which is not an answer such as {example}: {}", in_words(&error))
    })?;
    if answer.error.is_none() {
        check(&answer, asked)?;
    }
    Ok(answer)
}

/// Checks that an answer has all numbers that its end leaves to it.
fn check(answer: &Answer, asked: Asked<'_>) -> Result<(), String> {
    match asked.kind {
        AskedKind::Trace { samples } => {
            let Some(columns) = &answer.trace else {
                return match answer.end {
                    Some(End::Invalid | End::Diverged) => Ok(()),
                    _ => Err("an answer without `trace`".to_string()),
                };
            };
            let lengths = || columns.iter().map(Vec::len);
            let length = lengths().max().unwrap_or_default();
            if let Some((name, shorter)) = asked.signals.iter().zip(lengths()).find(|(_, n)| *n != length) {
                return Err(format!(
                    "{shorter} numbers of the signal `{name}`, but {length} of another one; all lists of a trace have one \
                     length"
                ));
            }
            match answer.end {
                None if length != samples => Err(format!(
                    "a trace of {length} samples instead of {samples}: one before the first control step and one after \
                     each; a simulation that ended early says `\"end\": \"terminated\"`"
                )),
                Some(End::Terminated) if length == 0 => Err("a trace without a sample".to_string()),
                _ => Ok(()),
            }
        }
        AskedKind::Sample { observation } => {
            let may_lack = matches!(answer.end, Some(End::Invalid | End::Diverged));
            let sizes = [
                ("signals", &answer.signals, Some(asked.signals.len())),
                ("observation", &answer.observation, observation),
            ];
            for (name, found, expected) in sizes {
                match (found.as_ref().map(Vec::len), expected) {
                    (None, Some(_)) if may_lack => {}
                    (found, expected) if found == expected => {}
                    (None, _) => return Err(format!("an answer without `{name}`")),
                    (Some(found), expected) => {
                        let expected = expected.unwrap_or_default();
                        return Err(format!("a list `{name}` of {found} numbers instead of {expected}"));
                    }
                }
            }
            Ok(())
        }
    }
}

/// Returns the start of a text that is kept in a run.
pub(crate) fn kept(text: &str) -> String {
    text[..text.floor_char_boundary(LONGEST_REASON)].to_string()
}

impl<'de> DeserializeSeed<'de> for Asked<'_> {
    type Value = Answer;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Answer, D::Error> {
        deserializer.deserialize_map(self)
    }
}

impl<'de> Visitor<'de> for Asked<'_> {
    type Value = Answer;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an object")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Answer, A::Error> {
        let mut answer = Answer::default();
        let mut id: Option<u64> = None;
        let mut reason: Option<String> = None;
        let numbers = |longest| Numbers { longest };
        while let Some(key) = map.next_key::<Key>()? {
            match (key.0.as_str(), self.kind) {
                ("id", _) => once(&mut id, "id", map.next_value()?)?,
                ("error", _) => once(&mut answer.error, "error", kept(&map.next_value::<String>()?))?,
                ("reason", _) => once(&mut reason, "reason", kept(&map.next_value::<String>()?))?,
                ("end", _) => once(&mut answer.end, "end", end(&map.next_value::<String>()?)?)?,
                ("trace", AskedKind::Trace { samples }) => {
                    let columns = map.next_value_seed(Columns { names: self.signals, samples })?;
                    once(&mut answer.trace, "trace", columns)?;
                }
                ("signals", AskedKind::Sample { .. }) => {
                    let list = map.next_value_seed(numbers(self.signals.len()))?;
                    once(&mut answer.signals, "signals", list)?;
                }
                ("observation", AskedKind::Sample { observation: Some(size) }) => {
                    let list = map.next_value_seed(numbers(size))?;
                    once(&mut answer.observation, "observation", list)?;
                }
                (other, kind) => {
                    let known = match kind {
                        AskedKind::Trace { .. } => "id, trace, end, reason, error",
                        AskedKind::Sample { observation: None } => "id, signals, end, reason, error",
                        AskedKind::Sample { .. } => "id, signals, observation, end, reason, error",
                    };
                    let other: String = other.chars().take(100).collect();
                    return Err(A::Error::custom(format!("unknown key `{other}`; known: {known}")));
                }
            }
        }
        match id {
            Some(id) if id == self.id => {}
            Some(id) => {
                return Err(A::Error::custom(format!("it has the id {id} instead of {}", self.id)));
            }
            None => return Err(A::Error::missing_field("id")),
        }
        answer.reason = reason.unwrap_or_default();
        Ok(answer)
    }
}

fn once<T, E: Error>(place: &mut Option<T>, name: &'static str, value: T) -> Result<(), E> {
    match place.replace(value) {
        None => Ok(()),
        Some(_) => Err(E::duplicate_field(name)),
    }
}

fn end<E: Error>(text: &str) -> Result<End, E> {
    let found = ENDS.iter().find(|(name, _)| *name == text).map(|(_, end)| *end);
    found.ok_or_else(|| E::custom("`end` is `terminated`, `diverged` or `invalid`"))
}

/// A key of an object. A short one does not allocate twice.
#[derive(serde::Deserialize)]
#[serde(transparent)]
struct Key(String);

/// The lists of a trace by the names of the signals.
struct Columns<'a> {
    names: &'a [String],
    samples: usize,
}

impl<'de> DeserializeSeed<'de> for Columns<'_> {
    type Value = Vec<Vec<f64>>;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Self::Value, D::Error> {
        deserializer.deserialize_map(self)
    }
}

impl<'de> Visitor<'de> for Columns<'_> {
    type Value = Vec<Vec<f64>>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an object with a list of numbers for each signal")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Self::Value, A::Error> {
        let mut columns: Vec<Option<Vec<f64>>> = self.names.iter().map(|_| None).collect();
        let mut next = 0;
        while let Some(Key(name)) = map.next_key()? {
            // Programs mostly write the signals in the order of their description.
            let is_next = self.names.get(next) == Some(&name);
            let index = if is_next { Some(next) } else { self.names.iter().position(|known| *known == name) };
            let Some(index) = index else {
                let name: String = name.chars().take(100).collect();
                return Err(A::Error::custom(format!("the trace has an unknown signal `{name}`")));
            };
            let list = map.next_value_seed(Numbers { longest: self.samples })?;
            if columns[index].replace(list).is_some() {
                return Err(A::Error::custom(format!("the trace has the signal `{name}` twice")));
            }
            next = index + 1;
        }
        let missing = |name: &String| A::Error::custom(format!("the trace lacks the signal `{name}`"));
        let columns = columns.into_iter().zip(self.names);
        columns.map(|(column, name)| column.ok_or_else(|| missing(name))).collect()
    }
}

/// A list of at most `longest` numbers. `null` stands for NaN and infinities, which JSON lacks.
struct Numbers {
    longest: usize,
}

impl<'de> DeserializeSeed<'de> for Numbers {
    type Value = Vec<f64>;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Vec<f64>, D::Error> {
        deserializer.deserialize_seq(self)
    }
}

impl<'de> Visitor<'de> for Numbers {
    type Value = Vec<f64>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a list of numbers")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Vec<f64>, A::Error> {
        // Grows with what arrives, not with the number that the simulator announced.
        let mut numbers = Vec::new();
        while let Some(number) = list.next_element::<Option<f64>>()? {
            if numbers.len() == self.longest {
                return Err(A::Error::custom(format!("a list of more than {} numbers", self.longest)));
            }
            numbers.push(number.unwrap_or(f64::NAN));
        }
        Ok(numbers)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asked(signals: &[String]) -> Asked<'_> {
        Asked { id: 7, signals, kind: AskedKind::Trace { samples: 3 } }
    }

    fn names() -> Vec<String> {
        vec!["a".to_string(), "b".to_string()]
    }

    #[test]
    fn columns_have_the_order_of_the_signals() {
        let names = names();
        let text = r#"{"trace": {"b": [4, 5e0, 6.0], "a": [1, null, 3]}, "id": 7}"#;
        let columns = read(text, asked(&names)).expect("an answer").trace.expect("a trace");
        assert_eq!(columns[1], [4.0, 5.0, 6.0]);
        assert!(columns[0][1].is_nan() && columns[0][2] == 3.0);
    }

    #[test]
    fn wrong_answers_name_their_mistake() {
        let names = names();
        let trace = r#""trace": {"a": [1, 2, 3], "b": [1, 2, 3]}"#;
        for (text, expected) in [
            ("[]".to_string(), "an object"),
            (format!("{{{trace}}}"), "missing field `id`"),
            (format!("{{\"id\": 8, {trace}}}"), "the id 8 instead of 7"),
            (format!("{{\"id\": 7, {trace}, \"ende\": 1}}"), "unknown key `ende`"),
            (format!("{{\"id\": 7, {trace}}} 1"), "trailing"),
            (r#"{"id": 7, "trace": {"a": [1, 2, 3]}}"#.to_string(), "lacks the signal `b`"),
            (r#"{"id": 7, "trace": {"a": [1, 2, 3, 4], "b": []}}"#.to_string(), "more than 3"),
            (r#"{"id": 7, "trace": {"a": [1, 2], "b": [1, 2]}}"#.to_string(), "2 samples instead of 3"),
            (r#"{"id": 7, "trace": {"a": [1, 2, 3], "b": [1]}}"#.to_string(), "one length"),
            (r#"{"id": 7, "trace": {"a": ["nan", 2, 3], "b": [1]}}"#.to_string(), "expected a number"),
            (r#"{"id": 7, "trace": {"a": [NaN, 2, 3], "b": [1]}}"#.to_string(), "expected"),
            (r#"{"id": 7, "end": "done"}"#.to_string(), "`end` is"),
            (r#"{"id": 7, "signals": [1, 2]}"#.to_string(), "unknown key `signals`"),
            (r#"{"id": 7}"#.to_string(), "without `trace`"),
        ] {
            let error = read(&text, asked(&names)).expect_err(&text);
            assert!(error.contains(expected), "{text}: {error}");
        }
    }

    #[test]
    fn an_early_end_allows_a_short_trace() {
        let names = names();
        let text = r#"{"id": 7, "trace": {"a": [1, 2], "b": [1, 2]}, "end": "terminated", "reason": "dry"}"#;
        let answer = read(text, asked(&names)).expect("an answer");
        assert_eq!((answer.end, answer.reason.as_str()), (Some(End::Terminated), "dry"));
        assert!(read(r#"{"id": 7, "end": "invalid"}"#, asked(&names)).is_ok());
        let refused = read(r#"{"id": 7, "error": "no license"}"#, asked(&names)).expect("an answer");
        assert_eq!(refused.error.as_deref(), Some("no license"));
    }
}
