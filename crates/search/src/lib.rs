//! Searches: black-box optimization on the unit cube `[0,1]^d` with an ask-and-tell interface.
//!
//! A [`Search`] minimizes a function, here the robustness of a simulation. The caller asks for a
//! point of the unit cube, maps it to a scenario, simulates the scenario and reports an
//! [`Observation`] to the search. A search knows no units and no physics. It is a state machine: it
//! can stop after any evaluation, and its points depend only on the types of its coordinates, its
//! random seed, its options and the observations.
//!
//! [`SEARCHES`] lists all searches with their options; [`by_name`] creates one.
//!
//! # Example
//! ```
//! use mishandle_search::{Coordinate, Observation, SearchOptions, by_name};
//!
//! let mut search = by_name("random", &[Coordinate::Continuous; 2], 7, &SearchOptions::default())?;
//! for _ in 0..300 {
//!     let Some(u) = search.ask() else { break };
//!     let value = (u[0] - 0.3).abs() + (u[1] - 0.8).abs();
//!     search.tell(&u, &Observation::from(value))?;
//! }
//! let (u, value) = search.best().expect("300 evaluations");
//! assert!(value < 0.1 && (u[0] - 0.3).abs() < 0.1);
//! # Ok::<(), mishandle_search::SearchError>(())
//! ```

mod ask_tell;
mod bayesian;
mod categories;
mod cma_es;
mod coordinate;
mod corners;
mod cross_entropy;
mod differential_evolution;
mod direct;
mod dual_annealing;
mod error;
mod free;
pub mod functions;
mod gp;
mod indexed;
mod lbfgsb;
mod line;
mod nelder_mead;
mod observation;
mod options;
mod pending;
mod portfolio;
mod random;
mod registry;
mod search;
mod search_space;
mod sobol;
mod turbo;

pub use ask_tell::{AskTell, RoundBased};
pub use bayesian::{Bayesian, BayesianOptions};
pub use cma_es::{CmaEs, CmaEsOptions};
pub use coordinate::Coordinate;
pub use corners::Corners;
pub use cross_entropy::{CrossEntropy, CrossEntropyOptions};
pub use differential_evolution::{DifferentialEvolution, DifferentialEvolutionOptions};
pub use direct::{Direct, DirectOptions};
pub use dual_annealing::{DualAnnealing, DualAnnealingOptions, VisitingDistribution};
pub use error::SearchError;
pub use indexed::{InSequence, PointSequence};
pub use lbfgsb::{Lbfgsb, LbfgsbOptions};
pub use line::{Line, LineOptions};
pub use nelder_mead::{NelderMead, NelderMeadOptions};
pub use observation::Observation;
pub use options::{OptionSpec, OptionType, OptionValue, SearchOptions};
pub use portfolio::{Portfolio, PortfolioOptions};
pub use random::Random;
pub use registry::{SEARCHES, SearchConstructor, SearchEntry, by_name, find_search};
pub use search::{Search, SearchEnd};
pub use search_space::{Composition, Parts, SearchSpace};
pub use sobol::{Sobol, SobolOptions};
pub use turbo::{Turbo, TurboOptions};
