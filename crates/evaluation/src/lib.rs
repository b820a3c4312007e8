//! Measures the success rate, dangerous behavior rate and task completion time of a controller,
//! with confidence intervals.
//!
//! [`evaluate`] runs simulations from random initial states. They depend only on the seed and the
//! number of the simulation, so two controllers that are evaluated with the same seed have the same
//! initial states and the same noise. [`MetricCounter`] reduces the verdicts to [`Metrics`].
//! [`wilson`], [`betting_mean`] and [`bootstrap_mean`] compute the confidence intervals;
//! `tests/coverage.rs` measures how often they contain the true value.
//!
//! Random initial states hardly ever meet a corner of the initial box. [`Corners`] are its corners
//! and its center, which [`evaluate_corners`] simulates separately.
//!
//! Two controllers on the same scenarios are compared by [`PairedCounts`], [`sign_test`] and
//! [`paired_mean_difference`]. The numbers of simulations to a failure are analyzed by
//! [`SurvivalCurve`], [`log_rank`] and [`vargha_delaney`], and several tests are corrected by
//! [`holm()`](holm()). [`AxisRateCounter`] counts successes over the values of each axis and of
//! pairs of axes. [`kolmogorov_smirnov()`](kolmogorov_smirnov()) compares two distributions,
//! [`kruskal_wallis()`](kruskal_wallis()) several.
//!
//! [`RateSequence`], [`DifferenceSequence`] and [`ClippedDifferences`] have intervals that hold at
//! any time, so that a [`StopRule`] may end the simulations.
//!
//! # Example
//! ```
//! use mishandle_evaluation::wilson;
//! let rate = wilson(85, 100);
//! assert_eq!((rate.value, rate.n), (Some(0.85), 100));
//! assert!((rate.low.unwrap() - 0.77).abs() < 0.005 && (rate.high.unwrap() - 0.91).abs() < 0.005);
//! ```

mod axis_rates;
mod beta;
mod betting;
mod chi_squared;
mod corners;
mod effect;
mod ends;
mod error;
mod exact;
mod holm;
mod interaction;
mod interval;
mod kolmogorov_smirnov;
mod kruskal_wallis;
mod metrics;
mod paired;
mod repeats;
mod run;
mod screened;
mod sensitivity;
mod sequential;
mod smooth_region;
mod survival;
mod two_phase;
mod two_stage;

pub use axis_rates::AxisRateCounter;
pub use betting::{betting_mean, betting_mean_at};
pub use chi_squared::chi_squared_tail;
pub use corners::{CornerCounter, Corners, evaluate_corners};
pub use effect::vargha_delaney;
pub use ends::count_end;
pub use error::EvaluationError;
pub use exact::{fisher_test, sign_test};
pub use holm::holm;
pub use interval::{bootstrap_mean, bound_without_failures, clopper_pearson, complement, mean, wilson};
pub use kolmogorov_smirnov::kolmogorov_smirnov;
pub use kruskal_wallis::{KruskalWallis, kruskal_wallis};
pub use metrics::{
    FormulaRoles, MetricCounter, decides_careful_success, decides_strict_success, decides_success,
    failure_rate, rate,
};
pub use mishandle_results::{EndCounts, Estimate, Metrics, QUANTILES, Repeats};
pub use paired::{PairedCounts, paired_mean_difference, paired_rates, paired_rates_at_any_time};
pub use repeats::{repeats, variance_share};
pub use run::{Evaluation, ScenarioFilter, evaluate};
pub use screened::{
    EvaluationFailure, SCREENED_CHUNK, ScreenedEvaluation, ScreenedProgress, Selection, evaluate_screened,
    screen,
};
pub use sensitivity::{SensitivitySample, total_effects};
pub use sequential::{
    ClippedDifferences, DifferenceSequence, RateSequence, SizeSettings, Sizes, StopRule, anytime_rate,
    pair_size, rate_size,
};
pub use smooth_region::{NotSmooth, SmoothRegion, smooth_region};
pub use survival::{Lifetime, LogRank, SurvivalCurve, SurvivalStep, lifetimes, log_rank};
pub use two_phase::TwoPhase;
pub use two_stage::{TwoStage, two_stage};
