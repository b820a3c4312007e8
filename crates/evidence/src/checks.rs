//! Checks of requirements in a folder of evidence: the files beside their runs.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use mishandle::check::{COUNTEREXAMPLES, REQUIREMENTS, RESULT, differences, moved, replay, to_json};
use mishandle::counterexample::Counterexample;
use mishandle::files::{limits, read_text_bounded};
use mishandle::results::{Check, EvidenceVerification, Key, Severity, VerifiedCheck, Words};
use mishandle::store::RunFile;
use mishandle_report::{CHECK_REPORTS, CheckFigures, check_reports, check_summary};
use mishandle_text::plural;

use crate::closed::copy_file;
use crate::error::EvidenceError;
use crate::layout::{CHECKS, MANIFEST};
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
    let found = moved(found, &place, |path| now(path).unwrap_or_default());
    let mut found = strict(Check { requirements_file: format!("{place}/{REQUIREMENTS}"), ..found });
    let create = |path: &Path| fs::create_dir_all(path).map_err(EvidenceError::file(path));
    create(&home.join(&place))?;
    if !files.is_empty() {
        create(&home.join(&place).join(COUNTEREXAMPLES))?;
    }
    let requirements = (folder.join(REQUIREMENTS), home.join(&place).join(REQUIREMENTS));
    let copies = files.iter().map(|(file, place)| (file.into(), home.join(place)));
    for (from, to) in std::iter::once(requirements).chain(copies) {
        copy_file(&from, &to)?;
    }
    name_replays(&mut found, home, |name| runs.iter().find(|run| run.file == name)?.files.as_deref(), words)?;
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

/// Returns a check in which every violation and every requirement that was not checked counts: no
/// run shows what its maker accepted.
fn strict(found: Check) -> Check {
    Check { fail_on: Severity::Warning, allows_inapplicable: false, ..found }
}

/// Names what replays each violation with the files of its run: `files` returns their folder.
fn name_replays<'f>(
    found: &mut Check,
    home: &Path,
    files: impl Fn(&str) -> Option<&'f str>,
    words: Words,
) -> Result<(), EvidenceError> {
    let kind = found.target_kind.clone();
    for violation in found.cells.iter_mut().filter_map(|cell| cell.counterexample.as_mut()) {
        let mut moved = Vec::new();
        if let (Some(file), Some(own)) = (&violation.file, files(&violation.run)) {
            let plan = Counterexample::read(&home.join(file))?.plan;
            let keys = [(Key::MOVED_CONTROLLER, plan.controller), (Key::MOVED_TARGET, plan.target)];
            let place =
                |(key, name): (Key, String)| Some((key, format!("{own}/{}", name.strip_prefix("./")?)));
            moved.extend(keys.into_iter().filter_map(place));
        }
        violation.replay = words(&replay(&kind, violation, moved));
    }
    Ok(())
}

/// Returns the files of a check, without its runs.
pub(crate) fn files(check: &ManifestCheck) -> Vec<String> {
    let reports = CHECK_REPORTS.into_iter().chain([REQUIREMENTS, RESULT]);
    let own = reports.map(|name| format!("{}/{name}", check.folder));
    own.chain(check.counterexamples.iter().cloned()).collect()
}

/// How a check is verified.
#[derive(Clone, Copy)]
pub(crate) struct Manner {
    /// Whether this program made the folder, so that it writes the same texts.
    pub is_of_this_build: bool,
    /// Whether the counterexamples are replayed.
    pub replays: bool,
    /// How the folder names commands.
    pub words: Words,
}

/// Verifies a check: its requirements, its verdicts, which follow from the runs, its reports and
/// its counterexamples. Adds the problems and what cannot be verified, and returns what was done.
pub(crate) fn verify<'r>(
    home: &Path,
    check: &ManifestCheck,
    manner: Manner,
    run: impl Fn(&str) -> Option<&'r RunFile>,
    files: impl Fn(&str) -> Option<&'r str>,
    result: &mut EvidenceVerification,
) -> VerifiedCheck {
    let mut verified = VerifiedCheck { folder: check.folder.clone(), verdicts: 0, replayed: 0 };
    let of = |problem: &dyn std::fmt::Display| format!("{}: {problem}", check.folder);
    let read = |name: &str, limit: u64| {
        let text = read_text_bounded(&home.join(&check.folder).join(name), limit);
        text.map_err(|error| of(&format!("{name}: {error}")))
    };
    let texts = read(RESULT, limits::RESULT).and_then(|text| {
        let found: Check = serde_json::from_str(&text).map_err(|error| of(&format!("{RESULT}: {error}")))?;
        Ok((found, text, read(REQUIREMENTS, limits::PLAN)?))
    });
    let (found, text, requirements) = match texts {
        Ok(texts) => texts,
        Err(problem) => {
            result.problems.push(problem);
            return verified;
        }
    };
    verified.verdicts = found.cells.len() as u64;
    let violations = found.cells.iter().filter_map(|cell| cell.counterexample.as_ref());
    let places: Vec<(&str, &str)> =
        violations.filter_map(|violation| Some((violation.file.as_deref()?, &*violation.run))).collect();
    // Only files of the manifest are opened: it names none outside of the folder.
    if !places.iter().map(|(file, _)| *file).eq(check.counterexamples.iter().map(String::as_str)) {
        result.problems.push(of(&"the manifest names other counterexamples"));
        return verified;
    }
    match differences(&found, &requirements, &run, |file| home.join(file)) {
        Ok(differences) => {
            result.problems.extend(differences.problems.iter().map(|problem| of(problem)));
            result.unverified.extend(differences.unverified.iter().map(|statement| of(statement)));
        }
        Err(error) => result.problems.push(of(&reason(&error))),
    }
    let named: Vec<&str> =
        found.controllers.iter().flat_map(|own| &own.runs).map(|run| run.run.as_str()).collect();
    let is_here =
        found.folder == check.folder && found.requirements_file == format!("{}/{REQUIREMENTS}", check.folder);
    if !is_here || found.target != check.target || named != check.runs {
        result
            .problems
            .push(of(&format!("{RESULT} is about another folder, target or runs than {MANIFEST}")));
    }
    if strict(found.clone()) != found {
        result.unverified.push(of(&format!("{RESULT} says that not every violation or open cell counts")));
    }
    if manner.is_of_this_build {
        result.problems.extend(text_problems(&found, &text, check, &read));
        let mut again = found.clone();
        match name_replays(&mut again, home, &files, manner.words) {
            Ok(()) if again == found => {}
            Ok(()) => result.problems.push(of(&"other commands replay its counterexamples")),
            Err(error) => result.problems.push(of(&reason(&error))),
        }
    }
    if !manner.replays && !places.is_empty() {
        let count = plural(places.len() as u64, "counterexample");
        result.unverified.push(of(&format!("the physics and the end of its {count}, without a replay")));
    }
    for (file, run) in places.into_iter().filter(|_| manner.replays) {
        replay_one(home, file, files(run).unwrap_or(""), &mut verified, &mut result.problems);
    }
    verified
}

/// Lists which texts of a check are not those that this program writes.
fn text_problems(
    found: &Check,
    text: &str,
    check: &ManifestCheck,
    read: &dyn Fn(&str, u64) -> Result<String, String>,
) -> Vec<String> {
    let mut problems = Vec::new();
    if to_json(found).ok().as_deref() != Some(text) {
        problems.push(format!("{}: {RESULT} has something that no check writes", check.folder));
    }
    for (name, content) in check_reports(found, &CheckFigures::default()) {
        if read(name, limits::RESULT).as_deref() != Ok(&content) {
            problems.push(format!("{}: {name} is not what follows from {RESULT}", check.folder));
        }
    }
    if check_summary(found) != check.verdicts {
        problems.push(format!("{}: the manifest has another number of verdicts", check.folder));
    }
    problems
}

/// Replays a counterexample with the files in the folder `own`, whose absence is reported for its
/// run.
fn replay_one(home: &Path, file: &str, own: &str, verified: &mut VerifiedCheck, problems: &mut Vec<String>) {
    // A file that cannot be read is a difference already.
    let Ok(counterexample) = Counterexample::read(&home.join(file)) else { return };
    let Ok(resolved) = counterexample.resolve_in(&home.join(own)) else { return };
    verified.replayed += 1;
    match counterexample.replay(&resolved) {
        Ok(again) if again.differences.is_empty() => {}
        Ok(again) => problems.push(format!("{file}: {}", again.differences.join("; "))),
        Err(error) => problems.push(format!("{file}: {}", reason(&error))),
    }
}
