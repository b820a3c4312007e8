//! The builds of a run: the one that started it, and those that continued it.
//!
//! Rows of two builds under the name of the first one would be taken for rows of one program. So
//! another build may continue a run only if it is recorded, as a further row among the versions of
//! the header.

use mishandle_store::{BuildRecord, RunFile, RunHeader, RunWriter};

use crate::build::build;
use crate::error::MishandleError;
use crate::resolve::ResolvedPlan;
use crate::run::unfinished;

/// First part of the name of a version that describes a build that continued the run. Its number
/// follows.
const CONTINUED: &str = "build ";

/// Returns name and description of each build that continued a run.
pub fn continued_builds(header: &RunHeader) -> impl Iterator<Item = (&str, &str)> {
    let is_build = |name: &str| name.strip_prefix(CONTINUED).is_some_and(|n| n.parse::<u32>().is_ok());
    header
        .versions
        .iter()
        .filter(move |(name, _)| is_build(name))
        .map(|(name, build)| (name.as_str(), build.as_str()))
}

/// Lists the differences between the builds that made a run and the present one.
pub fn build_differences(header: &RunHeader, resolved: &ResolvedPlan) -> Vec<String> {
    let started = started(header, resolved);
    let present = description(resolved);
    let continued = continued_builds(header).filter(|(_, build)| *build != present);
    started
        .into_iter()
        .chain(continued.map(|(name, build)| format!("{name} continued the run: {build}")))
        .collect()
}

/// Lists the differences between the build that started a run and the present one.
fn started(header: &RunHeader, resolved: &ResolvedPlan) -> Vec<String> {
    let continued: Vec<&str> = continued_builds(header).map(|(name, _)| name).collect();
    let versions: Vec<_> =
        header.versions.iter().filter(|(name, _)| !continued.contains(&name.as_str())).cloned().collect();
    differences_of_builds(&header.build, &versions, resolved)
}

/// Lists the differences between a recorded build and the present one, with the versions of the
/// target's software.
pub(crate) fn differences_of_builds(
    then: &BuildRecord,
    versions: &[(String, String)],
    resolved: &ResolvedPlan,
) -> Vec<String> {
    let now = build();
    let mut parts = vec![
        ("program", then.program_version.as_str(), now.program_version.as_str()),
        ("commit", &then.git_commit, &now.git_commit),
        ("compiler", &then.rustc, &now.rustc),
        ("platform", &then.target, &now.target),
        ("architecture", &then.architecture, &now.architecture),
    ];
    for (name, now) in &resolved.target.versions {
        let then = versions.iter().find(|(known, _)| known == name).map_or("unknown", |(_, version)| version);
        parts.push((name.as_str(), then, now.as_str()));
    }
    for (name, then) in versions {
        if !resolved.target.versions.iter().any(|(known, _)| known == name) {
            parts.push((name.as_str(), then.as_str(), "unknown"));
        }
    }
    let known = |text: &str| if text.is_empty() { "unknown".to_string() } else { text.to_string() };
    parts
        .iter()
        .filter(|(_, then, now)| then != now)
        .map(|(part, then, now)| format!("recorded {part} {}, now {}", known(then), known(now)))
        .collect()
}

/// Describes the present build with the versions of the target's software.
fn description(resolved: &ResolvedPlan) -> String {
    let BuildRecord { program_version, git_commit, target, rustc, architecture } = build();
    let mut parts = vec![format!("mishandle {program_version} ({git_commit})"), rustc, target, architecture];
    parts.extend(resolved.target.versions.iter().map(|(name, version)| format!("{name} {version}")));
    parts.join(", ")
}

/// Records the present build in the header of a run that another build started, so that it may
/// continue the run.
///
/// # Errors
/// If the file cannot be written.
pub fn admit_build(run: &mut RunWriter, resolved: &ResolvedPlan) -> Result<(), MishandleError> {
    if is_admitted(run.file(), resolved) {
        return Ok(());
    }
    // The build that started the run is the first one.
    let number = continued_builds(run.file().header()).count() + 2;
    Ok(run.add_version(&format!("{CONTINUED}{number}"), &description(resolved))?)
}

/// Checks that the present build may add rows to a run. A complete run gets no rows.
///
/// # Errors
/// [`OtherBuild`](MishandleError::OtherBuild), or an error of the run file.
pub(crate) fn check_build(run: &RunFile, resolved: &ResolvedPlan) -> Result<(), MishandleError> {
    if is_admitted(run, resolved) || unfinished(run)?.is_none() {
        return Ok(());
    }
    Err(MishandleError::OtherBuild { differences: started(run.header(), resolved) })
}

fn is_admitted(run: &RunFile, resolved: &ResolvedPlan) -> bool {
    let present = description(resolved);
    started(run.header(), resolved).is_empty()
        || continued_builds(run.header()).any(|(_, build)| build == present)
}
