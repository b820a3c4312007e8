//! `mishandle evidence --verify`: what no replay can find is said, manifest, pages and README
//! follow from the run files, nothing is written, and an interruption does not count as agreement.

use std::fs;
use std::ops::ControlFlow;
use std::path::Path;
use std::process::Command;

use mishandle::store::{
    IfExists, RunFile, RunHeader, RunWriter, Simulation, SimulationEnd, TrialStatus, TrialSummary,
};
use mishandle_cli::words::shell_command;
use mishandle_evidence::{Signers, Verification};
use serde_json::{Value, json};

use crate::bench::{Bench, text};

/// Makes an evaluation with failures, which is complete, and its folder.
fn evaluation() -> Bench {
    let bench = Bench::new();
    bench.run("evaluate toy/sphere-2d --episodes 400 --seed 3 --out run.sqlite");
    bench.check("evidence run.sqlite --out ev", 0);
    bench
}

/// Writes a run with changed rows, whose hashes all fit. A row without a simulation is left out.
fn forge(
    bench: &Bench,
    header: impl Fn(&mut RunHeader),
    status: Option<TrialStatus>,
    keeps: impl Fn(u32) -> bool,
    edit: impl Fn(Simulation) -> Option<Simulation>,
) {
    let run = RunFile::open(bench.path("run.sqlite")).unwrap();
    let mut changed = run.header().clone();
    header(&mut changed);
    let mut forged = RunWriter::create(bench.path("forged.sqlite"), &changed, IfExists::Replace).unwrap();
    for TrialSummary { trial, .. } in
        run.trials().unwrap().into_iter().filter(|found| keeps(found.trial.number))
    {
        forged.start_trial(trial.number, trial.seed).unwrap();
        for found in run.trial_simulations(trial.number) {
            let found = found.unwrap();
            if let Some(row) = edit(run.simulation(found.trial, found.number).unwrap()) {
                forged.record(&[row]).unwrap();
            }
        }
        let status = status.unwrap_or(trial.status);
        if status != TrialStatus::Running {
            forged.end_trial(trial.number, status).unwrap();
        }
    }
    forged.close().unwrap();
    bench.check("evidence forged.sqlite --out forged --force", 0);
}

/// Changes the manifest of a folder, and makes its list of files and all hashes fit again.
pub fn seal(bench: &Bench, folder: &str, edit: impl Fn(&mut Value)) {
    let home = bench.path(folder);
    let hash = |name: &str| {
        let output = Command::new("sha256sum").arg(name).current_dir(&home).output().unwrap();
        text(&output.stdout).split(' ').next().unwrap().to_string()
    };
    let path = home.join("manifest.json");
    let mut manifest: Value = serde_json::from_str(&fs::read_to_string(&path).unwrap()).unwrap();
    let mut list = Vec::new();
    for file in manifest["files"].as_array_mut().unwrap() {
        let name = file["path"].as_str().unwrap().to_string();
        *file = json!({
            "path": name,
            "size": fs::metadata(home.join(&name)).unwrap().len(),
            "sha256": hash(&name),
        });
        list.push((name.clone(), hash(&name)));
    }
    edit(&mut manifest);
    fs::write(&path, serde_json::to_string_pretty(&manifest).unwrap()).unwrap();
    list.push(("manifest.json".to_string(), hash("manifest.json")));
    let list: String = list.iter().map(|(name, hash)| format!("{hash}  {name}\n")).collect();
    fs::write(home.join("SHA256SUMS"), list).unwrap();
}

/// Verifies a folder, which must say `part` and nothing of agreement.
#[track_caller]
fn says(bench: &Bench, arguments: &str, part: &str) -> String {
    let out = bench.check(&format!("evidence --verify {arguments}"), 1);
    assert!(out.contains(part) && !out.contains("All agrees"), "{part}:\n{out}");
    out
}

#[test]
fn simulations_that_the_clock_ended_are_counted_and_named_first() {
    let bench = evaluation();
    let hidden = |row: Simulation| {
        if row.is_violated() {
            Simulation {
                robustness: None,
                robustness_low: None,
                robustness_high: None,
                end: SimulationEnd::TimedOut { step: 1 },
                verdicts: row.verdicts.iter().map(|_| None).collect(),
                trace_digest: None,
                trace: None,
                ..row
            }
        } else {
            row
        }
    };
    let failures = RunFile::open(bench.path("run.sqlite")).unwrap().counts().unwrap().falsified;
    assert!(failures > 0);
    forge(&bench, |_| (), None, |_| true, |row| Some(hidden(row)));
    let out = says(
        &bench,
        "forged -k evidence.replay=1",
        &format!("not verified: runs/forged.sqlite: {failures} of "),
    );
    assert!(
        out.starts_with("not verified: ") && out.contains("chosen simulations cannot be replayed"),
        "{out}"
    );
    let found = bench.json("evidence --verify forged -k evidence.replay=1 --json", 1);
    let run = &found["runs"][0];
    let replayed = run["replayed"].as_array().unwrap().len() as u64;
    assert_eq!(run["chosen"].as_u64().unwrap(), replayed + failures);
    assert_eq!((&found["is_verified"], found["unverified"].as_array().unwrap().len()), (&false.into(), 1));
    // Also if none of them is chosen.
    says(&bench, "forged -k evidence.replay=0.001 --seed 1", &format!("the run has {failures} of these"));
    // Without replays, the question still finds an end that the target does not have.
    says(&bench, "forged -k evidence.replay=0", "which its target does not have");
}

#[test]
fn runs_that_lack_what_their_plan_asks_for_are_no_agreement() {
    let bench = evaluation();
    forge(&bench, |_| (), None, |trial| trial == 1, Some);
    says(&bench, "forged", "says that the run is finished, but: its question asks for further simulations");
    let first_half = |row: Simulation| Some(row).filter(|row| row.number <= 200);
    forge(&bench, |_| (), Some(TrialStatus::Running), |trial| trial == 1, first_half);
    let out = says(
        &bench,
        "forged -k evidence.replay=0",
        "not verified: runs/forged.sqlite: the run is not finished",
    );
    assert!(out.contains("it has 200 of 400 random simulations"), "{out}");
    forge(&bench, |_| (), None, |_| false, Some);
    says(&bench, "forged -k evidence.replay=0", "the run has no simulation");
}

#[test]
fn a_target_of_this_program_cannot_be_declared_not_replayable() {
    let bench = evaluation();
    let declared = |manifest: &mut Value| manifest["runs"][0]["not_replayable"] = "it is secret".into();
    seal(&bench, "ev", declared);
    says(&bench, "ev -k evidence.replay=0", "says that its simulations cannot be replayed, but they can");
    forge(&bench, |header| header.target.kind = "python".to_string(), None, |_| true, Some);
    says(&bench, "forged -k evidence.replay=0", "says that its target toy/sphere-2d is Python code");
}

#[test]
fn manifest_pages_and_readme_say_what_the_run_files_say() {
    let bench = evaluation();
    let fresh = |name: &str, edit: &dyn Fn(&mut Value)| {
        let copied =
            Command::new("cp").args(["-r", "ev", name]).current_dir(bench.path("")).status().unwrap();
        assert!(copied.success());
        seal(&bench, name, edit);
    };
    fresh("same", &|_| ());
    assert!(bench.check("evidence --verify same", 0).contains("README and pages: made again and compared"));
    for (fact, value) in [
        ("failures", json!(0)),
        ("simulations", json!(1_000_000)),
        ("formula", json!("true")),
        ("plan", json!("target = \"certified-robot\"\ncontroller = \"safe\"\n")),
    ] {
        let name = format!("fact-{fact}");
        fresh(&name, &|manifest| manifest["runs"][0][fact] = value.clone());
        says(&bench, &name, &format!("manifest.json describes another run: {fact}"));
    }
    fresh("none", &|manifest| manifest["runs"] = json!([]));
    let out = says(&bench, "none", "manifest.json: it has no run");
    assert!(out.contains("runs/run.sqlite: no run of manifest.json has this file"), "{out}");
    fresh("twice", &|manifest| {
        let first = manifest["runs"][0].clone();
        manifest["runs"].as_array_mut().unwrap().push(first);
    });
    says(&bench, "twice", "manifest.json: it names runs/run.sqlite twice");
    for (name, file, words) in [
        ("page", "pages/run.html", "it is not the page that follows from runs/run.sqlite"),
        ("readme", "README.md", "it is not the text that follows from manifest.json"),
    ] {
        fresh(name, &|_| ());
        fs::write(bench.path(name).join(file), "<h1>0 failures, certified</h1>").unwrap();
        seal(&bench, name, |_| ());
        says(&bench, name, words);
    }
    // Only the build that made the pages makes them again: a forger cannot name another one.
    for (name, fact) in [("other", "commit"), ("older", "version"), ("cross", "target")] {
        fresh(name, &|manifest| manifest["program"][fact] = "c0ffee".into());
        fs::write(bench.path(name).join("pages/run.html"), "<h1>0 failures, certified</h1>").unwrap();
        seal(&bench, name, |_| ());
        let out = says(&bench, name, "not all compared");
        assert!(out.starts_with("not verified: manifest.json: it says that Mishandle "), "{out}");
    }
}

/// Makes SQLite read a file by a log, as a program does that writes it.
fn use_log(path: &Path) {
    let connection = rusqlite::Connection::open(path).unwrap();
    let mode: String = connection.query_row("PRAGMA journal_mode = WAL", [], |row| row.get(0)).unwrap();
    assert_eq!(mode, "wal");
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name());
    let mut names: Vec<String> = entries.map(|name| name.to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

#[test]
fn a_run_that_needs_a_log_is_copied_without_and_never_opened_in_a_folder() {
    let bench = evaluation();
    use_log(&bench.path("ev/runs/run.sqlite"));
    seal(&bench, "ev", |_| ());
    says(&bench, "ev", "WAL mode");
    assert_eq!(names(&bench.path("ev/runs")), ["run.sqlite"]);
    use_log(&bench.path("run.sqlite"));
    let before = (names(&bench.path("")), fs::read(bench.path("run.sqlite")).unwrap());
    bench.check("evidence run.sqlite --out ev --force", 0);
    assert_eq!((names(&bench.path("")), fs::read(bench.path("run.sqlite")).unwrap()), before);
    bench.check("evidence --verify ev", 0);
    assert_eq!(names(&bench.path("ev/runs")), ["run.sqlite"]);
}

#[test]
fn only_files_of_evidence_are_replaced() {
    let bench = evaluation();
    bench.check("evidence run.sqlite --out ev --force", 0);
    bench.write("ev/pages/thesis.tex", "years");
    bench.refuses("evidence run.sqlite --out ev --force", &["pages/thesis.tex", "does not list it"]);
    fs::remove_file(bench.path("ev/pages/thesis.tex")).unwrap();
    // The same folder by another path.
    bench.refuses(
        "evidence ev/../ev/runs/run.sqlite --out ./ev --force",
        &["in the folder that would be replaced", "another --out"],
    );
    fs::rename(bench.path("ev/README.md"), bench.path("README.md")).unwrap();
    bench.refuses("evidence run.sqlite --out ev --force", &["README.md, which SHA256SUMS lists, is missing"]);
    fs::rename(bench.path("README.md"), bench.path("ev/README.md")).unwrap();
    bench.write("ev/manifest.json", "{\"name\": \"my package\"}");
    bench.refuses("evidence run.sqlite --out ev --force", &["its manifest.json is not one of evidence"]);
    assert!(bench.path("ev/runs/run.sqlite").exists());
}

#[test]
fn an_interruption_is_no_agreement() {
    let bench = evaluation();
    let folder = bench.path("ev");
    let request = Verification {
        folder: &folder,
        signers: Signers::Unknown,
        share: 1.0,
        seed: 1,
        words: shell_command,
    };
    let stop_at = |limit: u64| {
        let watch = |done, total| {
            if total > 0 && done >= limit { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        mishandle_evidence::verify(&request, watch).unwrap()
    };
    let found = stop_at(3);
    assert_eq!((found.is_complete, found.is_verified, found.problems.len()), (false, false, 0));
    assert_eq!((found.runs[0].chosen, found.runs[0].replayed.len()), (405, 3));
    assert!(stop_at(u64::MAX).is_verified);
    // The first signal stops it while it hashes.
    let found = mishandle_evidence::verify(&request, |_, _| ControlFlow::Break(())).unwrap();
    assert_eq!((found.files, found.is_complete, found.is_verified), (0, false, false));
}
