//! The builds of a run: the one that started it, and those that continued it.
//!
//! Rows of two builds under the name of the first one would be taken for rows of one program. So
//! another build may continue a run only if it is recorded, as a further row among the versions of
//! the header.

use mishandle_results::{Key, Remedy};
use mishandle_store::{BuildRecord, RunFile, RunHeader, RunWriter};

use crate::build::build;
use crate::error::{Compared, MishandleError, RunError, problem};
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
/// A difference of the [build](Compared::Build), or an error of the run file.
pub(crate) fn check_build(run: &RunFile, resolved: &ResolvedPlan) -> Result<(), MishandleError> {
    if is_admitted(run, resolved) || unfinished(run)?.is_none() {
        return Ok(());
    }
    Err(MishandleError::differs(Compared::Build, started(run.header(), resolved)))
}

fn is_admitted(run: &RunFile, resolved: &ResolvedPlan) -> bool {
    let present = description(resolved);
    started(run.header(), resolved).is_empty()
        || continued_builds(run.header()).any(|(_, build)| build == present)
}

/// Returns the error of runs in the folder of a question that no other build may continue.
pub(crate) fn of_folder(error: MishandleError) -> MishandleError {
    match error {
        MishandleError::Run(RunError::Differs { whose: Compared::Build, differences }) => {
            problem(format!("another build made the runs in the folder: {}", differences.join("; ")))
                .with(Remedy::Advice("continue with that build"))
                .with(Remedy::Another(Key::OUT))
        }
        error => error,
    }
}

#[cfg(test)]
mod tests {
    use std::ops::ControlFlow;

    use mishandle_store::IfExists;

    use super::*;
    use crate::plan::{EvaluatePlan, Plan};
    use crate::run::{Engine, Progress, ask, header, same_plan};

    #[test]
    fn another_build_adds_rows_only_if_the_header_names_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.sqlite");
        let evaluation = EvaluatePlan { episodes: 6, batch: 2, ..EvaluatePlan::default() };
        let plan = Plan { evaluate: Some(evaluation), ..Plan::new("toy/sphere-2d", "") };
        let resolved = ResolvedPlan::new(&plan).unwrap();
        let mut started = header::header(&resolved);
        started.build.git_commit = "c0ffee".to_string();
        started.versions.push(("engine".to_string(), "1.0".to_string()));
        RunWriter::create(&path, &started, IfExists::Refuse).unwrap().close().unwrap();
        let go = |simulations: u64| {
            let mut watch = |progress: &Progress| {
                let is_done = progress.simulations >= simulations;
                if is_done { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            };
            ask(&resolved, RunWriter::resume(&path).unwrap(), Engine::Direct, &mut watch).map(drop)
        };
        let error = go(2).unwrap_err();
        for part in ["commit c0ffee", "recorded engine 1.0, now unknown"] {
            assert!(error.to_string().contains(part), "{error}");
        }
        assert!(error.remedies().iter().any(|remedy| remedy.keys() == [Key::ANY_BUILD]));
        for _ in 0..2 {
            let mut run = RunWriter::resume(&path).unwrap();
            admit_build(&mut run, &resolved).unwrap();
            run.close().unwrap();
        }
        go(2).unwrap();
        let run = RunFile::open(&path).unwrap();
        assert_eq!(run.header().build.git_commit, "c0ffee");
        let continued: Vec<_> = continued_builds(run.header()).collect();
        assert_eq!(continued, [("build 2", description(&resolved).as_str())]);
        // The build that started the run is still another one for replays.
        assert_eq!(build_differences(run.header(), &resolved).len(), 2);
        assert!(same_plan::differences(run.header(), &resolved).unwrap().is_empty());
        drop(run);
        go(u64::MAX).unwrap();
        // A complete run gets no rows, so any build may read its answer.
        let other = RunFile::open(&path).unwrap();
        let unnamed = RunHeader { versions: started.versions.clone(), ..other.header().clone() };
        assert_eq!(self::started(&unnamed, &resolved).len(), 2);
        assert!(unfinished(&other).unwrap().is_none());
    }

    #[test]
    fn a_header_without_a_component_is_a_difference() {
        let plan = Plan::new("toy/sphere-2d", "");
        let resolved = ResolvedPlan::new(&plan).unwrap();
        let mut recorded = header::header(&resolved);
        recorded.components.push(mishandle_store::ComponentRecord::default());
        let found = same_plan::differences(&recorded, &resolved).unwrap();
        assert_eq!(found, ["number of components: recorded 1, expected 0"]);
    }
}
