//! Bisections: the first of an ordered list of controllers that fails a counterexample, or whose
//! success rate is below a bar.

mod answer;
mod candidate_test;
mod candidates;
mod order;

use std::ops::ControlFlow;
use std::path::PathBuf;

use mishandle_results::{BisectedCandidate, BisectedResult, Bisection};
use mishandle_store::RunKind;

pub use answer::finished;
pub use candidates::Candidate;

use answer::Tested;
use candidate_test::CandidateTest;
use order::{earliest_failing, first_failing};

use crate::error::{MishandleError, problem};
use crate::plan::{EvaluatePlan, Plan, Until};

/// The test of a bisection.
#[derive(Clone, Debug)]
pub enum BisectionTest {
    /// A counterexample, or a folder of them: a candidate passes if it violates none.
    Counterexamples(PathBuf),
    /// The evaluation of a candidate, which ends when it decides whether the success rate is above
    /// or below the bar: see [`BisectionTest::rate`].
    Rate(Box<Plan>),
}

impl BisectionTest {
    /// Largest number of simulations of a candidate, if the plan has no table `[evaluate]`.
    pub const EPISODES: u64 = 1000;

    /// Returns the test by a success rate: a candidate passes if it is above the bar. All
    /// candidates have the same scenarios and seeds, at most as many as the table `[evaluate]` of
    /// the plan states.
    ///
    /// # Errors
    /// If the plan has a screening.
    pub fn rate(plan: Plan, bar: f64) -> Result<BisectionTest, MishandleError> {
        if plan.screening.is_some() {
            return Err(problem("a bisection has no screening: remove the table [screening] of the plan"));
        }
        let planned = plan.evaluate.clone();
        let evaluate = EvaluatePlan {
            episodes: planned.as_ref().map_or(BisectionTest::EPISODES, |evaluate| evaluate.episodes),
            until: Some(Until::Decided),
            rate: Some(bar),
            // They take simulations and do not decide.
            corners: false,
            control: false,
            ..planned.unwrap_or_default()
        };
        let plan = Plan { evaluate: Some(evaluate), ..plan.only(RunKind::Evaluate) };
        Ok(BisectionTest::Rate(Box::new(plan)))
    }
}

/// A question about ordered candidates.
#[derive(Clone, Debug)]
pub struct BisectionPlan {
    /// Folder of the controllers, ordered by name. Numbers in names are ordered by value.
    pub controllers: PathBuf,
    /// The test.
    pub test: BisectionTest,
    /// Whether every candidate is tested.
    pub every: bool,
    /// Folder of finished tests, which are not made again, and of the result.
    pub folder: PathBuf,
    /// Command that asks this question.
    pub command: String,
}

impl BisectionPlan {
    /// Default of `folder`.
    pub const FOLDER: &str = "runs/bisect";
}

/// How far a bisection is.
#[derive(Clone, Copy, Debug)]
pub struct BisectionProgress<'a> {
    /// The candidate that is tested.
    pub candidate: &'a Candidate,
    /// Number of its simulations so far, and the maximum.
    pub simulations: (u64, u64),
}

/// Gets the progress now and then, and can end the bisection, which a later call continues.
pub type Watch<'w> = &'w mut (dyn FnMut(BisectionProgress<'_>) -> ControlFlow<()> + Send);

/// Finds the first failing candidate, and writes the result to the folder.
///
/// A test by a rate is sequential: it ends as soon as the interval of the success rate, which holds
/// at any time (95 %), is on one side of the bar. A candidate about which the maximum number of
/// simulations does not decide is undecided, as is one whose test cannot run.
///
/// # Errors
/// If there are fewer than two candidates, a plan cannot be resolved, a simulation cannot be run,
/// or the folder cannot be written.
pub fn bisect(plan: &BisectionPlan, watch: Watch<'_>) -> Result<Bisection, MishandleError> {
    answer::open(&plan.folder)?;
    let candidates = candidates::candidates(&plan.controllers)?;
    let test = CandidateTest::new(plan, &candidates)?;
    let n = candidates.len();
    // A folder with this file is that of a bisection, also after a kill.
    let started = Tested { tests: Vec::new(), place: None, all: None };
    answer::write(&plan.folder, &started.answer(plan, &candidates, test.text()))?;
    let mut tested: Vec<Option<BisectedCandidate>> = vec![None; n];
    let mut ask = |index: usize| -> Result<Option<BisectedResult>, MishandleError> {
        let Some(found) = test.run(&candidates[index], &mut *watch)? else { return Ok(None) };
        let result = found.result;
        tested[index] = Some(BisectedCandidate { place: index as u64 + 1, ..found });
        Ok(Some(result))
    };
    let (place, all) = if plan.every {
        // An interruption ends the tests.
        let outcomes: Result<Vec<BisectedResult>, _> =
            (0..n).map_while(|index| ask(index).transpose()).collect();
        let all = Some(outcomes?).filter(|outcomes| outcomes.len() == n);
        (all.as_deref().and_then(earliest_failing), all)
    } else {
        (first_failing(n, ask)?, None)
    };
    let tested = Tested { tests: tested.into_iter().flatten().collect(), place, all };
    let found = tested.answer(plan, &candidates, test.text());
    answer::write(&plan.folder, &found)?;
    Ok(found)
}
