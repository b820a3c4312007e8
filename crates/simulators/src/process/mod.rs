//! Programs that answer line by line: each question is a line to the standard input of a program,
//! and the answer is the next line of its standard output.
//!
//! A [`Peer`] is one running program. It answers within a time limit or fails, and after a failure
//! it is not asked again, so that a late answer is never taken for the next one. Dropping it ends
//! the program and the programs of its process group. A program that gets its whole input at once
//! [finishes](Peer::finish) instead. A [`Job`] is such a program without questions.
//!
//! ```
//! use std::time::Duration;
//! use mishandle_simulators::process::{Failure, Peer, Program};
//!
//! let program = Program { words: vec!["cat".into()], folder: ".".into() };
//! let mut peer = Peer::start(&program)?;
//! assert_eq!(peer.ask("1", Duration::from_secs(10))?, "1");
//! # Ok::<(), Failure>(())
//! ```

mod failure;
mod job;
mod lines;
mod peer;

pub use failure::Failure;
pub use job::{Job, Program};
pub use lines::LONGEST;
pub use peer::{Output, Peer};
