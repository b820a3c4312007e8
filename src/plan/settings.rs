//! Settings: keys that are not part of a question. No run file contains them, and no simulation of
//! a question depends on them.

use mishandle_falsification::Repeated;
use serde::{Deserialize, Serialize};
use toml::{Table, Value};

use super::declare::plan_table;
use super::keys::{self, ImageSize, OpenShare, Seconds, Share, Within};
use super::{
    CheckSettings, FormulaSettings, LogSettings, MonitorSettings, RecordSettings, TrainPlan, TuneSettings,
};
use crate::error::MishandleError;

/// Keys that only a person may set: a file that others wrote must not weaken the checks of a run
/// file, or choose a program.
pub(super) const OF_PERSONS: [&str; 3] = ["engine.skip-check", "engine.any-build", "render.python"];

/// Allowed numbers of random scenarios that measure something.
const SCENARIOS: &str = "an integer from 0 to 1000000";

/// Allowed numbers of a trial, a simulation or a failure mode.
const NUMBER: &str = "an integer from 1 to 4294967295";

/// The tables of a plan that are not part of its question.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct Settings {
    /// How run files are opened and written.
    pub engine: EngineSettings,
    /// How a formula is explained and mined.
    pub formula: FormulaSettings,
    /// How a log is read.
    pub log: LogSettings,
    /// Contents of verdicts on logs, and how a log is followed.
    pub monitor: MonitorSettings,
    /// Parts of answers and pages beyond the simulations of their runs.
    pub report: ReportSettings,
    /// Contents of pictures of a simulation.
    pub render: RenderSettings,
    /// How counterexamples are kept and tested.
    pub regress: RegressSettings,
    /// How a single scenario is simulated.
    pub simulate: SimulateSettings,
    /// Contents of a written trace.
    pub trace: TraceSettings,
    /// How the number of simulations of a question is computed before them.
    pub size: SizePlan,
    /// How the requirements of a file are checked.
    pub check: CheckSettings,
    /// How the threshold of a guard is chosen.
    pub tune: TuneSettings,
    /// A training run.
    pub train: TrainPlan,
    /// How demonstrations are recorded.
    pub record: RecordSettings,
    /// Facts that the file of an imported policy lacks.
    pub import: ImportSettings,
    /// How a folder of evidence is verified.
    pub evidence: EvidenceSettings,
}

plan_table! {
    /// How run files are opened and written: the table `[engine]`.
    pub struct EngineSettings in "engine" {
        /// Wait after each batch until its records are on the disk. Without it, a power failure can
        /// lose the last simulations; a kill loses at most the running batch.
        pub durable: bool = false, keys::BOOLEAN;
        /// Resume a run that another build started: its rows and those of this build stand in one
        /// file, whose header then names both.
        pub any_build: bool = false, keys::BOOLEAN;
        /// Do not check a whole run file before reading it; a record is still checked when it is
        /// read.
        pub skip_check: bool = false, keys::BOOLEAN;
        /// Simulate several runs on a Ray cluster: its address, `auto` for the one that runs on
        /// this machine, or `local` to start one; needs the Python package with Ray.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub ray: Option<String> = None, "a string, such as \"auto\"";
        /// Number of runs at the same time. Several keep all cores busy when searches propose few
        /// simulations at a time.
        pub jobs: u32 = 1, "an integer from 1 to 1024" => Within<1, 1024>;
        /// Measure a device and MuJoCo C on the first simulations of an `evaluate`, `falsify` or
        /// `risk`, and use the faster one: the plan in the run file then has the table `screening`
        /// or lacks it, so a run that is resumed or repeated by it measures nothing.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub screening: Option<EngineChoice> = None, "\"auto\"";
        /// New path of a run's controller, if the file was moved.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub controller: Option<String> = None, "a string: the path of the file";
        /// New path of a run's target file, if it was moved.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub target: Option<String> = None, "a string: the path of the file";
    }
}

/// How the engine of a question is chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum EngineChoice {
    /// By a measurement.
    Auto,
}

plan_table! {
    /// Parts of answers and pages beyond the simulations of their runs: the table `[report]`.
    pub struct ReportSettings in "report" {
        /// Simulations of each counterexample of a random target with other seeds, which measure
        /// how often it fails; at most as many in total as the run has. 0 skips this.
        pub repeats: u32 = 100, "an integer from 0 to 10000000" => Within<0, 10_000_000>;
        /// Whether up to 1,000 samples of a random search without a failure are simulated again:
        /// with their traces, the answer says which part of the space cannot fail if the
        /// requirement is smooth.
        pub smooth_region: bool = false, keys::BOOLEAN;
        /// Axes with which an explained failure is simulated again, each alone at its nominal
        /// value: those farthest from nominal. 0 leaves it out.
        pub axes: u64 = 30, "an integer of at least 0";
        /// Whether a page shows what takes simulations, and not only what the run files contain.
        pub simulations: bool = true, keys::BOOLEAN;
        /// Random scenarios around each failure mode, which estimate the size of the failing patch.
        /// 0 skips this, and all random scenarios of the whole space.
        pub probes: u32 = 64, SCENARIOS => Within<0, 1_000_000>;
        /// Random scenarios that measure the total effect of each axis on the robustness (Sobol
        /// index); each is simulated twice and once more for each axis. 0 skips this.
        pub sensitivity: u32 = 0, SCENARIOS => Within<0, 1_000_000>;
        /// Whether a page has 3-D replays, which a script in it draws.
        pub replay: bool = false, keys::BOOLEAN;
    }
}

plan_table! {
    /// Contents of pictures of a simulation: the table `[render]`.
    pub struct RenderSettings in "render" {
        /// Event that the pictures center on.
        pub event: CenterEvent = CenterEvent::Decisive, "\"decisive\", \"contact\" or \"release\"";
        /// Show only this many seconds before and after the event. Without it, all of an episode of
        /// up to 10 s, otherwise 5.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub around: Option<f64> = None, "a number of seconds above 0, such as 0.5" => Seconds;
        /// Width and height of the images of cameras of the target, pixels. Without it, 64 each.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub image_size: Option<[u16; 2]> = None, "two integers from 1 to 1024, such as [64, 64]" => ImageSize;
        /// Draw hard shadows and rougher edges, about four times as fast on a machine without a
        /// graphics card.
        pub fast: bool = false, keys::BOOLEAN;
        /// Mark each contact point with arrows along its force, and name the largest force.
        pub contacts: bool = false, keys::BOOLEAN;
        /// Python interpreter with the package `mujoco`, whose viewer opens a simulation.
        pub python: String = "python3".to_string(), "a string: the name or path of a program";
    }
}

/// Center of pictures of a simulation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CenterEvent {
    /// The violation, closest approach or smallest margin.
    Decisive,
    /// The first contact of two parts that do not touch in the first 0.1 s.
    Contact,
    /// The release of the held object.
    Release,
}

plan_table! {
    /// How counterexamples are kept and tested: the table `[regress]`.
    pub struct RegressSettings in "regress" {
        /// Simulations with other random seeds, which decide a test. Without it, the recorded seed
        /// does.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub repeat: Option<u32> = None, "an integer from 1 to 10000000" => Within<1, 10_000_000>;
        /// With `repeat`: largest failure rate of a test that passes.
        pub max_failure_rate: f64 = 0.0, keys::SHARE => Share;
        /// Failure mode, from 1, whose representative is kept.
        pub mode: u32 = 1, NUMBER => Within<1, 4_294_967_295>;
        /// Keep the representatives of all failure modes.
        pub all: bool = false, keys::BOOLEAN;
        /// Number of the trial, from 1, of the simulation that is kept.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub trial: Option<u32> = None, NUMBER => Within<1, 4_294_967_295>;
        /// Number of the simulation within its trial, from 1, that is kept instead of a
        /// representative.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub simulation: Option<u32> = None, NUMBER => Within<1, 4_294_967_295>;
        /// Move the scenario toward the nominal one while it still fails.
        pub minimize: bool = false, keys::BOOLEAN;
        /// Largest number of simulations that minimize a counterexample.
        pub budget: u32 = 300, keys::BUDGET => Within<1, 1_000_000>;
        /// Lowest success rate of a controller that passes, to find the first bad one.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub rate: Option<f64> = None, "a number between 0 and 1, such as 0.95" => OpenShare;
        /// Test every controller, and say whether one passes after one that fails.
        pub every: bool = false, keys::BOOLEAN;
    }
}

plan_table! {
    /// How a single scenario is simulated: the table `[simulate]`.
    pub struct SimulateSettings in "simulate" {
        /// With repeats of the scenario: random scenarios, each simulated twice, that measure the
        /// share of the robustness variance that comes from the scenario. 0 skips this.
        pub scenarios: u32 = Repeated::NOISE_SCENARIOS as u32, SCENARIOS => Within<0, 1_000_000>;
    }
}

plan_table! {
    /// Contents of a written trace: the table `[trace]`.
    pub struct TraceSettings in "trace" {
        /// The signals, or also joint positions and velocities, actions and contact forces of tasks
        /// and target files.
        pub columns: TraceColumns = TraceColumns::Signals, "\"signals\" or \"full\"";
    }
}

/// Columns of a written trace.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TraceColumns {
    /// The signals of the formulas.
    Signals,
    /// Joints, actions and contacts, too.
    Full,
}

plan_table! {
    /// How the number of simulations of a question is computed before them: the table `[size]`.
    pub struct SizePlan in "size" {
        /// Expected share of pairs in which both succeed. `None`: the product of both rates, which
        /// takes the most pairs.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub both: Option<f64> = None, keys::SHARE;
        /// Number of simulations, or of pairs, between two looks.
        pub batch: u64 = 64, keys::BATCH;
        /// Number of replications of the rule.
        pub replications: u64 = 1000, "an integer from 1 to 100000";
    }
}

plan_table! {
    /// Facts that the file of an imported policy lacks: the table `[import]`.
    pub struct ImportSettings in "import" {
        /// Activation of the hidden layers. `None`: that of the file, if it says so.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub activation: Option<String> = None, ACTIVATION;
        /// Activation of the last layer. `None`: that of the algorithm, if the file shows it.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub output_activation: Option<String> = None, ACTIVATION;
        /// JSON file with the statistics that normalize observations (mean, variance, epsilon,
        /// clip), or `none` if observations were not normalized. `None`: the statistics in the
        /// file.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub normalizer: Option<String> = None, "a string: the path of a file, or \"none\"";
    }
}

impl ImportSettings {
    /// Normalizer of a policy whose observations were not normalized.
    pub const NO_NORMALIZER: &str = "none";
}

/// Allowed activations.
const ACTIVATION: &str = "\"elu\", \"relu\", \"tanh\", \"silu\", \"gelu\", \"leaky_relu\" or \"identity\"";

plan_table! {
    /// How a folder of evidence is verified: the table `[evidence]`.
    pub struct EvidenceSettings in "evidence" {
        /// Share of the simulations of each run to replay, at least one; 0 replays none.
        pub replay: f64 = 0.05, keys::SHARE => Share;
    }
}

impl Settings {
    /// Names of the tables.
    const TABLES: [&str; 16] = [
        "engine", "formula", "log", "monitor", "report", "render", "regress", "simulate", "trace", "size",
        "check", "tune", "train", "record", "import", "evidence",
    ];

    /// Returns the keys of all tables.
    pub(super) fn described() -> Vec<keys::Key> {
        [
            EngineSettings::described(),
            FormulaSettings::described(),
            LogSettings::described(),
            MonitorSettings::described(),
            ReportSettings::described(),
            RenderSettings::described(),
            RegressSettings::described(),
            SimulateSettings::described(),
            TraceSettings::described(),
            SizePlan::described(),
            CheckSettings::described(),
            TuneSettings::described(),
            TrainPlan::described(),
            RecordSettings::described(),
            ImportSettings::described(),
            EvidenceSettings::described(),
        ]
        .concat()
    }

    /// Returns whether a key is one of settings, not of a question.
    pub fn has(key: &str) -> bool {
        key.split_once('.').is_some_and(|(table, _)| Settings::TABLES.contains(&table))
    }

    /// Takes the tables of settings out of the table of a plan.
    ///
    /// # Errors
    /// If a value has another type, or the settings of a log contradict each other.
    pub fn take(table: &mut Table) -> Result<Settings, MishandleError> {
        let own =
            Settings::TABLES.iter().filter_map(|name| Some(((*name).to_string(), table.remove(*name)?)));
        let own: Table = own.collect();
        let text = own.to_string();
        let settings: Settings = Value::Table(own).try_into().map_err(|error: toml::de::Error| {
            MishandleError::PlanSyntax { line: 1, found: text, message: error.message().to_string() }
        })?;
        settings.log.options()?;
        Ok(settings)
    }
}
