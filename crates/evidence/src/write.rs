//! Makes a folder of evidence.

use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::fs;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use mishandle::check::verified;
use mishandle::files::AtomicFolder;
use mishandle::portable::{check_no_program, copy_files, resolve_in};
use mishandle::resolve::{Moved, is_python};
use mishandle::results::{Evidence, EvidenceCheck, EvidenceRun, Words};
use mishandle::store::RunFile;
use mishandle::{Plan, ResolvedPlan};
use mishandle_text::path_text;

use crate::checks;
use crate::closed;
use crate::error::EvidenceError;
use crate::existing;
use crate::layout::{self, FILES, MANIFEST, PAGES, README, RUNS, SIGNATURE, SUMS, is_name};
use crate::manifest::{Manifest, ManifestCheck, ManifestFile, ManifestRun};
use crate::page;
use crate::readme;
use crate::signature::Key;
use crate::sums::{self, Hashed, Watch};

/// Why no system in Python is replayed.
pub(crate) const PYTHON: &str =
    "its system is Python code, which is not part of the folder: replay it with your code";

/// The parts of a folder of evidence.
#[derive(Debug)]
pub struct Collection<'a> {
    /// The run files, and folders of checks.
    pub runs: &'a [PathBuf],
    /// The folder to make.
    pub out: &'a Path,
    /// Whether another folder of evidence at `out` is replaced.
    pub force: bool,
    /// Present paths of the runs' files that were moved.
    pub moved: Moved<'a>,
    /// The key that signs; `None`: no signature.
    pub key: Option<&'a Key>,
    /// How pages and results name commands.
    pub words: Words,
}

/// Makes a folder of evidence. It appears when it is complete. If `watch` stops it, nothing is
/// left.
///
/// # Errors
/// If the folder exists, a run cannot be read or is not closed, a file cannot be written, or
/// `watch` stops it.
pub fn write(
    collection: &Collection<'_>,
    mut watch: impl FnMut() -> ControlFlow<()>,
) -> Result<Evidence, EvidenceError> {
    let watch: Watch<'_> = &mut watch;
    let out = collection.out;
    let folder = create(collection)?;
    let home = folder.path();
    for name in [RUNS, PAGES] {
        let path = home.join(name);
        fs::create_dir(&path).map_err(EvidenceError::file(&path))?;
    }
    let mut names = BTreeSet::new();
    let mut runs = Vec::new();
    let mut found_checks = Vec::new();
    let mut check_names = BTreeSet::new();
    for path in collection.runs {
        if !path.is_dir() {
            runs.push(add(path, home, &mut names, collection, watch)?);
            continue;
        }
        let found = verified(path, collection.words)?
            .ok_or_else(|| EvidenceError::NotACheck { path: path.clone() })?;
        let first = runs.len();
        for run in found.controllers.iter().flat_map(|controller| &controller.runs) {
            runs.push(add(run.run.as_ref(), home, &mut names, collection, watch)?);
        }
        found_checks.push(checks::write(
            path,
            &found,
            home,
            &runs[first..],
            &mut check_names,
            collection.words,
        )?);
    }
    let manifest = Manifest::new(runs, found_checks);
    write_file(&home.join(README), readme::text(&manifest, collection.words).as_bytes())?;
    let files = hashed(home, watch)?;
    let bytes: u64 = files.iter().map(|file| file.size).sum();
    let manifest = Manifest { files, ..manifest };
    let mut text = serde_json::to_string_pretty(&manifest)
        .map_err(std::io::Error::from)
        .map_err(EvidenceError::file(out))?;
    text.push('\n');
    write_file(&home.join(MANIFEST), text.as_bytes())?;
    let Hashed { size, sha256 } = sums::hash(&home.join(MANIFEST), watch)?;
    let mut listed: Vec<(&str, &str)> =
        manifest.files.iter().map(|file| (file.path.as_str(), file.sha256.as_str())).collect();
    listed.push((MANIFEST, &sha256));
    listed.sort_unstable();
    let list = sums::text(listed.iter().copied());
    write_file(&home.join(SUMS), list.as_bytes())?;
    let sign = |key: &Key| {
        let list = list.as_bytes();
        let path = home.join(SIGNATURE);
        write_file(&path, key.sign(list, watch)?.as_bytes())?;
        key.signer(list, &path, watch)
    };
    let signer = collection.key.map(sign).transpose()?;
    if collection.force { folder.persist_over() } else { folder.persist() }
        .map_err(EvidenceError::file(out))?;
    let check = |check: ManifestCheck| EvidenceCheck { folder: check.folder, verdicts: check.verdicts };
    let run = |run: ManifestRun| EvidenceRun {
        file: run.file,
        page: run.page,
        files: run.files,
        target: run.target[1].clone(),
        simulations: run.simulations,
        is_complete: run.is_complete,
        not_replayable: run.not_replayable,
    };
    Ok(Evidence {
        folder: path_text(out),
        signer,
        files: manifest.files.len() as u64 + 1,
        bytes: bytes.saturating_add(size),
        runs: manifest.runs.into_iter().map(run).collect(),
        checks: manifest.checks.into_iter().map(check).collect(),
    })
}

/// Creates the temporary folder. Only a folder of evidence is replaced.
fn create(collection: &Collection<'_>) -> Result<AtomicFolder, EvidenceError> {
    let out = collection.out;
    let created = if collection.force {
        existing::check(out, collection.runs)?;
        AtomicFolder::replace(out)
    } else {
        AtomicFolder::create_new(out)
    };
    created.map_err(|error| match error.kind() {
        std::io::ErrorKind::AlreadyExists => EvidenceError::Exists { path: out.to_path_buf() },
        _ => EvidenceError::file(out)(error),
    })
}

/// Adds a run with its page and files.
fn add(
    path: &Path,
    home: &Path,
    names: &mut BTreeSet<String>,
    collection: &Collection<'_>,
    watch: Watch<'_>,
) -> Result<ManifestRun, EvidenceError> {
    if watch().is_break() {
        return Err(EvidenceError::Interrupted);
    }
    let name = unique(path.file_stem().unwrap_or_default(), names);
    let [file, page_name] = [format!("{RUNS}/{name}.sqlite"), format!("{PAGES}/{name}.html")];
    let copy = home.join(&file);
    closed::copy(path, &copy)?;
    let run = RunFile::open(&copy)?;
    run.check()?;
    let (files, resolved) = files(&run, home, collection, watch)?;
    let text = page::text(&run, &file, resolved.as_ref().map_err(String::as_str), collection.words)?;
    write_file(&home.join(&page_name), text.as_bytes())?;
    ManifestRun::new(&run, [file, page_name], files, resolved.err())
}

/// Gives the copy of a moved file the name by which the plan of the run finds it.
fn rename(place: &Path, now: &str, recorded: &str) -> Result<(), EvidenceError> {
    let [Some(now), Some(then)] = [now, recorded].map(|path| Path::new(path).file_name()) else {
        return Ok(());
    };
    let [now, then] = [now, then].map(|name| place.join(name));
    if now == then || !now.is_file() {
        return Ok(());
    }
    fs::rename(&now, &then).map_err(EvidenceError::file(&now))
}

/// Copies the files of a run. Returns their folder, and the plan as it resolves there, or why it
/// does not.
fn files(
    run: &RunFile,
    home: &Path,
    collection: &Collection<'_>,
    watch: Watch<'_>,
) -> Result<(Option<String>, Result<ResolvedPlan, String>), EvidenceError> {
    let header = run.header();
    if is_python(&header.target.kind) {
        return Ok((None, Err(PYTHON.to_string())));
    }
    let (number, place) = (1..)
        .map(|number: u32| (number, home.join(FILES).join(number.to_string())))
        .find(|(_, place)| !place.exists())
        .unwrap_or_default();
    let moved = collection.moved;
    let recorded = Plan::from_toml(&header.plan)?;
    let mut plan = recorded.clone();
    plan.controller = moved.controller.map_or(plan.controller, str::to_string);
    plan.target = moved.target.map_or(plan.target, str::to_string);
    // The page has the reason, which must not depend on what may be started here.
    let checked = match check_no_program(&plan) {
        Ok(()) => copy_files(&plan, &place),
        Err(error) => Err(error),
    };
    let resolved = match checked {
        Ok(_) => {
            rename(&place, &plan.controller, &recorded.controller)?;
            rename(&place, &plan.target, &recorded.target)?;
            resolve_in(header, &place)
        }
        Err(error) => Err(error),
    };
    let remove = |place: &Path| {
        if place.exists() { fs::remove_dir_all(place).map_err(EvidenceError::file(place)) } else { Ok(()) }
    };
    let resolved = match resolved {
        Ok(resolved) => resolved,
        Err(error) => {
            // Files of another target than the run's are not evidence of it.
            remove(&place)?;
            return Ok((None, Err(reason(&error))));
        }
    };
    if !place.exists() {
        return Ok((None, Ok(resolved)));
    }
    let own = hashed(&place, watch)?;
    for known in 1..number {
        if hashed(&home.join(FILES).join(known.to_string()), watch)? == own {
            remove(&place)?;
            return Ok((Some(format!("{FILES}/{known}")), Ok(resolved)));
        }
    }
    Ok((Some(format!("{FILES}/{number}")), Ok(resolved)))
}

/// Returns an error with its causes on one line.
pub(crate) fn reason(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut cause = std::error::Error::source(error);
    while let Some(next) = cause {
        // Some messages contain their cause.
        let next_text = next.to_string();
        if !text.contains(&next_text) {
            text.push_str(": ");
            text.push_str(&next_text);
        }
        cause = next.source();
    }
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Returns the files of a folder with their hashes.
fn hashed(folder: &Path, watch: Watch<'_>) -> Result<Vec<ManifestFile>, EvidenceError> {
    let found = layout::list(folder)?;
    if let Some(problem) = found.problems.into_iter().next() {
        return Err(EvidenceError::Name { name: problem });
    }
    let hash = |path: String| {
        let Hashed { size, sha256 } = sums::hash(&folder.join(&path), watch)?;
        Ok(ManifestFile { path, size, sha256 })
    };
    found.files.into_iter().map(hash).collect()
}

/// Returns a name like `stem` that is not one of `names`, and adds it to them.
pub(crate) fn unique(stem: &OsStr, names: &mut BTreeSet<String>) -> String {
    let stem = stem.to_string_lossy();
    let plain: String =
        stem.chars().map(|c| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '-' }).collect();
    let plain: String = plain.chars().take(100).collect();
    let plain = if is_name(&plain) { plain } else { "run".to_string() };
    let numbered = (2..).map(|number: u64| format!("{plain}-{number}"));
    let name = std::iter::once(plain.clone())
        .chain(numbered)
        .find(|name| !names.contains(name))
        .unwrap_or(plain.clone());
    names.insert(name.clone());
    name
}

pub(crate) fn write_file(path: &Path, bytes: &[u8]) -> Result<(), EvidenceError> {
    fs::write(path, bytes).map_err(EvidenceError::file(path))
}
