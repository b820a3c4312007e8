use mishandle_rollout::DEFAULT_BATCH_SIZE;
use mishandle_search::SearchOptions;
use serde::{Deserialize, Serialize};

use crate::MishandleError;

/// Version of the plan format.
const FORMAT: u32 = 2;

/// What to do, as a value: read from TOML, edited by flags, stored with the results.
///
/// Nothing in it is looked up yet: names are checked when it becomes a [`ResolvedPlan`](crate::ResolvedPlan) plan.
///
/// # Example
/// ```
/// use mishandle::Plan;
/// let plan = Plan::new("ball-balancing", "ppo");
/// assert_eq!(Plan::from_toml(&plan.to_toml()).unwrap(), plan);
/// assert!(Plan::from_toml("tusk = 1").is_err());
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct Plan {
    /// Version of the format.
    #[serde(default = "format")]
    pub format: u32,
    /// Name of the target, a task or `toy/NAME`; a plan that leaves it out needs it from a flag. Plans of format 1 call
    /// it `task`.
    #[serde(default, alias = "task")]
    pub target: String,
    /// Name of the scenario space, or several joined by `+`.
    #[serde(default = "starts")]
    pub space: String,
    /// The task preset, which reading of the original benchmark counts: `paper` or `code`.
    #[serde(default = "paper")]
    pub preset: String,
    /// Of a task, a shipped controller's name, or a path; a plan that leaves it out needs it from a flag.
    #[serde(default)]
    pub controller: String,
    /// Sample the policy's actions instead of taking their mean.
    #[serde(default)]
    pub stochastic: bool,
    /// Standard deviation of the noise on each action, in units of the normalised action.
    #[serde(default)]
    pub action_noise: f64,
    /// Standard deviation of the noise on each observation.
    #[serde(default)]
    pub observation_noise: f64,
    /// Seed of everything random. Above 2⁶³ - 1, where TOML's integers end, it is written as a text.
    #[serde(default, with = "seed")]
    pub seed: u64,
    /// What an evaluation does.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub evaluate: Option<EvaluatePlan>,
    /// What a falsification does.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub falsify: Option<FalsifyPlan>,
}

/// Which initial configurations are drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StartRegion {
    /// The whole box.
    #[default]
    Whole,
    /// The part of it from which the task can be done at all.
    Reachable,
}

/// What an evaluation does.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct EvaluatePlan {
    /// Number of simulations.
    pub episodes: u64,
    /// Where they start: `box = "whole"` or `"reachable"`. Older plans call it `starts`.
    #[serde(rename = "box", alias = "starts")]
    pub starts: StartRegion,
    /// Simulations that are run at once.
    pub batch: u32,
}

impl Default for EvaluatePlan {
    fn default() -> Self {
        EvaluatePlan { episodes: 100, starts: StartRegion::Whole, batch: DEFAULT_BATCH_SIZE as u32 }
    }
}

/// What a falsification does.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct FalsifyPlan {
    /// The requirement to violate: the name of one of the target's formulas, or the text of a formula. Without it, the
    /// target's first: of a task, `success`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub formula: Option<String>,
    /// Name of the search.
    pub search: String,
    /// Number of trials.
    pub trials: u32,
    /// Simulations a trial may spend.
    pub budget: u32,
    /// Simulations that are run at once.
    pub batch: u32,
    /// Alias of the option `initial-simplex` of `nelder-mead`, from before searches had options. Other searches
    /// ignore it, and `options` overrides it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub initial_simplex: Option<Vec<Vec<f64>>>,
    /// Options of the search by name, the table `[falsify.options]`. `mishandle searches SEARCH` lists them.
    #[serde(with = "crate::search_options", skip_serializing_if = "SearchOptions::is_empty")]
    pub options: SearchOptions,
}

impl Default for FalsifyPlan {
    fn default() -> Self {
        FalsifyPlan {
            formula: None,
            search: "random".to_string(),
            trials: 30,
            budget: 300,
            batch: DEFAULT_BATCH_SIZE as u32,
            initial_simplex: None,
            options: SearchOptions::new(),
        }
    }
}

fn format() -> u32 {
    FORMAT
}

/// A seed as TOML spells it.
mod seed {
    use serde::{Deserialize, Deserializer, Serializer};

    #[derive(Deserialize)]
    #[serde(
        untagged,
        expecting = "expected a seed: a whole number from 0 to 18446744073709551615, or its text"
    )]
    enum Spelled {
        Number(u64),
        Text(String),
    }

    pub fn serialize<S: Serializer>(seed: &u64, serializer: S) -> Result<S::Ok, S::Error> {
        match i64::try_from(*seed) {
            Ok(number) => serializer.serialize_i64(number),
            Err(_) => serializer.serialize_str(&seed.to_string()),
        }
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u64, D::Error> {
        match Spelled::deserialize(deserializer)? {
            Spelled::Number(seed) => Ok(seed),
            Spelled::Text(text) => text.parse().map_err(serde::de::Error::custom),
        }
    }
}

fn starts() -> String {
    "starts".to_string()
}

fn paper() -> String {
    "paper".to_string()
}

impl Plan {
    /// A plan for a controller in a task, or for another target and an empty controller, with everything else at its
    /// default.
    pub fn new(target: &str, controller: &str) -> Plan {
        Plan {
            format: FORMAT,
            target: target.to_string(),
            space: starts(),
            preset: paper(),
            controller: controller.to_string(),
            stochastic: false,
            action_noise: 0.0,
            observation_noise: 0.0,
            seed: 0,
            evaluate: None,
            falsify: None,
        }
    }

    /// Reads a plan.
    ///
    /// # Errors
    /// If the text is not TOML, has a key that is none of a plan's, or is of a newer format.
    pub fn from_toml(text: &str) -> Result<Plan, MishandleError> {
        let unreadable = |error: toml::de::Error| MishandleError::Plan(error.to_string());
        // A newer format may have keys that are unknown here: the format is the more useful thing to report.
        let Format { format } = toml::from_str(text).map_err(unreadable)?;
        match format {
            Some(0) => {
                let wanted = "1 or more";
                return Err(MishandleError::Value {
                    what: "the plan's format",
                    value: "0".to_string(),
                    wanted,
                });
            }
            Some(found) if found > FORMAT => return Err(MishandleError::NewerPlan { found, known: FORMAT }),
            _ => {}
        }
        let mut plan: Plan = toml::from_str(text).map_err(unreadable)?;
        // What an older format calls otherwise has its present name now.
        plan.format = FORMAT;
        Ok(plan)
    }

    /// The plan as TOML.
    pub fn to_toml(&self) -> String {
        // Strings, numbers and booleans in tables: TOML has a form for each.
        toml::to_string(self).unwrap_or_default()
    }
}

/// What every format of a plan states.
#[derive(Deserialize)]
struct Format {
    format: Option<u32>,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The example of docs/plans.md.
    fn documented() -> &'static str {
        let page = include_str!("../docs/plans.md");
        page.split("```toml\n").nth(1).and_then(|rest| rest.split("```").next()).unwrap()
    }

    #[test]
    fn the_documented_plan_names_every_key_and_every_default() {
        let plan = Plan::from_toml(documented()).unwrap();
        // Without a formula the target's first counts, which is `success` for a task.
        let falsify = FalsifyPlan { formula: Some("success".to_string()), ..FalsifyPlan::default() };
        let evaluate = EvaluatePlan::default();
        let defaults = Plan { evaluate: Some(evaluate), falsify: Some(falsify), ..plan.clone() };
        let named = Plan { target: plan.target.clone(), controller: plan.controller.clone(), ..defaults };
        assert_eq!(plan, named);
        assert_eq!(
            Plan { evaluate: None, falsify: None, ..plan.clone() },
            Plan::new("ball-balancing", "ppo")
        );
        // Whatever a plan can hold is written out by `to_toml`, and stands in the example.
        let is_key = |line: &&str| line.contains(" = ");
        let keys = |text: &str| -> Vec<String> {
            text.lines().filter(is_key).map(|line| line.split(' ').next().unwrap().to_string()).collect()
        };
        let (mut written, mut shown) = (keys(&plan.to_toml()), keys(documented()));
        written.sort();
        shown.sort();
        assert_eq!(written, shown);
    }

    fn options_of(falsify: &str) -> Result<FalsifyPlan, MishandleError> {
        let plan = format!("task = \"a\"\ncontroller = \"b\"\n[falsify]\n{falsify}");
        Plan::from_toml(&plan).map(|plan| plan.falsify.unwrap())
    }

    #[test]
    fn options_of_a_search_are_a_table_that_reads_back_as_itself() {
        let text = "search = \"nelder-mead\"\n[falsify.options]\nxatol = 1\nmax_iterations = 9\nadaptive = true\n\
                    start = [0.5, 1]\ninitial-simplex = [[0, 1], [0.5, 1]]\nmodel = \"cubic\"\n";
        let falsify = options_of(text).unwrap();
        let expected = SearchOptions::new()
            .with("xatol", 1)
            .with("max-iterations", 9)
            .with("adaptive", true)
            .with("start", vec![0.5, 1.0])
            .with("initial-simplex", vec![vec![0.0, 1.0], vec![0.5, 1.0]])
            .with("model", "cubic");
        assert_eq!(falsify.options, expected);
        let plan = Plan { falsify: Some(falsify), ..Plan::new("a", "b") };
        assert_eq!(Plan::from_toml(&plan.to_toml()).unwrap(), plan);
    }

    #[test]
    fn an_option_that_is_no_value_or_set_twice_is_refused() {
        let refused = |text: &str| options_of(text).unwrap_err().to_string();
        assert!(
            refused("[falsify.options]\nxatol = 1979-05-27\n").contains("expected a number, true or false")
        );
        let twice = refused("[falsify.options]\nmax-iterations = 1\nmax_iterations = 2\n");
        assert!(twice.contains("`max_iterations` is set twice"), "{twice}");
    }

    #[test]
    fn a_plan_of_the_first_format_is_read_and_written_in_the_present_one() {
        let old =
            "format = 1\ntask = \"ball-balancing\"\ncontroller = \"ppo\"\n[falsify]\nformula = \"success\"\n";
        let plan = Plan::from_toml(old).unwrap();
        assert_eq!((plan.format, plan.target.as_str()), (FORMAT, "ball-balancing"));
        assert_eq!(plan.falsify.as_ref().unwrap().formula.as_deref(), Some("success"));
        assert_eq!(Plan::from_toml(&plan.to_toml()).unwrap(), plan);
    }

    #[test]
    fn a_plan_of_another_format_is_refused_by_its_format() {
        let refused = |format: u32| {
            let plan = format!("format = {format}\ntarget = \"a\"\nnew_key = 1\n");
            Plan::from_toml(&plan).unwrap_err().to_string()
        };
        assert!(matches!(
            Plan::from_toml("format = 99\nnew_key = 1\n"),
            Err(MishandleError::NewerPlan { found: 99, .. })
        ));
        assert!(refused(0).contains("format is 0"), "{}", refused(0));
        assert!(refused(FORMAT).contains("new_key"), "{}", refused(FORMAT));
    }

    #[test]
    fn every_seed_comes_back() {
        for seed in [0, i64::MAX as u64, 1 << 63, u64::MAX] {
            let plan = Plan { seed, ..Plan::new("a", "b") };
            assert_eq!(Plan::from_toml(&plan.to_toml()).unwrap().seed, seed);
        }
    }

    #[test]
    fn what_an_older_plan_calls_starts_is_read() {
        let plan = |key| format!("task = \"a\"\ncontroller = \"b\"\n[evaluate]\n{key} = \"reachable\"\n");
        assert_eq!(Plan::from_toml(&plan("starts")).unwrap(), Plan::from_toml(&plan("box")).unwrap());
    }
}
