//! Errors of the runs themselves.

use super::MishandleError;

/// A run is not what its plan says, or gives no answer.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunError {
    /// Something differs between the run and what continues or repeats it.
    #[error("{}: {}{}", whose.fact(), differences.join("; "), whose.way_out())]
    Differs {
        /// The part that differs.
        whose: Compared,
        /// Each difference, with the recorded and the present value.
        differences: Vec<String>,
    },
    /// A recorded simulation differs from the simulation of its plan.
    #[error(
        "{what} {number} of the run differs from {what} {number} of its plan: rows are missing or were added or changed, or \
         another build made the run and must resume it"
    )]
    OtherRequest {
        /// A simulation, or a chunk of a screening.
        what: &'static str,
        /// Its number.
        number: u32,
    },
    /// A recorded simulation is impossible.
    #[error("the run file was changed: {problem}")]
    Changed {
        /// The simulation and the problem.
        problem: String,
    },
    /// The target of a run has other components now.
    #[error("the run was made with the components {recorded}; {target} now has: {found}")]
    Components {
        /// Name of the target.
        target: String,
        /// Roles of the recorded components.
        recorded: String,
        /// Roles of the present components.
        found: String,
    },
    /// The target of a run is not part of this program.
    #[error(
        "the target `{name}` of the run is not part of this program; runs of Python code are replayed and resumed by the \
         Python package (docs/guide/python.md)"
    )]
    ForeignTarget {
        /// Name of the target.
        name: String,
    },
    /// A system returned no episode for a request.
    #[error("the system returned no episode")]
    NoEpisode,
    /// The first simulations of a search all failed.
    #[error(
        "the first {count} simulations have no verdict, so the search stopped; this is the end of the first one: {end}"
    )]
    NothingRuns {
        /// Number of simulations.
        count: u32,
        /// End of the first simulation, with its reason.
        end: String,
    },
}

/// Returns the error of a recorded simulation that is not that of the plan.
pub(crate) fn other_request(what: &'static str, number: u32) -> MishandleError {
    RunError::OtherRequest { what, number }.into()
}

/// Returns the error of a recorded simulation that is impossible.
pub(crate) fn changed(problem: String) -> MishandleError {
    RunError::Changed { problem }.into()
}

/// Part of a run that must stay the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Compared {
    /// The settings on which the scenarios of its search depend.
    Settings,
    /// The parts that its plan describes.
    Plan,
    /// The build that made its rows.
    Build,
    /// A system that is not part of this program.
    System,
}

impl Compared {
    fn fact(self) -> &'static str {
        match self {
            Compared::Settings => "the run was made with other settings",
            Compared::Plan => "the run file does not match",
            Compared::Build => {
                "another build made the run, and its rows would stand beside those of this one"
            }
            Compared::System => {
                "the system is not that of the run, although its hash is the recorded one: the first recorded simulation differs"
            }
        }
    }

    fn way_out(self) -> &'static str {
        match self {
            Compared::Settings => {
                "; a run continues with its own settings only: pass those, or make a new run file"
            }
            Compared::Plan => {
                "; the target, its formulas or its space are others than those of the run, the file was changed, or another build \
                 made it: pass what the run was made with, or make a new run file"
            }
            // Its remedies say how.
            Compared::Build => "",
            Compared::System => {
                "; resume with the code, data and libraries of the run, or make a new run file"
            }
        }
    }
}
