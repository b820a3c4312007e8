//! A system for tests whose robustness is a function of the request.

use std::sync::Arc;

use mishandle_rollout::{Episode, EpisodeEnd, Request, RolloutError, Space, System, Verdict};
use mishandle_stl::{Trace, is_satisfied, is_violated};

/// The outcome of a simulation of a [`FunctionSystem`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SimulatedEnd {
    /// The simulation completes with this robustness.
    Robustness(f64),
    /// The simulation stops before the formula is decided.
    Undecided,
    /// The simulation diverges.
    Diverged,
    /// The simulation cannot start.
    InvalidStart,
}

/// A [`System`] whose robustness is a function of the request.
///
/// Its episodes have one control step, and so two samples, of the signal `robustness`.
///
/// # Example
/// ```
/// use mishandle_rollout::{Axis, Request, Seed, Space, System};
/// use mishandle_toys::{SimulatedEnd, FunctionSystem};
///
/// let space = Space::new("starts", vec![Axis::start("x", "m", -1.0, 1.0)]).unwrap();
/// let mut system = FunctionSystem::new(space, |request| SimulatedEnd::Robustness(request.scenario.get(0).unwrap()));
/// let episodes = system.rollout(&[Request::new([0.25], Seed(0))]).unwrap();
/// assert_eq!(episodes[0].verdict.robustness, Some(0.25));
/// ```
pub struct FunctionSystem {
    space: Space,
    outcome: Box<dyn Fn(&Request) -> SimulatedEnd>,
    signals: Arc<[String]>,
    simulations: usize,
}

impl FunctionSystem {
    /// Creates a system with this space. `outcome` returns the outcome of each simulation.
    pub fn new(space: Space, outcome: impl Fn(&Request) -> SimulatedEnd + 'static) -> FunctionSystem {
        let signals = Arc::from(["robustness".to_string()]);
        FunctionSystem { space, outcome: Box::new(outcome), signals, simulations: 0 }
    }

    /// Returns the number of completed simulations.
    pub fn simulations(&self) -> usize {
        self.simulations
    }

    fn episode(&self, request: &Request) -> Episode {
        let (robustness, end) = match (self.outcome)(request) {
            SimulatedEnd::Robustness(rho) => (Some(rho), EpisodeEnd::Completed),
            SimulatedEnd::Undecided => (None, EpisodeEnd::Stopped { step: 1 }),
            SimulatedEnd::Diverged => (None, EpisodeEnd::Diverged { step: 1 }),
            SimulatedEnd::InvalidStart => (None, EpisodeEnd::InvalidScenario),
        };
        let mut trace = Trace::with_capacity(self.signals.clone(), 2);
        (0..2).for_each(|_| trace.push(&[robustness.unwrap_or(0.0)]));
        Episode {
            request: request.clone(),
            end,
            steps: 1,
            verdict: Verdict {
                robustness,
                success: robustness,
                strict: robustness,
                dangerous_steps: robustness.map(|rho| usize::from(is_violated(rho))),
                completion_step: robustness.filter(|rho| is_satisfied(*rho)).map(|_| 1),
                ..Verdict::default()
            },
            reason: String::new(),
            total_reward: 0.0,
            trace,
            trace_digest: None,
        }
    }
}

impl System for FunctionSystem {
    fn space(&self) -> &Space {
        &self.space
    }

    fn rollout(&mut self, requests: &[Request]) -> Result<Vec<Episode>, RolloutError> {
        requests.iter().try_for_each(|request| self.space.check(&request.scenario))?;
        self.simulations += requests.len();
        Ok(requests.iter().map(|request| self.episode(request)).collect())
    }
}
