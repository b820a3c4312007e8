//! A folder of counterexamples as a suite of tests.

use mishandle_stl::{Formula, is_violated};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use mishandle_results as results;
use mishandle_results::{BaselineTest, Number, RegressionResult, RegressionTest, Repeats};
use mishandle_rollout::{Episode, Target};
use mishandle_text::{decimal, path_text, plural};

use crate::counterexample::{Counterexample, Regression, regress, regress_with};
use crate::error::MishandleError;
use crate::inspect::compared_values;
use crate::plan::Plan;
use crate::resolve::{ResolvedPlan, is_onnx};
use crate::run::failure_text;

/// The system that a suite tests.
#[derive(Clone, Copy)]
pub enum Tested<'a> {
    /// Systems of this program with this controller, or the one of each counterexample.
    Controllers {
        /// Name or path.
        controller: Option<&'a str>,
        /// A controller to compare with.
        baseline: Option<&'a str>,
    },
    /// A target that need not be part of this program.
    Target {
        /// The target.
        target: &'a Target,
        /// A target to compare with.
        baseline: Option<&'a Target>,
    },
}

/// A folder of counterexamples and how they are tested.
#[derive(Clone, Copy)]
pub struct Suite<'a> {
    /// The folder.
    pub folder: &'a Path,
    /// The system.
    pub tested: Tested<'a>,
    /// Number of simulations with other seeds; if it is 0, the recorded seed decides a test.
    pub repeats: u64,
    /// With repeats: largest failure rate of a test that passes.
    pub max_failure_rate: f64,
}

/// Returns the counterexample files of a folder, sorted.
///
/// # Errors
/// If the folder cannot be read.
pub fn suite_files(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        let is_json = path.extension().is_some_and(|found| found.eq_ignore_ascii_case("json"));
        let describes_onnx = path.file_stem().is_some_and(|stem| is_onnx(Path::new(stem)));
        if is_json && !describes_onnx {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

/// A simulation of a test, or the reason that it gives no outcome.
type Simulated = Result<Regression, Failed>;

/// Why a test has no outcome.
#[derive(Clone, Debug)]
struct Failed {
    why: String,
    /// Whether the simulation ran and ended without a verdict.
    has_ended: bool,
}

impl Failed {
    fn new(error: &MishandleError) -> Failed {
        let has_ended = matches!(error, MishandleError::NoVerdict { .. });
        Failed { why: error.with_causes(), has_ended }
    }
}

impl Suite<'_> {
    /// Returns the files `*.json` of the folder, sorted by name, except for descriptions of ONNX
    /// models (`NAME.onnx.json`).
    ///
    /// # Errors
    /// If the folder cannot be read.
    pub fn files(&self) -> std::io::Result<Vec<PathBuf>> {
        suite_files(self.folder)
    }

    /// Returns the number of simulations of a test.
    pub fn simulations(&self) -> u64 {
        (1 + self.repeats) * if self.baseline().is_some() { 2 } else { 1 }
    }

    /// Simulates a file. `watch` is called after each repeat, and can end them. Mistakes in the
    /// file are the result of its test.
    pub fn test(&self, path: &Path, mut watch: impl FnMut(&Episode) -> ControlFlow<()>) -> RegressionTest {
        let recorded = Counterexample::read(path).map_err(|error| match error {
            // Names the path itself.
            MishandleError::File { .. } => Failed::new(&error),
            error => Failed { why: format!("{}: {}", path.display(), error.with_causes()), has_ended: false },
        });
        let mut simulated = |is_baseline| {
            let recorded = recorded.as_ref().map_err(Clone::clone)?;
            self.simulate(recorded, is_baseline, &mut watch).map_err(|error| Failed::new(&error))
        };
        let found: Simulated = simulated(false);
        let baseline: Option<Simulated> = self.baseline().map(|_| simulated(true));
        let outcome = match (self.fails(&found), baseline.as_ref().map(|baseline| self.fails(baseline))) {
            _ if [Some(&found), baseline.as_ref()].into_iter().flatten().any(is_error) => {
                RegressionResult::Error
            }
            (None, _) | (_, Some(None)) => RegressionResult::NoVerdict,
            (Some(false), Some(Some(true))) => RegressionResult::Fixed,
            (Some(false), _) => RegressionResult::Passes,
            (Some(true), Some(Some(false))) => RegressionResult::NewFailure,
            (Some(true), _) => RegressionResult::Fails,
        };
        let recorded = recorded.ok();
        let reason = || reason(&found, baseline.as_ref());
        let robustness = |found: &Simulated| -> Option<Number> {
            found.as_ref().ok()?.episode.robustness().map(Into::into)
        };
        let repeats = |found: &Simulated| found.as_ref().ok()?.repeats.clone();
        let predicate =
            found.as_ref().ok().and_then(|found| found.explained.explanation.diagnosis.predicate.as_ref());
        RegressionTest {
            file: path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            target: recorded.as_ref().map(|recorded| recorded.target.name.clone()),
            result: outcome,
            recorded_robustness: recorded.map(|recorded| recorded.expected.robustness.into()),
            robustness: robustness(&found),
            predicate: predicate.map(|predicate| predicate.text.clone()),
            sample: predicate.map(|predicate| predicate.sample as u64),
            values: predicate.map(|predicate| predicate.values.map(Into::into)),
            same_target: found.as_ref().ok().and_then(|found| Some(!found.has_other_target?)),
            repeats: repeats(&found),
            asks_nothing: found.as_ref().ok().and_then(asks_nothing),
            reason: (![RegressionResult::Passes, RegressionResult::Fixed].contains(&outcome)).then(reason),
            baseline: baseline
                .as_ref()
                .map(|found| BaselineTest { robustness: robustness(found), repeats: repeats(found) }),
        }
    }

    /// Returns the result of all tests.
    pub fn result(&self, tests: Vec<RegressionTest>, is_complete: bool) -> results::Regression {
        let number = |results: &[RegressionResult]| {
            tests.iter().filter(|test| results.contains(&test.result)).count() as u64
        };
        let with_baseline = |result| self.baseline().map(|_| number(&[result]));
        let controller = match self.tested {
            Tested::Controllers { controller, .. } => controller.map(str::to_string),
            Tested::Target { .. } => None,
        };
        results::Regression {
            folder: path_text(self.folder),
            controller,
            baseline: self.baseline().map(str::to_string),
            passes: number(&[RegressionResult::Passes, RegressionResult::Fixed]),
            fails: number(&[RegressionResult::Fails, RegressionResult::NewFailure]),
            without_verdict: number(&[RegressionResult::NoVerdict]),
            errors: number(&[RegressionResult::Error]),
            new_failures: with_baseline(RegressionResult::NewFailure),
            fixed: with_baseline(RegressionResult::Fixed),
            is_complete,
            tests,
        }
    }

    fn baseline(&self) -> Option<&str> {
        match self.tested {
            Tested::Controllers { baseline, .. } => baseline,
            Tested::Target { baseline, .. } => baseline.map(|baseline| baseline.identity.name.as_str()),
        }
    }

    fn simulate(
        &self,
        recorded: &Counterexample,
        is_baseline: bool,
        watch: &mut dyn FnMut(&Episode) -> ControlFlow<()>,
    ) -> Result<Regression, MishandleError> {
        match self.tested {
            Tested::Controllers { controller, baseline } => {
                let controller = if is_baseline { baseline } else { controller };
                regress(recorded, self.folder, controller, self.repeats, watch)
            }
            Tested::Target { target, baseline } => {
                let target = baseline.filter(|_| is_baseline).unwrap_or(target);
                let plan = Plan { seed: 0, ..recorded.plan.clone() };
                let resolved = ResolvedPlan::with_target(&plan, target.clone())?;
                regress_with(recorded, &resolved, self.repeats, watch)
            }
        }
    }

    /// Returns whether a test fails: by the failure rate with other seeds, or without repeats by
    /// the robustness with the recorded seed. `None` if a simulation has no verdict, because a rate
    /// of the others would say nothing about it.
    fn fails(&self, found: &Simulated) -> Option<bool> {
        let found = found.as_ref().ok()?;
        match &found.repeats {
            None => found.episode.robustness().map(is_violated),
            Some(repeats) if repeats.without_verdict > 0 => None,
            Some(repeats) => repeats.failure_rate.value.map(|rate| rate > self.max_failure_rate),
        }
    }
}

/// Returns why the simulation with the recorded seed asks nothing.
fn asks_nothing(found: &Regression) -> Option<String> {
    let vacuity = found.episode.verdict.vacuity?;
    Some(vacuity.reason(&Formula::parse(&found.header.formula).ok()?))
}

/// Returns whether a simulation could not run.
fn is_error(found: &Simulated) -> bool {
    found.as_ref().is_err_and(|failed| !failed.has_ended)
}

/// Describes why a test fails or could not run: the decisive predicate with its values, the failure
/// rate, or the error.
fn reason(found: &Simulated, baseline: Option<&Simulated>) -> String {
    let of_baseline = || baseline.and_then(problem).map(|problem| format!("with the baseline: {problem}"));
    if let Some(problem) = problem(found).or_else(of_baseline) {
        return problem;
    }
    let Ok(found) = found else { return String::new() };
    let robustness = found.episode.robustness().unwrap_or(f64::NAN);
    let decisive = found.explained.explanation.diagnosis.predicate.as_ref().map(|predicate| {
        let at = mishandle_text::instant(predicate.sample, found.header.control_dt);
        format!(
            "{} at {at}: {}",
            predicate.text,
            compared_values(predicate, &found.explained.explanation.unit)
        )
    });
    let rate = found.repeats.as_ref().map(failure_text);
    let parts = [rate, Some(format!("robustness {}", decimal(robustness, 4))), decisive];
    parts.into_iter().flatten().collect::<Vec<_>>().join("; ")
}

/// Describes why simulations give no outcome; `None` if they do.
fn problem(found: &Simulated) -> Option<String> {
    match found {
        Err(failed) => Some(failed.why.clone()),
        Ok(Regression {
            repeats: Some(Repeats { simulations, without_verdict: without @ 1.., .. }), ..
        }) => Some(format!("{without} of {} without a verdict", plural(*simulations, "repeat"))),
        Ok(_) => None,
    }
}
