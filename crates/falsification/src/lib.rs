//! Falsification: searches for scenarios with a negative robustness (counterexamples).
//!
//! A [`Trial`] is one seeded search with a budget of simulations. A [`Falsification`] runs many
//! trials together: one batch of the [`System`](mishandle_rollout::System) under test contains
//! simulations of several trials. Each trial has the same simulations as if it ran alone, one
//! simulation at a time. A callback receives every [`Episode`](mishandle_rollout::Episode) before
//! the next batch starts. An interrupted falsification resumes from its records. This crate uses
//! neither files nor clocks.
//!
//! [`minimize`](minimize()) moves a counterexample toward the nominal scenario,
//! [`repeat`](repeat()) simulates it with other seeds, and [`Repeated`] says how often.
//! [`PhysicsChecks`] simulate it under changes of the physics that it may not depend on.
//! [`margin`](margin()) searches for the smallest disturbance that violates the requirement.
//! [`metamorphic`](metamorphic()) compares the results of pairs of scenarios.
//!
//! # Example
//! A system in closed form whose requirement is violated where x > 0.9:
//! ```
//! use std::ops::ControlFlow;
//! use mishandle_falsification::{Falsification, FalsificationError, FalsificationSettings};
//! use mishandle_rollout::{Axis, Seed, Space};
//! use mishandle_search::{Coordinate, SearchOptions, by_name};
//! use mishandle_toys::{SimulatedEnd, FunctionSystem};
//!
//! let space = Space::new("starts", vec![Axis::start("x", "m", 0.0, 1.0)])?;
//! let mut system = FunctionSystem::new(space.clone(), |request| {
//!     SimulatedEnd::Robustness(0.9 - request.scenario.get(0).unwrap())
//! });
//!
//! let settings = FalsificationSettings { trials: 5, budget: 300, seed: Seed(7), ..FalsificationSettings::default() };
//! let make = |seed| by_name("random", &[Coordinate::Continuous], seed, &SearchOptions::default());
//! let mut falsification = Falsification::new(settings, &space, make)?;
//! let outcome = falsification.run(&mut system, |batch| {
//!     assert!(batch.episodes.iter().all(|episode| episode.request.number <= 300));
//!     Ok::<_, FalsificationError>(ControlFlow::Continue(()))
//! })?;
//! assert_eq!(outcome.falsified_trials, 5);
//! let found = |trial: &mishandle_falsification::TrialOutcome| trial.minimum.as_ref().unwrap().scenario.get(0).unwrap();
//! assert!(outcome.trials.iter().all(|trial| found(trial) > 0.9));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod bound;
mod coordinate;
mod error;
mod falsification;
mod isolate;
mod keep_going;
mod margin;
mod metamorphic;
mod minimize;
mod modes;
mod outcome;
mod physics;
mod repeat;
mod screened;
mod trial;

pub use bound::{inside_bounds, is_inside_of, on_bounds};
pub use coordinate::{coordinate, search_space};
pub use error::FalsificationError;
pub use falsification::{Falsification, FalsificationBatch, FalsificationSettings, trial_seed};
pub use isolate::{isolate, isolation_budget};
pub use keep_going::{KeepGoing, SignatureOf, simulations_without_mode};
pub use margin::{
    Margin, MarginSettings, Narrowed, Witness, category_axes, check_margin, distance, each_category,
    each_fault, has_margin, margin, norms,
};
pub use metamorphic::{
    AxisChange, Case, Cases, Metamorphic, MetamorphicSettings, OutputRelation, Pair, Relation,
    RelationOutcome, SmallestChange, metamorphic,
};
pub use minimize::{Keeps, Minimized, any_violation, axes_off_nominal, is_close, minimize, off_nominal};
pub use modes::{
    FailurePoint, MAX_FAILURES, MAX_OTHERS, ModeMembers, Signature, UnitScenario, group_failures,
    mode_distance, unit_scenario,
};
pub use outcome::{FalsificationOutcome, Minimum, TrialOutcome, Unevaluated};
pub use physics::{PhysicsChecks, Survivor, nearest_survivor, physics_text};
pub use repeat::{Repeated, measure_noise, repeat, repeat_seeds};
pub use screened::ScreenedCounts;
pub use trial::{SearchFactory, Trial, TrialEnd};
