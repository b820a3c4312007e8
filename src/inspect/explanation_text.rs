//! Explanations in sentences.

use mishandle_stl::{DecisivePredicate, is_satisfied, is_violated};

use crate::inspect::explanation::OperatorEvent;
use crate::inspect::{Explanation, PredicateHistory};
use mishandle_text::{decimal, short_unit};

/// Largest number of characters of an operand that a sentence repeats.
const MAX_OPERAND: usize = 80;

impl Explanation {
    /// Describes what decides the formula, one sentence per item: the instant after which nothing
    /// can change the verdict, the values of the decisive predicate, the samples of its window at
    /// which it fails, and what the operators above it require. Empty without a decisive predicate.
    ///
    /// `at` names a sample, such as [`mishandle_text::instant`]. Names and formulas are as in the
    /// run file: escape them before you print them. Formulas are between backticks.
    pub fn sentences(&self, at: impl Fn(usize) -> String) -> Vec<String> {
        let verdict = if is_violated(self.diagnosis.robustness()) { "satisfy" } else { "violate" };
        let decided =
            self.decided.map(|sample| format!("From {} on, nothing can {verdict} the formula.", at(sample)));
        let mut sentences: Vec<String> = decided.into_iter().collect();
        if let (Some(predicate), Some(history)) = (&self.diagnosis.predicate, &self.history) {
            let makes = history.operand.as_ref().map(|whole| {
                let fails = is_violated(self.diagnosis.robustness()) != whole.is_negated;
                format!("which makes {} {}", quoted(&whole.text, WHOLE), if fails { "fail" } else { "hold" })
            });
            sentences.push(decision(predicate, &self.unit, makes.as_deref(), &at));
            sentences.push(violation(history, predicate.is_negated, self.one_is_enough(), &at));
        }
        sentences.extend(self.events.iter().map(|event| event_text(event, &at)));
        sentences
    }

    /// Returns whether the formula is satisfied and the operator above the decisive predicate needs
    /// one sample only.
    fn one_is_enough(&self) -> bool {
        let above = self.diagnosis.path.iter().rev().find(|found| found.window.is_some());
        let is_existential = |operator| matches!(operator, "eventually" | "once");
        above.is_some_and(|found| {
            is_satisfied(self.diagnosis.robustness())
                && is_satisfied(found.robustness)
                && found.operator.is_some_and(is_existential)
        })
    }
}

/// Describes the values of the two sides of a predicate, such as
/// `gap is 1.2000 m, the threshold 2.0000 m`.
pub fn compared_values(predicate: &DecisivePredicate, unit: &str) -> String {
    let [left, right] = predicate.values.map(|value| quantity(value, unit));
    let [left_text, right_text] = &predicate.sides;
    let is_number = |side: &str| side.parse::<f64>().is_ok();
    match [is_number(left_text), is_number(right_text)] {
        [false, true] => format!("{left_text} is {left}, the threshold {right}"),
        [true, false] => format!("{right_text} is {right}, the threshold {left}"),
        _ => format!("{left_text} is {left}, {right_text} is {right}"),
    }
}

fn quantity(value: f64, unit: &str) -> String {
    let number = decimal(value, 4);
    if unit.is_empty() { number } else { format!("{number} {}", short_unit(unit)) }
}

/// Describes the values of a predicate. `makes` says what they make of the operand that contains
/// it.
fn decision(
    predicate: &DecisivePredicate,
    unit: &str,
    makes: Option<&str>,
    at: &dyn Fn(usize) -> String,
) -> String {
    let compared = compared_values(predicate, unit);
    let margin = quantity(predicate.robustness.abs(), unit);
    let (verb, of_negation) = if is_violated(predicate.robustness) {
        ("violates", "as the formula requires")
    } else {
        ("satisfies", "which the formula forbids")
    };
    let meaning =
        if predicate.is_negated { format!(", {}", makes.unwrap_or(of_negation)) } else { String::new() };
    format!(
        "Decisive: {} at {}: {compared}. The trace {verb} it by {margin}{meaning}.",
        predicate.text,
        at(predicate.sample)
    )
}

/// Describes the samples of the window at which the predicate is violated. A predicate that is not
/// the whole operand is to blame only where that is violated, too.
fn violation(
    history: &PredicateHistory,
    is_negated: bool,
    one_is_enough: bool,
    at: &dyn Fn(usize) -> String,
) -> String {
    let (first, last) = history.window;
    let samples = last + 1 - first;
    let of_window = |count: usize| match count {
        _ if samples == 1 => format!("at the only sample of its window, {}", at(first)),
        count if count == samples => {
            format!("at all {samples} samples of its window, {} to {}", at(first), at(last))
        }
        count => format!("at {count} of {samples} samples in its window"),
    };
    let places = |violated: &[usize]| match violated {
        violated if violated.len() == samples => of_window(samples),
        [only] => format!("{}, at {}", of_window(1), at(*only)),
        [from, .., to] => format!("{}, from {} to {}", of_window(violated.len()), at(*from), at(*to)),
        [] => of_window(samples),
    };
    let is_alone = |sample: &usize| history.robustness.get(*sample).is_some_and(|rho| is_violated(*rho));
    let alone: Vec<usize> = (first..=last).filter(is_alone).collect();
    let [holds, fails] = match (is_negated, &history.operand) {
        (false, _) => ["holds", "fails"],
        (true, Some(_)) => ["fails", "holds"],
        (true, None) => ["fails, as the formula requires,", "holds, which the formula forbids,"],
    };
    if alone.is_empty() {
        return format!("It {holds} {}.", of_window(samples));
    }
    let (text, whole_fails) = match &history.operand {
        Some(whole) => (quoted(&whole.text, WHOLE), if whole.is_negated { "holds" } else { "fails" }),
        None => ("it".to_string(), ""),
    };
    let is_enough = one_is_enough && alone.len() < samples;
    let enough =
        if is_enough { format!("; one sample at which {text} holds is enough") } else { String::new() };
    if alone == history.violated && (!is_negated || history.operand.is_none()) {
        return format!("It {fails} {}{enough}.", places(&alone));
    }
    if history.violated.is_empty() {
        let otherwise = if whole_fails == "fails" { "holds" } else { "fails" };
        return format!("It {fails} {}; {text} {otherwise} there.", places(&alone));
    }
    format!("It {fails} where {text} {whole_fails}, {}{enough}.", places(&history.violated))
}

/// Stands for an operand that is too long for a sentence.
const WHOLE: &str = "the operand that contains it";

/// Returns a formula as a sentence repeats it, or `otherwise` if it is too long.
fn quoted(formula: &str, otherwise: &str) -> String {
    if formula.chars().count() > MAX_OPERAND { otherwise.to_string() } else { format!("`{formula}`") }
}

fn event_text(event: &OperatorEvent, at: &dyn Fn(usize) -> String) -> String {
    match event {
        OperatorEvent::NoSample { operator, operand, nearest } => {
            let operand = quoted(operand, "its operand");
            let nearest = at(*nearest);
            format!(
                "`{operator}` needs a sample at which {operand} holds. No sample does; {nearest} comes nearest."
            )
        }
        OperatorEvent::Until { operands: [left, right], window: (first, last), left_fails, right_holds } => {
            match (right_holds, left_fails) {
                (None, _) => {
                    format!(
                        "`{right}` holds at no sample of the window of `until`, {} to {}.",
                        at(*first),
                        at(*last)
                    )
                }
                (Some(holds), Some(fails)) => format!(
                    "`{left}` fails at {}, before `{right}` holds for the first time, at {}.",
                    at(*fails),
                    at(*holds)
                ),
                (Some(holds), None) => format!("`{right}` holds for the first time at {}.", at(*holds)),
            }
        }
        OperatorEvent::Implied { operands: [left, right], sample } => {
            format!("`{left}` holds at {}, so `{right}` is required there.", at(*sample))
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use mishandle_stl::{Clock, Formula, Trace};
    use mishandle_text::instant;

    use crate::inspect::explain_trace;

    /// Explains a formula on signals `a` and `b`, with a sample every 0.1 s.
    fn sentences(formula: &str, samples: &[[f64; 2]]) -> Vec<String> {
        let mut trace = Trace::new(Arc::from(["a".to_string(), "b".to_string()]));
        samples.iter().for_each(|sample| trace.push(sample));
        let formula = Formula::parse(formula).unwrap();
        let found = explain_trace(&formula, &trace, Clock::steps(0.1)).unwrap();
        found.sentences(|sample| instant(sample, 0.1))
    }

    #[test]
    fn the_first_violation_comes_before_the_worst_sample() {
        let found = sentences("always(a <= 1 and b <= 1)", &[[0.0, 0.0], [0.0, 1.5], [2.0, 0.0], [4.0, 0.0]]);
        assert_eq!(found[0], "From step 1 (0.10 s) on, nothing can satisfy the formula.");
        assert!(
            found[1].starts_with("Decisive: a <= 1 at step 3 (0.30 s): a is 4.0000, the threshold 1.0000.")
        );
    }

    #[test]
    fn a_violated_eventually_names_the_sample_that_comes_nearest() {
        let found = sentences("eventually(a >= 1 and b >= 1)", &[[0.0, 1.0], [0.5, 2.0], [0.0, 3.0]]);
        assert_eq!(found[0], "From step 2 (0.20 s) on, nothing can satisfy the formula.");
        let last = "`eventually` needs a sample at which `a >= 1 and b >= 1` holds. No sample does; step 1 (0.10 s) comes nearest.";
        assert_eq!(found.last().unwrap(), last);
        let satisfied = sentences("eventually(a >= 1)", &[[0.0, 0.0], [2.0, 0.0], [0.0, 0.0]]);
        assert_eq!(satisfied[0], "From step 1 (0.10 s) on, nothing can violate the formula.");
        assert!(satisfied[2].ends_with("; one sample at which it holds is enough."), "{satisfied:?}");
    }

    #[test]
    fn until_names_its_two_events() {
        let early = sentences("a <= 1 until b >= 1", &[[0.0, 0.0], [2.0, 0.0], [0.0, 0.0], [0.0, 2.0]]);
        let event = "`a <= 1` fails at step 1 (0.10 s), before `b >= 1` holds for the first time, at step 3 (0.30 s).";
        assert_eq!(early.last().unwrap(), event);
        assert_eq!(early[0], "From step 1 (0.10 s) on, nothing can satisfy the formula.");
        let never = sentences("a <= 1 until[0:2] b >= 1", &[[0.0, 0.0], [0.0, 0.5], [0.0, 0.0]]);
        let event =
            "`b >= 1` holds at no sample of the window of `until`, step 0 (0.00 s) to step 2 (0.20 s).";
        assert_eq!(never.last().unwrap(), event);
    }

    #[test]
    fn what_the_formula_forbids_does_not_fail() {
        let found = sentences("always(not(a >= 1))", &[[0.0, 0.0], [2.0, 0.0], [3.0, 0.0]]);
        assert!(
            found[1].ends_with("The trace satisfies it by 2.0000, which the formula forbids."),
            "{found:?}"
        );
        assert!(found[2].starts_with("It holds, which the formula forbids, at 2 of 3 samples"), "{found:?}");
        let all = ["fails", "No sample does"];
        assert!(found.iter().all(|sentence| all.iter().all(|part| !sentence.contains(part))), "{found:?}");
    }

    /// The premise holds at three samples, and the conclusion fails at one of them.
    #[test]
    fn a_premise_is_to_blame_only_where_the_conclusion_fails() {
        let samples = [[1.0, 0.0], [9.0, 50.0], [1.0, 0.0], [9.0, 50.0], [6.0, 0.0], [1.0, 0.0]];
        let found = sentences("always(a >= 5 implies b >= 12)", &samples);
        assert!(
            found[1].ends_with("satisfies it by 1.0000, which makes `a >= 5 implies b >= 12` fail."),
            "{found:?}"
        );
        let expected = "It holds where `a >= 5 implies b >= 12` fails, at 1 of 6 samples in its window, at step 4 (0.40 s).";
        assert_eq!(found[2], expected);
        // The formula requires no premise to fail, and forbids none.
        let satisfied = [[1.0, 0.0], [9.0, 50.0], [1.0, 0.0]];
        let found = sentences("always(a >= 5 implies b >= 12)", &satisfied);
        assert!(found[1].ends_with("which makes `a >= 5 implies b >= 12` hold."), "{found:?}");
        let expected = "It holds at 1 of 3 samples in its window, at step 1 (0.10 s); `a >= 5 implies b >= 12` holds there.";
        assert_eq!(found[2], expected);
    }

    /// Each truth value by hand. A predicate is violated at a sample only if the whole operand is.
    #[test]
    fn what_is_violated_is_where_the_whole_operand_is_violated() {
        type Operand = (&'static str, fn(bool, bool) -> bool);
        let operands: [Operand; 7] = [
            ("a >= 0", |a, _| a),
            ("not(a >= 0)", |a, _| !a),
            ("a >= 0 and b >= 0", |a, b| a && b),
            ("a >= 0 or b >= 0", |a, b| a || b),
            ("a >= 0 implies b >= 0", |a, b| !a || b),
            ("not(a >= 0 implies b >= 0)", |a, b| a && !b),
            ("not(a >= 0) or not(b >= 0)", |a, b| !a || !b),
        ];
        let mut random = mishandle_random::Sequence::new(1, 0);
        for _ in 0..200 {
            let mut trace = Trace::new(Arc::from(["a".to_string(), "b".to_string()]));
            let values: Vec<[f64; 2]> =
                (0..6).map(|_| [0, 1].map(|_| 2.0 * random.uniform() - 1.0)).collect();
            values.iter().for_each(|sample| trace.push(sample));
            for (text, holds) in operands {
                for (outer, requires) in [("always", true), ("not eventually", false)] {
                    let formula = Formula::parse(&format!("{outer}({text})")).unwrap();
                    let found = explain_trace(&formula, &trace, Clock::steps(0.1)).unwrap();
                    let history = found.history.as_ref().unwrap();
                    for (sample, values) in values.iter().enumerate() {
                        let [a, b] = values.map(|value| value >= 0.0);
                        let is_violated = holds(a, b) != requires;
                        let is_counted = history.violated.contains(&sample);
                        let is_own = history.robustness[sample] < 0.0;
                        assert_eq!(is_counted, is_violated && is_own, "{formula} at {sample}");
                    }
                    let said = found.sentences(|sample| instant(sample, 0.1)).concat();
                    let is_alone = !text.contains('b');
                    assert!(
                        is_alone || !["forbids", "requires"].iter().any(|word| said.contains(word)),
                        "{said}"
                    );
                }
            }
        }
    }

    #[test]
    fn implies_names_the_condition() {
        let found = sentences("always(a >= 1 implies b >= 1)", &[[0.0, 0.0], [2.0, 0.5], [0.0, 0.0]]);
        assert_eq!(
            found.last().unwrap(),
            "`a >= 1` holds at step 1 (0.10 s), so `b >= 1` is required there."
        );
    }
}
