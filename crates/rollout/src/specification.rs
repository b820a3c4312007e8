use std::sync::Arc;

use mishandle_stl::{
    Bounds, Clock, Decomposition, Formula, Monitor, MonitorError, OnlineMonitor, Trace, Vacuity,
    is_satisfied, is_violated,
};

use crate::{EpisodeEnd, NamedFormula, Request, RolloutError};

/// The formulas that are evaluated on an episode. Only the requirement is mandatory.
#[derive(Clone, Debug, PartialEq)]
pub struct Specification {
    /// φ: the requirement that a falsification tries to violate.
    pub requirement: Formula,
    /// Success: the task was done.
    pub success: Option<Formula>,
    /// φ′, strict success: the task was done well.
    pub strict: Option<Formula>,
    /// Careful success: the task was done in a manner that an operator of the robot would accept.
    pub careful: Option<Formula>,
    /// δ: a predicate on one sample. The behavior is dangerous where it is violated.
    pub safe: Option<Formula>,
    /// κ: the task is completed where it first holds.
    pub completion: Option<Formula>,
    /// Further requirements with a name, each with a robustness of its own.
    pub others: Vec<(String, Formula)>,
}

impl Specification {
    /// Makes a specification with a requirement only.
    pub fn new(requirement: Formula) -> Specification {
        Specification {
            requirement,
            success: None,
            strict: None,
            careful: None,
            safe: None,
            completion: None,
            others: Vec::new(),
        }
    }

    /// Parses the four formulas of a task. The requirement is `success`.
    ///
    /// # Errors
    /// If a formula does not parse, or `safe` contains a temporal operator.
    pub fn parse(success: &str, strict: &str, safe: &str, completion: &str) -> Result<Self, RolloutError> {
        let named = |(name, text): (&str, &str)| NamedFormula { name: name.into(), text: text.into() };
        let texts = [("success", success), ("strict", strict), ("safe", safe), ("completion", completion)];
        Specification::from_formulas(&texts.map(named), parse(success)?)
    }

    /// Makes a specification from a requirement and the formulas with the role names `success`,
    /// `strict`, `careful`, `safe` and `completion`. Other formulas are ignored.
    ///
    /// # Errors
    /// If a formula does not parse, or `safe` contains a temporal operator.
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
            careful: role("careful")?,
            safe,
            completion: role("completion")?,
            others: Vec::new(),
        })
    }

    /// Returns the parts of which the robustness of the requirement is made on episodes of
    /// `samples` samples, one every `control_dt` seconds.
    ///
    /// # Errors
    /// If the requirement contains an interval bound that is not a multiple of the control step.
    pub fn decomposition(&self, control_dt: f64, samples: usize) -> Result<Decomposition, RolloutError> {
        decomposition(&self.requirement, Clock::steps(control_dt), samples)
    }

    /// Returns whether a formula reads a signal with one of these names.
    pub fn reads_any(&self, names: &[&str]) -> bool {
        let Specification { requirement, success, strict, careful, safe, completion, others } = self;
        let roles = [success, strict, careful, safe, completion];
        let formulas = roles.into_iter().flatten().chain(others.iter().map(|(_, formula)| formula));
        std::iter::once(requirement)
            .chain(formulas)
            .any(|formula| formula.signals().iter().any(|name| names.contains(name)))
    }
}

/// The most parts of a robustness. A search has a model of each.
const MOST_PARTS: usize = 8;

fn decomposition(formula: &Formula, clock: Clock, samples: usize) -> Result<Decomposition, RolloutError> {
    let error = |source| RolloutError::Monitor { formula: formula.to_string(), source };
    formula.decompose(&clock, samples, MOST_PARTS).map_err(error)
}

fn parse(text: &str) -> Result<Formula, RolloutError> {
    Formula::parse(text).map_err(|source| RolloutError::Parse { formula: text.to_string(), source })
}

/// Values of the formulas on one episode. A value is `None` if the formula does not exist or the
/// trace does not decide it: a window is cut at the end of the trace or contains no sample.
/// [`Monitor::decided_robustness_signal`] states the rule. If the episode ended early but no
/// continuation could change the sign of a robustness, the value is the bound closer to 0.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Verdict {
    /// Robustness of the requirement at time 0.
    pub robustness: Option<f64>,
    /// Robustness of success at time 0.
    pub success: Option<f64>,
    /// Robustness of strict success at time 0.
    pub strict: Option<f64>,
    /// Robustness of careful success at time 0.
    pub careful: Option<f64>,
    /// Number of samples, except the first, at which the safe condition is violated.
    pub dangerous_steps: Option<usize>,
    /// Number of control steps until completion first holds with its whole window inside the trace.
    pub completion_step: Option<usize>,
    /// Parts of the robustness, in the order of [`Specification::decomposition`]. Empty unless
    /// [requested](crate::Request::needs_parts), and if the trace does not decide them.
    pub parts: Vec<f64>,
    /// Robustness at time 0 of each of the [other requirements](Specification::others).
    pub others: Vec<Option<f64>>,
    /// Why the requirement holds and asks nothing of the episode; `None` if it is violated, has no
    /// verdict, or asks something.
    pub vacuity: Option<Vacuity>,
    /// The same of each of the other requirements.
    pub other_vacuities: Vec<Option<Vacuity>>,
}

impl Verdict {
    /// Returns whether success is satisfied.
    pub fn is_success(&self) -> bool {
        self.success.is_some_and(is_satisfied)
    }

    /// Returns whether success and strict success are satisfied.
    pub fn is_strict_success(&self) -> bool {
        self.is_success() && self.strict.is_some_and(is_satisfied)
    }

    /// Returns whether success and careful success are satisfied.
    pub fn is_careful_success(&self) -> bool {
        self.is_success() && self.careful.is_some_and(is_satisfied)
    }

    /// Returns whether the safe condition is violated at some sample.
    pub fn is_dangerous(&self) -> bool {
        self.dangerous_steps > Some(0)
    }
}

/// A [`Specification`] compiled for one list of signals. It owns its buffers, so that evaluation
/// does not allocate.
#[derive(Debug)]
pub struct SpecificationMonitor {
    requirement: RequirementMonitor,
    success: Option<FormulaMonitor>,
    strict: Option<FormulaMonitor>,
    careful: Option<FormulaMonitor>,
    safe: Option<FormulaMonitor>,
    completion: Option<FormulaMonitor>,
    others: Vec<RequirementMonitor>,
    formula: Formula,
    clock: Clock,
    /// The parts of the requirement for episodes of this many samples.
    parts: Option<(usize, Decomposition)>,
}

#[derive(Debug)]
struct FormulaMonitor {
    text: String,
    monitor: Monitor,
    /// For the start of an episode.
    online: OnlineMonitor,
}

impl FormulaMonitor {
    fn new(formula: &Formula, signals: &[String], clock: Clock) -> Result<FormulaMonitor, RolloutError> {
        let compile = || {
            let online = OnlineMonitor::new(std::slice::from_ref(formula), signals, clock, None)?;
            Ok((Monitor::new(formula, signals, clock)?, online))
        };
        let text = formula.to_string();
        match compile() {
            Ok((monitor, online)) => Ok(FormulaMonitor { text, monitor, online }),
            Err(source) => Err(RolloutError::Monitor { formula: text, source }),
        }
    }

    fn error(&self, source: MonitorError) -> RolloutError {
        RolloutError::Monitor { formula: self.text.clone(), source }
    }

    /// Returns the robustness at the samples at which the trace decides the formula, without a cut
    /// window.
    ///
    /// A formula with an unbounded window is undecided before the end of the episode.
    fn decided(&mut self, trace: &Trace, is_complete: bool) -> Result<&[f64], RolloutError> {
        if self.monitor.horizon().is_none() && !is_complete {
            return Ok(&[]);
        }
        self.monitor
            .decided_robustness_signal(trace)
            .map_err(|source| RolloutError::Monitor { formula: self.text.clone(), source })
    }

    /// Returns the robustness at time 0 if the trace decides the formula. If the trace is the start
    /// of an episode and no continuation can change the sign, returns the bound of the robustness
    /// that is closer to 0.
    fn at_start(&mut self, trace: &Trace, samples: usize) -> Result<Option<f64>, RolloutError> {
        let is_complete = trace.len() >= samples;
        let found = if is_complete || self.monitor.horizon().is_some_and(|horizon| trace.len() > horizon) {
            self.monitor.decided_robustness(trace).map_err(|source| self.error(source))?
        } else {
            self.online.reset();
            self.online.state_samples(Some(samples));
            self.online.push_trace(trace, 0..trace.len()).map_err(|source| self.error(source))?;
            match self.online.bounds(0) {
                Bounds { high, .. } if is_violated(high) => Some(high),
                Bounds { low, .. } if is_satisfied(low) => Some(low),
                _ => None,
            }
        };
        // An empty window has an infinite value: the formula depends on no sample of the trace.
        Ok(found.filter(|rho| rho.is_finite()))
    }

    /// Returns whether the first sample alone satisfies the formula, whatever follows.
    fn is_satisfied_by_first(&mut self, trace: &Trace, samples: usize) -> bool {
        self.online.reset();
        self.online.state_samples(Some(samples));
        self.online.push_trace(trace, 0..1).is_ok() && is_satisfied(self.online.bounds(0).low)
    }
}

/// A requirement, and where it asks nothing.
#[derive(Debug)]
struct RequirementMonitor {
    monitor: FormulaMonitor,
    vacuous: Option<FormulaMonitor>,
    /// The operands of its `and`; empty without one.
    parts: Vec<RequirementMonitor>,
}

impl RequirementMonitor {
    fn new(formula: &Formula, signals: &[String], clock: Clock) -> Result<RequirementMonitor, RolloutError> {
        let vacuous = formula.vacuous().and_then(|found| FormulaMonitor::new(&found, signals, clock).ok());
        let mut parts = formula.demands();
        if parts.len() < 2 {
            parts.clear();
        }
        let parts = parts.iter().map(|part| RequirementMonitor::new(part, signals, clock));
        let monitor = FormulaMonitor::new(formula, signals, clock)?;
        Ok(RequirementMonitor { monitor, vacuous, parts: parts.collect::<Result<_, _>>()? })
    }

    /// Returns the robustness at time 0, and why the requirement holds and asks nothing.
    fn at_start(
        &mut self,
        trace: &Trace,
        samples: usize,
    ) -> Result<(Option<f64>, Option<Vacuity>), RolloutError> {
        let robustness = self.monitor.at_start(trace, samples)?;
        let vacuity = match robustness {
            // A trace of one sample is a state, which the first sample alone has to decide.
            Some(rho) if is_satisfied(rho) && trace.len() > 1 => {
                let holds = |found: &mut FormulaMonitor, trace: &Trace| {
                    found.at_start(trace, samples).is_ok_and(|rho| rho.is_some_and(is_satisfied))
                };
                if self.monitor.is_satisfied_by_first(trace, samples) {
                    Some(Vacuity::FirstSample)
                } else if self.vacuous.as_mut().is_some_and(|found| holds(found, trace)) {
                    Some(Vacuity::Premise)
                } else {
                    // A part without a value is outside of the trace.
                    let asks = |part: &mut RequirementMonitor| {
                        !matches!(part.at_start(trace, samples), Ok((None, _) | (_, Some(_))))
                    };
                    let is_empty = self.parts.is_empty() || self.parts.iter_mut().any(asks);
                    (!is_empty).then_some(Vacuity::Parts)
                }
            }
            _ => None,
        };
        Ok((robustness, vacuity))
    }
}

impl SpecificationMonitor {
    /// Compiles `specification` for traces of these signals with a sample every `control_dt`
    /// seconds.
    ///
    /// # Errors
    /// If a formula reads no signal, or contains an unknown signal or an interval bound that is not
    /// a multiple of the control step.
    pub fn new(
        specification: &Specification,
        signals: &Arc<[String]>,
        control_dt: f64,
    ) -> Result<SpecificationMonitor, RolloutError> {
        let clock = Clock::steps(control_dt);
        let monitor = |formula: &Formula| FormulaMonitor::new(formula, signals, clock);
        let optional = |formula: &Option<Formula>| formula.as_ref().map(monitor).transpose();
        let of_episodes = |formula: &Formula| RequirementMonitor::new(formula, signals, clock);
        Ok(SpecificationMonitor {
            requirement: of_episodes(&specification.requirement)?,
            success: optional(&specification.success)?,
            strict: optional(&specification.strict)?,
            careful: optional(&specification.careful)?,
            safe: optional(&specification.safe)?,
            completion: optional(&specification.completion)?,
            others: specification
                .others
                .iter()
                .map(|(_, formula)| of_episodes(formula))
                .collect::<Result<_, _>>()?,
            formula: specification.requirement.clone(),
            clock,
            parts: None,
        })
    }

    /// Returns the parts of the robustness on `trace`, in the order of
    /// [`Specification::decomposition`] for episodes of `samples` samples.
    ///
    /// The list is empty if the trace does not decide the requirement or a sub-formula has no
    /// finite value at some sample. The latter is not an error, because the requirement may not
    /// depend on that sample.
    ///
    /// # Errors
    /// If a signal of the requirement contains NaN or an infinity.
    pub fn parts(&mut self, trace: &Trace, samples: usize) -> Result<Vec<f64>, RolloutError> {
        let (length, parts) = match self.parts.take() {
            Some(known) if known.0 == samples => known,
            _ => (samples, decomposition(&self.formula, self.clock, samples)?),
        };
        let found = self.requirement.monitor.monitor.parts(trace, &parts);
        self.parts = Some((length, parts));
        match found {
            Ok(parts) => Ok(parts.unwrap_or_default()),
            Err(MonitorError::Undefined { .. }) => Ok(Vec::new()),
            Err(source) => Err(self.requirement.monitor.error(source)),
        }
    }

    /// Returns the verdict of an episode that has ended, with the parts of the robustness if the
    /// request needs them. `trace` is the whole episode or the start of one with `samples` samples.
    /// The end may become [`EpisodeEnd::Undefined`]; then only the other requirements have values.
    ///
    /// # Errors
    /// If a signal of a formula contains NaN or an infinity.
    pub fn judge(
        &mut self,
        request: &Request,
        trace: &Trace,
        samples: usize,
        end: &mut EpisodeEnd,
    ) -> Result<Verdict, RolloutError> {
        if !end.has_verdict() {
            return Ok(Verdict::default());
        }
        let mut verdict = match self.verdict(trace, samples) {
            Err(RolloutError::Monitor { source: MonitorError::Undefined { step, .. }, .. }) => {
                *end = EpisodeEnd::Undefined { step };
                let (others, other_vacuities) = self.others(trace, samples)?;
                return Ok(Verdict { others, other_vacuities, ..Verdict::default() });
            }
            verdict => verdict?,
        };
        if request.needs_parts && verdict.robustness.is_some() {
            verdict.parts = self.parts(trace, samples)?;
        }
        Ok(verdict)
    }

    /// Returns the values of the formulas on `trace`, which is a whole episode or the start of one
    /// with `samples` samples.
    ///
    /// On the start of an episode, a robustness that every continuation has with the same sign is a
    /// bound: the upper bound if it is negative, the lower bound if it is positive.
    /// [`OnlineMonitor::bounds`] computes it.
    ///
    /// # Errors
    /// If a signal of a formula contains NaN or an infinity, or a formula has no finite value that
    /// is not one of the other requirements.
    pub fn verdict(&mut self, trace: &Trace, samples: usize) -> Result<Verdict, RolloutError> {
        let is_complete = trace.len() >= samples;
        let at_start = |monitor: &mut Option<FormulaMonitor>| match monitor {
            Some(monitor) => monitor.at_start(trace, samples),
            None => Ok(None),
        };
        let success = at_start(&mut self.success)?;
        let strict = at_start(&mut self.strict)?;
        let careful = at_start(&mut self.careful)?;
        let dangerous_steps = match &mut self.safe {
            Some(safe) => Some(
                safe.decided(trace, is_complete)?.iter().skip(1).filter(|rho| is_violated(**rho)).count(),
            ),
            None => None,
        };
        let completion_step = match &mut self.completion {
            Some(completion) => {
                completion.decided(trace, is_complete)?.iter().position(|rho| is_satisfied(*rho))
            }
            None => None,
        };
        let (robustness, vacuity) = self.requirement.at_start(trace, samples)?;
        let (others, other_vacuities) = self.others(trace, samples)?;
        Ok(Verdict {
            robustness,
            success,
            strict,
            careful,
            dangerous_steps,
            completion_step,
            parts: Vec::new(),
            others,
            vacuity,
            other_vacuities,
        })
    }

    /// Returns the robustness of each other requirement, and why it asks nothing. Where one is
    /// undefined, only its own value is missing.
    #[expect(clippy::type_complexity, reason = "the two lists of a verdict")]
    fn others(
        &mut self,
        trace: &Trace,
        samples: usize,
    ) -> Result<(Vec<Option<f64>>, Vec<Option<Vacuity>>), RolloutError> {
        let value = |monitor: &mut RequirementMonitor| match monitor.at_start(trace, samples) {
            Err(RolloutError::Monitor { source: MonitorError::Undefined { .. }, .. }) => Ok((None, None)),
            found => found,
        };
        self.others.iter_mut().map(value).collect()
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

    fn monitor(success: &str, completion: &str) -> SpecificationMonitor {
        let specification =
            Specification::parse(success, "eventually[0:3](d <= 1)", "d < 3", completion).unwrap();
        SpecificationMonitor::new(&specification, &Arc::from(["d".to_string()]), 1.0 / 60.0).unwrap()
    }

    #[test]
    fn a_verdict_matches_a_hand_calculation() {
        // d = 5 4 2 1 1: success needs d <= 2.5 at samples 2 to 4, the worst of 0.5 1.5 1.5;
        // unsafe after sample 0: only the 4; complete once d <= 2 for two samples: from sample 2.
        let verdict = monitor("always[2:4](d <= 2.5)", "always[0:1](d < 2.5)")
            .verdict(&trace(&[5.0, 4.0, 2.0, 1.0, 1.0]), 5)
            .unwrap();
        assert_eq!(verdict.success, Some(0.5));
        assert_eq!(verdict.robustness, Some(0.5));
        assert_eq!(verdict.strict, Some(0.0));
        assert_eq!(verdict.dangerous_steps, Some(1));
        assert_eq!(verdict.completion_step, Some(2));
    }

    #[test]
    fn values_without_a_formula_are_none() {
        let specification = Specification::new(parse("always[0:2](d <= 2.5)").unwrap());
        let mut monitor =
            SpecificationMonitor::new(&specification, &Arc::from(["d".to_string()]), 1.0 / 60.0).unwrap();
        let verdict = monitor.verdict(&trace(&[1.0, 4.0, 2.0]), 3).unwrap();
        assert_eq!(verdict, Verdict { robustness: Some(-1.5), ..Verdict::default() });
    }

    #[test]
    fn a_careful_success_counts_with_success_only() {
        let named = |(name, text): (&str, &str)| NamedFormula { name: name.into(), text: text.into() };
        let formulas = [("success", "always(d <= 2)"), ("careful", "eventually(d <= 1)")].map(named);
        let specification = Specification::from_formulas(&formulas, parse("d >= 0").unwrap()).unwrap();
        let signals: Arc<[String]> = Arc::from(["d".to_string()]);
        let mut monitor = SpecificationMonitor::new(&specification, &signals, 1.0 / 60.0).unwrap();
        // The least value is 0.5 in both; the largest is 1.5 and 2.5.
        for (values, success) in [([1.5, 0.5], true), ([2.5, 0.5], false)] {
            let verdict = monitor.verdict(&trace(&values), 2).unwrap();
            assert_eq!((verdict.careful, verdict.strict), (Some(0.5), None));
            assert_eq!((verdict.is_success(), verdict.is_careful_success()), (success, success));
        }
    }

    #[test]
    fn a_specification_knows_which_signals_it_reads() {
        let mut specification = Specification::new(parse("always(a <= 1 and b >= 0)").unwrap());
        assert!(specification.reads_any(&["x", "b"]) && !specification.reads_any(&["c", "d"]));
        specification.careful = Some(parse("c <= 1").unwrap());
        specification.others.push(("named".to_string(), parse("d <= 1").unwrap()));
        assert!(specification.reads_any(&["c"]) && specification.reads_any(&["d"]));
        assert!(!specification.reads_any(&[]));
    }

    #[test]
    fn the_parts_of_a_verdict_are_those_of_the_decomposition() {
        let specification = Specification::new(parse("always[0:2](d <= 2.5 and d >= 1)").unwrap());
        let signals: Arc<[String]> = Arc::from(["d".to_string()]);
        let mut monitor = SpecificationMonitor::new(&specification, &signals, 1.0 / 60.0).unwrap();
        // One part for each conjunct and sample.
        assert_eq!(specification.decomposition(1.0 / 60.0, 3).unwrap().ends().len(), 6);
        let parts = monitor.parts(&trace(&[1.5, 2.0, 1.25]), 3).unwrap();
        assert_eq!(parts, [1.0, 0.5, 1.25, 0.5, 1.0, 0.25]);
        assert!(monitor.parts(&trace(&[1.5, 2.0]), 3).unwrap().is_empty());
    }

    #[test]
    fn a_verdict_has_parts_only_if_they_are_requested() {
        let specification = Specification::new(parse("always[0:1](d <= 2.5)").unwrap());
        let signals: Arc<[String]> = Arc::from(["d".to_string()]);
        let mut monitor = SpecificationMonitor::new(&specification, &signals, 1.0 / 60.0).unwrap();
        let plain = Request::new([0.0], crate::Seed(0));
        let mut parts = |request: &Request| {
            let mut end = EpisodeEnd::Completed;
            monitor.judge(request, &trace(&[1.5, 2.0]), 2, &mut end).unwrap().parts
        };
        assert!(parts(&plain).is_empty());
        assert_eq!(parts(&Request { needs_parts: true, ..plain }), [1.0, 0.5]);
    }

    #[test]
    fn an_undefined_formula_takes_no_verdict_from_the_other_requirements() {
        // The square root of -1 does not exist; 1 and -0.5 are the distances of d = 1 to 0 and 1.5.
        let defined = ["d >= 0", "d >= 1.5"];
        let undefined = "sqrt(d - 2) <= 1";
        let signals: Arc<[String]> = Arc::from(["d".to_string()]);
        for (requirement, robustness, expected_end) in [
            ("d <= 3", Some(2.0), EpisodeEnd::Completed),
            (undefined, None, EpisodeEnd::Undefined { step: 0 }),
        ] {
            let others = [defined[0], undefined, defined[1]];
            let others = others.map(|text| (text.to_string(), parse(text).unwrap()));
            let specification =
                Specification { others: others.to_vec(), ..Specification::new(parse(requirement).unwrap()) };
            let mut monitor = SpecificationMonitor::new(&specification, &signals, 1.0 / 60.0).unwrap();
            let mut end = EpisodeEnd::Completed;
            let request = Request::new([0.0], crate::Seed(0));
            let verdict = monitor.judge(&request, &trace(&[1.0]), 1, &mut end).unwrap();
            assert_eq!(verdict.others, [Some(1.0), None, Some(-0.5)]);
            assert_eq!((verdict.robustness, end), (robustness, expected_end));
        }
    }

    #[test]
    fn a_formula_longer_than_the_trace_is_undecided() {
        let verdict = monitor("always[2:9](d <= 2.5)", "d < 0").verdict(&trace(&[1.0, 1.0, 1.0]), 3).unwrap();
        assert_eq!(verdict.success, None);
        assert_eq!(verdict.strict, None);
        assert_eq!(verdict.completion_step, None);
    }

    #[test]
    fn an_unbounded_formula_is_undecided_before_the_end_of_the_episode() {
        let mut monitor = monitor("always(d <= 2.5)", "d < 0");
        assert_eq!(monitor.verdict(&trace(&[1.0, 1.0]), 2).unwrap().success, Some(1.5));
        assert_eq!(monitor.verdict(&trace(&[1.0, 1.0]), 5).unwrap().success, None);
    }

    #[test]
    fn a_window_cut_under_an_unbounded_operator_neither_satisfies_nor_violates_a_formula() {
        let robustness = |formula: &str, values: &[f64]| {
            monitor(formula, "d < 0").verdict(&trace(values), values.len()).unwrap().robustness
        };
        // d >= 4 holds at the last sample only: never for three samples. The best three are 0 1 0.
        assert_eq!(robustness("eventually(always[0:2](d >= 4))", &[0.0, 1.0, 0.0, 5.0]), Some(-4.0));
        // Every whole window of three samples contains a 5 or a 7; the cut window of the last
        // sample only 0.
        assert_eq!(robustness("always(eventually[0:2](d >= 4))", &[5.0, 5.0, 7.0, 0.0]), Some(3.0));
        // No window of three samples is inside a trace of two.
        assert_eq!(robustness("eventually(always[0:2](d >= 4))", &[5.0, 5.0]), None);
        assert_eq!(robustness("always(eventually[0:2](d >= 4))", &[0.0, 0.0]), None);
    }

    #[test]
    fn a_formula_with_an_empty_window_is_undecided() {
        for formula in ["eventually[9:inf](d <= 2.5)", "always[9:inf](d <= 2.5)", "once[1:2](d <= 2.5)"] {
            let verdict = monitor(formula, "d < 0").verdict(&trace(&[1.0, 1.0]), 2).unwrap();
            assert_eq!(verdict.success, None, "{formula}");
        }
    }

    #[test]
    fn completion_requires_its_whole_window_inside_the_trace() {
        let verdict =
            monitor("d < 9", "always[0:4](d < 1)").verdict(&trace(&[2.0, 0.0, 0.0, 0.0, 0.0]), 5).unwrap();
        assert_eq!(verdict.completion_step, None);
    }

    #[test]
    fn the_start_of_an_episode_has_a_verdict_that_no_continuation_can_change() {
        // An episode of 10 samples that ended after three, with d = 1 4 2.
        let robustness = |formula: &str| {
            monitor(formula, "d < 0").verdict(&trace(&[1.0, 4.0, 2.0]), 10).unwrap().robustness
        };
        for (formula, expected) in [
            // The 4 violates `d <= 2.5` by 1.5; later samples can only make it worse.
            ("always[0:9](d <= 2.5)", Some(-1.5)),
            ("always(d <= 2.5)", Some(-1.5)),
            ("not always[0:9](d <= 2.5)", Some(1.5)),
            ("eventually[0:9](d >= 3)", Some(1.0)),
            ("always[0:9](d <= 5)", None),
            ("eventually[0:9](d >= 5)", None),
            // A premise that held and a conclusion that failed at sample 1.
            ("always[0:9](d >= 3 implies d >= 6)", Some(-1.0)),
            // d >= 3 at sample 1, with d >= 0.5 before it: min(1, 0.5).
            ("(d >= 0.5) until[0:9] (d >= 3)", Some(0.5)),
            // `d <= 3` fails at sample 1 before `d >= 6` held: max over min(...) is -1 at most.
            ("(d <= 3) until[0:9] (d >= 6)", Some(-1.0)),
            ("(d <= 3) until[0:9] (d >= 7)", Some(-1.0)),
            // The horizon of both operands is beyond the trace, but the violation is at sample 1.
            ("always[0:6](eventually[0:3](d >= 5) or d <= 3)", None),
            // The episode has 10 samples, so the formula reaches past its end.
            ("always[0:10](d <= 2.5)", None),
        ] {
            assert_eq!(robustness(formula), expected, "{formula}");
        }
    }

    #[test]
    fn a_safe_condition_with_a_temporal_operator_is_an_error() {
        let error = Specification::parse("d < 1", "d < 1", "always(d < 1)", "d < 1").unwrap_err();
        assert!(error.to_string().contains("temporal operator"), "{error}");
    }
}
