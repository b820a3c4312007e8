//! `mishandle check`: exit codes, files, and one file of requirements for targets and logs.

#![allow(clippy::unwrap_used)]

mod bench;

use bench::Bench;

/// The point (0.3, -0.4) must be avoided by 0.1: `x` and `y` of a scenario give the signal.
const CHECK: &str =
    "check toy/sphere-2d --requirements requirements.toml --episodes 50 --budget 100 --seed 4";

fn signal(bench: &Bench) -> String {
    let target = bench.json("targets toy/sphere-2d --json", 0);
    target["signals"][0]["name"].as_str().unwrap().to_string()
}

fn write(bench: &Bench, text: &str) {
    let text = text.replace('X', &signal(bench));
    std::fs::write(bench.path("requirements.toml"), text).unwrap();
}

const FINE: &str = "[[requirement]]\nname = \"R-1\"\nformula = \"always(X >= -10)\"\nclause = \"A <1>\"\n";
const WRONG: &str =
    "[[requirement]]\nname = \"R-2\"\nformula = \"always(X <= -10)\"\nseverity = \"warning\"\n";
const OTHER: &str = "[[requirement]]\nname = \"R-3\"\nformula = \"always(force <= 1)\"\n";

#[test]
fn exit_codes_follow_severities() {
    let bench = Bench::new();
    for (number, (text, flags, expected)) in [
        (FINE.to_string(), "", 0),
        (format!("{FINE}{WRONG}"), "", 0),
        (format!("{FINE}{WRONG}"), "--fail-on warning", 1),
        (format!("{FINE}{}", WRONG.replace("warning", "critical")), "--fail-on critical", 1),
        (format!("{FINE}{OTHER}"), "", 2),
        (format!("{FINE}{OTHER}"), "--allow-inapplicable", 0),
        (format!("{FINE}{OTHER}"), "--fail-on critical", 0),
        (format!("{FINE}max-failure-rate = 0.0001\n"), "", 2),
        (format!("{FINE}max-failure-rate = 0.1\n"), "", 0),
    ]
    .into_iter()
    .enumerate()
    {
        write(&bench, &text);
        bench.check(&format!("{CHECK} --out checked-{number} {flags}"), expected);
    }
}

#[test]
fn the_folder_has_reports_that_agree_with_the_document() {
    let bench = Bench::new();
    write(&bench, &format!("title = \"Cell <7>\"\nnotice = \"no certificate\"\n{FINE}{WRONG}{OTHER}"));
    let command = format!("{CHECK} --out checked --allow-inapplicable --fail-on warning");
    let found = bench.json(&format!("{command} --json"), 1);
    let read = |name: &str| std::fs::read_to_string(bench.path(&format!("checked/{name}"))).unwrap();
    let verdicts = ["not violated", "violated", "not applicable"];
    for (cell, verdict) in found["cells"].as_array().unwrap().iter().zip(verdicts) {
        assert_eq!(cell["verdict"], verdict);
        for name in ["report.md", "report.html", "junit.xml"] {
            assert!(read(name).contains(cell["requirement"].as_str().unwrap()), "{name}");
        }
    }
    let junit = read("junit.xml");
    for count in ["tests=\"3\"", "failures=\"1\"", "errors=\"0\"", "skipped=\"1\""] {
        assert!(junit.contains(count), "{junit}");
    }
    let page = read("report.html");
    assert!(page.contains("Cell &lt;7&gt;") && page.contains("no certificate") && !page.contains("A <1>"));
    assert!(!page.contains("<script"));
    let digest = found["controllers"][0]["runs"][0]["digest"].as_str().unwrap();
    assert!(page.contains(digest) && read("report.md").contains(digest));
    // What replays is what is recorded.
    let counterexample = &found["cells"][1]["counterexample"];
    let replay = counterexample["replay"].as_str().unwrap().strip_prefix("mishandle ").unwrap();
    assert_eq!(bench.json(&format!("{replay} --json"), 0)["robustness"], counterexample["robustness"]);
    // Again, with another number of threads.
    assert_eq!(bench.json(&format!("{command} --json --threads 1"), 1), found);
    let fresh = bench.json(&format!("{command} --json --threads 2").replace("checked", "fresh"), 1);
    assert_eq!(fresh["controllers"][0]["runs"][0]["digest"], digest);
    // The page again, from the folder.
    bench.check("report checked --out again.html", 0);
    assert_eq!(std::fs::read_to_string(bench.path("again.html")).unwrap(), page);
}

#[test]
fn logs_and_targets_read_the_same_file() {
    let bench = Bench::new();
    let text = FINE.replace("always(X >= -10)", "always[0:0.5](distance >= 2)")
        + "unit = \"s\"\nspace = \"starts\"\n";
    std::fs::write(
        bench.path("requirements.toml"),
        text.replace("clause", "severity = \"critical\"\nclause"),
    )
    .unwrap();
    std::fs::write(bench.path("log.csv"), "time,distance\n0,3\n0.5,1\n1,5\n").unwrap();
    let found = bench.json("monitor --requirements requirements.toml log.csv --json", 1);
    assert_eq!(found["verdicts"][0]["severity"], "critical");
}

#[test]
fn templates_are_files_of_requirements() {
    let bench = Bench::new();
    for name in ["iso-10218", "machinery-regulation"] {
        let text = bench.check(&format!("check --template {name}"), 0);
        assert!(text.contains("Evidence, not certification"));
        std::fs::write(bench.path("requirements.toml"), text).unwrap();
        let out = format!("checked-{name}");
        let command = format!(
            "check point-reaching --controller expert --requirements requirements.toml --out {out} --episodes 4 --budget 4"
        );
        let printed = bench.run(&format!("{command} --json")).stdout;
        let found: serde_json::Value = serde_json::from_slice(&printed).unwrap();
        assert!(found["cells"].as_array().unwrap().iter().all(|cell| cell["verdict"] != "not applicable"));
    }
}
