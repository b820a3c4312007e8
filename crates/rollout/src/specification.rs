use std::sync::Arc;

use mishandle_stl::{Clock, Formula, Monitor, MonitorError, SubformulaMinimum, Trace};

use crate::{NamedFormula, RolloutError};

/// The formulas an episode is judged by, over the signals of its trace. All but the requirement are optional.
#[derive(Clone, Debug, PartialEq)]
pub struct Specification {
    /// φ: what a falsification tries to violate.
    pub requirement: Formula,
    /// Whether the task was done.
    pub success: Option<Formula>,
    /// φ′: whether it was done well.
    pub strict: Option<Formula>,
    /// δ: a predicate on one sample; where it is violated, the behavior is dangerous.
    pub safe: Option<Formula>,
    /// κ: holds from the moment the task is completed.
    pub completion: Option<Formula>,
}

impl Specification {
    /// A requirement and nothing else.
    pub fn new(requirement: Formula) -> Specification {
        Specification { requirement, success: None, strict: None, safe: None, completion: None }
    }

    /// Parses the four formulas of a task; the requirement is `success`.
    ///
    /// # Errors
    /// If one does not parse, or `safe` has a temporal operator.
    pub fn parse(success: &str, strict: &str, safe: &str, completion: &str) -> Result<Self, RolloutError> {
        let named = |(name, text): (&str, &str)| NamedFormula { name: name.into(), text: text.into() };
        let texts = [("success", success), ("strict", strict), ("safe", safe), ("completion", completion)];
        Specification::from_formulas(&texts.map(named), parse(success)?)
    }

    /// A requirement with those of `formulas` that have a role.
    ///
    /// # Errors
    /// If one does not parse, or `safe` has a temporal operator.
    pub fn from_formulas(formulas: &[NamedFormula], requirement: Formula) -> Result<Self, RolloutError> {
        let role = |name: &str| {
            formulas
                .iter()
                .find(|formula| formula.name == name)
                .map(|formula| parse(&formula.text))
                .transpose()
        };
        let safe = role("safe")?;
        if let Some(safe) = safe.as_ref().filter(|safe| !safe.is_state_predicate()) {
            return Err(RolloutError::NotAPredicate { formula: safe.to_string() });
        }
        Ok(Specification {
            requirement,
            success: role("success")?,
            strict: role("strict")?,
            safe,
            completion: role("completion")?,
        })
    }
}

fn parse(text: &str) -> Result<Formula, RolloutError> {
    Formula::parse(text).map_err(|source| RolloutError::Parse { formula: text.to_string(), source })
}

/// What the formulas say of one episode. `None` where there is no such formula, or the trace does not cover it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Verdict {
    /// Robustness of the requirement at time 0.
    pub robustness: Option<f64>,
    /// Robustness of success at time 0.
    pub success: Option<f64>,
    /// Robustness of strict success at time 0.
    pub strict: Option<f64>,
    /// Samples after the first at which the safe condition is violated.
    pub dangerous_steps: Option<usize>,
    /// Control steps until completion first holds, its whole window inside the trace.
    pub completion_step: Option<usize>,
    /// The least robustness of each sub-formula of the requirement and its first sample, in the order of
    /// [`Formula::subformulas`]. Empty unless [asked for](crate::Request::wants_subformulas), and where the arithmetic of
    /// one has no finite value somewhere on the trace.
    pub subformulas: Vec<SubformulaMinimum>,
}

/// A [`Specification`] compiled for one list of signals; owns its scratch, so that judging allocates nothing.
#[derive(Debug)]
pub struct SpecificationMonitor {
    requirement: Rule,
    success: Option<Rule>,
    strict: Option<Rule>,
    safe: Option<Rule>,
    completion: Option<Rule>,
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

impl SpecificationMonitor {
    /// Compiles `specification` for traces with these signals, sampled every `control_dt` seconds.
    ///
    /// # Errors
    /// If a formula names an unknown signal, or an interval that is not a whole number of control steps.
    pub fn new(
        specification: &Specification,
        signals: &Arc<[String]>,
        control_dt: f64,
    ) -> Result<SpecificationMonitor, RolloutError> {
        let rule = |formula: &Formula| Rule::new(formula, signals, Clock::steps(control_dt));
        let optional = |formula: &Option<Formula>| formula.as_ref().map(rule).transpose();
        Ok(SpecificationMonitor {
            requirement: rule(&specification.requirement)?,
            success: optional(&specification.success)?,
            strict: optional(&specification.strict)?,
            safe: optional(&specification.safe)?,
            completion: optional(&specification.completion)?,
        })
    }

    /// The least robustness of each sub-formula of the requirement on `trace`; none where one has no finite value
    /// somewhere, since that may be at a sample that the requirement never looks at.
    ///
    /// # Errors
    /// As [`verdict`](Self::verdict).
    pub fn subformulas(&mut self, trace: &Trace) -> Result<Vec<SubformulaMinimum>, RolloutError> {
        match self.requirement.monitor.subformula_minima(trace) {
            Ok(minima) => Ok(minima.to_vec()),
            Err(MonitorError::Undefined { .. }) => Ok(Vec::new()),
            Err(source) => Err(RolloutError::Monitor { formula: self.requirement.text.clone(), source }),
        }
    }

    /// The verdict on `trace`, which holds the `whole` episode or its begin.
    ///
    /// # Errors
    /// If a signal that a formula names holds NaN or an infinity.
    pub fn verdict(&mut self, trace: &Trace, whole: bool) -> Result<Verdict, RolloutError> {
        let at_start = |rule: &mut Option<Rule>| match rule {
            Some(rule) => rule.at_start(trace, whole),
            None => Ok(None),
        };
        let (success, strict) = (at_start(&mut self.success)?, at_start(&mut self.strict)?);
        let dangerous_steps = match &mut self.safe {
            Some(safe) => Some(safe.signal(trace)?.iter().skip(1).filter(|rho| **rho < 0.0).count()),
            None => None,
        };
        let completion_step = match &mut self.completion {
            Some(completion) => {
                let covered = completion.covered(trace.len(), whole);
                completion.signal(trace)?[..covered].iter().position(|rho| *rho > 0.0)
            }
            None => None,
        };
        let robustness = self.requirement.at_start(trace, whole)?;
        Ok(Verdict { robustness, success, strict, dangerous_steps, completion_step, subformulas: Vec::new() })
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

    fn judge(success: &str, completion: &str) -> SpecificationMonitor {
        let specification =
            Specification::parse(success, "eventually[0:3](d <= 1)", "d < 3", completion).unwrap();
        SpecificationMonitor::new(&specification, &Arc::from(["d".to_string()]), 1.0 / 60.0).unwrap()
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
        assert_eq!(verdict.dangerous_steps, Some(1));
        assert_eq!(verdict.completion_step, Some(2));
    }

    #[test]
    fn a_requirement_alone_leaves_out_what_no_formula_says() {
        let specification = Specification::new(parse("always[0:2](d <= 2.5)").unwrap());
        let mut judge =
            SpecificationMonitor::new(&specification, &Arc::from(["d".to_string()]), 1.0 / 60.0).unwrap();
        let verdict = judge.verdict(&trace(&[1.0, 4.0, 2.0]), true).unwrap();
        assert_eq!(verdict, Verdict { robustness: Some(-1.5), ..Verdict::default() });
    }

    #[test]
    fn the_minima_of_sub_formulas_come_with_their_samples() {
        let specification = Specification::new(parse("always[0:2](d <= 2.5 and d >= 1)").unwrap());
        let mut judge =
            SpecificationMonitor::new(&specification, &Arc::from(["d".to_string()]), 1.0 / 60.0).unwrap();
        let minima = judge.subformulas(&trace(&[1.5, 2.0, 1.25])).unwrap();
        let found: Vec<(f64, usize)> = minima.iter().map(|least| (least.minimum, least.step)).collect();
        // The whole, the conjunction, and its operands: 2.5 - 2.0 at sample 1, 1.25 - 1 at sample 2.
        assert_eq!(found, [(0.25, 0), (0.25, 2), (0.5, 1), (0.25, 2)]);
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
