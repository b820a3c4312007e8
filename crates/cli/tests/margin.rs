//! The smallest disturbance that breaks a controller, and its witness.

#![allow(clippy::unwrap_used)]

mod bench;

use bench::Bench;
use serde_json::Value;

const CAR: &str = "margin toy/car-following --space dynamics+events --budget 600";

#[test]
fn the_witness_is_the_result_and_replays_to_the_same_bits() {
    let bench = Bench::new();
    let found = bench.json(&format!("{CAR} --out witness.json --json"), 1);
    let witness = &found["witness"];
    let amplitude = witness["amplitude"].as_f64().unwrap();
    assert!(witness["robustness"].as_f64().unwrap() < 0.0);
    assert!(found["no_violation_up_to"].as_f64().unwrap() < amplitude);
    assert!(found["simulations"].as_u64().unwrap() <= 600);
    // No level above the witness passes, and none below it fails.
    for level in found["levels"].as_array().unwrap() {
        let is_violated = level["is_violated"].as_bool().unwrap();
        assert!(is_violated || level["amplitude"].as_f64().unwrap() < amplitude, "{level}");
    }
    let replayed = bench.json("replay witness.json --json", 0);
    assert_eq!(replayed["robustness"], witness["robustness"]);
    // The offsets of the scenario are those of the norm.
    let scenario = witness["scenario"].as_object().unwrap();
    let target = bench.json("targets toy/car-following --json", 0);
    let spaces = target["spaces"].as_array().unwrap();
    let axes: Vec<&Value> = spaces.iter().flat_map(|space| space["axes"].as_array().unwrap()).collect();
    let mut largest = 0.0_f64;
    for (name, value) in scenario {
        let axis = axes.iter().find(|axis| axis["name"] == name.as_str()).unwrap();
        // The times of events vary freely.
        if axis["kind"] == "event" && axis["unit"] == "s" {
            continue;
        }
        let of = |key: &str| axis[key].as_f64().unwrap();
        let (value, nominal) = (value.as_f64().unwrap(), of("nominal"));
        let bound = if value < nominal { of("low") } else { of("high") };
        let is_logarithmic = axis["values"] == "logarithmic";
        let scale = |x: f64| if is_logarithmic { x.ln() } else { x };
        if value != nominal {
            largest = largest.max((scale(value) - scale(nominal)) / (scale(bound) - scale(nominal)));
        }
    }
    assert!((largest - amplitude).abs() < 1e-9, "{largest} and {amplitude}");
    bench.refuses(&format!("{CAR} --out witness.json"), &["witness.json exists already"]);
}

#[test]
fn a_safe_system_has_no_witness_and_impossible_requests_are_errors() {
    let bench = Bench::new();
    let said = bench.check(&format!("{CAR} --formula gap>=-1000"), 0);
    assert!(said.contains("up to the largest disturbance of the space"), "{said}");
    bench.refuses("margin toy/car-following --space starts", &["number of disturbed axes is 0"]);
    bench.refuses("margin toy/sphere-2d", &["no space `disturbance`"]);
    bench.refuses(&format!("{CAR} --out witness.txt"), &["it must end with .json"]);
}
