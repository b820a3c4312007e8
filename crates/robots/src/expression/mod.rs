//! Expressions over numbers and vectors, as files describe robots with them: `norm(site_pos('tool')
//! - goal)`.
//!
//! [`parse`] makes a tree of a text. A [`Compiler`] checks trees, with the names and quantities
//! that [`Names`] knows, and makes a [`Program`] of them. The lengths of all vectors are known
//! then, so an evaluation cannot fail and does not allocate. Values are 64-bit numbers; a condition
//! is 1 or 0.

mod compile;
mod error;
mod functions;
mod parse;
mod program;
mod token;

pub use compile::{Argument, Compiler, Meaning, Names, Reading, Size, functions};
pub use error::ExpressionError;
pub use parse::{Node, NodeKind, parse};
pub use program::{Place, Program, Reader, value};
