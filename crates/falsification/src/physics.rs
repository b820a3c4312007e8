//! Checks that failures do not depend on the solver of the physics.

use std::ops::ControlFlow;

use mishandle_results as results;
use mishandle_results::{PhysicsCheck, SolverSimulation};
use mishandle_rollout::{Episode, Request, SolverChange, SolverSystem};

use crate::FalsificationError;
use crate::repeat::BATCH;

/// Checks of the physics of the failures of a target. Each failure is simulated once under each
/// change, however often it is requested.
pub struct PhysicsChecks {
    systems: Vec<SolverSystem>,
    known: Vec<(Request, PhysicsCheck)>,
    simulations: u64,
}

/// The failure nearest to nominal that does not depend on the solver.
#[derive(Clone, Debug, PartialEq)]
pub struct Survivor {
    /// Its index.
    pub index: usize,
    /// Its check. If it depends on the solver, so does the found failure.
    pub physics: PhysicsCheck,
    /// The failures that were looked at, in order, with their checks.
    pub checked: Vec<(usize, PhysicsCheck)>,
}

impl PhysicsChecks {
    /// Checks with these systems: [`Target::solver_systems`](mishandle_rollout::Target::solver_systems).
    pub fn new(systems: Vec<SolverSystem>) -> PhysicsChecks {
        PhysicsChecks { systems, known: Vec::new(), simulations: 0 }
    }

    /// Returns whether the target has changes to check.
    pub fn are_possible(&self) -> bool {
        !self.systems.is_empty()
    }

    /// Returns the number of simulations so far.
    pub fn simulations(&self) -> u64 {
        self.simulations
    }

    /// Returns the largest number of simulations that check this number of failures.
    pub fn most(failures: u64) -> u64 {
        SolverChange::ALL.len() as u64 * failures
    }

    /// Returns the largest number of simulations of [`nearest_survivor`](Self::nearest_survivor)
    /// for this number of failures: its ends and the steps of a bisection between them.
    pub fn most_to_go_back(failures: u64) -> u64 {
        let steps = failures.saturating_sub(1).checked_next_power_of_two().map_or(64, u64::trailing_zeros);
        PhysicsChecks::most(failures.min(2) + u64::from(steps))
    }

    /// Simulates failures under each change, a batch for each. A failure has its own scenario and
    /// seed, and runs to its end. Returns `None` if `watch`, which gets the number of simulations,
    /// ends the checks.
    ///
    /// # Errors
    /// If a simulation cannot be run.
    pub fn check(
        &mut self,
        failures: &[Request],
        watch: &mut dyn FnMut(u64) -> ControlFlow<()>,
    ) -> Result<Option<Vec<PhysicsCheck>>, FalsificationError> {
        let mut new: Vec<Request> = Vec::new();
        for failure in failures {
            if !self.is_known(failure) && !new.iter().any(|other| is_same(other, failure)) {
                new.push(Request { trial: failure.trial, number: failure.number, ..plain(failure) });
            }
        }
        for requests in new.chunks(BATCH) {
            let mut found: Vec<Vec<SolverSimulation>> = vec![Vec::new(); requests.len()];
            for (change, system) in &mut self.systems {
                let episodes = system.rollout(requests)?;
                let returned = episodes.len();
                if returned != requests.len() {
                    return Err(FalsificationError::EpisodeCount { requested: requests.len(), returned });
                }
                for (simulations, episode) in found.iter_mut().zip(&episodes) {
                    simulations.push(simulation(*change, episode));
                }
                self.simulations += returned as u64;
                if watch(self.simulations).is_break() {
                    return Ok(None);
                }
            }
            let checks = found.into_iter().map(PhysicsCheck::new);
            self.known.extend(requests.iter().cloned().zip(checks));
        }
        Ok(Some(failures.iter().filter_map(|failure| self.of(failure)).collect()))
    }

    /// Returns the failure nearest to nominal that survives each change: see [`nearest_survivor`].
    /// Returns `None` if `watch` ends the checks.
    ///
    /// # Errors
    /// If a simulation cannot be run.
    pub fn nearest_survivor(
        &mut self,
        failures: &[Request],
        watch: &mut dyn FnMut(u64) -> ControlFlow<()>,
    ) -> Result<Option<Survivor>, FalsificationError> {
        nearest_survivor(failures.len(), |index| {
            Ok(self.check(&failures[index..=index], watch)?.and_then(|mut found| found.pop()))
        })
    }

    fn is_known(&self, failure: &Request) -> bool {
        self.known.iter().any(|(known, _)| is_same(known, failure))
    }

    fn of(&self, failure: &Request) -> Option<PhysicsCheck> {
        self.known.iter().find(|(known, _)| is_same(known, failure)).map(|(_, check)| check.clone())
    }
}

/// Returns the failure nearest to nominal that survives each change, of this number of failures,
/// which begin with the one nearest to nominal and end with the one that was found. `check` returns
/// the check of one of them; it is `None` as soon as a check is missing.
///
/// If the nearest one depends on the solver and the found one does not, it bisects between them. If
/// the found one depends on the solver, too, the result is the nearest one.
///
/// # Errors
/// If a check fails.
pub fn nearest_survivor<E>(
    failures: usize,
    mut check: impl FnMut(usize) -> Result<Option<PhysicsCheck>, E>,
) -> Result<Option<Survivor>, E> {
    let mut checked = Vec::new();
    let mut check = |index: usize| -> Result<Option<PhysicsCheck>, E> {
        let found = check(index)?;
        checked.extend(found.clone().map(|found| (index, found)));
        Ok(found)
    };
    let Some(nearest) = check(0)? else { return Ok(None) };
    let mut depends = 0;
    let mut survives = failures.saturating_sub(1);
    let mut survivor = nearest.clone();
    if nearest.depends_on_solver && survives > 0 {
        let Some(found) = check(survives)? else { return Ok(None) };
        if found.depends_on_solver {
            return Ok(Some(Survivor { index: 0, physics: nearest, checked }));
        }
        survivor = found;
        while survives - depends > 1 {
            let middle = depends.midpoint(survives);
            let Some(found) = check(middle)? else { return Ok(None) };
            if found.depends_on_solver {
                depends = middle;
            } else {
                (survives, survivor) = (middle, found);
            }
        }
    } else {
        survives = 0;
    }
    Ok(Some(Survivor { index: survives, physics: survivor, checked }))
}

/// Describes a check: `the violation remains with half the physics step (robustness -0.0122), ...`,
/// or `depends on the solver: ...`.
pub fn physics_text(check: &PhysicsCheck) -> String {
    let named = |simulation: &SolverSimulation| {
        let change = simulation.change.words();
        match simulation.robustness {
            Some(robustness) => format!("{change} (robustness {:.4})", robustness.0),
            None => format!("{change} (no verdict)"),
        }
    };
    let list = |simulations: &mut dyn Iterator<Item = &SolverSimulation>| {
        let named: Vec<String> = simulations.map(named).collect();
        match named.split_last() {
            Some((last, [])) => last.clone(),
            Some((last, others)) => format!("{} and {last}", others.join(", ")),
            None => String::new(),
        }
    };
    let mut remaining = check.simulations.iter().filter(|simulation| simulation.violated == Some(true));
    if check.depends_on_solver {
        let remaining = list(&mut remaining);
        let also = if remaining.is_empty() { remaining } else { format!("; it remains with {remaining}") };
        format!("depends on the solver: the violation vanishes with {}{also}", list(&mut check.vanishing()))
    } else {
        format!("the violation remains with {}", list(&mut remaining))
    }
}

/// Returns the request of the scenario and seed of a failure alone.
fn plain(failure: &Request) -> Request {
    Request::new(failure.scenario.clone(), failure.seed)
}

fn is_same(a: &Request, b: &Request) -> bool {
    a.seed == b.seed && a.scenario.is_same(&b.scenario)
}

fn simulation(change: SolverChange, episode: &Episode) -> SolverSimulation {
    let robustness = episode.robustness();
    SolverSimulation {
        change: match change {
            SolverChange::HalfStep => results::SolverChange::HalfStep,
            SolverChange::OtherCollider => results::SolverChange::OtherCollider,
            SolverChange::MovedStart => results::SolverChange::MovedStart,
        },
        robustness: robustness.map(Into::into),
        violated: robustness.map(|_| episode.is_violated()),
    }
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;
    use std::rc::Rc;

    use mishandle_rollout::{Axis, Seed, Space, System};
    use mishandle_toys::{FunctionSystem, SimulatedEnd};

    use super::*;

    /// Changes under which x fails from a bound of each on; a negative bound is a simulation
    /// without a verdict. Keeps what is simulated.
    fn checks(bounds: [f64; 3]) -> (PhysicsChecks, Rc<RefCell<Vec<f64>>>) {
        let simulated = Rc::new(RefCell::new(Vec::new()));
        let systems = SolverChange::ALL.into_iter().zip(bounds).map(|(change, bound)| {
            let space = Space::new("starts", vec![Axis::start("x", "m", 0.0, 100.0)]).unwrap();
            let simulated = simulated.clone();
            let system = FunctionSystem::new(space, move |request: &Request| {
                assert!(request.stop_threshold.is_none() && !request.needs_parts);
                let x = request.scenario.get(0).unwrap();
                simulated.borrow_mut().push(x);
                if bound < 0.0 { SimulatedEnd::Diverged } else { SimulatedEnd::Robustness(bound - x) }
            });
            (change, Box::new(system) as Box<dyn System>)
        });
        (PhysicsChecks::new(systems.collect()), simulated)
    }

    fn failures(n: usize) -> Vec<Request> {
        (1..=n).map(|x| Request { stop_threshold: Some(0.5), ..Request::new([x as f64], Seed(1)) }).collect()
    }

    fn survivor(bounds: [f64; 3], n: usize) -> Survivor {
        let (mut checks, _) = checks(bounds);
        let found = checks.nearest_survivor(&failures(n), &mut |_| ControlFlow::Continue(())).unwrap();
        assert!(checks.simulations() <= PhysicsChecks::most_to_go_back(n as u64), "{n}");
        found.unwrap()
    }

    #[test]
    fn each_simulation_is_named_and_a_violation_that_vanishes_in_one_depends_on_the_solver() {
        let (mut checks, simulated) = checks([0.5, 2.5, 0.5]);
        let found = checks.check(&failures(3), &mut |_| ControlFlow::Continue(())).unwrap().unwrap();
        assert_eq!(
            found.iter().map(|check| check.depends_on_solver).collect::<Vec<_>>(),
            [true, true, false]
        );
        assert_eq!(
            physics_text(&found[1]),
            "depends on the solver: the violation vanishes with another collision algorithm (robustness 0.5000); it remains with half \
             the physics step (robustness -1.5000) and the start moved by 1e-6 m or rad (robustness -1.5000)"
        );
        let [half, other, moved] = found[1].simulations[..] else { panic!("three simulations") };
        assert_eq!((half.change, half.robustness.unwrap().0), (results::SolverChange::HalfStep, -1.5));
        assert_eq!((other.change, other.violated), (results::SolverChange::OtherCollider, Some(false)));
        assert_eq!((moved.change, moved.violated), (results::SolverChange::MovedStart, Some(true)));
        assert_eq!((checks.simulations(), simulated.borrow().len()), (9, 9));
        // A failure that is known is not simulated again.
        checks.check(&failures(2), &mut |_| ControlFlow::Continue(())).unwrap();
        assert_eq!(simulated.borrow().len(), 9);
        let stopped = checks.check(&failures(4), &mut |_| ControlFlow::Break(())).unwrap();
        assert_eq!((stopped, simulated.borrow().len()), (None, 10));
    }

    #[test]
    fn a_simulation_without_a_verdict_confirms_nothing() {
        let found = survivor([0.5, 0.5, -1.0], 1);
        assert!(found.physics.depends_on_solver);
        assert_eq!((found.index, found.physics.simulations[2].violated), (0, None));
    }

    #[test]
    fn a_minimal_failure_goes_back_until_it_survives_all_changes_and_no_further() {
        for n in 1..40 {
            for bound in 0..=n {
                let found = survivor([0.5, bound as f64 + 0.5, 0.5], n);
                if bound == n {
                    assert!(found.physics.depends_on_solver && found.index == 0, "the found one depends");
                    continue;
                }
                // Those up to the bound pass with the other collider.
                assert_eq!((found.index, found.physics.depends_on_solver), (bound, false), "{n} {bound}");
                assert_eq!(found.checked[0].0, 0);
                assert!(found.checked.contains(&(bound, found.physics.clone())));
            }
        }
        assert_eq!(survivor([0.5; 3], 30).checked.len(), 1, "one that survives is the only one checked");
    }
}
