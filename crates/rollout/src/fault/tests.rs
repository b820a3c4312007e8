//! The law of every kind of fault: it changes its channel only, exactly in its life cycle, and
//! within the stated range.

use super::*;
use crate::disturbance::{ActiveDisturbances, AxisRouting};
use crate::{Axis, AxisValues, Disturbance, Scenario, Seed, Space};

const ENTRIES: usize = 5;
const STEPS: usize = 100;

/// A site with the channels a (entries 0 and 1), b (2 and 3) and c (4). A control step takes
/// 0.1 s, and each entry has the range from -2 to 2.
fn site(side: Side, number: u32) -> FaultSite {
    let channel = |name: &str, entries: &[usize]| Channel { name: name.into(), entries: entries.into() };
    FaultSite {
        side,
        name: format!("fault{number}"),
        number,
        channels: vec![channel("a", &[0, 1]), channel("b", &[2, 3]), channel("c", &[4])],
        ranges: vec![[-2.0, 2.0]; ENTRIES],
        has_numbers: true,
        control_dt: 0.1,
        episode_steps: STEPS,
    }
}

/// A scenario of some disturbances: values by name, names for categories.
fn scenario(space: &Space, values: &[(&str, &str)]) -> Scenario {
    let number = |axis: &Axis, text: &str| match &axis.values {
        AxisValues::Categorical(names) => names.iter().position(|name| name == text).unwrap() as f64,
        _ => text.parse().unwrap(),
    };
    let value = |axis: &Axis| {
        let set = values.iter().find(|(name, _)| *name == axis.name);
        set.map_or(axis.nominal, |(_, text)| Some(number(axis, text)))
    };
    let scenario = Scenario::new(space.axes().iter().map(value).collect());
    space.check(&scenario).unwrap();
    for (name, _) in values {
        assert!(space.axes().iter().any(|axis| axis.name == *name), "no axis {name}");
    }
    scenario
}

fn space(disturbances: &[Disturbance]) -> Space {
    Space::new("faults", disturbances.iter().map(|d| d.axis.clone()).collect()).unwrap()
}

/// The true value of an entry in a control step: a smooth signal within its range.
fn truth(step: usize, entry: usize) -> f32 {
    (1.5 * (0.13 * step as f64 + entry as f64).sin()) as f32
}

/// Runs an episode with a fault of one side; returns the true and the faulty values of each step.
fn run(side: Side, values: &[(&str, &str)], seed: u64) -> Vec<[[f32; ENTRIES]; 2]> {
    let disturbances = site(side, 0).disturbances();
    let space = space(&disturbances);
    let none = Space::new("none", vec![]).unwrap();
    let routing = AxisRouting::new(&space, &none, &disturbances).unwrap();
    let mut active = ActiveDisturbances::new(&routing, &scenario(&space, values), Seed(seed), ENTRIES);
    let step = |step: usize| {
        let before: [f32; ENTRIES] = std::array::from_fn(|entry| truth(step, entry));
        let mut after = before;
        active.fail(side, step, &mut after);
        [before, after]
    };
    (0..STEPS).map(step).collect()
}

/// Life cycle of the tests: control steps 20 to 29 whole, 30 to 34 recovery.
const LIFE: [(&str, &str); 3] = [("fault0_onset", "2"), ("fault0_duration", "1"), ("fault0_recovery", "0.5")];

/// A fault of kind `kind` on channel `a`, with further values.
fn fault(side: Side, kind: &str, more: &[(&str, &str)]) -> Vec<[[f32; ENTRIES]; 2]> {
    let mut values = LIFE.to_vec();
    values.extend([("fault0", kind)]);
    values.extend(more);
    run(side, &values, 7)
}

/// Checks that only these entries differ, and only in these control steps.
fn check_differs(rows: &[[[f32; ENTRIES]; 2]], entries: &[usize], steps: std::ops::Range<usize>) {
    for (step, [before, after]) in rows.iter().enumerate() {
        for entry in 0..ENTRIES {
            let is_same = before[entry].to_bits() == after[entry].to_bits();
            let may_differ = entries.contains(&entry) && steps.contains(&step);
            assert!(is_same || may_differ, "entry {entry} in step {step}");
            assert!(!is_same || !may_differ, "entry {entry} is unchanged in step {step}");
        }
    }
}

const A: (&str, &str) = ("fault0_channel", "a");
const RECOVERED: [f64; 5] = [5.0 / 6.0, 4.0 / 6.0, 3.0 / 6.0, 2.0 / 6.0, 1.0 / 6.0];

/// The share of the fault in a control step.
fn share(step: usize) -> f64 {
    match step {
        20..30 => 1.0,
        30..35 => RECOVERED[step - 30],
        _ => 0.0,
    }
}

fn check_values(rows: &[[[f32; ENTRIES]; 2]], expected: impl Fn(usize, usize, f64) -> f64) {
    for (step, [before, after]) in rows.iter().enumerate() {
        for entry in [0, 1] {
            let x = f64::from(before[entry]);
            let found = f64::from(after[entry]);
            let value = expected(step, entry, x);
            assert!((found - value).abs() < 1e-6, "{found} is not {value} in step {step}");
        }
    }
}

#[test]
fn each_sensor_fault_has_the_stated_values_in_its_life_cycle() {
    let s = Side::Sensing;
    let last = |entry| f64::from(truth(19, entry));
    let frozen = fault(s, "freeze", &[A]);
    check_values(&frozen, |step, entry, x| x + share(step) * (last(entry) - x));
    check_differs(&frozen, &[0, 1], 20..35);
    let stuck = fault(s, "stuck", &[A, ("fault0_level", "0.75")]);
    check_values(&stuck, |step, _, x| x + share(step) * (1.5 - x));
    let bias = fault(s, "bias", &[A, ("fault0_offset", "-0.25")]);
    check_values(&bias, |step, _, x| x - 0.5 * share(step));
    check_differs(&bias, &[0, 1], 20..35);
    let ramp = fault(s, "ramp", &[A, ("fault0_offset", "0.5")]);
    let risen = |step: usize| ((step as f64 - 19.0) / 10.0).clamp(0.0, 1.0);
    check_values(&ramp, |step, _, x| x + share(step) * risen(step));
    let spike = fault(s, "spike", &[A, ("fault0_offset", "0.5")]);
    let fallen = |step: usize| if (20..30).contains(&step) { (30.0 - step as f64) / 10.0 } else { 0.0 };
    check_values(&spike, |step, _, x| x + fallen(step));
    check_differs(&spike, &[0, 1], 20..30);
    let quantized = fault(s, "quantization", &[A, ("fault0_quantum", "0.2")]);
    check_values(&quantized, |step, _, x| x + share(step) * ((x / 0.4).round() * 0.4 - x));
    let swapped = fault(s, "swap", &[A, ("fault0_partner", "b")]);
    check_differs(&swapped, &[0, 1, 2, 3], 20..30);
    for [before, after] in &swapped[20..30] {
        assert_eq!([after[0], after[1], after[2], after[3]], [before[2], before[3], before[0], before[1]]);
    }
    // The next channel of b is c, which has one entry; all channels are shifted by one entry.
    let next = fault(s, "swap", &[("fault0_channel", "b"), ("fault0_partner", "next")]);
    check_differs(&next, &[2, 4], 20..30);
    let shifted = fault(s, "swap", &[("fault0_channel", "all")]);
    for [before, after] in &shifted[20..30] {
        assert_eq!(*after, [before[1], before[2], before[3], before[4], before[0]]);
    }
}

#[test]
fn a_dropout_shows_its_fill_for_exactly_its_duration() {
    for (fill, expected) in [("last", None), ("zero", Some(0.0)), ("nan", Some(f32::NAN))] {
        let rows = fault(Side::Sensing, "dropout", &[A, ("fault0_fill", fill)]);
        check_differs(&rows, &[0, 1], 20..30);
        for [_, after] in &rows[20..30] {
            assert_eq!(after[0].to_bits(), expected.unwrap_or(truth(19, 0)).to_bits(), "{fill}");
        }
    }
    // Without a sample before it, the first one is held.
    let rows = fault(Side::Sensing, "dropout", &[("fault0_onset", "0"), A]);
    let early =
        run(Side::Sensing, &[("fault0", "dropout"), ("fault0_onset", "0"), ("fault0_duration", "0.4"), A], 7);
    assert!(early[..4].iter().all(|[_, after]| after[0] == truth(0, 0)) && rows.len() == STEPS);
}

#[test]
fn each_actuator_fault_has_the_stated_values_in_its_life_cycle() {
    let s = Side::Actuation;
    let last = |entry| f64::from(truth(19, entry));
    let weak = fault(s, "authority-loss", &[("fault0_loss", "0.75")]);
    check_values(&weak, |step, _, x| x * (1.0 - 0.75 * share(step)));
    check_differs(&weak, &[0, 1, 2, 3, 4], 20..35);
    let held = fault(s, "stuck", &[A]);
    check_values(&held, |step, entry, x| if (20..30).contains(&step) { last(entry) } else { x });
    check_differs(&held, &[0, 1], 20..30);
    let flipped = fault(s, "sign-flip", &[A]);
    check_values(&flipped, |step, _, x| if (20..30).contains(&step) { -x } else { x });
    let limited = fault(s, "saturation", &[A, ("fault0_limit", "0.1")]);
    check_values(&limited, |step, _, x| {
        let limit = 2.0 * (1.0 - 0.9 * share(step));
        if share(step) > 0.0 { x.clamp(-limit, limit) } else { x }
    });
    assert!(limited[20..30].iter().all(|[_, after]| after[0].abs() <= 0.2), "within the stated range");
}

#[test]
fn losses_come_in_bursts_of_the_stated_length_with_the_stated_probability() {
    for (side, kind) in [(Side::Sensing, "burst-loss"), (Side::Actuation, "command-loss")] {
        let lost = |seed: u64, burst: &str| -> Vec<bool> {
            let values = [
                ("fault0", kind),
                ("fault0_onset", "1"),
                ("fault0_duration", "4"),
                ("fault0_probability", "0.2"),
                ("fault0_burst", burst),
            ];
            let rows = run(side, &values, seed);
            let mut last = rows[0][0];
            for [before, after] in &rows {
                if before == after {
                    last = *before;
                }
                assert_eq!(after, &last, "the last value that passed is held");
            }
            rows.iter().map(|[before, after]| before != after).collect()
        };
        let all: Vec<Vec<bool>> = (0..400).map(|seed| lost(seed, "1")).collect();
        let share = all.iter().flat_map(|lost| &lost[10..50]).filter(|lost| **lost).count() as f64 / 16_000.0;
        // Five standard errors.
        assert!((share - 0.2).abs() < 5.0 * (0.2 * 0.8 / 16_000.0_f64).sqrt(), "{kind}: {share}");
        assert!(all.iter().all(|lost| !lost[..10].iter().chain(&lost[50..]).any(|lost| *lost)));
        assert_eq!(all[3], lost(3, "1"), "the seed decides");
        let bursts = lost(5, "6");
        let starts = lost(5, "1");
        for (step, is_lost) in bursts.iter().enumerate().take(50).skip(10) {
            let expected = (10.max(step.max(15) - 5)..=step).any(|start| starts[start]);
            assert_eq!(*is_lost, expected, "a burst lasts six control steps: step {step}");
        }
    }
}

#[test]
fn late_commands_are_past_commands_in_order() {
    let rows = fault(Side::Actuation, "clock-jitter", &[("fault0_lateness", "3")]);
    let mut shown = 19;
    for (step, [_, after]) in rows.iter().enumerate().skip(20) {
        let from = (0..=step).rev().find(|from| truth(*from, 2) == after[2]).unwrap();
        let most = if step < 30 { 3 } else { 0 };
        assert!(step - from <= most && from >= shown, "step {step} has the command of step {from}");
        shown = from;
    }
    assert!(rows[20..30].iter().any(|[before, after]| before != after));
    assert!(rows[..20].iter().all(|[before, after]| before == after));
}

#[test]
fn a_fault_without_duration_or_magnitude_changes_no_bit() {
    let magnitudes = [
        ("bias", ("fault0_offset", "0")),
        ("ramp", ("fault0_offset", "0")),
        ("spike", ("fault0_offset", "0")),
        ("quantization", ("fault0_quantum", "0")),
        ("burst-loss", ("fault0_probability", "0")),
        ("swap", ("fault0_partner", "a")),
    ];
    for (kind, magnitude) in magnitudes {
        check_differs(&fault(Side::Sensing, kind, &[A, magnitude]), &[], 0..0);
    }
    let magnitudes = [
        ("authority-loss", ("fault0_loss", "0")),
        ("command-loss", ("fault0_probability", "0")),
        ("saturation", ("fault0_limit", "1")),
        ("clock-jitter", ("fault0_lateness", "0")),
    ];
    for (kind, magnitude) in magnitudes {
        check_differs(&fault(Side::Actuation, kind, &[magnitude]), &[], 0..0);
    }
    for side in [Side::Sensing, Side::Actuation] {
        for kind in side.kinds() {
            let rows =
                run(side, &[("fault0", kind.name), ("fault0_duration", "0.04"), ("fault0_onset", "1")], 3);
            check_differs(&rows, &[], 0..0);
        }
    }
}

#[test]
fn a_fault_never_leaves_the_range_of_the_values_and_its_channel() {
    for side in [Side::Sensing, Side::Actuation] {
        let disturbances = site(side, 0).disturbances();
        let space = space(&disturbances);
        let none = Space::new("none", vec![]).unwrap();
        let routing = AxisRouting::new(&space, &none, &disturbances).unwrap();
        for index in 0..600 {
            let scenario = space.sample(Seed(5), index);
            let mut active = ActiveDisturbances::new(&routing, &scenario, Seed(index), ENTRIES);
            for step in 0..STEPS {
                let mut values: [f32; ENTRIES] = std::array::from_fn(|entry| truth(step, entry));
                active.fail(side, step, &mut values);
                // The signal is within 1.5, and an offset at most half of the half range, 1.
                let bound = if side == Side::Sensing { 2.5 + 1e-6 } else { 2.0 };
                assert!(values.iter().all(|value| value.is_nan() || value.abs() <= bound), "{scenario:?}");
            }
        }
    }
}

#[test]
fn overlapping_faults_are_applied_in_the_order_of_their_numbers() {
    // A quantization to multiples of 1 after an offset of 0.5, and before it.
    let pair = |first: [(&str, &str); 2], second: [(&str, &str); 2]| {
        // The axes come in the other order, which does not matter.
        let mut disturbances = site(Side::Sensing, 1).disturbances();
        disturbances.extend(site(Side::Sensing, 0).disturbances());
        let space = space(&disturbances);
        let mut values = first.to_vec();
        values.extend(second);
        values.extend([("fault0_duration", "1"), ("fault1_duration", "1")]);
        let none = Space::new("none", vec![]).unwrap();
        let routing = AxisRouting::new(&space, &none, &disturbances).unwrap();
        let mut active = ActiveDisturbances::new(&routing, &scenario(&space, &values), Seed(1), ENTRIES);
        let mut observation = [0.75_f32; ENTRIES];
        active.fail(Side::Sensing, 0, &mut observation);
        observation[0]
    };
    let quantized_last = pair(
        [("fault0", "bias"), ("fault0_offset", "0.25")],
        [("fault1", "quantization"), ("fault1_quantum", "0.5")],
    );
    assert_eq!(quantized_last, 1.0, "1.25 is rounded to 1");
    let offset_last = pair(
        [("fault0", "quantization"), ("fault0_quantum", "0.5")],
        [("fault1", "bias"), ("fault1_offset", "0.25")],
    );
    assert_eq!(offset_last, 1.5, "0.75 is rounded to 1");
}

#[test]
fn axes_without_a_meaning_for_the_kind_are_nominal() {
    let disturbances = site(Side::Actuation, 0).disturbances();
    let space = space(&disturbances);
    for index in 0..400 {
        let drawn = space.sample(Seed(2), index);
        let value = |name: &str| {
            let place = space.axes().iter().position(|axis| axis.name == name).unwrap();
            drawn.get(place).unwrap()
        };
        let kind = Side::Actuation.kinds()[value("fault0") as usize].name;
        if kind == "authority-loss" {
            assert_eq!(value("fault0_channel"), 0.0, "a loss of authority has no channel");
            assert!(value("fault0_loss") > 0.0);
        } else {
            assert_eq!(value("fault0_loss"), 0.0);
        }
        if kind == "none" {
            assert_eq!(drawn, space.nominal());
        }
    }
    // Without a duration the kind has no meaning either.
    let idle = scenario(&space, &[("fault0", "sign-flip"), ("fault0_channel", "b")]);
    assert_eq!(space.canonical(idle), space.nominal());
}
