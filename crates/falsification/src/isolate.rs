//! Finds which axes of a counterexample cause the failure, with few simulations.

use std::ops::ControlFlow;

use mishandle_rollout::{Episode, Request, System};

use crate::FalsificationError;
use crate::bound::{inside_bounds, on_bounds};
use crate::minimize::{Search, Stop, any_violation, lowest_violation};
use crate::repeat::repeat_seeds;

/// Simulations of the result with other seeds, if the target is random.
const FRESH: u64 = 10;

/// Returns the largest number of simulations of [`isolate`] for a trial with this budget: 30, or a
/// tenth of a large budget.
///
/// # Example
/// ```
/// use mishandle_falsification::isolation_budget;
/// assert_eq!((isolation_budget(300), isolation_budget(1000)), (30, 100));
/// ```
pub fn isolation_budget(budget: u32) -> u64 {
    (u64::from(budget) / 10).max(30)
}

/// Simulates which axes of a failure cause it, and moves it toward nominal, with at most `budget`
/// simulations:
///
/// 1. The nominal scenario, and each axis alone with its value of the failure. An axis that has an
///    effect only with others, such as the magnitude of a fault, keeps these. If one of the
///    scenarios fails, the search continues from the one with the lowest robustness.
/// 2. The failure with each axis alone at its nominal value.
/// 3. If no axis alone fails, as many axes as possible go to nominal.
/// 4. The rest moves toward nominal as in [`minimize`](crate::minimize()).
///
/// Steps 1 and 2 are left out if they take more than the budget. If the result is exactly on
/// bounds of axes, a few more simulations move them inside by a millionth of their width, together
/// and then one by one, which shows whether the failure holds only there. All simulations have the
/// seed of the failure. If the target `is_random`, a part of the budget repeats the result with
/// other seeds. The simulations are the result: a journal of the system keeps them.
///
/// `watch` gets the number of simulations after each batch, and can end them. Returns whether they
/// came to their end.
///
/// # Errors
/// If a simulation cannot be run.
pub fn isolate(
    system: &mut dyn System,
    failure: &Episode,
    budget: u64,
    is_random: bool,
    mut watch: impl FnMut(u64) -> ControlFlow<()>,
) -> Result<bool, FalsificationError> {
    let own = if is_random { budget - FRESH } else { budget };
    let mut search = Search::new(system, failure.clone(), own, &any_violation, &mut watch);
    match run(&mut search, own) {
        Ok(()) | Err(Stop::Budget) => {}
        Err(Stop::Interrupted) => return Ok(false),
        Err(Stop::Error(error)) => return Err(*error),
    }
    let best = search.best;
    let mut done = search.simulations;
    done += try_inside(system, &best)?;
    if watch(done).is_break() {
        return Ok(false);
    }
    if is_random {
        let request = |seed| Request { seed, unit_point: Vec::new(), ..best.request.clone() };
        let requests: Vec<Request> = repeat_seeds(best.request.seed, FRESH).map(request).collect();
        system.rollout(&requests)?;
        return Ok(watch(done + FRESH).is_continue());
    }
    Ok(true)
}

/// Simulates a failure on bounds with these axes moved inside: all of them, and if that passes,
/// each of them alone. Returns the number of simulations.
fn try_inside(system: &mut dyn System, failure: &Episode) -> Result<u64, FalsificationError> {
    let space = system.space().clone();
    let axes = on_bounds(&space, &failure.request.scenario);
    if axes.is_empty() {
        return Ok(0);
    }
    let request = |axes: &[usize]| Request {
        scenario: inside_bounds(&space, &failure.request.scenario, axes),
        unit_point: Vec::new(),
        ..failure.request.clone()
    };
    let together = system.rollout(&[request(&axes)])?;
    if together.iter().any(Episode::is_violated) || axes.len() == 1 {
        return Ok(1);
    }
    let alone: Vec<Request> = axes.iter().map(|axis| request(&[*axis])).collect();
    system.rollout(&alone)?;
    Ok(1 + alone.len() as u64)
}

fn run<W: FnMut(u64) -> ControlFlow<()>>(search: &mut Search<'_, W>, budget: u64) -> Result<(), Stop> {
    let off = search.off_axes();
    let n = off.len() as u64;
    if n == 0 {
        return Ok(());
    }
    let mut alone_fails = false;
    if 2 * n < budget {
        let only = |kept: &[usize]| {
            let others: Vec<usize> = off.iter().copied().filter(|axis| !kept.contains(axis)).collect();
            search.at_nominal(&others)
        };
        let alone = off.iter().map(|axis| only(&search.with_needed(*axis)));
        let alone: Vec<_> = std::iter::once(only(&[])).chain(alone).collect();
        let without: Vec<_> = off.iter().map(|axis| search.at_nominal(&[*axis])).collect();
        let mut alone = search.simulate(&alone)?;
        let without = search.simulate(&without)?;
        // The nominal scenario comes first: nothing is nearer to it.
        if alone.first().is_some_and(Episode::is_violated) {
            alone.truncate(1);
        }
        if let Some(least) = lowest_violation(alone) {
            (search.best, alone_fails) = (least, true);
        } else if let Some(least) = lowest_violation(without) {
            search.best = least;
        }
    }
    if !alone_fails {
        search.remove_groups()?;
    }
    search.move_all()
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;
    use std::rc::Rc;

    use mishandle_rollout::{Axis, Scenario, Seed, Space};
    use mishandle_stl::is_violated;
    use mishandle_toys::{FunctionSystem, SimulatedEnd};

    use super::*;

    /// Isolates a failure of ten axes from 0 (nominal) to 1, and returns the simulated values.
    fn simulated(at: [f64; 10], robustness: impl Fn(&[f64]) -> f64 + Copy + 'static) -> Vec<(Vec<f64>, f64)> {
        let axis = |index| Axis { nominal: Some(0.0), ..Axis::start(&format!("x{index}"), "", 0.0, 1.0) };
        let axes = (0..10).map(axis);
        let space = Space::new("starts", axes.collect()).unwrap();
        let rows = Rc::new(RefCell::new(Vec::new()));
        let kept = Rc::clone(&rows);
        let mut system = FunctionSystem::new(space, move |request: &Request| {
            let values: Vec<f64> = request.scenario.values().iter().map(|value| value.unwrap()).collect();
            let found = robustness(&values);
            kept.borrow_mut().push((values, found));
            SimulatedEnd::Robustness(found)
        });
        let failure = system.rollout(&[Request::new(Scenario::from(at), Seed(3))]).unwrap().remove(0);
        rows.borrow_mut().clear();
        let is_complete = isolate(&mut system, &failure, 30, false, |_| ControlFlow::Continue(())).unwrap();
        assert!(is_complete && rows.borrow().len() <= 30 + 1 + at.len());
        rows.take()
    }

    fn nearest(rows: &[(Vec<f64>, f64)]) -> &[f64] {
        let off = |values: &[f64]| values.iter().filter(|x| **x != 0.0).count();
        let size = |values: &[f64]| (off(values), values.iter().sum::<f64>());
        let failing = rows.iter().filter(|(_, rho)| is_violated(*rho));
        let nearest = failing.min_by(|a, b| size(&a.0).partial_cmp(&size(&b.0)).unwrap());
        &nearest.unwrap().0
    }

    #[test]
    fn a_corner_of_ten_axes_becomes_the_one_axis_that_fails() {
        let rows = simulated([1.0; 10], |x| 0.5 - x[3]);
        let found = nearest(&rows);
        assert!(found[3] > 0.5 && found[3] < 0.53, "{found:?}");
        assert_eq!(found.iter().filter(|x| **x != 0.0).count(), 1);
    }

    #[test]
    fn two_axes_that_fail_only_together_stay() {
        let rows = simulated([1.0; 10], |x| 1.5 - x[3] - x[7]);
        let found = nearest(&rows);
        assert_eq!(found.iter().filter(|x| **x != 0.0).count(), 2, "{found:?}");
        assert!(found[3] + found[7] > 1.5);
    }

    #[test]
    fn a_failure_on_a_bound_is_moved_inside() {
        let inside = |rows: &[(Vec<f64>, f64)]| {
            let is_near = |x: &f64| *x > 0.999_99 && *x < 1.0;
            let moved = |x: &[f64]| x.iter().filter(|x| is_near(x)).count();
            rows.iter().map(|(x, _)| moved(x)).filter(|n| *n > 0).collect::<Vec<_>>()
        };
        let on_two = |x: &[f64]| if x[3] >= 1.0 && x[7] > 0.9 { -1.0 } else { 1.0 };
        let two = std::array::from_fn(|axis| if axis == 3 || axis == 7 { 1.0 } else { 0.0 });
        let rows = simulated(two, on_two);
        let found = nearest(&rows);
        assert!(found[3] == 1.0 && found[7] < 1.0, "{found:?}");
        assert_eq!(inside(&rows), [1], "the other axis is no longer on its bound");
        let corner = |x: &[f64]| if x[3] >= 1.0 && x[7] >= 1.0 { -1.0 } else { 1.0 };
        assert_eq!(inside(&simulated(two, corner)), [2, 1, 1]);
        // Five axes stay on their bounds, and only one of them decides.
        let far = |x: &[f64]| x[4..8].iter().sum::<f64>() > 3.99;
        let five = std::array::from_fn(|axis| if (3..8).contains(&axis) { 1.0 } else { 0.0 });
        let rows = simulated(five, move |x: &[f64]| if x[3] >= 1.0 && far(x) { -1.0 } else { 1.0 });
        let found = inside(&rows);
        assert!(
            found[0] == found.len() - 1 && found[1..].iter().all(|n| *n == 1),
            "all together, then each alone"
        );
        assert_eq!(inside(&simulated([0.9; 10], |x| 0.5 - x[3])), Vec::<usize>::new());
    }
}
