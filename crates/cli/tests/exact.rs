//! `mishandle compare --exact`: how two runs differ.

use crate::bench::Bench;

const EVALUATE: &str = "evaluate point-reaching --controller expert --seed 3 --episodes 40";

#[test]
fn a_run_and_its_repetition_are_the_same_to_the_bit() {
    let bench = Bench::new();
    bench.check("falsify toy/sphere-2d --trials 3 --budget 60 --seed 1 --threads 1 --out a.sqlite", 1);
    bench.check("falsify toy/sphere-2d --trials 3 --budget 60 --seed 1 --threads 2 --out b.sqlite", 1);
    let text = bench.check("compare a.sqlite b.sqlite --exact", 0);
    assert!(text.contains("same to the bit: digest "), "{text}");
    // It concludes nothing, so that a key of conclusions has no effect.
    let key = "-k max-without-verdict=0.5";
    bench.refuses(&format!("compare a.sqlite b.sqlite --exact {key}"), &["no effect with --exact"]);
    let found = bench.json("compare a.sqlite b.sqlite --exact --json", 0);
    let counts = &found["simulations"];
    assert_eq!((&found["same_records"], found["facts"].as_array().unwrap().len()), (&true.into(), 0));
    assert_eq!((&counts["same"], &counts["changed"]), (&found["first"]["simulations"], &0.into()));
}

/// `compare` counts the same pairs by other code, with the corners in its lists of failures.
#[test]
fn changed_verdicts_are_those_of_a_comparison() {
    let bench = Bench::new();
    bench.check(&format!("{EVALUATE} --action-noise 0.6 --out a.sqlite"), 0);
    bench.check(&format!("{EVALUATE} --action-noise 1.2 --out b.sqlite"), 0);
    let found = bench.json("compare a.sqlite b.sqlite --exact --json", 1);
    let compared = bench.json("compare a.sqlite b.sqlite --json", 1);
    let count = |key: &str| compared[key].as_array().unwrap().len();
    let changed = count("new_failures") + count("fixed_failures");
    assert!(changed > 3, "the noise must be visible: {changed}");
    assert_eq!(found["simulations"]["changed"], changed);
    let rate = found["results"].as_array().unwrap().iter().find(|row| row["name"] == "success rate").unwrap();
    assert_eq!(
        (&rate["first"], &rate["second"]),
        (&compared["success"]["first"], &compared["success"]["second"])
    );
    let facts: Vec<&str> =
        found["facts"].as_array().unwrap().iter().map(|fact| fact["name"].as_str().unwrap()).collect();
    assert!(facts.contains(&"plan action-noise") && !facts.contains(&"plan seed"), "{facts:?}");
    let text = bench.check("compare a.sqlite b.sqlite --exact", 1);
    assert!(text.contains("different: digest ") && text.contains("Verdicts that changed"), "{text}");
}

#[test]
fn runs_of_different_questions_and_sizes_have_a_difference() {
    let bench = Bench::new();
    bench.check("evaluate toy/sphere-2d --episodes 30 --out a.sqlite", 0);
    bench.check("evaluate toy/sphere-2d --episodes 20 --out b.sqlite", 0);
    bench.check("falsify toy/car-following --trials 1 --budget 10 --out c.sqlite", 0);
    let counts = bench.json("compare a.sqlite b.sqlite --exact --json", 1)["simulations"].clone();
    assert_eq!(
        (&counts["first_only"], &counts["second_only"], &counts["changed"]),
        (&10.into(), &0.into(), &0.into())
    );
    let text = bench.check("compare a.sqlite c.sqlite --exact", 1);
    for part in ["A is of `evaluate`, B of `falsify`", "toy/car-following", "axis gap"] {
        assert!(text.contains(part), "{part}:\n{text}");
    }
    bench.write("notes.txt", "no run");
    bench.refuses("compare a.sqlite notes.txt --exact", &["not a run file", "notes.txt"]);
    bench.refuses("compare a.sqlite missing.sqlite --exact", &["does not exist"]);
}
