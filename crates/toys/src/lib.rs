//! Toy targets in closed form, for tests, documentation and benchmarks of searches.
//!
//! A simulation takes microseconds, and the counterexamples are known, so searches and campaigns
//! can be tested in milliseconds. To add a toy, write a file and add a line to [`TOYS`].
//! [`FunctionSystem`] is a system for tests whose robustness is an arbitrary function.
//! [`arch`] has the problems of the ARCH competition.
//!
//! # Example
//! The car keeps its distance from every start, unless the car in front brakes:
//! ```
//! use mishandle_rollout::{Request, Seed, Specification};
//! use mishandle_stl::Formula;
//! let target = mishandle_toys::target("toy/car-following").unwrap()?;
//! let specification = Specification::new(Formula::parse("always(gap >= 2)").unwrap());
//! let starts = target.space("starts")?;
//! let mut system = target.system(&starts, &specification)?;
//! let episodes = system.rollout(&[Request::new(starts.nominal(), Seed(0))])?;
//! assert!(!episodes[0].is_violated());
//! # Ok::<(), mishandle_rollout::RolloutError>(())
//! ```

pub mod arch;
mod car_following;
mod function_system;
mod hidden_corner;
mod needle;
mod noisy;
mod pits;
mod plateau;
mod sphere;
mod toy;

pub use function_system::{FunctionSystem, SimulatedEnd};
pub use toy::{Toy, target, target_among};

/// All toys, in the order of the list.
pub static TOYS: &[&dyn Toy] = &[
    &sphere::Sphere,
    &needle::Needle,
    &plateau::Plateau,
    &hidden_corner::HiddenCorner,
    &noisy::Noisy,
    &pits::Pits,
    &car_following::CarFollowing,
];
