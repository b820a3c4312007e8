//! Results as SARIF 2.1.0, which code scanning shows: a run with its rules, results and errors.
//!
//! Source: OASIS, "Static Analysis Results Interchange Format (SARIF) Version 2.1.0".

use std::path::{Component, Path};

use mishandle::build::{VERSION, build};
use mishandle::results::{LogVerdict, Regression, RegressionTest, Severity};
use mishandle_text::number_text;
use serde_json::{Value, json};

use super::{escape, log_verdicts};

/// A kind of results.
struct Rule {
    id: String,
    text: String,
}

/// A test or a verdict.
struct Finding {
    rule: usize,
    /// `pass`, or `error`, `warning` or `note` of a failure.
    level: &'static str,
    message: String,
    file: String,
    /// How the result differs from that with a baseline; `None` without a baseline.
    baseline: Option<&'static str>,
    properties: Value,
}

/// Returns a folder of counterexamples that were simulated again.
pub fn regression(found: &Regression) -> String {
    let rule = |id: &str, text: &str| Rule { id: id.to_string(), text: text.to_string() };
    let rules =
        vec![rule("counterexample", "The scenario of a recorded counterexample satisfies its formula.")];
    let file = |test: &RegressionTest| uri(&Path::new(&found.folder).join(&test.file));
    let is_error = |test: &&RegressionTest| test.result == "error";
    let finding = |test: &RegressionTest| {
        let fails = ["still fails", "new failure"].contains(&test.result.as_str());
        let baseline = test.baseline.as_ref().map(|_| match test.result.as_str() {
            "new failure" => "new",
            "fixed" => "updated",
            _ => "unchanged",
        });
        let message = match &test.reason {
            Some(reason) => format!("{}: {reason}", test.result),
            None => test.result.clone(),
        };
        Finding {
            rule: 0,
            level: match fails {
                false => "pass",
                // It fails with the baseline, too, so it is not a failure of the new controller.
                true if baseline == Some("unchanged") => "note",
                true => "error",
            },
            message,
            file: file(test),
            baseline,
            properties: json!({ "target": test.target, "robustness": test.robustness, "recordedRobustness": test.recorded_robustness }),
        }
    };
    let findings: Vec<Finding> = found.tests.iter().filter(|test| !is_error(test)).map(finding).collect();
    let errors = found.tests.iter().filter(is_error);
    let errors = errors.map(|test| (test.reason.clone().unwrap_or_default(), file(test))).collect();
    document(&rules, &findings, errors)
}

/// Returns verdicts of requirements on logs.
pub fn verdicts(found: &[LogVerdict]) -> String {
    let id = |verdict: &LogVerdict| verdict.name.clone().unwrap_or_else(|| verdict.formula.clone());
    let mut rules: Vec<Rule> = Vec::new();
    let mut findings = Vec::new();
    for verdict in found {
        let id = id(verdict);
        let rule = rules.iter().position(|rule| rule.id == id).unwrap_or_else(|| {
            let text = match &verdict.description {
                Some(description) => format!("{description}: {}", verdict.formula),
                None => verdict.formula.clone(),
            };
            rules.push(Rule { id, text });
            rules.len() - 1
        });
        findings.push(Finding {
            rule,
            level: match (verdict.violated, verdict.severity) {
                (false, _) => "pass",
                (true, Severity::Critical | Severity::Error) => "error",
                (true, Severity::Warning) => "warning",
            },
            message: format!(
                "robustness {}\n{}",
                number_text(verdict.robustness.0),
                log_verdicts::text(verdict)
            ),
            file: uri(Path::new(&verdict.log)),
            baseline: None,
            properties: json!({ "robustness": verdict.robustness }),
        });
    }
    document(&rules, &findings, Vec::new())
}

/// Returns a log file with one run. `errors` are messages with the file of each.
fn document(rules: &[Rule], findings: &[Finding], errors: Vec<(String, String)>) -> String {
    let text = |text: &str| json!({ "text": escape::text(text) });
    let location = |file: &str| json!([{ "physicalLocation": { "artifactLocation": { "uri": file } } }]);
    let rule = |rule: &Rule| json!({ "id": escape::name(&rule.id), "shortDescription": text(&rule.text) });
    let result = |finding: &Finding| {
        let is_pass = finding.level == "pass";
        let mut result = json!({
            "ruleId": escape::name(&rules[finding.rule].id),
            "ruleIndex": finding.rule,
            "kind": if is_pass { "pass" } else { "fail" },
            "level": if is_pass { "none" } else { finding.level },
            "message": text(&finding.message),
            "locations": location(&finding.file),
            "partialFingerprints": { "file/v1": finding.file },
            "properties": finding.properties,
        });
        if let Some(baseline) = finding.baseline {
            result["baselineState"] = json!(baseline);
        }
        result
    };
    let is_successful = errors.is_empty();
    let error = |(message, file): (String, String)| json!({ "level": "error", "message": text(&message), "locations": location(&file) });
    let notifications: Vec<Value> = errors.into_iter().map(error).collect();
    let document = json!({
        "$schema": "https://docs.oasis-open.org/sarif/sarif/v2.1.0/errata01/os/schemas/sarif-schema-2.1.0.json",
        "version": "2.1.0",
        "runs": [{
            "tool": { "driver": {
                "name": "mishandle",
                "version": VERSION,
                "properties": { "commit": build().git_commit },
                "rules": rules.iter().map(rule).collect::<Vec<_>>(),
            } },
            "invocations": [{ "executionSuccessful": is_successful, "toolExecutionNotifications": notifications }],
            "results": findings.iter().map(result).collect::<Vec<_>>(),
        }],
    });
    format!("{document:#}\n")
}

/// Returns a path as a reference of a URI, RFC 3986.
fn uri(path: &Path) -> String {
    let part = |part: &str| -> String {
        let byte = |byte: u8| match byte {
            b'0'..=b'9' | b'a'..=b'z' | b'A'..=b'Z' | b'-' | b'.' | b'_' | b'~' => {
                char::from(byte).to_string()
            }
            _ => format!("%{byte:02X}"),
        };
        part.bytes().map(byte).collect()
    };
    let mut parts = Vec::new();
    for component in path.components() {
        match component {
            Component::RootDir => parts.push("file://".to_string()),
            Component::CurDir => {}
            other => parts.push(part(&other.as_os_str().to_string_lossy())),
        }
    }
    parts.join("/")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_is_a_reference_of_rfc_3986() {
        for (path, expected) in [
            ("logs/a.csv", "logs/a.csv"),
            ("./logs/my log#1.csv", "logs/my%20log%231.csv"),
            ("/tmp/ü.csv", "file:///tmp/%C3%BC.csv"),
            ("a:b", "a%3Ab"),
        ] {
            assert_eq!(uri(Path::new(path)), expected);
        }
    }
}
