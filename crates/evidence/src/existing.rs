//! A folder that another one replaces.

use std::path::{Path, PathBuf};

use mishandle::files::{read_text_bounded, refuse_link};

use crate::error::EvidenceError;
use crate::layout::{self, MANIFEST, SIGNATURE, SUMS};
use crate::manifest::{self, Manifest};
use crate::sums;

/// Checks that nothing but a folder of evidence is lost if the folder `out` is replaced: its list
/// of hashes has exactly the files that are there, its manifest is one of evidence, and none of
/// `runs` is in it. A folder that does not exist is fine.
///
/// # Errors
/// [`Foreign`](EvidenceError::Foreign) with the first file that is not evidence,
/// [`Inside`](EvidenceError::Inside), or if the folder cannot be read.
pub(crate) fn check(out: &Path, runs: &[PathBuf]) -> Result<(), EvidenceError> {
    if out.symlink_metadata().is_err() {
        return Ok(());
    }
    let foreign = |problem: String| EvidenceError::Foreign { path: out.to_path_buf(), problem };
    if refuse_link(out).is_err() || !out.is_dir() {
        return Err(foreign("it is not a folder".to_string()));
    }
    let read = |name: &str, limit: u64| {
        let path = out.join(name);
        refuse_link(&path)
            .and_then(|()| read_text_bounded(&path, limit))
            .map_err(|error| foreign(format!("it is not a folder of evidence: {name}: {error}")))
    };
    let list = read(SUMS, sums::MAX_SIZE)?;
    let listed = sums::parse(&list)
        .map_err(|problem| foreign(format!("it is not a folder of evidence: {problem}")))?;
    let manifest = read(MANIFEST, manifest::MAX_SIZE)?;
    if let Err(error) = serde_json::from_str::<Manifest>(&manifest) {
        return Err(foreign(format!("its {MANIFEST} is not one of evidence: {error}")));
    }
    let found = layout::list(out)?;
    if let Some(problem) = found.problems.into_iter().next() {
        return Err(foreign(format!("it has something that is not evidence: {problem}")));
    }
    let is_known = |name: &str| listed.contains_key(name) || [SUMS, SIGNATURE].contains(&name);
    if let Some(name) = found.files.iter().find(|name| !is_known(name)) {
        return Err(foreign(format!("{name} in it is not evidence: {SUMS} does not list it")));
    }
    if let Some(name) = listed.keys().find(|name| !found.files.iter().any(|file| file == *name)) {
        return Err(foreign(format!("{name}, which {SUMS} lists, is missing in it")));
    }
    let home = out.canonicalize().map_err(EvidenceError::file(out))?;
    for run in runs {
        // A run that does not exist is reported when it is read.
        if run.canonicalize().is_ok_and(|run| run.starts_with(&home)) {
            return Err(EvidenceError::Inside { path: run.clone() });
        }
    }
    Ok(())
}
