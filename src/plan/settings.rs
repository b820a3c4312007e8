//! Settings: keys that are not part of a question. No run file contains them, and no simulation of
//! a question depends on them.

use serde::{Deserialize, Serialize};
use toml::{Table, Value};

use super::declare::plan_table;
use super::keys::{self, Share, Within};
use super::{CheckSettings, RecordSettings, TrainPlan, TuneSettings};
use crate::error::MishandleError;

/// Keys that only a person may set: a file that others wrote must not weaken the checks of a run
/// file.
pub(super) const OF_PERSONS: [&str; 2] = ["engine.skip-check", "engine.any-build"];

/// The tables of a plan that are not part of its question.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct Settings {
    /// How run files are opened and written.
    pub engine: EngineSettings,
    /// Parts of answers beyond the simulations of their runs.
    pub report: ReportSettings,
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
        /// New path of a run's controller, if the file was moved.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub controller: Option<String> = None, "a string: the path of the file";
        /// New path of a run's target file, if it was moved.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub target: Option<String> = None, "a string: the path of the file";
    }
}

plan_table! {
    /// Parts of answers beyond the simulations of their runs: the table `[report]`.
    pub struct ReportSettings in "report" {
        /// Simulations of each counterexample of a random target with other seeds, which measure
        /// how often it fails; at most as many in total as the run has. 0 skips this.
        pub repeats: u32 = 100, "an integer from 0 to 10000000" => Within<0, 10_000_000>;
    }
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
    const TABLES: [&str; 9] =
        ["engine", "report", "size", "check", "tune", "train", "record", "import", "evidence"];

    /// Returns the keys of all tables.
    pub(super) fn described() -> Vec<keys::Key> {
        [
            EngineSettings::described(),
            ReportSettings::described(),
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
    /// If a value has another type.
    pub fn take(table: &mut Table) -> Result<Settings, MishandleError> {
        let own =
            Settings::TABLES.iter().filter_map(|name| Some(((*name).to_string(), table.remove(*name)?)));
        let own: Table = own.collect();
        let text = own.to_string();
        Value::Table(own).try_into().map_err(|error: toml::de::Error| MishandleError::PlanSyntax {
            line: 1,
            found: text,
            message: error.message().to_string(),
        })
    }
}
