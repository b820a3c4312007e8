//! `monitor --follow`: pipes and files that grow, the exit code as soon as it is certain, signals.

use std::fs::OpenOptions;
use std::io::{BufRead, BufReader, Read, Write};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::time::Duration;

use crate::bench::{Bench, signal, text};
use serde_json::Value;

/// A program that follows a log, and its lines.
struct Following {
    child: Child,
    lines: BufReader<ChildStdout>,
}

impl Following {
    fn start(mut command: Command) -> Following {
        let pipe = Stdio::piped;
        let mut child = command.stdin(pipe()).stdout(pipe()).stderr(pipe()).spawn().unwrap();
        let lines = BufReader::new(child.stdout.take().unwrap());
        Following { child, lines }
    }

    fn write(&mut self, text: &str) {
        self.child.stdin.as_mut().unwrap().write_all(text.as_bytes()).unwrap();
    }

    /// Waits for the next line.
    fn line(&mut self) -> Value {
        let mut line = String::new();
        self.lines.read_line(&mut line).unwrap();
        serde_json::from_str(&line).unwrap_or_else(|error| panic!("{line}: {error}"))
    }

    /// Waits for the end, and returns the exit code and stderr.
    fn end(mut self) -> (Option<i32>, String) {
        let mut error = Vec::new();
        self.child.stderr.take().unwrap().read_to_end(&mut error).unwrap();
        (self.child.wait().unwrap().code(), text(&error))
    }
}

#[test]
fn a_violation_ends_the_program_while_the_pipe_is_open() {
    let bench = Bench::new();
    let mut following = Following::start(
        bench.command("monitor --follow -k monitor.bounds=true --formula 'always(d <= 2)' -"),
    );
    following.write("time,d\n0,0\n");
    let line = following.line();
    assert_eq!(
        (&line["event"], &line["low"], line["high"].as_f64()),
        (&"bounds".into(), &"-inf".into(), Some(2.0))
    );
    assert_eq!(line["violated"], Value::Null);
    following.write("0.5,0.5\n");
    assert_eq!(following.line()["high"].as_f64(), Some(1.5));
    // The answer is the same, so there is no line.
    following.write("1,0\n1.5,4\n");
    let line = following.line();
    assert_eq!(
        (&line["event"], &line["violated"], &line["samples"]),
        (&"verdict".into(), &true.into(), &4.into())
    );
    let violation = &line["violation"];
    assert_eq!((&violation["formula"], violation["time"].as_f64()), (&"d <= 2".into(), Some(1.5)));
    assert_eq!((&violation["sample"], violation["robustness"].as_f64()), (&3.into(), Some(-2.0)));
    let stdin = following.child.stdin.take();
    assert_eq!(following.end(), (Some(1), String::new()));
    drop(stdin);
}

#[test]
fn the_end_of_a_pipe_has_the_verdict_of_the_complete_log() {
    let bench = Bench::new();
    let rows = "time,d\n0,1\n0.1,0\n0.2,0.25\n0.3,1";
    bench.write("log.csv", rows);
    for formula in
        ["always(d >= 1 implies eventually[0:1](d <= 0.5))", "always[0:9](d >= 0)", "eventually(d >= 4)"]
    {
        for flags in ["", "-k log.strict-horizon=true"] {
            let whole = bench.run(&format!("monitor --json {flags} --formula '{formula}' log.csv"));
            let mut following =
                Following::start(bench.command(&format!("monitor --follow {flags} --formula '{formula}' -")));
            following.write(rows);
            drop(following.child.stdin.take());
            if whole.status.code() != Some(2) {
                let whole: Value = serde_json::from_slice(&whole.stdout).unwrap();
                let line = following.line();
                assert_eq!((&line["event"], &line["low"]), (&"end".into(), &whole["robustness"]));
                assert_eq!((&line["high"], &line["violated"]), (&whole["robustness"], &whole["violated"]));
                assert_eq!(line["cuts_windows"], whole["cuts_windows"]);
            }
            assert_eq!(following.end().0, whole.status.code(), "{formula} {flags}");
        }
    }
}

#[test]
fn lines_of_several_requirements_carry_their_names() {
    let bench = Bench::new();
    bench.write(
        "set.toml",
        "[[requirement]]\nname = \"soft\"\nformula = \"always(f <= 2)\"\nseverity = \"warning\"\n\
         [[requirement]]\nname = \"hard\"\nformula = \"always(f <= 9)\"\n\
         [[requirement]]\nname = \"starts\"\nformula = \"eventually[0:0.2](f >= 1)\"\nunit = \"s\"\n",
    );
    bench.write("log.csv", "time,f\n0,0\n0.1,1\n0.2,3\n0.3,10\n0.4,0\n");
    let names = |out: &str| -> Vec<String> {
        let line = |line: &str| serde_json::from_str::<Value>(line).unwrap();
        let shown = |line: Value| format!("{} {} {}", line["name"], line["violated"], line["samples"]);
        out.lines().map(|text| shown(line(text)).replace('"', "")).collect()
    };
    let follow = "monitor --follow --requirements set.toml -k log.period=0.1 -k monitor.idle=0.1";
    let out = bench.check(&format!("{follow} log.csv"), 1);
    assert_eq!(names(&out), ["starts false 2", "soft true 3", "hard true 4"]);
    // A warning does not end it.
    bench.write("log.csv", "time,f\n0,0\n0.1,3\n0.2,3\n0.3,3\n");
    assert_eq!(
        names(&bench.check(&format!("{follow} log.csv"), 0)),
        ["soft true 2", "starts false 2", "hard false 4"]
    );
    let more = "--requirement 'low=f <= -1' -k monitor.keep-going=true";
    let out = bench.check(&format!("{follow} {more} log.csv"), 1);
    assert_eq!(names(&out), ["low true 1", "soft true 2", "starts false 2", "hard false 4"]);
    bench.refuses(&format!("{follow} log.csv log.csv"), &["--follow reads one log"]);
    // A requirement without its signal, or without a value, takes no verdict from the others.
    for (other, reason, samples) in
        [("other=always(g <= 1)", "`g`", 0), ("other=always(sqrt(f - 1) <= 9)", "sqrt", 1)]
    {
        let output = bench.run(&format!("{follow} --requirement '{other}' log.csv"));
        assert_eq!(output.status.code(), Some(2), "{other}");
        let lines = text(&output.stdout);
        let (first, others) = lines.split_once('\n').unwrap();
        assert_eq!(names(others), ["soft true 2", "starts false 2", "hard false 4"]);
        let first: Value = serde_json::from_str(first).unwrap();
        assert_eq!((&first["event"], &first["samples"]), (&"no-verdict".into(), &samples.into()));
        assert!(first["name"] == "other" && first["violated"].is_null(), "{first}");
        assert!(first["reason"].as_str().unwrap().contains(reason), "{first}");
        let message = text(&output.stderr);
        assert!(message.contains("requirement other") && message.contains(reason), "{message}");
        assert!(message.contains("without a verdict: 1 requirement"), "{message}");
        // A violation comes first.
        let failing = "--requirement 'low=always(f <= 1)' -k monitor.keep-going=true";
        bench.check(&format!("{follow} --requirement '{other}' {failing} log.csv"), 1);
    }
    bench.refuses("monitor --follow --requirements set.toml log.csv", &["-k log.period=SECONDS"]);
    bench.refuses("monitor --follow --json --formula f>=0 log.csv", &["--json"]);
    bench.refuses("monitor -k monitor.idle=1 --formula f>=0 log.csv", &["--follow"]);
    bench.refuses(
        "monitor --follow -k log.sort=true --formula f>=0 log.csv",
        &["-k monitor.lateness=SECONDS"],
    );
}

#[test]
fn a_file_is_read_as_it_grows() {
    let bench = Bench::new();
    bench.write("log.jsonl", "{\"time\":0,\"d\":0}\n{\"time\":1,");
    let mut following = Following::start(
        bench.command("monitor --follow -k monitor.bounds=true --formula 'always(d <= 2)' log.jsonl"),
    );
    assert_eq!(following.line()["samples"], 1);
    let mut file = OpenOptions::new().append(true).open(bench.path("log.jsonl")).unwrap();
    file.write_all(b"\"d\":1}\n").unwrap();
    assert_eq!(following.line()["samples"], 2);
    file.write_all(b"{\"time\":2,\"d\":7}\n").unwrap();
    assert_eq!(following.line()["violated"], true);
    assert_eq!(following.end().0, Some(1));
}

#[test]
fn a_file_that_is_replaced_or_cut_is_an_error() {
    let replaced = |bench: &Bench| {
        std::fs::rename(bench.path("log.csv"), bench.path("log.csv.1")).unwrap();
        bench.write("log.csv", "d\n0\n");
    };
    type Change = fn(&Bench);
    let changes: [(Change, &str); 3] = [
        (|bench| std::fs::remove_file(bench.path("log.csv")).unwrap(), "removed or renamed"),
        (replaced, "another file took the name"),
        (|bench| bench.write("log.csv", "d\n"), "became shorter"),
    ];
    for (change, message) in changes {
        let bench = Bench::new();
        bench.write("log.csv", "d\n0\n");
        let mut following = Following::start(
            bench.command("monitor --follow -k monitor.bounds=true --formula 'always(d <= 2)' log.csv"),
        );
        following.line();
        change(&bench);
        let (code, error) = following.end();
        assert!(code == Some(2) && error.contains(message), "{code:?} {error}");
    }
}

#[test]
fn a_signal_ends_it_with_the_answer_so_far() {
    for name in ["INT", "TERM"] {
        let bench = Bench::new();
        let mut following = Following::start(
            bench.command("monitor --follow -k monitor.bounds=true --formula 'always(d <= 2)' -"),
        );
        following.write("d\n0\n");
        following.line();
        signal(&following.child, name);
        let line = following.line();
        assert_eq!(
            (&line["event"], &line["samples"], &line["violated"]),
            (&"interrupted".into(), &1.into(), &Value::Null)
        );
        assert_eq!(following.end().0, Some(130));
    }
}

#[test]
fn a_closed_stdout_ends_it() {
    let bench = Bench::new();
    let mut following = Following::start(
        bench.command("monitor --follow -k monitor.bounds=true --formula 'always(d <= 2)' -"),
    );
    following.write("d\n0\n");
    following.line();
    let Following { mut child, lines } = following;
    drop(lines);
    child.stdin.as_mut().unwrap().write_all(b"1\n1.5\n").unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(141));
}

#[test]
fn what_is_no_log_is_an_error() {
    let bench = Bench::new();
    for (bytes, message) in [
        ("time,d\n", "a header, but no samples"),
        ("", "the file is empty"),
        ("time,d\n0,1\n1,nan\n", "line 3: `d` is `nan`"),
        ("time,d\n0,1\n1\n", "line 3 has 1 cell"),
        ("time,d\n0,1\n0,1\n", "-k log.duplicates=first|last"),
        ("time,d\n1,1\n0,1\n", "-k monitor.lateness=SECONDS"),
        ("time,e\n1,1\n0,1\n", "signal `d` is not in the trace"),
    ] {
        let mut following = Following::start(bench.command("monitor --follow --formula 'always(d <= 2)' -"));
        following.write(bytes);
        drop(following.child.stdin.take());
        let (code, error) = following.end();
        assert!(code == Some(2) && error.contains(message), "{bytes:?}: {code:?} {error}");
    }
    // A line that does not end is not read into memory.
    let mut following = Following::start(bench.command("monitor --follow --formula 'always(d <= 2)' -"));
    let mut pipe = following.child.stdin.take().unwrap();
    let _ = pipe.write_all(b"d\n");
    let block = vec![b'1'; 1 << 20];
    let blocks = (0..100).take_while(|_| pipe.write_all(&block).is_ok()).count();
    drop(pipe);
    let (code, error) = following.end();
    assert!(code == Some(2) && blocks < 100 && error.contains("16 MiB"), "{code:?} {blocks} {error}");
}

#[test]
fn a_row_is_as_late_in_one_read_as_in_several() {
    let bench = Bench::new();
    let question = "monitor --follow -k log.topic-column=topic -k log.resample=hold -k log.period=1 -k monitor.lateness=1 \
                    --formula 'always(`a/v` + `b/v` <= 5)' -";
    let first = "topic,time,v\na,0,1\nb,0,1\na,1,1\na,2.5,1\n";
    let rest = "b,1,9\n";
    for pause in [Duration::ZERO, Duration::from_millis(300)] {
        let mut following = Following::start(bench.command(question));
        following.write(first);
        std::thread::sleep(pause);
        following.write(rest);
        drop(following.child.stdin.take());
        let (code, error) = following.end();
        assert_eq!(code, Some(2), "{error}");
        assert!(error.contains("line 6: the row of 1 s came when those up to 1 s were taken"), "{error}");
    }
}
