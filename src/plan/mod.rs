//! Plans: what a user asks for, in names and numbers.
//!
//! A [`Plan`] is read from TOML or made from flags. This room looks nothing up: `resolve` does.

mod check;
mod declare;
mod edit;
mod grid;
mod guard;
mod harden;
mod keys;
mod log;
mod metamorphic;
mod read;
mod record;
mod risk;
pub(crate) mod search_options;
mod settings;
mod train;
mod until;

use std::collections::BTreeMap;
use std::ops::RangeInclusive;

use mishandle_rollout::DEFAULT_BATCH_SIZE;
use mishandle_search::SearchOptions;
use mishandle_store::RunKind;
use serde::{Deserialize, Serialize};

use crate::error::MishandleError;
use declare::plan_table;

pub use check::CheckSettings;
pub(crate) use edit::key_values;
pub use edit::{Values, assignments, axis_setting, set, set_tables, set_value};
pub use grid::{GridRun, grid, read_grid};
pub use guard::{GuardPlan, TuneSettings};
pub use harden::HardenPlan;
pub use keys::{Key, keys};
pub use log::{DecimalMark, FormulaSettings, LogSettings, MonitorSettings};
pub use metamorphic::{MetamorphicPlan, RelationPlan};
pub use mishandle_results::{Measure, StartRegion};
pub use mishandle_training::AxisSetting;
pub use read::table;
pub use record::RecordSettings;
pub use risk::RiskPlan;
pub use search_options::search_option_value;
pub use settings::{
    CenterEvent, EngineChoice, EngineSettings, EvidenceSettings, ImportSettings, RegressSettings,
    RenderSettings, ReportSettings, Settings, SimulateSettings, SizePlan, TraceColumns, TraceSettings,
};
pub use train::TrainPlan;
pub use until::{ComparePlan, Until};

/// Device of a plan that every front end has.
pub const CPU: &str = "cpu";

/// Device of a plan that only some front ends have.
pub const GPU: &str = "gpu";

/// Devices of a training's physics.
pub const DEVICES: [&str; 2] = [CPU, GPU];

/// Version of the plan format.
const FORMAT: u32 = 2;

/// An evaluation, a falsification or an estimation of the failure probability: read from TOML,
/// edited by flags, and stored with the results.
///
/// A plan contains names only. [`ResolvedPlan::new`](crate::resolve::ResolvedPlan::new) looks them
/// up and checks them.
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
    /// Name of the target: a task, `toy/NAME`, the path of a target file, or `process:COMMAND` for
    /// a simulator. Empty if an argument names it.
    #[serde(default)]
    pub target: String,
    /// Working folder of the simulator `process:COMMAND` and of the trainer of a hardening. Empty:
    /// the present one.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub folder: String,
    /// Whether the user typed the command of the simulator, which allows it. A file never does.
    #[serde(skip)]
    pub is_typed: bool,
    /// Name of the scenario space, or several names joined by `+`. Empty: the first space of the
    /// target.
    #[serde(default)]
    pub space: String,
    /// Axes with a narrower range or a fixed value, by name. Axes that the space lacks are added to
    /// it: the table `[axes]`, and the flag `--axis`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub axes: BTreeMap<String, AxisSetting>,
    /// Task preset: the initial boxes and formulas of the benchmark's `paper` or of its `code`.
    #[serde(default = "paper")]
    pub preset: String,
    /// Name of a shipped controller, or a path. Empty for toys, or if a flag names it.
    #[serde(default)]
    pub controller: String,
    /// Sample the policy's actions instead of taking their mean.
    #[serde(default)]
    pub stochastic: bool,
    /// Standard deviation of the Gaussian noise on each action, from 0 to 10. Actions range from -1
    /// to 1.
    #[serde(default)]
    pub action_noise: f64,
    /// Standard deviation of the Gaussian noise on each observation, from 0 to 10, in units of the
    /// observation.
    #[serde(default)]
    pub observation_noise: f64,
    /// Random seed of the run. Seeds above 2⁶³ - 1, the largest TOML integer, are written as
    /// strings.
    #[serde(default, with = "seed")]
    pub seed: u64,
    /// Evaluate the formula `careful` of the target, and record the signals that it reads, in every
    /// question. By default, only evaluations do, and questions whose formula needs such signals.
    #[serde(default)]
    pub careful: bool,
    /// Largest share of the simulations without a verdict, from 0 to 1, with which a question has a
    /// conclusion.
    #[serde(default = "max_without_verdict", skip_serializing_if = "is_max_without_verdict")]
    pub max_without_verdict: f64,
    /// Requirements by name: names of formulas of the target, or texts. Each has a result of its
    /// own from the same simulations. A search tries to violate any of them.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub requirements: BTreeMap<String, String>,
    /// Guard of the controller. `None`: the controller acts alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub guard: Option<GuardPlan>,
    /// Settings of an evaluation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub evaluate: Option<EvaluatePlan>,
    /// Settings of a comparison that stops by itself. Both of its evaluations have them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub compare: Option<ComparePlan>,
    /// Settings of a falsification.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub falsify: Option<FalsifyPlan>,
    /// Settings of a search for the smallest disturbance.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub margin: Option<MarginPlan>,
    /// Settings of relations between pairs of scenarios.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub metamorphic: Option<MetamorphicPlan>,
    /// Settings of an estimation of the failure probability.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub risk: Option<RiskPlan>,
    /// Settings of a hardening.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub harden: Option<HardenPlan>,
    /// Settings of a screening: another device proposes simulations, and the target's system
    /// confirms them. `None`: the system computes all simulations.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub screening: Option<ScreeningPlan>,
}

plan_table! {
    /// Settings of a search for the smallest disturbance: the table `[margin]` of a plan.
    pub struct MarginPlan in "margin" {
        /// Requirement: the name of a formula of the target, or the text of a formula. `None`
        /// selects the target's first formula.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub formula: Option<String> = None, keys::FORMULA;
        /// Largest number of simulations, without the repeats of the witness.
        pub budget: u64 = 3000, keys::BUDGET;
        /// Search once for each combination of categories, each time with the whole budget.
        /// Otherwise categorical axes stay at their nominal categories.
        pub each_category: bool = false, keys::BOOLEAN;
    }
}

plan_table! {
    /// Settings of a screening: the table `[screening]` of a plan.
    pub struct ScreeningPlan in "screening" {
        /// Name of the device that proposes; `none`: there is no screening.
        pub device: String = GPU.to_string(), "\"gpu\" or \"none\"";
        /// Number of worlds that the device steps together.
        pub rows: u32 = 16_384, "an integer from 1 to 1048576";
        /// Probability, from 0 to 1, with which a simulation that is not flagged is confirmed: the
        /// audit sample.
        pub confirm: f64 = 0.1, keys::SHARE;
    }
}

impl ScreeningPlan {
    /// Returns the default batch size of a screened falsification, which fills the worlds.
    pub fn batch(&self) -> u32 {
        self.rows.min(*Plan::BATCH.end() as u32)
    }
}

plan_table! {
    /// Settings of an evaluation.
    pub struct EvaluatePlan in "evaluate" {
        /// Number of simulations; with `until`, the largest number.
        pub episodes: u64 = 100, keys::EPISODES;
        /// When the evaluation stops by itself. `None`: after `episodes` simulations.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub until: Option<Until> = None, keys::UNTIL;
        /// The success rate that `until = "decided"` decides about.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub rate: Option<f64> = None, "a number above 0 and below 1";
        /// Region of the initial states: `box = "whole"` or `"reachable"`.
        pub starts as "box": StartRegion = StartRegion::Whole, "\"whole\" or \"reachable\"";
        /// Whether the corners and the center of the initial box are simulated, too.
        pub corners: bool = true, keys::BOOLEAN;
        /// Whether the same starts and seeds are simulated with every other axis at nominal, too:
        /// the control arm.
        pub control: bool = true, keys::BOOLEAN;
        /// Batch size: number of simulations run at once. Results do not depend on it, but `until`
        /// looks at the ends of batches.
        pub batch: u32 = DEFAULT_BATCH_SIZE as u32, keys::BATCH;
    }
}

plan_table! {
    /// Settings of a falsification.
    pub struct FalsifyPlan in "falsify" {
        /// Requirement to violate: the name of a formula of the target, or the text of a formula.
        /// `None` selects the target's first formula, which is `success` for a task.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub formula: Option<String> = None, keys::FORMULA;
        /// Name of the search.
        pub search: String = "portfolio".to_string(), "a string, such as \"nelder-mead\"";
        /// Number of trials.
        pub trials: u32 = 3, "an integer from 1 to 1000000";
        /// Largest number of simulations per trial.
        pub budget: u32 = 300, keys::BUDGET;
        /// Batch size: number of simulations run at once.
        pub batch: u32 = DEFAULT_BATCH_SIZE as u32, keys::BATCH;
        /// Random seed of every simulation. `None`: each simulation has a seed of its own.
        #[serde(with = "seed::optional", skip_serializing_if = "Option::is_none")]
        pub fixed_seed: Option<u64> = None, keys::SEED => seed::SeedValue;
        /// End simulations as soon as the search does not need the rest.
        pub early_stopping: bool = false, keys::BOOLEAN;
        /// Continue a trial after its first violation, to find other failure modes.
        pub keep_going: bool = false, keys::BOOLEAN;
        /// With `keep_going`, a trial ends when less than this fraction of its simulations finds a
        /// new failure mode, from 0 to less than 1. With 0, it spends its budget.
        pub new_mode_rate: f64 = 0.01, "a number from 0 to less than 1";
        /// Move each counterexample toward nominal, to find the axes that cause it. `None`: not in
        /// a campaign or with `keep_going`.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub isolate: Option<bool> = None, keys::BOOLEAN;
        /// Options of the search by name: the table `[falsify.options]`. `mishandle list searches
        /// SEARCH` lists them.
        #[serde(with = "search_options", skip_serializing_if = "SearchOptions::is_empty")]
        pub options: SearchOptions = SearchOptions::new(), "a table, as [falsify.options]" => toml::Table;
    }
}

impl FalsifyPlan {
    /// Sets `isolate` where the plan leaves it open: a person who asks one question wants to know
    /// why it fails.
    pub fn isolate_by_default(&mut self) {
        self.isolate.get_or_insert(!self.keep_going);
    }
}

fn format() -> u32 {
    FORMAT
}

/// Conversion of seeds to and from TOML.
mod seed {
    use std::num::ParseIntError;

    use serde::{Deserialize, Deserializer, Serializer};

    /// A seed in TOML: an integer, or a string with that integer.
    #[derive(Deserialize)]
    #[serde(untagged)]
    enum Stated {
        Number(u64),
        Text(String),
    }

    #[derive(Deserialize)]
    #[serde(try_from = "Stated")]
    pub(super) struct SeedValue(u64);

    impl TryFrom<Stated> for SeedValue {
        type Error = ParseIntError;

        fn try_from(stated: Stated) -> Result<SeedValue, ParseIntError> {
            match stated {
                Stated::Number(seed) => Ok(SeedValue(seed)),
                Stated::Text(text) => text.parse().map(SeedValue),
            }
        }
    }

    pub fn serialize<S: Serializer>(seed: &u64, serializer: S) -> Result<S::Ok, S::Error> {
        match i64::try_from(*seed) {
            Ok(number) => serializer.serialize_i64(number),
            Err(_) => serializer.serialize_str(&seed.to_string()),
        }
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u64, D::Error> {
        SeedValue::deserialize(deserializer).map(|seed| seed.0)
    }

    /// The same for a seed that may be missing.
    pub mod optional {
        use super::*;

        pub fn serialize<S: Serializer>(seed: &Option<u64>, serializer: S) -> Result<S::Ok, S::Error> {
            match seed {
                Some(seed) => super::serialize(seed, serializer),
                None => serializer.serialize_none(),
            }
        }

        pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<u64>, D::Error> {
            super::deserialize(deserializer).map(Some)
        }
    }
}

fn max_without_verdict() -> f64 {
    Plan::MAX_WITHOUT_VERDICT
}

fn is_max_without_verdict(share: &f64) -> bool {
    share.to_bits() == Plan::MAX_WITHOUT_VERDICT.to_bits()
}

fn paper() -> String {
    "paper".to_string()
}

impl Plan {
    /// Allowed numbers of episodes of an evaluation. Run files store simulation numbers in 32 bits.
    pub const EPISODES: RangeInclusive<u64> = 1..=1_000_000_000;

    /// Allowed numbers of trials. A campaign allocates memory for every trial when it starts.
    pub const TRIALS: RangeInclusive<u64> = 1..=1_000_000;

    /// Allowed numbers of simulations per trial.
    pub const BUDGET: RangeInclusive<u64> = 1..=1_000_000;

    /// Allowed batch sizes. The traces of a batch are in memory together.
    pub const BATCH: RangeInclusive<u64> = 1..=65_536;

    /// Default of the largest share of the simulations without a verdict.
    pub const MAX_WITHOUT_VERDICT: f64 = 0.05;

    /// Returns a plan with default settings. `controller` is empty for a target that is not a task.
    pub fn new(target: &str, controller: &str) -> Plan {
        Plan {
            format: FORMAT,
            target: target.to_string(),
            folder: String::new(),
            is_typed: false,
            space: String::new(),
            axes: BTreeMap::new(),
            preset: paper(),
            controller: controller.to_string(),
            stochastic: false,
            action_noise: 0.0,
            observation_noise: 0.0,
            seed: 0,
            careful: false,
            max_without_verdict: Plan::MAX_WITHOUT_VERDICT,
            requirements: BTreeMap::new(),
            guard: None,
            evaluate: None,
            compare: None,
            falsify: None,
            margin: None,
            metamorphic: None,
            risk: None,
            harden: None,
            screening: None,
        }
    }

    /// Returns the question that the plan asks: that of its first table.
    pub fn kind(&self) -> RunKind {
        let tables = [
            (RunKind::Falsify, self.falsify.is_some()),
            (RunKind::Margin, self.margin.is_some()),
            (RunKind::Metamorphic, self.metamorphic.is_some()),
            (RunKind::Risk, self.risk.is_some()),
        ];
        tables.into_iter().find(|(_, is_given)| *is_given).map_or(RunKind::Evaluate, |(kind, _)| kind)
    }

    /// Removes the tables of all questions, also of a comparison and of a hardening.
    pub fn without_questions(self) -> Plan {
        Plan {
            evaluate: None,
            compare: None,
            falsify: None,
            margin: None,
            metamorphic: None,
            risk: None,
            harden: None,
            ..self
        }
    }

    /// Removes the tables of other questions.
    pub fn only(self, kind: RunKind) -> Plan {
        let Plan { evaluate, falsify, margin, metamorphic, risk, .. } = self.clone();
        let others = self.without_questions();
        match kind {
            RunKind::Evaluate => Plan { evaluate, ..others },
            RunKind::Falsify => Plan { falsify, ..others },
            RunKind::Margin => Plan { margin, ..others },
            RunKind::Metamorphic => Plan { metamorphic, ..others },
            RunKind::Risk => Plan { risk, ..others },
        }
    }

    /// Parses a plan. Keys that are left out have their defaults.
    ///
    /// # Errors
    /// If the text is not TOML, contains an unknown key or an invalid value, or has another format.
    pub fn from_toml(text: &str) -> Result<Plan, MishandleError> {
        read::read(text)
    }

    /// Returns the plan as TOML.
    pub fn to_toml(&self) -> String {
        // Cannot fail: the plan contains strings, numbers and booleans only.
        toml::to_string(self).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the example of docs/reference/plans.md.
    fn documented_plan() -> &'static str {
        let page = include_str!("../../docs/reference/plans.md");
        page.split("```toml\n").nth(1).and_then(|rest| rest.split("```").next()).unwrap()
    }

    #[test]
    fn a_plan_of_one_question_has_no_table_of_another() {
        // It has all of them.
        let plan = Plan::from_toml(documented_plan()).unwrap();
        for (kind, name) in RunKind::ALL {
            let tables = toml::Table::try_from(plan.clone().only(kind)).unwrap();
            let kept = RunKind::ALL.map(|(_, name)| name).into_iter().chain(["compare", "harden"]);
            let kept: Vec<&str> = kept.filter(|name| tables.contains_key(*name)).collect();
            assert_eq!(kept, [name]);
        }
    }

    #[test]
    fn the_documented_plan_contains_every_key_with_its_default() {
        let plan = Plan::from_toml(documented_plan()).unwrap();
        // The default formula is the target's first, which is `success` for a task, and so is the
        // default space, `starts`.
        let formula = Some("success".to_string());
        let falsify = FalsifyPlan { formula, isolate: Some(true), ..FalsifyPlan::default() };
        let formula = Some("success".to_string());
        let risk = RiskPlan { formula: formula.clone(), ..RiskPlan::default() };
        let margin = Some(MarginPlan { formula, ..MarginPlan::default() });
        let change =
            [("ball_x", "+0.02")].map(|(axis, change)| (axis.to_string(), change.to_string())).into();
        let relations = [("shift".to_string(), RelationPlan { change, ..RelationPlan::default() })].into();
        let formula = Some("success".to_string());
        let metamorphic = Some(MetamorphicPlan { formula, relations, ..MetamorphicPlan::default() });
        let settings = Some("my_settings.toml".to_string());
        let harden = Some(HardenPlan { settings, ..HardenPlan::default() });
        let screening = Some(ScreeningPlan::default());
        let guard = Some(GuardPlan {
            formula: "ball_3 >= 0.3".to_string(),
            return_threshold: Some(0.05),
            fallback: "expert".to_string(),
            actions: Some("increments".to_string()),
            ..GuardPlan::default()
        });
        let evaluate = EvaluatePlan::default();
        let defaults = Plan {
            evaluate: Some(evaluate),
            compare: Some(ComparePlan::default()),
            falsify: Some(falsify),
            risk: Some(risk),
            margin,
            metamorphic,
            harden,
            screening,
            guard,
            ..plan.clone()
        };
        let named = Plan { target: plan.target.clone(), controller: plan.controller.clone(), ..defaults };
        assert_eq!(plan, named);
        assert_eq!(
            Plan { screening: None, guard: None, ..plan.clone().without_questions() },
            Plan { space: "starts".to_string(), ..Plan::new("ball-balancing", "ppo") }
        );
        // `to_toml` writes every key, this share only if it is changed, so the example must contain
        // the same keys.
        let is_key = |line: &&str| line.contains(" = ");
        let keys = |text: &str| -> Vec<String> {
            text.lines().filter(is_key).map(|line| line.split(' ').next().unwrap().to_string()).collect()
        };
        let mut written = keys(&Plan { max_without_verdict: 0.1, ..plan }.to_toml());
        let mut shown = keys(documented_plan());
        written.sort();
        shown.sort();
        assert_eq!(written, shown);
    }

    fn options_of(falsify: &str) -> Result<FalsifyPlan, MishandleError> {
        let plan = format!("target = \"a\"\ncontroller = \"b\"\n[falsify]\n{falsify}");
        Plan::from_toml(&plan).map(|plan| plan.falsify.unwrap())
    }

    #[test]
    fn search_options_survive_a_round_trip_through_toml() {
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
    fn an_option_with_an_invalid_value_or_two_values_is_an_error() {
        let error = |text: &str| options_of(text).unwrap_err().to_string();
        assert!(error("[falsify.options]\nxatol = 1979-05-27\n").contains("must be a number, true or false"));
        let twice = error("[falsify.options]\nmax-iterations = 1\nmax_iterations = 2\n");
        assert!(twice.contains("`falsify.options.max_iterations` is 2"), "{twice}");
    }

    #[test]
    fn a_plan_of_another_format_is_an_error_that_names_both_formats() {
        let error = |format: u32| {
            let plan = format!("format = {format}\ntarget = \"a\"\nnew_key = 1\n");
            Plan::from_toml(&plan).unwrap_err().to_string()
        };
        assert_eq!(error(99), "the plan has format 99, this program reads format 2: use a newer Mishandle");
        assert_eq!(
            error(1),
            "the plan has format 1, this program reads format 2: write it again with the keys of docs/reference/plans.md"
        );
        assert!(error(0).contains("`format` is 0"), "{}", error(0));
        assert!(error(FORMAT).contains("new_key"), "{}", error(FORMAT));
    }

    #[test]
    fn every_seed_survives_a_round_trip_through_toml() {
        for seed in [0, i64::MAX as u64, 1 << 63, u64::MAX] {
            let plan = Plan { seed, ..Plan::new("a", "b") };
            assert_eq!(Plan::from_toml(&plan.to_toml()).unwrap().seed, seed);
        }
    }
}
