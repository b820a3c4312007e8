//! The counter-based random number generator of the whole workspace: Philox4x32-10.
//!
//! Simulations use a [`Seed`]. It returns random numbers as a pure function of (seed, stream, step,
//! index), without state, so the order of threads or calls cannot change a number. Searches and the
//! bootstrap use a [`Sequence`], which returns one random number after another.
//!
//! # Reference
//! Salmon, Moraes, Dror and Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC 2011.

mod philox;
mod seed;
mod sequence;

pub use philox::philox4x32;
pub use seed::{Seed, Stream};
pub use sequence::Sequence;
