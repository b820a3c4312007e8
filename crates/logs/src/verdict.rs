//! Verdicts of a formula on the samples of a log: when it is violated, how long, and by which part.

use mishandle_results::{Choice, Key, Remedy};
use mishandle_stl::{
    Clock, DenseMonitor, DenseSignal, Diagnosis, Formula, Monitor, MonitorError, OnlineMonitor,
    SubformulaNode, TimeUnit, Trace, Vacuity, Windows, is_satisfied, is_violated,
};
use mishandle_text::{number_text, visible};

use crate::error::{LogError, Result, content, name_time, resample, state_period, undecided};
use crate::samples::{Samples, Signals};
use crate::unit_name::unit_in;

/// Periods in which bounds of formulas in dense time are whole numbers, s.
const TICKS: [f64; 3] = [1e-9, 1e-6, 1e-3];

/// Questions about a log.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Evaluation {
    /// The unit of bounds without one; `None`: they count samples.
    pub unit: Option<TimeUnit>,
    /// Whether only windows inside the log count, instead of cutting them at its end.
    pub strict_horizon: bool,
}

impl Evaluation {
    fn windows(self) -> Windows {
        if self.strict_horizon { Windows::Whole } else { Windows::Cut }
    }
}

/// The verdict of a formula on a log.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict {
    /// The robustness at the first time.
    pub robustness: f64,
    /// Whether a window is cut at the end of the log.
    pub cuts_windows: bool,
    /// The number of samples; `None` in dense time.
    pub samples: Option<usize>,
    /// The violations of the parts of the formula, in the order of time.
    pub violations: Vec<Interval>,
    /// The part that is violated most, or nearest to it.
    pub part: Option<Part>,
    /// The predicate that determines the robustness; `None` if the value comes from no comparison.
    pub predicate: Option<Predicate>,
}

/// The predicate that determines a robustness.
#[derive(Clone, Debug, PartialEq)]
pub struct Predicate {
    /// The text.
    pub formula: String,
    /// The time at which it has the value; in dense time also the limit there.
    pub at: At,
    /// Values of the two sides.
    pub values: [f64; 2],
    /// Its robustness.
    pub robustness: f64,
}

/// A part of a formula: an operand of its `and`s below its `always`.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// The text.
    pub formula: String,
    /// The least robustness where the formula requires the part.
    pub worst: f64,
    /// Its time.
    pub at: At,
}

/// A time in which a part of the formula is violated.
#[derive(Clone, Debug, PartialEq)]
pub struct Interval {
    /// The text of the part.
    pub formula: String,
    /// The first time.
    pub start: At,
    /// The last time.
    pub end: At,
    /// The least robustness of the part in this time.
    pub worst: f64,
}

/// A time of a log.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct At {
    /// In seconds, as the log counts them; `None` if the log has no times and no period.
    pub secs: Option<f64>,
    /// The sample; `None` in dense time.
    pub sample: Option<usize>,
}

/// The first and last time relative to that of a formula at which it requires a part; `None`
/// without an end.
pub(crate) type Reach = (usize, Option<usize>);

impl Samples {
    /// Returns the verdict of a formula.
    ///
    /// # Errors
    /// If the samples lack a signal, a bound has no unit or is not a whole number of samples, or
    /// the log is too short for `strict_horizon`.
    pub fn verdict(&self, formula: &Formula, evaluation: &Evaluation) -> Result<Verdict> {
        match &self.signals {
            Signals::Even { trace, period, start, has_times } => {
                let clock = clock(formula, *period, *has_times, self.likely_time.as_deref(), evaluation)?;
                let even = Even { trace, clock, period: *period, start: *start, evaluation };
                even.verdict(formula).map_err(|error| match error {
                    LogError::Formula(error @ MonitorError::NotAMultiple { .. }) if *has_times => undecided(
                        [state_period().when("another one fits the times")],
                        format!("{error}; the steps are those of the times, in seconds"),
                    ),
                    error => error,
                })
            }
            Signals::Dense(signals) => dense(signals, formula, evaluation),
        }
    }

    /// Returns why a formula that holds asks nothing of the samples; `None` if it asks something.
    pub(crate) fn vacuity(&self, formula: &Formula, evaluation: &Evaluation) -> Option<Vacuity> {
        let by_first = match &self.signals {
            // A log of one sample is a state, which that sample has to decide.
            Signals::Even { trace, .. } if trace.len() < 2 => return None,
            Signals::Even { trace, .. } => {
                let clock = self.clock(formula, evaluation).ok().flatten()?;
                let formulas = std::slice::from_ref(formula);
                let monitor = OnlineMonitor::new(formulas, trace.names(), clock, None);
                monitor.is_ok_and(|mut monitor| {
                    monitor.push_trace(trace, 0..1).is_ok() && monitor.verdict(0) == Some(true)
                })
            }
            Signals::Dense(_) => formula.is_state_predicate(),
        };
        if by_first {
            return Some(Vacuity::FirstSample);
        }
        let first = |formula: &Formula| {
            let values = self.robustness_signal(formula, evaluation).ok()?;
            values.first().map(|(_, value)| *value)
        };
        if formula.vacuous().is_some_and(|vacuous| first(&vacuous).is_some_and(is_satisfied)) {
            return Some(Vacuity::Premise);
        }
        let parts = formula.demands();
        let asks_nothing =
            |part: &Formula| first(part) == Some(f64::INFINITY) || self.vacuity(part, evaluation).is_some();
        (parts.len() > 1 && parts.iter().all(asks_nothing)).then_some(Vacuity::Parts)
    }

    /// Returns how the bounds of a formula count the samples; `None` in dense time.
    ///
    /// # Errors
    /// If a bound has no unit that the samples can tell.
    pub fn clock(&self, formula: &Formula, evaluation: &Evaluation) -> Result<Option<Clock>> {
        match &self.signals {
            Signals::Even { period, has_times, .. } => {
                clock(formula, *period, *has_times, self.likely_time.as_deref(), evaluation).map(Some)
            }
            Signals::Dense(_) => Ok(None),
        }
    }

    /// Returns even samples, how the bounds of a formula count them, and the time of the first one
    /// in seconds. The bounds may not be whole numbers of samples.
    ///
    /// # Errors
    /// In dense time, or if a bound has no unit that the samples can tell.
    pub fn evenly(&self, formula: &Formula, evaluation: &Evaluation) -> Result<(&Trace, Clock, f64)> {
        match &self.signals {
            Signals::Even { trace, period, start, has_times } => {
                let clock = clock(formula, *period, *has_times, self.likely_time.as_deref(), evaluation)?;
                Ok((trace, clock, *start))
            }
            Signals::Dense(_) => {
                Err(undecided([resample()], "this needs samples, which dense time does not have"))
            }
        }
    }

    /// Returns the robustness at each sample with its time; in dense time at each breakpoint.
    ///
    /// # Errors
    /// As for [`Samples::verdict`].
    pub fn robustness_signal(&self, formula: &Formula, evaluation: &Evaluation) -> Result<Vec<(At, f64)>> {
        match &self.signals {
            Signals::Even { trace, period, start, has_times } => {
                let clock = clock(formula, *period, *has_times, self.likely_time.as_deref(), evaluation)?;
                let even = Even { trace, clock, period: *period, start: *start, evaluation };
                let values = even.signal(formula)?;
                Ok(values.into_iter().enumerate().map(|(sample, value)| (even.at(sample), value)).collect())
            }
            Signals::Dense(signals) => {
                let names: Vec<String> = signals.iter().map(|signal| signal.name().to_owned()).collect();
                let monitor = DenseMonitor::new(formula, &names, evaluation.unit)?;
                let found = if evaluation.strict_horizon {
                    monitor.decided_robustness_signal(signals)?
                } else {
                    monitor.robustness_signal(signals)?
                };
                Ok(found.breakpoints().map(|point| (in_secs(point.time), point.at)).collect())
            }
        }
    }
}

fn in_secs(secs: f64) -> At {
    At { secs: Some(secs), sample: None }
}

fn clock(
    formula: &Formula,
    period: Option<f64>,
    has_times: bool,
    likely_time: Option<&str>,
    evaluation: &Evaluation,
) -> Result<Clock> {
    match (period, evaluation.unit) {
        (Some(period), Some(unit)) => Ok(Clock::rtamt(period, unit)),
        (Some(period), None) => Ok(Clock::steps(period)),
        (None, unit) if formula.needs_period(unit.is_some()) => {
            let needs = "a bound of the formula is a time, which needs the time between two samples";
            let typed = likely_time.filter(|name| visible(name) == *name);
            if has_times {
                return Err(undecided([state_period()], format!("{needs}, but the trace has one sample")));
            }
            let time = typed.map_or_else(name_time, |name| {
                let (unit, key): (_, &'static [&'static str]) = match unit_in(name) {
                    None => (" in seconds", &[]),
                    Some("nanoseconds") => (" in nanoseconds", &["ns"]),
                    Some("microseconds") => (" in microseconds", &["us"]),
                    Some("milliseconds") => (" in milliseconds", &["ms"]),
                    // Times are never in minutes.
                    Some(_) => ("", &[]),
                };
                let unit_key = (!key.is_empty()).then_some((Key::LOG_TIME_UNIT, Choice::OneOf(key)));
                let column = (Key::LOG_TIME, Choice::Text(name.to_owned()));
                Remedy::Set([column].into_iter().chain(unit_key).collect())
                    .when(format!("the column `{name}` has the times{unit}"))
            });
            Err(undecided([state_period(), time], format!("{needs}, but the trace has no column `time`")))
        }
        (None, _) => Ok(Clock::unknown()),
    }
}

/// Returns the positions of the parts of a formula, and when it requires them.
pub(crate) fn parts(nodes: &[SubformulaNode]) -> Vec<(usize, Reach)> {
    let mut open = vec![(0, (0, Some(0)))];
    let mut found = Vec::new();
    while let Some((position, reach)) = open.pop() {
        let (first, last): Reach = reach;
        let node = &nodes[position];
        match (node.operator, node.window) {
            (Some("always"), Some((begin, end))) => {
                let last = last.zip(end).map(|(last, end)| last.saturating_add(end));
                open.push((node.operands[0], (first.saturating_add(begin), last)));
            }
            (Some("and"), _) => open.extend(node.operands.iter().rev().map(|operand| (*operand, reach))),
            _ => found.push((position, reach)),
        }
    }
    found
}

/// Even samples, and how a formula is evaluated on them.
struct Even<'a> {
    trace: &'a Trace,
    clock: Clock,
    period: Option<f64>,
    start: f64,
    evaluation: &'a Evaluation,
}

impl Even<'_> {
    fn at(&self, sample: usize) -> At {
        // `start` of a log with a single time is known without a period.
        let secs = self.period.map(|period| self.start + sample as f64 * period);
        At { secs, sample: Some(sample) }
    }

    /// Returns the robustness at all samples that count, of which there is at least one.
    fn signal(&self, formula: &Formula) -> Result<Vec<f64>> {
        let mut monitor = Monitor::new(formula, self.trace.names(), self.clock)?;
        if !self.evaluation.strict_horizon {
            return Ok(monitor.robustness_signal(self.trace)?.to_vec());
        }
        self.check_needed(&monitor)?;
        let signal = monitor.decided_robustness_signal(self.trace)?;
        check_decided(signal[0])?;
        Ok(signal.to_vec())
    }

    /// Checks that the trace is as long as the windows of a formula.
    fn check_needed(&self, monitor: &Monitor) -> Result<()> {
        let needed = monitor.needed_samples();
        if needed > self.trace.len() {
            return Err(too_short(needed, self.trace.len()));
        }
        Ok(())
    }

    fn diagnosis(&self, formula: &Formula, monitor: &Monitor) -> Result<Diagnosis> {
        if !self.evaluation.strict_horizon {
            return Ok(formula.diagnose(self.trace, &self.clock)?);
        }
        self.check_needed(monitor)?;
        let diagnosis = formula.diagnose_decided(self.trace, &self.clock)?;
        diagnosis.ok_or_else(|| content("the trace does not decide the formula"))
    }

    fn verdict(&self, formula: &Formula) -> Result<Verdict> {
        let monitor = Monitor::new(formula, self.trace.names(), self.clock)?;
        let cuts_windows = !self.evaluation.strict_horizon && monitor.cuts_windows(self.trace.len());
        let diagnosis = self.diagnosis(formula, &monitor)?;
        // Of the formula, not of its parts: beside an empty window, another part can decide.
        if self.evaluation.strict_horizon {
            check_decided(diagnosis.robustness())?;
        }
        let nodes = formula.subformula_nodes(&self.clock)?;
        let texts: Vec<String> = formula.subformulas().collect();
        let mut violations = Vec::new();
        let mut worst = None;
        for (position, (first, last)) in parts(&nodes) {
            let text = &texts[position];
            let Ok(part) = Formula::parse(text) else { continue };
            let found = self.part(&part, first, last)?;
            violations.extend(found.runs.into_iter().map(|run| Interval {
                formula: text.clone(),
                start: self.at(run.first),
                end: self.at(run.last),
                worst: run.worst,
            }));
            if let Some((value, sample)) = found.least
                && worst.as_ref().is_none_or(|known: &Part| value < known.worst)
            {
                worst = Some(Part { formula: text.clone(), worst: value, at: self.at(sample) });
            }
        }
        violations.sort_by_key(|found| found.start.sample);
        let robustness = diagnosis.robustness();
        let predicate = diagnosis.predicate.map(|predicate| Predicate {
            formula: predicate.text,
            at: self.at(predicate.sample),
            values: predicate.values,
            robustness: predicate.robustness,
        });
        let samples = Some(self.trace.len());
        Ok(Verdict { robustness, cuts_windows, samples, violations, part: worst, predicate })
    }

    /// Evaluates a part where the formula requires it and it is decided.
    fn part(&self, part: &Formula, first: usize, last: Option<usize>) -> Result<Runs> {
        let mut monitor = Monitor::new(part, self.trace.names(), self.clock)?;
        let mut found = Runs::default();
        if last == Some(0) {
            found.extend(0, &[self.diagnosis(part, &monitor)?.robustness()]);
            return Ok(found);
        }
        let samples = first..last.map_or(usize::MAX, |last| last.saturating_add(1));
        let visit = |first: usize, values: &[f64]| found.extend(first, values);
        monitor.visit_robustness(self.trace, samples, self.evaluation.windows(), visit)?;
        Ok(found)
    }
}

/// Returns the error for a log that is too short for `strict_horizon`.
pub(crate) fn too_short(needed: usize, samples: usize) -> LogError {
    LogError::TooShort(format!("the formula needs {needed} samples, but the trace has only {samples}"))
}

/// Checks that a value does not come from an empty window.
pub(crate) fn check_decided(robustness: f64) -> Result<()> {
    if !robustness.is_finite() {
        return Err(LogError::TooShort(format!(
            "the robustness at time 0 is {}: it depends on no sample of the trace",
            number_text(robustness)
        )));
    }
    Ok(())
}

/// Violated samples without a gap.
struct Run {
    first: usize,
    last: usize,
    worst: f64,
}

/// The violated samples of a part, and its least value with the first sample that has it.
#[derive(Default)]
struct Runs {
    runs: Vec<Run>,
    least: Option<(f64, usize)>,
}

impl Runs {
    /// Adds the values of the samples from `first` on, which follow the ones before.
    fn extend(&mut self, first: usize, values: &[f64]) {
        for (sample, value) in (first..).zip(values.iter().copied()) {
            if self.least.is_none_or(|(least, _)| value.total_cmp(&least).is_lt()) {
                self.least = Some((value, sample));
            }
            if !is_violated(value) {
                continue;
            }
            match self.runs.last_mut() {
                Some(run) if run.last + 1 == sample => {
                    run.last = sample;
                    run.worst = run.worst.min(value);
                }
                _ => self.runs.push(Run { first: sample, last: sample, worst: value }),
            }
        }
    }
}

fn dense(signals: &[DenseSignal], formula: &Formula, evaluation: &Evaluation) -> Result<Verdict> {
    let names: Vec<String> = signals.iter().map(|signal| signal.name().to_owned()).collect();
    let start = signals.first().map_or(0.0, DenseSignal::start);
    let end = signals.first().map_or(0.0, DenseSignal::end);
    let monitor = DenseMonitor::new(formula, &names, evaluation.unit)?;
    let diagnosis = if evaluation.strict_horizon {
        monitor.diagnose_decided(signals)?.ok_or_else(|| {
            LogError::TooShort(format!(
                "the windows of the formula are longer than the log, which has {} s",
                number_text(end - start)
            ))
        })?
    } else {
        monitor.diagnose(signals)?
    };
    let cuts_windows = !evaluation.strict_horizon && monitor.cuts_windows(signals)?;
    let unit = evaluation.unit.unwrap_or(TimeUnit::Seconds);
    let nodes = TICKS.iter().find_map(|tick| {
        formula.subformula_nodes(&Clock::rtamt(*tick, unit)).ok().map(|nodes| (*tick, nodes))
    });
    let texts: Vec<String> = formula.subformulas().collect();
    let mut violations = Vec::new();
    let mut worst = None;
    let (tick, found) = nodes.map_or((0.0, vec![(0, (0, Some(0)))]), |(tick, nodes)| (tick, parts(&nodes)));
    for (position, (first, last)) in found {
        let Ok(part) = Formula::parse(&texts[position]) else { continue };
        let monitor = DenseMonitor::new(&part, &names, evaluation.unit)?;
        let from = start + first as f64 * tick;
        let to = last.map_or(end, |last| start + last as f64 * tick);
        let values = monitor.robustness_within(signals, from, to, evaluation.windows())?;
        violations.extend(values.violations().into_iter().map(|found| Interval {
            formula: texts[position].clone(),
            start: in_secs(found.start),
            end: in_secs(found.end),
            worst: found.worst,
        }));
        if let Some((time, value)) = values.minimum()
            && worst.as_ref().is_none_or(|known: &Part| value < known.worst)
        {
            worst = Some(Part { formula: texts[position].clone(), worst: value, at: in_secs(time) });
        }
    }
    violations.sort_by(|a, b| a.start.secs.unwrap_or(0.0).total_cmp(&b.start.secs.unwrap_or(0.0)));
    let predicate = diagnosis.predicate.map(|predicate| Predicate {
        formula: predicate.text,
        at: in_secs(predicate.time),
        values: predicate.values,
        robustness: predicate.robustness,
    });
    let robustness = diagnosis.robustness;
    Ok(Verdict { robustness, cuts_windows, samples: None, violations, part: worst, predicate })
}
