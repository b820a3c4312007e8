//! Verifies a folder of evidence.

use std::collections::BTreeSet;
use std::fmt::Display;
use std::hash::{BuildHasher, Hasher, RandomState};
use std::ops::ControlFlow;
use std::path::Path;

use mishandle::build::build;
use mishandle::files::{read_text_bounded, refuse_link};
use mishandle::portable::resolve_in;
use mishandle::random::Sequence;
use mishandle::replay::{build_differences, replay_with};
use mishandle::resolve::is_python;
use mishandle::results::{EvidenceVerification, ReplayedSimulation, Seed, VerifiedRun};
use mishandle::store::{RunFile, SimulationEnd};
use mishandle_text::path_text;

use crate::error::EvidenceError;
use crate::layout::{self, MANIFEST, SIGNATURE, SUMS, is_name};
use crate::manifest::{self, FORMAT, Manifest, ManifestRun};
use crate::signature::{self, Checked, WRONG};
use crate::signers::Signers;
use crate::sums;
use crate::write::reason;

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
}

/// Returns a seed that nobody can foresee, so that a forger does not know which simulations will be
/// replayed.
pub fn random_seed() -> u64 {
    // The standard library seeds its hash maps by the system's random numbers.
    RandomState::new().build_hasher().finish()
}

/// Verifies a folder. `watch` gets the number of replayed simulations, and of those to replay.
///
/// Every problem is part of the result. A run file is opened only if the whole folder has the
/// hashes of its list.
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
        signature: "missing".to_string(),
        signer: None,
        files: 0,
        problems: Vec::new(),
        program: build().git_commit,
        share: request.share,
        seed: Seed(request.seed),
        runs: Vec::new(),
        is_verified: false,
        is_complete: true,
    };
    if folder.join(SUMS).symlink_metadata().is_err() {
        return Err(EvidenceError::NotEvidence { path: folder.to_path_buf() });
    }
    let Some(list) = read(folder, SUMS, sums::MAX_SIZE, &mut found.problems) else { return Ok(found) };
    let signature = match folder.join(SIGNATURE).symlink_metadata() {
        Ok(_) => read(folder, SIGNATURE, signature::MAX_SIZE, &mut found.problems),
        Err(_) => None,
    };
    let Checked { status, signer, problem } =
        signature::check(list.as_bytes(), signature.as_deref(), &request.signers);
    found.signature = status.to_string();
    found.signer = signer;
    found.problems.extend(problem);
    let Some(manifest) = check_files(folder, &list, &mut found)? else { return Ok(found) };
    check_runs(request, &manifest, &mut found, &mut watch)?;
    let differs = |run: &VerifiedRun| run.replayed.iter().any(|replayed| !replayed.differences.is_empty());
    found.is_verified = found.problems.is_empty() && !found.runs.iter().any(differs);
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
    folder: &Path,
    list: &str,
    found: &mut EvidenceVerification,
) -> Result<Option<Manifest>, EvidenceError> {
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
        let hashed = sums::hash(&folder.join(name))?;
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
    if is_changed || found.signature == WRONG {
        return Ok(None);
    }
    let Some(text) = read(folder, MANIFEST, manifest::MAX_SIZE, &mut found.problems) else { return Ok(None) };
    let manifest: Manifest = match serde_json::from_str(&text) {
        Ok(manifest) => manifest,
        Err(error) => {
            found.problems.push(format!("{MANIFEST}: {error}"));
            return Ok(None);
        }
    };
    if manifest.evidence_format != FORMAT {
        let problem =
            format!("{MANIFEST}: format {}; this program reads format {FORMAT}", manifest.evidence_format);
        found.problems.push(problem);
        return Ok(None);
    }
    sizes.retain(|(name, _)| name != MANIFEST);
    let is_same = sizes.len() == manifest.files.len()
        && sizes.iter().zip(&manifest.files).all(|((name, hashed), file)| {
            (name, hashed.size, &hashed.sha256) == (&file.path, file.size, &file.sha256)
        });
    if !is_same {
        found.problems.push(format!("{MANIFEST}: its list of files is not that of {SUMS}"));
        return Ok(None);
    }
    Ok(Some(manifest))
}

/// Opens the runs, compares them with the manifest, and replays a share of their simulations.
fn check_runs(
    request: &Verification<'_>,
    manifest: &Manifest,
    found: &mut EvidenceVerification,
    watch: &mut impl FnMut(u64, u64) -> ControlFlow<()>,
) -> Result<(), EvidenceError> {
    let mut opened = Vec::new();
    for (index, run) in manifest.runs.iter().enumerate() {
        match open(request, run, manifest) {
            Ok(file) => {
                // Each run has its own numbers, so that another run changes none of them.
                let chosen = choose(&file, request.share, Sequence::new(request.seed, index as u64));
                match chosen {
                    Ok(chosen) => opened.push((run, file, chosen)),
                    Err(error) => found.problems.push(format!("{}: {error}", run.file)),
                }
            }
            Err(problem) => found.problems.push(problem),
        }
    }
    let total = opened.iter().map(|(_, _, chosen)| chosen.len() as u64).sum();
    let mut done = 0;
    for (run, file, chosen) in opened {
        let mut verified = VerifiedRun {
            file: run.file.clone(),
            simulations: run.simulations,
            replayed: Vec::new(),
            not_replayed: None,
            build_differences: Vec::new(),
        };
        if !chosen.is_empty() && found.is_complete {
            let place = run.files.as_deref().unwrap_or("");
            let resolved = match is_python(&file.header().target.kind) {
                true => Err("its system is written in Python: replay it with mishandle.replay and your code"
                    .to_string()),
                false => {
                    resolve_in(file.header(), &request.folder.join(place)).map_err(|error| reason(&error))
                }
            };
            match resolved {
                Ok(resolved) => {
                    verified.build_differences = build_differences(file.header(), &resolved);
                    for (trial, simulation) in chosen {
                        if watch(done, total).is_break() {
                            found.is_complete = false;
                            break;
                        }
                        let differences = match replay_with(&file, trial, simulation, &resolved) {
                            Ok(replayed) => replayed.differences,
                            Err(error) => vec![reason(&error)],
                        };
                        verified.replayed.push(ReplayedSimulation { trial, simulation, differences });
                        done += 1;
                    }
                }
                Err(why) => {
                    if run.not_replayable.is_none() {
                        found
                            .problems
                            .push(format!("{}: its simulations cannot be replayed: {why}", run.file));
                    }
                    verified.not_replayed = Some(why);
                }
            }
        }
        found.runs.push(verified);
    }
    Ok(())
}

/// Opens a run of the folder with all checks of its records, and compares it with the manifest.
fn open(request: &Verification<'_>, run: &ManifestRun, manifest: &Manifest) -> Result<RunFile, String> {
    let of = |problem: &dyn Display| format!("{}: {problem}", run.file);
    let is_file = |name: &str| is_name(name) && manifest.files.iter().any(|file| file.path == *name);
    if !is_file(&run.file) || !is_file(&run.page) || !run.files.as_deref().is_none_or(is_name) {
        return Err(format!("{MANIFEST}: it names files that the folder does not list"));
    }
    let file = RunFile::open(request.folder.join(&run.file)).map_err(|error| of(&error))?;
    file.check().map_err(|error| of(&error))?;
    let [file_name, page] = [run.file.clone(), run.page.clone()];
    let again = ManifestRun::new(&file, [file_name, page], run.files.clone(), run.not_replayable.clone())
        .map_err(|error| of(&error))?;
    // Another version of the program can write the same plan in other words.
    match (ManifestRun { plan: run.plan.clone(), ..again }) == *run {
        true => Ok(file),
        false => Err(of(&format!("{MANIFEST} describes another run"))),
    }
}

/// Chooses simulations of a run, in order.
fn choose(run: &RunFile, share: f64, mut random: Sequence) -> Result<Vec<(u32, u32)>, EvidenceError> {
    if share <= 0.0 {
        return Ok(Vec::new());
    }
    let mut all = Vec::new();
    for simulation in run.simulations() {
        let simulation = simulation?;
        // A time limit depends on the clock.
        if !matches!(simulation.end, SimulationEnd::TimedOut { .. }) {
            all.push((simulation.trial, simulation.number));
        }
    }
    let n = ((share * all.len() as f64).ceil() as usize).min(all.len());
    // The first n numbers of a shuffle.
    for i in 0..n {
        let other = i + random.below((all.len() - i) as u64) as usize;
        all.swap(i, other);
    }
    all.truncate(n);
    all.sort_unstable();
    Ok(all)
}
