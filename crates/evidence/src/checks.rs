//! Checks of requirements in a folder of evidence: the files beside their runs.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use mishandle::Plan;
use mishandle::check::{COUNTEREXAMPLES, REQUIREMENTS, RESULT, differences, moved, to_json};
use mishandle::counterexample::Counterexample;
use mishandle::files::{limits, read_text_bounded};
use mishandle::results::{Check, Command, Key, VerifiedCheck, Words};
use mishandle::store::RunFile;
use mishandle_report::{CHECK_REPORTS, CheckFigures, check_reports, check_summary};

use crate::error::EvidenceError;
use crate::layout::CHECKS;
use crate::manifest::{ManifestCheck, ManifestRun};
use crate::write::{reason, unique, write_file};

/// Writes the files of a check beside its runs, with paths in the folder of evidence. `home` is
/// that folder, and `runs` are the check's runs in it, in their order.
pub(crate) fn write(
    folder: &Path,
    found: &Check,
    home: &Path,
    runs: &[ManifestRun],
    names: &mut BTreeSet<String>,
    words: Words,
) -> Result<ManifestCheck, EvidenceError> {
    let place = format!("{CHECKS}/{}", unique(folder.file_name().unwrap_or_default(), names));
    let then = found.controllers.iter().flat_map(|controller| &controller.runs);
    let then: Vec<&str> = then.map(|run| run.run.as_str()).collect();
    let mut files: Vec<(String, String)> = Vec::new();
    for violation in found.cells.iter().filter_map(|cell| cell.counterexample.as_ref()) {
        let Some(file) = &violation.file else { continue };
        let name = Path::new(file).file_name().unwrap_or_default().to_string_lossy();
        files.push((file.clone(), format!("{place}/{COUNTEREXAMPLES}/{name}")));
    }
    let now = |path: &str| match then.iter().position(|run| *run == path) {
        Some(index) => runs.get(index).map(|run| run.file.clone()),
        None => files.iter().find(|(file, _)| file == path).map(|(_, place)| place.clone()),
    };
    let found = moved(found, &place, |path| now(path).unwrap_or_default(), words);
    let mut found = Check { requirements_file: format!("{place}/{REQUIREMENTS}"), ..found };
    for violation in found.cells.iter_mut().filter_map(|cell| cell.counterexample.as_mut()) {
        let Some(file) = &violation.file else { continue };
        let then = files.iter().find(|(_, place)| place == file).map(|(then, _)| Path::new(then));
        let run = runs.iter().find(|run| run.file == violation.run);
        if let (Some(then), Some(own)) = (then, run.and_then(|run| run.files.as_ref())) {
            violation.replay = words(&replay(file, &Counterexample::read(then)?.plan, own));
        }
    }
    let create = |path: &Path| fs::create_dir_all(path).map_err(EvidenceError::file(path));
    create(&home.join(&place))?;
    if !files.is_empty() {
        create(&home.join(&place).join(COUNTEREXAMPLES))?;
    }
    let requirements = (folder.join(REQUIREMENTS), home.join(&place).join(REQUIREMENTS));
    let copies = files.iter().map(|(file, place)| (file.into(), home.join(place)));
    for (from, to) in std::iter::once(requirements).chain(copies) {
        fs::copy(&from, to).map_err(EvidenceError::file(&from))?;
    }
    let result = home.join(&place).join(RESULT);
    let json = to_json(&found).map_err(EvidenceError::file(&result))?;
    write_file(&result, json.as_bytes())?;
    for (name, content) in check_reports(&found, &CheckFigures::default()) {
        write_file(&home.join(&place).join(name), content.as_bytes())?;
    }
    Ok(ManifestCheck {
        folder: place,
        target: found.target.clone(),
        verdicts: check_summary(&found),
        runs: runs.iter().map(|run| run.file.clone()).collect(),
        counterexamples: files.into_iter().map(|(_, place)| place).collect(),
    })
}

/// Returns what replays a counterexample with the files of its run in the folder `own`.
fn replay(file: &str, plan: &Plan, own: &str) -> Command {
    let keys = [(Key::MOVED_CONTROLLER, &plan.controller), (Key::MOVED_TARGET, &plan.target)];
    let place = |(key, name): (Key, &String)| Some((key, format!("{own}/{}", name.strip_prefix("./")?)));
    Command::ReplayFile { file: file.to_string(), moved: keys.into_iter().filter_map(place).collect() }
}

/// Returns the files of a check, without its runs.
pub(crate) fn files(check: &ManifestCheck) -> Vec<String> {
    let reports = CHECK_REPORTS.into_iter().chain([REQUIREMENTS, RESULT]);
    let own = reports.map(|name| format!("{}/{name}", check.folder));
    own.chain(check.counterexamples.iter().cloned()).collect()
}

/// Verifies a check: its requirements, its verdicts, which follow from the runs, its reports and
/// its counterexamples, which are replayed if `replays`. Returns what was done and the problems.
pub(crate) fn verify<'r>(
    home: &Path,
    check: &ManifestCheck,
    is_of_this_build: bool,
    replays: bool,
    run: impl Fn(&str) -> Option<&'r RunFile>,
    files: impl Fn(&str) -> Option<&'r str>,
) -> (VerifiedCheck, Vec<String>) {
    let mut verified = VerifiedCheck { folder: check.folder.clone(), verdicts: 0, replayed: 0 };
    let of = |problem: &dyn std::fmt::Display| format!("{}: {problem}", check.folder);
    let read = |name: &str, limit: u64| {
        let text = read_text_bounded(&home.join(&check.folder).join(name), limit);
        text.map_err(|error| of(&format!("{name}: {error}")))
    };
    let texts = read(RESULT, limits::RESULT)
        .and_then(|result| serde_json::from_str(&result).map_err(|error| of(&format!("{RESULT}: {error}"))))
        .and_then(|found: Check| Ok((found, read(REQUIREMENTS, limits::PLAN)?)));
    let (found, requirements) = match texts {
        Ok(texts) => texts,
        Err(problem) => return (verified, vec![problem]),
    };
    verified.verdicts = found.cells.len() as u64;
    let mut problems: Vec<String> = match differences(&found, &requirements, &run) {
        Ok(found) => found.iter().map(|problem| of(problem)).collect(),
        Err(error) => vec![of(&reason(&error))],
    };
    let named: Vec<&str> =
        found.controllers.iter().flat_map(|own| &own.runs).map(|run| run.run.as_str()).collect();
    if found.folder != check.folder || found.target != check.target || named != check.runs {
        problems.push(of(&format!("{RESULT} is about another folder, target or runs than the manifest")));
    }
    if is_of_this_build {
        for (name, content) in check_reports(&found, &CheckFigures::default()) {
            if read(name, limits::RESULT).as_deref() != Ok(&content) {
                problems.push(of(&format!("{name} is not what follows from {RESULT}")));
            }
        }
        if check_summary(&found) != check.verdicts {
            problems.push(of(&"the manifest has another number of verdicts"));
        }
    }
    let mut places = Vec::new();
    for cell in &found.cells {
        let Some((violation, file)) =
            cell.counterexample.as_ref().and_then(|violation| Some((violation, violation.file.as_ref()?)))
        else {
            continue;
        };
        places.push(file.as_str());
        if !check.counterexamples.contains(file) {
            problems.push(of(&format!("{file} is no counterexample of the manifest")));
            continue;
        }
        let counterexample = match Counterexample::read(&home.join(file)) {
            Ok(counterexample) => counterexample,
            Err(error) => {
                problems.push(format!("{file}: {}", reason(&error)));
                continue;
            }
        };
        let values = counterexample.scenario.iter().map(|value| (value.axis.as_str(), value.value));
        let is_same = values.eq(violation.scenario.iter().map(|value| (value.axis.as_str(), value.value)))
            && counterexample.seed == violation.seed.0
            && counterexample.expected.robustness == violation.robustness.0;
        if !is_same {
            problems.push(format!("{file}: it is not the counterexample of {RESULT}"));
        }
        // Runs that cannot be replayed are reported as such.
        let place = home.join(files(&violation.run).unwrap_or(""));
        if let (true, Ok(resolved)) = (replays, counterexample.resolve_in(&place)) {
            verified.replayed += 1;
            match counterexample.replay(&resolved) {
                Ok(again) if again.differences.is_empty() => {}
                Ok(again) => problems.push(format!("{file}: {}", again.differences.join("; "))),
                Err(error) => problems.push(format!("{file}: {}", reason(&error))),
            }
        }
    }
    if places != check.counterexamples.iter().map(String::as_str).collect::<Vec<_>>() {
        problems.push(of(&"the manifest names other counterexamples"));
    }
    (verified, problems)
}
