//! Compares the header of a run with the header that its plan gives now.

use std::fmt::Debug;

use mishandle_store::{AxisRecord, RunFile, RunHeader};

use crate::error::{Compared, MishandleError};
use crate::plan::{FalsifyPlan, Plan};
use crate::resolve::ResolvedPlan;
use crate::run::builds::check_build;
use crate::run::header;

/// Checks that a plan may add rows to a run: the run has the header of the plan, and the present
/// build is one of its builds.
///
/// # Errors
/// The errors of [`check`], or a difference of the [build](Compared::Build).
pub(crate) fn check_run(run: &RunFile, resolved: &ResolvedPlan) -> Result<(), MishandleError> {
    check(run.header(), resolved)?;
    check_build(run, resolved)
}

/// Checks that a run to resume has the header of its plan.
///
/// # Errors
/// All differences of the [plan](Compared::Plan), or the differences of the
/// [settings](Compared::Settings) on which the proposed scenarios depend.
pub(crate) fn check(recorded: &RunHeader, resolved: &ResolvedPlan) -> Result<(), MishandleError> {
    let settings = settings(&Plan::from_toml(&recorded.plan)?, &resolved.plan);
    if !settings.is_empty() {
        return Err(MishandleError::differs(Compared::Settings, settings));
    }
    match differences(recorded, resolved)? {
        differences if differences.is_empty() => Ok(()),
        differences => Err(MishandleError::differs(Compared::Plan, differences)),
    }
}

/// Lists the settings that differ between the plan of a run and the plan to continue it with.
/// Results do not depend on the batch size.
fn settings(recorded: &Plan, given: &Plan) -> Vec<String> {
    let mut found = Found { planned: "given", ..Found::default() };
    found.compare("seed", &recorded.seed, &given.seed);
    // No simulation depends on it, but the conclusion of a finished run does.
    found.compare("max-without-verdict", &recorded.max_without_verdict, &given.max_without_verdict);
    if let (Some(then), Some(now)) = (&recorded.falsify, &given.falsify) {
        found.compare("search", &then.search, &now.search);
        found.compare("trials", &then.trials, &now.trials);
        found.compare("budget", &then.budget, &now.budget);
        found.compare("keep-going", &then.keep_going, &now.keep_going);
        found.compare("new-mode-rate", &then.new_mode_rate, &now.new_mode_rate);
        found.compare("early-stopping", &then.early_stopping, &now.early_stopping);
        found.compare("fixed-seed", &then.fixed_seed, &now.fixed_seed);
        found.compare("isolate", &then.isolate, &now.isolate);
        let options = |plan: &FalsifyPlan| {
            if plan.options.is_empty() {
                "none".to_string()
            } else {
                plan.options
                    .iter()
                    .map(|(name, value)| format!("{name} = {value}"))
                    .collect::<Vec<_>>()
                    .join(", ")
            }
        };
        found.texts("options of the search", &options(then), &options(now));
    }
    if let (Some(then), Some(now)) = (&recorded.evaluate, &given.evaluate) {
        found.compare("episodes", &then.episodes, &now.episodes);
        found.compare("corners", &then.corners, &now.corners);
        found.compare("control", &then.control, &now.control);
        found.compare("until", &then.until, &now.until);
        found.compare("rate", &then.rate, &now.rate);
        if then.until.is_some() {
            found.compare("batch", &then.batch, &now.batch);
        }
    }
    if let (Some(then), Some(now)) = (&recorded.margin, &given.margin) {
        found.compare("budget", &then.budget, &now.budget);
        found.compare("each-category", &then.each_category, &now.each_category);
    }
    if let (Some(then), Some(now)) = (&recorded.metamorphic, &given.metamorphic) {
        found.compare("pairs", &then.pairs, &now.pairs);
        found.compare("relations", &then.relations, &now.relations);
    }
    if let (Some(then), Some(now)) = (&recorded.risk, &given.risk) {
        found.compare("simulations", &then.simulations, &now.simulations);
        found.compare("method", &then.method, &now.method);
        found.compare("distributions", &then.distributions, &now.distributions);
    }
    found.compare("compare", &recorded.compare, &given.compare);
    found.compare("screening", &recorded.screening, &given.screening);
    found.differences
}

/// Lists the facts of the header that differ from the plan's, except for the build.
///
/// # Errors
/// If the plan of the header is invalid.
pub(crate) fn differences(
    recorded: &RunHeader,
    resolved: &ResolvedPlan,
) -> Result<Vec<String>, MishandleError> {
    let planned = &header::header(resolved);
    let mut found = Found::default();
    found.compare("kind of run", &recorded.kind, &planned.kind);
    found.compare("kind of target", &recorded.target.kind, &planned.target.kind);
    found.compare("target", &recorded.target.name, &planned.target.name);
    found.compare("hash of the target", &recorded.target.hash, &planned.target.hash);
    let is_deterministic = |header: &RunHeader| header.target.is_deterministic;
    found.compare("determinism", &is_deterministic(recorded), &is_deterministic(planned));
    found.compare("space", &recorded.space, &planned.space);
    found.compare("formula", &recorded.formula, &planned.formula);
    found.compare("search", &recorded.search, &planned.search);
    found.compare("seed", &recorded.seed, &planned.seed);
    found.compare("control period in seconds", &recorded.control_dt, &planned.control_dt);
    found.compare("number of control steps", &recorded.episode_steps, &planned.episode_steps);
    for (what, entries) in LISTS {
        found.list(what, &entries(recorded), &entries(planned));
    }
    found.compare("number of components", &recorded.components.len(), &planned.components.len());
    // A file that was moved can have another name.
    let then = Plan::from_toml(&recorded.plan)?;
    let fallback = |plan: &Plan| plan.guard.as_ref().map(|guard| guard.fallback.clone());
    let paths = |plan: &Plan| (plan.controller.clone(), plan.target.clone(), fallback(plan));
    let is_moved = paths(&then) != paths(&resolved.plan);
    for (then, now) in recorded.components.iter().zip(&planned.components) {
        found.compare("role of a component", &then.role, &now.role);
        found.compare(&format!("hash of the file of the {}", now.role), &then.file_hash, &now.file_hash);
        if !is_moved {
            found.compare(&format!("name of the {}", now.role), &then.name, &now.name);
        }
    }
    Ok(found.differences)
}

/// A list of the header as text, by the name of an entry.
type List = (&'static str, fn(&RunHeader) -> Vec<String>);

const LISTS: &[List] = &[
    ("signal", |header| header.signals.iter().map(|signal| signal.name.clone()).collect()),
    ("unit of signal", |header| header.signals.iter().map(|signal| signal.unit.clone()).collect()),
    ("named formula", |header| {
        header.formulas.iter().map(|formula| format!("{}: {}", formula.name, formula.text)).collect()
    }),
    ("axis", axes),
    ("verdict", |header| header.verdicts.clone()),
];

/// Returns all facts of each axis. Floats have all their digits.
fn axes(header: &RunHeader) -> Vec<String> {
    let axis = |AxisRecord { name, unit, kind, low, high, nominal, values, meaning }: &AxisRecord| {
        let nominal = nominal.map_or_else(|| "none".to_string(), |nominal| format!("{nominal:?}"));
        format!(
            "{name} in {unit:?}, {kind}, {values}, from {low:?} to {high:?}, nominal {nominal}: {meaning}"
        )
    };
    header.axes.iter().map(axis).collect()
}

struct Found {
    differences: Vec<String>,
    /// Name of the second value of a difference.
    planned: &'static str,
}

impl Default for Found {
    fn default() -> Self {
        Found { differences: Vec::new(), planned: "expected" }
    }
}

impl Found {
    fn compare<T: Debug>(&mut self, what: &str, recorded: &T, planned: &T) {
        // The text has all digits and the sign of a zero.
        self.texts(what, &format!("{recorded:?}"), &format!("{planned:?}"));
    }

    fn texts(&mut self, what: &str, recorded: &str, planned: &str) {
        if recorded != planned {
            self.differences.push(format!("{what}: recorded {recorded}, {} {planned}", self.planned));
        }
    }

    fn list(&mut self, what: &str, recorded: &[String], planned: &[String]) {
        self.compare(&format!("number of entries of the list `{what}`"), &recorded.len(), &planned.len());
        for (index, (recorded, planned)) in recorded.iter().zip(planned).enumerate() {
            self.compare(&format!("{what} {}", index + 1), recorded, planned);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each of these keys decides which simulations a search proposes, or what is kept of them.
    #[test]
    fn a_run_continues_with_its_own_settings_of_the_search_only() {
        let plan =
            |line: &str| Plan::from_toml(&format!("target = \"toy/sphere-2d\"\n[falsify]\n{line}")).unwrap();
        for line in [
            "trials = 4",
            "budget = 7",
            "search = \"random\"",
            "keep-going = true",
            "new-mode-rate = 0.5",
            "early-stopping = true",
            "fixed-seed = 3",
            "isolate = true",
        ] {
            let given = plan(line);
            let name = line.split(' ').next().unwrap();
            let found = settings(&plan(""), &given);
            assert!(found.len() == 1 && found[0].starts_with(name), "{line}: {found:?}");
        }
        assert!(settings(&plan("batch = 3"), &plan("batch = 4")).is_empty());
    }

    #[test]
    fn a_finished_run_concludes_with_its_own_share_without_a_verdict_only() {
        let [recorded, given] =
            [0.05, 0.5].map(|share| Plan { max_without_verdict: share, ..Plan::new("toy/sphere-2d", "") });
        assert_eq!(settings(&recorded, &given), ["max-without-verdict: recorded 0.05, given 0.5"]);
    }
}
