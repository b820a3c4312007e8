//! Logs of robots: sets of requirements, several logs, topics and the files of verdicts.

#![allow(clippy::unwrap_used)]

mod bench;

use bench::{Bench, text};

const REQUIREMENTS: &str = r#"
[[requirement]]
name = "gentle"
formula = "always(force <= 2)"
description = "The gripper must not crush the part"

[[requirement]]
name = "settles"
formula = "eventually[0:0.5](always(force <= 1))"
unit = "s"
severity = "warning"
"#;

#[test]
fn a_set_of_requirements_on_several_logs_gives_a_table_worst_first() {
    let bench = Bench::new();
    bench.write("set.toml", REQUIREMENTS);
    bench.write("good.csv", "time,force\n0,1\n0.5,0\n1,0\n");
    bench.write("loud.csv", "time,force\n0,2\n0.5,1.5\n1,1.5\n");
    bench.write("bad.csv", "time,force\n0,2\n0.5,3\n1,0\n");
    let found = bench.json(
        "monitor --formulas set.toml good.csv loud.csv bad.csv --json --junit v.xml --markdown v.md",
        1,
    );
    let order: Vec<String> = found["verdicts"]
        .as_array()
        .expect("verdicts")
        .iter()
        .map(|verdict| {
            format!("{} {} {}", verdict["log"], verdict["name"], verdict["violated"]).replace('"', "")
        })
        .collect();
    assert_eq!(
        order[..3],
        ["bad.csv gentle true", "bad.csv settles true", "loud.csv settles true"].map(String::from)
    );
    let violation = &found["verdicts"][0]["violations"][0];
    assert_eq!((&violation["formula"], violation["start"].as_f64()), (&"force <= 2".into(), Some(0.5)));
    assert_eq!((violation["duration"].as_f64(), violation["worst"].as_f64()), (Some(0.0), Some(-1.0)));
    let xml = std::fs::read_to_string(bench.path("v.xml")).expect("the JUnit file");
    assert_eq!((xml.matches("<testcase").count(), xml.matches("<failure").count()), (6, 1));
    assert!(xml.contains("always(force &lt;= 2)"), "{xml}");
    let markdown = std::fs::read_to_string(bench.path("v.md")).expect("the Markdown file");
    assert_eq!(markdown.lines().count(), 8, "{markdown}");
    // A warning alone gives no exit code, and files are not overwritten.
    bench.check("monitor --formulas set.toml good.csv loud.csv", 0);
    bench.refuses("monitor --formulas set.toml good.csv --junit v.xml", &["v.xml exists already"]);
    bench.refuses("monitor --formulas set.toml good.csv --junit good.csv --force", &["good.csv"]);
}

#[test]
fn mistakes_in_a_set_of_requirements_are_named() {
    let bench = Bench::new();
    bench.write("d.csv", "d\n1\n");
    for (set, part) in [
        ("[[requirement]]\nname = \"a\"\nformula = \"d > 0\"\nseverty = \"warning\"\n", "severty"),
        ("[[requirement]]\nname = \"a\"\nformula = \"d > 0\"\nseverity = \"low\"\n", "unknown variant `low`"),
        (
            "[[requirement]]\nname = \"a\"\nformula = \"d > 0\"\nunit = \"h\"\n",
            "unit is `h`; it must be one of s, ms",
        ),
        ("[[requirement]]\nname = \"a\"\nformula = \"d > \"\n", "`a`: formula: column"),
        ("", "has no [[requirement]]"),
    ] {
        bench.write("set.toml", set);
        bench.refuses("monitor --formulas set.toml d.csv", &[part]);
    }
    let twice = "[[requirement]]\nname = \"a\"\nformula = \"d > 0\"\n".repeat(2);
    bench.write("set.toml", &twice);
    bench.refuses("monitor --formulas set.toml d.csv", &["two requirements are named `a`"]);
}

#[test]
fn topics_of_several_files_are_one_log() {
    let bench = Bench::new();
    bench.write("arm.csv", "time,q\n0,0.1\n0.5,0.2\n1,0.3\n");
    bench.write("hand.csv", "time,force\n0,1\n0.3,5\n0.7,2\n1,1\n");
    let topics = "--topic arm=arm.csv --topic /hand=hand.csv";
    let formula = "--formula 'always(`/hand/force` <= 4 or `arm/q` <= 0.25)'";
    bench.refuses(&format!("monitor {formula} {topics}"), &["have different times; pass --resample"]);
    let found = bench.json(&format!("monitor {formula} {topics} --dense hold --json"), 0);
    assert!((found["robustness"].as_f64().expect("a number") - 0.05).abs() < 1e-12, "{found}");
    let found =
        bench.json(&format!("monitor {formula} {topics} --resample hold --period 0.1 --json --values"), 0);
    assert_eq!(found["robustness_times"].as_array().expect("times").len(), 11);
    bench.refuses(&format!("monitor {formula} {topics} arm.csv"), &["--topic names the files of one log"]);
    bench.refuses("monitor --formula 'x > 0'", &["there is no log: name a file, or several topics"]);
}

#[test]
fn the_text_says_when_how_long_and_by_which_part() {
    let bench = Bench::new();
    bench.write("d.csv", "time,d,v\n0,0,0\n0.1,3,0\n0.2,4,0\n0.3,0,9\n0.4,0,0\n");
    let out = text(&bench.run("monitor --formula 'always[0:0.4s](d <= 2 and v < 5)' d.csv").stdout);
    for part in [
        "robustness -4 at time 0: violated",
        "d <= 2 violated from 0.1 s to 0.2 s (0.1 s), at worst -2",
        "v < 5 violated at 0.3 s, at worst -4",
        "decided by v < 5 at 0.3 s: the sides are 9 and 5",
    ] {
        assert!(out.contains(part), "{out}");
    }
}
