//! Error messages speak of the user's values and files, not of the libraries that read them.

use crate::bench::{Bench, text};

/// Returns the message of a command that must fail.
#[track_caller]
fn message(bench: &Bench, arguments: &str) -> String {
    let output = bench.run(arguments);
    let err = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{arguments}: {err}");
    err
}

/// Checks a message, which must not contain the words of a library.
#[track_caller]
fn check(bench: &Bench, arguments: &str, parts: &[&str]) {
    let err = message(bench, arguments);
    for part in parts {
        assert!(err.contains(part), "{arguments} does not print `{part}`:\n{err}");
    }
    for word in
        ["u64", "u32", "usize", "f64", "float literal", "digit found", "CSV error", "struct ", "invalid type"]
    {
        assert!(!err.contains(word), "{arguments} prints `{word}`:\n{err}");
    }
}

#[test]
fn an_unknown_command_gets_the_list_of_commands() {
    let bench = Bench::new();
    for name in ["runs", "bisect", "view", "counterexamples"] {
        let err = message(&bench, name);
        for group in ["The commands:", "Ask: evaluate, falsify", "See: show", "Set up: list, init"] {
            assert!(err.contains(group), "{name}: {err}");
        }
    }
    assert!(message(&bench, "runs").contains("'run'"));
}

#[test]
fn an_unknown_flag_with_the_name_of_a_key_gets_the_key() {
    let bench = Bench::new();
    for (arguments, key) in [
        ("evaluate toy/sphere-2d --stochastic", "-k stochastic=VALUE"),
        ("falsify toy/sphere-2d --early-stopping", "-k falsify.early-stopping=VALUE"),
        ("monitor a.csv --formula x>0 --dense hold", "-k log.dense=VALUE"),
        ("train point-reaching --device gpu", "-k train.device=VALUE"),
    ] {
        let err = message(&bench, arguments);
        assert!(err.contains(key), "{arguments}: {err}");
    }
    let err = message(&bench, "evaluate toy/sphere-2d --early-stopping");
    assert!(!err.contains("-k "), "{err}");
}

#[test]
fn a_wrong_number_on_the_command_line_is_repeated_with_the_allowed_numbers() {
    let bench = Bench::new();
    let integer =
        |low: u64, high: u64| format!("expected an integer from {low} to {high}, such as 10, 1_000 or 1e3");
    let toy = "falsify toy/sphere-2d";
    for (command, flag, allowed) in [
        (toy, "--seed", integer(0, u64::MAX)),
        (toy, "--threads", integer(1, 1024)),
        (toy, "--trials", integer(1, 1_000_000)),
        (toy, "--budget", integer(1, 1_000_000)),
        (toy, "--action-noise", "expected a number from 0 to 10, such as 0.5".to_string()),
        ("evaluate toy/sphere-2d", "--episodes", integer(1, 1_000_000_000)),
        ("replay a.sqlite", "--trial", integer(1, u32::MAX.into())),
        ("replay a.sqlite", "--simulation", integer(1, u32::MAX.into())),
        ("render --out a.png a.sqlite", "--trial", integer(1, u32::MAX.into())),
        ("render --out a.png a.sqlite", "--simulation", integer(1, u32::MAX.into())),
        (
            "render --out a.png point-reaching",
            "--at",
            "expected a number in the unit of the axis".to_string(),
        ),
        ("train point-reaching", "--steps", integer(1, 1_000_000_000_000)),
    ] {
        check(
            &bench,
            &format!("{command} {flag} many"),
            &["'many'", flag, "the value is not a number", &allowed],
        );
        if allowed.contains("integer") {
            check(
                &bench,
                &format!("{command} {flag} -1"),
                &["'-1'", flag, "the value is negative", &allowed],
            );
            check(
                &bench,
                &format!("{command} {flag} 1e20"),
                &["'1e20'", flag, "the value is too large", &allowed],
            );
        }
        if allowed.contains("integer from 1") {
            check(&bench, &format!("{command} {flag} 0"), &["'0'", flag, "the value is too small", &allowed]);
        }
    }
    for (flag, value) in [("--action-noise", "-1"), ("--action-noise", "nan"), ("--action-noise", "10.5")] {
        check(
            &bench,
            &format!("{toy} {flag} {value}"),
            &[flag, value, "out of range", "a number from 0 to 10"],
        );
    }
    for period in ["0", "-1", "inf", "nan", "many"] {
        check(
            &bench,
            &format!("monitor --formula d>0 a.csv -k log.period={period}"),
            &[&format!("`log.period` is {period}; it must be a number of seconds above 0")],
        );
    }
}

#[test]
fn a_wrong_value_or_key_in_a_plan_is_named_with_its_line_and_what_is_allowed() {
    let bench = Bench::new();
    for (plan, parts) in [
        ("seed = \"abc\"", ["`seed` is \"abc\"; it must be an integer from 0 to 18446744073709551615", ""]),
        (
            "[evaluate]\nepisodes = \"x\"",
            ["line 2 of the plan: the key `evaluate.episodes` is \"x\"", "from 1 to 1000000000"],
        ),
        (
            "[evaluate]\nepisods = 1",
            [
                "line 2 of the plan: there is no key `evaluate.episods`",
                "hint: did you mean `evaluate.episodes`?",
            ],
        ),
        ("action_noise = 1", ["there is no key `action_noise`", "hint: did you mean `action-noise`?"]),
        ("action-noise = -1", ["action noise is -1", "from 0 to 10"]),
        (
            "target = \"toy/sphere-2d\"\n[evaluate]\nepisodes = 0",
            ["the number of episodes is 0", "from 1 to 1000000000"],
        ),
        ("target = \"a", ["line 1 of the plan, `target = \"a`, is not valid TOML: ", ""]),
    ] {
        bench.write("plan.toml", &format!("{plan}\n"));
        let target = if plan.contains("target") { "" } else { "point-reaching --controller expert" };
        check(&bench, &format!("evaluate {target} --plan plan.toml"), &parts);
    }
}

#[test]
fn a_wrong_line_of_a_csv_file_is_named_by_its_number_in_the_file() {
    let bench = Bench::new();
    for (csv, part) in [
        ("d,e\n1,2\n\n\n3\n", "line 5 has 1 cell, but the header has 2 names"),
        ("d,e\n1,2\n\n\nx,1\n", "line 5: `d` is `x`; it must be a number such as 0.25"),
        ("d,e\r\n1,2\r\n\r\nx,1\r\n", "line 4: `d` is `x`"),
        ("d;e\n0,5;1\n1.5;1\n", "line 3: `1.5` has a decimal point, the numbers before have a comma"),
        ("e,f;d\n0,5;1\n", "by commas or by semicolons; pass -k log.delimiter="),
    ] {
        bench.write("d.csv", csv);
        check(&bench, "monitor --formula d>0 d.csv", &["trace d.csv: ", part]);
    }
}

#[test]
fn an_error_in_a_long_formula_shows_the_place_of_the_error() {
    let bench = Bench::new();
    bench.write("d.csv", "d\n1\n");
    let terms = "(d > 0) and ".repeat(400);
    for command in ["monitor d.csv", "falsify toy/sphere-2d"] {
        let err = message(&bench, &format!("{command} --formula '{terms}(d > ) and {terms} d > 0'"));
        let lines: Vec<&str> = err.lines().collect();
        assert!(lines[0].starts_with("error: formula: column 4806: expected a signal"), "{err}");
        assert!(err.lines().count() == 3 && lines.iter().all(|line| line.len() <= 100), "{err}");
        let mark = lines[2].find('^').unwrap();
        assert_eq!(&lines[1][mark - 5..=mark], "(d > )", "{err}");
    }
}

#[test]
fn a_socket_in_place_of_a_file_is_named() {
    let bench = Bench::new();
    let names = ["s.toml", "s.csv", "s.safetensors"];
    let _sockets = names.map(|name| std::os::unix::net::UnixListener::bind(bench.path(name)).unwrap());
    for command in [
        "evaluate --plan s.toml",
        "train point-reaching --dry-run --settings s.toml",
        "report s.csv --out a.html",
        "show ./s.safetensors",
        "evaluate point-reaching --controller ./s.safetensors",
    ] {
        check(&bench, command, &["expected a regular file, found a socket"]);
    }
    check(
        &bench,
        "monitor --formula d>0 s.csv",
        &["s.csv: expected a file or a pipe, found a socket or a device"],
    );
}

#[test]
fn an_output_of_a_training_run_that_cannot_be_created_is_named() {
    let bench = Bench::new();
    bench.write("file", "");
    std::fs::create_dir(bench.path("a.safetensors.lock")).unwrap();
    let train = "train point-reaching --steps 256";
    check(&bench, &format!("{train} --out file/a.safetensors"), &["error: cannot write the folder file: "]);
    check(
        &bench,
        &format!("{train} --out a.safetensors"),
        &["error: cannot write the lock file a.safetensors.lock: "],
    );
    check(
        &bench,
        &format!("{train} --out b.safetensors --tensorboard file/b"),
        &["error: cannot write the folder file/b: "],
    );
}

#[test]
fn a_planted_file_beside_a_run_is_named_once() {
    let bench = Bench::new();
    for suffix in ["wal", "journal", "shm"] {
        let name = format!("{suffix}.sqlite");
        let planted = format!("{name}-{suffix}");
        std::fs::create_dir(bench.path(&planted)).unwrap();
        let err = message(&bench, &format!("evaluate toy/sphere-2d --episodes 3 --out {name}"));
        assert_eq!(err.matches(&format!("{planted} is not a regular file")).count(), 1, "{err}");
        assert!(!bench.path(&name).exists());
    }
}

#[test]
fn the_hint_on_an_unknown_controller_names_the_folder_of_the_controllers() {
    let bench = Bench::new();
    let err = message(&bench, "evaluate point-reaching --controller xyzzy");
    let (_, rest) = err.split_once("hint: shipped controllers are in ").expect(&err);
    let folder = rest.split_once(';').unwrap().0;
    assert!(folder.ends_with("/controllers"), "{err}");
    assert!(std::path::Path::new(folder).join("point-reaching/ppo.safetensors").is_file(), "{err}");
}

#[test]
fn a_bound_in_seconds_needs_the_time_between_two_samples() {
    let bench = Bench::new();
    let rows = "0,5\n0.5,5\n1,2\n1.5,1\n";
    bench.write("none.csv", &format!("step,d\n{rows}"));
    bench.write("one.csv", "time,d\n0,1\n");
    bench.write("time.csv", &format!("time,d\n{rows}"));
    let asks = ["needs the time between two samples", "-k log.period=SECONDS"];
    for arguments in [
        "--formula always[0:1s](d>0) none.csv",
        "--formula always[0:1](d>0) -k log.unit=s none.csv",
        "--formula historically[20ms:inf](d>0) none.csv",
        "--formula always[0:1s](d>0) one.csv",
    ] {
        check(&bench, &format!("monitor {arguments}"), &asks);
    }
    for name in ["Time", "timestamp", "t", "__time", "header.stamp", "elapsed_s", "time [s]", "sec"] {
        bench.write("named.csv", &format!("{name},d\n{rows}"));
        let quoted = if name.contains('[') { format!("'{name}'") } else { name.to_string() };
        let parts = [asks[0], asks[1], &format!("-k log.time={quoted}")];
        check(&bench, "monitor --formula always[0:1s](d>0) named.csv", &parts);
        // d is 5, 5, 2 within 1 s.
        let named = format!("monitor --formula 'always[0:1s](d>=2)' named.csv -k 'log.time={name}'");
        assert_eq!(bench.json(&format!("{named} --json"), 0)["robustness"], 0.0);
    }
    for arguments in [
        "--formula always[0:1s](d>=2) time.csv",
        "--formula always[0:1](d>=2) time.csv -k log.unit=s",
        "--formula always[0:1s](d>=2) none.csv -k log.period=0.5",
        "--formula always[0:2](d>=2) none.csv",
    ] {
        assert_eq!(bench.json(&format!("monitor {arguments} --json"), 0)["robustness"], 0.0, "{arguments}");
    }
    // Before the first sample is nothing, so it asks nothing.
    let past = "monitor --formula historically[0s:inf](d>=5) none.csv --json";
    assert_eq!(bench.json(past, 2)["robustness"], 0.0);
    check(
        &bench,
        "monitor --formula d>0 time.csv -k log.time=tme",
        &["the time column is `tme`", "did you mean `time`?"],
    );
    let milliseconds = "monitor --formula always[0:1s](d>0) ms.csv";
    bench.write("ms.csv", "time,d\n0,1\n500,1\n1000,1\n");
    check(&bench, milliseconds, &["mostly steps by 500", "-k log.time-unit=s|ms|us|ns"]);
    check(
        &bench,
        &format!("{milliseconds} -k log.time-unit=s"),
        &["0.002 steps of 500 s", "those of the times, in seconds"],
    );
    // No time is claimed that is not known.
    bench.write("nan.csv", "d\n1\nnan\n");
    check(&bench, "monitor --formula d>0 nan.csv", &["line 3: `d` is `nan`; it must be a number"]);
}

#[test]
fn a_column_with_any_name_is_read_in_backquotes_and_hints_name_them() {
    let bench = Bench::new();
    bench.write("d.csv", "/arm/q[0],load/diff1,door yaw,a`b\n1,2,3,4\n2,3,4,5\n");
    for (formula, robustness) in
        [("`/arm/q[0]` <= 3", 2.0), ("`load/diff1`-`door yaw`+2 >= 0", 1.0), ("`a``b` - 4 >= 0", 0.0)]
    {
        let found = bench.json(&format!("monitor --formula '{formula}' d.csv --json"), 2);
        assert_eq!(found["robustness"], robustness, "{formula}");
    }
    for (formula, name) in [
        ("always(/arm/q[0] <= 3)", "/arm/q[0]"),
        ("always(load/diff1 <= 3)", "load/diff1"),
        ("always(door yaw <= 3)", "door yaw"),
        ("a`b > 0", "a``b"),
    ] {
        let err = message(&bench, &format!("monitor --formula '{formula}' d.csv"));
        let is_hinted = err.contains(&format!("hint: to read the signal `{name}`, write its name"));
        assert!(is_hinted || formula.starts_with("a`") && err.contains("a backquote to end"), "{err}");
        assert!(!err.contains("did you mean"), "{err}");
    }
    check(
        &bench,
        "monitor --formula x>0 d.csv",
        &["known signals: `/arm/q[0]`, `load/diff1`, `door yaw`, `a``b`"],
    );
}

#[test]
fn a_definition_without_use_is_a_warning() {
    let bench = Bench::new();
    bench.write("d.csv", "d\n1\n");
    let output = bench.run("monitor --formula 'low = d <= 0\nd >= 1' d.csv");
    assert_eq!(output.status.code(), Some(0));
    let err = text(&output.stderr);
    assert!(err.contains("warning: no statement reads the definition `low`; the formula is d >= 1"), "{err}");
}

#[test]
fn headers_and_numbers_in_messages_are_short_and_harmless() {
    let bench = Bench::new();
    bench.write("d.csv", "\"a\u{202e}b\u{1b}[31m\nerror: c\",d\n1,1e300\n2,-1e300\n");
    let err = message(&bench, "monitor --formula x>0 d.csv");
    assert!(err.contains("`a\\u{202e}b\\u{1b}[31m\\nerror: c`, d"), "{err}");
    let out = text(&bench.run("monitor --formula 'always(d <= 0)' d.csv").stdout);
    assert!(out.contains("robustness -1e300"), "{out}");
    bench.write("cell.csv", &format!("d\n{}x\n", "1".repeat(300)));
    bench.write("time.csv", "time,d\n0,1\n1e300,1\n1e301,1\n");
    for arguments in [
        "--formula 'd * d > 0' d.csv",
        "--formula 'always[1e300:1e301](d > 0)' d.csv",
        "--formula 'always[0:1s](d > 0)' d.csv -k log.period=1e-300",
        "--formula 'd > 0' cell.csv",
        "--formula 'd > 0' time.csv",
        "--formula 'd > 0' time.csv -k log.period=1e-300",
    ] {
        let err = message(&bench, &format!("monitor {arguments}"));
        let longest = err.split(|c: char| !c.is_ascii_digit()).map(str::len).max().unwrap();
        assert!(longest <= 40, "{arguments}: {err}");
    }
}

/// A command that gets a file of another kind names the command that reads it, with the file.
#[test]
fn a_file_of_another_kind_gets_the_command_that_reads_it() {
    let bench = Bench::new();
    bench.write("own log.csv", "time,force\n0,1\n0.1,3\n");
    bench.write("robot.toml", "model = \"robot.xml\"\n");
    bench.write("plan.toml", "target = \"toy/sphere-2d\"\n[falsify]\nbudget = 10\n");
    bench.write("rules.toml", "[[requirement]]\nname = \"a\"\nformula = \"x >= 0\"\n");
    bench.check("evaluate toy/sphere-2d --episodes 5 --out run.sqlite", 0);
    bench.write("curve.csv", "iteration,environment_steps\n");
    let log = "mishandle report --log 'own log.csv' --formula FORMULA --out page.html";
    let judged = "mishandle monitor --formula FORMULA 'own log.csv'";
    let falsified = "mishandle falsify robot.toml";
    let asked = "mishandle run plan.toml";
    let checked = "mishandle check TARGET --requirements rules.toml --out FOLDER";
    let shown = "mishandle show run.sqlite";
    for (arguments, expected) in [
        ("report 'own log.csv'", log),
        ("report 'own log.csv' --out p.html", log),
        ("report run.sqlite 'own log.csv' --open", log),
        ("report robot.toml --out p.html", falsified),
        ("report plan.toml", asked),
        ("report rules.toml --markdown p.md", checked),
        ("show 'own log.csv'", judged),
        ("show robot.toml", falsified),
        ("show plan.toml", asked),
        ("show rules.toml", checked),
        ("show curve.csv", "mishandle report curve.csv --out curve.html"),
        ("replay 'own log.csv'", judged),
        ("export robot.toml --out rows.csv", falsified),
        ("compare run.sqlite 'own log.csv' --exact", judged),
        ("regress --add plan.toml", asked),
        ("run run.sqlite", shown),
        ("run 'own log.csv'", judged),
        ("run rules.toml", checked),
        ("monitor run.sqlite", shown),
        ("monitor --formula x>=0 robot.toml", falsified),
        ("monitor --formula x>=0 plan.toml", asked),
    ] {
        check(&bench, arguments, &[expected]);
    }
}
