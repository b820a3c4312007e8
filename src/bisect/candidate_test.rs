//! The test of a candidate. A finished test stays in the folder of the bisection, under a hash of
//! all that it depends on.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use mishandle_files::{limits, read_text_bounded};
use mishandle_results::{BisectedCandidate, BisectedResult, Evaluation, StopDecision};
use mishandle_rollout::Component;
use mishandle_text::{path_text, plural};
use sha2::{Digest, Sha256};

use super::answer::write_json;
use super::candidates::Candidate;
use super::{BisectionPlan, BisectionProgress, BisectionTest, Watch};
use crate::counterexample::{Counterexample, Suite, Tested, suite_files};
use crate::error::{MishandleError, problem};
use crate::plan::Plan;
use crate::resolve::ResolvedPlan;
use crate::run::{Engine, Probed, Progress, ask, continue_run, of_folder};

/// The test that all candidates take.
pub(super) struct CandidateTest<'a> {
    test: &'a BisectionTest,
    folder: &'a Path,
    /// The files of a test by counterexamples.
    counterexamples: Vec<PathBuf>,
}

/// Result of a candidate; `None` if its test was interrupted.
type Found = Option<BisectedCandidate>;

impl<'a> CandidateTest<'a> {
    /// Checks the test: a mistake in it is reported before the first simulation.
    ///
    /// # Errors
    /// If there is no counterexample, or no candidate can be evaluated as the plan says.
    pub fn new(
        plan: &'a BisectionPlan,
        candidates: &[Candidate],
    ) -> Result<CandidateTest<'a>, MishandleError> {
        let counterexamples = match &plan.test {
            BisectionTest::Counterexamples(path) => counterexamples(path)?,
            BisectionTest::Rate(asked) => {
                // One candidate that cannot be loaded does not make the plan wrong.
                let mut resolved = candidates.iter().map(|one| ResolvedPlan::new(&of_candidate(asked, one)));
                if let Some(Err(first)) = resolved.next()
                    && !resolved.any(|other| other.is_ok())
                {
                    return Err(first);
                }
                Vec::new()
            }
        };
        Ok(CandidateTest { test: &plan.test, folder: &plan.folder, counterexamples })
    }

    /// Returns the test in words.
    pub fn text(&self) -> String {
        match self.test {
            BisectionTest::Counterexamples(path) => {
                let files = plural(self.counterexamples.len() as u64, "counterexample");
                format!("violates none of {files} of {}", path_text(path))
            }
            BisectionTest::Rate(plan) => {
                let evaluate = plan.evaluate.clone().unwrap_or_default();
                format!(
                    "success rate of at least {} on {}, at most {} each, seed {}",
                    evaluate.rate.unwrap_or_default(),
                    plan.target,
                    plural(evaluate.episodes, "simulation"),
                    plan.seed
                )
            }
        }
    }

    /// Tests a candidate, or reads its finished test.
    ///
    /// # Errors
    /// If a simulation cannot be run, or a file cannot be written.
    pub fn run(&self, candidate: &Candidate, watch: Watch<'_>) -> Result<Found, MishandleError> {
        let mut count = |done, most| watch(BisectionProgress { candidate, simulations: (done, most) });
        match self.test {
            BisectionTest::Counterexamples(_) => self.by_counterexamples(candidate, &mut count),
            BisectionTest::Rate(plan) => self.by_rate(candidate, plan, &mut count),
        }
    }

    /// Returns the file of a test that depends on what `hash` contains.
    fn file(&self, candidate: &Candidate, hash: Sha256, ending: &str) -> PathBuf {
        let name = Path::new(&candidate.name).file_stem().unwrap_or_default().to_string_lossy();
        let hash: String = hash.finalize().iter().take(8).map(|byte| format!("{byte:02x}")).collect();
        self.folder.join(format!("{name}-{hash}.{ending}"))
    }

    /// Evaluates a candidate in a run file, which keeps each simulation.
    fn by_rate(
        &self,
        candidate: &Candidate,
        asked: &Plan,
        count: Count<'_>,
    ) -> Result<Found, MishandleError> {
        let resolved = match ResolvedPlan::new(&of_candidate(asked, candidate)) {
            Ok(resolved) => resolved,
            // A candidate that cannot be loaded says nothing about its neighbors.
            Err(error) => {
                let reason = Some(error.with_causes());
                return Ok(Some(found(candidate, BisectedResult::Undecided, reason)));
            }
        };
        let mut hash = Sha256::new();
        feed_target(&mut hash, &resolved);
        feed(&mut hash, &Plan { controller: String::new(), ..asked.clone() }.to_toml());
        let file = self.file(candidate, hash, "sqlite");
        let evaluation = asked.evaluate.clone().unwrap_or_default();
        let run = continue_run(&resolved, &file, Probed::Requirement)?;
        let mut watch = |progress: &Progress| count(progress.simulations, evaluation.episodes);
        let answer = ask(&resolved, run, Engine::Direct, &mut watch).map_err(of_folder)?;
        let answer: Evaluation = answer.try_into()?;
        let Some(sequential) = answer.sequential.filter(|_| answer.is_complete) else { return Ok(None) };
        let (outcome, reason) = match sequential.decision {
            Some(StopDecision::Above) => (BisectedResult::Passes, None),
            Some(_) => (BisectedResult::Fails, Some(sequential.verdict)),
            None => (BisectedResult::Undecided, Some(sequential.verdict)),
        };
        Ok(Some(BisectedCandidate {
            success_rate: Some(sequential.interval),
            simulations: sequential.simulations,
            run: Some(path_text(&file)),
            ..found(candidate, outcome, reason)
        }))
    }

    /// Simulates the counterexamples with a candidate.
    fn by_counterexamples(&self, candidate: &Candidate, count: Count<'_>) -> Result<Found, MishandleError> {
        let controller = path_text(&candidate.controller);
        let kept = self.hash_of_counterexamples(&controller).map(|hash| self.file(candidate, hash, "json"));
        if let Some(file) = &kept
            && let Ok(text) = read_text_bounded(file, limits::RESULT)
            && let Ok(violated) = serde_json::from_str::<Vec<Violated>>(&text)
        {
            return Ok(Some(self.judged(candidate, violated, &[])));
        }
        let mut violated = Vec::new();
        let mut errors = Vec::new();
        for (done, path) in (0..).zip(&self.counterexamples) {
            if count(done, self.counterexamples.len() as u64).is_break() {
                return Ok(None);
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
                Some(_) => violated.extend(reason.map(|reason| (path_text(path), reason))),
            }
        }
        // What a missing file or module prevented can work next time.
        if let (Some(file), []) = (&kept, errors.as_slice()) {
            write_json(file, &violated)?;
        }
        Ok(Some(self.judged(candidate, violated, &errors)))
    }

    /// Returns the result of a test by counterexamples.
    fn judged(&self, candidate: &Candidate, violated: Vec<Violated>, errors: &[String]) -> BisectedCandidate {
        let (outcome, reason) = match (violated.first(), errors.first()) {
            (Some((_, reason)), _) => (BisectedResult::Fails, Some(reason.clone())),
            (None, Some(reason)) => (BisectedResult::Undecided, Some(reason.clone())),
            (None, None) => (BisectedResult::Passes, None),
        };
        let violated = violated.into_iter().map(|(file, _)| file).collect();
        let simulations = (self.counterexamples.len() - errors.len()) as u64;
        BisectedCandidate { simulations, violated, ..found(candidate, outcome, reason) }
    }

    /// Returns the hash of the counterexamples and of their targets with a controller; `None` if
    /// one of them cannot be simulated.
    fn hash_of_counterexamples(&self, controller: &str) -> Option<Sha256> {
        let mut hash = Sha256::new();
        for path in &self.counterexamples {
            let recorded = Counterexample::read(path).ok()?;
            let folder = path.parent().unwrap_or(Path::new("."));
            feed_target(&mut hash, &recorded.resolve_with(folder, controller).ok()?);
            feed(&mut hash, &path_text(path));
            feed(&mut hash, &recorded.to_json());
        }
        Some(hash)
    }
}

/// Path of a counterexample, and why it is violated.
type Violated = (String, String);

type Count<'w> = &'w mut (dyn FnMut(u64, u64) -> ControlFlow<()> + Send);

fn of_candidate(plan: &Plan, candidate: &Candidate) -> Plan {
    Plan { controller: path_text(&candidate.controller), ..plan.clone() }
}

fn counterexamples(path: &Path) -> Result<Vec<PathBuf>, MishandleError> {
    let unreadable = |error| problem(format!("{} cannot be read: {error}", path_text(path)));
    let files = if path.is_dir() {
        suite_files(path).map_err(unreadable)?
    } else {
        vec![std::fs::metadata(path).map(|_| path.to_path_buf()).map_err(unreadable)?]
    };
    if files.is_empty() {
        Err(problem(format!("there is no counterexample (*.json) in {}", path_text(path))))
    } else {
        Ok(files)
    }
}

/// Adds a target with its controller, and the program: the hash of a target covers its files, but
/// not the versions of the software that simulates it.
fn feed_target(hash: &mut Sha256, resolved: &ResolvedPlan) {
    let target = &resolved.target;
    feed(hash, &format!("{:?}", crate::build::build()));
    feed(hash, &format!("{:?}", (&target.identity.hash, &target.versions)));
    // Files can have other names in another folder.
    for Component { role, hash: behavior, file_hash, .. } in &target.components {
        feed(hash, &format!("{role} {behavior} {file_hash}"));
    }
}

fn feed(hash: &mut Sha256, text: &str) {
    hash.update((text.len() as u64).to_le_bytes());
    hash.update(text);
}

/// Returns the result of a candidate without simulations.
fn found(candidate: &Candidate, result: BisectedResult, reason: Option<String>) -> BisectedCandidate {
    BisectedCandidate {
        place: 0,
        name: candidate.name.clone(),
        controller: path_text(&candidate.controller),
        result,
        success_rate: None,
        simulations: 0,
        reason,
        run: None,
        violated: Vec::new(),
    }
}
