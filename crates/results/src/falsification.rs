use serde::Serialize;

use crate::word::words;
use crate::{
    CheckedFailure, EndReasons, Estimate, Instant, Modes, Named, Number, PhysicsCheck, Repeats, Scenario,
    Screening, Seed, Subject, Vacuous, WithoutVerdict,
};

/// Counterexamples that the trials of a search found.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Falsification {
    /// Path of the run file; missing if none is written.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub run: Option<String>,
    /// Target, controller, noise and space of the search.
    #[serde(flatten)]
    pub subject: Subject,
    /// Whether all trials have ended; `false` after an interruption, exit code 130.
    pub is_complete: bool,
    /// Name of the search.
    pub search: String,
    /// Search options that the plan sets.
    pub search_options: Named<SearchValue>,
    /// The requirement.
    pub formula: String,
    /// Largest number of simulations per trial.
    pub budget: u32,
    /// Number of simulations run at once.
    pub batch: u32,
    /// Random seed of every simulation; `null` if each simulation has a seed of its own.
    pub fixed_seed: Option<Seed>,
    /// Whether simulations end as soon as the search does not need the rest.
    pub early_stopping: bool,
    /// Number of simulations of all trials.
    pub simulations: u64,
    /// The simulations without a verdict; with screening, the simulations of MuJoCo C.
    pub without_verdict: WithoutVerdict,
    /// Number of control steps of all simulations; with screening, of the simulations of MuJoCo C.
    pub control_steps: u64,
    /// Number of simulations that belong to no trial: in their batch they follow the end of their
    /// trial or its search.
    #[serde(skip)]
    pub surplus: u64,
    /// Number of trials that found a counterexample.
    pub falsified_trials: u32,
    /// Fraction of the ended trials that found a counterexample, with its Wilson interval.
    pub falsification_rate: Estimate,
    /// Mean number of simulations up to the counterexample, over the falsified trials only; `null`
    /// without one.
    pub mean_simulations: Option<f64>,
    /// Number of simulations after which half of all trials are falsified; `null` if fewer than
    /// half are falsified within the budget, or if a trial was interrupted.
    pub median_simulations: Option<u32>,
    /// Mean number of simulations over all trials; a trial without a counterexample counts as the
    /// budget. `null` if a trial was interrupted.
    pub restricted_mean_simulations: Option<f64>,
    /// The part of the space that cannot fail if the requirement is smooth; `null` where
    /// `failure_rate_bound` is, and without `report.smooth-region`, which takes further
    /// simulations.
    pub smooth_region: Option<SmoothRegion>,
    /// One-sided 95 % upper bound of the failure rate if no simulation of uniform random samples
    /// (`random`) fails; `null` otherwise.
    pub failure_rate_bound: Option<f64>,
    /// Why no simulation asks anything of the controller, so that none is evidence; `null`
    /// otherwise.
    pub asks_nothing: Option<String>,
    /// Warnings of the checks before the first simulation.
    pub warnings: Vec<String>,
    /// Each named requirement over all simulations; missing without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub requirements: Option<Vec<Requirement>>,
    /// Reasons that the target gave for the ends of simulations, by end; missing without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reasons: Option<Vec<EndReasons>>,
    /// The trials.
    pub trials: Vec<Trial>,
    /// Failure modes, with `falsify.keep-going`.
    #[serde(flatten)]
    pub modes: Option<Modes>,
    /// Counts of the screening; missing without it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub screening: Option<Screening>,
}

words! {
    /// End of a trial.
    pub enum TrialEnd {
        Falsified = "falsified", BudgetSpent = "budget spent", SearchEnded = "search ended",
        ModesDriedUp = "modes dried up",
    }
}

impl Falsification {
    /// Returns the number of simulations without a verdict, with the ones that could not start.
    pub fn simulations_without_verdict(&self) -> u64 {
        let of = |trial: &Trial| trial.diverged + trial.invalid + trial.failed + trial.undecided;
        self.trials.iter().map(|trial| u64::from(of(trial))).sum()
    }
}

/// A trial: one search with its own random seed.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Trial {
    /// Number of the trial, from 1.
    pub trial: u32,
    /// Whether the trial found a counterexample.
    pub falsified: bool,
    /// Number of simulations.
    pub simulations: u32,
    /// Number of the first simulation with a counterexample; `null` without one.
    pub first_violation: Option<u32>,
    /// Minimum robustness; `null` if no simulation has one.
    pub minimum_robustness: Option<Number>,
    /// The values of `scenario` in the order of `axes`.
    pub initial_configuration: Option<Vec<Option<f64>>>,
    /// Scenario of the simulation with the minimum robustness by axis; a value that is drawn at
    /// random is `null`.
    pub scenario: Option<Scenario>,
    /// Number of that simulation.
    pub simulation: Option<u32>,
    /// Random seed of that simulation.
    pub seed: Option<Seed>,
    /// `falsified`, `budget spent`, `search ended` or, with `falsify.keep-going`, `modes dried up`;
    /// `null` if the run was interrupted before.
    pub end: Option<TrialEnd>,
    /// Number of simulations that diverged.
    pub diverged: u32,
    /// Number of simulations that ended in a value that is not finite.
    pub invalid: u32,
    /// Number of simulations that could not start or failed: crash, invalid answer or time limit.
    pub failed: u32,
    /// Number of other simulations that left the formula undecided.
    pub undecided: u32,
    /// Number of undecided simulations without a finite value of the formula.
    pub undefined: u32,
    /// The first simulation that is invalid, failed or undefined; `null` without one.
    pub first_unevaluated: Option<Unevaluated>,
    /// Simulations of the counterexample with other seeds; `null` without a counterexample, without
    /// randomness, and in a campaign.
    pub repeats: Option<Repeats>,
    /// The check of the physics of the counterexample; `null` without a counterexample, in a
    /// campaign, and for a target whose physics MuJoCo C does not step.
    pub physics: Option<PhysicsCheck>,
    /// When and how that simulation violates the requirement; `null` without a counterexample.
    pub violation: Option<Violation>,
    /// The axes that cause the failure; `null` without a counterexample, in a campaign, with
    /// `falsify.keep-going`, with `falsify.isolate = false` and with a screening.
    pub cause: Option<Cause>,
}

/// When and how a simulation violates a requirement.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Violation {
    /// First sample after which nothing can satisfy the requirement; `null` if the trace does not
    /// decide it.
    pub decided: Option<Instant>,
    /// The sample at which `words` hold; `null` if they are about a whole window.
    pub at: Option<Instant>,
    /// The predicate that decides the requirement; empty without one.
    pub predicate: String,
    /// The opposite of the predicate in English, which is true instead; empty without a predicate.
    pub words: String,
}

/// A named requirement over the simulations of a run.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Requirement {
    /// Name.
    pub name: String,
    /// Formula.
    pub formula: String,
    /// Number of simulations that started; without the corners of an evaluation.
    pub started: u64,
    /// Number of these in which it has a verdict.
    pub simulations: u64,
    /// Number of these that violate it.
    pub violated: u64,
    /// Fraction of the started simulations that violate it, with its Wilson interval: those without
    /// a verdict count as failures in the upper bound only. `null` if a search chose the
    /// simulations, because then it says nothing about the space.
    pub violation_rate: Option<Estimate>,
    /// Minimum robustness; `null` without a verdict.
    pub minimum_robustness: Option<Number>,
    /// Trial of the simulation with the minimum robustness.
    pub trial: Option<u32>,
    /// Number of this simulation.
    pub simulation: Option<u32>,
    /// The simulations that ask nothing of the controller.
    pub vacuous: Vacuous,
    /// Why all of them ask nothing, so that they do not count as evidence; `null` otherwise.
    pub asks_nothing: Option<String>,
}

impl Requirement {
    /// Returns the number of violations in words.
    pub fn violated_text(&self) -> String {
        let mark = match (self.started - self.simulations, &self.asks_nothing) {
            (0, Some(_)) => ": asks nothing".to_string(),
            (0, None) => String::new(),
            (open, _) if open == self.started => return format!("no verdict in {open}"),
            (open, Some(_)) => format!(" ({open} without a verdict): asks nothing"),
            (open, None) => format!(" ({open} without a verdict)"),
        };
        format!("{} of {}{mark}", self.violated, self.started)
    }
}

/// The axes that cause the failure of a counterexample: simulations with its seed that move it
/// toward nominal. They count in no rate.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Cause {
    /// Number of these simulations.
    pub simulations: u64,
    /// The failing scenario with the fewest axes off nominal, and of these the closest to nominal.
    pub scenario: Scenario,
    /// Its robustness.
    pub robustness: Number,
    /// When and how it violates the requirement; `null` without a recorded trace.
    pub violation: Option<Violation>,
    /// Axes that have another value than the nominal one in this scenario; empty if the nominal
    /// scenario fails.
    pub axes: Vec<String>,
    /// Axes that cause a failure alone: with their value of the counterexample and all others at
    /// nominal, the simulation fails. `null` if there are too many axes to try.
    pub sufficient: Option<Vec<String>>,
    /// Axes that remove the failure alone: the counterexample with this axis at nominal does not
    /// fail. `null` if there are too many axes to try.
    pub necessary: Option<Vec<String>>,
    /// Axes that must be exactly on a bound: `scenario` does not fail if they move inside by a
    /// millionth of their width. Empty if it fails there, too, or if no axis is on a bound.
    pub only_on_bounds: Vec<String>,
    /// Failures of `scenario` with other seeds; `null` if the target is not random, or if it went
    /// back after they were simulated.
    pub other_seeds: Option<Estimate>,
    /// Whether `scenario` went back toward the counterexample, because nearer failures depend on
    /// the solver of the physics.
    pub went_back: bool,
    /// The check of the physics of `scenario`; `null` if the counterexample has none. If the
    /// counterexample depends on the solver, `scenario` does not go back.
    pub physics: Option<PhysicsCheck>,
    /// The failures on the way back whose physics was checked, in order, without the
    /// counterexample.
    pub checked: Vec<CheckedFailure>,
}

/// A simulation without a verdict.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Unevaluated {
    /// Number of the simulation in its trial, from 1.
    pub simulation: u32,
    /// Scenario by axis; a value that is drawn at random is `null`.
    pub scenario: Scenario,
    /// Random seed.
    pub seed: Seed,
    /// How the simulation ended, in words.
    pub end: String,
}

/// The part of a space that cannot fail if no predicate is steeper than its samples show.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct SmoothRegion {
    /// Largest of the estimated upper bounds (95 % together) of the change of each predicate per
    /// width of the space, at any time; `null` if refused.
    pub slope: Option<f64>,
    /// Largest slope of a predicate between adjacent samples; `null` if refused.
    pub largest_slope: Option<f64>,
    /// Number of predicates of the requirement; `null` if refused.
    pub predicates: Option<u64>,
    /// Fraction of the space in which then no scenario fails: the lower end of a 95 % interval;
    /// `null` if refused.
    pub covered: Option<f64>,
    /// Why there is no region; `null` with one.
    pub refusal: Option<String>,
}

/// The value of a search option.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(untagged)]
#[cfg_attr(feature = "schema", schemars(inline))]
pub enum SearchValue {
    /// A number.
    Float(Number),
    /// An integer.
    Integer(i64),
    /// A switch.
    Boolean(bool),
    /// A word.
    Text(String),
    /// A point of the unit cube.
    Point(Vec<f64>),
    /// Points of the unit cube.
    Points(Vec<Vec<f64>>),
}
