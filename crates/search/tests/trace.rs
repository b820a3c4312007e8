//! Laws of `portfolio` with observations that have parts.

use mishandle_search::Composition::{Max, Min, Part};
use mishandle_search::{Coordinate, Observation, Parts, Search, SearchOptions, SearchSpace, by_name};

/// Two signals: the first is driven by coordinates 0 and 1, the second by all. They end at 1/2 and
/// 1; coordinates 2 and 3 act from 1/2.
fn space() -> SearchSpace {
    let composition = Max(vec![Part(0), Min(vec![Part(1), Part(2)])]);
    SearchSpace {
        begins: vec![0.0, 0.0, 0.5, 0.5],
        parts: Some(Parts { ends: vec![0.5, 0.5, 1.0], signals: vec![0, 1, 1], composition }),
        ..SearchSpace::from(&[
            Coordinate::Continuous,
            Coordinate::Integer { levels: 5 },
            Coordinate::Continuous,
            Coordinate::Categorical { levels: 3 },
        ])
    }
}

fn observation(u: &[f64], limit: f64) -> Observation {
    let first = 1e3 * (u[0] + u[1] - 1.0);
    let early = limit - u[0];
    let late = 2.0 * limit - u[0] - u[2] - u[3] + u[1];
    let parts = vec![first, early, late];
    Observation { robustness: first.max(early.min(late)), parts }
}

fn make(options: &SearchOptions, space: &SearchSpace) -> Box<dyn Search> {
    by_name("portfolio", space, 5, options).expect("a space and options")
}

#[test]
fn parts_are_needed_only_if_the_space_has_several_and_the_option_is_on() {
    let default = SearchOptions::new();
    assert!(make(&default, &space()).needs_parts());
    assert!(!make(&SearchOptions::new().with("trace", false), &space()).needs_parts());
    let without = SearchSpace { parts: None, ..space() };
    assert!(!make(&default, &without).needs_parts());
    let one = Parts { ends: vec![1.0], signals: vec![0], composition: Part(0) };
    assert!(!make(&default, &SearchSpace { parts: Some(one), ..space() }).needs_parts());
    let windows = Parts { signals: vec![0; 3], ..space().parts.expect("parts") };
    let windows = SearchSpace { parts: Some(windows), ..space() };
    assert!(!make(&default, &windows).needs_parts());
}

/// Parts that never arrive leave the search as it is without them.
#[test]
fn without_parts_the_points_are_those_of_a_search_without_the_source() {
    let mut search = make(&SearchOptions::new(), &space());
    let mut plain = make(&SearchOptions::new().with("trace", false), &space());
    for _ in 0..150 {
        let u = search.ask().expect("a point");
        let v = plain.ask().expect("a point");
        assert_eq!(u, v);
        let robustness = Observation::from(observation(&u, 2.0).robustness);
        search.tell(&u, &robustness).expect("a pending point");
        plain.tell(&v, &robustness).expect("a pending point");
    }
}

/// A simulation that ends early may have no parts.
#[test]
fn a_search_of_parts_lets_no_simulation_end_early() {
    let mut search = make(&SearchOptions::new(), &space());
    let mut plain = make(&SearchOptions::new().with("trace", false), &space());
    let mut n_finite = 0;
    for search in [&mut search, &mut plain] {
        for _ in 0..60 {
            let u = search.ask().expect("a point");
            n_finite += usize::from(search.stop_threshold(&u).is_finite());
            search.tell(&u, &observation(&u, 2.0)).expect("a pending point");
        }
        assert_eq!(n_finite > 0, !search.needs_parts());
    }
}

#[test]
fn the_points_do_not_depend_on_the_batch_sizes() {
    let points = |batch: usize| {
        let mut search = make(&SearchOptions::new(), &space());
        let mut points = Vec::new();
        while points.len() < 150 {
            let round = search.ask_batch(batch);
            for u in round {
                search.tell(&u, &observation(&u, 2.0)).expect("a pending point");
                points.push(u);
            }
        }
        points.truncate(150);
        points
    };
    assert_eq!(points(1), points(7));
}

/// Infinite parts, as of windows after the end of an episode, and constant ones.
#[test]
fn parts_without_finite_values_leave_the_search_working() {
    let mut search = make(&SearchOptions::new(), &space());
    for i in 0..100 {
        let u = search.ask().expect("a point");
        let parts = vec![f64::INFINITY, if i % 2 == 0 { f64::NEG_INFINITY } else { 1.0 }, 1.0];
        let robustness = if i % 3 == 0 { 1.0 } else { u[0] + 1.0 };
        search.tell(&u, &Observation { robustness, parts }).expect("a pending point");
        assert!(u.iter().all(|x| (0.0..=1.0).contains(x)));
    }
}
