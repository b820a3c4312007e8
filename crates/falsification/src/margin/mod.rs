//! The smallest disturbance that makes a system violate its requirement.

mod amplitude;
mod attack;
mod attempt;
mod categories;
mod descent;
#[cfg(test)]
mod tests;

use std::ops::{ControlFlow, RangeInclusive};

use mishandle_results::{Level, Norms};
use mishandle_rollout::{Episode, Seed, Space, System};
use mishandle_stl::is_satisfied;

use crate::{FalsificationError, minimize};
pub use amplitude::{distance, norms};
use amplitude::{is_disturbed, offsets};
use attempt::Attempt;
pub use categories::{Narrowed, category_axes, each_category, each_fault};
use descent::{FIRST_STEP, LAST_STEP};

/// Share of the budget after which the axes of the witness are minimized, and share that is left
/// for a second minimization.
const DESCENT: f64 = 0.75;
const LAST: f64 = 0.05;

/// The smallest disturbance that was found, and what was tried.
#[derive(Clone, Debug)]
pub struct Margin {
    /// The violation with the smallest disturbance; `None` if no simulation violates the
    /// requirement.
    pub witness: Option<Witness>,
    /// The amplitudes in the order in which they were tried.
    pub levels: Vec<Level>,
    /// Smallest amplitude of a simulation that started and has no verdict; `None` without one.
    pub smallest_without_verdict: Option<f64>,
    /// The amplitude of the largest disturbance with a verdict.
    pub largest_with_verdict: f64,
    /// Number of all simulations.
    pub simulations: u64,
    /// Whether it was not interrupted.
    pub is_complete: bool,
}

/// A violation and the size of its disturbance.
#[derive(Clone, Debug)]
pub struct Witness {
    /// The simulation.
    pub episode: Episode,
    /// The norms of its disturbance.
    pub norms: Norms,
    /// Number of disturbed axes.
    pub axes: usize,
}

impl Margin {
    /// Allowed numbers of simulations.
    pub const BUDGETS: RangeInclusive<u64> = 1..=1_000_000;

    /// Default of the largest number of simulations.
    pub const BUDGET: u64 = 3000;

    /// Space that is searched by default.
    pub const SPACE: &str = "disturbance";

    /// Returns whether a simulation has a verdict. Without one, the system was not tested.
    pub fn has_verdict(&self) -> bool {
        self.levels.iter().any(|level| level.minimum_robustness.is_some())
    }

    /// Returns the largest amplitude below that of the witness at which a finished search found no
    /// violation, and up to which every simulation that started has a verdict. Their number is
    /// evidence, not a proof, that smaller disturbances are harmless.
    pub fn largest_without_violation(&self) -> Option<Level> {
        let amplitude = |level: &Level| level.amplitude;
        let below = self.witness.as_ref().map_or(f64::INFINITY, |witness| witness.norms.amplitude);
        let below = below.min(self.smallest_without_verdict.unwrap_or(f64::INFINITY));
        let has_passed = |level: &&Level| {
            let has_evidence = level.minimum_robustness.is_some_and(is_satisfied);
            level.is_complete && has_evidence && level.amplitude < below
        };
        // Nothing was tested beyond the largest disturbance that could start.
        let tested =
            |level: Level| Level { amplitude: level.amplitude.min(self.largest_with_verdict), ..level };
        let passed = self.levels.iter().filter(has_passed);
        passed.copied().map(tested).max_by(|a, b| amplitude(a).total_cmp(&amplitude(b)))
    }
}

/// Settings of a [`margin`].
#[derive(Clone, Copy, Debug)]
pub struct MarginSettings {
    /// Seed of the search. A deterministic system is simulated with it, a random one with its
    /// children.
    pub seed: Seed,
    /// Largest number of simulations.
    pub budget: u64,
    /// Whether two simulations of a scenario with different seeds can differ.
    pub is_random: bool,
}

/// Searches for the smallest disturbance that violates the requirement of `system`: an upper bound
/// of its margin, with a witness.
///
/// The disturbed axes are those of the space that have a nominal value and are neither initial
/// state nor categorical. At amplitude a, an axis is at most the fraction a of the way from its
/// nominal value to a bound. Initial states in the space vary within their whole box, categorical
/// axes stay nominal. Random draws keep their random streams. If the system is random, each
/// simulation of the search has a new seed, and only steps from a violation keep its seed.
///
/// The search begins at amplitude 1 with random signs and CMA-ES. A violation there is scaled
/// toward nominal. Then the search continues at amplitudes below the smallest violation, a third
/// below at first and a twentieth at last, in turns from that violation and from random scenarios.
/// If all disturbed axes are discrete, the amplitude is bisected before, and if the scenarios are
/// few, all of them are tried. Three quarters into the budget, [`minimize`] removes as many axes as
/// possible from the witness, and the rest is spent below the result. Before and after that, the
/// witness is bisected toward nominal.
///
/// Without a violation at amplitude 1, the whole budget is spent there; if the system is random, a
/// quarter of it on repeats of the scenarios with the lowest robustness.
///
/// `watch` gets the number of simulations after each batch. It can end the search: the witness is
/// then the one so far.
///
/// # Errors
/// If the space has no disturbed axis, or a simulation cannot be run.
pub fn margin(
    system: &mut dyn System,
    settings: MarginSettings,
    mut watch: impl FnMut(u64) -> ControlFlow<()>,
) -> Result<Margin, FalsificationError> {
    let space = system.space().clone();
    check_margin(settings.budget, &space)?;
    let mut attempt = Attempt::new(system, settings, &mut watch);
    let budget = settings.budget as f64;
    attempt.begin()?;
    attempt.descend((DESCENT * budget) as u64, FIRST_STEP)?;
    attempt.bisect_ray()?;
    attempt.minimize(settings.budget)?;
    let before = attempt.smallest();
    attempt.descend(((1.0 - LAST) * budget) as u64, LAST_STEP)?;
    attempt.bisect_ray()?;
    if attempt.smallest() < before {
        attempt.minimize(settings.budget)?;
        attempt.bisect_ray()?;
    }
    let Attempt {
        levels,
        witness,
        simulations,
        is_interrupted,
        smallest_without_verdict,
        largest_with_verdict,
        ..
    } = attempt;
    Ok(Margin {
        witness: witness.map(|found| Witness::new(&space, found)),
        levels,
        largest_with_verdict,
        smallest_without_verdict: Some(smallest_without_verdict).filter(|amplitude| amplitude.is_finite()),
        simulations,
        is_complete: !is_interrupted,
    })
}

/// Returns whether a space has an axis for a [`margin`]: a start has no size.
pub fn has_margin(space: &Space) -> bool {
    space.axes().iter().any(is_disturbed)
}

/// Checks the budget of a [`margin`] and that its space has a disturbed axis.
///
/// # Errors
/// If not.
pub fn check_margin(budget: u64, space: &Space) -> Result<(), FalsificationError> {
    let (what, value, expected) = if !Margin::BUDGETS.contains(&budget) {
        ("the budget", budget, "from 1 to 1000000")
    } else if !has_margin(space) {
        let expected = "at least 1: an axis with a nominal value whose `kind` is \"model\", \"input\", \"event\" or \
                        \"fault\"; without a `kind`, an axis is a start";
        ("the number of disturbed axes", 0, expected)
    } else {
        return Ok(());
    };
    Err(FalsificationError::InvalidValue { what, value: value.to_string(), expected })
}

impl Witness {
    fn new(space: &Space, episode: Episode) -> Witness {
        let scenario = &episode.request.scenario;
        let axes = offsets(space, scenario).filter(|offset| *offset > 0.0).count();
        Witness { norms: norms(space, scenario), axes, episode }
    }
}
