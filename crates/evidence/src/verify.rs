//! Verifies a folder of evidence.

use std::collections::BTreeSet;
use std::hash::{BuildHasher, Hasher, RandomState};
use std::ops::ControlFlow;
use std::path::Path;

use mishandle::build::build;
use mishandle::files::{read_text_bounded, refuse_link};
use mishandle::results::{EvidenceVerification, Seed, VerifiedRun, Words};
use mishandle_text::path_text;

use crate::checks;
use crate::error::EvidenceError;
use crate::layout::{self, CHECKS, FILES, MANIFEST, PAGES, README, RUNS, SIGNATURE, SUMS, is_name};
use crate::manifest::{self, FORMAT, Format, Manifest, Program};
use crate::readme;
use crate::replays;
use crate::signature::{self, Checked, MISSING, Signers, UNCHECKED, WRONG};
use crate::sums::{self, Watch};

/// A folder to verify, and how.
#[derive(Debug)]
pub struct Verification<'a> {
    /// The folder.
    pub folder: &'a Path,
    /// The keys whose signatures count.
    pub signers: Signers,
    /// Share of the simulations of each run to replay, at least one; 0 for none.
    pub share: f64,
    /// Seed that chooses them.
    pub seed: u64,
    /// How pages and results name commands.
    pub words: Words,
}

/// Returns a seed that nobody can foresee, so that a forger does not know which simulations will be
/// replayed.
pub fn random_seed() -> u64 {
    // The standard library seeds its hash maps by the system's random numbers.
    RandomState::new().build_hasher().finish()
}

/// Verifies a folder. `watch` gets the number of replayed simulations, and of those to replay (0
/// while it hashes files), and can stop it.
///
/// Every problem is part of the result, and so is an interruption. A run file is opened only if the
/// whole folder has the hashes of its list.
///
/// # Errors
/// If the folder is not one of evidence, or a file cannot be read.
pub fn verify(
    request: &Verification<'_>,
    mut watch: impl FnMut(u64, u64) -> ControlFlow<()>,
) -> Result<EvidenceVerification, EvidenceError> {
    let folder = request.folder;
    let mut found = EvidenceVerification {
        folder: path_text(folder),
        signature: MISSING.to_string(),
        signer: None,
        files: 0,
        problems: Vec::new(),
        unverified: Vec::new(),
        pages_compared: false,
        program: build().git_commit,
        share: request.share,
        seed: Seed(request.seed),
        runs: Vec::new(),
        checks: Vec::new(),
        is_verified: false,
        is_complete: true,
    };
    if folder.join(SUMS).symlink_metadata().is_err() {
        return Err(EvidenceError::NotEvidence { path: folder.to_path_buf() });
    }
    let Some(list) = read(folder, SUMS, sums::MAX_SIZE, &mut found.problems) else {
        return Ok(found);
    };
    let path = folder.join(SIGNATURE);
    // A link, a device or a large file is a wrong signature, and `ssh-keygen` does not open it.
    let is_there = path.symlink_metadata().is_ok();
    let pem = if is_there { read(folder, SIGNATURE, signature::MAX_SIZE, &mut found.problems) } else { None };
    let signature = pem.as_deref().map(|pem| (&*path, pem));
    let checked = signature::check(list.as_bytes(), signature, &request.signers, &mut || watch(0, 0));
    let Checked { status, signer, problem } = match checked {
        Err(EvidenceError::Interrupted) => {
            (found.signature, found.is_complete) = (UNCHECKED.to_string(), false);
            return Ok(found);
        }
        checked => checked?,
    };
    let is_unreadable = is_there && pem.is_none();
    found.signature = if is_unreadable { WRONG } else { status }.to_string();
    found.signer = signer;
    match status {
        UNCHECKED => found.unverified.extend(problem),
        _ if is_unreadable => {}
        _ => found.problems.extend(problem),
    }
    // Without the signature that the caller demands, no run file is opened.
    let is_refused =
        found.signature == WRONG || (status == MISSING && !matches!(request.signers, Signers::Unknown));
    let checked = check_files(request, &list, is_refused, &mut found, &mut || watch(0, 0));
    let done = match checked {
        Ok(Some(manifest)) => replays::check(request, &manifest, &mut found, &mut watch),
        Ok(None) => return Ok(found),
        Err(error) => Err(error),
    };
    match done {
        Err(EvidenceError::Interrupted) => found.is_complete = false,
        done => done?,
    }
    let differs = |run: &VerifiedRun| run.replayed.iter().any(|replayed| !replayed.differences.is_empty());
    found.is_verified = found.is_complete
        && found.problems.is_empty()
        && found.unverified.is_empty()
        && !found.runs.iter().any(differs);
    Ok(found)
}

/// Reads a text of the folder, or adds the problem.
fn read(folder: &Path, name: &str, limit: u64, problems: &mut Vec<String>) -> Option<String> {
    let path = folder.join(name);
    match refuse_link(&path).and_then(|()| read_text_bounded(&path, limit)) {
        Ok(text) => Some(text),
        Err(error) => {
            problems.push(format!("{name}: {error}"));
            None
        }
    }
}

/// Compares all files with the list of hashes and with the manifest. Returns the manifest if they
/// agree.
fn check_files(
    request: &Verification<'_>,
    list: &str,
    is_refused: bool,
    found: &mut EvidenceVerification,
    watch: Watch<'_>,
) -> Result<Option<Manifest>, EvidenceError> {
    let folder = request.folder;
    let listed = match sums::parse(list) {
        Ok(listed) => listed,
        Err(problem) => {
            found.problems.push(problem);
            return Ok(None);
        }
    };
    let there = layout::list(folder)?;
    let mut problems = there.problems;
    let mut sizes = Vec::new();
    for name in &there.files {
        let Some(expected) = listed.get(name.as_str()) else {
            if ![SUMS, SIGNATURE].contains(&name.as_str()) {
                problems.push(format!("{name}: the file is not listed in {SUMS}"));
            }
            continue;
        };
        let hashed = sums::hash(&folder.join(name), watch)?;
        found.files += 1;
        if hashed.sha256 != *expected {
            problems.push(format!("{name}: the content has changed; its SHA-256 is {}", hashed.sha256));
        }
        sizes.push((name.clone(), hashed));
    }
    let names: BTreeSet<&str> = there.files.iter().map(String::as_str).collect();
    problems.extend(
        listed
            .keys()
            .filter(|name| !names.contains(*name))
            .map(|name| format!("{name}: the file is missing")),
    );
    if !listed.contains_key(MANIFEST) {
        problems.push(format!("{MANIFEST}: {SUMS} does not list it"));
    }
    let is_changed = !problems.is_empty();
    found.problems.extend(problems);
    if is_changed || is_refused {
        return Ok(None);
    }
    let Some(text) = read(folder, MANIFEST, manifest::MAX_SIZE, &mut found.problems) else {
        return Ok(None);
    };
    let manifest = match serde_json::from_str(&text) {
        Ok(Format { evidence_format: FORMAT }) => {
            serde_json::from_str(&text).map_err(|error| error.to_string())
        }
        Ok(Format { evidence_format }) => {
            Err(format!("format {evidence_format}; this program reads format {FORMAT}"))
        }
        Err(error) => Err(error.to_string()),
    };
    let manifest: Manifest = match manifest {
        Ok(manifest) => manifest,
        Err(problem) => {
            found.problems.push(format!("{MANIFEST}: {problem}"));
            return Ok(None);
        }
    };
    sizes.retain(|(name, _)| name != MANIFEST);
    let is_same = sizes.len() == manifest.files.len()
        && sizes.iter().zip(&manifest.files).all(|((name, hashed), file)| {
            (name, hashed.size, &hashed.sha256) == (&file.path, file.size, &file.sha256)
        });
    if !is_same {
        found.problems.push(format!("{MANIFEST}: its list of files is not that of {SUMS}"));
        return Ok(None);
    }
    let uses = uses(&manifest);
    let is_consistent = uses.is_empty();
    found.problems.extend(uses);
    if !is_consistent {
        return Ok(None);
    }
    // Another version of the program writes other words.
    found.pages_compared = manifest.is_of_this_build();
    if !found.pages_compared {
        let Program { version, commit, .. } = &manifest.program;
        found.unverified.push(format!(
            "{MANIFEST}: it says that Mishandle {version} ({commit}) made the folder, with MuJoCo {}; only that program makes \
             README, pages and reports again",
            manifest.mujoco
        ));
    }
    if found.pages_compared
        && let Some(text) = read(folder, README, manifest::MAX_SIZE, &mut found.problems)
        && text != readme::text(&manifest, request.words)
    {
        found.problems.push(format!("{README}: it is not the text that follows from {MANIFEST}"));
    }
    Ok(Some(manifest))
}

/// Lists what is wrong with the files that the runs of a manifest name: each file of the folder
/// belongs to one run, so that no run goes without a check.
fn uses(manifest: &Manifest) -> Vec<String> {
    let mut problems = Vec::new();
    if manifest.runs.is_empty() {
        problems.push(format!("{MANIFEST}: it has no run"));
    }
    let mut named = BTreeSet::from([README.to_string()]);
    for run in &manifest.runs {
        for (name, folder) in [(run.file.as_str(), RUNS), (run.page.as_str(), PAGES)] {
            let is_there = manifest.files.iter().any(|file| file.path == name);
            if !is_there || name.split('/').next() != Some(folder) {
                problems.push(format!("{MANIFEST}: {name:?} is none of the files in {folder}"));
            }
            if !named.insert(name.to_string()) {
                problems.push(format!("{MANIFEST}: it names {name} twice"));
            }
        }
    }
    for file in manifest.checks.iter().flat_map(checks::files) {
        let is_there = manifest.files.iter().any(|known| known.path == file);
        if !is_there || !file.starts_with(&format!("{CHECKS}/")) {
            problems.push(format!("{MANIFEST}: {file:?} is none of the files in {CHECKS}"));
        }
        named.insert(file);
    }
    let folders: Vec<&str> = manifest.runs.iter().filter_map(|run| run.files.as_deref()).collect();
    if let Some(folder) = folders.iter().find(|folder| !is_name(folder) || !folder.starts_with(FILES)) {
        problems.push(format!("{MANIFEST}: {folder:?} is no folder in {FILES}"));
    }
    let is_in = |name: &str| {
        let mut rests = folders.iter().filter_map(|folder| name.strip_prefix(*folder));
        rests.any(|rest| rest.starts_with('/'))
    };
    let unused =
        manifest.files.iter().filter(|file| !named.contains(file.path.as_str()) && !is_in(&file.path));
    problems.extend(unused.map(|file| format!("{}: no run of {MANIFEST} has this file", file.path)));
    problems
}
