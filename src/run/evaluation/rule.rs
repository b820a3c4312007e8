//! The rule that ends an evaluation by its success rate.

use mishandle_evaluation::{RateSequence, StopRule};
use mishandle_results::{Estimate, Measure, Sequential, StopDecision};
use mishandle_rollout::Episode;
use mishandle_text::{plural, short_number};

use crate::plan::{EvaluatePlan, Until};

/// The rule that ends an evaluation, and the success rate that it watches.
#[derive(Clone, Debug)]
pub(crate) struct RateRule {
    rule: StopRule,
    batch: u64,
    max: u64,
    rate: RateSequence,
    simulations: u64,
    /// A rate without any verdict decides nothing.
    has_verdict: bool,
    decision: Option<StopDecision>,
}

impl RateRule {
    pub(crate) fn new(evaluate: &EvaluatePlan) -> Option<RateRule> {
        let rule = match (evaluate.until?, evaluate.rate) {
            (Until::Width(width), _) => StopRule::Width(width),
            (Until::Decided, rate) => StopRule::Rate(rate?),
        };
        Some(RateRule {
            rule,
            batch: evaluate.batch.into(),
            max: evaluate.episodes,
            rate: RateSequence::default(),
            simulations: 0,
            has_verdict: false,
            decision: None,
        })
    }

    /// Adds the next simulation. At the end of a batch, the rule looks.
    pub(crate) fn add(&mut self, episode: &Episode) {
        self.simulations += 1;
        self.has_verdict |= mishandle_evaluation::decides_success(episode);
        if episode.end.counts_in_rates() {
            self.rate.add(episode.is_success());
        }
        if self.simulations.is_multiple_of(self.batch.max(1)) || self.simulations == self.max {
            self.rate.look();
            let decision = self.has_verdict.then(|| self.rule.decide(&self.rate.estimate())).flatten();
            self.decision = self.decision.or(decision);
        }
    }

    /// Returns whether the rule ended the evaluation.
    pub(crate) fn is_decided(&self) -> bool {
        self.decision.is_some()
    }

    /// Returns the success rate with its interval that holds at any time.
    pub(crate) fn estimate(&self) -> Estimate {
        self.rate.estimate()
    }

    /// Returns what the rule found.
    pub(crate) fn result(&self, evaluate: &EvaluatePlan) -> Sequential {
        let interval = if self.has_verdict {
            self.rate.estimate()
        } else {
            Estimate { n: self.rate.n(), ..Estimate::default() }
        };
        Sequential {
            until: evaluate.until.unwrap_or_default().to_string(),
            measure: Measure::Success,
            rate: evaluate.rate.map(Into::into),
            margin: None,
            robustness_bounds: None,
            interval,
            p_value: None,
            decision: self.decision,
            simulations: self.simulations,
            max_simulations: self.max,
            verdict: self.verdict(&interval),
        }
    }

    fn verdict(&self, interval: &Estimate) -> String {
        let n = plural(self.simulations, "simulation");
        let what = match (self.rule, self.decision) {
            (StopRule::Rate(rate), Some(StopDecision::Above)) => {
                format!("the success rate is above {}", percent(rate))
            }
            (StopRule::Rate(rate), Some(_)) => {
                format!("the success rate is below {}", percent(rate))
            }
            (_, Some(_)) => "the interval of the success rate is narrow enough".to_string(),
            (StopRule::Rate(rate), None) => {
                return format!(
                    "Not decided after {n}: the interval of the success rate contains {}{}",
                    percent(rate),
                    interval_text(interval)
                );
            }
            (_, None) => {
                return format!("Not narrow enough after {n}{}", interval_text(interval));
            }
        };
        let max = plural(self.max, "simulation");
        format!(
            "Stopped by itself after {} of at most {max}: {what}{}",
            self.simulations,
            interval_text(interval)
        )
    }
}

/// Returns the end of a sentence: the interval in percent, and that it holds at any time.
fn interval_text(interval: &Estimate) -> String {
    let ends = interval.low.zip(interval.high);
    ends.map_or(". No simulation has a verdict".to_string(), |(low, high)| {
        format!(" (95 % interval at any time: {:.2} to {:.2} %)", 100.0 * low, 100.0 * high)
    }) + "."
}

fn percent(rate: f64) -> String {
    format!("{} %", short_number(100.0 * rate))
}
