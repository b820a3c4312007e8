use serde::{Deserialize, Serialize};

/// Simulations that started, and those of them without a verdict by reason.
///
/// A scenario from which the target cannot start says nothing about the controller: it is in no
/// rate and in no share.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct EndCounts {
    /// Number of simulations that started.
    pub simulations: u64,
    /// Number of these that diverged.
    pub diverged: u64,
    /// Number of these that ended because the controller or the environment returned a value that
    /// is not finite.
    pub invalid: u64,
    /// Number of these that failed: the target or its controller crashed, gave an invalid answer,
    /// or took longer than its time limit.
    pub failed: u64,
    /// Number of others that left the formula undecided.
    pub undecided: u64,
    /// Number of scenarios from which the target cannot start. `simulations` does not include them.
    pub invalid_starts: u64,
}

impl EndCounts {
    /// Adds other counts.
    pub fn add_all(&mut self, other: EndCounts) {
        self.simulations += other.simulations;
        self.diverged += other.diverged;
        self.invalid += other.invalid;
        self.failed += other.failed;
        self.undecided += other.undecided;
        self.invalid_starts += other.invalid_starts;
    }

    /// Returns the number of simulations without a verdict.
    pub fn total(&self) -> u64 {
        self.diverged + self.invalid + self.failed + self.undecided
    }

    /// Returns the numbers of simulations without a verdict, with what they did.
    pub fn reasons(&self) -> [(u64, &'static str); 4] {
        [
            (self.diverged, "diverged"),
            (self.invalid, "ended in a value that is not finite"),
            (self.failed, "failed (crash, invalid answer or time limit)"),
            (self.undecided, "left the formula undecided"),
        ]
    }

    /// Returns the fraction of the simulations without a verdict; `None` if none started.
    pub fn share(&self) -> Option<f64> {
        (self.simulations > 0).then(|| self.total() as f64 / self.simulations as f64)
    }
}

/// Simulations that satisfy a requirement and ask nothing of the controller, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Vacuous {
    /// Number of simulations whose first sample alone satisfies it, whatever follows.
    pub first_sample: u64,
    /// Number of further simulations in which no premise holds, so that it requires nothing.
    pub premise: u64,
    /// Number of further simulations in which each operand of its `and` asks nothing, for reasons
    /// that differ.
    #[serde(default)]
    pub parts: u64,
}

impl Vacuous {
    /// Adds other counts.
    pub fn add_all(&mut self, other: Vacuous) {
        self.first_sample += other.first_sample;
        self.premise += other.premise;
        self.parts += other.parts;
    }

    /// Returns the number of simulations.
    pub fn total(&self) -> u64 {
        self.first_sample + self.premise + self.parts
    }
}

/// The simulations of a question without a verdict: one rule for all questions.
///
/// Nothing is known about a simulation that diverges, crashes, takes too long or leaves the formula
/// undecided. A bound without an assumption counts it as a failure, and no claim covers a region
/// with such simulations. If their share is too large, a question has no conclusion.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct WithoutVerdict {
    /// Fraction of the started simulations without a verdict; `null` if none started. After a
    /// screening, an unbiased estimate of it: all flagged simulations are repeated, and the audit
    /// sample stands for the others.
    pub share: Option<f64>,
    /// Largest share with which a question has a conclusion: the key `max-without-verdict` of the
    /// plan.
    pub max_share: f64,
    /// The simulations; after a screening, the repeated ones.
    #[serde(flatten)]
    pub ends: EndCounts,
}

impl WithoutVerdict {
    /// Makes the simulations without a verdict of a question.
    pub fn new(ends: EndCounts, max_share: f64) -> WithoutVerdict {
        WithoutVerdict { share: ends.share(), max_share, ends }
    }

    /// Returns whether too many simulations have no verdict for a conclusion.
    pub fn is_too_large(&self) -> bool {
        self.share.is_none_or(|share| share > self.max_share)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn invalid_starts_are_in_no_share() {
        let ends = EndCounts { simulations: 20, diverged: 1, invalid_starts: 80, ..EndCounts::default() };
        let found = WithoutVerdict::new(ends, 0.05);
        assert_eq!((found.share, found.is_too_large()), (Some(0.05), false));
        let more = EndCounts { failed: 1, ..ends };
        assert!(WithoutVerdict::new(more, 0.05).is_too_large());
        // Nothing started: nothing is concluded, whatever is allowed.
        let none = EndCounts { simulations: 0, diverged: 0, ..ends };
        assert!(WithoutVerdict::new(none, 1.0).is_too_large());
    }
}
