//! Flags that ask whether logs meet formulas.

use std::path::PathBuf;

use clap::Args;

use super::named_formula;

/// Flags that mean nothing for a run.
pub const OF_LOGS: [&str; 4] = ["paths", "formula", "requirement", "requirements"];

/// Formulas on logs.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Formulas")]
pub struct LogQuestion {
    /// Formula in the syntax of RTAMT
    #[arg(long, allow_hyphen_values = true)]
    pub formula: Option<String>,
    /// Formula with a name; repeat the flag for several. Each has a verdict of its own
    #[arg(long, value_name = "NAME=FORMULA", allow_hyphen_values = true, value_parser = named_formula)]
    pub requirement: Vec<(String, String)>,
    /// TOML file with [[requirement]] tables: name, formula, text, severity, clause, unit
    /// (docs/guide/check.md)
    #[arg(long, value_name = "FILE")]
    pub requirements: Option<PathBuf>,
}

/// Logs as an alternative to runs.
#[derive(Clone, Debug, Args)]
#[command(next_help_heading = "Logs instead of runs")]
pub struct Logs {
    /// Files with a log each, as for `mishandle monitor`, whose flags for formulas and keys of the
    /// table `log` apply
    #[arg(long = "log", value_name = "LOG", num_args = 1..)]
    pub paths: Vec<PathBuf>,
    #[command(flatten)]
    pub question: LogQuestion,
}
