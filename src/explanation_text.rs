//! Explanations in sentences.

use mishandle_stl::DecisivePredicate;

use crate::{Explanation, PredicateHistory, plural};

impl Explanation {
    /// Describes the decisive predicate, one sentence per item: the values of its sides at the decisive sample, the samples of
    /// its window that violate it, and whether it is the nearest of samples that all fail. Empty without a decisive predicate.
    ///
    /// `control_dt` is the time between two samples, in seconds. Names and formulas are as in the run file: escape them before
    /// you print them.
    pub fn sentences(&self, control_dt: f64) -> Vec<String> {
        let (Some(predicate), Some(history)) = (&self.diagnosis.predicate, &self.history) else {
            return Vec::new();
        };
        let at = |sample: usize| instant(sample, control_dt);
        let mut sentences = vec![decision(predicate, &at), violation(history, &at)];
        let nearest = self.diagnosis.path.iter().rev().skip(1).find_map(|found| {
            let operator =
                found.operator.filter(|operator| matches!(*operator, "eventually" | "once" | "until"))?;
            (found.robustness < 0.0).then_some(operator)
        });
        if let Some(operator) = nearest {
            sentences
                .push(format!("No sample satisfies the operand of `{operator}`; this one comes nearest."));
        }
        sentences
    }
}

/// Formats a sample with its time, such as `step 30 (0.50 s)`. `control_dt` is the time between two samples, in seconds.
pub fn instant(sample: usize, control_dt: f64) -> String {
    format!("step {sample} ({:.2} s)", sample as f64 * control_dt)
}

/// Describes the values of the two sides of a predicate, such as `gap is 1.2000, the threshold 2.0000`.
pub fn compared_values(predicate: &DecisivePredicate) -> String {
    let [left, right] = predicate.values;
    let [left_text, right_text] = &predicate.sides;
    let is_number = |side: &str| side.parse::<f64>().is_ok();
    match [is_number(left_text), is_number(right_text)] {
        [false, true] => format!("{left_text} is {left:.4}, the threshold {right:.4}"),
        [true, false] => format!("{right_text} is {right:.4}, the threshold {left:.4}"),
        _ => format!("{left_text} is {left:.4}, {right_text} is {right:.4}"),
    }
}

fn decision(predicate: &DecisivePredicate, at: &dyn Fn(usize) -> String) -> String {
    let compared = compared_values(predicate);
    let margin = predicate.robustness.abs();
    let side = match (predicate.robustness < 0.0, predicate.is_negated) {
        (true, false) => format!("violates it by {margin:.4}"),
        (false, false) => format!("satisfies it by {margin:.4}"),
        (true, true) => format!("violates it by {margin:.4}, as the formula requires"),
        (false, true) => format!("satisfies it by {margin:.4}, which the formula forbids"),
    };
    format!("Decisive: {} at {}: {compared}. The trace {side}.", predicate.text, at(predicate.sample))
}

fn violation(history: &PredicateHistory, at: &dyn Fn(usize) -> String) -> String {
    let (first, last) = history.window;
    let samples = last + 1 - first;
    let all = if samples == 1 { "the only sample".to_string() } else { format!("all {samples} samples") };
    match history.first_and_last {
        None => format!("It holds at {all} of its window, {} to {}.", at(first), at(last)),
        Some(_) if history.violated == samples => {
            format!("It fails at {all} of its window, {} to {}.", at(first), at(last))
        }
        Some((from, to)) => format!(
            "It fails at {} of {} in its window, from {} to {}.",
            history.violated,
            plural(samples, "sample"),
            at(from),
            at(to),
        ),
    }
}
