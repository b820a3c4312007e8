use serde::Serialize;

use crate::word::words;
use crate::{Number, Repeats};

words! {
    /// Result of the test of a counterexample.
    pub enum RegressionResult {
        Passes = "passes", Fixed = "fixed", Fails = "still fails", NewFailure = "new failure",
        NoVerdict = "no verdict", Error = "error",
    }
}

/// Counterexamples of a folder, simulated again. The document is printed also if a test could not
/// run (exit code 2).
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Regression {
    /// The folder.
    pub folder: String,
    /// The controller; `null`: that of each counterexample.
    pub controller: Option<String>,
    /// The controller of `--baseline`; `null` without it.
    pub baseline: Option<String>,
    /// Number of tests that pass, with the controller alone.
    pub passes: u64,
    /// Number of tests that fail, with the controller alone.
    pub fails: u64,
    /// Number of tests with a simulation without a verdict: they neither pass nor fail.
    pub without_verdict: u64,
    /// Number of tests that could not run.
    pub errors: u64,
    /// Number of tests that fail but pass with the baseline; `null` without `--baseline`.
    pub new_failures: Option<u64>,
    /// Number of tests that pass but fail with the baseline; `null` without `--baseline`.
    pub fixed: Option<u64>,
    /// Whether all tests are finished; `false` after an interruption, exit code 130: the others are
    /// missing.
    pub is_complete: bool,
    /// The tests, in the order of the file names.
    pub tests: Vec<RegressionTest>,
}

impl Regression {
    /// Returns why no test asks anything, so that none shows that a failure is fixed; `None` if one
    /// does.
    pub fn asks_nothing(&self) -> Option<&str> {
        let reasons: Option<Vec<&str>> = self.tests.iter().map(|test| test.asks_nothing.as_deref()).collect();
        reasons?.first().copied()
    }
}

/// A counterexample, simulated again.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct RegressionTest {
    /// Name of the file.
    pub file: String,
    /// Target; `null` if the file is not a counterexample.
    pub target: Option<String>,
    /// `passes`, `still fails`, `no verdict` or `error`; with `--baseline` also `new failure` and
    /// `fixed`.
    pub result: RegressionResult,
    /// Robustness in the file.
    pub recorded_robustness: Option<Number>,
    /// Robustness now, with the recorded seed.
    pub robustness: Option<Number>,
    /// Decisive predicate now.
    pub predicate: Option<String>,
    /// Its sample, from 0.
    pub sample: Option<u64>,
    /// Values of its two sides.
    pub values: Option<[Number; 2]>,
    /// Whether the target has the recorded hash; `null` after an error, if the recorded controller
    /// cannot be loaded, and if the hash does not cover all of the target.
    pub same_target: Option<bool>,
    /// Simulations with other seeds; `null` without `--repeat`, without randomness and after an
    /// error.
    pub repeats: Option<Repeats>,
    /// Why the test fails or could not run; `null` if it passes.
    pub reason: Option<String>,
    /// Why the simulation with the recorded seed satisfies the formula and asks nothing; `null`
    /// otherwise.
    pub asks_nothing: Option<String>,
    /// The same simulations with the baseline; `null` without `--baseline`.
    pub baseline: Option<BaselineTest>,
}

/// Simulations of a counterexample with the baseline.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct BaselineTest {
    /// Robustness with the recorded seed; `null` after an error.
    pub robustness: Option<Number>,
    /// Simulations with other seeds; `null` where those of the controller are.
    pub repeats: Option<Repeats>,
}
