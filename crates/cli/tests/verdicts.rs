//! Simulations that end without a verdict, in every question: an invalid start is in no rate, any
//! other end is not a success, nothing without any verdict is a result, and a search whose first
//! simulations all fail stops.

use crate::bench::{Bench, text, unwrapped};
use serde_json::Value;

/// A simulator that ends as the function `end` of its file says.
const SIMULATOR: &str = r#"
import json, sys
from end import end
HELLO = {"protocol": 1, "name": "s", "control_dt": 0.1, "steps": 5,
  "axes": [{"name": "a", "unit": "m", "low": 0.0, "high": 1.0, "nominal": 0.5, "kind": "start"},
           {"name": "push", "unit": "N", "low": -1.0, "high": 1.0, "nominal": 0.0, "kind": "input"}],
  "signals": [{"name": "x", "unit": "m"}], "formulas": [{"name": "low", "text": "always(x <= 0.8)"}]}
for line in sys.stdin:
    q = json.loads(line)
    print(json.dumps({"id": q["id"], **(HELLO if q["type"] == "hello" else end(q["scenario"]["a"]))}), flush=True)
"#;

/// Ends without a verdict: name, answer, and whether a search gives up on them.
const ENDS: [(&str, &str, bool); 6] = [
    ("invalid", "{'end': 'invalid', 'reason': 'no steady state'}", true),
    ("error", "{'error': 'no license'}", true),
    ("crash", "sys.exit('no license')", true),
    ("nan", "{'trace': {'x': [None] * 6}}", true),
    ("diverged", "{'end': 'diverged'}", false),
    ("undecided", "{'trace': {'x': [0.0, 0.0]}, 'end': 'terminated'}", false),
];

const COMMAND: &str = "--command 'python3 s.py'";

/// Returns a folder with the simulator, which ends with `answer` where `condition` holds for the
/// start `a`; otherwise `a` is the signal, and starts above 0.8 fail.
fn bench(condition: &str, answer: &str) -> Bench {
    let bench = Bench::new();
    bench.write("s.py", SIMULATOR);
    bench.write(
        "end.py",
        &format!(
            "import sys\ndef end(a): return {answer} if {condition} else {{'trace': {{'x': [a] * 6}}}}\n"
        ),
    );
    bench
}

/// Returns exit code, JSON document and messages.
#[track_caller]
fn ask(bench: &Bench, arguments: &str) -> (Option<i32>, Value, String) {
    let mut command = bench.command(&format!("{arguments} --json"));
    let output = command.env("MISHANDLE_ALLOW_PROGRAMS", "1").output().unwrap();
    let document = serde_json::from_slice(&output.stdout).unwrap_or_default();
    (output.status.code(), document, text(&output.stderr))
}

/// Returns the number of recorded simulations.
fn rows(bench: &Bench, run: &str) -> usize {
    bench.check(&format!("export {run} --out rows.csv --force"), 0);
    std::fs::read_to_string(bench.path("rows.csv")).unwrap().lines().count() - 1
}

#[test]
fn nothing_without_a_verdict_is_a_result() {
    for (end, answer, _) in ENDS {
        let bench = bench("True", answer);
        let (code, found, err) = ask(&bench, &format!("evaluate {COMMAND} --episodes 4 --out e.sqlite"));
        assert_eq!(code, Some(2), "{end}: {err}");
        assert!(err.contains("no simulation has a verdict"), "{end}: {err}");
        let rate = &found["success_rate"];
        let n = if end == "invalid" { 0 } else { 4 };
        assert_eq!((&rate["value"], &rate["n"]), (&Value::Null, &Value::from(n)), "{end}");
        let corners = &found["corners"];
        assert_eq!(
            (&corners["center_succeeds"], &corners["succeeding"]),
            (&Value::Null, &Value::from(0)),
            "{end}"
        );
        let counted = if end == "invalid" { 0 } else { 2 };
        assert_eq!(
            (&corners["n"], &corners["without_verdict"]),
            (&Value::from(counted), &Value::from(counted))
        );

        let listed = bench.check("show .", 0);
        assert!(
            listed.lines().any(|line| line.contains("e.sqlite") && line.ends_with("no verdict")),
            "{end}: {listed}"
        );

        let (code, found, err) = ask(&bench, "compare e.sqlite e.sqlite");
        assert_eq!(code, Some(2), "{end}: {err}");
        for rate in ["first", "second", "difference"] {
            assert_eq!(found["success"][rate]["value"], Value::Null, "{end}");
        }

        bench.write("c.toml", "target = 'process:python3 s.py'\nseed = [0]\n[evaluate]\nepisodes = 3\n");
        let (code, found, err) = ask(&bench, "run c.toml --out c");
        assert_eq!((code, found["runs"].as_array().unwrap().len()), (Some(2), 1), "{end}: {err}");
        let mut command = bench.command("run --resume c");
        let output = command.env("MISHANDLE_ALLOW_PROGRAMS", "1").output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{end}");
        let out = text(&output.stdout);
        assert!(!out.contains("0.00 %") && out.contains("  -  "), "{end}: {out}");
    }
}

/// Of simulations without a verdict, no line says that a requirement holds or fails.
#[test]
fn no_line_concludes_from_simulations_without_a_verdict() {
    for (end, answer, _) in ENDS {
        for condition in ["True", "a < 0.5"] {
            let bench = bench(condition, answer);
            for question in
                ["evaluate --episodes 12", "falsify --trials 1 --budget 12", "risk --simulations 12"]
            {
                let said = unwrapped(&text(&bench.run(&format!("{question} {COMMAND}")).stdout));
                let is_tested = condition != "True";
                assert!(
                    is_tested || said.is_empty() || said.starts_with("NO VERDICT "),
                    "{end} {question}: {said}"
                );
                // An invalid start is in no rate.
                assert!(end == "invalid" || !said.starts_with("HOLDS "), "{end} {question}: {said}");
                assert!(
                    said.is_empty() || said.contains("verdict") || end == "invalid",
                    "{question}: {said}"
                );
            }
        }
    }
}

#[test]
fn tables_and_pages_have_no_verdict_instead_of_failures() {
    let bench = bench("True", "{'error': 'no license'}");
    let out = text(&bench.run(&format!("evaluate {COMMAND} --episodes 2 --out e.sqlite")).stdout);
    assert!(out.starts_with("NO VERDICT "), "{out}");
    assert!(!out.contains("0 %") && !out.contains("FAILS") && !out.contains("violat"), "{out}");
    bench.check("report e.sqlite --out r.html", 0);
    let page = std::fs::read_to_string(bench.path("r.html")).unwrap();
    let sentence =
        "No simulation at the corners of the initial box has a verdict; its center has no verdict.";
    assert!(page.contains(sentence) && page.contains("No simulation of s has a verdict"), "{page}");
    bench.check("compare e.sqlite e.sqlite --out c.html", 2);
    let page = std::fs::read_to_string(bench.path("c.html")).unwrap();
    assert!(page.contains("No random simulation of A or of B has a verdict"), "{page}");
    assert!(!page.contains("0 %") && !page.contains("differ significantly"), "{page}");
}

#[test]
fn a_search_stops_if_its_first_simulations_all_fail_and_a_resumed_one_too() {
    let searches = ["falsify --trials 3 --budget 300", "risk --simulations 5000", "margin --space scenarios"];
    for (end, answer, gives_up) in ENDS.into_iter().filter(|(end, ..)| !matches!(*end, "crash" | "undecided"))
    {
        let bench = bench("True", answer);
        for (number, search) in searches.iter().enumerate() {
            let budget = if gives_up {
                ""
            } else {
                [" --trials 2 --budget 30", " --simulations 200", " --budget 60"][number]
            };
            let search = if gives_up { search } else { search.split(' ').next().unwrap() };
            let space = if search == "margin" { " --space scenarios" } else { "" };
            let run = format!("r{number}.sqlite");
            let (code, found, err) = ask(&bench, &format!("{search}{budget}{space} {COMMAND} --out {run}"));
            assert_eq!(code, Some(2), "{end} {search}: {err}");
            assert_eq!(
                err.contains("the first 20 simulations have no verdict"),
                gives_up,
                "{end} {search}: {err}"
            );
            assert_eq!(found.is_null(), gives_up, "{end} {search}");
            if !gives_up {
                continue;
            }
            let reason = match end {
                "invalid" => "no steady state",
                "error" => "no license",
                _ => "the signal `x` is not finite",
            };
            assert!(err.contains(reason), "{end} {search}: {err}");
            let recorded = rows(&bench, &run);
            assert!((20..=64).contains(&recorded), "{end} {search}: {recorded} rows");
            let kind = search.split(' ').next().unwrap();
            let (code, _, err) = ask(&bench, &format!("{kind} --resume {run}"));
            assert_eq!(code, Some(2), "{end} {search}: {err}");
            assert!(
                err.contains("the first 20 simulations have no verdict") && err.contains(reason),
                "{err}"
            );
            assert_eq!(rows(&bench, &run), recorded, "{end} {search}");
        }
        let pairs = if gives_up { 100 } else { 15 };
        bench.write(
            "c.toml",
            &format!(
                "target = 'process:python3 s.py'\nseed = [0]\nmetamorphic.pairs = {pairs}\n\
                 metamorphic.relations.r.change.a = '*0.5'\n"
            ),
        );
        for start in ["run c.toml --out c", "run --resume c"] {
            let (code, found, err) = ask(&bench, start);
            assert_eq!(code, Some(2), "{end} {start}: {err}");
            let stops = err.contains("the first 20 simulations have no verdict");
            assert_eq!(stops, gives_up, "{end} {start}: {err}");
            assert_eq!(found["runs"].as_array().unwrap().is_empty(), gives_up, "{end} {start}");
            let recorded = rows(&bench, "c/0.sqlite");
            assert!(!gives_up || (20..=64).contains(&recorded), "{end} {start}: {recorded} rows");
        }
    }
}

#[test]
fn an_invalid_start_is_in_no_rate() {
    let bench = bench("a < 0.5", "{'end': 'invalid'}");
    let (code, found, err) = ask(&bench, &format!("evaluate {COMMAND} --episodes 40 --out e.sqlite"));
    assert_eq!(code, Some(0), "{err}");
    let invalid = found["failed"].as_u64().unwrap();
    let n = found["success_rate"]["n"].as_u64().unwrap();
    assert!(invalid > 5 && invalid + n == 40);
    // The corner at 0 cannot start, that at 1 fails, and the center succeeds.
    let corners = &found["corners"];
    assert_eq!(
        (&corners["n"], &corners["succeeding"], &corners["center_succeeds"]),
        (&1.into(), &0.into(), &true.into())
    );
    assert_eq!(
        (&corners["points"][0]["counts"], &corners["points"][0]["invalid_starts"]),
        (&false.into(), &1.into())
    );

    let (code, compared, err) = ask(&bench, "compare e.sqlite e.sqlite");
    assert_eq!(code, Some(0), "{err}");
    assert_eq!((&compared["pairs"], &compared["left_out"]), (&n.into(), &invalid.into()));
    assert_eq!(compared["success"]["first"], found["success_rate"]);

    // 0.2 of 0.5 fail.
    let (code, found, err) =
        ask(&bench, &format!("risk {COMMAND} --simulations 400 -k risk.method=monte-carlo --out r.sqlite"));
    assert_eq!(code, Some(1), "{err}");
    let part = &found["monte_carlo"];
    let probability = &found["probability"];
    let invalid = part["invalid_starts"].as_u64().unwrap();
    assert_eq!((&part["failure_rate"]["n"], &part["without_verdict"]), (&(400 - invalid).into(), &0.into()));
    assert!(probability["low"].as_f64() < Some(0.4) && probability["high"].as_f64() > Some(0.4), "{found}");
}

#[test]
fn a_crash_is_no_success_beside_simulations_that_succeed() {
    let bench = bench("a < 0.5", "{'error': 'no license'}");
    let (code, found, err) = ask(&bench, &format!("evaluate {COMMAND} --episodes 40 --out e.sqlite"));
    assert_eq!((code, &found["success_rate"]["n"]), (Some(0), &40.into()), "{err}");
    let (code, compared, err) = ask(&bench, "compare e.sqlite e.sqlite");
    assert_eq!((code, &compared["pairs"]), (Some(2), &40.into()), "{err}");
    assert_eq!(compared["first"]["without_verdict"]["failed"], found["failed"]);
}

/// Half of the space has no verdict, and a fifth fails: the true rate can be 0.7. No page or table
/// states a rate of the others alone.
#[test]
fn a_page_states_no_rate_of_the_simulations_with_a_verdict_alone() {
    let bench = bench("a < 0.5", "{'end': 'diverged'}");
    let (_, found, err) = ask(&bench, &format!("evaluate {COMMAND} --episodes 40 --out e.sqlite"));
    let rate = &found["violation_rate"];
    assert!(rate["n"] == 40 && rate["high"].as_f64() > Some(0.5), "{rate} {err}");
    let page = |run: &str| {
        let report = format!("report {run} --out p.html --markdown p.md -k report.simulations=false --force");
        let mut command = bench.command(&report);
        let output = command.env("MISHANDLE_ALLOW_PROGRAMS", "1").output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        std::fs::read_to_string(bench.path("p.md")).unwrap()
    };
    let said = page("e.sqlite");
    let headline = format!("in {} of 40 random scenarios", found["violations"]);
    assert!(said.contains(&headline), "{said}");
    assert!(said.contains("counts those without a verdict as failures"), "{said}");

    bench.write(
        "end.py",
        "def end(a): return {'end': 'diverged'} if a < 0.8 else {'trace': {'x': [a] * 6}}\n",
    );
    let keep_going = "--search random --trials 1 --budget 40 -k falsify.keep-going=true";
    let (_, found, err) = ask(&bench, &format!("falsify {COMMAND} {keep_going} --out f.sqlite"));
    let ends = &found["without_verdict"];
    assert!(ends["diverged"].as_u64() > Some(0), "{ends} {err}");
    let said = page("f.sqlite");
    assert!(!said.contains("simulations fail.</strong>") && !said.contains("All "), "{said}");
    assert!(said.contains(&format!("Of the {} random simulations", ends["simulations"])), "{said}");
}

/// Requirements of the simulator, for `check`.
const REQUIREMENTS: &str = "[[requirement]]\nname = 'low'\nformula = 'low'\n";

/// The questions, each with a run file of its own and the exit code with too many simulations
/// without a verdict.
const QUESTIONS: [(&str, i32); 4] = [
    ("evaluate --episodes 80", 0),
    ("falsify --trials 1 --budget 80", 0),
    ("margin --space scenarios --budget 80", 2),
    ("risk --simulations 400 -k risk.method=monte-carlo", 2),
];

/// In 35 % of the space, simulations end so; everywhere else, the formula is satisfied. Each
/// question says so first, and concludes nothing. The true failure probability can be 0.35.
#[test]
fn a_region_without_a_verdict_is_said_first_and_nothing_is_concluded_about_it() {
    for (end, answer, _) in ENDS.into_iter().filter(|(end, ..)| !matches!(*end, "invalid" | "crash")) {
        let bench = bench("a > 0.65", answer);
        bench.write(
            "end.py",
            &std::fs::read_to_string(bench.path("end.py")).unwrap().replace("[a]", "[0.1 * a]"),
        );
        for (number, (question, expected)) in QUESTIONS.into_iter().enumerate() {
            let run = format!("{question} {COMMAND} --out r{number}.sqlite");
            let (code, found, err) = ask(&bench, &run);
            assert_eq!(code, Some(expected), "{end} {question}: {err}");
            assert_eq!(err.contains("no conclusion"), expected == 2, "{end} {question}: {err}");
            let share = found["without_verdict"]["share"].as_f64().unwrap();
            // A search chooses its scenarios.
            let is_random = question.starts_with("evaluate") || question.starts_with("risk");
            assert!(
                if is_random { (0.2..0.5).contains(&share) } else { share > 0.05 },
                "{end} {question}: {share}"
            );
            let mut shown = bench.command(&format!("show r{number}.sqlite"));
            let shown = text(&shown.env("MISHANDLE_ALLOW_PROGRAMS", "1").output().unwrap().stdout);
            assert!(shown.contains("have no verdict: "), "{end} {question}: {shown}");
            let mut again = bench.command(&run.replace("--out r", "--out again"));
            let out = text(&again.env("MISHANDLE_ALLOW_PROGRAMS", "1").output().unwrap().stdout);
            let first = out.lines().next().unwrap_or_default();
            assert!(first.contains(" %) have no verdict: "), "{end} {question}: {out}");
            assert!(!out.contains("up to the largest disturbance"), "{end}: {out}");
            match number {
                0 => {
                    let rate = &found["violation_rate"];
                    assert!(rate["high"].as_f64() > Some(0.35) && rate["n"] == 80, "{end}: {rate}");
                }
                1 => assert_eq!(found["failure_rate_bound"], Value::Null, "{end}"),
                2 => assert_eq!(found["no_violation_up_to"], Value::Null, "{end}"),
                3 => {
                    let part = &found["monte_carlo"]["failure_rate"]["high"];
                    let bound = &found["bounds"][1];
                    assert!(bound.as_f64() > Some(0.35) && part == bound, "{end}: {bound} {part}");
                }
                _ => {}
            }
        }
        let (code, _, err) = ask(&bench, "compare r0.sqlite r0.sqlite");
        assert_eq!((code, err.contains("no conclusion")), (Some(2), true), "{end}: {err}");
        let shown = bench.check("compare r0.sqlite r0.sqlite", 2);
        assert!(shown.starts_with("NO VERDICT"), "{end}: {shown}");
        let (code, _, err) = ask(&bench, "compare r0.sqlite r0.sqlite -k max-without-verdict=0.6");
        assert_eq!(code, Some(0), "{end}: {err}");
        bench.write("r.toml", REQUIREMENTS);
        let check = format!("check {COMMAND} --requirements r.toml --episodes 40 --budget 40 --out checked");
        let (code, found, err) = ask(&bench, &check);
        assert_eq!((code, &found["cells"][0]["verdict"]), (Some(2), &"no verdict".into()), "{end}: {err}");
        // A larger share is allowed on request.
        let risk = format!("{} {COMMAND} -k max-without-verdict=0.6 --out allowed.sqlite", QUESTIONS[3].0);
        assert_eq!(ask(&bench, &risk).0, Some(0), "{end}");
    }
}

/// As above where the process ends or answers too late, with few simulations: each of these takes a
/// process or a time limit.
#[test]
fn nothing_is_concluded_about_a_region_in_which_the_simulator_crashes_or_hangs() {
    for answer in ["sys.exit('no license')", "__import__('time').sleep(60)"] {
        let bench = bench("a > 0.65", answer);
        for (file, from, to) in
            [("end.py", "[a]", "[0.1 * a]"), ("s.py", "\"steps\": 5,", "\"steps\": 5, \"time_limit\": 0.3,")]
        {
            bench.write(file, &std::fs::read_to_string(bench.path(file)).unwrap().replace(from, to));
        }
        bench.write("r.toml", REQUIREMENTS);
        for (number, (question, expected)) in [
            ("evaluate --episodes 30", 0),
            ("margin --space scenarios --budget 30", 2),
            ("risk --simulations 100 -k risk.method=monte-carlo", 2),
            ("check --requirements r.toml --episodes 30 --budget 30", 2),
        ]
        .into_iter()
        .enumerate()
        {
            let (code, found, err) = ask(&bench, &format!("{question} {COMMAND} --out r{number}.sqlite"));
            assert_eq!(code, Some(expected), "{answer} {question}: {err}");
            let without = &found["without_verdict"];
            assert!(without["share"].as_f64() > Some(0.05), "{answer} {question}: {without}");
            let total = without["simulations"].as_f64().unwrap() * without["share"].as_f64().unwrap();
            assert_eq!(without["failed"].as_f64(), Some(total.round()), "{answer} {question}: {without}");
        }
        let (code, _, err) = ask(&bench, "compare r0.sqlite r0.sqlite");
        assert_eq!((code, err.contains("no conclusion")), (Some(2), true), "{answer}: {err}");
    }
}

/// All pairs together have enough verdicts, and those of one relation have none.
#[test]
fn each_relation_needs_verdicts_of_its_own() {
    let bench = bench("a >= 1.0", "{'end': 'diverged'}");
    let relation = |name: &str, change: &str| {
        format!("[metamorphic.relations.{name}]\nholds = 'same-verdict'\nchange = {{ {change} }}\n")
    };
    let plan = "target = 'process:python3 s.py'\nspace = 'scenarios'\nmax-without-verdict = 0.5\n\
                metamorphic.pairs = 20\nmetamorphic.formula = 'always(x >= -1)'\n";
    let small = format!("{plan}{}", relation("small", "push = '+0.0'"));
    bench.write("plan.toml", &small);
    let (code, _, err) = ask(&bench, "run plan.toml --out small.sqlite");
    assert_eq!(code, Some(0), "{err}");
    bench.write("plan.toml", &format!("{small}{}", relation("big", "a = '=1'")));
    let (code, found, err) = ask(&bench, "run plan.toml --out both.sqlite");
    assert_eq!(code, Some(2), "{err}");
    assert!(err.contains("no conclusion about the relation big: 20 of its 20 pairs"), "{err}");
    let share = found["without_verdict"]["share"].as_f64().unwrap();
    assert!(share < 0.5, "{found}");
}

/// A violation counts, however many simulations have no verdict.
#[test]
fn a_violation_beside_simulations_without_a_verdict_is_a_violation() {
    let bench = bench("a < 0.35", "{'end': 'diverged'}");
    for (number, (question, _)) in QUESTIONS.into_iter().enumerate().skip(1) {
        let (code, _, err) = ask(&bench, &format!("{question} {COMMAND} --out r{number}.sqlite"));
        assert_eq!(code, Some(1), "{question}: {err}");
    }
    bench.write("r.toml", REQUIREMENTS);
    let check = format!("check {COMMAND} --requirements r.toml --episodes 40 --budget 40 --out checked");
    assert_eq!(ask(&bench, &check).0, Some(1));
}

/// The disturbance alone ends the simulations: an effect of 100 %, and none on starts alone.
#[test]
fn the_control_arm_shows_an_end_that_only_the_disturbance_causes() {
    let bench = bench("False", "None");
    let simulator = std::fs::read_to_string(bench.path("s.py")).unwrap();
    let diverging = "{'end': 'diverged'} if q[\"scenario\"][\"push\"] > 0.3 else {'trace': {'x': [0.0] * 6}}";
    bench.write("s.py", &simulator.replace("end(q[\"scenario\"][\"a\"])", &format!("({diverging})")));
    let (code, found, err) =
        ask(&bench, &format!("evaluate {COMMAND} --space scenarios --episodes 60 --out e.sqlite"));
    assert_eq!(code, Some(0), "{err}");
    let diverged = found["diverged"].as_u64().unwrap();
    assert!((10..32).contains(&diverged), "{diverged} of 60, expected 0.35 of them");
    let control = &found["control"];
    assert_eq!((&control["fails_only_in_space"], &control["left_out"]), (&diverged.into(), &0.into()));
    assert!(control["p_value"].as_f64() < Some(0.01), "{control}");
    assert_eq!(control["success_rate"]["value"].as_f64(), Some(1.0));
}

/// A counterexample whose simulation ends without a verdict is not fixed.
#[test]
fn a_counterexample_without_a_verdict_is_not_fixed() {
    let bench = bench("False", "None");
    let (code, _, err) = ask(&bench, &format!("falsify --trials 1 --budget 60 {COMMAND} --out f.sqlite"));
    assert_eq!(code, Some(1), "{err}");
    // The file of the target is copied, without what it imports.
    ask(&bench, "regress failures --add f.sqlite");
    bench.write("failures/end.py", "def end(a): return {'trace': {'x': [a] * 6}}\n");
    assert_eq!(ask(&bench, "regress failures").0, Some(1));
    bench.write("failures/end.py", "def end(a): return {'end': 'diverged'}\n");
    let (code, found, err) = ask(&bench, "regress failures");
    assert_eq!((code, &found["without_verdict"]), (Some(2), &1.into()), "{err}");
    assert_eq!((&found["tests"][0]["result"], &found["passes"]), (&"no verdict".into(), &0.into()));
    // In words, not as the program stores it.
    let (_, found, err) = ask(&bench, "regress failures");
    let shown = found.to_string() + &err;
    assert!(shown.contains("diverged in control step") && !shown.contains("Diverged"), "{shown}");
    bench.write("failures/end.py", "def end(a): sys.exit('no license')\n");
    let (_, found, err) = ask(&bench, "regress failures");
    assert!((found.to_string() + &err).contains("no license"), "{found}{err}");
    bench.write("failures/end.py", "def end(a): return {'trace': {'x': [0.0] * 6}}\n");
    assert_eq!(ask(&bench, "regress failures").0, Some(0));
}

#[test]
fn a_campaign_goes_on_after_a_search_that_stopped() {
    let bench = bench("a >= 0", "sys.exit('no license')");
    bench.write(
        "c.toml",
        "target = ['process:python3 s.py', 'toy/sphere-2d']\n[falsify]\ntrials = 2\nbudget = 40\n",
    );
    for start in ["run c.toml --out c", "run --resume c"] {
        let (code, found, err) = ask(&bench, start);
        assert_eq!((code, found["runs"].as_array().unwrap().len()), (Some(2), 1), "{err}");
        assert!(
            err.contains("the first 20 simulations have no verdict") && err.contains("no license"),
            "{err}"
        );
    }
}
