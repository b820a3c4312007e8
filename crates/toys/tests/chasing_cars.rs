//! Laws of the chasing cars that follow from their equations without an integrator.

use mishandle_rollout::{Episode, Request, Scenario, Seed, Specification};
use mishandle_stl::Formula;

/// Runs a problem with these inputs: throttle and brake of every piece, and the ramp.
fn episode(name: &str, throttle: f64, brake: f64, ramp: f64) -> Episode {
    let target = mishandle_toys::arch::target(name).expect("a problem").expect("a target");
    let requirement = Formula::parse(&target.formulas[0].text).expect("a formula");
    let space = target.space("instance-1").expect("a space");
    let mut system = target.system(&space, &Specification::new(requirement)).expect("a system");
    let value = |axis: &str| match axis {
        "ramp" => ramp,
        axis if axis.starts_with("throttle") => throttle,
        _ => brake,
    };
    let values = space.axes().iter().map(|axis| Some(value(&axis.name))).collect();
    system.rollout(&[Request::new(Scenario::new(values), Seed(0))]).expect("an episode").remove(0)
}

fn signal(episode: &Episode, name: &str) -> Vec<f64> {
    episode.trace.signal(name).expect("a signal").to_vec()
}

#[test]
fn the_first_car_follows_its_closed_form() {
    // v' = -u - b v from rest: v = -u/b (1 - exp(-b t)), y = -u/b (t - (1 - exp(-b t)) / b).
    for (u, b) in [(1.0, 0.25), (0.5, 1.0), (0.3, 0.7)] {
        for ramp in [0.0, 1.0] {
            let y = signal(&episode("arch/cc1", u, b, ramp), "y1");
            for (sample, y) in y.iter().enumerate() {
                let t = 0.05 * sample as f64;
                let expected = -u / b * (t - (1.0 - (-b * t).exp()) / b);
                assert!((y - expected).abs() < 1e-6, "u {u}, b {b}, t {t}: {y} and {expected}");
            }
        }
    }
}

#[test]
fn the_second_car_starts_when_the_gap_reaches_15() {
    // At full throttle y1 = -t²/2. The second car waits until t₁² / 2 = 5, then accelerates by 1.
    // The gap 10 + t²/2 - s²/2 with s = t - t₁ never falls, because the first car is faster.
    let run = episode("arch/cc1", 1.0, 0.0, 0.0);
    let y1 = signal(&run, "y1");
    let y2 = signal(&run, "y2");
    let start = 10.0_f64.sqrt();
    for (sample, (y1, y2)) in y1.iter().zip(&y2).enumerate() {
        let t = 0.05 * sample as f64;
        let since = (t - start).max(0.0);
        assert!((y1 + 0.5 * t * t).abs() < 1e-6 && (y2 - 10.0 + 0.5 * since * since).abs() < 1e-6, "t {t}");
    }
}

#[test]
fn a_row_at_rest_stays_at_rest() {
    let run = episode("arch/cc4", 0.0, 1.0, 0.0);
    for (name, expected) in [("y1", 0.0), ("y2", 10.0), ("y3", 20.0), ("y4", 30.0), ("y5", 40.0)] {
        assert!(signal(&run, name).iter().all(|y| *y == expected));
    }
    // The margin of CC4 is then 10 - 8.
    assert_eq!(run.verdict.robustness, Some(2.0));
}
