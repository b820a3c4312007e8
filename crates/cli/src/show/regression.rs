//! A folder of counterexamples that were simulated again, as text.

use mishandle::results::{Number, Regression, RegressionResult, RegressionTest, Repeats};
use mishandle_text::{decimal, plural};

use super::{answer, escape, output};

/// Reports on stderr what is uncertain about the results.
pub fn report_problems(found: &Regression) {
    for test in &found.tests {
        let file = escape::name(&test.file);
        if [RegressionResult::Error, RegressionResult::NoVerdict].contains(&test.result) {
            output::message(&format!("error: {file}: {}", test.reason.as_deref().unwrap_or_default()));
        } else if test.same_target == Some(false) {
            output::message(&format!(
                "warning: {file}: the target has changed since the counterexample was recorded, so its scenario may have \
                 another meaning"
            ));
        } else if test.same_target.is_none() {
            output::message(&format!(
                "warning: {file}: it is not known whether the target is the one of the counterexample: the recorded controller \
                 cannot be loaded, or the hash of the target does not cover all of it"
            ));
        }
    }
}

/// Returns a table of the tests, their numbers, and why tests fail.
pub fn text(found: &Regression) -> String {
    let tests = &found.tests;
    let has_baseline = tests.iter().any(|test| test.baseline.is_some());
    let has_repeats = tests.iter().any(|test| test.repeats.is_some());
    let mut columns = vec!["file", "recorded robustness"];
    columns.extend(has_baseline.then_some("baseline robustness"));
    columns.push("robustness now");
    if has_repeats {
        columns.extend(has_baseline.then_some("baseline failure rate"));
        columns.push("failure rate");
    }
    columns.push("result");
    let mut rows = vec![columns.into_iter().map(String::from).collect::<Vec<_>>()];
    for test in tests {
        let value = |value: Option<Number>| value.map_or("-".to_string(), |value| decimal(value.0, 4));
        let rate = |repeats: Option<&Repeats>| {
            let rate = repeats.and_then(|repeats| repeats.failure_rate.value);
            rate.map_or("-".to_string(), |rate| format!("{:.1} %", 100.0 * rate))
        };
        let baseline = test.baseline.as_ref();
        let mut row = vec![test.file.clone(), value(test.recorded_robustness)];
        row.extend(baseline.map(|baseline| value(baseline.robustness)));
        row.push(value(test.robustness));
        if has_repeats {
            row.extend(baseline.map(|baseline| rate(baseline.repeats.as_ref())));
            row.push(rate(test.repeats.as_ref()));
        }
        row.push(test.result.to_string());
        rows.push(row);
    }
    let failing = tests
        .iter()
        .filter(|test| [RegressionResult::Fails, RegressionResult::NewFailure].contains(&test.result));
    let reasons: String = failing
        .map(|test| {
            format!(
                "\n{}: {}",
                escape::name(&test.file),
                escape::name(test.reason.as_deref().unwrap_or_default())
            )
        })
        .collect();
    let gap = if reasons.is_empty() { "" } else { "\n" };
    let nothing = answer::asks_nothing(found.asks_nothing().map(str::to_owned).as_ref());
    format!("{nothing}{}\n\n{}{gap}{reasons}", output::table(&rows), summary(tests, has_baseline))
}

/// Returns the numbers of tests by result. With a baseline also how far the tests that fail with
/// both controllers are from it: a worse controller violates them by more.
fn summary(tests: &[RegressionTest], has_baseline: bool) -> String {
    let n = |results: &[RegressionResult]| tests.iter().filter(|test| results.contains(&test.result)).count();
    let head = plural(tests.len(), "counterexample");
    let errors = plural(n(&[RegressionResult::Error]), "error");
    let errors = match n(&[RegressionResult::NoVerdict]) {
        0 => errors,
        undecided => format!("{undecided} without a verdict, {errors}"),
    };
    if !has_baseline {
        return format!(
            "{head}: {} pass, {} still fail, {errors}",
            n(&[RegressionResult::Passes, RegressionResult::Fixed]),
            n(&[RegressionResult::Fails, RegressionResult::NewFailure])
        );
    }
    let mut text = format!(
        "{head}: {}, {} still fail, {} fixed, {} pass with both, {errors}",
        plural(n(&[RegressionResult::NewFailure]), "new failure"),
        n(&[RegressionResult::Fails]),
        n(&[RegressionResult::Fixed]),
        n(&[RegressionResult::Passes]),
    );
    let still = tests.iter().filter(|test| test.result == RegressionResult::Fails);
    let pairs = still.filter_map(|test| test.robustness.zip(test.baseline.as_ref()?.robustness));
    let pairs: Vec<(Number, Number)> = pairs.collect();
    if !pairs.is_empty() {
        let lower = pairs.iter().filter(|(now, before)| now < before).count();
        let higher = pairs.iter().filter(|(now, before)| now > before).count();
        text.push_str(&format!(
            "\nOf those that still fail, the robustness is lower than with the baseline in {lower}, higher in {higher}, equal in {}",
            pairs.len() - lower - higher
        ));
    }
    text
}
