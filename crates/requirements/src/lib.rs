//! Requirements that engineers write: formulas in words, their traps, examples, patterns and mined
//! parameters.
//!
//! - [`describe`] puts a formula into words and checks it for known traps (`traps`), such as an
//!   implication whose condition can never hold.
//! - [`draw`] says when each sub-formula holds on a trace, and [`find_examples`] searches for a
//!   trace that satisfies a formula and one that violates it.
//! - [`patterns`] are requirements with names, such as `response`, and [`Pattern::fill`] makes a
//!   formula of one.
//! - [`mine`] finds the tightest values of the parameters of a formula for which traces satisfy it.
//! - [`RequirementFile`] is a file of requirements: identifiers, formulas, severities, and the
//!   clauses of standards that ask for them. [`TEMPLATES`] are files to start from.
//!
//! # Example
//! ```
//! use mishandle_requirements::{Context, describe};
//! let found = describe("always force <= 20 implies slip == 0", &Context::default()).unwrap();
//! let names: Vec<&str> = found.traps.iter().map(|trap| trap.name.as_str()).collect();
//! assert_eq!(names, ["precedence", "measured-equality"]);
//! ```

mod describe;
mod error;
mod example;
mod file;
mod lanes;
mod mining;
mod pattern;
mod ranges;
mod template;
mod traps;
mod tree;
mod units;

pub use describe::{Context, describe, describe_formula};
pub use error::{RequirementError, Result};
pub use example::{add_examples, find_examples};
pub use file::{CheckRequest, RequirementFile, WrittenRequirement, time_unit};
pub use lanes::{draw, with_values};
pub use mining::{
    MAX_POINTS, MiningQuestion, NamedTrace, ParameterRange, check_names, mine, parse_with_ranges,
};
pub use pattern::{Pattern, Shown, Slot, page as pattern_page, pattern, patterns};
pub use template::{TEMPLATES, template};
pub use traps::{certainty, start_traps};
pub use units::unit_of;
