//! The answer of a bisection: its sentences, and its file.

use std::path::Path;

use mishandle_files::{limits, read_text_bounded, write_atomically};
use mishandle_results::{BisectedCandidate, BisectedResult, Bisection, Versioned};
use mishandle_text::path_text;
use serde::Serialize;

use super::BisectionPlan;
use super::candidates::Candidate;
use super::order::Place;
use crate::error::{MishandleError, foreign_folder, problem};

/// File of the result in the folder of a bisection.
const RESULT: &str = "bisect.json";

/// Tests of some or all candidates.
pub(super) struct Tested {
    /// The tests, in the order of the candidates.
    pub tests: Vec<BisectedCandidate>,
    /// Where the first failing candidate is; `None` after an interruption.
    pub place: Option<Place>,
    /// The outcomes of all candidates; `None` unless all are tested.
    pub all: Option<Vec<BisectedResult>>,
}

impl Tested {
    /// Returns the answer. `test` is the test in words.
    pub fn answer(self, plan: &BisectionPlan, candidates: &[Candidate], test: String) -> Bisection {
        let Tested { tests, place, all } = self;
        let name = |index: usize| candidates[index].name.clone();
        let later_passing: Option<Vec<String>> = all.map(|outcomes| {
            let fails = outcomes.iter().position(|outcome| *outcome == BisectedResult::Fails);
            let later = fails.unwrap_or(outcomes.len())..outcomes.len();
            later.filter(|index| outcomes[*index] == BisectedResult::Passes).map(name).collect()
        });
        let between = match place {
            Some(Place::Between(good, bad)) => Some((good, bad)),
            _ => None,
        };
        Bisection {
            folder: path_text(&plan.folder),
            command: plan.command.clone(),
            test,
            candidates: candidates.iter().map(|candidate| candidate.name.clone()).collect(),
            found: between.is_some_and(|(good, bad)| bad == good + 1),
            verdict: verdict(candidates, place, later_passing.as_deref()),
            last_good: between.map(|(good, _)| name(good)),
            first_bad: between.map(|(_, bad)| name(bad)),
            undecided: between.map_or(Vec::new(), |(good, bad)| (good + 1..bad).map(name).collect()),
            is_monotone: later_passing.map(|later| later.is_empty()),
            simulations: tests.iter().map(|found| found.simulations).sum(),
            is_complete: place.is_some(),
            tested: tests,
        }
    }
}

fn verdict(candidates: &[Candidate], place: Option<Place>, later_passing: Option<&[String]>) -> String {
    let name = |index: usize| &candidates[index].name;
    let last = candidates.len() - 1;
    let word = |outcome: BisectedResult| match outcome {
        BisectedResult::Undecided => "is undecided",
        decided => decided.name(),
    };
    let order = match later_passing {
        Some([]) => " No later candidate passes.".to_string(),
        Some([later]) => format!(" But {later} passes later: the test does not change once only."),
        Some([more @ .., last]) => format!(
            " But {} and {last} pass later: the test does not change once only.",
            more.join(", ")
        ),
        None => {
            " This supposes that no candidate before it fails and none after it passes; only a test of every candidate says so."
                .to_string()
        }
    };
    match place {
        None => "interrupted".to_string(),
        Some(Place::Between(good, bad)) if bad == good + 1 => {
            format!("{} is the first that fails; {} before it passes.{order}", name(bad), name(good))
        }
        Some(Place::Between(good, bad)) => format!(
            "the first that fails is one of the {} after {} up to {}: {} passes, {} fails, and the tests do not decide about \
             those between.{order}",
            bad - good,
            name(good),
            name(bad),
            name(good),
            name(bad)
        ),
        Some(Place::NotBracketed(first, end)) => {
            let of_first = (first != BisectedResult::Passes)
                .then(|| format!("the first candidate, {}, {} instead of passing", name(0), word(first)));
            let of_last = (end != BisectedResult::Fails)
                .then(|| format!("the last candidate, {}, {} instead of failing", name(last), word(end)));
            let parts: Vec<String> = of_first.into_iter().chain(of_last).collect();
            format!("nothing to bisect: {}", parts.join("; "))
        }
    }
}

/// Checks that a folder is missing, empty, or that of a bisection.
///
/// # Errors
/// If it has other files, which are not changed.
pub(super) fn open(folder: &Path) -> Result<(), MishandleError> {
    if folder.join(RESULT).exists() || !folder.exists() {
        return Ok(());
    }
    let with_path = MishandleError::file(folder);
    for entry in std::fs::read_dir(folder).map_err(with_path)? {
        let name = entry.map_err(with_path)?.file_name().to_string_lossy().into_owned();
        // A temporary file of a killed process.
        if !name.starts_with('.') {
            return Err(foreign_folder("bisection", folder, &name));
        }
    }
    Ok(())
}

/// Writes the result to the folder of its bisection.
pub(super) fn write(folder: &Path, found: &Bisection) -> Result<(), MishandleError> {
    write_json(&folder.join(RESULT), &Versioned::new(found))
}

/// Writes a file of the folder, which is created if it is missing.
pub(super) fn write_json(path: &Path, value: &impl Serialize) -> Result<(), MishandleError> {
    let written = serde_json::to_vec_pretty(value).map_err(std::io::Error::from);
    let written = written.and_then(|text| {
        std::fs::create_dir_all(path.parent().unwrap_or(Path::new(".")))?;
        write_atomically(path, &text)
    });
    written.map_err(|error| problem(format!("{} cannot be written: {error}", path_text(path))))
}

/// Returns the result of the last bisection in a folder, with the present paths of its run files;
/// `None` if the folder is not that of a bisection.
///
/// # Errors
/// If the file of the result cannot be read.
pub fn finished(folder: &Path) -> Result<Option<Bisection>, MishandleError> {
    let path = folder.join(RESULT);
    if !path.exists() {
        return Ok(None);
    }
    let with_path = MishandleError::file(&path);
    let text = read_text_bounded(&path, limits::RESULT).map_err(with_path)?;
    let mut found: Bisection = serde_json::from_str(&text).map_err(|error| with_path(error.into()))?;
    found.folder = path_text(folder);
    for run in found.tested.iter_mut().filter_map(|tested| tested.run.as_mut()) {
        *run = path_text(&folder.join(Path::new(run).file_name().unwrap_or_default()));
    }
    Ok(Some(found))
}
