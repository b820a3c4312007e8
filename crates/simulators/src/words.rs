//! Errors of JSON in words of the protocol.

/// Names of types in Rust that errors of `serde` contain, and what a program shall write.
const WORDS: [(&str, &str); 9] = [
    ("usize", "a whole number that is not negative"),
    ("u64", "a whole number that is not negative"),
    ("u32", "a whole number that is not negative"),
    ("f64", "a number"),
    ("a string", "a text"),
    ("a borrowed string", "a text"),
    ("a sequence", "a list"),
    ("a map", "an object"),
    ("an array of length 2", "a list of 2 numbers"),
];

/// Returns an error of JSON without names of types in Rust: `expected usize` becomes `expected a
/// whole number that is not negative`.
pub(crate) fn in_words(error: &serde_json::Error) -> String {
    let text = error.to_string();
    // What the program wrote comes before.
    let Some((found, expected)) = text.rsplit_once(", expected ") else { return text };
    let (what, place) = match expected.rfind(" at line ") {
        Some(at) => expected.split_at(at),
        None => (expected, ""),
    };
    let what = match what.strip_prefix("struct ") {
        Some(_) => "an object",
        None => WORDS.iter().find(|(name, _)| *name == what).map_or(what, |(_, words)| words),
    };
    format!("{found}, expected {what}{place}")
}

#[cfg(test)]
mod tests {
    use serde::Deserialize;

    use super::*;

    #[derive(Debug, Deserialize)]
    struct Steps {
        #[serde(rename = "steps")]
        _steps: usize,
    }

    fn words_of<T: for<'a> Deserialize<'a>>(text: &str) -> String {
        in_words(&serde_json::from_str::<T>(text).err().expect("an error"))
    }

    #[test]
    fn types_of_rust_become_words() {
        for (found, what) in [
            (words_of::<Steps>("[]"), "an object"),
            (words_of::<Steps>("7"), "an object"),
            (words_of::<Steps>("{\"steps\": -1}"), "a whole number that is not negative"),
            (words_of::<u64>("1.5"), "a whole number that is not negative"),
            (words_of::<f64>("\"x, expected u64\""), "a number"),
            (words_of::<String>("1"), "a text"),
            (words_of::<Vec<f64>>("1"), "a list"),
            (words_of::<[f64; 2]>("1"), "a list of 2 numbers"),
        ] {
            let expected = found.rsplit_once(", expected ").map(|(_, expected)| expected).unwrap_or_default();
            let words = expected.split(" at line ").next().unwrap_or_default();
            assert_eq!(words, what, "{found}");
        }
        // What the program wrote stays as it is.
        assert!(words_of::<f64>("\"x, expected u64\"").contains("\"x, expected u64\""));
        assert!(words_of::<Steps>("{").starts_with("EOF while parsing"));
    }
}
