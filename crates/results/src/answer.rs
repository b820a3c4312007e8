use std::fmt;

use serde::Serialize;

use crate::{
    Evaluation, Falsification, Hardening, Margin, Metamorphic, Requirement, Risk, Screening, WithoutVerdict,
};

/// The result of a run.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(untagged)]
#[cfg_attr(feature = "schema", schemars(inline))]
pub enum Answer {
    /// The result of `evaluate`.
    Evaluation(Box<Evaluation>),
    /// The result of `falsify`.
    Falsification(Box<Falsification>),
    /// The result of `margin`.
    Margin(Box<Margin>),
    /// The result of metamorphic relations.
    Metamorphic(Box<Metamorphic>),
    /// The result of `risk`.
    Risk(Box<Risk>),
    /// The result of `harden`.
    Hardening(Box<Hardening>),
}

impl Answer {
    /// Returns whether the question was not interrupted. A hardening has an answer at its end only.
    pub fn is_complete(&self) -> bool {
        match self {
            Answer::Evaluation(found) => found.is_complete,
            Answer::Falsification(found) => found.is_complete,
            Answer::Margin(found) => found.is_complete,
            Answer::Metamorphic(found) => found.is_complete,
            Answer::Risk(found) => found.is_complete,
            Answer::Hardening(_) => true,
        }
    }

    /// Returns whether any simulation has a verdict. Without one, the system was not tested.
    pub fn has_verdict(&self) -> bool {
        match self {
            Answer::Evaluation(found) => found.metrics.success_rate.value.is_some(),
            Answer::Falsification(found) => found.falsification_rate.value.is_some(),
            Answer::Margin(found) => found.has_verdict(),
            Answer::Metamorphic(found) => found.has_verdict(),
            Answer::Risk(found) => found.monte_carlo.failure_rate.value.is_some(),
            Answer::Hardening(found) => found.failure_probability.iter().any(|rate| rate.value.is_some()),
        }
    }

    /// Returns the simulations of the question without a verdict.
    pub fn without_verdict(&self) -> &WithoutVerdict {
        match self {
            Answer::Evaluation(found) => &found.without_verdict,
            Answer::Falsification(found) => &found.without_verdict,
            Answer::Margin(found) => &found.without_verdict,
            Answer::Metamorphic(found) => &found.without_verdict,
            Answer::Risk(found) => &found.without_verdict,
            Answer::Hardening(found) => &found.without_verdict,
        }
    }

    /// Returns whether the question concludes something, and too few of its simulations have a
    /// verdict for that, or none asks anything. An evaluation and a search say what they found.
    pub fn is_inconclusive(&self) -> bool {
        let concludes = !matches!(self, Answer::Evaluation(_) | Answer::Falsification(_));
        let open_relation = || match self {
            Answer::Metamorphic(found) => found.open_relation(),
            _ => None,
        };
        let is_open = || {
            self.without_verdict().is_too_large()
                || self.formula_asks_nothing().is_some()
                || open_relation().is_some()
        };
        concludes && !self.is_violated() && is_open()
    }

    /// Returns whether a violation was found; for a hardening, whether no round was accepted. An
    /// evaluation only measures.
    pub fn is_violated(&self) -> bool {
        match self {
            Answer::Evaluation(_) => false,
            Answer::Falsification(found) => found.falsified_trials > 0,
            Answer::Margin(found) => found.witness.is_some(),
            Answer::Metamorphic(found) => found.is_broken(),
            Answer::Risk(found) => !found.failures.is_empty(),
            Answer::Hardening(found) => found.after.is_none(),
        }
    }

    /// Returns the number of simulations of the question.
    pub fn simulations(&self) -> u64 {
        match self {
            Answer::Evaluation(found) => found.metrics.simulations,
            Answer::Falsification(found) => found.simulations,
            Answer::Margin(found) => found.simulations,
            Answer::Metamorphic(found) => found.simulations,
            Answer::Risk(found) => found.simulations,
            Answer::Hardening(found) => found.simulations,
        }
    }

    /// Returns the findings about the named requirements; empty without one.
    pub fn requirements(&self) -> &[Requirement] {
        let found = match self {
            Answer::Evaluation(found) => &found.requirements,
            Answer::Falsification(found) => &found.requirements,
            _ => &None,
        };
        found.as_deref().unwrap_or_default()
    }

    /// Returns why no simulation asks anything with the formula of the question; `None` if one
    /// does.
    pub fn formula_asks_nothing(&self) -> Option<&str> {
        let reason = match self {
            Answer::Falsification(found) => &found.asks_nothing,
            Answer::Margin(found) => &found.asks_nothing,
            Answer::Metamorphic(found) => &found.asks_nothing,
            Answer::Risk(found) => &found.asks_nothing,
            Answer::Evaluation(found) => &found.asks_nothing,
            Answer::Hardening(_) => &None,
        };
        reason.as_deref()
    }

    /// Returns why requirements ask nothing in the simulations, as `NAME: REASON` or as the reason
    /// of the formula of a search. Empty if one is violated.
    pub fn asks_nothing(&self) -> Vec<String> {
        let named = self.requirements();
        if self.is_violated() || named.iter().any(|found| found.violated > 0) {
            return Vec::new();
        }
        // Named requirements say it of themselves.
        let alone = self.formula_asks_nothing().filter(|_| named.is_empty()).map(str::to_owned);
        let reason = |found: &Requirement| {
            found.asks_nothing.as_ref().map(|reason| format!("{}: {reason}", found.name))
        };
        named.iter().filter_map(reason).chain(alone).collect()
    }

    /// Returns the counts of the screening; `None` without it.
    pub fn screening(&self) -> Option<&Screening> {
        match self {
            Answer::Evaluation(found) => found.screening.as_ref(),
            Answer::Falsification(found) => found.screening.as_ref(),
            Answer::Risk(found) => found.screening.as_ref(),
            _ => None,
        }
    }
}

/// An answer is that of another question than the one whose answer is needed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OtherQuestion;

impl fmt::Display for OtherQuestion {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str("the answer is that of another question")
    }
}

impl std::error::Error for OtherQuestion {}

macro_rules! answers {
    ($($question:ident)*) => {$(
        impl TryFrom<Answer> for $question {
            type Error = OtherQuestion;

            fn try_from(answer: Answer) -> Result<$question, OtherQuestion> {
                match answer {
                    Answer::$question(found) => Ok(*found),
                    _ => Err(OtherQuestion),
                }
            }
        }
    )*};
}

answers!(Evaluation Falsification Margin Metamorphic Risk Hardening);
