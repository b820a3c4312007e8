//! Comparisons that stop by themselves: both evaluations run in step, and a rule looks at the pairs
//! after each batch.

use std::collections::VecDeque;
use std::ops::ControlFlow;

use mishandle_evaluation::{ClippedDifferences, DifferenceSequence, Estimate, StopRule, decides_success};
use mishandle_results::{Evaluation, Number, Sequential, StopDecision};
use mishandle_rollout::Episode;
use mishandle_store::RunWriter;
use mishandle_text::{decimal, number_text, p_value_text, plural};

use crate::error::{Compared, MishandleError, other_request};
use crate::plan::{ComparePlan, EvaluatePlan, Plan, Until};
use crate::resolve::ResolvedPlan;
use crate::run::ask::{Engine, conclude, open};
use crate::run::evaluation::progress::Evaluating;
use crate::run::evaluation::with_requests;

/// The part of a simulation that a rule reads.
#[derive(Clone, Copy, Debug)]
struct Side {
    counts: bool,
    succeeds: bool,
    decides: bool,
    robustness: Option<f64>,
}

impl Side {
    fn of(episode: &Episode) -> Side {
        Side {
            counts: episode.end.counts_in_rates(),
            succeeds: episode.is_success(),
            decides: decides_success(episode),
            robustness: episode.robustness(),
        }
    }
}

/// The rule that ends a comparison, and the pairs that it has seen.
#[derive(Clone, Debug)]
pub(crate) struct PairRule {
    compare: ComparePlan,
    batch: u64,
    max: u64,
    pairs: u64,
    success: DifferenceSequence,
    robustness: Option<ClippedDifferences>,
    /// Whether A and B have any verdict; without one, nothing is compared.
    has_verdict: [bool; 2],
    decision: Option<StopDecision>,
}

impl PairRule {
    /// Returns the rule of a plan; `None` if it has none.
    pub(crate) fn new(plan: &Plan) -> Option<PairRule> {
        let compare = plan.compare?;
        let EvaluatePlan { batch, episodes, .. } = plan.evaluate.clone().unwrap_or_default();
        Some(PairRule {
            compare,
            batch: u64::from(batch).max(1),
            max: episodes,
            pairs: 0,
            success: DifferenceSequence::default(),
            robustness: compare.robustness_bounds.map(ClippedDifferences::new),
            has_verdict: [false; 2],
            decision: None,
        })
    }

    /// Adds the next pair. At the end of a batch, the rule looks.
    pub(crate) fn add(&mut self, first: &Episode, second: &Episode) {
        self.add_sides(Side::of(first), Side::of(second));
    }

    fn add_sides(&mut self, first: Side, second: Side) {
        self.pairs += 1;
        if first.counts && second.counts {
            self.success.add(first.succeeds, second.succeeds);
            let values = first.robustness.zip(second.robustness);
            if let (Some(robustness), Some((first, second))) = (&mut self.robustness, values) {
                robustness.add(first, second);
            }
            self.has_verdict[0] |= first.decides;
            self.has_verdict[1] |= second.decides;
        }
        if self.pairs.is_multiple_of(self.batch) || self.pairs == self.max {
            self.success.look();
            if self.decision.is_none() && self.has_verdict == [true; 2] {
                self.decision = self.rule().decide(&self.interval());
            }
        }
    }

    fn rule(&self) -> StopRule {
        match self.compare.until {
            Until::Width(width) => StopRule::Width(width),
            Until::Decided => StopRule::Difference(self.compare.margin),
        }
    }

    fn interval(&self) -> Estimate {
        match &self.robustness {
            Some(robustness) => robustness.estimate(),
            None => self.success.estimate(),
        }
    }

    /// Returns the difference of the success rates with an interval that holds at any time, and the
    /// p-value of "no difference".
    pub(crate) fn success(&self) -> (Estimate, f64) {
        (self.success.estimate(), self.success.p_value())
    }

    /// Returns whether there are enough pairs.
    fn has_enough(&self) -> bool {
        self.decision.is_some() || self.pairs >= self.max
    }

    /// Returns what the rule found.
    pub(crate) fn result(&self) -> Sequential {
        let interval = match self.has_verdict {
            [true, true] => self.interval(),
            _ => Estimate { n: self.pairs, ..Estimate::default() },
        };
        let p_value = self.robustness.as_ref().map_or(self.success.p_value(), ClippedDifferences::p_value);
        let ComparePlan { until, measure, margin, robustness_bounds } = self.compare;
        Sequential {
            until: until.to_string(),
            measure,
            rate: None,
            margin: margin.map(Into::into),
            robustness_bounds: robustness_bounds.map(|bounds| bounds.map(Number)),
            interval,
            p_value: Some(p_value),
            decision: self.decision,
            simulations: self.pairs,
            max_simulations: self.max,
            verdict: self.verdict(&interval, p_value),
        }
    }

    fn verdict(&self, interval: &Estimate, p_value: f64) -> String {
        let is_rate = self.robustness.is_none();
        let amount = |value: f64| {
            if is_rate { format!("{} points", number_text(100.0 * value)) } else { number_text(value) }
        };
        let end = |value: f64| if is_rate { format!("{:+.2}", 100.0 * value) } else { decimal(value, 4) };
        let p = match p_value_text(p_value) {
            small if small.starts_with('<') => format!("p {small}"),
            value => format!("p = {value}"),
        };
        let unit = if is_rate { " points" } else { "" };
        let Some((low, high)) = interval.low.zip(interval.high) else {
            return "No simulation of A or of B has a verdict, so there is nothing to compare.".to_string();
        };
        let holds = format!("(B - A, 95 % interval at any time: {} to {}{unit}; {p})", end(low), end(high));
        let margin = self.compare.margin.map(amount).unwrap_or_default();
        let more = if is_rate { "B succeeds more often" } else { "B has the higher mean robustness" };
        let less = if is_rate { "B succeeds less often" } else { "B has the lower mean robustness" };
        let what = match self.decision {
            Some(StopDecision::Above) => more.to_string(),
            Some(StopDecision::Below) => less.to_string(),
            Some(StopDecision::Equivalent) => format!("A and B differ by less than {margin}"),
            Some(StopDecision::Narrow) => {
                format!("the interval of the difference satisfies {}", self.compare.until)
            }
            None => {
                let pairs = plural(self.pairs, "pair");
                let why = match (self.compare.until, margin.is_empty()) {
                    (Until::Width(_), _) => "the interval is wider",
                    (Until::Decided, true) => "the interval contains 0",
                    (Until::Decided, false) => "the interval contains 0 and reaches beyond the margin",
                };
                return format!("Not decided after {pairs}: {why} {holds}.");
            }
        };
        let max = plural(self.max, "pair");
        format!("Stopped by itself after {} of at most {max}: {what} {holds}.", self.pairs)
    }
}

/// Runs both evaluations of a comparison in step until its rule decides, then their corners and
/// control arms. Returns the answers of both.
///
/// `runs` are open run files of the plans, which have the same table `[compare]`; the simulations
/// that they contain are not repeated. `watch` gets the numbers of finished simulations and of all
/// that there can be after each batch, and can stop.
///
/// # Errors
/// If the plans have no table `[compare]`, a run contains other simulations than its plan, or a
/// simulation cannot be run or stored.
pub fn evaluate_pairs(
    plans: [&ResolvedPlan; 2],
    runs: [RunWriter; 2],
    mut watch: impl FnMut(u64, u64) -> ControlFlow<()>,
) -> Result<[Evaluation; 2], MishandleError> {
    let [first, second] = plans;
    let rule = PairRule::new(&first.plan).filter(|_| first.plan.compare == second.plan.compare);
    let mut rule = rule.ok_or(MishandleError::MissingPlanTable { table: "compare" })?;
    let [first_run, second_run] = runs;
    let first_journal = open(first, first_run.into(), Engine::Direct)?;
    let second_journal = open(second, second_run.into(), Engine::Direct)?;
    let found = with_requests(first, |first_requests| {
        with_requests(second, |second_requests| {
            let mut waiting = [VecDeque::new(), VecDeque::new()];
            let mut a = Evaluating::open(&first_journal, first_requests, |it| {
                waiting[0].push_back(Side::of(it));
            })?;
            let mut b = Evaluating::open(&second_journal, second_requests, |it| {
                waiting[1].push_back(Side::of(it));
            })?;
            let max = a.max_simulations()? + b.max_simulations()?;
            take_pairs(&mut rule, &mut waiting)?;
            if (a.is_ended() || b.is_ended()) && !rule.has_enough() {
                let differences = vec![format!(
                    "status of trial 1: recorded as complete, but the rule does not end the comparison after {}",
                    plural(rule.pairs, "pair")
                )];
                return Err(MishandleError::differs(Compared::Plan, differences));
            }
            let mut is_stopped = watch(a.done() + b.done(), max).is_break();
            while !is_stopped && !rule.has_enough() {
                let number = (rule.pairs / rule.batch + 1) * rule.batch;
                let others = b.done();
                let flow = a.advance(number, &mut |done, episodes| {
                    waiting[0].extend(episodes.iter().map(Side::of));
                    watch(done + others, max)
                })?;
                is_stopped = flow.is_break();
                if !is_stopped {
                    let others = a.done();
                    let flow = b.advance(number, &mut |done, episodes| {
                        waiting[1].extend(episodes.iter().map(Side::of));
                        watch(done + others, max)
                    })?;
                    is_stopped = flow.is_break();
                }
                take_pairs(&mut rule, &mut waiting)?;
            }
            if !rule.has_enough() {
                return Ok([a.found(), b.found()]);
            }
            a.end();
            b.end();
            let others = b.done();
            let mut done_by_a = a.done();
            let a = if is_stopped {
                a.found()
            } else {
                a.finish(&mut |done, _| {
                    done_by_a = done;
                    let flow = watch(done + others, max);
                    is_stopped |= flow.is_break();
                    flow
                })?
            };
            let b =
                if is_stopped { b.found() } else { b.finish(&mut |done, _| watch(done + done_by_a, max))? };
            Ok([a, b])
        })
    });
    let [first_found, second_found] = found?;
    let first = conclude(first_journal, first_found)?.try_into()?;
    Ok([first, conclude(second_journal, second_found)?.try_into()?])
}

/// Adds the pairs of which both simulations are there.
fn take_pairs(rule: &mut PairRule, waiting: &mut [VecDeque<Side>; 2]) -> Result<(), MishandleError> {
    let [first, second] = waiting;
    while let (Some(a), Some(b)) = (first.front(), second.front()) {
        // After its decision, the rule asks for no more.
        if rule.has_enough() {
            return Err(other_request("simulation", rule.pairs as u32 + 1));
        }
        rule.add_sides(*a, *b);
        first.pop_front();
        second.pop_front();
    }
    Ok(())
}
