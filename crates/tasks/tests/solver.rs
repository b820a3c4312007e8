//! Every task has variants of its physics: other bits, and close first seconds.

use mishandle_rollout::{Component, Episode, Noise, Request, Seed, SolverChange, System, Target};
use mishandle_tasks::{Preset, Task, TaskTarget, tasks};

/// Control steps in a second.
const FIRST: usize = 60;

/// Largest difference of a length in the first second, m. A cloth makes millimeters of a start that
/// moves by a micrometer and centimeters of half the step, a rigid object 12 micrometers and a
/// millimeter.
const CLOSE: f64 = 0.05;

fn target(task: &'static dyn Task) -> Target {
    let component = Component {
        role: "controller".into(),
        name: "expert".into(),
        hash: String::new(),
        file_hash: String::new(),
    };
    let controller = task.expert().unwrap();
    let target = TaskTarget::new(task, Preset::Paper, controller, vec![component], Noise::default()).unwrap();
    target.target().unwrap()
}

fn run(system: &mut dyn System, request: &Request) -> Episode {
    system.rollout(std::slice::from_ref(request)).unwrap().remove(0)
}

/// Returns the bits of all signals.
fn bits(episode: &Episode) -> Vec<u64> {
    let trace = &episode.trace;
    (0..trace.names().len()).flat_map(|i| trace.column(i).iter().map(|x| x.to_bits())).collect()
}

/// Returns the largest difference of a length at a sample up to `last`, and its signal. Where an
/// impact comes a step later, a speed differs by all that it changes.
fn difference(target: &Target, a: &Episode, b: &Episode, last: usize) -> (f64, String) {
    let mut largest = (0.0, String::new());
    for (index, signal) in target.signals.iter().enumerate().filter(|(_, signal)| signal.unit == "m") {
        let pairs = a.trace.column(index).iter().zip(b.trace.column(index)).take(last + 1);
        let found = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        if found > largest.0 {
            largest = (found, signal.name.clone());
        }
    }
    largest
}

#[test]
fn every_task_has_variants_of_its_physics_with_other_bits_and_a_close_start() {
    let mut other_colliders = 0;
    for task in tasks() {
        let name = task.definition().name;
        let target = target(task);
        let specification = task.definition().paper.specification().unwrap();
        let space = target.space("starts").unwrap();
        let request = Request::new(space.sample(Seed(1), 0), Seed(3));
        let plain = run(&mut *target.system(&space, &specification).unwrap(), &request);
        let variants = target.solver_systems(&space, &specification).unwrap();
        assert_eq!(
            variants.iter().map(|(change, _)| *change).collect::<Vec<_>>(),
            SolverChange::ALL,
            "{name}"
        );
        for (change, mut system) in variants {
            let changed = run(&mut *system, &request);
            assert_eq!(bits(&changed), bits(&run(&mut *system, &request)), "{name}: equal each time");
            assert_eq!(changed.steps, plain.steps, "{name}");
            let differs = bits(&changed) != bits(&plain);
            let (start, _) = difference(&target, &changed, &plain, 0);
            let (first, signal) = difference(&target, &changed, &plain, FIRST);
            println!(
                "{name} {change:?}: start {start:.1e}, first second {first:.1e} of {signal}, differs {differs}"
            );
            match change {
                SolverChange::HalfStep => {
                    assert!(differs && start == 0.0, "{name}");
                }
                // Not every task has shapes that only the collider of convex shapes can handle.
                SolverChange::OtherCollider => {
                    other_colliders += u32::from(differs);
                    assert!(start == 0.0, "{name}");
                }
                SolverChange::MovedStart => {
                    assert!(differs && start > 0.0 && start < 1e-4, "{name}: {start}");
                }
            }
            assert!(first < CLOSE, "{name}, {change:?}: {signal} differs by {first}");
        }
    }
    assert!(other_colliders > 0);
}
