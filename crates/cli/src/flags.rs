//! Flags: groups that commands share, and the parsing of their values.

mod keys;
mod log_question;
pub mod numbers;
mod plan;
mod recorded;
mod run;
mod subject;

use std::ops::RangeInclusive;

pub use keys::{
    Assignment, KeyParser, Keys, Planned, SettingKeys, reads_key, settings, settings_of_runs, tables,
};
pub use log_question::{LogQuestion, Logs, OF_LOGS};
pub use plan::planned;
pub use recorded::{check_flags, is_full_trace};
pub use run::{OpenRun, Run, Verbose};
pub use subject::{Axes, Simulator, Subject, named_formula};

/// Random seeds.
pub const SEEDS: RangeInclusive<u64> = 0..=u64::MAX;

/// Numbers of threads: more than any machine has cores.
pub const THREADS: RangeInclusive<u64> = 1..=1024;

/// Numbers of trials and simulations in a run file.
pub const NUMBERS: RangeInclusive<u64> = 1..=u32::MAX as u64;

/// Numbers of repeated simulations of a scenario.
pub const REPEATS: RangeInclusive<u64> = 1..=10_000_000;
