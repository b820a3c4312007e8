use mishandle_results as results;
use mishandle_results::{ComparedRun, Seed};

use crate::inspect::{ComparedPair, Comparison};
use crate::replay::replay_command;
use crate::run::{recorded_axes, recorded_scenario};

impl Comparison {
    /// Returns the comparison as a result.
    pub fn result(&self) -> results::Comparison {
        results::Comparison {
            target: self.target.clone(),
            target_kind: self.target_kind.clone(),
            formula: self.formula.clone(),
            first: self.first.clone(),
            second: self.second.clone(),
            differences: self.differences.clone(),
            sequential: self.sequential.clone(),
            at_any_time: self.at_any_time,
            pairs: self.pairs,
            left_out: self.left_out,
            success: self.success,
            strict_success: self.strict,
            careful_success: self.careful,
            robustness: self.robustness,
            dangerous_steps: self.dangerous_steps,
            completion_step: self.completion_step,
            verdict: self.verdict(),
            new_failures: self.pairs_of(&self.new_failures, &self.second),
            fixed_failures: self.pairs_of(&self.fixed_failures, &self.first),
            space_axes: recorded_axes(&self.axes),
        }
    }

    /// Returns the pairs with the commands that replay the failures in `run`.
    fn pairs_of(&self, pairs: &[ComparedPair], run: &ComparedRun) -> Vec<results::ComparedPair> {
        let pair = |pair: &ComparedPair| results::ComparedPair {
            trial: pair.trial,
            simulation: pair.number,
            seed: Seed(pair.seed),
            scenario: recorded_scenario(&self.axes, &pair.scenario),
            first_robustness: pair.first_robustness.map(Into::into),
            second_robustness: pair.second_robustness.map(Into::into),
            replay: replay_command(&self.target_kind, run.run.as_ref(), pair.trial, pair.number),
        };
        pairs.iter().map(pair).collect()
    }
}
