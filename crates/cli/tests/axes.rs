//! Axes with a narrower range or a fixed value.

use crate::bench;
use crate::bench::Bench;
use serde_json::json;

const CAR: &str = "falsify toy/car-following --space events --trials 2 --budget 40";

#[test]
fn every_scenario_is_within_the_range_and_has_the_fixed_value() {
    let bench = Bench::new();
    for search in ["random", "nelder-mead", "dual-annealing"] {
        let out = format!("{search}.sqlite");
        let flags = format!("--search {search} --axis brake_time=5:7.5 --axis speed=20 --out {out} --json");
        let found = bench.run(&format!("{CAR} {flags}"));
        assert!(matches!(found.status.code(), Some(0 | 1)), "{}", bench::text(&found.stderr));
        let run = mishandle::store::RunFile::open(bench.path(&out)).unwrap();
        let place = |name: &str| run.header().axes.iter().position(|axis| axis.name == name).unwrap();
        let ranged = place("brake_time");
        let fixed = place("speed");
        for row in run.simulations() {
            let scenario = row.unwrap().scenario;
            assert!((5.0..=7.5).contains(&scenario[ranged].unwrap()), "{search}: {scenario:?}");
            assert_eq!(scenario[fixed], Some(20.0), "{search}");
        }
    }
}

#[test]
fn flags_edit_the_table_of_a_plan_and_a_stored_run_is_replayed() {
    let bench = Bench::new();
    bench.write(
        "plan.toml",
        "target = \"ball-balancing\"\ncontroller = \"ppo\"\n[axes]\naction_delay = 3\nball_x = [0.3, 0.4]\n[falsify]\ntrials = 1\nbudget = 5\n",
    );
    let found = bench.json("falsify --plan plan.toml --axis action_delay=2 --out run.sqlite --json", 1);
    assert_eq!(found["axes"], json!(["ball_x", "ball_y", "action_delay"]));
    assert_eq!(found["trials"][0]["scenario"]["action_delay"], 2.0);
    bench.check("replay run.sqlite", 0);
    bench.check("show run.sqlite --simulation first", 1);
    // The values of the axes that are not fixed are enough.
    let at =
        bench.json("simulate ball-balancing --controller ppo --axis action_delay=3 --at 0.3,0.1 --json", 1);
    let named = "simulate ball-balancing --controller ppo --space starts+delay --at ball_x=0.3,ball_y=0.1,action_delay=3 --json";
    assert_eq!(at["robustness"], bench.json(named, 1)["robustness"]);
}

/// The narrower space has corners of its own, and a fixed axis has none.
#[test]
fn the_corners_of_an_evaluation_are_those_of_the_narrower_box() {
    let bench = Bench::new();
    let flags = "--axis ball_x=0.25:0.5 --axis ball_y=0.125 --episodes 3 --json";
    let found = bench.json(&format!("evaluate ball-balancing --controller ppo {flags}"), 0);
    let points: Vec<&serde_json::Value> =
        found["corners"]["points"].as_array().unwrap().iter().map(|point| &point["scenario"]).collect();
    let at = |x: f64| json!({ "ball_x": x, "ball_y": 0.125 });
    assert_eq!(points, [&at(0.25), &at(0.5), &at(0.375)]);
}

#[test]
fn impossible_settings_are_errors() {
    let bench = Bench::new();
    for (flags, parts) in [
        ("--axis speed", vec!["--axis", "a value, such as ball_x=0.2:0.3 or action_delay=2"]),
        ("--axis speed=30:20", vec!["speed", "from 30 to 20"]),
        ("--axis sped=20", vec!["no axis `sped`", "did you mean `speed`"]),
        ("--axis speed=20 --axis speed=20:25", vec!["speed is set twice"]),
        ("--axis speed=fast", vec!["the axis speed cannot be fast: expected a number"]),
        (
            "--axis brake_time=0,5",
            vec!["brake_time cannot be 0,5: expected a number from 0 to 15, written 0.5"],
        ),
        ("--axis brake_time=1:20", vec!["brake_time cannot be 20: expected a number from 0 to 15"]),
        (
            "--axis reaction_delay=1.5",
            vec!["reaction_delay cannot be 1.5: expected a whole number from 0 to 10"],
        ),
    ] {
        bench.refuses(&format!("{CAR} {flags}"), &parts);
    }
    bench.write("plan.toml", "target = \"toy/car-following\"\n[axes]\nspeed = [1, 2, 3]\n[falsify]\n");
    bench.refuses(
        "falsify --plan plan.toml",
        &["line 3 of the plan", "the key `axes.speed` is [1, 2, 3]", "a list of two numbers"],
    );
}
