//! A formula that asks nothing of a trace holds there, whatever it requires beside its premises.

use std::sync::Arc;

use mishandle_stl::{Clock, Formula, Monitor, Trace, Vacuity, is_satisfied};

use super::naive::Random;

const NAMES: [&str; 3] = ["p", "q", "r"];

/// Formulas with consequences `A` and `B`, which no premise contains.
const FORMULAS: [&str; 9] = [
    "always(p > 0 implies A)",
    "always[0:2](p > 0 implies eventually[0:3](A))",
    "eventually(p > 0 implies A)",
    "p > 0 implies always(A)",
    "always(p > 0 implies (r > 0 implies A))",
    "always((p > 0 implies r > 0) implies A)",
    "always(p > 0 implies A) and always[1:4](r > 0 implies B)",
    "always((p > 0 implies A and B) or (r > 0 implies historically(B)))",
    "always(not (p > 0) or A)",
];

const CONSEQUENCES: [&str; 5] =
    ["(q > 0)", "(not (q > 1))", "(q > 0 until r > 0)", "(r + q >= 0)", "(q == r)"];

fn robustness(formula: &Formula, trace: &Trace) -> f64 {
    Monitor::new(formula, trace.names(), Clock::steps(1.0)).unwrap().robustness(trace).unwrap()
}

#[test]
fn what_asks_nothing_holds_whatever_it_requires() {
    let mut random = Random(7);
    let names: Arc<[String]> = NAMES.map(String::from).into();
    let mut vacuous = 0;
    for _ in 0..200 {
        let samples = 1 + random.below(8);
        let columns = NAMES.map(|_| (0..samples).map(|_| random.below(5) as f64 - 2.5).collect()).to_vec();
        let trace = Trace::from_columns(Arc::clone(&names), columns);
        for text in FORMULAS {
            let with = |a: &str, b: &str| Formula::parse(&text.replace('A', a).replace('B', b)).unwrap();
            let nothing = robustness(&with("false", "false"), &trace);
            for a in CONSEQUENCES {
                for b in CONSEQUENCES {
                    let formula = with(a, b);
                    let found = robustness(&formula.vacuous().unwrap(), &trace);
                    assert_eq!(found, nothing, "{formula}");
                    assert!(!is_satisfied(found) || is_satisfied(robustness(&formula, &trace)), "{formula}");
                    vacuous += u32::from(is_satisfied(found));
                }
            }
        }
    }
    assert!(vacuous > 1000, "{vacuous}");
}

#[test]
fn a_formula_that_requires_something_beside_its_premises_asks_something() {
    for text in [
        "always(q > 0)",
        "not always(p > 0 implies q > 0)",
        "p > 0",
        "(p > 0 implies q > 0) until r > 0",
        "next(p > 0 implies q > 0)",
    ] {
        assert_eq!(Formula::parse(text).unwrap().vacuous(), None, "{text}");
    }
    for text in ["always(p >= 5 implies false)", "always(not (p >= 5) or false)"] {
        assert_eq!(Formula::parse(text).unwrap().vacuous(), None, "{text}");
    }
    // What is required of a sample after the last one is asked of none.
    let at_the_end = Formula::parse("always(p > 0 implies next(q > 0))").unwrap().vacuous().unwrap();
    let column = |last: f64| vec![vec![-1.0, -1.0, last], vec![-1.0; 3], vec![-1.0; 3]];
    let trace = |columns| Trace::from_columns(NAMES.map(String::from).into(), columns);
    assert!(is_satisfied(robustness(&at_the_end, &trace(column(1.0)))));
    let before = vec![vec![-1.0, 1.0, -1.0], vec![1.0; 3], vec![1.0; 3]];
    assert!(!is_satisfied(robustness(&at_the_end, &trace(before))));
    let turned = Formula::parse("always(q > 0 or not (p > 0))").unwrap().vacuous().unwrap();
    assert_eq!(turned.to_string(), "always(false or not(p > 0))");
    let formula = Formula::parse("always(p > 0 implies q > 0) and r > 0").unwrap();
    let trace =
        Trace::from_columns(NAMES.map(String::from).into(), vec![vec![-1.0; 3], vec![1.0; 3], vec![1.0; 3]]);
    assert_eq!(robustness(&formula.vacuous().unwrap(), &trace), f64::NEG_INFINITY);
}

#[test]
fn a_reason_names_a_premise_that_is_alone_and_a_code_gives_the_finding_back() {
    let reason = |text: &str| Vacuity::Premise.reason(&Formula::parse(text).unwrap());
    assert!(reason("always(p > 0 implies q > 0)").contains("its premise `p > 0` does not hold"));
    assert!(reason("always(p > 0 implies (r > 0 implies q > 0))").contains("its premises do not hold"));
    for found in [
        None,
        Some(Vacuity::FirstSample),
        Some(Vacuity::Premise),
        Some(Vacuity::NoSample),
        Some(Vacuity::Parts),
    ] {
        assert_eq!(Vacuity::from_code(Vacuity::code(found)), found);
    }
}
