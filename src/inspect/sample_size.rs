//! How many simulations a question takes, before any of them.

use mishandle_evaluation::{SizeSettings, Sizes, StopRule, pair_size, rate_size};
use mishandle_results::{Evaluation, ExpectedPairs, SampleSize, Seed as ResultSeed};
use mishandle_store::{RunFile, RunKind};

use crate::error::{MishandleError, invalid};
use crate::inspect::comparison::{compare, not_comparable};
use crate::plan::{ComparePlan, EvaluatePlan, Plan, Until};
use crate::resolve::{check_compare, check_evaluate};
use crate::run::recorded_answer;

/// Expected rates, from experience or from a pilot run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Expected {
    /// A success rate.
    Rate(f64),
    /// The probabilities that both controllers, only A, only B and neither succeed.
    Pairs([f64; 4]),
}

impl Expected {
    /// Returns what two success rates say about pairs whose verdicts are independent. Pairs on the
    /// same scenarios agree more often and take fewer simulations.
    pub fn independent(first: f64, second: f64) -> Expected {
        let both = first * second;
        Expected::Pairs([both, first - both, second - both, 1.0 - first - second + both])
    }

    /// Returns a warning if what is expected has no uncertainty, such as after a pilot run without
    /// a failure.
    pub fn warning(&self) -> Option<String> {
        let certain = match *self {
            Expected::Rate(rate) if rate == 0.0 || rate == 1.0 => {
                format!("a success rate of {} %", 100.0 * rate)
            }
            Expected::Pairs([_, first_only, second_only, _]) if first_only <= 0.0 && second_only <= 0.0 => {
                "pairs that never differ".to_string()
            }
            Expected::Rate(_) | Expected::Pairs(_) => return None,
        };
        Some(format!("the numbers are for {certain}, which no pilot run shows; state a rate instead"))
    }

    /// Returns the success rate of an evaluation.
    ///
    /// # Errors
    /// If the run is not an evaluation, has no verdict, or cannot be read.
    pub fn of_run(run: &RunFile) -> Result<Expected, MishandleError> {
        if run.header().kind != RunKind::Evaluate {
            let kind = run.header().kind.name();
            return Err(not_comparable(format!(
                "the pilot is a run of `{kind}`; expected one of `evaluate`"
            )));
        }
        let found: Evaluation = recorded_answer(run, None)?.try_into()?;
        let no_verdict = || not_comparable("no simulation of the pilot has a verdict");
        found.metrics.success_rate.value.map(Expected::Rate).ok_or_else(no_verdict)
    }

    /// Returns how often both, one or none of two evaluations succeed.
    ///
    /// # Errors
    /// Those of [`compare`], or if no simulation has a verdict.
    pub fn of_pairs(first: &RunFile, second: &RunFile) -> Result<Expected, MishandleError> {
        let found = compare(first, second, |_| String::new())?;
        if !found.has_verdicts() || found.pairs == 0 {
            return Err(not_comparable("the pilots have no verdicts"));
        }
        let share = |count: u64| count as f64 / found.pairs as f64;
        let first_only = share(found.success.first_only);
        let second_only = share(found.success.second_only);
        let both = (found.success.first.value.unwrap_or(0.0) - first_only).clamp(0.0, 1.0);
        Ok(Expected::Pairs([both, first_only, second_only, (1.0 - both - first_only - second_only).max(0.0)]))
    }
}

/// A question before the simulations, in the words of a plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SizeQuestion {
    /// Expected rates.
    pub expected: Expected,
    /// When it is known.
    pub until: Until,
    /// The rate that `decided` decides about.
    pub rate: Option<f64>,
    /// The largest difference that counts as none.
    pub margin: Option<f64>,
}

/// Returns how many simulations or pairs a question takes, fixed beforehand and with the rule that
/// stops by itself, which is simulated `replications` times. No target is simulated.
///
/// # Errors
/// If a number is out of its range.
pub fn sample_size(question: &SizeQuestion, settings: SizeSettings) -> Result<SampleSize, MishandleError> {
    let SizeQuestion { expected, until, rate, margin } = *question;
    if !(1..=SizeSettings::LARGEST).contains(&settings.max) {
        return Err(invalid("the largest number", settings.max.to_string(), "from 1 to 100000"));
    }
    if !(1..=100_000).contains(&settings.replications) {
        let value = settings.replications.to_string();
        return Err(invalid("the number of replications", value, "from 1 to 100000"));
    }
    if !Plan::BATCH.contains(&settings.batch) {
        return Err(invalid("the batch size", settings.batch.to_string(), "from 1 to 65536"));
    }
    let is_rate = |value: f64| (0.0..=1.0).contains(&value);
    let (Sizes { fixed, median, ninety_percent, mean, decided }, expected_rate, expected_pairs) =
        match expected {
            Expected::Rate(value) if !is_rate(value) => {
                return Err(invalid("the expected rate", value.to_string(), "from 0 to 1"));
            }
            Expected::Rate(value) => {
                if let Some(margin) = margin {
                    return Err(invalid(
                        "the margin",
                        margin.to_string(),
                        "left out, because one rate has none",
                    ));
                }
                check_evaluate(&EvaluatePlan { until: Some(until), rate, ..EvaluatePlan::default() })?;
                let rule = match (until, rate) {
                    (Until::Decided, Some(rate)) => StopRule::Rate(rate),
                    (Until::Width(width), _) => StopRule::Width(width),
                    (Until::Decided, None) => {
                        return Err(MishandleError::MissingPlanTable { table: "evaluate" });
                    }
                };
                (rate_size(value, rule, settings), Some(value.into()), None)
            }
            Expected::Pairs(cells) => {
                if cells.iter().any(|cell| !(-1e-12..=1.0).contains(cell)) {
                    let value = format!("{cells:?}");
                    let expected = "probabilities of both, only A, only B and neither: a share of both is at most either rate";
                    return Err(invalid("what is expected", value, expected));
                }
                if let Some(rate) = rate {
                    let expected = "left out, because a comparison decides about a difference";
                    return Err(invalid("the rate", rate.to_string(), expected));
                }
                check_compare(&ComparePlan { until, margin, ..ComparePlan::default() })?;
                let rule = match until {
                    Until::Decided => StopRule::Difference(margin),
                    Until::Width(width) => StopRule::Width(width),
                };
                let [both, first_only, second_only, neither] = cells.map(|cell| cell.max(0.0).into());
                let pairs = ExpectedPairs { both, first_only, second_only, neither };
                (pair_size(cells.map(|cell| cell.max(0.0)), rule, settings), None, Some(pairs))
            }
        };
    Ok(SampleSize {
        until: until.to_string(),
        rate: rate.map(Into::into),
        margin: margin.map(Into::into),
        expected_rate,
        expected_pairs,
        fixed,
        median,
        ninety_percent,
        mean: mean.into(),
        decided: decided.into(),
        max_simulations: settings.max,
        batch: settings.batch,
        replications: settings.replications,
        seed: ResultSeed(settings.seed.0),
    })
}
