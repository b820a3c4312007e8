//! Guards and data: the threshold of a guard is chosen on training scenarios, and what the guard is
//! worth is measured on held-out ones.
//!
//! A guard that only watches is evaluated first. The curve of missed failures and false alarms over
//! all thresholds follows from these simulations, since the robustness until the first alarm does
//! not depend on the threshold. Three evaluations on held-out scenarios follow, which decide
//! nothing: the controller alone, the guarded controller, and the fallback alone. Each is a run
//! file of a folder, so that a tuning continues where it stopped.

mod alarm;
mod result;
mod threshold;

use std::fs;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use alarm::{Requirement, WatchedRun};
use mishandle_evaluation::count_end;
use mishandle_files::write_atomically;
use mishandle_results::{Choice, EndCounts, GuardTuning, Key, Remedy};
use mishandle_rollout::Seed;
use mishandle_store::{RANDOM_TRIAL, RunFile};

use crate::error::{MishandleError, invalid, problem};
use crate::plan::{EvaluatePlan, GuardPlan, Plan, TuneSettings};
use crate::resolve::ResolvedPlan;
use crate::run::{Engine, Probed, Progress, ask, continue_run, of_folder, rows};
pub use threshold::Least;

/// Indices of the child seeds of the training and of the held-out scenarios.
const TRAINING: u64 = 5 << 32;
const HELD_OUT: u64 = 6 << 32;

/// Names of the requirements in the runs: the formula of the guard over all actions, and the
/// formula that decides what a failure is, if it is not that of the target.
const GUARD: &str = "guard";
const REQUIREMENT: &str = "requirement";

/// The least robustness of the guard's formula. Sample 0 comes before the first action.
const LEAST: &str = "always[1:inf](guard_robustness >= 0)";

/// Fewest failures, and fewest successes, on which a threshold can rest.
const FEWEST: usize = 10;

/// Run files in the folder of a tuning.
const RUNS: [&str; 4] = ["training.sqlite", "controller.sqlite", "guarded.sqlite", "fallback.sqlite"];

/// The guard with the chosen threshold.
const CHOSEN: &str = "guard.toml";

/// Progress of a tuning.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TuneProgress {
    /// The evaluation that runs.
    pub phase: &'static str,
    /// Number of its finished simulations.
    pub done: u64,
    /// Number of all its simulations.
    pub all: u64,
}

/// Gets the progress now and then, and can end the tuning, which a later call continues.
pub type Watch<'w> = &'w mut (dyn FnMut(&TuneProgress) -> ControlFlow<()> + Send);

/// Chooses the threshold of the plan's guard, and measures the guard on held-out scenarios. All
/// runs, and the guard with its threshold, are in `folder`; a second call with the same arguments
/// continues it. Returns `None` if it was interrupted.
///
/// # Errors
/// If the plan is wrong or has no guard, the folder has runs of another plan, too few training
/// scenarios fail or succeed, or a simulation cannot be run or stored.
pub fn tune(
    plan: &Plan,
    settings: &TuneSettings,
    folder: &Path,
    watch: Watch<'_>,
) -> Result<Option<GuardTuning>, MishandleError> {
    let tuner = Tuner::new(plan, settings, folder)?;
    let watching = GuardPlan { threshold: f64::NEG_INFINITY, return_threshold: None, ..tuner.guard.clone() };
    let Some(training) = tuner.ask(Phase::Training, &watching, watch)? else { return Ok(None) };
    let trained = training.watched()?;
    let least = Least::of(&trained.simulations);
    check_counts(&least, settings.episodes)?;
    let point = least.choose(settings.false_alarms);
    let chosen = tuner.with_threshold(point.threshold.0);
    let path = folder.join(CHOSEN);
    write_atomically(&path, chosen.to_toml().as_bytes()).map_err(|source| MishandleError::Write {
        what: "file",
        path,
        source,
    })?;
    let always = GuardPlan { threshold: f64::INFINITY, ..watching.clone() };
    let Some(alone) = tuner.ask(Phase::Controller, &watching, watch)? else { return Ok(None) };
    let Some(guarded) = tuner.ask(Phase::Guarded, &chosen, watch)? else { return Ok(None) };
    let Some(fallback) = tuner.ask(Phase::Fallback, &always, watch)? else { return Ok(None) };
    let held_out = result::HeldOut { alone, guarded, fallback };
    Ok(Some(result::tuning(settings, folder, &chosen, &training, &trained, &least, &held_out)?))
}

/// Checks that there is something to choose from.
fn check_counts(least: &Least, scenarios: u64) -> Result<(), MishandleError> {
    let failures = least.failures.len();
    let successes = least.successes.len();
    if failures.min(successes) < FEWEST {
        let (few, kind, more) =
            if failures < successes { (failures, "fail", "more") } else { (successes, "succeed", "less") };
        Err(problem(format!(
            "{few} of {scenarios} training scenarios {kind}, and a threshold rests on at least {FEWEST}: use more episodes, or a \
             space in which the controller fails {more} often"
        )))
    } else {
        Ok(())
    }
}

/// The evaluations of a tuning.
#[derive(Clone, Copy)]
enum Phase {
    Training,
    Controller,
    Guarded,
    Fallback,
}

impl Phase {
    fn name(self) -> &'static str {
        match self {
            Phase::Training => "training scenarios",
            Phase::Controller => "held-out scenarios: controller",
            Phase::Guarded => "held-out scenarios: guarded",
            Phase::Fallback => "held-out scenarios: fallback",
        }
    }
}

/// A checked tuning.
struct Tuner<'p> {
    plan: &'p Plan,
    guard: &'p GuardPlan,
    settings: &'p TuneSettings,
    folder: &'p Path,
}

impl<'p> Tuner<'p> {
    fn new(
        plan: &'p Plan,
        settings: &'p TuneSettings,
        folder: &'p Path,
    ) -> Result<Tuner<'p>, MishandleError> {
        let missing = || problem("there is no guard to tune").with(Remedy::set(Key::GUARD, Choice::FILE));
        let guard = plan.guard.as_ref().ok_or_else(missing)?;
        if !(0.0..1.0).contains(&settings.false_alarms) {
            return Err(invalid("the share of false alarms", settings.false_alarms, "from 0 to less than 1"));
        }
        if let Some(name) = [GUARD, REQUIREMENT].iter().find(|name| plan.requirements.contains_key(**name)) {
            return Err(invalid(
                "the name of a requirement",
                name,
                "another name: the runs of a tuning use it",
            ));
        }
        let has_distance = guard.threshold.is_finite() && guard.return_threshold.is_none_or(f64::is_finite);
        if guard.return_threshold.is_some() && !has_distance {
            let expected = "a number beside `return-threshold`: the tuning keeps the distance of both";
            return Err(problem(format!("the guard has no `threshold`; expected {expected}")));
        }
        Ok(Tuner { plan, guard, settings, folder })
    }

    /// Returns the guard with another threshold. The distance to the way back stays.
    fn with_threshold(&self, threshold: f64) -> GuardPlan {
        let back = self.guard.return_threshold.map(|back| back - self.guard.threshold);
        // A guard that never hands over has no way back either.
        let return_threshold = back
            .filter(|_| threshold.is_finite())
            .map(|distance| threshold::short(threshold + distance).max(threshold));
        GuardPlan { threshold, return_threshold, ..self.guard.clone() }
    }

    /// Returns the plan of a phase.
    fn plan(&self, phase: Phase, guard: &GuardPlan) -> Plan {
        let seed = Seed(self.plan.seed);
        let (seed, episodes) = match phase {
            Phase::Training => (seed.child(TRAINING), self.settings.episodes),
            _ => (seed.child(HELD_OUT), self.settings.held_out),
        };
        let evaluate = self.plan.evaluate.clone().unwrap_or_default();
        let mut plan = Plan {
            seed: seed.0,
            guard: Some(guard.clone()),
            // Corners are not a random sample, so no rate counts them.
            evaluate: Some(EvaluatePlan {
                episodes,
                corners: false,
                control: false,
                until: None,
                rate: None,
                ..evaluate
            }),
            screening: None,
            ..self.plan.clone().without_questions()
        };
        plan.requirements.insert(GUARD.to_string(), LEAST.to_string());
        if let Some(formula) = &self.settings.formula {
            plan.requirements.insert(REQUIREMENT.to_string(), formula.clone());
        }
        plan
    }

    /// Runs a phase, or continues it. Returns `None` if it was interrupted.
    fn ask(
        &self,
        phase: Phase,
        guard: &GuardPlan,
        watch: Watch<'_>,
    ) -> Result<Option<Asked>, MishandleError> {
        let resolved = ResolvedPlan::new(&self.plan(phase, guard))?;
        fs::create_dir_all(self.folder).map_err(MishandleError::write("folder", self.folder))?;
        let path = self.folder.join(RUNS[phase as usize]);
        let run = continue_run(&resolved, &path, Probed::Requirement)?;
        let mut watch = |progress: &Progress| {
            let Progress { simulations: done, max_simulations: all, .. } = *progress;
            watch(&TuneProgress { phase: phase.name(), done, all })
        };
        let answer = ask(&resolved, run, Engine::Direct, &mut watch).map_err(of_folder)?;
        let requirement = requirement(&resolved);
        Ok(answer.is_complete().then_some(Asked { resolved, requirement, path }))
    }
}

/// A finished evaluation of a tuning.
struct Asked {
    resolved: ResolvedPlan,
    requirement: Requirement,
    path: PathBuf,
}

impl Asked {
    fn run(&self) -> Result<RunFile, MishandleError> {
        Ok(RunFile::open(&self.path)?)
    }

    /// Returns how its simulations ended: the requirement of the tuning decides.
    fn ends(&self) -> Result<EndCounts, MishandleError> {
        let mut ends = EndCounts::default();
        for row in self.run()?.trial_simulations(RANDOM_TRIAL) {
            let episode = rows::episode(&row?, &self.resolved)?;
            count_end(&mut ends, episode.end, self.requirement.is_violated(&episode).is_some(), 1);
        }
        Ok(ends)
    }

    fn watched(&self) -> Result<WatchedRun, MishandleError> {
        WatchedRun::read(&self.run()?, &self.resolved, &self.requirement)
    }
}

/// Returns what counts as a failure in the runs of a plan.
fn requirement(resolved: &ResolvedPlan) -> Requirement {
    let others = &resolved.specification.others;
    let place = |name: &str| others.iter().position(|(other, _)| other == name);
    let named = place(REQUIREMENT);
    let formula = match named {
        Some(index) => others[index].1.clone(),
        None => resolved.specification.requirement.clone(),
    };
    Requirement { formula, named, guard: place(GUARD).unwrap_or(others.len()) }
}
