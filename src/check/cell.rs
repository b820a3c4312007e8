//! The verdict of a requirement for a controller, with its evidence.

use mishandle_evaluation::clopper_pearson;
use mishandle_falsification::FalsificationError;
use mishandle_results as results;
use mishandle_results::{
    CheckCell, CheckCounterexample, CheckedValue, Estimate, NO_VERDICT, NOT_APPLICABLE, NOT_VIOLATED, Number,
    VIOLATED,
};
use mishandle_rollout::{Request, Scenario, Seed};
use mishandle_store::{AxisRecord, RunFile, Simulation};
use mishandle_text::{decimal, number_text, path_text, plural, shell_quote};

use super::{Asked, Checker, counterexample_file, create_folder};
use crate::counterexample::Counterexample;
use crate::error::MishandleError;
use crate::replay::replay_command;
use crate::resolve::{ResolvedPlan, is_python};

/// Two one-sided 95 % bounds.
const CONFIDENCE: f64 = 0.9;

/// Numbers of simulations of a requirement.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Counts {
    decided: u64,
    violated: u64,
    without: u64,
}

/// Numbers and the worst simulation of all runs for a requirement.
#[derive(Debug, Default)]
pub(super) struct Row {
    random: Counts,
    searched: Counts,
    pub violated: u64,
    minimum: Option<Number>,
    /// Path, trial and number of the simulation with the minimum robustness.
    worst: Option<(std::path::PathBuf, u32, u32)>,
}

impl Row {
    /// Adds a run with `all` simulations.
    pub fn add(&mut self, found: &results::Requirement, all: u64, run: &RunFile, is_random: bool) {
        let counts = if is_random { &mut self.random } else { &mut self.searched };
        counts.decided += found.simulations;
        counts.violated += found.violated;
        counts.without += all - found.simulations;
        self.violated += found.violated;
        let place = found.minimum_robustness.zip(found.trial.zip(found.simulation));
        if let Some((robustness, (trial, number))) = place
            && self.minimum.is_none_or(|least| robustness.0.total_cmp(&least.0).is_lt())
        {
            self.minimum = Some(robustness);
            self.worst = Some((run.path().to_path_buf(), trial, number));
        }
    }

    fn simulations(&self) -> u64 {
        self.random.decided + self.searched.decided
    }

    fn without_verdict(&self) -> u64 {
        self.random.without + self.searched.without
    }

    /// Returns the failure rate of the random scenarios. Those without a verdict widen the
    /// interval.
    fn failure_rate(&self) -> Estimate {
        let Counts { decided, violated, without } = self.random;
        let all = decided + without;
        let low = clopper_pearson(violated, all, CONFIDENCE).low;
        let high = clopper_pearson(violated + without, all, CONFIDENCE).high;
        Estimate { value: (decided > 0).then(|| violated as f64 / decided as f64), low, high, n: decided }
    }

    /// Returns the verdict and its evidence in a sentence.
    fn verdict(&self, limit: Option<f64>) -> (&'static str, String) {
        let Counts { violated, decided, .. } = self.random;
        let rate = self.failure_rate();
        let (low, high) = (rate.low.unwrap_or(0.0), rate.high.unwrap_or(1.0));
        let (verdict, sentence) = match limit {
            _ if self.simulations() == 0 => (
                NO_VERDICT,
                format!("none of {} has a verdict", plural(self.without_verdict(), "simulation")),
            ),
            Some(limit) => {
                let of = format!("{violated} of {} violate it", plural(decided, "random scenario"));
                let between = format!(
                    "a failure rate from {} to {} (each bound with 95 %)",
                    percent(low),
                    percent(high)
                );
                let limit_text = percent(limit);
                if low > limit {
                    (VIOLATED, format!("{of}: {between}, above the limit of {limit_text}"))
                } else if high <= limit {
                    (NOT_VIOLATED, format!("{of}: {between}, within the limit of {limit_text}"))
                } else {
                    (NO_VERDICT, format!("{of}: {between} does not decide about the limit of {limit_text}"))
                }
            }
            None if violated > 0 => {
                let of = format!("{violated} of {} violate it", plural(decided, "random scenario"));
                (VIOLATED, format!("{of}: a failure rate of at least {} (95 %)", percent(low)))
            }
            None if self.violated > 0 => {
                let found = plural(self.searched.violated, "violation");
                (
                    VIOLATED,
                    format!("searches found {found} in {}", plural(self.searched.decided, "simulation")),
                )
            }
            None => {
                let searched = match self.searched.decided {
                    0 => String::new(),
                    searched => format!(" and {searched} of searches"),
                };
                let all = plural(decided, "random simulation");
                let rate = format!("a failure rate of at most {} in random scenarios (95 %)", percent(high));
                (NOT_VIOLATED, format!("no violation in {all}{searched}: {rate}"))
            }
        };
        let without = match self.without_verdict() {
            0 => String::new(),
            _ if self.simulations() == 0 => String::new(),
            without => format!("; {} without a verdict", plural(without, "simulation")),
        };
        (verdict, sentence + &without)
    }
}

/// Formats a share. Small ones keep two digits.
fn percent(share: f64) -> String {
    let value = 100.0 * share;
    let decimals = if value == 0.0 || value >= 1.0 { 1 } else { (-value.log10()).ceil() as usize + 1 };
    // More digits would be unreadable.
    if decimals > 9 { number_text(share) } else { format!("{} %", decimal(value, decimals)) }
}

impl Checker<'_> {
    /// Returns the cell of a requirement, and writes its counterexample.
    pub(super) fn cell(&self, asked: &Asked<'_>, row: &Row) -> Result<CheckCell, MishandleError> {
        let mut cell = CheckCell {
            requirement: asked.written.name.clone(),
            controller: self.plan.controller.clone(),
            verdict: NOT_APPLICABLE.to_string(),
            evidence: format!("the target has no signal {}", asked.missing.join(", ")),
            missing_signals: asked.missing.clone(),
            simulations: row.simulations(),
            violated: row.violated,
            without_verdict: row.without_verdict(),
            failure_rate: None,
            minimum_robustness: row.minimum,
            counterexample: None,
        };
        let Some(alone) = &asked.alone else { return Ok(cell) };
        let (verdict, evidence) = row.verdict(asked.written.check.max_failure_rate);
        (cell.verdict, cell.evidence) = (verdict.to_string(), evidence);
        cell.failure_rate = Some(row.failure_rate());
        if let (Some((path, trial, number)), true) = (&row.worst, row.violated > 0) {
            let run = RunFile::open_unchecked(path)?;
            let recorded = run.simulation(*trial, *number)?;
            let (counterexample, is_reproduced) =
                self.counterexample(asked, alone, &run, &recorded, row.minimum)?;
            if !is_reproduced {
                cell.evidence +=
                    "; simulated again, the counterexample satisfies it: the system is not deterministic";
            }
            cell.counterexample = Some(counterexample);
        }
        Ok(cell)
    }

    /// Describes a violation and writes it to a file. Also returns whether it happened again.
    fn counterexample(
        &self,
        asked: &Asked<'_>,
        alone: &ResolvedPlan,
        run: &RunFile,
        recorded: &Simulation,
        robustness: Option<Number>,
    ) -> Result<(CheckCounterexample, bool), MishandleError> {
        let (trial, number) = (recorded.trial, recorded.number);
        let value = |(axis, value): (&AxisRecord, &Option<f64>)| CheckedValue {
            axis: axis.name.clone(),
            unit: axis.unit.clone(),
            value: *value,
            nominal: axis.nominal,
        };
        let header = run.header();
        let mut found = CheckCounterexample {
            run: path_text(run.path()),
            trial,
            simulation: number,
            seed: results::Seed(recorded.seed),
            scenario: header.axes.iter().zip(&recorded.scenario).map(value).collect(),
            robustness: robustness.unwrap_or_default(),
            file: None,
            replay: replay_command(&header.target.kind, run.path(), trial, number),
        };
        let scenario = Scenario::new(recorded.scenario.clone());
        let request = Request { trial, number, ..Request::new(scenario, Seed(recorded.seed)) };
        let counterexample = match Counterexample::simulate(alone, request) {
            Err(MishandleError::Falsification(FalsificationError::NotACounterexample { .. })) => {
                return Ok((found, false));
            }
            counterexample => counterexample?,
        };
        let path = counterexample_file(self.folder, &self.label, &asked.written.name);
        create_folder(path.parent().unwrap_or(self.folder))?;
        super::folder::write(&path, counterexample.to_json().as_bytes())?;
        if !is_python(&header.target.kind) {
            found.replay = format!("mishandle replay {}", shell_quote(&path_text(&path)));
            if counterexample.plan.controller.starts_with("./") {
                found.replay += &format!(" --controller {}", shell_quote(&self.plan.controller));
            }
        }
        found.file = Some(path_text(&path));
        Ok((found, true))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(random: [u64; 3], searched: [u64; 3]) -> Row {
        let counts = |[decided, violated, without]: [u64; 3]| Counts { decided, violated, without };
        let violated = random[1] + searched[1];
        Row { random: counts(random), searched: counts(searched), violated, ..Row::default() }
    }

    #[test]
    fn without_a_violation_the_rate_has_the_bound_of_the_rule_of_three() {
        let found = row([299, 0, 0], [300, 0, 0]);
        // 299 simulations without a failure are the fewest that show a rate below 1 %.
        assert!(found.failure_rate().high.expect("simulated") < 0.01);
        assert_eq!(found.verdict(None).0, NOT_VIOLATED);
        assert_eq!(found.verdict(Some(0.01)).0, NOT_VIOLATED);
        assert_eq!(row([298, 0, 0], [0; 3]).verdict(Some(0.01)).0, NO_VERDICT);
    }

    #[test]
    fn a_limit_is_violated_only_if_the_rate_is_surely_above_it() {
        // The upper bounds of 1 and 2 of 100 are 4.7 % and 6.2 %: the 95 % quantiles of the beta
        // distributions (2, 99) and (3, 98).
        assert_eq!(row([100, 1, 0], [0; 3]).verdict(Some(0.05)).0, NOT_VIOLATED);
        assert_eq!(row([100, 2, 0], [0; 3]).verdict(Some(0.05)).0, NO_VERDICT);
        assert_eq!(row([100, 50, 0], [0; 3]).verdict(Some(0.05)).0, VIOLATED);
        assert_eq!(row([100, 1, 0], [0; 3]).verdict(None).0, VIOLATED);
    }

    #[test]
    fn a_share_is_never_shown_as_zero() {
        assert_eq!([0.25, 1e-9, 1e-320].map(percent), ["25.0 %", "0.00000010 %", "1e-320"]);
    }

    #[test]
    fn simulations_without_a_verdict_never_help() {
        let (clean, unclear) = (row([1000, 0, 0], [0; 3]), row([900, 0, 100], [0; 3]));
        assert_eq!(clean.verdict(Some(0.05)).0, NOT_VIOLATED);
        assert_eq!(unclear.verdict(Some(0.05)).0, NO_VERDICT);
        assert_eq!(
            row([0, 0, 10], [0, 0, 5]).verdict(None),
            (NO_VERDICT, "none of 15 simulations has a verdict".into())
        );
        assert!(unclear.verdict(None).1.ends_with("; 100 simulations without a verdict"));
    }
}
