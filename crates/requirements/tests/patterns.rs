//! Every pattern accepts the trace that it shows as satisfying and rejects the other one.

use std::sync::Arc;

use mishandle_requirements::{Context, describe, pattern, pattern_page, patterns};
use mishandle_stl::{Clock, Formula, Monitor, Trace, is_satisfied};

/// Start of the page of patterns.
const INTRODUCTION: &str = "# Patterns of requirements

`mishandle formula --pattern NAME --parameter NAME=VALUE` writes the formula of a pattern, puts it into words, checks it
and draws it. This page is made from the table of the program, whose traces are tested.

A condition is a formula, such as `x >= 1`. A signal may be arithmetic with signals, such as `abs(a - b)`. A time has a
unit (`2s`, `50ms`), or counts samples. The samples of a trace, such as `x 0 0.5 1`, are 1 s apart. The samples of
`p 0010` are 0, 0, 1 and 0, and the parameter of this name is `p >= 1`.
";

#[test]
fn each_pattern_tells_its_two_traces_apart() {
    for pattern in patterns() {
        let verdicts: Vec<bool> = pattern
            .examples()
            .unwrap_or_else(|error| panic!("{}: {error}", pattern.name))
            .iter()
            .map(|example| example.violated)
            .collect();
        assert_eq!(verdicts, [false, true], "{}", pattern.name);
    }
}

/// At the first sample no edge is known: a pattern about edges requires nothing there, whatever the
/// conditions are from the start on.
#[test]
fn the_first_sample_is_no_edge() {
    let edges = ["reaction", "response-and-hold", "hold-for", "minimum-duration", "minimum-gap"];
    let settings = [("p", "x >= 1"), ("q", "y >= 1"), ("deadline", "1"), ("duration", "2"), ("gap", "2")];
    for name in edges {
        let pattern = pattern(name).expect("there is one");
        let own = settings.iter().filter(|(name, _)| pattern.slots.iter().any(|slot| slot.name == *name));
        let own: Vec<(String, String)> =
            own.map(|(name, value)| ((*name).to_owned(), (*value).to_owned())).collect();
        let (formula, _) = pattern.fill(&own).expect("the settings are complete");
        let formula = Formula::parse(&formula).expect("a formula");
        let names: Arc<[String]> = vec!["x".to_owned(), "y".to_owned()].into();
        for x in [0.0, 2.0] {
            let columns = vec![vec![x, x, 2.0 - x, 2.0 - x, 2.0 - x], vec![0.0, 0.0, 2.0, 2.0, 2.0]];
            let trace = Trace::from_columns(Arc::clone(&names), columns);
            let mut monitor = Monitor::new(&formula, &names, Clock::steps(1.0)).expect("a monitor");
            let robustness = monitor.robustness(&trace).expect("a value");
            assert!(is_satisfied(robustness), "{name} with x = {x}: {robustness}");
        }
    }
}

#[test]
fn the_page_is_that_of_the_table() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/reference/patterns.md");
    if std::env::var_os("MISHANDLE_WRITE_PATTERNS").is_some() {
        std::fs::write(path, pattern_page(INTRODUCTION)).expect("the page can be written");
    }
    let page = std::fs::read_to_string(path).expect("the page exists");
    assert!(
        page == pattern_page(INTRODUCTION),
        "run the tests of mishandle-requirements with MISHANDLE_WRITE_PATTERNS=1"
    );
}

/// Patterns that require what may come as late as at the end of the trace, as their sources do.
const WITHOUT_DEADLINE: [&str; 7] = [
    "existence-globally",
    "existence-after",
    "existence-after-until",
    "response-globally",
    "response-after",
    "response-after-until",
    "fret-eventually",
];

/// A pattern is not a trap: only notes are allowed, and `settling` is meant up to the end. A
/// missing deadline is one, also if it is meant.
#[test]
fn the_formulas_of_patterns_have_no_warning() {
    for pattern in patterns() {
        let all = pattern.shown_settings();
        let has_default =
            |name: &str| pattern.slots.iter().any(|slot| slot.name == name && slot.default.is_some());
        let needed = all.iter().filter(|(name, _)| !has_default(name)).cloned().collect();
        for settings in [all, needed] {
            let (formula, _) = pattern.fill(&settings).expect("the settings are complete");
            let context = Context { period: Some(1.0), ..Context::default() };
            let found = describe(&formula, &context).expect("a formula");
            let warnings = found.traps.iter().filter(|trap| trap.severity.name() == "warning");
            let mut names: Vec<&str> = warnings.map(|trap| trap.name.as_str()).collect();
            names.dedup();
            let is_open = WITHOUT_DEADLINE.contains(&pattern.name);
            assert_eq!(names, &["unbounded-eventually"][..usize::from(is_open)], "{}", pattern.name);
        }
    }
}

#[test]
fn mistakes_in_settings_are_named() {
    let set = |settings: &[(&str, &str)]| {
        let settings: Vec<(String, String)> =
            settings.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned())).collect();
        pattern("response").expect("there is one").fill(&settings).expect_err("a mistake").to_string()
    };
    assert!(set(&[]).contains("needs the parameter `p`"));
    assert!(set(&[("p", "x >= 1"), ("z", "1")]).contains("has p, q, deadline"));
    assert!(set(&[("p", "x >= 1"), ("q", "y >= 1"), ("deadline", "soon")]).contains("must be a time"));
    assert!(set(&[("p", "x >= "), ("q", "y >= 1"), ("deadline", "2s")]).contains("column 5"));
    assert!(pattern("respons").expect_err("no pattern").to_string().contains("did you mean `response`?"));
}

/// A condition with an operator that binds looser than those of the pattern stays one part.
#[test]
fn conditions_keep_their_grouping() {
    let settings = [("p", "a >= 1 or b >= 1"), ("q", "c >= 1 implies d >= 1"), ("deadline", "3")];
    let settings = settings.map(|(name, value)| (name.to_owned(), value.to_owned()));
    let (formula, _) = pattern("response").expect("there is one").fill(&settings).expect("valid");
    let meant = "always((a >= 1 or b >= 1) implies eventually[0:3](c >= 1 implies d >= 1))";
    let parsed = Formula::parse(&formula).expect("a formula");
    assert_eq!(parsed, Formula::parse(meant).expect("a formula"));
}
