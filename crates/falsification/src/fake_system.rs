//! A system in closed form, which tests searches and campaigns in milliseconds.

use std::sync::Arc;

use mishandle_rollout::{End, Episode, InitialBox, Request, RolloutError, System, Verdict};
use mishandle_stl::Trace;

/// How a simulation of a [`FakeSystem`] goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fate {
    /// It runs to its end and has this robustness.
    Robustness(f64),
    /// It is stopped before the formula is decided.
    Undecided,
    /// It diverges.
    Diverged,
}

/// A [`System`] whose robustness is a function of the request.
///
/// Its episodes have the signal `robustness`, two samples of it, and one control step.
///
/// # Example
/// ```
/// use mishandle_falsification::{FakeSystem, Fate};
/// use mishandle_rollout::{Axis, InitialBox, Request, Seed, System};
///
/// let axis = Axis { name: "x".into(), unit: "m".into(), low: -1.0, high: 1.0 };
/// let initial_box = InitialBox::new(vec![axis]).unwrap();
/// let mut system = FakeSystem::new(initial_box, |request| Fate::Robustness(request.x0[0]));
/// let episodes = system.rollout(&[Request { x0: vec![0.25], seed: Seed(0) }]).unwrap();
/// assert_eq!(episodes[0].verdict.robustness, Some(0.25));
/// ```
pub struct FakeSystem {
    initial_box: InitialBox,
    batch_size: usize,
    fate: Box<dyn Fn(&Request) -> Fate>,
    signals: Arc<[String]>,
    simulations: usize,
}

impl FakeSystem {
    /// A system with these initial configurations, whose simulations go as `fate` says, 32 in a batch.
    pub fn new(initial_box: InitialBox, fate: impl Fn(&Request) -> Fate + 'static) -> FakeSystem {
        FakeSystem {
            initial_box,
            batch_size: 32,
            fate: Box::new(fate),
            signals: Arc::from(["robustness".to_string()]),
            simulations: 0,
        }
    }

    /// The same system, asked for `batch_size` simulations at once.
    pub fn with_batch_size(self, batch_size: usize) -> FakeSystem {
        FakeSystem { batch_size, ..self }
    }

    /// How many simulations it has run.
    pub fn simulations(&self) -> usize {
        self.simulations
    }

    fn episode(&self, request: &Request) -> Episode {
        let (robustness, end) = match (self.fate)(request) {
            Fate::Robustness(rho) => (Some(rho), End::Completed),
            Fate::Undecided => (None, End::Stopped { step: 1 }),
            Fate::Diverged => (None, End::Diverged { step: 1 }),
        };
        let mut trace = Trace::with_capacity(self.signals.clone(), 2);
        (0..2).for_each(|_| trace.push(&[robustness.unwrap_or(0.0)]));
        Episode {
            x0: request.x0.clone(),
            seed: request.seed,
            trace,
            verdict: Verdict {
                robustness,
                success: robustness,
                strict: robustness,
                dangerous_steps: usize::from(robustness.is_some_and(|rho| rho < 0.0)),
                completion_step: robustness.filter(|rho| *rho > 0.0).map(|_| 1),
            },
            total_reward: 0.0,
            end,
        }
    }
}

impl System for FakeSystem {
    fn initial_box(&self) -> &InitialBox {
        &self.initial_box
    }

    fn batch_size(&self) -> usize {
        self.batch_size
    }

    fn rollout(&mut self, requests: &[Request]) -> Result<Vec<Episode>, RolloutError> {
        requests.iter().try_for_each(|request| self.initial_box.check(&request.x0))?;
        self.simulations += requests.len();
        Ok(requests.iter().map(|request| self.episode(request)).collect())
    }
}
