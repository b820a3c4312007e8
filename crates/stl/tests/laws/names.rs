//! Names of signals in backquotes, and hints on names.

use super::naive::Random;
use mishandle_stl::{Clock, Formula, Monitor, MonitorError, Trace, spelled};

/// A random name: of characters with a meaning in formulas, or a word that has one.
fn random_name(random: &mut Random) -> String {
    let pieces = [
        "a", "b1", "G", "always", "R", "ln", "true", "inf", "s", "float", "input", "const", "until", "`",
        "``", " ", "\n", "\r\n", "/", "//", "/*", "[0]", "(", ";", "=", "-", ".", "é", "²", "\"", "'", "\\",
        "%", "#", "\u{202e}", "\u{0}", "2",
    ];
    (0..random.below(4)).map(|_| random.pick(&pieces)).collect()
}

#[test]
fn every_name_can_be_written_and_a_printed_formula_parses_to_itself() {
    let mut random = Random(61);
    for _ in 0..20_000 {
        let x = random_name(&mut random);
        let y = random_name(&mut random);
        let spell = |name: &str| spelled(name).into_owned();
        let always_quoted = |name: &str| format!("`{}`", name.replace('`', "``"));
        let p = spell(&x);
        let q = always_quoted(&y);
        for text in [
            p.clone(),
            format!("{p} release {q}"),
            format!("not {p} >= -{q} and ln({q})/{p} < 2"),
            format!("{p} R[0:3s] {q}"),
            format!("n = {p} > 1\n{q} > 1 and n"),
        ] {
            if x == "n" || y == "n" {
                continue;
            }
            let formula = Formula::parse(&text).unwrap_or_else(|error| panic!("{text:?}: {error}"));
            let read = formula.signals();
            assert!(read.contains(&x.as_str()), "{text:?} reads {read:?}, not {x:?}");
            assert!(text == p || read.contains(&y.as_str()), "{text:?} reads {read:?}, not {y:?}");
            let printed = formula.to_string();
            assert_eq!(Formula::parse(&printed).as_ref(), Ok(&formula), "{text:?} printed as {printed:?}");
        }
    }
}

#[test]
fn a_quoted_name_is_the_same_name() {
    assert_eq!(Formula::parse("`d` > `pose.x`"), Formula::parse("d > pose.x"));
    assert_eq!(Formula::parse("`d` > `pose.x`").unwrap().to_string(), "d > pose.x");
    assert_eq!(Formula::parse("G(`a/b[0]`<=1)").unwrap().to_string(), "always(`a/b[0]` <= 1)");
    assert_eq!(Formula::parse("`` > 0").unwrap().signals(), [""]);
    assert_eq!(Formula::parse("````").unwrap().signals(), ["`"]);
    let error = Formula::parse("d > `a b").unwrap_err().to_string();
    assert!(error.starts_with("column 5: expected a backquote to end the name"), "{error}");
}

#[test]
fn a_signal_with_any_name_is_read() {
    let names = ["a/b[0]".to_owned(), "until".to_owned(), String::new()];
    let mut trace = Trace::new(names.clone().into());
    trace.push(&[1.0, 2.0, 4.0]);
    let formula = Formula::parse("`a/b[0]` + `until` + ``").unwrap();
    let mut monitor = Monitor::new(&formula, &names, Clock::steps(1.0)).unwrap();
    assert_eq!(monitor.robustness(&trace), Ok(7.0));
}

fn error(text: &str, known: &[&str]) -> MonitorError {
    let known: Vec<String> = known.iter().map(|name| (*name).to_owned()).collect();
    Monitor::new(&Formula::parse(text).unwrap(), &known, Clock::steps(1.0)).unwrap_err()
}

#[test]
fn a_hint_can_be_written_as_it_is_suggested() {
    let hint = |text: &str, known: &[&str]| error(text, known).hint();
    assert_eq!(hint("dd > 0", &["d"]), Some("did you mean `d`?".to_owned()));
    let quoted = |name: &str| Some(format!("to read the signal {name}, write its name with the backquotes"));
    assert_eq!(hint("LOAD/diff1 > 0", &["t", "LOAD/diff1"]), quoted("`LOAD/diff1`"));
    assert_eq!(hint("diff1 - LOAD/diff1 > 0", &["LOAD/diff1", "diff2"]), quoted("`LOAD/diff1`"));
    assert_eq!(hint("a-b-c > 0", &["a-b", "a-b-c"]), quoted("`a-b-c`"));
    assert_eq!(hint("`door yaw` > 0", &["door_yaw"]), Some("did you mean `door_yaw`?".to_owned()));
    assert_eq!(hint("`wei``rd` > 0", &["wei`rf"]), quoted("`wei``rf`"));
    // A reader cannot copy these from a message.
    assert_eq!(hint("abc > 0", &["abc\u{202e}"]), None);
    assert_eq!(hint("abc > 0", &["abc\n"]), None);
    assert_eq!(hint("xyz > 0", &["LOAD/diff1"]), None);
}

#[test]
fn a_hint_is_never_the_name_that_was_written() {
    let mut random = Random(62);
    let mut hints = 0;
    for _ in 0..20_000 {
        let known: Vec<String> = (0..3).map(|_| random_name(&mut random)).collect();
        let written = spelled(&random_name(&mut random)).into_owned();
        let formula = Formula::parse(&written).unwrap();
        let Err(error) = Monitor::new(&formula, &known, Clock::steps(1.0)) else { continue };
        let Some(hint) = error.hint() else { continue };
        hints += 1;
        assert!(!hint.contains(&format!(" {written},")) && !hint.contains(&format!(" {written}?")), "{hint}");
        let shows = |name: &String| hint.contains(&format!("`{}`", spelled(name).trim_matches('`')));
        assert!(known.iter().any(shows), "{hint} of {known:?}");
    }
    assert!(hints > 300, "{hints}");
}

#[test]
fn messages_list_names_as_a_formula_spells_them_on_one_line() {
    let message = error("x > 0", &["a, b", "G", "c\nerror: d"]).to_string();
    assert_eq!(message, "signal `x` is not in the trace; known signals: `a, b`, `G`, `c\\nerror: d`");
    let long = error(&format!("{} > 0", "y".repeat(5000)), &["a"]).to_string();
    assert!(long.len() < 250, "{long}");
}

#[test]
fn messages_have_no_number_with_hundreds_of_digits() {
    let zeros = "0".repeat(300);
    let trace = |value: f64| {
        let mut trace = Trace::new(["d".to_owned()].into());
        trace.push(&[value]);
        trace
    };
    let mut messages = Vec::new();
    for text in [
        format!("d > 1{zeros}{zeros}"),
        format!("always[1{zeros}:2] d"),
        format!("always[0:1{zeros}s] d"),
        format!("always[0:1{zeros} min] d"),
        format!("1{zeros} 1{zeros}"),
        format!("d {}", "x".repeat(5000)),
        format!("always[0:0.{zeros}1s] d"),
        "d * d > 0".to_owned(),
    ] {
        match Formula::parse(&text) {
            Err(error) => messages.push(error.to_string()),
            Ok(formula) => {
                for period in [1.0, 1e-200, 1e200] {
                    let monitor = Monitor::new(&formula, &["d".to_owned()], Clock::steps(period));
                    let found = monitor.and_then(|mut monitor| monitor.robustness(&trace(1e200)));
                    messages.extend(found.err().map(|error| error.to_string()));
                }
            }
        }
    }
    assert!(messages.len() > 8, "{messages:?}");
    assert!(messages.iter().all(|message| message.len() < 300), "{messages:#?}");
    let printed = Formula::parse(&format!("always[0:1{zeros}](d > 1{zeros})")).unwrap().to_string();
    assert_eq!(printed, "always[0:1e300](d > 1e300)");
}
