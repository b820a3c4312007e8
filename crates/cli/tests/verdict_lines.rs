//! The few lines that say what an answer means: they fit 80 columns, say what the document says,
//! and name what to do next.

use crate::bench::{Bench, text, unwrapped};

/// A question of each kind, and the word with which its answer starts.
const QUESTIONS: [(&str, i32, &str); 8] = [
    ("falsify ball-balancing --controller ppo --space delay --trials 1 --budget 10 --seed 1", 1, "FAILS"),
    ("falsify toy/noisy --trials 2 --budget 40", 1, "FAILS"),
    ("falsify toy/sphere-2d --formula 'always(distance >= -1)' --trials 2 --budget 20", 0, "NOTHING FOUND"),
    ("evaluate ball-balancing --controller ppo --space all --episodes 60", 0, "FAILS"),
    ("margin toy/car-following --space dynamics+events --budget 300", 1, "FAILS"),
    (
        "margin toy/car-following --space dynamics --formula 'always(gap >= -1000)' --budget 60",
        0,
        "NOTHING FOUND",
    ),
    ("risk toy/sphere-2d --simulations 2000", 1, "FAILS"),
    ("risk toy/sphere-2d --formula 'always(distance >= -1)' --simulations 500", 0, "NOTHING FOUND"),
];

#[test]
fn no_line_is_wider_than_80_columns() {
    let bench = Bench::new();
    for (question, code, word) in QUESTIONS {
        let said = bench.check(question, code);
        assert!(said.starts_with(&format!("{word} ")), "{question}\n{said}");
        for line in said.lines() {
            assert!(line.chars().count() <= 80, "{question}: {line}");
        }
        assert!(said.lines().count() <= 24, "{question}: {said}");
    }
    for run in ["a", "b"] {
        bench.check(&format!("evaluate toy/noisy --episodes 20 --out {run}.sqlite"), 0);
    }
    let said = bench.check("compare a.sqlite b.sqlite", 0);
    assert!(said.starts_with("NOT BETTER ") && said.lines().all(|line| line.chars().count() <= 80), "{said}");
}

/// The cause of the document is in the text: each axis with its value and no other, and the instant
/// from which nothing can satisfy the requirement.
#[test]
fn the_cause_is_that_of_the_document() {
    let bench = Bench::new();
    let question = QUESTIONS[0].0;
    let said = bench.check(&format!("{question} --out r.sqlite"), 1);
    let trial = bench.json(&format!("{question} --json"), 1)["trials"][0].clone();
    let cause = &trial["cause"];
    let line = |label: &str| {
        let mut lines = said.lines().skip_while(|line| !line.starts_with(&format!("{label} ")));
        let first = lines.next().unwrap_or_else(|| panic!("no {label}: {said}")).to_string();
        unwrapped(&lines.take_while(|line| line.starts_with(' ')).fold(first, |all, line| all + " " + line))
    };
    let axes: Vec<&str> =
        cause["axes"].as_array().unwrap().iter().map(|axis| axis.as_str().unwrap()).collect();
    for (axis, value) in cause["scenario"].as_object().unwrap() {
        let steps = value.as_f64().unwrap();
        let said = format!("{axis} = {steps} control step");
        assert_eq!(line("cause").contains(&said), axes.contains(&axis.as_str()), "{said}: {}", line("cause"));
        let time = format!("({:.0} ms; nominal 0)", 1000.0 * steps / 60.0);
        assert!(!axes.contains(&axis.as_str()) || line("cause").contains(&time), "{time}: {}", line("cause"));
    }
    assert!(line("cause").ends_with("all else nominal"), "{said}");
    let decided = cause["violation"]["decided"]["time"].as_f64().unwrap();
    let expected = format!(
        "at {decided:.2} s ball tray horizontal distance is more than 0.25 m; from then on nothing can satisfy the requirement any more"
    );
    assert_eq!(line("since"), format!("since {expected}"), "{said}");
    // The recorded trace violates the predicate at that sample first in its window.
    let sample = cause["violation"]["decided"]["sample"].as_u64().unwrap() as usize;
    let axes = cause["scenario"].as_object().unwrap().iter();
    let at: Vec<String> = axes.map(|(axis, value)| format!("{axis}={value}")).collect();
    let simulate = format!(
        "simulate ball-balancing --controller ppo --space delay --at {} --seed {} --trace t.csv",
        at.join(","),
        trial["seed"].as_str().map_or(trial["seed"].to_string(), String::from)
    );
    bench.check(&simulate, 1);
    let trace = std::fs::read_to_string(bench.path("t.csv")).unwrap();
    let mut lines = trace.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let column = header.iter().position(|name| name.starts_with("ball_tray_horizontal_distance")).unwrap();
    let distance: Vec<f64> =
        lines.map(|line| line.split(',').nth(column).unwrap().parse().unwrap()).collect();
    let first = (50..=200).find(|sample| distance[*sample] > 0.25).unwrap();
    assert_eq!(first, sample, "{said}");
}

/// Each next step is a command of this program.
#[test]
fn the_next_steps_are_commands() {
    let bench = Bench::new();
    let mut seen = 0;
    for (question, ..) in QUESTIONS {
        let output = bench.run(question);
        let lines = text(&output.stdout).replace("\\\n", " ");
        for line in lines.lines().filter_map(|line| line.split_once("mishandle ")) {
            let help = bench.run(&format!("{} --help", line.1));
            assert_eq!(help.status.code(), Some(0), "{}\n{}", line.1, text(&help.stderr));
            seen += 1;
        }
    }
    assert!(seen > 8, "{seen}");
}

#[test]
fn a_pipe_has_no_colors() {
    let bench = Bench::new();
    let said = bench.check(QUESTIONS[2].0, 0);
    assert!(!said.contains('\u{1b}'), "{said}");
}

/// Failures on both sides of nominal are two ways, as they are two modes.
#[test]
fn ways_are_counted_by_axes_and_their_sides() {
    let bench = Bench::new();
    let question = "falsify toy/sphere-2d --formula 'always(distance <= 0.55)' --trials 12 --search random";
    let said = unwrapped(&bench.check(question, 1));
    let document = bench.json(&format!("{question} --json"), 1);
    let mut counts = std::collections::BTreeMap::new();
    for cause in document["trials"].as_array().unwrap().iter().map(|trial| &trial["cause"]) {
        let side =
            |axis: &str| if cause["scenario"][axis].as_f64().unwrap() < 0.0 { "below" } else { "above" };
        let axes = cause["axes"].as_array().unwrap().iter().map(|axis| axis.as_str().unwrap());
        let way: Vec<String> = axes.map(|axis| format!("{axis} {} nominal", side(axis))).collect();
        *counts.entry(way.join(" with ")).or_insert(0) += 1;
    }
    assert!(counts.contains_key("x below nominal") && counts.contains_key("x above nominal"), "{counts:?}");
    for side in ["below", "above"] {
        let way = format!("x {side} nominal");
        assert!(said.contains(&format!("{way} ({} of 12)", counts[&way])), "{counts:?}\n{said}");
    }
}
