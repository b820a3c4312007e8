//! Bisections: the first of an ordered list of controllers that fails a counterexample, or whose
//! success rate is below a bar.

mod candidates;
mod order;

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use mishandle_evaluation::{Decision, StopRule};
use mishandle_files::{limits, read_text_bounded, write_atomically};
use mishandle_results::{BisectedCandidate, Bisection, Estimate};
use mishandle_text::{path_text, plural};
use sha2::{Digest, Sha256};

pub use candidates::{Candidate, folder_candidates, git_candidates};
use order::{Outcome, Place, earliest_failing, first_failing};

use crate::counterexample::{Suite, Tested, suite_files};
use crate::error::MishandleError;
use crate::inspect::RANDOM_TRIAL;
use crate::plan::Plan;
use crate::resolve::ResolvedPlan;
use crate::run::{RateRule, recorded_episode, run_simulations};

/// The test of a bisection.
#[derive(Clone, Debug)]
pub enum BisectionTest {
    /// A counterexample, or a folder of them: a candidate passes if it violates none.
    Counterexamples(PathBuf),
    /// The success rate in the random scenarios of an evaluation: a candidate passes if it is at
    /// least the bar. All candidates have the same scenarios and seeds.
    Rate {
        /// Plan of the evaluation, whose number of simulations is the maximum for a candidate.
        plan: Box<Plan>,
        /// The bar.
        bar: f64,
    },
}

/// A question about ordered candidates.
#[derive(Clone, Debug)]
pub struct BisectionPlan {
    /// The candidates, the oldest first.
    pub candidates: Vec<Candidate>,
    /// The test.
    pub test: BisectionTest,
    /// Whether every candidate is tested.
    pub all: bool,
    /// Folder of finished tests, which are not made again.
    pub cache: PathBuf,
}

/// How far a bisection is.
#[derive(Clone, Copy, Debug)]
pub struct BisectionProgress<'a> {
    /// The candidate that is tested.
    pub candidate: &'a Candidate,
    /// Number of its simulations so far, and the maximum.
    pub simulations: (u64, u64),
}

type Watch<'a> = &'a mut dyn FnMut(BisectionProgress<'_>) -> ControlFlow<()>;

/// Finds the first failing candidate.
///
/// A test by a rate is sequential: it ends as soon as the interval of the success rate, which holds
/// at any time (95 %), is on one side of the bar. A candidate about which the maximum number of
/// simulations does not decide is undecided, as is one whose test cannot run.
///
/// # Errors
/// If a plan cannot be resolved, a simulation cannot be run, or the cache cannot be written.
pub fn bisect(plan: &BisectionPlan, watch: Watch<'_>) -> Result<Bisection, MishandleError> {
    let files = match &plan.test {
        BisectionTest::Counterexamples(path) => counterexamples(path)?,
        BisectionTest::Rate { plan: asked, .. } => {
            // A mistake in the plan is reported before the first simulation. One candidate that
            // cannot be loaded is none.
            let mut mistake = None;
            for candidate in &plan.candidates {
                match ResolvedPlan::new(&with_controller(asked, candidate)) {
                    Ok(_) => {
                        mistake = None;
                        break;
                    }
                    Err(error) => mistake = mistake.or(Some(error)),
                }
            }
            mistake.map_or(Ok(Vec::new()), Err)?
        }
    };
    let n = plan.candidates.len();
    let mut tested: Vec<Option<BisectedCandidate>> = vec![None; n];
    let mut test = |index: usize| -> Result<Option<Outcome>, MishandleError> {
        let Some(found) = test_candidate(plan, &files, index, &mut *watch)? else { return Ok(None) };
        let outcome = outcome(&found);
        tested[index] = Some(found);
        Ok(Some(outcome))
    };
    let mut is_complete = true;
    let mut outcomes = Vec::new();
    if plan.all {
        for index in 0..n {
            match test(index)? {
                Some(found) => outcomes.push(found),
                None => {
                    is_complete = false;
                    break;
                }
            }
        }
    }
    let place = match (plan.all, is_complete) {
        (true, true) => earliest_failing(&outcomes),
        (true, false) => None,
        (false, _) => first_failing(n, &mut test)?,
    };
    let name = |index: usize| plan.candidates[index].name.clone();
    // The candidates that pass after the first failing one; unknown unless all are tested.
    let later_passing: Option<Vec<String>> = (plan.all && is_complete).then(|| {
        let bad = outcomes.iter().position(|outcome| *outcome == Outcome::Fails).unwrap_or(n);
        (bad..n).filter(|index| outcomes[*index] == Outcome::Passes).map(name).collect()
    });
    let between = match place {
        Some(Place::Between(good, bad)) => Some((good, bad)),
        _ => None,
    };
    let tested: Vec<BisectedCandidate> = tested.into_iter().flatten().collect();
    Ok(Bisection {
        test: test_text(&plan.test, files.len()),
        candidates: n as u64,
        found: between.is_some(),
        verdict: verdict(plan, place, later_passing.as_deref()),
        last_good: between.map(|(good, _)| name(good)),
        first_bad: between.map(|(_, bad)| name(bad)),
        undecided: between.map_or(Vec::new(), |(good, bad)| (good + 1..bad).map(name).collect()),
        is_monotone: later_passing.map(|later| later.is_empty()),
        simulations: tested.iter().map(|found| found.simulations).sum(),
        is_complete: place.is_some(),
        tested,
    })
}

fn with_controller(plan: &Plan, candidate: &Candidate) -> Plan {
    Plan { controller: path_text(&candidate.controller), ..plan.clone() }
}

fn counterexamples(path: &Path) -> Result<Vec<PathBuf>, MishandleError> {
    let unreadable =
        |error| MishandleError::Bisect { problem: format!("{} cannot be read: {error}", path_text(path)) };
    let files = match path.is_dir() {
        true => suite_files(path).map_err(unreadable)?,
        false => vec![std::fs::metadata(path).map(|_| path.to_path_buf()).map_err(unreadable)?],
    };
    match files.is_empty() {
        true => Err(MishandleError::Bisect {
            problem: format!("there is no counterexample (*.json) in {}", path_text(path)),
        }),
        false => Ok(files),
    }
}

/// Tests a candidate, or reads its finished test. Returns `None` if it was interrupted.
fn test_candidate(
    plan: &BisectionPlan,
    files: &[PathBuf],
    index: usize,
    watch: Watch<'_>,
) -> Result<Option<BisectedCandidate>, MishandleError> {
    let candidate = &plan.candidates[index];
    let file = plan.cache.join(format!("{}.json", key(plan, files, candidate)?));
    let named = |found: BisectedCandidate| BisectedCandidate {
        place: index as u64 + 1,
        name: candidate.name.clone(),
        controller: path_text(&candidate.controller),
        ..found
    };
    if let Ok(text) = read_text_bounded(&file, limits::RESULT)
        && let Ok(found) = serde_json::from_str::<BisectedCandidate>(&text)
    {
        return Ok(Some(named(found)));
    }
    let mut count = |done: u64, most: u64| watch(BisectionProgress { candidate, simulations: (done, most) });
    let found = match &plan.test {
        BisectionTest::Counterexamples(_) => by_counterexamples(candidate, files, &mut count),
        BisectionTest::Rate { plan, bar } => by_rate(candidate, plan, *bar, &mut count)?,
    };
    let Some(found) = found.map(named) else { return Ok(None) };
    // What a missing file or module prevented can work next time.
    if outcome(&found) == Outcome::Undecided && found.simulations == 0 {
        return Ok(Some(found));
    }
    let unwritable = |error: std::io::Error| MishandleError::Bisect {
        problem: format!("{} cannot be written: {error}", path_text(&file)),
    };
    std::fs::create_dir_all(&plan.cache).map_err(unwritable)?;
    let text = serde_json::to_string_pretty(&found).map_err(|error| unwritable(error.into()))?;
    write_atomically(&file, text.as_bytes()).map_err(unwritable)?;
    Ok(Some(found))
}

/// Returns the name of a finished test: the hash of its question, of the controller's file, and of
/// the program.
fn key(plan: &BisectionPlan, files: &[PathBuf], candidate: &Candidate) -> Result<String, MishandleError> {
    let read = |path: &Path| {
        mishandle_files::read_bounded(path, limits::CONTROLLER).map_err(|error| MishandleError::Bisect {
            problem: format!("{} cannot be read: {error}", path_text(path)),
        })
    };
    let mut hash = Sha256::new();
    let mut feed = |bytes: &[u8]| {
        hash.update((bytes.len() as u64).to_le_bytes());
        hash.update(bytes);
    };
    feed(crate::build::build().git_commit.as_bytes());
    feed(&read(&candidate.controller)?);
    match &plan.test {
        BisectionTest::Counterexamples(_) => {
            for file in files {
                feed(&read(file)?);
            }
        }
        BisectionTest::Rate { plan, bar } => {
            // It covers the file of a target.
            if let Ok(resolved) = ResolvedPlan::new(&with_controller(plan, candidate)) {
                feed(resolved.target.identity.hash.as_bytes());
            }
            feed(Plan { controller: String::new(), ..(**plan).clone() }.to_toml().as_bytes());
            feed(&bar.to_bits().to_le_bytes());
        }
    }
    Ok(hash.finalize().iter().take(16).map(|byte| format!("{byte:02x}")).collect())
}

type Count<'a> = &'a mut dyn FnMut(u64, u64) -> ControlFlow<()>;

fn by_counterexamples(
    candidate: &Candidate,
    files: &[PathBuf],
    count: Count<'_>,
) -> Option<BisectedCandidate> {
    let controller = path_text(&candidate.controller);
    let most = files.len() as u64;
    let (mut failing, mut errors) = (Vec::new(), Vec::new());
    for (done, path) in (0..).zip(files) {
        if count(done, most).is_break() {
            return None;
        }
        let suite = Suite {
            folder: path.parent().unwrap_or(Path::new(".")),
            tested: Tested::Controllers { controller: Some(&controller), baseline: None },
            repeats: 0,
            max_failure_rate: 0.0,
        };
        let test = suite.test(path, |_| ControlFlow::Continue(()));
        let reason = test.reason.map(|reason| format!("{}: {reason}", test.file));
        match test.robustness {
            None => errors.extend(reason),
            Some(_) => failing.extend(reason),
        }
    }
    let (result, reason) = match (failing.first(), errors.first()) {
        (Some(reason), _) => (Outcome::Fails, Some(reason.clone())),
        (None, Some(reason)) => (Outcome::Undecided, Some(reason.clone())),
        (None, None) => (Outcome::Passes, None),
    };
    Some(result_of(result, None, most, reason))
}

/// Simulates until the interval of the success rate is on one side of the bar.
fn by_rate(
    candidate: &Candidate,
    plan: &Plan,
    bar: f64,
    count: Count<'_>,
) -> Result<Option<BisectedCandidate>, MishandleError> {
    let resolved = match ResolvedPlan::new(&with_controller(plan, candidate)) {
        Ok(resolved) => resolved,
        // A revision that cannot be loaded says nothing about its neighbors.
        Err(error) => {
            let reason = Some(error.with_causes());
            return Ok(Some(result_of(Outcome::Undecided, None, 0, reason)));
        }
    };
    let evaluate = plan.evaluate.clone().unwrap_or_default();
    let most = u32::try_from(evaluate.episodes).unwrap_or(u32::MAX);
    let batch = evaluate.batch.max(1);
    let (mut rule, mut done) = (RateRule::with(StopRule::Rate(bar), batch.into(), most.into()), 0);
    while done < most && !rule.is_decided() {
        if count(u64::from(done), u64::from(most)).is_break() {
            return Ok(None);
        }
        let last = done.saturating_add(batch).min(most);
        for simulation in run_simulations(&resolved, RANDOM_TRIAL, done + 1..=last)? {
            rule.add(&recorded_episode(&simulation));
        }
        done = last;
    }
    let outcome = match rule.decision() {
        Some(Decision::Above) => Outcome::Passes,
        Some(_) => Outcome::Fails,
        None => Outcome::Undecided,
    };
    let found = rule.estimate();
    let percent =
        |value: Option<f64>| value.map_or("-".to_string(), |value| format!("{:.1} %", 100.0 * value));
    let interval = format!("{} to {} at any time", percent(found.low), percent(found.high));
    let reason = match outcome {
        Outcome::Passes => None,
        Outcome::Fails => Some(format!("success rate {} ({interval})", percent(found.value))),
        Outcome::Undecided if !rule.has_verdict() => Some("no simulation has a verdict".to_string()),
        Outcome::Undecided => {
            Some(format!("success rate {} ({interval}), which contains the bar", percent(found.value)))
        }
    };
    Ok(Some(result_of(outcome, Some(found), u64::from(done), reason)))
}

fn result_of(
    outcome: Outcome,
    success_rate: Option<Estimate>,
    simulations: u64,
    reason: Option<String>,
) -> BisectedCandidate {
    let result = match outcome {
        Outcome::Passes => "passes",
        Outcome::Fails => "fails",
        Outcome::Undecided => "undecided",
    };
    BisectedCandidate {
        place: 0,
        name: String::new(),
        controller: String::new(),
        result: result.to_string(),
        success_rate,
        simulations,
        reason,
    }
}

fn outcome(found: &BisectedCandidate) -> Outcome {
    match found.result.as_str() {
        "passes" => Outcome::Passes,
        "fails" => Outcome::Fails,
        _ => Outcome::Undecided,
    }
}

fn test_text(test: &BisectionTest, files: usize) -> String {
    match test {
        BisectionTest::Counterexamples(path) => {
            format!("violates none of {} of {}", plural(files as u64, "counterexample"), path_text(path))
        }
        BisectionTest::Rate { plan, bar } => format!(
            "success rate of at least {bar} on {}, at most {} each, seed {}",
            plan.target,
            plural(plan.evaluate.clone().unwrap_or_default().episodes, "simulation"),
            plan.seed
        ),
    }
}

fn verdict(plan: &BisectionPlan, place: Option<Place>, later_passing: Option<&[String]>) -> String {
    let name = |index: usize| &plan.candidates[index].name;
    let last = plan.candidates.len() - 1;
    let word = |outcome| match outcome {
        Outcome::Passes => "passes",
        Outcome::Fails => "fails",
        Outcome::Undecided => "is undecided",
    };
    let order = match later_passing {
        Some([]) => " No later candidate passes.".to_string(),
        Some([later]) => format!(" But {later} passes later: the test does not change once only."),
        Some([more @ .., last]) => format!(
            " But {} and {last} pass later: the test does not change once only.",
            more.join(", ")
        ),
        None => {
            " This supposes that no candidate before it fails and none after it passes; --all tests every candidate."
                .to_string()
        }
    };
    match place {
        None => "interrupted".to_string(),
        Some(Place::Between(good, bad)) if bad == good + 1 => {
            format!("{} is the first that fails; {} before it passes.{order}", name(bad), name(good))
        }
        Some(Place::Between(good, bad)) => format!(
            "the first that fails is one of the {} after {} up to {}: {} passes, {} fails, and the simulations do not decide about \
             those between.{order}",
            bad - good,
            name(good),
            name(bad),
            name(good),
            name(bad)
        ),
        Some(Place::NotBracketed(first, end)) => format!(
            "nothing to bisect: the first candidate, {}, {}, and the last, {}, {}; the first must pass and the last must fail.",
            name(0),
            word(first),
            name(last),
            word(end)
        ),
    }
}
