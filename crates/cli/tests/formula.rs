//! Formulas in words with their traps, and mined parameters, as a person and a program see them.

use crate::bench::{Bench, text};
use mishandle::Plan;
use mishandle::tasks::tasks;
use mishandle_requirements::{Context, describe};

const LOG: &str = "time,force,closed\n0,0,0\n0.5,1,0\n1,4,1\n1.5,7.5,1\n2,6,1\n";

/// The formulas of the tasks have no warning. Their notes are known: those of the manner join
/// forces, speeds and distances on purpose, and five samples in a row complete a task.
#[test]
fn formulas_of_the_tasks_have_no_false_alarm() {
    let allowed = ["mixed-units", "samples-not-seconds"];
    for (task, preset) in tasks().into_iter().flat_map(|task| [(task, "paper"), (task, "code")]) {
        let plan = Plan { preset: preset.to_owned(), ..Plan::new(task.definition().name, "expert") };
        let target = mishandle::resolve::described_target(&plan).expect("a target");
        let signals = target.signals.iter().chain(&target.signals_on_request);
        let context = Context {
            period: Some(target.control_dt),
            units: signals.map(|signal| (signal.name.clone(), signal.unit.clone())).collect(),
            samples: Some(target.episode_steps + 1),
            ..Context::default()
        };
        for formula in &target.formulas {
            let at_every_sample = ["safe", "completion"].contains(&&*formula.name);
            let context = Context { at_every_sample, ..context.clone() };
            for trap in describe(&formula.text, &context).expect("a formula").traps {
                let is_known = trap.severity.name() == "note" && allowed.contains(&trap.name.as_str());
                assert!(is_known, "{} of {}: {trap:?}", formula.name, plan.target);
            }
        }
    }
}

#[test]
fn a_formula_is_drawn_over_a_log() {
    let bench = Bench::new();
    bench.write("rig.csv", LOG);
    let found = bench.json("formula 'always(closed >= 1 implies force >= 5)' rig.csv --json", 0);
    let example = &found["examples"][0];
    assert_eq!((&example["kind"], &example["violated"]), (&"log".into(), &true.into()));
    // Rows 0, 1 and 3, 4 hold; row 2 is closed with a force of 4.
    let spans: Vec<(u64, u64)> = example["lanes"][1]["spans"]
        .as_array()
        .expect("spans")
        .iter()
        .filter(|span| span["state"] == "violated")
        .map(|span| (span["first"].as_u64().expect("a sample"), span["last"].as_u64().expect("a sample")))
        .collect();
    assert_eq!(spans, [(2, 2)]);
    let shown = bench.check("formula 'always(closed >= 1 implies force >= 5)' rig.csv --out a.svg", 0);
    assert!(shown.contains("rig.csv: violated, robustness -0 (its sign is the verdict)"), "{shown}");
    let svg = std::fs::read_to_string(bench.path("a.svg")).expect("the drawing");
    assert!(svg.contains("1: always(closed &gt;= 1 implies force &gt;= 5)"), "{svg}");
    bench.refuses("formula 'force >= 5' rig.csv --out a.svg", &["a.svg exists already"]);
    bench.refuses("formula 'foce >= 5' rig.csv", &["did you mean `force`?"]);
    bench.refuses("formula 'alw_[0,1](force >= 5)' rig.csv", &["did you mean `always`?"]);
}

#[test]
fn warnings_give_an_exit_code_only_if_strict() {
    let bench = Bench::new();
    let shown = bench.check("formula 'always p >= 1 implies q >= 1'", 0);
    assert!(shown.contains("warning: precedence (column 1)"), "{shown}");
    assert!(shown.contains("(always (p >= 1)) implies (q >= 1)"), "{shown}");
    bench.check("formula 'always p >= 1 implies q >= 1' --strict", 1);
    bench.check("formula 'always[0:2s](p >= 1)' --strict", 0);
    let found = bench.json("formula 'always[0:2s](p >= 1)' -k formula.episode=1 --json", 0);
    assert_eq!(found["traps"][0]["name"], "horizon-beyond-episode");
    let found = bench.json("formula 'always[0:2s](p >= 1)' -k log.period=0.3 --json", 0);
    assert_eq!(found["traps"][0]["name"], "bound-between-samples");
}

#[test]
fn names_of_a_target_and_of_a_file_are_formulas() {
    let bench = Bench::new();
    let found = bench.json("formula success --target ball-balancing --json", 0);
    assert_eq!(found["formula"], "always[50:200](ball_tray_horizontal_distance <= 0.25)");
    assert_eq!(found["signals"][0]["unit"], "m");
    assert_eq!(
        (&found["examples"][0]["kind"], &found["examples"][0]["violated"]),
        (&"episode".into(), &false.into())
    );
    bench.refuses(
        "formula 'ball_distance <= 1' --target ball-balancing",
        &["`ball_distance` is not in the trace"],
    );
    bench.write(
        "set.toml",
        "[[requirement]]\nname = \"equal\"\nformula = \"always(force <= torque)\"\n\n[units]\nforce = \"N\"\ntorque = \"N m\"\n",
    );
    let found = bench.json("formula equal --requirements set.toml --json", 0);
    assert_eq!(found["traps"][0]["name"], "unit-mismatch");
}

#[test]
fn patterns_make_formulas() {
    let bench = Bench::new();
    let all = bench.json("list patterns --json", 0);
    assert!(
        all["patterns"].as_array().expect("patterns").iter().any(|pattern| pattern["name"] == "response")
    );
    let found = bench.json(
        "formula --pattern hold-for --parameter 'p=closed >= 1' --parameter 'q=force < 20' --parameter duration=2s --json",
        0,
    );
    assert_eq!(
        found["formula"],
        "always(s_prev not(closed >= 1) and closed >= 1 implies always[0s:2s](force < 20))"
    );
    bench.refuses("formula --pattern hold-for --parameter 'p=closed >= 1'", &["needs the parameter `q`"]);
    bench.refuses("formula --pattern holdfor", &["did you mean `hold-for`?"]);
}

#[test]
fn parameters_are_mined_from_logs_and_runs() {
    let bench = Bench::new();
    bench.write("a.csv", LOG);
    bench.write("b.csv", "time,force,closed\n0,0,0\n0.5,1,0\n1,2,0\n");
    let found = bench
        .json("formula 'always(force <= limit)' --parameter limit=0:50 a.csv b.csv --json --out p.csv", 0);
    assert_eq!(
        (&found["points"][0]["values"][0], &found["points"][0]["decisive"]),
        (&7.5.into(), &"a.csv".into())
    );
    let csv = std::fs::read_to_string(bench.path("p.csv")).expect("the points");
    assert!(
        csv.starts_with(
            "limit,robustness,satisfied,support,decisive,formula\n7.5,0,2,2,a.csv,always(force <= 7.5)"
        ),
        "{csv}"
    );
    // The mined formula holds, and a tighter one does not.
    bench.check("monitor --formula 'always(force <= 7.5)' a.csv b.csv", 0);
    bench.check("monitor --formula 'always(force <= 7.499999)' a.csv b.csv", 1);
    let time = bench.json("formula 'eventually[0:T](force >= 4)' --parameter T=0:2s a.csv --json", 0);
    assert_eq!(time["points"][0]["formula"], "eventually[0s:1s](force >= 4)");
    let shown = bench.check("formula 'always(force <= limit)' --parameter limit=0:5 a.csv", 1);
    assert!(shown.contains("Nothing was mined"), "{shown}");
    let shown = bench.check("formula 'force <= limit' --parameter limit=0:50 a.csv", 0);
    assert!(shown.contains("only the first sample counts"), "{shown}");
    bench.refuses("formula 'always(force <= closed)' --parameter closed=0:5 a.csv", &["is also a signal"]);
    bench.refuses("formula 'always(force <= limit' --parameter limit=0:5 a.csv", &["column 22", "^"]);
    bench.check("evaluate toy/car-following --episodes 3 --out run.sqlite", 0);
    let gap = bench.json("formula 'always(gap >= least)' --parameter least=-100:100 run.sqlite --json", 0);
    // The three random episodes, without the corners and the center of the initial box.
    assert_eq!((&gap["outcome"], &gap["traces"]), (&"found".into(), &3.into()));
    let left_out = bench.run("formula 'always(gap >= least)' --parameter least=-100:100 run.sqlite");
    assert!(text(&left_out.stderr).contains("left out: corners"), "{}", text(&left_out.stderr));
    bench.refuses("formula 'always(force <= F)' --parameter F=0:5 a.csv", &["`F` is an operator"]);
}

#[test]
fn errors_of_empty_questions_name_what_is_missing() {
    let bench = Bench::new();
    for (arguments, part) in [
        ("formula ''", "expected a signal"),
        ("formula", "required"),
        ("formula 'x <= c' --parameter c=0:1", "there is no log"),
        ("formula 'x <= c' --parameter c=1 a.csv", "0:50 or 0:5s"),
        ("formula 'x <= c' --parameter c=0:1 --strict a.csv", "--strict is for"),
        ("formula 'x <= c' --parameter c=0:1 --out p.svg a.csv", "a .csv file"),
        ("formula 'x <= 1' --out p.csv", "a .svg file"),
        ("formula 'x <= c' --parameter c=0:1 -k formula.resolution.d=0.1 a.csv", "no --parameter declares d"),
    ] {
        let found = bench.run(arguments);
        assert_eq!(found.status.code(), Some(2), "{arguments}");
        assert!(text(&found.stderr).contains(part), "{arguments}: {}", text(&found.stderr));
    }
}
