use serde::{Deserialize, Serialize};

use crate::MishandleError;

/// Version of the plan format.
const FORMAT: u32 = 1;

/// What to do, as a value: read from TOML, edited by flags, stored with the results.
///
/// Nothing in it is looked up yet: names are checked when it becomes a [`Subject`](crate::Subject).
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
    /// Name of the task; a plan that leaves it out needs it from a flag.
    #[serde(default)]
    pub task: String,
    /// The task preset, which reading of the original benchmark counts: `paper` or `code`.
    #[serde(default = "paper")]
    pub preset: String,
    /// A shipped controller's name, or a path; a plan that leaves it out needs it from a flag.
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
    /// Seed of everything random.
    #[serde(default)]
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
pub enum Starts {
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
    pub starts: Starts,
}

impl Default for EvaluatePlan {
    fn default() -> Self {
        EvaluatePlan { episodes: 100, starts: Starts::Whole }
    }
}

/// What a falsification does.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct FalsifyPlan {
    /// What is to be violated: `success`, `strict`, or the text of a formula.
    pub formula: String,
    /// Name of the search.
    pub search: String,
    /// Number of trials.
    pub trials: u32,
    /// Simulations a trial may spend.
    pub budget: u32,
    /// First simplex of `nelder-mead`, d + 1 points of the unit cube; without one SciPy's, around a random start.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub initial_simplex: Option<Vec<Vec<f64>>>,
}

impl Default for FalsifyPlan {
    fn default() -> Self {
        FalsifyPlan {
            formula: "success".to_string(),
            search: "random".to_string(),
            trials: 30,
            budget: 300,
            initial_simplex: None,
        }
    }
}

fn format() -> u32 {
    FORMAT
}

fn paper() -> String {
    "paper".to_string()
}

impl Plan {
    /// A plan for a controller in a task, with everything else at its default.
    pub fn new(task: &str, controller: &str) -> Plan {
        Plan {
            format: FORMAT,
            task: task.to_string(),
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
        let plan: Plan = toml::from_str(text).map_err(|error| MishandleError::Plan(error.to_string()))?;
        if plan.format > FORMAT {
            return Err(MishandleError::NewerPlan { found: plan.format, known: FORMAT });
        }
        Ok(plan)
    }

    /// The plan as TOML.
    pub fn to_toml(&self) -> String {
        // Strings, numbers and booleans in tables: TOML has a form for each.
        toml::to_string(self).unwrap_or_default()
    }
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
        let simplex = plan.falsify.as_ref().unwrap().initial_simplex.clone();
        assert!(simplex.is_some());
        let falsify = FalsifyPlan { initial_simplex: simplex, ..FalsifyPlan::default() };
        let defaults =
            Plan { evaluate: Some(EvaluatePlan::default()), falsify: Some(falsify), ..plan.clone() };
        assert_eq!(plan, Plan { task: plan.task.clone(), controller: plan.controller.clone(), ..defaults });
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

    #[test]
    fn what_an_older_plan_calls_starts_is_read() {
        let plan = |key| format!("task = \"a\"\ncontroller = \"b\"\n[evaluate]\n{key} = \"reachable\"\n");
        assert_eq!(Plan::from_toml(&plan("starts")).unwrap(), Plan::from_toml(&plan("box")).unwrap());
    }
}
