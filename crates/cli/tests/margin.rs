//! The smallest disturbance that breaks a controller, and its witness.

use crate::bench::{Bench, unwrapped};
use serde_json::Value;

const CAR: &str = "margin toy/car-following --space dynamics+events --budget 600";

#[test]
fn the_witness_is_the_result_and_replays_to_the_same_bits() {
    let bench = Bench::new();
    let found = bench.json(&format!("{CAR} --out run.sqlite --json"), 1);
    let witness = &found["witness"];
    let amplitude = witness["amplitude"].as_f64().unwrap();
    assert!(witness["robustness"].as_f64().unwrap() < 0.0);
    assert!(found["no_violation_up_to"].as_f64().unwrap() < amplitude);
    assert!(found["simulations"].as_u64().unwrap() <= 600);
    // No level below the witness fails.
    for level in found["levels"].as_array().unwrap() {
        let is_violated = level["is_violated"].as_bool().unwrap();
        assert!(!is_violated || level["amplitude"].as_f64().unwrap() >= amplitude, "{level}");
    }
    let replay = format!("replay run.sqlite --simulation {} --json", witness["simulation"]);
    let replayed = bench.json(&replay, 0);
    assert_eq!(replayed["robustness"], witness["robustness"]);
    assert_eq!(replayed["scenario"], witness["scenario"]);
    // The run is complete: resuming it gives the same result at once.
    let again = bench.json("margin --resume run.sqlite --json", 1);
    assert_eq!(again, found);
    // The offsets of the scenario are those of the norm.
    let scenario = witness["scenario"].as_object().unwrap();
    let target = bench.json("list toy/car-following --json", 0);
    let spaces = target["target"]["spaces"].as_array().unwrap();
    let axes: Vec<&Value> = spaces.iter().flat_map(|space| space["axes"].as_array().unwrap()).collect();
    let mut largest = 0.0_f64;
    for (name, value) in scenario {
        let axis = axes.iter().find(|axis| axis["name"] == name.as_str()).unwrap();
        // The times of events vary freely.
        if axis["kind"] == "event" && axis["unit"] == "s" {
            continue;
        }
        let of = |key: &str| axis[key].as_f64().unwrap();
        let value = value.as_f64().unwrap();
        let nominal = of("nominal");
        let bound = if value < nominal { of("low") } else { of("high") };
        let is_logarithmic = axis["values"] == "logarithmic";
        let scale = |x: f64| if is_logarithmic { x.ln() } else { x };
        if value != nominal {
            largest = largest.max((scale(value) - scale(nominal)) / (scale(bound) - scale(nominal)));
        }
    }
    assert!((largest - amplitude).abs() < 1e-9, "{largest} and {amplitude}");
    bench.refuses(&format!("{CAR} --out run.sqlite"), &["run.sqlite", "exists already"]);
    let command = "evaluate --resume run.sqlite";
    bench.refuses(command, &["is a run of `margin`", "mishandle margin --resume run.sqlite"]);
}

#[test]
fn a_safe_system_has_no_witness_and_impossible_requests_are_errors() {
    let bench = Bench::new();
    let said = unwrapped(&bench.check(&format!("{CAR} --formula 'always(gap >= -1000)'"), 0));
    assert!(
        said.contains("no violation in 600 simulations with 600 seeds, up to the largest disturbance"),
        "{said}"
    );
    let found = bench.json(&format!("{CAR} --formula 'always(gap >= -1000)' --json"), 0);
    let claim = ["no_violation_up_to", "no_violation_simulations", "no_violation_seeds", "simulations"];
    assert_eq!(claim.map(|key| found[key].as_f64().unwrap()), [1.0, 600.0, 600.0, 600.0]);
    assert_eq!(found["is_random"], true);
    bench.refuses("margin toy/car-following --space starts", &["number of disturbed axes is 0"]);
    bench.refuses("margin toy/sphere-2d", &["no space `disturbance`"]);
    bench.refuses(&format!("{CAR} --out witness.json"), &["a run file is SQLite"]);
}

/// A delay has few values, and the arm has no noise: each value is simulated once. The noise of the
/// car makes 11 delays a sample.
#[test]
fn only_a_deterministic_target_has_all_its_scenarios_simulated() {
    let bench = Bench::new();
    let delay = "margin point-reaching --controller expert --space delay --formula always(finger_target_distance>=-1)";
    let found = bench.json(&format!("{delay} --json"), 0);
    let scenarios = found["simulations"].as_u64().unwrap();
    assert!(scenarios < 100 && found["levels"][0]["is_exhaustive"] == true, "{found}");
    let said = unwrapped(&bench.check(delay, 0));
    let claim = format!("no violation in {scenarios} simulations, which are all scenarios, up to");
    assert!(said.contains(&claim), "{said}");
    let car = "margin toy/car-following --space dynamics --axis braking_scale=1 --budget 110";
    let said = unwrapped(&bench.check(car, 0));
    assert!(said.contains("no violation in 110 simulations with 110 seeds, up to the largest"), "{said}");
}

/// A tenth of the random scenarios of this space fails.
#[test]
fn a_random_target_with_failures_is_called_safe_by_no_seed() {
    let bench = Bench::new();
    for seed in 0..10 {
        let found = bench.json(&format!("margin toy/car-following --space events --seed {seed} --json"), 1);
        assert!(found["witness"]["amplitude"].as_f64().unwrap() < 0.6, "seed {seed}: {found}");
    }
}

/// The gap is 37.5 m in the nominal scenario, in each seed.
#[test]
fn a_failure_without_a_disturbance_is_called_so() {
    let bench = Bench::new();
    let said = unwrapped(&bench.check(&format!("{CAR} --formula gap>=60 --verbose"), 1));
    assert!(said.contains("the controller fails without a disturbance, after"), "{said}");
    assert!(said.contains(" at the nominal scenario"), "{said}");
    assert!(said.contains(": robustness -22.5,"), "{said}");
    assert!(said.contains("fails in 100 of 100 repeats") && !said.contains("luck"), "{said}");
    let found = bench.json(&format!("{CAR} --formula gap>=60 --json"), 1);
    assert_eq!(
        (&found["witness"]["axes"], &found["witness"]["fails_in_most_repeats"]),
        (&0.into(), &true.into())
    );
}

/// The scale of the brakes is 1 in the target; the axis allows 0.5 at most.
#[test]
fn the_answer_says_from_where_it_is_measured() {
    let bench = Bench::new();
    let said = |axis: &str| {
        let output = bench.run(&format!("margin toy/car-following --space dynamics --budget 40{axis}"));
        unwrapped(&crate::bench::text(&output.stdout))
    };
    let moved = said(" --axis braking_scale=0.25:0.5");
    assert!(moved.contains("measured from braking_scale = 0.5"), "{moved}");
    let whole = said("");
    assert!(whole.contains("toy/car-following") && !whole.contains("measured"), "{whole}");
}

/// The error of the measured gap is the noise of the car: whether the car comes too near depends on
/// the seed.
#[test]
fn a_witness_that_fails_with_few_other_seeds_is_called_luck() {
    let bench = Bench::new();
    let mut outcomes = Vec::new();
    for seed in 0..6 {
        let found = bench.json(&format!("{CAR} --seed {seed} --json"), 1);
        let repeats = &found["witness"]["repeats"];
        let is_most = 2 * repeats["failures"].as_u64().unwrap() > repeats["simulations"].as_u64().unwrap();
        assert_eq!(found["witness"]["fails_in_most_repeats"], is_most);
        let said = unwrapped(&bench.check(&format!("{CAR} --seed {seed}"), 1));
        assert!(said.starts_with("FAILS toy/car-following"), "{said}");
        assert_eq!(said.contains(", but not with most other seeds, after"), !is_most, "{said}");
        assert_eq!(said.contains("the luck of its seed"), !is_most, "{said}");
        assert!(said.contains(&format!("fails in {} of 100 repeats", repeats["failures"])), "{said}");
        outcomes.push(is_most);
    }
    assert!(outcomes.contains(&true) && outcomes.contains(&false), "{outcomes:?}");
}

/// A system that is violated above 0.4 and has no answer above 0.7.
const BREAKS: &str = r#"
import json, sys
HELLO = {"protocol": 1, "name": "breaks", "control_dt": 1.0, "steps": 1,
  "axes": [{"name": "a", "low": 0, "high": 1, "nominal": 0.0, "kind": "model"}],
  "signals": [{"name": "x"}], "formulas": [{"name": "success", "text": "always(x >= 0)"}]}
for line in sys.stdin:
    q = json.loads(line)
    a = 0.0 if q["type"] == "hello" else q["scenario"]["a"]
    trace = {"x": [0.4 - a] * 2} if a <= 0.7 else {"y": [0.0] * 2}
    answer = HELLO if q["type"] == "hello" else {"trace": trace}
    print(json.dumps({"id": q["id"], **answer}), flush=True)
"#;

#[test]
fn a_margin_with_a_violation_names_the_amplitude_from_which_nothing_is_claimed() {
    let bench = Bench::new();
    bench.write("breaks.py", BREAKS);
    let margin = "margin --command 'python3 breaks.py' --budget 60 --out run.sqlite";
    let said = unwrapped(&bench.check(margin, 1));
    assert!(said.contains("a disturbance of 40 % of the way to the bounds"), "{said}");
    let (_, claim) = said.split_once("nothing is claimed from ").unwrap();
    let (amplitude, rest) = claim.split_once(' ').unwrap();
    assert!((70.0..=100.0).contains(&amplitude.parse::<f64>().unwrap()), "{said}");
    assert!(rest.starts_with("% of the way to the bounds on, where simulations have no verdict"), "{said}");
    // An invalid answer is not called a crash.
    assert!(said.contains("failed (crash, invalid answer or time limit)"), "{said}");
}
