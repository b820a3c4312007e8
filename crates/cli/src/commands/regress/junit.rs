//! JUnit XML, which continuous integration shows as tests.

use super::{FAILS, Outcome, Test, count, reason};
use crate::show::escape;

/// Returns the report of a folder.
pub(super) fn report(folder: &str, tests: &[Test]) -> String {
    let seconds: f64 = tests.iter().map(|test| test.time.as_secs_f64()).sum();
    let has_baseline = tests.iter().any(|test| test.baseline.is_some());
    let failures = tests.iter().filter(|test| test.outcome.is_failure(has_baseline)).count();
    let counts = format!(
        "tests=\"{}\" failures=\"{failures}\" errors=\"{}\" skipped=\"{}\" time=\"{seconds:.3}\"",
        tests.len(),
        count(tests, &[Outcome::Error]),
        count(tests, &FAILS) - failures,
    );
    let cases: String = tests.iter().map(case).collect();
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites {counts}>\n  <testsuite name=\"{}\" {counts}>\n{cases}  \
         </testsuite>\n</testsuites>\n",
        escaped(folder)
    )
}

fn case(test: &Test) -> String {
    let target = test.recorded.as_ref().map_or("unknown", |recorded| recorded.target.name.as_str());
    let open = format!(
        "    <testcase classname=\"{}\" name=\"{}\" time=\"{:.3}\"",
        escaped(target),
        escaped(&test.name),
        test.time.as_secs_f64()
    );
    let element = match test.outcome {
        Outcome::Passes | Outcome::Fixed => return open + "/>\n",
        // It fails with the baseline, too, so it is not a failure of the new controller.
        Outcome::Fails if test.baseline.is_some() => "skipped",
        Outcome::Fails | Outcome::NewFailure => "failure",
        Outcome::Error => "error",
    };
    let message = match &test.baseline {
        Some(_) => escaped(&format!("{}: {}", test.outcome.name(), reason(test))),
        None => escaped(&reason(test)),
    };
    format!("{open}>\n      <{element} message=\"{message}\">{message}</{element}>\n    </testcase>\n")
}

/// Escapes text for an attribute or the content of an element. XML allows no control characters, so they are written as in
/// messages, such as `\u{1b}`.
fn escaped(text: &str) -> String {
    let mut escaped = String::new();
    for c in escape::name(text).chars() {
        match c {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\'' => escaped.push_str("&apos;"),
            '\u{fffe}' | '\u{ffff}' => escaped.push_str(&c.escape_unicode().to_string()),
            c => escaped.push(c),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_character_breaks_the_document() {
        assert_eq!(escaped("a<b>&\"c'"), "a&lt;b&gt;&amp;&quot;c&apos;");
        assert_eq!(escaped("\u{1b}[0m\n\u{0}\u{ffff}ü"), "\\u{1b}[0m\\n\\u{0}\\u{ffff}ü");
    }
}
