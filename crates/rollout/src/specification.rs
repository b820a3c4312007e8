use std::sync::Arc;

use mishandle_stl::{Clock, Formula, Monitor, Trace};

use crate::RolloutError;

/// The formulas an episode is judged by, over the signals of its trace.
#[derive(Clone, Debug, PartialEq)]
pub struct Specification {
    /// What a falsification tries to violate: the success formula unless another was asked for.
    pub requirement: Formula,
    /// φ: whether the task was done.
    pub success: Formula,
    /// φ′: whether it was done well.
    pub strict: Formula,
    /// δ: a predicate on one sample; where it is violated, the behavior is dangerous.
    pub safe: Formula,
    /// κ: holds from the moment the task is completed.
    pub completion: Formula,
}

impl Specification {
    /// Parses the four formulas of a task; the requirement is `success`.
    ///
    /// # Errors
    /// If one does not parse, or `safe` has a temporal operator.
    pub fn parse(success: &str, strict: &str, safe: &str, completion: &str) -> Result<Self, RolloutError> {
        let parse = |text: &str| {
            Formula::parse(text).map_err(|source| RolloutError::Parse { formula: text.to_string(), source })
        };
        let success = parse(success)?;
        let safe = parse(safe)?;
        if !safe.is_state_predicate() {
            return Err(RolloutError::NotAPredicate { formula: safe.to_string() });
        }
        Ok(Specification {
            requirement: success.clone(),
            success,
            strict: parse(strict)?,
            safe,
            completion: parse(completion)?,
        })
    }
}

/// What the formulas say of one episode. A formula that the trace does not cover is undecided: `None`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Verdict {
    /// Robustness of the requirement at time 0.
    pub robustness: Option<f64>,
    /// Robustness of success at time 0.
    pub success: Option<f64>,
    /// Robustness of strict success at time 0.
    pub strict: Option<f64>,
    /// Samples after the first at which the safe condition is violated.
    pub dangerous_steps: usize,
    /// Control steps until completion first holds, its whole window inside the trace.
    pub completion_step: Option<usize>,
}

/// A [`Specification`] compiled for one list of signals; owns its scratch, so that judging allocates nothing.
#[derive(Debug)]
pub struct Judge {
    requirement: Rule,
    success: Rule,
    strict: Rule,
    safe: Rule,
    completion: Rule,
}

#[derive(Debug)]
struct Rule {
    text: String,
    monitor: Monitor,
}

impl Rule {
    fn new(formula: &Formula, signals: &[String], clock: Clock) -> Result<Rule, RolloutError> {
        let text = formula.to_string();
        match Monitor::new(formula, signals, clock) {
            Ok(monitor) => Ok(Rule { text, monitor }),
            Err(source) => Err(RolloutError::Monitor { formula: text, source }),
        }
    }

    fn signal(&mut self, trace: &Trace) -> Result<&[f64], RolloutError> {
        self.monitor
            .robustness_signal(trace)
            .map_err(|source| RolloutError::Monitor { formula: self.text.clone(), source })
    }

    /// Number of samples at whose time the formula is covered by a trace of `len` samples, the `whole` episode or its
    /// begin. A formula that reaches to the end, wherever that is, is covered by a whole one alone.
    fn covered(&self, len: usize, whole: bool) -> usize {
        match self.monitor.horizon() {
            Some(horizon) => len.saturating_sub(horizon),
            None if whole => len,
            None => 0,
        }
    }

    fn at_start(&mut self, trace: &Trace, whole: bool) -> Result<Option<f64>, RolloutError> {
        if self.covered(trace.len(), whole) == 0 {
            return Ok(None);
        }
        // An infinite value is that of an empty window: the formula speaks of no sample of the trace.
        Ok(self.signal(trace)?.first().copied().filter(|rho| rho.is_finite()))
    }
}

impl Judge {
    /// Compiles `specification` for traces with these signals, sampled every `control_dt` seconds.
    ///
    /// # Errors
    /// If a formula names an unknown signal, or an interval that is not a whole number of control steps.
    pub fn new(
        specification: &Specification,
        signals: &Arc<[String]>,
        control_dt: f64,
    ) -> Result<Judge, RolloutError> {
        let rule = |formula: &Formula| Rule::new(formula, signals, Clock::steps(control_dt));
        Ok(Judge {
            requirement: rule(&specification.requirement)?,
            success: rule(&specification.success)?,
            strict: rule(&specification.strict)?,
            safe: rule(&specification.safe)?,
            completion: rule(&specification.completion)?,
        })
    }

    /// The verdict on `trace`, which holds the `whole` episode or its begin.
    ///
    /// # Errors
    /// If a signal that a formula names holds NaN or an infinity.
    pub fn verdict(&mut self, trace: &Trace, whole: bool) -> Result<Verdict, RolloutError> {
        let covered = self.completion.covered(trace.len(), whole);
        Ok(Verdict {
            robustness: self.requirement.at_start(trace, whole)?,
            success: self.success.at_start(trace, whole)?,
            strict: self.strict.at_start(trace, whole)?,
            dangerous_steps: self.safe.signal(trace)?.iter().skip(1).filter(|rho| **rho < 0.0).count(),
            completion_step: self.completion.signal(trace)?[..covered].iter().position(|rho| *rho > 0.0),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn trace(values: &[f64]) -> Trace {
        let mut trace = Trace::new(Arc::from(["d".to_string()]));
        values.iter().for_each(|value| trace.push(&[*value]));
        trace
    }

    fn judge(success: &str, completion: &str) -> Judge {
        let specification =
            Specification::parse(success, "eventually[0:3](d <= 1)", "d < 3", completion).unwrap();
        Judge::new(&specification, &Arc::from(["d".to_string()]), 1.0 / 60.0).unwrap()
    }

    #[test]
    fn a_verdict_worked_out_by_hand() {
        // d = 5 4 2 1 1: success needs d <= 2.5 at samples 2 to 4, the worst of 0.5 1.5 1.5;
        // unsafe after sample 0: only the 4; complete once d <= 2 for two samples: from sample 2.
        let verdict = judge("always[2:4](d <= 2.5)", "always[0:1](d < 2.5)")
            .verdict(&trace(&[5.0, 4.0, 2.0, 1.0, 1.0]), true)
            .unwrap();
        assert_eq!(verdict.success, Some(0.5));
        assert_eq!(verdict.robustness, Some(0.5));
        assert_eq!(verdict.strict, Some(0.0));
        assert_eq!(verdict.dangerous_steps, 1);
        assert_eq!(verdict.completion_step, Some(2));
    }

    #[test]
    fn a_formula_past_the_end_of_the_trace_is_undecided() {
        let verdict =
            judge("always[2:9](d <= 2.5)", "d < 0").verdict(&trace(&[1.0, 1.0, 1.0]), true).unwrap();
        assert_eq!(verdict.success, None);
        assert_eq!(verdict.strict, None);
        assert_eq!(verdict.completion_step, None);
    }

    #[test]
    fn a_formula_that_reaches_to_the_end_is_undecided_before_it() {
        let mut judge = judge("always(d <= 2.5)", "d < 0");
        assert_eq!(judge.verdict(&trace(&[1.0, 1.0]), true).unwrap().success, Some(1.5));
        assert_eq!(judge.verdict(&trace(&[1.0, 1.0]), false).unwrap().success, None);
    }

    #[test]
    fn a_window_that_no_trace_can_fill_decides_nothing() {
        for formula in ["eventually[9:inf](d <= 2.5)", "always[9:inf](d <= 2.5)", "once[1:2](d <= 2.5)"] {
            let verdict = judge(formula, "d < 0").verdict(&trace(&[1.0, 1.0]), true).unwrap();
            assert_eq!(verdict.success, None, "{formula}");
        }
    }

    #[test]
    fn completion_needs_its_whole_window_inside_the_trace() {
        let verdict =
            judge("d < 9", "always[0:4](d < 1)").verdict(&trace(&[2.0, 0.0, 0.0, 0.0, 0.0]), true).unwrap();
        assert_eq!(verdict.completion_step, None);
    }

    #[test]
    fn a_safe_condition_over_time_is_refused() {
        let error = Specification::parse("d < 1", "d < 1", "always(d < 1)", "d < 1").unwrap_err();
        assert!(error.to_string().contains("temporal operator"), "{error}");
    }
}
