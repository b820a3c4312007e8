//! The plans of a check: one target with one controller, and the requirements of the file.

use std::collections::BTreeMap;
use std::path::Path;

use mishandle_falsification::PhysicsChecks;
use mishandle_requirements::{WrittenRequirement, unit_of};
use mishandle_results::Words;
use mishandle_rollout::Target;

use super::row::{StatedEpisodes, stated_episodes};
use super::{CheckCost, CheckSubject, Requirements};
use crate::error::{MishandleError, problem};
use crate::plan::{CheckSettings, EvaluatePlan, FalsifyPlan, Plan};
use crate::resolve::{ResolvedPlan, missing_signals, target};
use crate::run::cost;

/// A requirement of the file for a target.
pub(super) struct Asked<'a> {
    pub written: &'a WrittenRequirement,
    /// Its formula, with units.
    pub formula: String,
    pub space: String,
    pub missing: Vec<String>,
    /// The search for a counterexample; `None` if random scenarios decide alone.
    pub search: Option<ResolvedPlan>,
    /// The plan of a counterexample.
    pub alone: Option<ResolvedPlan>,
}

/// The check of one controller.
pub(super) struct Checker<'a> {
    pub label: String,
    pub settings: &'a CheckSettings,
    pub words: Words,
    pub folder: &'a Path,
    pub target: Target,
    pub plan: Plan,
    pub asked: Vec<Asked<'a>>,
    /// Random scenarios in each space.
    pub random: Vec<ResolvedPlan>,
}

impl<'a> Checker<'a> {
    pub(super) fn new(
        subject: &CheckSubject,
        label: String,
        requirements: &Requirements<'a>,
        settings: &'a CheckSettings,
        folder: &'a Path,
    ) -> Result<Checker<'a>, MishandleError> {
        let plan = Plan { screening: None, ..subject.plan.clone().without_questions() };
        let target = match &subject.target {
            Some(target) => target.clone(),
            None => target(&plan)?,
        };
        let first_space = target.spaces.first().map_or("", |space| space.name()).to_string();
        let default_space = if plan.space.is_empty() { first_space } else { plan.space.clone() };
        let mut asked = Vec::new();
        for written in &requirements.file.requirements {
            let formula = written.timed_formula();
            asked.push(Asked {
                missing: missing_signals(&formula, &target).map_err(|error| of(written, error))?,
                space: written.check.space.clone().unwrap_or_else(|| default_space.clone()),
                written,
                formula,
                search: None,
                alone: None,
            });
        }
        if let Some(text) = unit_problem(&requirements.file.units, &target, &asked) {
            return Err(problem(text));
        }
        let mut checker = Checker {
            label,
            settings,
            words: requirements.words,
            folder,
            target,
            plan,
            asked,
            random: Vec::new(),
        };
        checker.resolve()?;
        Ok(checker)
    }

    /// Returns the largest number of simulations of all runs.
    pub(super) fn cost(&self) -> Result<CheckCost, MishandleError> {
        let sum = |plans: &mut dyn Iterator<Item = &ResolvedPlan>| -> Result<u64, MishandleError> {
            plans.map(|resolved| Ok(cost(resolved)?.simulations)).sum()
        };
        let mut of_violation = 0;
        for alone in self.asked.iter().filter_map(|asked| asked.alone.as_ref()) {
            let is_checked = alone.physics_checks()?.are_possible();
            of_violation = of_violation.max(1 + if is_checked { PhysicsChecks::most(1) } else { 0 });
        }
        Ok(CheckCost {
            random: sum(&mut self.random.iter())?,
            searched: sum(&mut self.asked.iter().filter_map(|asked| asked.search.as_ref()))?,
            of_violation,
        })
    }

    /// Returns the numbers of random scenarios that the file states in the space of a requirement.
    pub(super) fn stated(&self, asked: &Asked<'_>) -> StatedEpisodes {
        let same_space = self.applicable().filter(|other| other.space == asked.space);
        StatedEpisodes::new(asked.written, same_space.map(|other| other.written))
    }

    /// Looks up and checks the plans of all runs.
    fn resolve(&mut self) -> Result<(), MishandleError> {
        // The plans of one requirement are the first ones, so that an error names it.
        let mut plans = Vec::new();
        for asked in &self.asked {
            plans.push(if asked.missing.is_empty() {
                Some(self.alone(asked).map_err(|error| of(asked.written, error))?)
            } else {
                None
            });
        }
        for (asked, alone) in self.asked.iter_mut().zip(plans) {
            asked.alone = alone;
        }
        let mut spaces: Vec<&str> = Vec::new();
        for asked in self.applicable() {
            if !spaces.contains(&asked.space.as_str()) {
                spaces.push(&asked.space);
            }
        }
        let mut random = Vec::new();
        for space in spaces {
            let asked = self.applicable().filter(|asked| asked.space == space);
            // The simulations are shared, so that all requirements have the most of them.
            let episodes = asked.map(|asked| self.episodes(asked)).max().unwrap_or_default();
            random.push(self.resolved(&self.random_plan(episodes, self.in_space(space)))?);
        }
        let mut searches = Vec::new();
        for asked in &self.asked {
            let has_search = asked.missing.is_empty() && asked.written.check.max_failure_rate.is_none();
            let plan = has_search.then(|| self.search_plan(asked));
            searches.push(plan.map(|plan| self.resolved(&plan)).transpose()?);
        }
        for (asked, search) in self.asked.iter_mut().zip(searches) {
            asked.search = search;
        }
        self.random = random;
        Ok(())
    }

    /// Returns the number of random scenarios of a requirement.
    fn episodes(&self, asked: &Asked<'_>) -> u64 {
        self.settings.episodes.unwrap_or_else(|| stated_episodes(asked.written))
    }

    /// Returns the plan of random scenarios.
    fn random_plan(&self, episodes: u64, plan: Plan) -> Plan {
        let evaluate = EvaluatePlan {
            episodes,
            // Corners are not a random sample, so no rate counts them.
            corners: false,
            batch: self.settings.batch,
            ..EvaluatePlan::default()
        };
        Plan { evaluate: Some(evaluate), ..plan }
    }

    /// Returns the plan of a counterexample of a requirement, which has no other one.
    fn alone(&self, asked: &Asked<'_>) -> Result<ResolvedPlan, MishandleError> {
        let plan = Plan { requirements: Default::default(), ..self.search_plan(asked) };
        self.resolved(&self.random_plan(self.episodes(asked), Plan { falsify: None, ..plan.clone() }))?;
        self.resolved(&plan)
    }

    /// Returns the plan of the search for a counterexample of a requirement.
    fn search_plan(&self, asked: &Asked<'_>) -> Plan {
        let check = &asked.written.check;
        let settings = self.settings;
        let falsify = FalsifyPlan {
            formula: Some(asked.formula.clone()),
            search: settings.search.clone(),
            trials: settings.trials.or(check.trials).unwrap_or(1),
            budget: settings.budget.or(check.budget).unwrap_or(FalsifyPlan::default().budget),
            batch: settings.batch,
            ..FalsifyPlan::default()
        };
        Plan { falsify: Some(falsify), ..self.in_space(&asked.space) }
    }

    fn applicable(&self) -> impl Iterator<Item = &Asked<'a>> {
        self.asked.iter().filter(|asked| asked.missing.is_empty())
    }

    /// Returns the plan with all requirements of a space, which share their simulations.
    fn in_space(&self, space: &str) -> Plan {
        let named = self.applicable().filter(|asked| asked.space == space);
        let requirements = named.map(|asked| (asked.written.name.clone(), asked.formula.clone()));
        Plan { space: space.to_string(), requirements: requirements.collect(), ..self.plan.clone() }
    }

    fn resolved(&self, plan: &Plan) -> Result<ResolvedPlan, MishandleError> {
        ResolvedPlan::with_target(plan, self.target.clone())
    }
}

/// Returns what is wrong with the units of a file for a target. A signal that the target lacks may
/// have one if a requirement reads it.
fn unit_problem(units: &BTreeMap<String, String>, target: &Target, asked: &[Asked<'_>]) -> Option<String> {
    units.keys().find_map(|name| {
        let Some(signal) = target.all_signals().find(|signal| signal.name == *name) else {
            let is_missing = asked.iter().any(|asked| asked.missing.contains(name));
            return (!is_missing).then(|| {
                format!("[units] names `{name}`, which is no signal of the target and in no formula")
            });
        };
        let stated = unit_of(name, units).unwrap_or_default();
        let own = BTreeMap::from([(name.clone(), signal.unit.clone())]);
        let known = unit_of(name, &own).unwrap_or_default();
        let differs = !signal.unit.is_empty() && stated != known;
        differs.then(|| {
            format!("[units] says that `{name}` is in `{stated}`, but the target gives it in `{known}`")
        })
    })
}

/// Names the requirement of an error.
fn of(written: &WrittenRequirement, source: MishandleError) -> MishandleError {
    source.of(format!("requirement `{}`", written.name))
}
