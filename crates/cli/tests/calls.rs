//! How often a question calls the system: for each simulation of its run file, for the probes
//! before the first one, and never unasked besides.

use std::path::Path;

use mishandle::store::RunFile;

use crate::bench::{self, Bench};

/// A system of two axes whose robustness is smooth; it writes a line for each simulation.
const SYSTEM: &str = r#"
import json, sys
HELLO = {"protocol": 1, "name": "counted", "control_dt": 1.0, "steps": 1,
  "axes": [{"name": name, "low": -1, "high": 1, "nominal": 0.0, "kind": "model"} for name in ("a", "b")],
  "signals": [{"name": "x"}], "formulas": [{"name": "success", "text": "always(x >= 0)"}]}
for line in sys.stdin:
    q = json.loads(line)
    if q["type"] == "hello": answer = HELLO
    else:
        open("calls", "a").write("1\n")
        x = 0.6 - 0.3 * q["scenario"]["a"] + 0.1 * q["scenario"]["b"]
        answer = {"trace": {"x": [x, x]}}
    print(json.dumps({"id": q["id"], **answer}), flush=True)
"#;

/// A push that is seen only with a duration, and not with a long delay, after which a robot has
/// fallen already.
const HIDDEN: &str = r#"
import json, sys
KINDS = {"push": "event", "duration": "event", "delay": "model", "unread": "model"}
HELLO = {"protocol": 1, "name": "hidden", "control_dt": 1.0, "steps": 1,
  "axes": [{"name": k, "low": 0, "high": 1, "nominal": 0.0, "kind": v} for k, v in KINDS.items()],
  "signals": [{"name": "x"}], "formulas": [{"name": "success", "text": "always(x >= 0)"}]}
for line in sys.stdin:
    q = json.loads(line)
    if q["type"] == "hello": answer = HELLO
    else:
        s = q["scenario"]
        x = s["push"] * s["duration"] if s["delay"] < 0.5 else 0.0
        answer = {"trace": {"x": [x, x]}}
    print(json.dumps({"id": q["id"], **answer}), flush=True)
"#;

/// Simulations before the first one: the nominal one, and each axis at its two bounds.
const PROBES: u64 = 5;

fn bench() -> Bench {
    let bench = Bench::new();
    bench.write("counted.py", SYSTEM);
    bench
}

/// Returns the number of calls, and forgets them.
fn calls(bench: &Bench) -> u64 {
    let lines = std::fs::read_to_string(bench.path("calls")).unwrap_or_default().lines().count();
    let _ = std::fs::remove_file(bench.path("calls"));
    lines as u64
}

/// Returns the number of simulations in a run file, those that answer no question of the user too.
fn rows(path: &Path) -> u64 {
    let run = RunFile::open(path).unwrap();
    let trials = run.trials().unwrap().into_iter().chain(run.derived_trials().unwrap());
    trials.map(|found| run.trial_simulations(found.trial.number).count() as u64).sum()
}

#[test]
fn a_question_calls_the_system_for_its_rows_and_its_probes() {
    let bench = bench();
    let safe = "always(x >= -9)";
    let fails = "always(x >= 0.4)";
    for (number, (question, budget, code)) in [
        (format!("falsify --search random --formula '{safe}' --trials 1 --budget 100"), 100, 0),
        (format!("falsify --search random --formula '{safe}' --trials 2 --budget 150"), 300, 0),
        (format!("falsify --formula '{safe}' --trials 1 --budget 60"), 60, 0),
        // A batch of one, since the rest of a batch after a violation is called and discarded.
        (
            format!("falsify --search random --formula '{fails}' --trials 1 --budget 100 -k falsify.batch=1"),
            100,
            1,
        ),
        // Corners and the control arm come besides the episodes.
        ("evaluate --episodes 40 -k evaluate.corners=false -k evaluate.control=false".to_string(), 40, 0),
        (format!("margin --formula '{safe}' --budget 60"), 60, 0),
        (format!("risk --formula '{safe}' -k risk.method=monte-carlo -k risk.simulations=100"), 100, 0),
    ]
    .into_iter()
    .enumerate()
    {
        let run = format!("{number}.sqlite");
        let output = bench.run(&format!("{question} --command 'python3 counted.py' --out {run}"));
        let said = bench::text(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{said}");
        let (calls, rows) = (calls(&bench), rows(&bench.path(&run)));
        assert_eq!(calls, rows + PROBES, "{question}");
        // Both are announced before the first simulation counts.
        assert!(said.contains(&format!("at most {budget} simulations")), "{said}");
        assert!(said.contains(&format!("after {PROBES} probes: about ")), "{said}");
        assert!(code == 1 || calls <= budget + PROBES, "{question}: {calls}");
    }
}

/// An axis without an effect is named once, beside the verdicts, in each form of them.
#[test]
fn a_check_names_the_axes_that_change_no_trace() {
    let bench = Bench::new();
    bench.write("hidden.py", HIDDEN);
    bench.write("set.toml", "[[requirement]]\nname = 'R'\nformula = 'always(x <= 2)'\n");
    let check = "check --command 'python3 hidden.py' --requirements set.toml --episodes 10 --budget 10";
    let shown = bench::unwrapped(&bench.check(&format!("{check} --out checked"), 0));
    let read = |name: &str| std::fs::read_to_string(bench.path(&format!("checked/{name}"))).unwrap();
    for text in [shown, read("report.html"), read("report.md"), read("check.json")] {
        let text = text.replace("&#96;", "`").replace("\\`", "`");
        for axis in ["push", "duration", "delay", "unread"] {
            let is_named = text.contains(&format!("axis `{axis}` changes no trace"));
            assert_eq!(is_named, axis == "unread", "{axis}: {text}");
        }
    }
}

/// The push has no effect while all other axes are away from nominal, nor while all are nominal.
#[test]
fn an_axis_whose_effect_another_one_hides_is_probed_further() {
    let bench = Bench::new();
    bench.write("hidden.py", HIDDEN);
    let said = bench.run("falsify --search random --trials 1 --budget 20 --command 'python3 hidden.py'");
    let said = bench::text(&said.stderr);
    let warned = |axis: &&str| said.contains(&format!("axis `{axis}` changes no trace"));
    let axes = ["push", "duration", "delay", "unread"];
    assert_eq!(axes.iter().filter(|axis| warned(axis)).collect::<Vec<_>>(), [&"unread"], "{said}");
}

#[test]
fn only_who_asks_for_the_smooth_region_gets_further_simulations() {
    let bench = bench();
    let question = "falsify --search random --formula 'always(x >= -9)' --trials 1 --budget 100 --json";
    let region = "-k report.smooth-region=true --command 'python3 counted.py' --out run.sqlite";
    let found = bench.json(&format!("{question} {region}"), 0);
    assert!(found["smooth_region"]["covered"].as_f64().unwrap() > 0.9, "{found}");
    assert_eq!(calls(&bench), 2 * 100 + PROBES);
}

#[test]
fn a_check_calls_the_system_for_its_runs_and_its_counterexamples() {
    let bench = bench();
    bench.write(
        "requirements.toml",
        "[[requirement]]\nname = 'R-1'\nformula = 'always(x >= -9)'\n\
         [[requirement]]\nname = 'R-2'\nformula = 'always(x >= 0.4)'\n",
    );
    let check = "check --requirements requirements.toml --episodes 30 --budget 20 --out checked --json";
    let found = bench.json(&format!("{check} --command 'python3 counted.py'"), 1);
    let runs = found["controllers"][0]["runs"].as_array().unwrap();
    let rows: u64 = runs.iter().map(|run| rows(&bench.path(run["run"].as_str().unwrap()))).sum();
    // The random run with its probes, the search for R-1 with the nominal one, and the
    // counterexample of R-2.
    assert_eq!((runs.len(), calls(&bench)), (2, rows + PROBES + 2));
}
