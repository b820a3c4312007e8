//! Trials and campaigns: searches that try to push a robustness below zero.
//!
//! A [`Trial`] is one seeded search with a budget of simulations. A [`Campaign`] advances many of them together, so
//! that one batch of the [`System`](mishandle_rollout::System) under test holds simulations of several trials; what
//! each trial simulates is the same as if it ran alone, one simulation at a time. Every
//! [`Episode`](mishandle_rollout::Episode) is handed to a callback before the next batch starts, and a campaign that was
//! cut short goes on from what was recorded. This crate reads no file and no clock.
//!
//! # Example
//! A system in closed form, violated in the corner x > 0.9:
//! ```
//! use std::ops::ControlFlow;
//! use mishandle_falsification::{Campaign, FalsificationError, CampaignSettings};
//! use mishandle_rollout::{Axis, Seed, Space};
//! use mishandle_search::{Coordinate, SearchOptions, by_name};
//! use mishandle_toys::{SimulatedEnd, FunctionSystem};
//!
//! let space = Space::new("starts", vec![Axis::start("x", "m", 0.0, 1.0)])?;
//! let mut system = FunctionSystem::new(space.clone(), |request| {
//!     SimulatedEnd::Robustness(0.9 - request.scenario.get(0).unwrap())
//! });
//!
//! let settings = CampaignSettings { trials: 5, budget: 300, seed: Seed(7), ..CampaignSettings::default() };
//! let make = |seed| by_name("random", &[Coordinate::Continuous], seed, &SearchOptions::default());
//! let mut campaign = Campaign::new(settings, &space, make)?;
//! let outcome = campaign.run(&mut system, |batch| {
//!     assert!(batch.episodes.iter().all(|episode| episode.request.number <= 300));
//!     Ok::<_, FalsificationError>(ControlFlow::Continue(()))
//! })?;
//! assert_eq!(outcome.falsified_trials, 5);
//! let found = |trial: &mishandle_falsification::TrialOutcome| trial.minimum.as_ref().unwrap().scenario.get(0).unwrap();
//! assert!(outcome.trials.iter().all(|trial| found(trial) > 0.9));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod campaign;
mod error;
mod outcome;
mod trial;

pub use campaign::{Campaign, CampaignBatch, CampaignSettings, SearchFactory};
pub use error::FalsificationError;
pub use outcome::{CampaignOutcome, Minimum, TrialOutcome, Undefined};
pub use trial::{Trial, TrialEnd};
