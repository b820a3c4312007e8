//! JUnit XML, which continuous integration shows as tests.

use std::path::Path;
use std::time::Duration;

use mishandle::results::{Regression, RegressionResult, RegressionTest};
use mishandle_text::xml_text;

use crate::show::escape;

/// Returns the report of a folder of counterexamples as JUnit XML. `times` are those of the tests.
pub fn report(found: &Regression, times: &[Duration]) -> String {
    let seconds: f64 = times.iter().map(Duration::as_secs_f64).sum();
    let failures = found.new_failures.unwrap_or(found.fails);
    let without_test = found.tests.iter().filter(|test| element(test) == Some("skipped")).count();
    let counts = format!(
        "tests=\"{}\" failures=\"{failures}\" errors=\"{}\" skipped=\"{}\" time=\"{seconds:.3}\"",
        found.tests.len(),
        found.errors + found.without_verdict,
        without_test,
    );
    let cases: String = found.tests.iter().zip(times).map(|(test, time)| case(test, *time)).collect();
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites {counts}>\n  <testsuite name=\"{}\" {counts}>\n{cases}  \
         </testsuite>\n</testsuites>\n",
        escaped(&found.folder)
    )
}

/// Returns the element of a test that is not passed.
fn element(test: &RegressionTest) -> Option<&'static str> {
    match test.result {
        RegressionResult::Error | RegressionResult::NoVerdict => Some("error"),
        // It fails with the baseline, too, so it is not a failure of the new controller.
        RegressionResult::Fails if test.baseline.is_some() => Some("skipped"),
        RegressionResult::Fails | RegressionResult::NewFailure => Some("failure"),
        RegressionResult::Passes | RegressionResult::Fixed => test.asks_nothing.as_ref().map(|_| "skipped"),
    }
}

fn case(test: &RegressionTest, time: Duration) -> String {
    let name = Path::new(&test.file).file_stem().unwrap_or_default().to_string_lossy();
    let open = format!(
        "    <testcase classname=\"{}\" name=\"{}\" time=\"{:.3}\"",
        escaped(test.target.as_deref().unwrap_or("unknown")),
        escaped(&name),
        time.as_secs_f64()
    );
    let Some(element) = element(test) else { return open + "/>\n" };
    let message = match (&test.reason, &test.asks_nothing) {
        (Some(reason), _) if test.baseline.is_some() => format!("{}: {reason}", test.result),
        (Some(reason), _) => reason.clone(),
        (None, nothing) => format!("asks nothing: {}", nothing.as_deref().unwrap_or_default()),
    };
    let message = escaped(&message);
    format!("{open}>\n      <{element} message=\"{message}\">{message}</{element}>\n    </testcase>\n")
}

/// Escapes text for an attribute or the content of an element. XML allows no control characters, so
/// they are written as in messages, such as `\u{1b}`.
fn escaped(text: &str) -> String {
    xml_text(&escape::name(text))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_character_breaks_the_document() {
        assert_eq!(escaped("a<b>&\"c'"), "a&lt;b&gt;&amp;&quot;c'");
        assert_eq!(escaped("\u{1b}[0m\n\u{0}\u{ffff}ü"), "\\u{1b}[0m\\n\\u{0}\u{fffd}ü");
    }
}
