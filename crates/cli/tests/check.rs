//! `mishandle check`: exit codes, files, and one file of requirements for targets and logs.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::bench::{Bench, unwrapped};

/// The point (0.3, -0.4) must be avoided by 0.1: `x` and `y` of a scenario give the signal.
const CHECK: &str =
    "check toy/sphere-2d --requirements requirements.toml --episodes 50 --budget 100 --seed 4";

fn signal(bench: &Bench) -> String {
    let target = bench.json("list toy/sphere-2d --json", 0);
    target["target"]["signals"][0]["name"].as_str().unwrap().to_string()
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
        (format!("{FINE}{WRONG}"), "-k check.fail-on=warning", 1),
        (format!("{FINE}{}", WRONG.replace("warning", "critical")), "-k check.fail-on=critical", 1),
        (format!("{FINE}{OTHER}"), "", 2),
        (format!("{FINE}{OTHER}"), "-k check.allow-inapplicable=true", 0),
        (format!("{FINE}{OTHER}"), "-k check.fail-on=critical", 0),
        // Nothing at all was tested.
        (OTHER.to_string(), "-k check.allow-inapplicable=true", 2),
        (format!("{OTHER}severity = \"warning\"\n"), "", 2),
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
    let command = format!("{CHECK} --out checked -k check.allow-inapplicable=true -k check.fail-on=warning");
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
    // The page and the Markdown again, from the folder.
    bench.check("report checked --out again.html --markdown again.md", 0);
    assert_eq!(std::fs::read_to_string(bench.path("again.html")).unwrap(), page);
    assert_eq!(std::fs::read_to_string(bench.path("again.md")).unwrap(), read("report.md"));
    assert_eq!(read("requirements.toml"), std::fs::read_to_string(bench.path("requirements.toml")).unwrap());
    // A chart of what violates it, and the counts of searches apart from those of random scenarios.
    assert!(page.contains("<svg") && page.contains("0 of 50 random, 0 of 100 searched"), "{page}");
}

#[test]
fn what_was_not_tested_is_marked_in_every_report() {
    let bench = Bench::new();
    write(&bench, &FINE.replace("always(X", "always(0 * X"));
    let text = unwrapped(&bench.check(&format!("{CHECK} --out checked"), 2));
    let read = |name: &str| std::fs::read_to_string(bench.path(&format!("checked/{name}"))).unwrap();
    let why = "it holds whatever the values of its signals are";
    for shown in [text, read("report.md"), read("report.html"), read("junit.xml")] {
        assert!(shown.contains("not violated: asks nothing") && shown.contains(why), "{shown}");
    }
}

#[test]
fn units_of_no_signal_or_against_the_target_are_refused() {
    let bench = Bench::new();
    for (units, said) in [
        ("ball_hight = \"m\"", "[units] names `ball_hight`, which is no signal of the target"),
        ("ball_speed = \"mm/s\"", "`ball_speed` is in `mm/s`, but the target gives it in `m/s`"),
    ] {
        let formula = "[[requirement]]\nname = \"a\"\nformula = \"always(ball_speed <= 5)\"\n[units]\n";
        std::fs::write(bench.path("requirements.toml"), format!("{formula}{units}\n")).unwrap();
        let ask = "check ball-balancing --controller ppo --requirements requirements.toml --out checked";
        bench.refuses(ask, &[said]);
    }
}

#[test]
fn what_has_no_verdict_says_why() {
    let bench = Bench::new();
    write(&bench, &FINE.replace("always(X >= -10)", "always(sqrt(X - 1) >= 0)"));
    let text = unwrapped(&bench.check(&format!("{CHECK} --out checked"), 2));
    let why = "simulation 1: the formula has no finite value)";
    let page = std::fs::read_to_string(bench.path("checked/report.html")).unwrap();
    for shown in [text, page] {
        assert!(shown.contains(why), "{shown}");
    }
}

#[test]
fn a_changed_result_is_neither_reported_nor_packed() {
    let bench = Bench::new();
    write(&bench, &format!("{FINE}{WRONG}"));
    bench.check(&format!("{CHECK} --out checked"), 0);
    let path = bench.path("checked/check.json");
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, text.replacen(": \"violated\"", ": \"not violated\"", 1)).unwrap();
    let said = ["check.json does not follow from the runs of the check", "R-2"];
    bench.refuses("report checked --out page.html", &said);
    bench.refuses("evidence checked --out ev", &said);
    assert!(!bench.path("ev").exists());
}

#[test]
fn a_check_is_evidence_that_others_verify() {
    let bench = Bench::new();
    let named = "[[requirement]]\nname = \"R-0\"\nformula = \"success\"\nmax-failure-rate = 0.5\n";
    write(&bench, &format!("{named}{FINE}{WRONG}{OTHER}"));
    bench.check(&format!("{CHECK} --out checked -k check.allow-inapplicable=true"), 0);
    bench.check("evidence checked --out ev", 0);
    std::fs::remove_dir_all(bench.path("checked")).unwrap();
    let found = bench.json("evidence --verify ev -k evidence.replay=0.05 --json", 0);
    assert_eq!(found["checks"][0]["verdicts"], 4);
    // Of R-0, whose rate is below its limit, and of R-2.
    assert_eq!(found["checks"][0]["replayed"], 2);
    let place = |name: &str| bench.path(&format!("ev/checks/checked/{name}"));
    for name in ["requirements.toml", "check.json", "report.html", "report.md", "junit.xml"] {
        assert!(place(name).is_file(), "{name}");
    }
    // Names and formulas of all requirements are on the pages of the runs.
    let page = std::fs::read_to_string(bench.path("ev/pages/random-starts-system.html")).unwrap();
    for text in ["R-0", "R-1", "R-2", "&gt;= -10"] {
        assert!(page.contains(text), "{text}: {page}");
    }
    // Paths are those in the folder.
    let result = std::fs::read_to_string(place("check.json")).unwrap();
    let result: serde_json::Value = serde_json::from_str(&result).unwrap();
    let replay = result["cells"][2]["counterexample"]["replay"].as_str().unwrap();
    assert_eq!(replay, "mishandle replay checks/checked/counterexamples/R-2@system.json");
    // A forger changes the verdict in all reports, and the hashes.
    let forged = std::fs::read_to_string(place("check.json")).unwrap().replacen(
        "\"verdict\": \"violated\"",
        "\"verdict\": \"not violated\"",
        1,
    );
    std::fs::write(place("check.json"), forged).unwrap();
    let sums = |name: &str| {
        let mut command = std::process::Command::new("sha256sum");
        let output = command.arg(name).current_dir(bench.path("ev")).output().unwrap();
        String::from_utf8(output.stdout).unwrap().split(' ').next().unwrap().to_string()
    };
    let replace = |file: &str, from: &str, to: &str| {
        let text = std::fs::read_to_string(bench.path(file)).unwrap();
        assert!(text.contains(from), "{file}");
        std::fs::write(bench.path(file), text.replace(from, to)).unwrap();
    };
    let before = {
        let list = std::fs::read_to_string(bench.path("ev/SHA256SUMS")).unwrap();
        let line = list.lines().find(|line| line.ends_with("checks/checked/check.json")).unwrap().to_string();
        (line.split(' ').next().unwrap().to_string(), sums("manifest.json"))
    };
    let now = sums("checks/checked/check.json");
    let size = |text: &str| text.len();
    let grown = size("\"not violated\"") - size("\"violated\"");
    let length = std::fs::metadata(place("check.json")).unwrap().len();
    replace("ev/manifest.json", &before.0, &now);
    replace(
        "ev/manifest.json",
        &format!("\"size\": {}", length - grown as u64),
        &format!("\"size\": {length}"),
    );
    replace("ev/SHA256SUMS", &before.0, &now);
    replace("ev/SHA256SUMS", &before.1, &sums("manifest.json"));
    let found = bench.json("evidence --verify ev -k evidence.replay=0 --json", 1);
    let problems = found["problems"].to_string();
    assert!(problems.contains("the runs give another result") && problems.contains("R-2"), "{problems}");
    bench.refuses("evidence ev --out other", &["without a finished check"]);
}

/// Writes a target file with its model to the folder `own`.
pub fn pole(bench: &Bench) {
    let model = "<mujoco><worldbody><body><joint name='hinge' axis='0 1 0'/>\
                 <geom type='capsule' fromto='0 0 0 0 0 0.6' size='0.02'/></body></worldbody>\
                 <actuator><motor joint='hinge'/></actuator></mujoco>";
    std::fs::create_dir(bench.path("own")).unwrap();
    bench.write("own/pole.xml", model);
    bench.write(
        "own/pole.toml",
        "format = 1\nname = 'pole'\nmodel.file = 'pole.xml'\ncontrol = { period = 0.02, steps = 20 }\n\
         start = { hinge = 'tilt' }\nobservation = { angle = \"qpos('hinge')\" }\n\
         policy = { expression = '0 * angle', action = 'action' }\n\
         signals = { lean = { value = \"abs(qpos('hinge'))\", unit = 'rad' } }\n\
         axes = { tilt = { range = [-0.3, 0.3], unit = 'rad' } }\nformulas = { upright = 'always(lean <= 1)' }\n",
    );
}

#[test]
fn a_counterexample_of_a_target_file_replays_and_is_drawn() {
    let bench = Bench::new();
    pole(&bench);
    bench.write("requirements.toml", "[[requirement]]\nname = \"R-1\"\nformula = \"always(lean <= 0.01)\"\n");
    let command =
        "check own/pole.toml --requirements requirements.toml --episodes 4 --budget 4 --out checked --json";
    let found = bench.json(command, 1);
    let replay = |found: &serde_json::Value| {
        let command = found["cells"][0]["counterexample"]["replay"].as_str().unwrap();
        command.strip_prefix("mishandle ").unwrap().to_string()
    };
    bench.check(&replay(&found), 0);
    let page = std::fs::read_to_string(bench.path("checked/report.html")).unwrap();
    assert!(page.contains("<svg") && !page.contains("There is no picture"), "{page}");
    // In a folder of evidence, with its files alone.
    bench.check("evidence checked --out ev", 0);
    for folder in ["checked", "own"] {
        std::fs::remove_dir_all(bench.path(folder)).unwrap();
    }
    let text = std::fs::read_to_string(bench.path("ev/checks/checked/check.json")).unwrap();
    let command = replay(&serde_json::from_str(&text).unwrap()).replace("checks/", "ev/checks/");
    bench.check(&command.replace("files/", "ev/files/"), 0);
}

/// Returns the files of a folder and of those in it, but no run: SQLite may order its pages
/// otherwise.
fn texts(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(texts(&path));
        } else if path.extension().is_none_or(|end| end != "sqlite") {
            found.insert(path.clone(), std::fs::read(path).unwrap());
        }
    }
    found
}

/// A kill can come after each file of a check.
#[test]
fn a_check_that_was_killed_writes_the_files_of_one_that_was_not() {
    let bench = Bench::new();
    pole(&bench);
    let two = ["R-1", "R-2"]
        .map(|name| format!("[[requirement]]\nname = \"{name}\"\nformula = \"always(lean <= 0.01)\"\n"));
    bench.write("requirements.toml", &two.concat());
    let command =
        "check own/pole.toml --requirements requirements.toml --episodes 4 --budget 4 --out checked --json";
    let whole = bench.json(command, 1);
    for cell in whole["cells"].as_array().unwrap() {
        let replay = cell["counterexample"]["replay"].as_str().unwrap();
        assert!(!replay.contains("engine."), "the target stands beside each counterexample: {replay}");
    }
    let before = texts(&bench.path("checked"));
    for lost in [
        &["report.html"][..],
        &["report.html", "report.md", "junit.xml"],
        &["report.html", "report.md", "junit.xml", "check.json"],
        &["report.html", "report.md", "junit.xml", "check.json", "requirements.toml"],
        &["report.html", "report.md", "junit.xml", "check.json", "counterexamples/R-2@system.json"],
        &["report.html", "report.md", "junit.xml", "check.json", "counterexamples/pole.xml"],
    ] {
        for name in lost {
            std::fs::remove_file(bench.path("checked").join(name)).unwrap();
        }
        assert_eq!(bench.json(command, 1), whole, "{lost:?}");
        assert!(texts(&bench.path("checked")) == before, "{lost:?}");
    }
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
        let text = bench.check(&format!("init --template {name}"), 0);
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
