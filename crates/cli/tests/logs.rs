//! Logs of robots: sets of requirements, several logs, topics and the files of verdicts.

use crate::bench::{Bench, text, unwrapped};

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

[units]
force = "N"
"#;

#[test]
fn a_set_of_requirements_on_several_logs_gives_a_table_worst_first() {
    let bench = Bench::new();
    bench.write("set.toml", REQUIREMENTS);
    bench.write("good.csv", "time,force\n0,1\n0.5,0\n1,0\n");
    bench.write("loud.csv", "time,force\n0,2\n0.5,1.5\n1,1.5\n");
    bench.write("bad.csv", "time,force\n0,2\n0.5,3\n1,0\n");
    let found = bench.json(
        "monitor --requirements set.toml good.csv loud.csv bad.csv --json --junit v.xml --markdown v.md",
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
    bench.check("monitor --requirements set.toml good.csv loud.csv", 0);
    bench.refuses("monitor --requirements set.toml good.csv --junit v.xml", &["v.xml exists already"]);
    bench.refuses("monitor --requirements set.toml good.csv --junit good.csv --force", &["good.csv"]);
}

#[test]
fn a_clock_that_starts_again_is_two_logs_with_a_verdict_each() {
    let bench = Bench::new();
    // The second run violates the formula. Sorted, and with one row of each time, it is gone.
    bench.write("log.csv", "time,force\n0,1\n1,1\n2,1\n# restarted\n0,9\n1,1\n2,1\n");
    for flags in ["", " -k log.sort=true -k log.duplicates=first"] {
        let ask = format!("monitor --formula 'always(force <= 2)' log.csv{flags}");
        let found = bench.json(&format!("{ask} --json"), 1);
        let verdicts: Vec<(&str, f64)> = found["verdicts"]
            .as_array()
            .expect("verdicts")
            .iter()
            .map(|verdict| {
                (verdict["log"].as_str().expect("a name"), verdict["robustness"].as_f64().expect("a number"))
            })
            .collect();
        let expected =
            [("log.csv: run 2 of 2, line 6 to line 8", -7.0), ("log.csv: run 1 of 2, line 2 to line 4", 1.0)];
        assert_eq!(verdicts, expected, "{flags}");
        let said = text(&bench.run(&ask).stderr);
        assert!(said.contains("note: the times of log.csv start again, so it is 2 logs"), "{said}");
    }
    bench.refuses(
        "monitor --formula 'always(force <= 2)' -k monitor.values=true --json log.csv",
        &["monitor.values prints the values of one log; cut this one into its runs"],
    );
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
        bench.refuses("monitor --requirements set.toml d.csv", &[part]);
    }
    let twice = "[[requirement]]\nname = \"a\"\nformula = \"d > 0\"\n".repeat(2);
    bench.write("set.toml", &twice);
    bench.refuses("monitor --requirements set.toml d.csv", &["two requirements are named `a`"]);
}

#[test]
fn topics_of_several_files_are_one_log() {
    let bench = Bench::new();
    bench.write("arm.csv", "time,q\n0,0.1\n0.5,0.2\n1,0.3\n");
    bench.write("hand.csv", "time,force\n0,1\n0.3,5\n0.7,2\n1,1\n");
    let topics = "-k log.topics.arm=arm.csv -k log.topics./hand=hand.csv";
    let formula = "--formula 'always(`/hand/force` <= 4 or `arm/q` <= 0.25)'";
    bench.refuses(
        &format!("monitor {formula} {topics}"),
        &["have different times; pass -k log.resample=hold|linear"],
    );
    let found = bench.json(&format!("monitor {formula} {topics} -k log.dense=hold --json"), 0);
    assert!((found["robustness"].as_f64().expect("a number") - 0.05).abs() < 1e-12, "{found}");
    let found = bench.json(
        &format!(
            "monitor {formula} {topics} -k log.resample=hold -k log.period=0.1 --json -k monitor.values=true"
        ),
        0,
    );
    assert_eq!(found["robustness_times"].as_array().expect("times").len(), 11);
    bench.refuses(&format!("monitor {formula} {topics} arm.csv"), &["log.topics names the files of one log"]);
    bench.refuses("monitor --formula 'x > 0'", &["there is no log: name a file, or several topics"]);
}

#[test]
fn the_text_says_when_how_long_and_by_which_part() {
    let bench = Bench::new();
    bench.write("d.csv", "time,d,v\n0,0,0\n0.1,3,0\n0.2,4,0\n0.3,0,9\n0.4,0,0\n");
    let out = text(&bench.run("monitor --formula 'always[0:0.4s](d <= 2 and v < 5)' d.csv").stdout);
    for part in [
        "FAILS d.csv: always[0s:0.4s](d <= 2 and v < 5) is violated, robustness -4",
        "d <= 2 violated from 0.1 s to 0.2 s (0.1 s), at worst -2",
        "v < 5 violated at 0.3 s, at worst -4",
        "decided by v < 5 at 0.3 s: 9 against 5",
    ] {
        assert!(unwrapped(&out).contains(part), "{out}");
    }
}

#[test]
fn a_log_is_explained_with_times_of_the_log_and_units() {
    let bench = Bench::new();
    bench.write("set.toml", REQUIREMENTS);
    bench.write("bad.csv", "time,force\n10,2\n10.5,3\n11,0\n");
    let found = bench.check("monitor --explain --requirements set.toml bad.csv", 1);
    for part in [
        "bad.csv, gentle: always(force <= 2) is violated, robustness -1",
        "From 10.5 s (sample 1) on, nothing can satisfy the formula.",
        "force is 3.0000 N, the threshold 2.0000 N. The trace violates it by 1.0000 N.",
        "bad.csv, settles",
    ] {
        assert!(found.contains(part), "{part}\n{found}");
    }
    let document = bench.json("monitor --explain --requirements set.toml bad.csv --json", 1);
    let first = &document["explanations"][0];
    assert_eq!(first["predicate"]["time"], 10.5);
    assert_eq!(first["signals"]["columns"][0]["unit"], "N");
    assert_eq!(first["verdict"]["violations"][0]["start"], 10.5);
}

#[test]
fn a_page_about_logs_has_a_section_for_each_verdict_and_escapes_names() {
    let bench = Bench::new();
    bench.write("set.toml", REQUIREMENTS);
    bench.write("<b>.csv", "time,force\n0,2\n0.5,3\n1,0\n");
    bench.write("good.csv", "time,force\n0,1\n0.5,0\n1,0\n");
    bench.check("report --requirements set.toml --log good.csv <b>.csv --out page.html", 0);
    let page = std::fs::read_to_string(bench.path("page.html")).unwrap();
    assert_eq!(page.matches("<section class=\"run\"").count(), 4);
    assert_eq!(page.matches("<svg").count(), 4);
    assert!(page.contains("&lt;b&gt;.csv") && !page.contains("<b>.csv"));
    assert!(page.contains("force (N)") && page.contains("The gripper must not crush the part"));
    let order = ["gentle on &lt;b&gt;.csv", "gentle on good.csv"].map(|name| page.find(name).expect(name));
    assert!(order[0] < order[1]);
    bench.check("report --requirements set.toml --log good.csv -k log.dense=hold --out dense.html", 0);
    assert!(std::fs::read_to_string(bench.path("dense.html")).unwrap().contains("decides at"));
}

#[test]
fn flags_of_runs_and_logs_do_not_mix() {
    let bench = Bench::new();
    bench.write("a.csv", "time,force\n0,1\n1,0\n");
    for (arguments, message) in [
        ("report run.sqlite --formula force<=1 --out p.html", "cannot be used with '--formula"),
        ("report run.sqlite --log a.csv --out p.html", "cannot be used with '--log"),
        ("report --log a.csv --out p.html", "there is no formula"),
        ("report --log a.csv --formula force<=1 --out a.csv", "--out"),
        ("report --formula force<=1 --out p.html", "there is no log"),
        ("monitor --explain a.csv --formula force<=1 -k log.dense=hold", "instead of log.dense"),
        (
            "monitor --explain a.csv --formula force<=1 -k log.strict-horizon=true",
            "leave out log.strict-horizon",
        ),
        ("monitor --explain a.csv --formula force<=1 --junit v.xml", "cannot be used with '--junit"),
        ("monitor a.csv --formula force<=1 -k monitor.values=true", "pass --json"),
        ("monitor a.csv --formula force<=1 -k log.dense=hold -k log.resample=hold", "log.resample is set"),
        ("monitor a.csv --formula force<=1 -k log.utc-offset=east", "an offset such as"),
        ("monitor a.csv --formula force<=1 -k log.delimiter=;;", "one character"),
        ("monitor a.csv --formula force<=1 -k log.missing=keep", "\"error\", \"hold\" or \"drop\""),
        ("monitor a.csv --formula force<=1 -k formula.share=0.5", "does not read; it reads log, monitor"),
    ] {
        bench.refuses(arguments, &[message]);
    }
    bench.write("set.toml", "[[requirement]]\nname = 'a'\nformula = 'force <= 1'\n[units]\nspeed = 'm/s'\n");
    bench
        .refuses("monitor --requirements set.toml a.csv", &["[units] names `speed`, which no formula reads"]);
}

#[test]
fn a_header_in_a_comment_may_have_columns_of_text() {
    let bench = Bench::new();
    let wrench = "%time,field.header.seq,field.header.stamp,field.header.frame_id,field.force.x\n\
                  1700000000100000000,0,1700000000099000000,ee_link,1\n\
                  1700000000200000000,1,1700000000199000000,ee_link,3\n";
    bench.write("wrench.csv", wrench);
    let found = bench.check("monitor --formula always(`field.force.x`<=2) wrench.csv", 1);
    assert!(found.contains("violated at 0.1 s"), "{found}");
    bench.write("modes.csv", "# time,force,mode\n0,1,auto\n0.5,3,auto\n");
    bench.check("monitor --formula always(force<=2) modes.csv", 1);
    // The first line after this comment is the header.
    bench.write("both.csv", "# made by rig 3, on Monday, at noon\ntime,force,mode\n0,1,auto\n0.5,2,auto\n");
    bench.check("monitor --formula always(force<=2) both.csv", 0);
}

#[test]
fn json_lines_are_known_by_their_first_bytes_and_may_have_the_numbers_of_python() {
    let bench = Bench::new();
    let lines = "{\"time\": 0, \"force\": 1, \"text\": \"a \\\"NaN\"}\n{\"time\": 1, \"force\": NaN}\n\
                 {\"time\": 2, \"force\": -Infinity}\n{\"time\": 3, \"force\": 3}\n";
    bench.write("log.csv", lines);
    bench.refuses(
        "monitor --formula always(force<=2) log.csv",
        &["line 2: `force`", "-k log.missing=hold|drop"],
    );
    let found = bench.check("monitor --formula always(force<=2) log.csv -k log.missing=hold", 1);
    assert!(found.contains("violated at 3 s"), "{found}");
}

#[test]
fn numbers_that_look_like_another_unit_of_time_need_the_flag() {
    let bench = Bench::new();
    bench.write("px4.csv", "timestamp,v\n165852000,0\n165872000,3\n165892000,0\n");
    let question = "monitor --formula always[0:0.04s](v<=1) -k log.time=timestamp";
    bench.refuses(&format!("{question} px4.csv"), &["mostly steps by 20000", "-k log.time-unit="]);
    bench.check(&format!("{question} -k log.time-unit=us px4.csv"), 1);
    bench.write("days.csv", "t,v\n738000.5,0\n738000.50001,3\n738000.50002,0\n");
    bench.refuses(
        "monitor --formula always(v<=1) -k log.time=t days.csv",
        &["looks like days", "-k log.time-unit="],
    );
    bench.write("slow.csv", "t,v\n0,0\n60,3\n120,0\n");
    bench.refuses("monitor --formula always(v<=1) -k log.time=t slow.csv", &["-k log.time-unit="]);
    bench.check("monitor --formula always(v<=1) -k log.time=t -k log.time-unit=s slow.csv", 1);
}

#[test]
fn a_log_that_cannot_be_read_leaves_the_verdicts_on_the_others() {
    let bench = Bench::new();
    bench.write("good.csv", "time,force\n0,1\n1,3\n");
    bench.write("empty.csv", "");
    bench.write("other.csv", "time,forse\n0,1\n1,3\n");
    let output = bench.run("monitor --formula always(force<=2) good.csv empty.csv other.csv gone.csv");
    // The violation comes first.
    assert_eq!(output.status.code(), Some(1));
    bench.check("monitor --formula always(force<=3) good.csv empty.csv", 2);
    assert!(text(&output.stdout).contains("good.csv   violated"), "{}", text(&output.stdout));
    let messages = text(&output.stderr);
    assert!(messages.contains("trace empty.csv: the file is empty"), "{messages}");
    assert!(messages.contains("3 of 4 logs have no verdict"), "{messages}");
    assert!(messages.contains("hint: did you mean `forse`?"), "{messages}");
    assert_eq!(messages.matches("No such file").count(), 1, "{messages}");
}

/// Every requirement on every log is in every output, also those without a verdict.
#[test]
fn no_output_leaves_out_a_log_or_a_requirement() {
    let bench = Bench::new();
    bench.write("good.csv", "time,force\n0,1\n1,\n2,1\n");
    bench.write("nan.csv", "time,force\n0,nan\n");
    let requirement = |name: &str, formula: &str, severity: &str| {
        format!("[[requirement]]\nname = \"{name}\"\nformula = \"{formula}\"\nseverity = \"{severity}\"\n")
    };
    let set = requirement("soft", "always(force <= 9)", "error")
        + &requirement("hard", "always[0:9s](force <= 0)", "warning")
        + &requirement("other", "always(speed <= 1)", "critical");
    bench.write("set.toml", &set);
    let read = |name: &str| std::fs::read_to_string(bench.path(name)).unwrap();
    for logs in
        [&["good.csv", "gone.csv", "nan.csv"][..], &["good.csv"], &["gone.csv"], &["gone.csv", "nan.csv"]]
    {
        // Yesterday's file has no failure.
        ["j.xml", "t.md", "p.html"].iter().for_each(|name| bench.write(name, "<testsuites/>"));
        let asked = format!("--requirements set.toml -k log.missing=hold {}", logs.join(" "));
        let output = bench.run(&format!("monitor {asked} --junit j.xml --markdown t.md --force"));
        assert_eq!(output.status.code(), Some(2), "{}", text(&output.stderr));
        let verdicts = if logs[0] == "good.csv" { 2 } else { 0 };
        let all = 3 * logs.len();
        let (junit, table) = (read("j.xml"), read("t.md"));
        assert_eq!(junit.matches("<testcase ").count(), all, "{junit}");
        assert_eq!(junit.matches("<error ").count(), all - verdicts, "{junit}");
        assert_eq!(table.matches("| no verdict |").count(), all - verdicts, "{table}");
        for json in ["--json", "--json --explain"] {
            let output = bench.run(&format!("monitor {asked} {json}"));
            let Ok(found) = serde_json::from_slice::<serde_json::Value>(&output.stdout) else {
                assert_eq!(verdicts, 0);
                continue;
            };
            assert_eq!(found["no_verdict"].as_array().map(Vec::len), Some(all - verdicts), "{found}");
        }
        let shown = text(&bench.run(&format!("monitor {asked}")).stdout);
        assert_eq!(
            shown.matches("no verdict").count(),
            if verdicts == 0 { 0 } else { all - verdicts },
            "{shown}"
        );
        let output = bench.run(&format!(
            "report --requirements set.toml -k log.missing=hold --out p.html --force --log {}",
            logs.join(" ")
        ));
        assert_eq!(output.status.code(), Some(2), "{}", text(&output.stderr));
        assert_eq!(read("p.html").matches("no verdict</span>").count(), all - verdicts);
        if verdicts > 0 {
            for file in [junit, table] {
                for note in ["window extends past the end", "1 value missing", "violated (warning)"] {
                    assert!(file.contains(note), "{note}: {file}");
                }
            }
        }
    }
    bench.refuses(
        "monitor good.csv --requirement a=force<=1 --requirement a=force<=2",
        &["two requirements are named a"],
    );
}

#[test]
fn a_requirement_without_a_verdict_leaves_those_of_the_others() {
    let bench = Bench::new();
    bench.write("log.csv", "time,force\n0,1\n1,3\n");
    let requirement = |name: &str, formula: &str, severity: &str| {
        format!("[[requirement]]\nname = \"{name}\"\nformula = \"{formula}\"\nseverity = \"{severity}\"\n")
    };
    let judged = requirement("gentle", "always(force <= 2)", "critical");
    // The name of a formula of a target, and the square root of -4.
    for (name, formula) in [("R-1", "success"), ("root", "always(sqrt(force - 5) <= 9)")] {
        bench.write("set.toml", &(requirement(name, formula, "error") + &judged));
        let output = bench.run("monitor --requirements set.toml log.csv --markdown v.md --force");
        assert_eq!(output.status.code(), Some(1));
        assert!(text(&output.stdout).contains("violated"), "{}", text(&output.stdout));
        let messages = text(&output.stderr);
        assert!(messages.contains(&format!("requirement {name}")), "{messages}");
        assert!(messages.contains("without a verdict: 1 requirement"), "{messages}");
        let table = std::fs::read_to_string(bench.path("v.md")).expect("the table");
        assert!(table.contains("gentle") && table.contains(&format!("{name} | no verdict")), "{table}");
    }
}

#[test]
fn parts_that_fail_at_the_same_time_count_once() {
    let bench = Bench::new();
    bench.write("ab.csv", "time,a,b\n0,0,0\n1,2,2\n2,2,2\n3,0,0\n");
    let found = bench.check("monitor --formula always(a<=1and(b<=1)) ab.csv ab.csv -k log.dense=hold", 1);
    assert!(found.contains("  2 s  "), "{found}");
}

#[test]
fn a_truth_value_alone_is_noted() {
    let bench = Bench::new();
    bench.write("ok.csv", "time,ok\n0,true\n1,false\n");
    let output = bench.run("monitor --formula always(ok) ok.csv");
    assert!(text(&output.stderr).contains("write ok >= 1"), "{}", text(&output.stderr));
    let output = bench.run("monitor --formula always(ok>=1) ok.csv");
    assert!(output.stderr.is_empty(), "{}", text(&output.stderr));
}

#[test]
fn a_row_does_not_move_to_an_earlier_time_for_lack_of_digits() {
    let bench = Bench::new();
    bench.write("snap.csv", "time,x\n0,0\n0.05,9\n0.1,0\n1,0\n2,0\n3,0\n");
    let question = "monitor --formula always(x<=5) -k log.resample=hold -k log.period=0.5";
    assert!(bench.check(&format!("{question} snap.csv"), 0).contains("robustness 5"));
    bench.check(&format!("{question} --follow -k monitor.idle=0.1 snap.csv"), 0);
}

#[test]
fn a_step_as_long_as_the_tolerance_is_bridged() {
    let bench = Bench::new();
    bench.write("tol.csv", "time,x\n0,0\n0.1,0\n0.2,0\n0.3,0\n0.4,0\n");
    bench.check("monitor --formula always(x<=5) -k log.dense=hold -k log.tolerance=0.1 tol.csv", 0);
}

#[test]
fn outputs_do_not_replace_the_requirements_or_each_other() {
    let bench = Bench::new();
    bench.write("set.toml", REQUIREMENTS);
    bench.write("a.csv", "time,force\n0,1\n0.5,0\n");
    let question = "monitor --requirements set.toml a.csv --force";
    bench.refuses(&format!("{question} --junit set.toml"), &["the same file as the input set.toml"]);
    bench.refuses(&format!("{question} --junit v --markdown v"), &["name the same file"]);
    bench.refuses(
        "report --requirements set.toml --log a.csv --force --out set.toml",
        &["same file as the input"],
    );
    assert_eq!(std::fs::read_to_string(bench.path("set.toml")).unwrap(), REQUIREMENTS);
}

#[test]
fn topics_whose_clocks_differ_by_months_are_no_log() {
    let bench = Bench::new();
    bench.write("a.csv", "time,v\n0,1\n1,2\n");
    bench.write("b.csv", "time,v\n1700000000,1\n1700000001,2\n");
    bench.refuses(
        "monitor --formula always(`a/v`+`b/v`<=5) -k log.topics.a=a.csv -k log.topics.b=b.csv -k log.dense=hold",
        &["do not count from the same instant"],
    );
}

#[test]
fn a_plan_states_how_logs_are_read() {
    let bench = Bench::new();
    bench.write("a.csv", "t;force\n0;1\n0,2;3\n0,3;1\n");
    bench.write(
        "rig.toml",
        "target = \"toy/sphere-2d\"\n[log]\ntime = \"t\"\ndecimal = \"comma\"\ndense = \"hold\"\n[monitor]\nbounds = true\n",
    );
    let found = bench.check("monitor --formula always(force<=2) --plan rig.toml a.csv", 1);
    assert!(found.contains("violated from 0.2 s to 0.3 s"), "{found}");
    bench.check("report --formula always(force<=2) --plan rig.toml --log a.csv --out page.html", 0);
    bench.write("topics.toml", "[log]\ndense = \"hold\"\n[log.topics]\narm = \"arm.csv\"\n");
    bench.write("arm.csv", "time,q\n0,1\n1,3\n");
    bench.check("monitor --formula always(`arm/q`<=2) --plan topics.toml", 1);
    bench.write("wrong.toml", "[log]\nperiod = 0\n");
    bench.refuses("monitor --formula q<=2 --plan wrong.toml arm.csv", &["`log.period` is 0", "above 0"]);
}

/// Two runs of a clock that nobody named would be one log, in which the first run answers for both.
#[test]
fn a_clock_of_another_name_that_starts_again_is_asked_about() {
    let bench = Bench::new();
    for name in ["t", "timestamp", "Time", "elapsed_s"] {
        bench.write("log.csv", &format!("{name},g\n0,0\n1,1\n2,0\n0,0\n1,0\n2,0\n"));
        let monitor = "monitor --formula 'eventually(g >= 1)' log.csv";
        let said = format!("`{name}` looks like the times, and starts again in line 5");
        bench.refuses(monitor, &[&said, "-k log.time="]);
        // Two logs, or samples of a stated distance.
        let named = bench.check(&format!("{monitor} -k log.time={name} -k log.time-unit=s"), 1);
        assert!(named.contains("1 violated, 1 satisfied"), "{named}");
        bench.check(&format!("{monitor} -k log.period=1"), 0);
    }
    // A flag is not a clock.
    bench.write("log.csv", "timeout,g\n0,0\n0,1\n1,0\n0,0\n0,0\n1,0\n");
    bench.check("monitor --formula 'eventually(g >= 1)' log.csv", 0);
}
