//! Output for people and programs: results on stdout, as text and as JSON, and messages on stderr.

pub mod campaign;
pub mod comparison;
pub mod corners;
pub mod escape;
pub mod evaluation;
pub mod explanation;
pub mod exports;
pub mod falsification;
pub mod formula_error;
pub mod hardening;
pub mod live_curve;
pub mod margin;
pub mod mode_survey;
pub mod modes;
pub mod output;
pub mod progress;
pub mod regression;
pub mod replay;
pub mod requirements;
pub mod risk;
pub mod scenario;
pub mod screening;
pub mod simulation;
pub mod subject;
pub mod train_reporter;
pub mod video;
