//! Requirements that hold whatever the controller does: each front says so, in each of its formats,
//! and none counts them as evidence.

use serde_json::Value;

use crate::bench::{Bench, text, unwrapped};

/// The truth about a requirement in each simulation of `toy/car-following`: gap and speed begin at
/// 15 or more, the speed is never negative, and no gap is below -50 m or above 500 m.
#[derive(Clone, Copy, PartialEq)]
enum Truth {
    /// It holds, and asks nothing for this reason.
    Nothing(&'static str),
    /// It holds, and another trace could violate it.
    Something,
    Violated,
}

use Truth::{Nothing, Something, Violated};

const FIRST: &str = "the first sample alone satisfies it";

const FORMULAS: [(&str, Truth); 15] = [
    ("gap >= 2", Nothing(FIRST)),
    ("historically(gap >= 2)", Nothing(FIRST)),
    ("gap >= 2 and speed >= 2", Nothing(FIRST)),
    ("eventually(gap >= 2)", Nothing(FIRST)),
    ("gap <= -60 implies always(speed <= 0)", Nothing(FIRST)),
    ("eventually(gap <= -60 implies speed <= 0)", Nothing(FIRST)),
    ("always(gap <= -60 implies speed <= 0)", Nothing("its premise `gap <= -60` does not hold")),
    ("always(gap <= -60 implies eventually[0:1s](speed <= 0))", Nothing("its premise")),
    ("always(speed >= 0 implies (gap <= -60 implies speed <= 0))", Nothing("its premises do not hold")),
    ("always((gap <= -60 implies speed <= 0) and (gap <= -70 implies speed <= 0))", Nothing("its premises")),
    ("always(gap - gap <= 2)", Nothing("it holds whatever the values of its signals are")),
    ("always(gap >= -50)", Something),
    ("always(speed >= 0 implies gap >= -50)", Something),
    ("always((gap <= -60 implies speed <= 0) and gap >= -50)", Something),
    ("always(gap >= 1000)", Violated),
];

const SIZE: &str = "--episodes 5 --budget 5 --seed 2";

/// Runs a command with and without `--json`, and compares exit code, text and document.
#[track_caller]
fn asks(bench: &Bench, command: &str, truth: Truth, violated: i32, found: impl Fn(&Value) -> Option<String>) {
    let code = match truth {
        Nothing(_) => 2,
        Something => 0,
        Violated => violated,
    };
    let output = bench.run(&command.replace("OUT", "text"));
    let shown = unwrapped(&text(&output.stdout));
    assert_eq!(output.status.code(), Some(code), "{command}\n{shown}\n{}", text(&output.stderr));
    let document = bench.json(&format!("{} --json", command.replace("OUT", "json")), code);
    let reason = found(&document);
    match truth {
        Nothing(part) => {
            assert!(shown.contains("asks nothing") && shown.contains(part), "{command}\n{shown}");
            assert!(reason.as_ref().is_some_and(|reason| reason.contains(part)), "{command}\n{reason:?}");
        }
        Something | Violated => {
            assert!(!shown.contains("asks nothing"), "{command}\n{shown}");
            assert_eq!(reason, None, "{command}");
        }
    }
}

/// Compares the files that a command wrote.
fn files_say(bench: &Bench, names: &[&str], truth: Truth) {
    for name in names {
        let content = std::fs::read_to_string(bench.path(name)).unwrap();
        assert_eq!(content.to_lowercase().contains("asks nothing"), matches!(truth, Nothing(_)), "{name}");
    }
}

#[test]
fn a_verdict_that_asks_nothing_says_so_everywhere_and_is_no_evidence() {
    let reason = |value: &Value| value["asks_nothing"].as_str().map(String::from);
    for (formula, truth) in FORMULAS {
        let bench = Bench::new();
        bench.write("set.toml", &format!("[[requirement]]\nname = \"R\"\nformula = \"{formula}\"\n"));
        let check = format!("check toy/car-following --requirements set.toml {SIZE} --out OUT");
        let verdict = match truth {
            Nothing(_) => "not violated: asks nothing",
            Something => "not violated",
            Violated => "violated",
        };
        asks(&bench, &check, truth, 1, |found| {
            let cell = &found["cells"][0];
            assert_eq!(cell["verdict"], verdict, "{formula}");
            cell["evidence"].as_str().filter(|text| text.contains("asks nothing")).map(String::from)
        });
        files_say(
            &bench,
            &["text/report.html", "text/report.md", "text/junit.xml", "json/check.json"],
            truth,
        );
        let named = format!("toy/car-following --requirement 'R={formula}'");
        let first = |found: &Value| reason(&found["requirements"][0]);
        asks(&bench, &format!("evaluate {named} --episodes 5 --out OUT.sqlite"), truth, 0, first);
        bench.check("report text.sqlite --out page.html --markdown page.md", 0);
        files_say(&bench, &["page.html", "page.md"], truth);
        let search = "--search random --trials 1 --budget 5 -k falsify.isolate=false -k report.repeats=0";
        asks(&bench, &format!("falsify {named} {search} --out named-OUT.sqlite"), truth, 1, first);
        let alone =
            format!("falsify toy/car-following --formula '{formula}' {search} --out alone-OUT.sqlite");
        asks(&bench, &alone, truth, 1, reason);
        bench.check("report alone-text.sqlite --out page.html --force", 0);
        // The checks before a search also name a part that asks nothing.
        let page = std::fs::read_to_string(bench.path("page.html")).unwrap();
        assert_eq!(page.contains("They ask nothing"), matches!(truth, Nothing(_)), "{formula}");
        bench.check("simulate toy/car-following --trace log.csv", 0);
        let monitor = format!("monitor --formula '{formula}' log.csv");
        asks(&bench, &monitor, truth, 1, |found| {
            assert_eq!(reason(found), reason(&found["verdicts"][0]), "{formula}");
            reason(found)
        });
        asks(&bench, "monitor --requirements set.toml log.csv", truth, 1, |found| {
            reason(&found["requirements"][0])
        });
        let logs = format!("report --log log.csv --formula '{formula}' --out log.html --force");
        bench.check(&logs, 0);
        files_say(&bench, &["log.html"], truth);
    }
}

/// The same answer comes while the log is written, and of several logs, one that asks is enough.
#[test]
fn a_log_that_asks_nothing_is_no_evidence_and_another_one_can_be() {
    let bench = Bench::new();
    bench.write("quiet.csv", "time,force,stop\n0,1,0\n0.5,1,0\n1,1,0\n");
    bench.write("stops.csv", "time,force,stop\n0,1,0\n0.5,1,1\n1,0,1\n");
    bench.write("pushes.csv", "time,force,stop\n0,9,1\n0.5,9,1\n1,9,1\n");
    bench.write("once.csv", "time,force,stop\n0,1,0\n");
    let formula = "always(stop >= 1 implies force <= 2)";
    for (logs, code) in
        [("quiet", 2), ("stops", 0), ("quiet stops", 0), ("quiet pushes", 1), ("quiet quiet", 2), ("once", 0)]
    {
        let files: String = logs.split(' ').map(|log| format!(" {log}.csv")).collect();
        let shown = text(&bench.run(&format!("monitor --formula '{formula}'{files}")).stdout);
        assert_eq!(shown.contains("asks nothing"), logs.contains("quiet"), "{shown}");
        let junit = "--junit v.xml --markdown v.md --force";
        bench.check(&format!("monitor --formula '{formula}'{files} {junit}"), code);
        let content = std::fs::read_to_string(bench.path("v.xml")).unwrap();
        assert_eq!(content.matches("<skipped").count(), logs.matches("quiet").count(), "{content}");
        let content = std::fs::read_to_string(bench.path("v.md")).unwrap();
        assert_eq!(content.contains("satisfied: asks nothing"), logs.contains("quiet"), "{content}");
    }
    // No window is inside of the log, whatever its length.
    for formula in [
        "always(eventually(always[1:2](force >= 5)))",
        "eventually(next(force >= 5))",
        "always[4:5](force >= 5)",
    ] {
        for front in ["", "--follow -k monitor.idle=0.1"] {
            let output = bench.run(&format!("monitor --formula '{formula}' {front} quiet.csv"));
            let shown = text(&output.stdout);
            assert!(shown.contains("no sample decides it"), "{formula} {front}\n{shown}");
            assert_eq!(output.status.code(), Some(2), "{formula} {front}");
        }
    }
    for (formula, log, code) in [
        (formula, "quiet.csv", 2),
        (formula, "stops.csv", 0),
        (formula, "pushes.csv", 1),
        ("force <= 2", "stops.csv", 2),
        ("always(force <= 2)", "stops.csv", 0),
    ] {
        for flags in ["", "-k log.strict-horizon=true"] {
            let follow = format!("monitor --follow -k monitor.idle=0.1 {flags} --formula '{formula}' {log}");
            let shown = bench.check(&follow, code);
            let line: Value = serde_json::from_str(shown.trim()).unwrap();
            assert_eq!(line["asks_nothing"].is_string(), code == 2, "{line}");
            bench.check(&format!("monitor {flags} --formula '{formula}' {log}"), code);
        }
    }
    // A violated formula has the trap, too.
    let found = bench.json("monitor --formula 'force <= 2' pushes.csv --json", 1);
    let trap = found["verdicts"][0]["traps"][0].as_str().unwrap();
    assert!(trap.contains("only the first sample counts") && trap.contains("always(force <= 2)"), "{trap}");
}

/// A warning does not count beside a requirement that asks something, and a violation comes first.
#[test]
fn severities_and_violations_decide_the_exit_code() {
    let bench = Bench::new();
    let nothing = "[[requirement]]\nname = \"N\"\nformula = \"gap >= 2\"\n";
    let violated = "[[requirement]]\nname = \"V\"\nformula = \"always(gap >= 1000)\"\n";
    let tested = "[[requirement]]\nname = \"T\"\nformula = \"always(gap >= -1000)\"\n";
    let warning = nothing.replace("\"N\"", "\"N\"\nseverity = \"warning\"");
    bench.check("simulate toy/car-following --trace log.csv", 0);
    for (number, (set, code)) in [
        (nothing.to_string(), 2),
        (format!("{nothing}{tested}"), 2),
        (format!("{warning}{tested}"), 0),
        (warning, 2),
        (format!("{nothing}{violated}"), 1),
    ]
    .into_iter()
    .enumerate()
    {
        bench.write("set.toml", &set);
        let check = format!("check toy/car-following --requirements set.toml {SIZE} --out checked-{number}");
        bench.check(&check, code);
        bench.check("monitor --requirements set.toml log.csv", code);
    }
    let both = "--requirement 'N=gap >= 2' --requirement 'V=always(gap >= 1000)'";
    bench.check(&format!("evaluate toy/car-following {both} --episodes 5 --out e.sqlite"), 1);
}

/// A program whose success is a formula over the signals of the toy.
const PROGRAM: &str = r#"
import json, sys
HELLO = {"protocol": 1, "name": "car", "control_dt": 1.0, "steps": 1,
  "axes": [{"name": "start", "low": 15, "high": 60, "nominal": 30}],
  "signals": [{"name": "gap"}, {"name": "speed"}], "formulas": [{"name": "success", "text": "FORMULA"}]}
for line in sys.stdin:
    q = json.loads(line)
    gap = 0.0 if q["type"] == "hello" else q["scenario"]["start"]
    answer = HELLO if q["type"] == "hello" else {"trace": {"gap": [gap, gap], "speed": [1.0, 1.0]}}
    print(json.dumps({"id": q["id"], **answer}), flush=True)
"#;

/// Questions that conclude something conclude nothing if all of their simulations ask nothing.
#[test]
fn a_question_that_concludes_says_first_that_nothing_was_asked() {
    for (formula, truth) in [
        ("gap >= 2", Nothing(FIRST)),
        ("always(gap <= -60 implies speed <= 0)", Nothing("its premise `gap <= -60` does not hold")),
        ("always(gap >= -50)", Something),
    ] {
        let bench = Bench::new();
        let reason = |found: &Value| found["asks_nothing"].as_str().map(String::from);
        let question = format!("toy/car-following --formula '{formula}' --seed 2");
        let risk = "-k risk.method=monte-carlo -k risk.simulations=100";
        asks(&bench, &format!("risk {question} {risk} --out risk-OUT.sqlite"), truth, 1, reason);
        bench.write("car.py", &PROGRAM.replace("FORMULA", formula));
        let evaluate = "evaluate --command 'python3 car.py' --episodes 5 -k evaluate.control=false";
        let code = if matches!(truth, Nothing(_)) { 2 } else { 0 };
        bench.check(&format!("{evaluate} --out a.sqlite"), code);
        asks(&bench, "compare a.sqlite a.sqlite", truth, 1, reason);
        let margin = format!("margin {question} --space dynamics+events --budget 20 --out margin-OUT.sqlite");
        asks(&bench, &margin, truth, 1, |found| {
            assert_eq!(found["no_violation_up_to"].is_null(), reason(found).is_some(), "{found}");
            reason(found)
        });
        let plan = format!(
            "target = 'toy/car-following'\nspace = 'starts'\nmetamorphic.formula = '{formula}'\nmetamorphic.pairs = 5\n\
             metamorphic.relations.r = {{ holds = 'same-verdict', change = {{ gap = '+1' }} }}\n"
        );
        bench.write("relations.toml", &plan);
        let said = bench.check("run relations.toml --out relations.sqlite", code);
        assert_eq!(said.contains("asks nothing"), code == 2, "{said}");
        // A counterexample of another formula, with this one in its place.
        let violated = "always(gap >= 1000)";
        let search = "--search random --trials 1 --budget 5 -k falsify.isolate=false -k report.repeats=0";
        bench
            .check(&format!("falsify toy/car-following --formula '{violated}' {search} --out run.sqlite"), 1);
        bench.check("regress suite --add run.sqlite", 0);
        let file = std::fs::read_dir(bench.path("suite")).unwrap().next().unwrap().unwrap().path();
        let known = std::fs::read_to_string(&file).unwrap();
        assert!(known.contains(violated), "{known}");
        std::fs::write(&file, known.replace(violated, formula)).unwrap();
        asks(&bench, "regress suite", truth, 1, |found| reason(&found["tests"][0]));
        bench.check("regress suite --junit tests.xml", code);
        files_say(&bench, &["tests.xml"], truth);
    }
}

/// No episode of 20 s decides what happens after 30 s, and the other requirement says nothing of
/// it.
#[test]
fn a_requirement_that_no_simulation_decides_is_not_met() {
    let bench = Bench::new();
    let named =
        "--requirement 'A=always(gap >= -50)' --requirement 'B=always(eventually[30s:40s](gap >= 2))'";
    let evaluate = format!("evaluate toy/car-following {named} --episodes 5 --out a.sqlite");
    let shown = unwrapped(&bench.check(&evaluate, 2));
    assert!(shown.starts_with("NO VERDICT"), "{shown}");
    assert!(shown.contains("A: violated in 0 of 5") && shown.contains("B: no verdict in 5"), "{shown}");
    bench.check("report a.sqlite --out page.html --markdown page.md", 0);
    for page in ["page.html", "page.md"] {
        let page = std::fs::read_to_string(bench.path(page)).unwrap();
        assert!(page.contains("no verdict in 5"), "{page}");
    }
}

/// A system that no scenario changes gives one simulation, whatever their number. A flag that never
/// rises has the same robustness in all of them, and was tested nevertheless.
#[test]
fn a_system_that_no_scenario_changes_is_no_evidence() {
    let constant = PROGRAM.replace("else q[\"scenario\"][\"start\"]", "else 30.0");
    for (program, formula, code) in [
        (constant.as_str(), "always(gap >= 2)", 2),
        (&constant, "always(gap >= 1000)", 1),
        (PROGRAM, "always(speed >= 1)", 0),
    ] {
        let bench = Bench::new();
        bench.write("car.py", &program.replace("FORMULA", formula));
        bench.write("set.toml", &format!("[[requirement]]\nname = 'R'\nformula = '{formula}'\n"));
        let system = "--command 'python3 car.py'";
        let named = format!("--requirement 'R={formula}'");
        let monte_carlo = "-k risk.method=monte-carlo -k risk.simulations=100";
        for (question, code) in [
            (format!("check {system} --requirements set.toml {SIZE} --out checked"), code),
            // An evaluation measures, also what is violated.
            (
                format!("evaluate {system} {named} --episodes 5 --out e.sqlite"),
                if code == 1 { 0 } else { code },
            ),
            (format!("falsify {system} --trials 1 --budget 5 --out f.sqlite"), code),
            (format!("risk {system} {monte_carlo} --out r.sqlite"), code),
            (format!("margin {system} --budget 20 --out m.sqlite"), code),
        ] {
            let output = bench.run(&question);
            let shown = unwrapped(&text(&output.stdout));
            assert_eq!(output.status.code(), Some(code), "{question}\n{shown}\n{}", text(&output.stderr));
            assert_eq!(shown.contains("nothing that was varied changes any signal"), code == 2, "{shown}");
        }
        // A comparison of two constant systems says no more than one of them.
        let compared = bench.run("compare e.sqlite e.sqlite");
        assert_eq!(compared.status.code() == Some(2), code == 2, "{}", text(&compared.stdout));
    }
}
