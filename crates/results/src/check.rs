use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};

use crate::word::words;
use crate::{Estimate, Number, PhysicsCheck, Seed, WithoutVerdict};

words! {
    /// Severity of the violation of a requirement, the worst first.
    #[derive(Default)]
    pub enum Severity { Critical = "critical", #[default] Error = "error", Warning = "warning" }

    /// Verdict of a requirement.
    pub enum CheckVerdict {
        Violated = "violated", NotViolated = "not violated", AsksNothing = "not violated: asks nothing",
        NoVerdict = "no verdict", NotApplicable = "not applicable",
    }

    /// Scenarios of a run of a check.
    pub enum CheckRunKind { Random = "random", Search = "search" }
}

/// A file of requirements checked on a target with one or several controllers: a traceability
/// matrix. It is evidence from simulations, and no certificate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Check {
    /// Folder of the run files, the counterexamples and the reports.
    pub folder: String,
    /// File of the requirements.
    pub requirements_file: String,
    /// SHA-256 of this file.
    pub requirements_digest: String,
    /// Title of the file; `null` without one.
    pub title: Option<String>,
    /// Note for the readers, from the file; `null` without one.
    pub notice: Option<String>,
    /// Name of the target.
    pub target: String,
    /// Kind of the target.
    pub target_kind: String,
    /// Least severity of a violation with exit code 1: `critical`, `error` or `warning`.
    pub fail_on: Severity,
    /// Whether requirements whose signals the target lacks are accepted.
    pub allows_inapplicable: bool,
    /// Seed of all runs.
    pub seed: Seed,
    /// Search for counterexamples; empty if none was needed.
    pub search: String,
    /// The simulations of all runs without a verdict on a requirement that they check.
    pub without_verdict: WithoutVerdict,
    /// Version of the program that made the runs.
    pub program: String,
    /// The requirements, in the order of the file.
    pub requirements: Vec<CheckedRequirement>,
    /// The controllers, in the given order.
    pub controllers: Vec<CheckedController>,
    /// The cells of the matrix: for each requirement, one per controller.
    pub cells: Vec<CheckCell>,
}

/// A requirement of a file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct CheckedRequirement {
    /// Identifier.
    pub name: String,
    /// The requirement in words, from the file; `null` without them.
    pub text: Option<String>,
    /// Formula as the file states it, with the units of its bounds; or the name of one of the
    /// target.
    pub formula: String,
    /// Text of the formula that `formula` names; `null` if `formula` is the text.
    pub named_formula: Option<String>,
    /// Severity of a violation: `critical`, `error` or `warning`.
    pub severity: Severity,
    /// Clauses of standards that ask for it.
    pub clauses: Vec<String>,
    /// Where the numbers of the formula come from; `null` if the file does not say it.
    pub source: Option<String>,
    /// Scenario space; empty if the target lacks signals of the formula and the file names no
    /// space.
    pub space: String,
    /// Largest failure rate that is allowed; `null`: no violation is.
    pub max_failure_rate: Option<f64>,
}

/// A controller of a check.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct CheckedController {
    /// Name, or path; empty for a target without one.
    pub name: String,
    /// Hash of what the controller does; `null` without one.
    pub hash: Option<String>,
    /// Hash of the target with this controller.
    pub target_hash: String,
    /// The runs, with all their simulations.
    pub runs: Vec<CheckRun>,
}

/// A run file of a check.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct CheckRun {
    /// Path of the run file.
    pub run: String,
    /// `random` scenarios, or a `search`.
    pub kind: CheckRunKind,
    /// Scenario space.
    pub space: String,
    /// The requirement that the search tries to violate; `null` for random scenarios.
    pub requirement: Option<String>,
    /// Number of simulations.
    pub simulations: u64,
    /// Digest of all records of the run: equal for equal simulations.
    pub digest: String,
    /// The axes that change no trace, each in a sentence; none of a search, whose space is that of
    /// random scenarios.
    pub idle_axes: Vec<String>,
}

/// The verdict of a requirement for a controller.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct CheckCell {
    /// Identifier of the requirement.
    pub requirement: String,
    /// Name of the controller.
    pub controller: String,
    /// `violated`; `not violated` in the simulations that were run, which proves nothing about
    /// others; `not violated: asks nothing`: it holds in each of them whatever the controller does,
    /// because the first sample decides it or its premise never holds; `no verdict`: the
    /// simulations do not decide, or too many of them have no verdict; or `not applicable`: the
    /// target lacks signals of the formula.
    pub verdict: CheckVerdict,
    /// The evidence in a sentence.
    pub evidence: String,
    /// Signals of the formula that the target lacks.
    pub missing_signals: Vec<String>,
    /// Random scenarios in the space of the requirement.
    pub random: CheckCounts,
    /// Simulations that searches chose in this space, also searches for another requirement.
    pub searched: CheckCounts,
    /// Share of the random scenarios that violate it, with two one-sided 95 % bounds
    /// (Clopper-Pearson). Simulations without a verdict count as satisfied for the lower bound, as
    /// violated for the upper one. `null` if it is not applicable.
    pub failure_rate: Option<Estimate>,
    /// Minimum robustness; `null` without a verdict.
    pub minimum_robustness: Option<Number>,
    /// The violation with the minimum robustness; `null` without one.
    pub counterexample: Option<CheckCounterexample>,
}

/// Numbers of simulations of a requirement.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct CheckCounts {
    /// Number of simulations with a verdict.
    pub simulations: u64,
    /// Number of these that violate it.
    pub violated: u64,
    /// Number of simulations without a verdict.
    pub without_verdict: u64,
    /// Number of other simulations, from whose scenario the target cannot start; left out if there
    /// are none.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub invalid_starts: u64,
}

fn is_zero(count: &u64) -> bool {
    *count == 0
}

/// A violation as evidence.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct CheckCounterexample {
    /// Run file.
    pub run: String,
    /// Trial.
    pub trial: u32,
    /// Number of the simulation in its trial.
    pub simulation: u32,
    /// Random seed of the simulation.
    pub seed: Seed,
    /// The scenario beside the nominal one.
    pub scenario: Vec<CheckedValue>,
    /// Robustness.
    pub robustness: Number,
    /// Counterexample file; `null` for a system that the command line cannot simulate.
    pub file: Option<String>,
    /// The check of its physics; `null` for a target whose physics MuJoCo C does not step.
    pub physics: Option<PhysicsCheck>,
    /// Command, or call in Python, that simulates it again.
    pub replay: String,
}

/// The value of an axis in a counterexample.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct CheckedValue {
    /// Name of the axis.
    pub axis: String,
    /// Unit; empty without one.
    pub unit: String,
    /// Value; `null`: drawn at random.
    pub value: Option<f64>,
    /// Value in the undisturbed episode; `null`: drawn at random.
    pub nominal: Option<f64>,
}

impl CheckedRequirement {
    /// Returns the text of the formula.
    pub fn formula_text(&self) -> &str {
        self.named_formula.as_deref().unwrap_or(&self.formula)
    }
}

impl CheckCell {
    /// Returns whether simulations could have violated it.
    fn is_checked(&self) -> bool {
        matches!(self.verdict, CheckVerdict::Violated | CheckVerdict::NotViolated)
    }
}

impl Check {
    /// Returns what found a counterexample: `a random scenario`, or the search for a requirement.
    /// Only random scenarios count in a rate. `None` if no run has the counterexample.
    pub fn found_by(&self, counterexample: &CheckCounterexample) -> Option<String> {
        let mut runs = self.controllers.iter().flat_map(|controller| &controller.runs);
        let run = runs.find(|run| run.run == counterexample.run)?;
        Some(match (run.kind, &run.requirement) {
            (CheckRunKind::Random, _) => "a random scenario".to_string(),
            (CheckRunKind::Search, Some(name)) => format!("found by the search for {name}"),
            (CheckRunKind::Search, None) => "found by a search".to_string(),
        })
    }

    /// Returns the sentences about axes that change no trace, each once.
    pub fn idle_axes(&self) -> BTreeSet<&str> {
        let runs = self.controllers.iter().flat_map(|controller| &controller.runs);
        runs.flat_map(|run| &run.idle_axes).map(String::as_str).collect()
    }

    /// Returns the requirement of a cell.
    pub fn requirement(&self, cell: &CheckCell) -> Option<&CheckedRequirement> {
        self.requirements.iter().find(|known| known.name == cell.requirement)
    }

    /// Returns whether the severity of a cell counts for the exit code.
    fn counts(&self, cell: &CheckCell) -> bool {
        self.requirement(cell).is_some_and(|requirement| requirement.severity <= self.fail_on)
    }

    /// Returns whether a cell gives exit code 1.
    pub fn fails(&self, cell: &CheckCell) -> bool {
        cell.verdict == CheckVerdict::Violated && self.counts(cell)
    }

    /// Returns whether a cell gives exit code 2: a requirement that counts was not checked, or none
    /// was.
    pub fn is_open(&self, cell: &CheckCell) -> bool {
        match cell.verdict {
            CheckVerdict::Violated | CheckVerdict::NotViolated => false,
            _ if !self.cells.iter().any(CheckCell::is_checked) => true,
            CheckVerdict::AsksNothing | CheckVerdict::NoVerdict => self.counts(cell),
            CheckVerdict::NotApplicable => !self.allows_inapplicable && self.counts(cell),
        }
    }

    /// Returns the exit code of the command: 1 if a requirement that counts is violated, 2 if one
    /// was not checked or none was, otherwise 0.
    pub fn exit_code(&self) -> u8 {
        if self.cells.iter().any(|cell| self.fails(cell)) {
            1
        } else {
            2 * u8::from(self.cells.iter().any(|cell| self.is_open(cell)))
        }
    }

    /// Returns the number of cells with a verdict.
    pub fn count(&self, verdict: CheckVerdict) -> usize {
        self.cells.iter().filter(|cell| cell.verdict == verdict).count()
    }
}
