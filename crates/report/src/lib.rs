//! Pages about runs: HTML files without scripts that load nothing.
//!
//! [`RunReport::load`] reads what the page shows from a run file, of any target.
//! [`RunReport::measure`] adds what takes simulations: the size of the failing patches, checks
//! of the physics, repeats under noise, corners and pictures. [`page`] writes the HTML,
//! [`markdown`] the most important of it. [`campaign_page`] and [`run_page`]
//! write those of a campaign, [`statistics_page`] compares its runs, [`comparison_page`] writes the
//! page of two evaluations on the same scenarios and seeds, [`learning_curve_page`] that of a
//! training run, [`hardening_page`] that of a hardening, with [`HardenedModes`]. [`log_page`]
//! writes the page about verdicts on logs, [`check_reports`] the files about the requirements of a
//! file, [`bisection_page`] that of a bisection, with its [`BisectionEvidence`].
//!
//! - `load`, `measure`, `pictures`, `seen`: the facts. `words`: verdict and meaning in sentences.
//! - `space`, `map`, `curves`, `trace`, `predicate_chart`: charts, drawn by `charts`. A
//!   style sheet maps their colors to the theme.
//! - `replay`: the 3-D replay of a page, with the one script that draws it.
//! - `html`, `head`, `section`, `modes`, `hardened_modes`, `controller_pair`, `flipped_pairs`,
//!   `violated_counterexamples`, `log`, `check`, `bisection`, `page`: text. Every name, unit and
//!   formula of a run file or log is escaped.

#![allow(clippy::result_large_err, reason = "functions return the error of the library")]

mod axis_rates;
mod bisection;
mod campaign;
pub mod charts;
mod check;
mod commands;
mod comparison;
mod controller_pair;
mod curves;
mod flipped_pairs;
mod grid;
mod hardened_modes;
mod hardening;
mod head;
mod html;
mod learning_curve;
mod load;
mod log;
mod map;
mod margin;
mod markdown;
mod measure;
mod metamorphic;
mod modes;
mod page;
mod pictures;
mod predicate_chart;
mod ranking;
mod replay;
mod risk;
mod section;
mod seen;
mod sensitivity;
mod space;
mod survey;
mod survival;
mod tables;
mod trace;
mod violated_counterexamples;
mod words;

pub use bisection::{BisectionEvidence, bisection_page};
pub use campaign::{RunSummary, campaign_page, run_page};
pub use check::{
    CHECK_REPORTS, CheckFigures, check_markdown, check_page, check_reports, marked_verdict,
    summary as check_summary, worst_place,
};
pub use comparison::comparison_page;
pub use flipped_pairs::FlippedPairs;
pub use grid::{
    Block, GridFalsification, GridRun, NOTHING, Page, Table, code, percent_with_interval, search_comparison,
    statistics_page, survival_curves, target_cell, value, with_interval,
};
pub use hardened_modes::HardenedModes;
pub use hardening::{HardeningSummary, hardening_page};
pub use learning_curve::learning_curve_page;
pub use load::RunReport;
pub use log::{LogSection, log_page};
pub use markdown::markdown;
pub use measure::{Measurement, Samples};
pub use page::{Document, page, replay_page};
pub use pictures::{PICTURE, Painter};
pub use replay::{Mover, Recording};
pub use violated_counterexamples::ViolatedCounterexamples;

/// Colors of the charts. `page.css` has the color of each in both themes.
pub(crate) mod color {
    /// Failing simulations and what belongs to them.
    pub const FAIL: &str = "#8F3A04";
    /// Passing simulations.
    pub const PASS: &str = "#1F5C99";
    /// Thresholds and the line between violated and satisfied.
    pub const LIMIT: &str = "#55565A";
    /// A fourth line.
    pub const FOURTH: &str = "#7A3E9D";
    /// Span of a violation.
    pub const SHADE: &str = "#FBD9B5";
    /// Span of time that the formula reads.
    pub const WINDOW: &str = "#ECEFF2";
    /// Robustness below 0, the weakest violation first.
    pub const NEGATIVE: [&str; 4] = ["#FDE6CC", "#FBCF9E", "#F6B26B", "#EE9546"];
    /// Robustness from 0 on, the smallest margin first.
    pub const POSITIVE: [&str; 4] = ["#E4EDF6", "#C8DBEE", "#A6C5E3", "#7FADD9"];
}
