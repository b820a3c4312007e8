//! Settings: keys that are not part of a question. No run file contains them, and no simulation
//! depends on them.

use mishandle_requirements::MAX_POINTS;
use serde::{Deserialize, Serialize};
use toml::{Table, Value};

use super::declare::plan_table;
use super::keys::{self, wrong};
use super::{FormulaSettings, LogSettings, MonitorSettings};
use crate::error::MishandleError;

/// Keys that only a person may set: a file that others wrote must not weaken the checks of a run
/// file.
pub(super) const OF_PERSONS: [&str; 2] = ["engine.skip-check", "engine.any-build"];

/// Largest number of runs at the same time.
const MAX_JOBS: u32 = 1024;

/// Largest number of repeats of a counterexample.
const MAX_REPEATS: u32 = 10_000_000;

/// Longest time for which a file that is still written need not grow, seconds.
const MAX_IDLE: f64 = 1e9;

/// Largest number of simulations of a run file from which parameters are mined.
const MAX_SIMULATIONS: u64 = 1_000_000_000;

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
    /// Parts of answers beyond the simulations of their runs.
    pub report: ReportSettings,
    /// How the number of simulations of a question is computed before them.
    pub size: SizePlan,
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
        pub jobs: u32 = 1, "an integer from 1 to 1024";
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
        pub repeats: u32 = 100, "an integer from 0 to 10000000";
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

impl Settings {
    /// Names of the tables.
    const TABLES: [&str; 6] = ["engine", "formula", "log", "monitor", "report", "size"];

    /// Returns the keys of all tables.
    pub(super) fn described() -> Vec<keys::Key> {
        [
            EngineSettings::described(),
            FormulaSettings::described(),
            LogSettings::described(),
            MonitorSettings::described(),
            ReportSettings::described(),
            SizePlan::described(),
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
    /// If a value is out of its range.
    pub fn take(table: &mut Table) -> Result<Settings, MishandleError> {
        let own =
            Settings::TABLES.iter().filter_map(|name| Some(((*name).to_string(), table.remove(*name)?)));
        let own: Table = own.collect();
        let stated = own.clone();
        let settings: Settings = Value::Table(own).try_into().map_err(|error: toml::de::Error| {
            let found = stated.to_string();
            MishandleError::PlanSyntax { line: 1, found, message: error.message().to_string() }
        })?;
        settings.log.options()?;
        let wrong_value = settings.wrong().and_then(|key| {
            let (table, name) = key.split_once('.')?;
            Some((key, stated.get(table)?.get(name)?.to_string()))
        });
        match wrong_value {
            Some((key, found)) => Err(wrong(key, &found)),
            None => Ok(settings),
        }
    }

    /// Returns a key whose value is out of its range.
    fn wrong(&self) -> Option<&'static str> {
        let Settings { engine, formula, log, monitor, report, .. } = self;
        let is_duration = |secs: Option<f64>| secs.is_none_or(|secs| secs > 0.0 && secs.is_finite());
        let is_right = [
            ("report.repeats", report.repeats <= MAX_REPEATS),
            ("engine.jobs", (1..=MAX_JOBS).contains(&engine.jobs)),
            ("log.period", is_duration(log.period)),
            ("log.tolerance", is_duration(log.tolerance)),
            ("monitor.lateness", is_duration(monitor.lateness)),
            ("monitor.idle", monitor.idle.is_none_or(|secs| (0.0..=MAX_IDLE).contains(&secs))),
            ("formula.episode", is_duration(formula.episode)),
            ("formula.share", formula.share > 0.0 && formula.share <= 1.0),
            ("formula.points", (2..=MAX_POINTS).contains(&(formula.points as usize))),
            ("formula.simulations", (1..=MAX_SIMULATIONS).contains(&formula.simulations)),
        ];
        is_right.into_iter().find_map(|(key, is_right)| (!is_right).then_some(key))
    }
}
