//! Guards: a controller that an online monitor watches, with a fallback that takes over.
//!
//! - A [`Watch`] is the formula: its robustness at the present sample if it reads the past, or the
//!   best robustness at time 0 that is still possible if it reads the future.
//! - A [`Switch`] decides when to hand over, and when to hand back.
//! - A [`Fallback`] acts after the hand-over: another controller, or a motion that needs none.
//! - A [`Guard`] has these three parts. It supervises the actions of any controller, also of one
//!   that learns.
//! - A [`Guarded`] controller is a controller with its guard: one that can be evaluated, falsified
//!   and replayed as any other.
//!
//! Everything that a guard remembers is a row of numbers, so that its decisions depend on nothing
//! but the simulation.

mod error;
mod fallback;

mod guarded;
mod supervisor;
mod switch;
mod watch;

pub use error::GuardError;
pub use fallback::{Fallback, Meaning, Motion};
pub use guarded::Guarded;
pub use supervisor::{ACTIVE, Guard, MAX_ROBUSTNESS, ROBUSTNESS};
pub use switch::Switch;
pub use watch::Watch;
