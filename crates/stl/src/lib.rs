//! Signal temporal logic (STL): formulas, traces and robustness.
//!
//! STL states requirements on signals over time, for example "the distance is at most 0.12 m at
//! every step from 50 to 300". A [`Trace`] holds named signals, one value per sample. A [`Formula`]
//! is parsed from text in the syntax of RTAMT. A [`Monitor`] evaluates a formula on traces. It
//! returns the robustness: a number that is positive if the trace satisfies the formula, negative
//! if the trace violates it, and whose size is the distance to the border between the two. The sign
//! of a zero is the Boolean verdict, see [`is_satisfied`]. A [`Clock`] converts the time bounds of
//! a formula to samples. An [`OnlineMonitor`] evaluates formulas while the samples arrive, a
//! [`DenseMonitor`] on signals with samples at any times.
//!
//! # Differences from RTAMT
//! RTAMT 0.4.10 parses `a - b + c` as `a - (b + c)` and `a / b * c` as `a / (b * c)`. Here `+` and
//! `-` have the same precedence and associate to the left, and so do `*` and `/`. The page
//! `docs/reference/formulas.md` lists the other differences, and all operators with examples.
//!
//! # Reference
//! Maler and Nickovic, "Monitoring Temporal Properties of Continuous Signals", FORMATS 2004. Donzé
//! and Maler, "Robust Satisfaction of Temporal Logic over Real-Valued Signals", FORMATS 2010.
//! Fainekos and Pappas, "Robustness of temporal logic specifications for continuous-time signals",
//! Theoretical Computer Science 410, 2009. Syntax and values: Ničković and Yamaguchi, "RTAMT:
//! Online Robustness Monitors from STL", ATVA 2020.
//!
//! # Example
//! ```
//! use std::sync::Arc;
//! use mishandle_stl::{Clock, Formula, Monitor, Trace};
//!
//! let names: Arc<[String]> = Arc::from(["door_yaw_deg".to_owned()]);
//! let mut trace = Trace::new(Arc::clone(&names));
//! for angle in [0.0, 12.0, 26.0] {
//!     trace.push(&[angle]);
//! }
//! let formula = Formula::parse("eventually[0:300](door_yaw_deg >= 20)").unwrap();
//! let mut monitor = Monitor::new(&formula, &names, Clock::steps(1.0 / 60.0)).unwrap();
//! assert_eq!(monitor.robustness(&trace).unwrap(), 6.0); // 26 degrees are 6 more than 20
//! ```

mod clock;
mod decisive;
mod dense;
mod diagnosis;
mod error;
mod explain;
mod extremum;
mod foreign;
mod formula;
mod lexer;
mod moment;
mod monitor;
mod name;
mod number;
mod online;
mod operator;
mod parser;
mod parts;
mod pointwise;
mod program;
mod skeleton;
mod span;
mod spelling;
mod state;
mod subformula;
mod syntax;
mod trace;
mod until;
mod vacuity;
mod verdict;

pub use clock::{Clock, TimeUnit};
pub use dense::{
    Breakpoint, DenseDiagnosis, DenseError, DenseMonitor, DensePredicate, DenseRobustness, DenseSignal,
    Interpolation, Violation,
};
pub use diagnosis::{DecisivePredicate, DecisiveSubformula, Diagnosis};
pub use error::{MonitorError, ParseError, Position, name_hint};
pub use explain::EvaluationTime;
pub use formula::Formula;
pub use monitor::{Monitor, Windows};
pub use name::{spelled, unquoted};
pub use online::{Bounds, CutMonitor, OnlineMonitor};
pub use parts::{Composition, Decomposition};
pub use spelling::nearest;
pub use subformula::SubformulaNode;
pub use syntax::{Parameter, SyntaxBound, SyntaxKind, SyntaxNode};
pub use trace::Trace;
pub use vacuity::Vacuity;
pub use verdict::{is_satisfied, is_violated};
