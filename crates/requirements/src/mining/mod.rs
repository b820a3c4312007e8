//! The tightest values of the parameters of a formula for which traces satisfy it.

mod axis;
mod direction;

use mishandle_results::{
    Choice, FormulaTrap, Key, MinedPoint, MinedTrace, Mining, MiningOutcome, Number, Remedy,
};
use mishandle_stl::{Clock, Formula, Monitor, Parameter, ParseError, TimeUnit, Trace, is_satisfied, spelled};

use crate::error::{RequirementError, Result};
use crate::traps::start_traps;
use crate::tree::Tree;
use axis::{Axis, first};

/// Largest number of parameters.
const MAX_PARAMETERS: usize = 4;

/// Largest number of points of a front.
pub const MAX_POINTS: usize = 200;

/// A parameter and the range of its values.
#[derive(Clone, Debug, PartialEq)]
pub struct ParameterRange {
    /// Name, as the formula reads it.
    pub name: String,
    /// Least value.
    pub low: f64,
    /// Greatest value.
    pub high: f64,
    /// Unit of a bound of a window.
    pub unit: Option<TimeUnit>,
    /// Step of the values; `None`: the next number, or the sampling period for a bound.
    pub resolution: Option<f64>,
}

/// A trace with a name.
#[derive(Clone, Debug)]
pub struct NamedTrace {
    /// Name.
    pub name: String,
    /// Samples.
    pub trace: Trace,
    /// How bounds count them.
    pub clock: Clock,
    /// The time of the first sample in seconds.
    pub start: f64,
}

/// A formula with parameters to mine.
#[derive(Clone, Debug)]
pub struct MiningQuestion<'a> {
    /// Text of the formula, which reads the parameters like constants.
    pub formula: &'a str,
    /// The parameters.
    pub parameters: &'a [ParameterRange],
    /// Share of the traces that must satisfy the formula, above 0 and at most 1.
    pub share: f64,
    /// Number of points of the Pareto front of several parameters.
    pub points: usize,
    /// Unit of bounds without one; `None`: they count samples.
    pub unit: Option<TimeUnit>,
}

fn question(text: String) -> RequirementError {
    RequirementError::Question(text)
}

/// Finds the tightest values for which at least a share of the traces satisfies the formula.
/// Windows are cut at the end of a trace, as [`Monitor::robustness`] does.
///
/// With one parameter this is one value, found by bisection: to the next number, to the next sample
/// for a bound, or to the resolution. With several it is a part of the Pareto front: at each point
/// enough traces satisfy the formula, and fewer do if any one parameter is a step tighter.
///
/// A trace supports a value if it contains the windows of the formula and the conditions of its
/// implications hold. A point without such a trace is left out. The share is one of the traces
/// whose conditions hold with some values.
///
/// # Errors
/// If the formula does not parse, a parameter is a signal, has no direction in which it is tighter,
/// or its range is not one; or if the formula has no value on a trace.
pub fn mine(asked: &MiningQuestion<'_>, traces: &[NamedTrace]) -> Result<Mining> {
    let miner = Miner::new(asked, traces)?;
    let loosest: Vec<u64> = miner.axes.iter().map(|axis| axis.last).collect();
    let tightest = vec![0; loosest.len()];
    let mut found = Mining {
        formula: asked.formula.trim().to_owned(),
        parameters: miner.axes.iter().map(Axis::result).collect(),
        traces: traces.len() as u64,
        share: Number(asked.share),
        outcome: MiningOutcome::Found,
        points: Vec::new(),
        per_trace: Vec::new(),
        traps: start_traps(&miner.formula(&miner.values(&loosest))?)
            .iter()
            .map(FormulaTrap::at_start)
            .collect(),
    };
    if miner.axes.len() == 1 {
        found.per_trace = miner.per_trace()?;
    }
    if !miner.is_met(&loosest)? {
        found.outcome = MiningOutcome::LoosestFails;
        return Ok(found);
    }
    let points = if miner.is_met(&tightest)? {
        found.outcome = MiningOutcome::TightestHolds;
        vec![tightest]
    } else {
        miner.front(asked.points)?
    };
    for point in points {
        found.points.push(miner.point(&point)?);
    }
    // Values that no trace asks for answer nothing.
    found.points.retain(|point| point.support > 0);
    if found.points.is_empty() {
        found.outcome = MiningOutcome::NoSupport;
        found.per_trace.clear();
    }
    if let [point] = found.points.as_slice() {
        let value = point.values.first().map_or(f64::NAN, |value| value.0);
        let formula = miner.formula(&[value])?;
        for (trace, mined) in traces.iter().zip(&mut found.per_trace) {
            mined.supports = mined.value.is_some() && supports(&formula, trace)?;
        }
    }
    Ok(found)
}

struct Miner<'a> {
    text: &'a str,
    axes: Vec<Axis>,
    traces: &'a [NamedTrace],
    /// The number of traces that must satisfy the formula.
    needed: usize,
    share: f64,
}

impl<'a> Miner<'a> {
    fn new(asked: &MiningQuestion<'a>, traces: &'a [NamedTrace]) -> Result<Miner<'a>> {
        let MiningQuestion { formula: text, parameters, share, .. } = *asked;
        if traces.is_empty() {
            return Err(question("there is no trace to mine from".to_owned()));
        }
        if parameters.is_empty() || parameters.len() > MAX_PARAMETERS {
            return Err(question(format!(
                "expected 1 to {MAX_PARAMETERS} parameters, found {}",
                parameters.len()
            )));
        }
        if !(share > 0.0 && share <= 1.0) {
            return Err(question(format!("the share is {share}; it must be above 0 and at most 1")));
        }
        check_names(parameters)?;
        for (index, parameter) in parameters.iter().enumerate() {
            check(parameter, traces)?;
            if parameters[..index].iter().any(|earlier| earlier.name == parameter.name) {
                return Err(question(format!("the parameter `{}` is given twice", parameter.name)));
            }
        }
        let formula = parse_with_ranges(text, parameters)?;
        if formula.signals().is_empty() {
            return Err(question("the formula reads no signal".to_owned()));
        }
        // The same tree with names in the place of numbers, for messages. Bounds of windows must be
        // numbers.
        let is_bound = |index: usize| {
            let nodes = formula.syntax();
            nodes
                .iter()
                .flat_map(|node| node.interval.iter().flatten())
                .any(|bound| bound.parameter == Some(index))
        };
        let bounds: Vec<ParameterRange> = parameters
            .iter()
            .enumerate()
            .filter(|(index, _)| is_bound(*index))
            .map(|(_, range)| range.clone())
            .collect();
        let shown = parse_with_ranges(text, &bounds).unwrap_or_else(|_| formula.clone());
        let mut axes = Vec::new();
        for (index, parameter) in parameters.iter().enumerate() {
            let tightest = direction::tightest(&formula, &shown, index, &parameter.name)?;
            let step = step(&formula, index, parameter, asked.unit, traces)?;
            axes.push(Axis::new(
                &parameter.name,
                parameter.unit,
                [parameter.low, parameter.high],
                tightest,
                step,
            ));
        }
        let mut miner = Miner { text, axes, traces, needed: traces.len(), share };
        miner.check_ends()?;
        // Traces that satisfy the formula only because a condition never holds must not make room
        // for others that violate it.
        let idle = miner.idle()?;
        let counted = if idle < traces.len() { traces.len() - idle } else { traces.len() };
        miner.needed =
            traces.len() - counted + (miner.share * counted as f64 - 1e-9).ceil().max(1.0) as usize;
        Ok(miner)
    }

    /// Returns the number of traces that satisfy the formula with all values, and whose conditions
    /// hold neither with the tightest nor with the loosest ones.
    fn idle(&self) -> Result<usize> {
        let tightest = self.formula(&self.values(&vec![0; self.axes.len()]))?;
        let loosest: Vec<u64> = self.axes.iter().map(|axis| axis.last).collect();
        let loosest = self.formula(&self.values(&loosest))?;
        let mut count = 0;
        for trace in self.traces {
            let is_idle = !has_conditions(&tightest, trace)?
                && !has_conditions(&loosest, trace)?
                && is_satisfied(robustness(&tightest, trace)?);
            count += usize::from(is_idle);
        }
        Ok(count)
    }

    /// Checks that the formula can be evaluated at the ends of all ranges.
    fn check_ends(&self) -> Result<()> {
        for corner in 0..1_u32 << self.axes.len() {
            let end = |(index, axis): (usize, &Axis)| {
                axis.value(if corner >> index & 1 == 0 { 0 } else { axis.last })
            };
            let values: Vec<f64> = self.axes.iter().enumerate().map(end).collect();
            let formula = match self.formula(&values) {
                Err(RequirementError::Parse(ParseError::BeginAfterEnd { begin, end, .. })) => {
                    return Err(question(format!(
                        "the ranges allow the window [{begin}:{end}], whose begin is after its end: let them not overlap"
                    )));
                }
                other => other?,
            };
            for trace in self.traces {
                let monitor = Monitor::new(&formula, trace.trace.names(), trace.clock);
                monitor.map_err(|error| question(format!("trace {}: {error}", trace.name)))?;
            }
        }
        Ok(())
    }

    fn formula(&self, values: &[f64]) -> Result<Formula> {
        let parameters: Vec<Parameter<'_>> =
            self.axes.iter().zip(values).map(|(axis, value)| axis.parameter(*value)).collect();
        Ok(Formula::parse_with(self.text, &parameters)?)
    }

    fn values(&self, point: &[u64]) -> Vec<f64> {
        self.axes.iter().zip(point).map(|(axis, index)| axis.value(*index)).collect()
    }

    /// Returns whether enough traces satisfy the formula.
    fn is_met(&self, point: &[u64]) -> Result<bool> {
        let formula = self.formula(&self.values(point))?;
        let mut failures_left = self.traces.len() - self.needed;
        for trace in self.traces {
            if !is_satisfied(robustness(&formula, trace)?) {
                if failures_left == 0 {
                    return Ok(false);
                }
                failures_left -= 1;
            }
        }
        Ok(true)
    }

    /// Returns the tightest value of the only parameter for each trace.
    fn per_trace(&self) -> Result<Vec<MinedTrace>> {
        let axis = &self.axes[0];
        let mut found = Vec::with_capacity(self.traces.len());
        for trace in self.traces {
            let holds = |index: u64| {
                Ok::<bool, RequirementError>(is_satisfied(robustness(
                    &self.formula(&[axis.value(index)])?,
                    trace,
                )?))
            };
            let value =
                if holds(axis.last)? { Some(Number(axis.value(first(axis.last, holds)?))) } else { None };
            found.push(MinedTrace { name: trace.name.clone(), value, supports: false });
        }
        Ok(found)
    }

    /// Tightens one parameter as far as the others allow.
    fn tighten(&self, point: &mut [u64], axis: usize) -> Result<()> {
        let start = point[axis];
        point[axis] = first(start, |index| {
            let mut tried = point.to_vec();
            tried[axis] = index;
            self.is_met(&tried)
        })?;
        Ok(())
    }

    /// Returns points of the Pareto front, for which the loosest values are met.
    fn front(&self, points: usize) -> Result<Vec<Vec<u64>>> {
        let loosest: Vec<u64> = self.axes.iter().map(|axis| axis.last).collect();
        let last = self.axes.len() - 1;
        let counts = match last {
            0 => 1,
            _ => ((points.clamp(2, MAX_POINTS) as f64).powf(1.0 / last as f64).round() as usize).max(2),
        };
        // The values of each parameter but the last, from its tightest alone to the one from which
        // on it does not help the others.
        let mut grids: Vec<Vec<u64>> = Vec::new();
        for axis in 0..last {
            let mut alone = loosest.clone();
            self.tighten(&mut alone, axis)?;
            let mut least_needed = loosest.clone();
            for other in (0..=last).filter(|other| *other != axis) {
                self.tighten(&mut least_needed, other)?;
            }
            self.tighten(&mut least_needed, axis)?;
            let [from, to] = [alone[axis], least_needed[axis]].map(|index| self.axes[axis].value(index));
            let value = |n: usize| from + (to - from) * n as f64 / (counts - 1) as f64;
            let mut grid: Vec<u64> = (0..counts).map(|n| self.axes[axis].index(value(n))).collect();
            // Exact ends, also of numbers that a sum rounds.
            grid[0] = alone[axis];
            grid[counts - 1] = least_needed[axis];
            grid.dedup();
            grids.push(grid);
        }
        let mut found: Vec<Vec<u64>> = Vec::new();
        for combination in combinations(&grids) {
            let mut point = combination;
            point.push(loosest[last]);
            if !self.is_met(&point)? {
                continue;
            }
            for axis in (0..=last).rev() {
                self.tighten(&mut point, axis)?;
            }
            if !found.contains(&point) {
                found.push(point);
            }
        }
        let order = |a: &Vec<u64>, b: &Vec<u64>| {
            let a = self.values(a);
            let b = self.values(b);
            a.iter()
                .zip(&b)
                .map(|(a, b)| a.total_cmp(b))
                .find(|order| order.is_ne())
                .unwrap_or(std::cmp::Ordering::Equal)
        };
        found.sort_by(order);
        Ok(found)
    }

    /// Describes a point.
    fn point(&self, point: &[u64]) -> Result<MinedPoint> {
        let values = self.values(point);
        let formula = self.formula(&values)?;
        let mut support = 0;
        let mut cut = 0;
        let mut least = f64::NAN;
        let mut satisfied = Vec::new();
        for trace in self.traces {
            let robustness = robustness(&formula, trace)?;
            if !is_satisfied(robustness) {
                continue;
            }
            satisfied.push(trace);
            support += u64::from(supports(&formula, trace)?);
            cut += u64::from(is_cut(&formula, trace)?);
            least = least.min(robustness);
        }
        let mut violated_if_tighter = Vec::with_capacity(point.len());
        // The trace that a tighter value violates most.
        let mut decisive: Option<(f64, &NamedTrace)> = None;
        for axis in 0..point.len() {
            let Some(tighter) = point[axis].checked_sub(1) else {
                violated_if_tighter.push(None);
                continue;
            };
            let mut tried = point.to_vec();
            tried[axis] = tighter;
            let tighter = self.formula(&self.values(&tried))?;
            let mut violated = 0;
            for trace in &satisfied {
                let robustness = robustness(&tighter, trace)?;
                if is_satisfied(robustness) {
                    continue;
                }
                violated += 1;
                if decisive.is_none_or(|(most, _)| robustness.total_cmp(&most).is_lt()) {
                    decisive = Some((robustness, trace));
                }
            }
            violated_if_tighter.push(Some(violated));
        }
        let at = decisive.and_then(|(_, trace)| {
            let sample = formula.diagnose(&trace.trace, &trace.clock).ok()?.predicate?.sample;
            Some((sample, trace.clock.period_secs().map(|period| trace.start + sample as f64 * period)))
        });
        Ok(MinedPoint {
            values: values.into_iter().map(Number).collect(),
            // `-limit` with a limit of -2 is printed as 2.
            formula: Formula::parse(&formula.to_string())?.to_string(),
            robustness: Number(least),
            satisfied: satisfied.len() as u64,
            support,
            cut,
            decisive: decisive.map(|(_, trace)| trace.name.clone()),
            decisive_time: at.and_then(|(_, secs)| secs).map(Number),
            decisive_sample: at.map(|(sample, _)| sample as u64),
            violated_if_tighter,
        })
    }
}

/// Parses a formula with parameters at an end of their ranges: the lower one, unless a window would
/// then begin after its end.
///
/// # Errors
/// As for [`Formula::parse_with`].
pub fn parse_with_ranges(
    text: &str,
    parameters: &[ParameterRange],
) -> std::result::Result<Formula, ParseError> {
    let at = |value: fn(&ParameterRange) -> f64| -> Vec<Parameter<'_>> {
        let named = parameters.iter();
        named.map(|range| Parameter { name: &range.name, value: value(range), unit: range.unit }).collect()
    };
    Formula::parse_with(text, &at(|range| range.low))
        .or_else(|error| Formula::parse_with(text, &at(|range| range.high)).map_err(|_| error))
}

fn robustness(formula: &Formula, trace: &NamedTrace) -> Result<f64> {
    let found = Monitor::new(formula, trace.trace.names(), trace.clock)
        .and_then(|mut monitor| monitor.robustness(&trace.trace));
    found.map_err(|error| question(format!("trace {}: {error}", trace.name)))
}

fn monitor(formula: &Formula, trace: &NamedTrace) -> Result<Monitor> {
    Ok(Monitor::new(formula, trace.trace.names(), trace.clock)?)
}

/// Returns whether a trace is shorter than the windows of a formula, which are cut at its end.
fn is_cut(formula: &Formula, trace: &NamedTrace) -> Result<bool> {
    Ok(monitor(formula, trace)?.decided_samples(trace.trace.len()) == 0)
}

/// Returns whether a trace contains the windows of a formula, and the condition of each implication
/// holds at some sample.
fn supports(formula: &Formula, trace: &NamedTrace) -> Result<bool> {
    Ok(!is_cut(formula, trace)? && has_conditions(formula, trace)?)
}

/// Returns whether the condition of each implication holds at some sample of a trace.
fn has_conditions(formula: &Formula, trace: &NamedTrace) -> Result<bool> {
    for node in Tree::new(formula).antecedents() {
        let mut condition = monitor(&formula.at_node(node), trace)?;
        if !condition.robustness_signal(&trace.trace)?.iter().any(|value| is_satisfied(*value)) {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Checks that a formula can read these parameters by their names.
///
/// # Errors
/// If a name is not a plain word, or a word of the language, such as `F`.
pub fn check_names(parameters: &[ParameterRange]) -> Result<()> {
    for ParameterRange { name, .. } in parameters {
        let is_word = name.chars().all(|letter| letter.is_ascii_alphanumeric() || letter == '_')
            && name.starts_with(|letter: char| letter.is_ascii_alphabetic() || letter == '_');
        if is_word && spelled(name) != *name {
            return Err(question(format!(
                "`{name}` is an operator or another word of the language, and cannot be a parameter: expected another name, \
                 such as limit"
            )));
        }
        if !is_word {
            return Err(question(format!(
                "`{name}` cannot be a parameter: expected a plain word, such as limit"
            )));
        }
    }
    Ok(())
}

fn check(parameter: &ParameterRange, traces: &[NamedTrace]) -> Result<()> {
    let ParameterRange { name, low, high, resolution, .. } = parameter;
    if let Some(trace) = traces.iter().find(|trace| trace.trace.signal(name).is_some()) {
        return Err(question(format!(
            "the parameter `{name}` is also a signal of {}; choose another name for the parameter",
            trace.name
        )));
    }
    if !(low.is_finite() && high.is_finite() && low <= high) {
        return Err(question(format!(
            "the range of `{name}` is {low}:{high}; expected two numbers, the lower one first"
        )));
    }
    if let Some(resolution) = resolution.filter(|resolution| !(*resolution > 0.0 && resolution.is_finite())) {
        return Err(question(format!("the resolution of `{name}` is {resolution}; it must be above 0")));
    }
    Ok(())
}

/// Returns the step of the values of a parameter: its resolution, the sampling period for a bound,
/// or none.
fn step(
    formula: &Formula,
    index: usize,
    parameter: &ParameterRange,
    default_unit: Option<TimeUnit>,
    traces: &[NamedTrace],
) -> Result<Option<f64>> {
    let name = &parameter.name;
    let nodes = formula.syntax();
    let bounds = nodes.iter().flat_map(|node| node.interval.iter().flatten());
    let mut own = bounds.filter(|bound| bound.parameter == Some(index)).peekable();
    let step = if own.peek().is_none() {
        if parameter.unit.is_some() {
            return Err(question(format!(
                "the range of `{name}` has a unit, but the formula reads it as a number and not as a bound of a window"
            )));
        }
        parameter.resolution
    } else {
        let units: Vec<Option<TimeUnit>> = own.map(|bound| bound.unit.or(default_unit)).collect();
        if units.iter().any(|unit| *unit != units[0]) {
            return Err(question(format!("the windows read `{name}` in different units")));
        }
        if parameter.low < 0.0 {
            return Err(question(format!(
                "`{name}` is a bound of a window: its range must start at 0 or later"
            )));
        }
        let own = match units[0] {
            None => 1.0,
            Some(unit) => {
                let per_second = match unit {
                    TimeUnit::Seconds => 1.0,
                    TimeUnit::Milliseconds => 1e3,
                    TimeUnit::Microseconds => 1e6,
                    TimeUnit::Nanoseconds => 1e9,
                };
                let periods: Option<Vec<f64>> =
                    traces.iter().map(|trace| trace.clock.period_secs()).collect();
                let periods = periods.ok_or_else(|| RequirementError::Lacking {
                    fact: format!("`{name}` is a time, and a trace has no sampling period"),
                    remedy: Remedy::set(Key::LOG_PERIOD, Choice::SECONDS),
                })?;
                let differ = periods.iter().any(|period| (period - periods[0]).abs() > 1e-9 * periods[0]);
                if differ && parameter.resolution.is_none() {
                    return Err(RequirementError::Lacking {
                        fact: "the traces have different sampling periods, and the step must be a multiple of each"
                            .to_owned(),
                        remedy: Remedy::set(
                            Key::RESOLUTION,
                            Choice::Of(name.clone(), Box::new(Choice::Shape("STEP"))),
                        ),
                    });
                }
                periods[0] * per_second
            }
        };
        Some(parameter.resolution.unwrap_or(own))
    };
    if let Some(step) = step {
        for end in [parameter.low, parameter.high] {
            let count = end / step;
            if (count - count.round()).abs() > 1e-6 || count.abs() > 1e15 {
                return Err(question(format!(
                    "the range of `{name}` ends at {end}, which is no multiple of the step {step}"
                )));
            }
        }
    }
    Ok(step)
}

/// Returns all combinations of one value of each list.
fn combinations(lists: &[Vec<u64>]) -> Vec<Vec<u64>> {
    let mut found = vec![Vec::new()];
    for list in lists {
        found = found
            .iter()
            .flat_map(|start: &Vec<u64>| {
                list.iter().map(move |value| start.iter().copied().chain([*value]).collect())
            })
            .collect();
    }
    found
}
