//! Trials and campaigns: searches that try to push a robustness below zero.
//!
//! A [`Trial`] is one seeded search with a budget of simulations. A [`Campaign`] advances many of them together, so
//! that one batch of the [`System`](mishandle_rollout::System) under test holds simulations of several trials; what
//! each trial simulates is the same as if it ran alone, one simulation at a time. Every [`Simulation`] is handed to a
//! callback before the next batch starts, and a campaign that was cut short goes on from what was recorded. This
//! crate reads no file and no clock.
//!
//! # Example
//! A system in closed form, violated in the corner x > 0.9:
//! ```
//! use std::ops::ControlFlow;
//! use mishandle_falsification::{Campaign, FakeSystem, FalsificationError, Fate, Settings};
//! use mishandle_rollout::{Axis, InitialBox, Seed};
//! use mishandle_search::{SearchOptions, by_name};
//!
//! let axis = Axis { name: "x".into(), unit: "m".into(), low: 0.0, high: 1.0 };
//! let initial_box = InitialBox::new(vec![axis])?;
//! let mut system = FakeSystem::new(initial_box.clone(), |request| Fate::Robustness(0.9 - request.x0[0]));
//!
//! let settings = Settings { trials: 5, budget: 300, seed: Seed(7) };
//! let make = |seed| by_name("random", 1, seed, &SearchOptions::default());
//! let mut campaign = Campaign::new(settings, &initial_box, make)?;
//! let outcome = campaign.run(&mut system, |simulations| {
//!     assert!(simulations.iter().all(|simulation| simulation.number <= 300));
//!     Ok::<_, FalsificationError>(ControlFlow::Continue(()))
//! })?;
//! assert_eq!(outcome.falsified_trials, 5);
//! assert!(outcome.trials.iter().all(|trial| trial.minimum.as_ref().unwrap().initial_configuration[0] > 0.9));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod campaign;
mod error;
mod fake_system;
mod outcome;
mod survival;
mod trial;

pub use campaign::{Campaign, MakeSearch, Recorded, Settings, Simulation};
pub use error::FalsificationError;
pub use fake_system::{FakeSystem, Fate};
pub use outcome::{Minimum, Outcome, TrialOutcome};
pub use survival::{Spell, Survival};
pub use trial::{Asked, Trial, TrialEnd};
