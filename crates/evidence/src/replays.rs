//! Checks the runs of a folder: against the manifest, their plans, their pages and replays.

use std::fmt::Display;
use std::ops::ControlFlow;
use std::path::Path;

use mishandle::ResolvedPlan;
use mishandle::portable::{needed_files, portable_plan, resolve_in};
use mishandle::random::Sequence;
use mishandle::replay::{build_differences, replay_with};
use mishandle::resolve::{command, is_built_in, is_python, is_target_file};
use mishandle::results::{EvidenceVerification, ReplayedSimulation, VerifiedRun};
use mishandle::run::{missing, unfinished};
use mishandle::store::{RunFile, RunHeader, SimulationEnd};

use crate::checks;
use crate::closed::needs_log;
use crate::error::EvidenceError;
use crate::layout::{self, MANIFEST};
use crate::manifest::{Manifest, ManifestRun};
use crate::page;
use crate::verify::Verification;
use crate::write::{PYTHON, reason};

/// Largest number of simulations that a sentence names.
const MAX_NAMED: usize = 10;

/// A run that was opened and compared with the manifest.
struct Opened<'a> {
    run: &'a ManifestRun,
    file: RunFile,
    /// The plan as it resolves in the folder, or why it does not.
    resolved: Result<ResolvedPlan, String>,
    chosen: Chosen,
}

/// Checks the runs of the manifest, and replays a share of their simulations.
///
/// # Errors
/// [`Interrupted`](EvidenceError::Interrupted); the runs so far are in `found`.
pub(crate) fn check(
    request: &Verification<'_>,
    manifest: &Manifest,
    found: &mut EvidenceVerification,
    watch: &mut impl FnMut(u64, u64) -> ControlFlow<()>,
) -> Result<(), EvidenceError> {
    let mut opened = Vec::new();
    for (index, run) in manifest.runs.iter().enumerate() {
        if watch(0, 0).is_break() {
            return Err(EvidenceError::Interrupted);
        }
        let of = |problem: &dyn Display| format!("{}: {problem}", run.file);
        // Each run has its own numbers, so that another run changes none of them.
        let random = Sequence::new(request.seed, index as u64);
        let read = open(request, run, manifest.is_of_this_build()).and_then(|file| {
            let chosen = Chosen::new(&file, request.share, random).map_err(|error| of(&error))?;
            Ok((file, chosen))
        });
        match read {
            Ok((file, chosen)) => {
                let resolved = resolve(request, run, &file);
                let next = Opened { run, file, resolved, chosen };
                next.state(request, found);
                found.problems.extend(next.unused_files(request));
                if manifest.is_of_this_build() {
                    next.compare_page(request, found);
                }
                opened.push(next);
            }
            Err(problem) => found.problems.push(problem),
        }
    }
    for check in &manifest.checks {
        let run = |name: &str| opened.iter().find(|next| next.run.file == name);
        let manner = checks::Manner {
            is_of_this_build: manifest.is_of_this_build(),
            replays: request.share > 0.0,
            words: request.words,
        };
        let file = |name: &str| run(name).map(|next| &next.file);
        let files = |name: &str| run(name).and_then(|next| next.run.files.as_deref());
        let verified = checks::verify(request.folder, check, manner, file, files, found);
        found.checks.push(verified);
    }
    let total = opened.iter().map(|next| next.chosen.to_replay().count() as u64).sum();
    let mut done = 0;
    for next in &opened {
        found.runs.push(next.replay(found.is_complete, &mut done, total, watch));
        found.is_complete &= next.resolved.is_err()
            || found.runs.last().is_none_or(|run| run.replayed.len() == next.chosen.to_replay().count());
    }
    Ok(())
}

/// Opens a run of the folder with all checks of its records, and compares it with the manifest.
fn open(request: &Verification<'_>, run: &ManifestRun, is_of_this_build: bool) -> Result<RunFile, String> {
    let of = |problem: &dyn Display| format!("{}: {problem}", run.file);
    let path = request.folder.join(&run.file);
    if needs_log(&path).map_err(|error| of(&error))? {
        return Err(of(
            &"it is in SQLite's WAL mode, in which nothing can read it without writing beside it",
        ));
    }
    let file = RunFile::open(&path).map_err(|error| of(&error))?;
    file.check().map_err(|error| of(&error))?;
    match run.differences(&file, is_of_this_build).map_err(|error| of(&error))?.as_slice() {
        [] => Ok(file),
        facts => Err(of(&format!("{MANIFEST} describes another run: {}", facts.join(", ")))),
    }
}

/// Resolves the plan of a run with the files of the folder alone.
fn resolve(request: &Verification<'_>, run: &ManifestRun, file: &RunFile) -> Result<ResolvedPlan, String> {
    if is_python(&file.header().target.kind) {
        return Err(PYTHON.to_string());
    }
    let place = request.folder.join(run.files.as_deref().unwrap_or(""));
    resolve_in(file.header(), &place).map_err(|error| reason(&error))
}

/// Returns whether a header has the name of a target of this program.
fn names_built_in(header: &RunHeader) -> bool {
    is_built_in(&header.target.name) || portable_plan(header).is_ok_and(|plan| is_built_in(&plan.target))
}

/// Returns whether the target of a plan can be written in Python: it is neither a target of this
/// program nor a file nor a program.
fn can_be_python(header: &RunHeader) -> bool {
    let is_other = |target: &str| is_built_in(target) || is_target_file(target) || command(target).is_some();
    !names_built_in(header) && portable_plan(header).is_ok_and(|plan| !is_other(&plan.target))
}

impl Opened<'_> {
    /// Adds what is wrong with the run as a whole, and what no replay can find.
    fn state(&self, request: &Verification<'_>, found: &mut EvidenceVerification) {
        let run = self.run;
        let header = self.file.header();
        let of = |text: &dyn Display| format!("{}: {text}", run.file);
        let cannot = |why: &str| of(&format!("its simulations cannot be replayed: {why}"));
        let is_asked = request.share > 0.0;
        match (&self.resolved, &run.not_replayable) {
            (Err(_), _) if is_python(&header.target.kind) && !can_be_python(header) => {
                let name = &header.target.name;
                found.problems.push(of(&format!(
                    "it says that its target {name} is Python code, but the plan names another kind of target"
                )));
            }
            (Err(why), Some(_)) if names_built_in(header) => found.problems.push(cannot(why)),
            (Err(why), None) => found.problems.push(cannot(why)),
            (Err(why), Some(_)) if is_asked => found.unverified.push(cannot(why)),
            // The page and the README show the reason of the manifest.
            (Err(why), Some(stated)) if why != stated => {
                let stated = format!("{MANIFEST} says why its simulations cannot be replayed: {stated}");
                found.unverified.push(of(&stated));
            }
            (Ok(_), Some(_)) => {
                let problem =
                    format!("{MANIFEST} says that its simulations cannot be replayed, but they can");
                found.problems.push(of(&problem));
            }
            _ => {}
        }
        let lacking = match &self.resolved {
            Ok(resolved) => missing(&self.file, resolved),
            Err(_) => unfinished(&self.file),
        };
        match lacking {
            Ok(None) => {}
            Ok(Some(what)) if run.is_complete => {
                found.problems.push(of(&format!("{MANIFEST} says that the run is finished, but: {what}")));
            }
            Ok(Some(what)) => found.unverified.push(of(&format!("the run is not finished: {what}"))),
            Err(error) => found.problems.push(of(&error)),
        }
        if run.simulations == 0 {
            found.unverified.push(of(&"the run has no simulation"));
        }
        if is_asked {
            found.unverified.extend(self.chosen.skipped_text().map(|text| of(&text)));
        }
    }

    /// Makes the page again and compares it.
    fn compare_page(&self, request: &Verification<'_>, found: &mut EvidenceVerification) {
        let page = &self.run.page;
        let resolved = match (&self.run.not_replayable, &self.resolved) {
            (Some(why), _) => Err(why.as_str()),
            (None, Ok(resolved)) => Ok(resolved),
            // That is a problem of the run.
            (None, Err(_)) => return found.pages_compared = false,
        };
        let problem = match page::text(&self.file, &self.run.file, resolved, request.words) {
            Ok(text) => match std::fs::read(request.folder.join(page)) {
                Ok(bytes) if bytes == text.as_bytes() => return,
                Ok(_) => format!("{page}: it is not the page that follows from {}", self.run.file),
                Err(error) => format!("{page}: {error}"),
            },
            Err(error) => format!("{page}: it cannot be made again: {error}"),
        };
        found.problems.push(problem);
    }

    /// Lists the files in the folder of the run that its simulations do not need.
    fn unused_files(&self, request: &Verification<'_>) -> Vec<String> {
        let (Some(folder), Ok(resolved)) = (&self.run.files, &self.resolved) else { return Vec::new() };
        let there = layout::list(&request.folder.join(folder));
        let (Ok(needed), Ok(there)) = (needed_files(&resolved.plan), there) else {
            return vec![format!("{folder}: it is not the folder of the files of {}", self.run.file)];
        };
        let is_unused = |name: &String| !needed.iter().any(|needed| needed == Path::new(name));
        let unused = there.files.into_iter().filter(is_unused);
        unused.map(|name| format!("{folder}/{name}: {} does not need this file", self.run.file)).collect()
    }

    /// Replays the chosen simulations, unless the verification was interrupted before.
    fn replay(
        &self,
        goes_on: bool,
        done: &mut u64,
        total: u64,
        watch: &mut impl FnMut(u64, u64) -> ControlFlow<()>,
    ) -> VerifiedRun {
        let mut verified = VerifiedRun {
            file: self.run.file.clone(),
            simulations: self.run.simulations,
            chosen: self.chosen.all.len() as u64,
            replayed: Vec::new(),
            not_replayed: None,
            build_differences: Vec::new(),
        };
        let resolved = match &self.resolved {
            _ if self.chosen.all.is_empty() => return verified,
            Ok(resolved) => resolved,
            Err(why) => {
                verified.not_replayed = Some(why.clone());
                return verified;
            }
        };
        verified.build_differences = build_differences(self.file.header(), resolved);
        for (trial, simulation) in self.chosen.to_replay().filter(|_| goes_on) {
            if watch(*done, total).is_break() {
                break;
            }
            let differences = match replay_with(&self.file, trial, simulation, resolved) {
                Ok(replayed) => replayed.differences,
                Err(error) => vec![reason(&error)],
            };
            verified.replayed.push(ReplayedSimulation { trial, simulation, differences });
            *done += 1;
        }
        verified
    }
}

/// The simulations of a run that the seed chose.
struct Chosen {
    /// Trial, number, and whether the clock ended it, in order.
    all: Vec<(u32, u32, bool)>,
    /// Number of all simulations of the run that the clock ended.
    timed_out: usize,
}

impl Chosen {
    /// Chooses among all simulations, those of the control arm too.
    fn new(run: &RunFile, share: f64, mut random: Sequence) -> Result<Chosen, EvidenceError> {
        let mut all = Vec::new();
        if share <= 0.0 {
            return Ok(Chosen { all, timed_out: 0 });
        }
        let trials = run.trials()?.into_iter().chain(run.derived_trials()?);
        for trial in trials {
            for simulation in run.trial_simulations(trial.trial.number) {
                let simulation = simulation?;
                let is_timed_out = matches!(simulation.end, SimulationEnd::TimedOut { .. });
                all.push((simulation.trial, simulation.number, is_timed_out));
            }
        }
        let timed_out = all.iter().filter(|(_, _, is_timed_out)| *is_timed_out).count();
        let n = ((share * all.len() as f64).ceil() as usize).min(all.len());
        // The first n numbers of a shuffle.
        for i in 0..n {
            let other = i + random.below((all.len() - i) as u64) as usize;
            all.swap(i, other);
        }
        all.truncate(n);
        all.sort_unstable();
        Ok(Chosen { all, timed_out })
    }

    /// Returns those whose results follow from the plan. A time limit depends on the clock.
    fn to_replay(&self) -> impl Iterator<Item = (u32, u32)> {
        let plain = self.all.iter().filter(|(_, _, is_timed_out)| !is_timed_out);
        plain.map(|(trial, simulation, _)| (*trial, *simulation))
    }

    /// Says which simulations no replay can check; `None` if there are none.
    fn skipped_text(&self) -> Option<String> {
        if self.timed_out == 0 {
            return None;
        }
        let skipped: Vec<String> = self
            .all
            .iter()
            .filter(|(_, _, is_timed_out)| *is_timed_out)
            .map(|(trial, simulation, _)| format!("simulation {simulation} of trial {trial}"))
            .collect();
        let mut names = skipped.iter().take(MAX_NAMED).cloned().collect::<Vec<_>>().join(", ");
        if skipped.len() > MAX_NAMED {
            names.push_str(", …");
        }
        let names = if names.is_empty() { names } else { format!(": {names}") };
        Some(format!(
            "{} of {} chosen simulations cannot be replayed, because they took too long, which depends on the clock{names}; \
             the run has {} of these",
            skipped.len(),
            self.all.len(),
            self.timed_out
        ))
    }
}
