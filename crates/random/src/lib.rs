//! One counter-based random generator for the whole workspace: Philox4x32-10.
//!
//! A [`Seed`] gives numbers as a pure function of (seed, stream, step, index), without any state: simulations use it. A
//! [`Sequence`] gives one number after another: searches and the bootstrap use it. Both read the same generator, so the
//! order of threads or calls cannot change a number.

mod philox;
mod seed;
mod sequence;

pub use philox::philox4x32;
pub use seed::{Seed, Stream};
pub use sequence::Sequence;
