//! Parts of the robustness on their way from the monitor to the search.

use std::ops::ControlFlow;

use mishandle_falsification::{Falsification, FalsificationError, FalsificationSettings, search_space};
use mishandle_rollout::{AxisKind, Request, Seed, Specification};
use mishandle_search::{SearchOptions, SearchSpace, by_name};
use mishandle_stl::Formula;

const FORMULA: &str = "always[50:200](gap >= 4) or eventually[0:60](closing_speed >= 9 and speed <= 12)";

fn specification() -> Specification {
    Specification::new(Formula::parse(FORMULA).unwrap())
}

/// The space of all axes of car following, and what a search may know of it.
fn spaces() -> (mishandle_rollout::Target, mishandle_rollout::Space, SearchSpace) {
    let target = mishandle_toys::target("toy/car-following").unwrap().unwrap();
    let space = target.space("all").unwrap();
    let steps = target.episode_steps;
    let parts = specification().decomposition(target.control_dt, steps + 1).unwrap();
    let known = search_space(&space, &parts, steps);
    (target, space, known)
}

#[test]
fn the_parts_of_an_episode_compose_its_robustness() {
    let (target, space, known) = spaces();
    let mut system = (target.factory)(&space, &specification()).unwrap();
    let parts = known.parts.unwrap();
    for index in 0..50 {
        let request =
            Request { needs_parts: true, ..Request::new(space.sample(Seed(4), index), Seed(index)) };
        let episode = system.rollout(&[request]).unwrap().remove(0);
        assert_eq!(episode.verdict.parts.len(), parts.ends.len());
        assert_eq!(Some(parts.composition.value(&episode.verdict.parts)), episode.robustness());
    }
}

/// Knots of the acceleration are 5 s apart in 20 s, errors of the gap act in a quarter each.
#[test]
fn knots_begin_to_act_at_the_knot_before_them() {
    let (_, space, known) = spaces();
    let begins = |kind: AxisKind| -> Vec<f64> {
        let axes = space.axes().iter().zip(&known.begins);
        axes.filter(|(axis, _)| axis.kind == kind).map(|(_, begin)| *begin).collect()
    };
    assert_eq!(begins(AxisKind::Input), [0.0, 0.0, 0.25, 0.5, 0.75]);
    assert_eq!(begins(AxisKind::Noise), [0.0, 0.25, 0.5, 0.75]);
    assert!(begins(AxisKind::Model).iter().chain(&begins(AxisKind::Event)).all(|begin| *begin == 0.0));
    assert_eq!(known.parts.unwrap().ends.iter().copied().fold(0.0, f64::max), 1.0);
}

#[test]
fn the_simulations_of_a_search_with_parts_do_not_depend_on_the_batch_size() {
    let (target, space, known) = spaces();
    let points = |batch: usize| {
        let settings = FalsificationSettings { trials: 2, budget: 60, batch, ..Default::default() };
        let known = known.clone();
        let make = move |seed| by_name("portfolio", &known, seed, &SearchOptions::default());
        let mut system = (target.factory)(&space, &specification()).unwrap();
        let mut points = vec![Vec::new(); 2];
        let mut falsification = Falsification::new(settings, &space, make).unwrap();
        falsification
            .run(&mut *system, |batch| {
                for episode in batch.episodes {
                    assert!(episode.request.needs_parts);
                    points[episode.request.trial as usize - 1].push(episode.request.unit_point.clone());
                }
                Ok::<_, FalsificationError>(ControlFlow::Continue(()))
            })
            .unwrap();
        points
    };
    assert_eq!(points(1), points(16));
}
