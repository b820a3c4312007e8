use serde::{Deserialize, Serialize};

use crate::Estimate;
use crate::word::words;

words! {
    /// Result of the test of a candidate.
    pub enum BisectedResult { Passes = "passes", Fails = "fails", Undecided = "undecided" }
}

/// The first of an ordered list of controllers that fails a test.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Bisection {
    /// Folder of the finished tests.
    pub folder: String,
    /// Command that asks again, and continues after an interruption.
    pub command: String,
    /// Test in words.
    pub test: String,
    /// Names of all candidates, the oldest first.
    pub candidates: Vec<String>,
    /// Whether the first failing candidate was found: the one just before it passes. Exit code 0.
    pub found: bool,
    /// Answer in a sentence.
    pub verdict: String,
    /// Name of the last candidate that passes before `first_bad`; `null` without an answer.
    pub last_good: Option<String>,
    /// Name of the first candidate that fails; `null` without an answer. One of `undecided` can
    /// fail before it.
    pub first_bad: Option<String>,
    /// Names of the candidates between both. Their tests do not decide, so `found` is `false`.
    pub undecided: Vec<String>,
    /// With every candidate tested: whether no candidate passes after one that fails; `null`
    /// otherwise.
    pub is_monotone: Option<bool>,
    /// Number of simulations of all tested candidates, also of those that were tested earlier.
    pub simulations: u64,
    /// Whether all tests are finished; `false` after an interruption, exit code 130.
    pub is_complete: bool,
    /// The tested candidates, in the order of the candidates.
    pub tested: Vec<BisectedCandidate>,
}

/// A tested candidate of a bisection.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct BisectedCandidate {
    /// Place among the candidates, from 1.
    pub place: u64,
    /// Name of the file.
    pub name: String,
    /// Path of the controller.
    pub controller: String,
    /// `passes`, `fails` or `undecided`.
    pub result: BisectedResult,
    /// Of a test by a rate: success rate with an interval that holds at any time; `null` otherwise.
    pub success_rate: Option<Estimate>,
    /// Number of simulations.
    pub simulations: u64,
    /// Why the candidate fails or is undecided; `null` if it passes.
    pub reason: Option<String>,
    /// Of a test by a rate: path of the run file; `null` otherwise, or if the candidate cannot be
    /// loaded.
    pub run: Option<String>,
    /// Paths of the counterexamples that the candidate violates.
    pub violated: Vec<String>,
}

impl Bisection {
    /// Returns the last passing and the first failing candidate; `None` without an answer.
    pub fn neighbors(&self) -> Option<[&BisectedCandidate; 2]> {
        let named =
            |name: &Option<String>| self.tested.iter().find(|tested| Some(&tested.name) == name.as_ref());
        Some([named(&self.last_good)?, named(&self.first_bad)?])
    }
}
