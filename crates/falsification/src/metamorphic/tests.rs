use mishandle_rollout::{Axis, AxisKind, AxisValues, Space};
use mishandle_toys::{FunctionSystem, SimulatedEnd};

use super::*;

const SEED: Seed = Seed(11);

fn x_and_y(low: f64, high: f64) -> Space {
    let axes = vec![Axis::start("x", "m", low, high), Axis::start("y", "m", -1.0, 1.0)];
    Space::new("starts", axes).expect("a space")
}

/// The distance from a point, less a radius that a fifth of the square is within.
fn distance(x: f64, y: f64) -> f64 {
    (x - 0.3).hypot(y + 0.4) - 0.5
}

fn relation(change: AxisChange, holds: OutputRelation) -> Relation {
    Relation { name: "r".to_string(), changes: vec![(0, change)], holds }
}

fn settings(pairs: u64) -> MetamorphicSettings {
    MetamorphicSettings { pairs, batch: 64 }
}

/// Tests relations of a function of x and y.
fn test_of(
    sources: Space,
    space: Space,
    relations: &[Relation],
    settings: MetamorphicSettings,
    outcome: impl Fn(f64, f64) -> SimulatedEnd + 'static,
) -> Metamorphic {
    let value = |request: &Request, index: usize| {
        request.scenario.values().get(index).copied().flatten().unwrap_or(0.0)
    };
    let of_request = move |request: &Request| outcome(value(request, 0), value(request, 1));
    let mut system = FunctionSystem::new(space.clone(), of_request);
    let cases = Cases::new(sources, space, SEED);
    metamorphic(&mut system, &cases, relations, settings, |_| ControlFlow::Continue(())).expect("a result")
}

fn test(relations: &[Relation], settings: MetamorphicSettings) -> Metamorphic {
    let space = x_and_y(-1.0, 1.0);
    test_of(space.clone(), space, relations, settings, |x, y| SimulatedEnd::Robustness(distance(x, y)))
}

#[test]
fn a_change_of_nothing_breaks_no_relation() {
    let identities = [
        relation(AxisChange::Offset(0.0), OutputRelation::SameVerdict),
        relation(AxisChange::Factor(1.0), OutputRelation::RobustnessWithin(0.0)),
    ];
    // The seed of both cases is the same, so noise that depends on it is, too.
    let space = x_and_y(-1.0, 1.0);
    let noisy = |request: &Request| SimulatedEnd::Robustness(f64::from(request.seed.0 as u32) - 2e9);
    let mut system = FunctionSystem::new(space.clone(), noisy);
    let cases = Cases::new(space.clone(), space, SEED);
    let watch = |_| ControlFlow::Continue(());
    let found = metamorphic(&mut system, &cases, &identities, settings(200), watch).expect("a result");
    for relation in &found.relations {
        let VerdictCounts { both_satisfied, both_violated, .. } = relation.verdicts;
        assert!(both_satisfied > 0 && both_violated > 0);
        assert_eq!((relation.broken, relation.pairs, both_satisfied + both_violated), (0, 200, 200));
    }
    // Sources once, then the follow-up cases of both relations; there is nothing to bisect.
    assert_eq!(found.simulations, 600);
    assert_eq!(found.trials().collect::<Vec<_>>(), [1, 2, 3]);
}

#[test]
fn the_broken_pairs_are_those_of_a_brute_force_search() {
    let pairs = 2000;
    let found = test(&[relation(AxisChange::Offset(0.25), OutputRelation::SameVerdict)], settings(pairs));
    let found = &found.relations[0];
    let mut broken = Vec::new();
    let mut out_of_bounds = 0;
    for index in 0..pairs {
        let scenario = x_and_y(-1.0, 1.0).sample(SEED, index);
        let [x, y] = [0, 1].map(|axis| scenario.get(axis).expect("a value"));
        let source = distance(x, y);
        let follow_up = distance(x + 0.25, y);
        if x + 0.25 > 1.0 {
            out_of_bounds += 1;
        } else if (source < 0.0) != (follow_up < 0.0) {
            broken.push((index as u32 + 1, (follow_up - source).abs()));
        }
    }
    broken.sort_by(|a, b| b.1.total_cmp(&a.1));
    assert!(broken.len() > KEPT && out_of_bounds > 100);
    assert_eq!((found.broken, found.out_of_bounds), (broken.len() as u64, out_of_bounds));
    assert_eq!(found.pairs + found.out_of_bounds, pairs);
    let numbers: Vec<u32> = found.worst.iter().map(|pair| pair.number).collect();
    assert_eq!(numbers, broken[..KEPT].iter().map(|(number, _)| *number).collect::<Vec<_>>());
    assert_eq!(found.verdicts.worse + found.verdicts.better, found.broken);
}

#[test]
fn the_result_does_not_depend_on_the_batch_size() {
    let relations = [
        relation(AxisChange::Offset(0.25), OutputRelation::SameVerdict),
        relation(AxisChange::Factor(0.5), OutputRelation::NotWorse(None)),
    ];
    let [one, seven, all] =
        [1, 7, 1000].map(|batch| test(&relations, MetamorphicSettings { pairs: 150, batch }));
    assert!(one.relations.iter().all(|relation| relation.broken > 0));
    assert_eq!(one, seven);
    assert_eq!(one, all);
}

#[test]
fn source_and_follow_up_swapped_turn_not_better_into_not_worse() {
    let values = [f64::NEG_INFINITY, -1.0, -0.1, -0.0, 0.0, 0.1, 1.0, f64::INFINITY];
    for (source, follow_up) in values.iter().flat_map(|a| values.map(|b| (*a, b))) {
        for tolerance in [None, Some(0.0), Some(0.5)] {
            let better = OutputRelation::NotBetter(tolerance).is_broken(source, follow_up);
            assert_eq!(better, OutputRelation::NotWorse(tolerance).is_broken(follow_up, source));
        }
    }
    // Sources from 0 to 0.5 that are doubled are the follow-up cases of sources from 0 to 1 that
    // are halved; a power of two is exact.
    let outcome = |x: f64, y: f64| SimulatedEnd::Robustness(distance(x, y));
    let whole = x_and_y(0.0, 1.0);
    let double = [relation(AxisChange::Factor(2.0), OutputRelation::NotBetter(None))];
    let halve = [relation(AxisChange::Factor(0.5), OutputRelation::NotWorse(None))];
    let there = test_of(x_and_y(0.0, 0.5), whole.clone(), &double, settings(500), outcome);
    let back = test_of(whole.clone(), whole, &halve, settings(500), outcome);
    let there = &there.relations[0];
    let back = &back.relations[0];
    assert!(there.broken > 0);
    assert_eq!(there.broken, back.broken);
    for (a, b) in there.worst.iter().zip(&back.worst) {
        assert_eq!((a.number, a.source.robustness), (b.number, b.follow_up.robustness));
    }
}

#[test]
fn a_pair_without_two_verdicts_is_no_evidence() {
    let space = x_and_y(-1.0, 1.0);
    let outcome = |x: f64, _| match x {
        x if x < -0.5 => SimulatedEnd::Diverged,
        x if x > 0.5 => SimulatedEnd::InvalidStart,
        // Each pair with two verdicts breaks the relation.
        x => SimulatedEnd::Robustness(if x < 0.0 { -1.0 } else { 1.0 }),
    };
    let negate = relation(AxisChange::Factor(-1.0), OutputRelation::SameVerdict);
    let found = test_of(space.clone(), space, &[negate], settings(400), outcome);
    let found = &found.relations[0];
    assert!(found.without_verdict > 100);
    assert_eq!(found.broken, found.pairs - found.without_verdict);
    assert_eq!(found.verdicts.both_satisfied + found.verdicts.both_violated, 0);
}

#[test]
fn no_case_is_outside_of_its_bounds_and_axes_that_sources_lack_are_nominal() {
    let friction = Axis::new(AxisKind::Model, "friction", "", [0.5, 2.0], Some(1.0));
    let sources = Space::new("s", vec![Axis::start("x", "m", -0.5, 0.5)]).expect("a space");
    let axes = vec![Axis::start("x", "m", -1.0, 1.0), friction];
    let space = Space::new("s", axes).expect("a space");
    let changes = vec![(0, AxisChange::Offset(0.75)), (1, AxisChange::Factor(0.8))];
    let holds = OutputRelation::RobustnessWithin(1e9);
    let relations = [Relation { name: "both".to_string(), changes, holds }];
    let outcome = |x: f64, friction: f64| {
        assert!((-1.0..=1.0).contains(&x));
        assert!(friction == 1.0 && x <= 0.5 || friction == 0.8, "{x} {friction}");
        SimulatedEnd::Robustness(x)
    };
    let found = test_of(sources, space, &relations, settings(300), outcome);
    let found = &found.relations[0];
    // A quarter of the sources is above 0.25.
    assert!((50..100).contains(&found.out_of_bounds), "{}", found.out_of_bounds);
    assert_eq!(found.pairs + found.out_of_bounds, 300);
}

#[test]
fn the_smallest_change_crosses_the_border_of_the_verdict() {
    let space = x_and_y(0.0, 1.0);
    let outcome = |x: f64, _| SimulatedEnd::Robustness(0.5 - x);
    let relations = [relation(AxisChange::Offset(0.4), OutputRelation::SameVerdict)];
    let found = test_of(space.clone(), space, &relations, settings(100), outcome);
    let found = &found.relations[0];
    let worst = &found.worst[0];
    let smallest = found.smallest_change.as_ref().expect("a change");
    let x = worst.source.scenario.get(0).expect("a value");
    let lower = x + 0.4 * smallest.holds_at;
    let upper = x + 0.4 * smallest.share;
    assert!(lower <= 0.5 && upper > 0.5 && upper - lower < 0.4 / 1000.0, "{lower} {upper}");
    assert_eq!((smallest.pair, smallest.simulations), (worst.number, BISECTIONS));
    assert!(smallest.case.robustness.is_some_and(is_violated));
}

#[test]
fn a_change_of_whole_numbers_is_bisected_to_one_of_them() {
    let delay =
        Axis::new(AxisKind::Model, "delay", "steps", [0.0, 9.0], Some(0.0)).with_values(AxisValues::Integer);
    let space = Space::new("s", vec![delay]).expect("a space");
    let sources = Space::new("s", Vec::new()).expect("a space");
    let relations = [relation(AxisChange::Offset(9.0), OutputRelation::SameVerdict)];
    // A delay of 4 steps violates.
    let outcome = |delay: f64, _| {
        assert_eq!(delay.fract(), 0.0);
        SimulatedEnd::Robustness(3.5 - delay)
    };
    let found = test_of(sources, space, &relations, settings(1), outcome);
    let smallest = found.relations[0].smallest_change.clone().expect("a change");
    assert_eq!(smallest.case.scenario.get(0), Some(4.0));
    assert!(smallest.simulations < 5, "{} simulations of 8 delays", smallest.simulations);
}

#[test]
fn an_interrupted_test_has_whole_batches() {
    let space = x_and_y(-1.0, 1.0);
    let mut system = FunctionSystem::new(space.clone(), |_| SimulatedEnd::Robustness(1.0));
    let cases = Cases::new(space.clone(), space, SEED);
    let relations = [relation(AxisChange::Offset(0.0), OutputRelation::SameVerdict)];
    let stop = |_| ControlFlow::Break(());
    let found = metamorphic(&mut system, &cases, &relations, settings(100), stop).expect("a result");
    assert_eq!((found.is_complete, found.simulations, found.relations[0].pairs), (false, 64, 32));
}

#[test]
fn impossible_relations_are_errors_before_the_first_simulation() {
    let surface = ["wood", "ice"].map(String::from).to_vec();
    let axes = vec![
        Axis::start("x", "m", 0.0, 1.0),
        Axis::new(AxisKind::Model, "delay", "steps", [0.0, 3.0], Some(0.0)).with_values(AxisValues::Integer),
        Axis::new(AxisKind::Model, "surface", "", [0.0, 1.0], Some(0.0))
            .with_values(AxisValues::Categorical(surface.into())),
        Axis::new(AxisKind::Noise, "draw", "", [-4.0, 4.0], None),
    ];
    let sources = Space::new("s", axes[..1].to_vec()).expect("a space");
    let cases = Cases::new(sources, Space::new("s", axes).expect("a space"), SEED);
    let check = |index: usize, change: &str, pairs: u64| {
        let change = change.parse().expect("a change");
        let holds = OutputRelation::SameVerdict;
        let relation = Relation { name: "r".to_string(), changes: vec![(index, change)], holds };
        cases.check(&[relation], settings(pairs)).map_err(|error| error.to_string())
    };
    for (index, change) in [(0, "+0.5"), (0, "=1"), (1, "+2"), (1, "*0.5"), (2, "ice")] {
        assert_eq!(check(index, change, 10), Ok(()), "{change}");
    }
    for (index, change, part) in [
        (0, "=1.5", "a value from 0 to 1"),
        (0, "+1.5", "all are outside of the bounds of its axes, x from 0 to 1"),
        (0, "ice", "the axis is numeric"),
        (1, "+0.5", "a whole number"),
        (2, "water", "one of its categories: wood, ice"),
        (2, "+1", "one of its categories"),
        (3, "=1", "source cases have"),
    ] {
        let error = check(index, change, 10).expect_err(change);
        assert!(error.contains(part), "{change}: {error}");
    }
    assert!(check(0, "+0.5", 0).expect_err("no pairs").contains("the number of pairs is 0"));
    assert!(cases.check(&[], settings(1)).is_err());
}

#[test]
fn texts_of_changes_and_relations_are_read_and_written() {
    for text in ["+0.02", "-0.02", "*0.8", "=0.3", "=-0.3", "=ice"] {
        assert_eq!(text.parse::<AxisChange>().expect(text).to_string(), text);
    }
    assert_eq!("+5%".parse::<AxisChange>().expect("a share"), AxisChange::Factor(1.05));
    for text in ["", "=", "+", "*x", "+nan", "*inf", "+1e999", "5%%+"] {
        let parsed = text.parse::<AxisChange>();
        assert!(!parsed.is_ok_and(|change| !matches!(change, AxisChange::Category(_))), "{text}");
    }
    for text in OutputRelation::FORMS {
        let text = text.replace("TOLERANCE", "0.05").replace("DISTANCE", "0");
        assert_eq!(text.parse::<OutputRelation>().expect("a relation").to_string(), text);
    }
    for text in
        ["better", "same-verdict:1", "robustness-within", "not-better:-1", "not-worse:inf", "not-worse:"]
    {
        assert!(text.parse::<OutputRelation>().is_err(), "{text}");
    }
}
