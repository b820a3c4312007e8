//! Formulas over samples that come one at a time: bounds, verdicts and the first violations.

use std::collections::VecDeque;

use mishandle_stl::{
    Bounds, Clock, CutMonitor, Formula, Monitor, MonitorError, OnlineMonitor, SubformulaNode, TimeUnit,
    is_violated,
};

use super::needs_period;
use crate::error::Result;
use crate::verdict::{Reach, check_decided, parts, too_short};

/// Bounds that take time in proportion to the samples are computed again when there are this share
/// more of them.
const PATIENCE: usize = 16;

/// A formula to watch.
#[derive(Clone, Debug)]
pub struct Watched {
    /// The formula.
    pub formula: Formula,
    /// The unit of bounds without one; `None`: they count samples.
    pub unit: Option<TimeUnit>,
}

/// The answer of the samples so far about a formula.
#[derive(Clone, Debug, PartialEq)]
pub struct Answer {
    /// The bounds of the robustness at time 0 over all continuations.
    pub bounds: Bounds,
    /// Whether the formula is satisfied, as soon as it is certain.
    pub verdict: Option<bool>,
    /// The first violation of a part of the formula that is known, if it is not satisfied.
    pub violation: Option<Violated>,
    /// Whether the robustness depends on a window that is cut at the end of the log.
    pub cuts_windows: bool,
}

/// The violation of a part of a formula: an operand of its `and`s below its `always`.
#[derive(Clone, Debug, PartialEq)]
pub struct Violated {
    /// The text of the part.
    pub formula: String,
    /// The sample.
    pub sample: usize,
    /// Its time in seconds; `None` if the log has no times and no period.
    pub time: Option<f64>,
    /// The robustness of the part there.
    pub robustness: f64,
}

/// Online monitors of some formulas, which share equal parts.
#[derive(Clone, Debug)]
pub struct Watch {
    groups: Vec<Group>,
    /// The group and the position in it of each formula.
    places: Vec<(usize, usize)>,
    names: Vec<String>,
    is_strict: bool,
    len: usize,
    /// The times of the last samples, as many as parts wait for.
    times: VecDeque<Option<f64>>,
    kept: usize,
}

/// Formulas with the same clock.
#[derive(Clone, Debug)]
struct Group {
    clock: Clock,
    online: Online,
    watched: Vec<State>,
    pushed: usize,
}

#[derive(Clone, Debug)]
enum Online {
    Cut(CutMonitor),
    Whole(OnlineMonitor),
}

/// A formula, and what is known about it.
#[derive(Clone, Debug)]
struct State {
    formula: Formula,
    parts: Vec<Part>,
    answer: Answer,
    /// Whether its bounds take time in proportion to the samples so far.
    is_slow: bool,
    /// The number of samples at which they are computed next, if so.
    next: usize,
}

#[derive(Clone, Debug)]
struct Part {
    text: String,
    /// The position among the formulas of the monitor.
    root: usize,
    reach: Reach,
    violation: Option<Violated>,
}

impl Answer {
    /// The answer before the first sample.
    pub const UNKNOWN: Answer =
        Answer { bounds: Bounds::UNKNOWN, verdict: None, violation: None, cuts_windows: false };
}

impl Watch {
    /// Compiles formulas for samples of these signals, `period` seconds apart. `is_strict`: only
    /// windows inside the log count, instead of cutting them at its end.
    ///
    /// # Errors
    /// If a formula does not fit the signals, or a bound needs a period or is not a whole number
    /// of samples.
    pub fn new(watched: &[Watched], names: &[String], period: Option<f64>, is_strict: bool) -> Result<Watch> {
        let mut units: Vec<Option<TimeUnit>> = Vec::new();
        for found in watched {
            if period.is_none() && found.formula.needs_period(found.unit.is_some()) {
                return Err(needs_period());
            }
            if !units.contains(&found.unit) {
                units.push(found.unit);
            }
        }
        let group = |unit: &Option<TimeUnit>| {
            let formulas =
                watched.iter().filter(|found| found.unit == *unit).map(|found| found.formula.clone());
            Group::new(formulas.collect(), *unit, names, period, is_strict)
        };
        let groups = units.iter().map(group).collect::<Result<Vec<Group>>>()?;
        let mut counts = vec![0; units.len()];
        let place = |found: &Watched| {
            let group = units.iter().position(|unit| *unit == found.unit).unwrap_or(0);
            counts[group] += 1;
            (group, counts[group] - 1)
        };
        let places = watched.iter().map(place).collect();
        let kept = groups.iter().map(Group::waits).max().unwrap_or(1);
        let names = names.to_vec();
        let times = VecDeque::new();
        Ok(Watch { groups, places, names, is_strict, len: 0, times, kept })
    }

    /// Adds a sample and its time in seconds, if it has one.
    ///
    /// # Errors
    /// If arithmetic has no finite value.
    pub fn push(&mut self, sample: &[f64], time: Option<f64>) -> Result<()> {
        self.len += 1;
        self.times.push_back(time);
        if self.times.len() > self.kept {
            self.times.pop_front();
        }
        let first = self.len - self.times.len();
        let time_of = |sample: usize| self.times.get(sample.checked_sub(first)?).copied().flatten();
        for group in &mut self.groups {
            group.push(sample, &time_of)?;
        }
        Ok(())
    }

    /// Returns the number of samples.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Returns whether there are no samples.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Returns what is known about formula `i`. Its bounds stay once the verdict is certain.
    ///
    /// # Panics
    /// If there is no formula `i`.
    pub fn answer(&self, i: usize) -> &Answer {
        let (group, position) = self.places[i];
        &self.groups[group].watched[position].answer
    }

    /// States that the log ends with the last sample. All formulas then have a verdict, that of
    /// [`Samples::verdict`](crate::Samples::verdict).
    ///
    /// # Errors
    /// If windows must be inside the log, and it is too short.
    pub fn finish(&mut self) -> Result<()> {
        for group in &mut self.groups {
            group.finish(&self.names, self.len, self.is_strict)?;
        }
        Ok(())
    }
}

impl Group {
    fn new(
        formulas: Vec<Formula>,
        unit: Option<TimeUnit>,
        names: &[String],
        period: Option<f64>,
        is_strict: bool,
    ) -> Result<Group> {
        let clock = match (period, unit) {
            (Some(period), Some(unit)) => Clock::rtamt(period, unit),
            (Some(period), None) => Clock::steps(period),
            (None, _) => Clock::unknown(),
        };
        let mut all = formulas.clone();
        let mut watched = Vec::new();
        for formula in formulas {
            let nodes = formula.subformula_nodes(&clock)?;
            let texts: Vec<String> = formula.subformulas().collect();
            let mut found = Vec::new();
            for (position, reach) in parts(&nodes) {
                let Ok(part) = Formula::parse(&texts[position]) else { continue };
                if part.signals().is_empty() {
                    continue;
                }
                found.push(Part { text: texts[position].clone(), root: all.len(), reach, violation: None });
                all.push(part);
            }
            let is_slow = has_open_window_ahead(&nodes);
            watched.push(State { formula, parts: found, answer: Answer::UNKNOWN, is_slow, next: 0 });
        }
        let online = if is_strict {
            Online::Whole(OnlineMonitor::new(&all, names, clock, None)?)
        } else {
            Online::Cut(CutMonitor::new(&all, names, clock)?)
        };
        Ok(Group { clock, online, watched, pushed: 0 })
    }

    /// Returns the number of samples after which a part is decided.
    fn waits(&self) -> usize {
        let parts = self.watched.iter().flat_map(|state| &state.parts);
        parts.map(|part| self.online.needed_samples(part.root)).max().unwrap_or(1)
    }

    fn push(&mut self, sample: &[f64], time_of: &dyn Fn(usize) -> Option<f64>) -> Result<()> {
        self.online.push(sample)?;
        self.pushed += 1;
        for (root, state) in self.watched.iter_mut().enumerate() {
            if state.answer.verdict.is_some() {
                continue;
            }
            for part in state.parts.iter_mut().filter(|part| part.violation.is_none()) {
                let (first, last) = part.reach;
                part.violation = self
                    .online
                    .decided(part.root)
                    .filter(|(sample, value)| {
                        first <= *sample && last.is_none_or(|last| *sample <= last) && is_violated(*value)
                    })
                    .map(|(sample, robustness)| Violated {
                        formula: part.text.clone(),
                        sample,
                        time: time_of(sample),
                        robustness,
                    });
            }
            if state.is_slow && self.pushed < state.next {
                continue;
            }
            // The time of all bounds then is in proportion to the samples.
            state.next = self.pushed + self.pushed / PATIENCE + 1;
            state.answer.bounds = self.online.bounds(root);
            state.decide();
        }
        Ok(())
    }

    fn finish(&mut self, names: &[String], len: usize, is_strict: bool) -> Result<()> {
        self.online.finish()?;
        for (root, state) in self.watched.iter_mut().enumerate() {
            if state.answer.verdict.is_some() {
                continue;
            }
            let monitor = Monitor::new(&state.formula, names, self.clock)?;
            state.answer.bounds = self.online.bounds(root);
            if is_strict {
                if monitor.needed_samples() > len {
                    return Err(too_short(monitor.needed_samples(), len));
                }
                check_decided(state.answer.bounds.low)?;
            }
            state.answer.cuts_windows = !is_strict && monitor.cuts_windows(len);
            state.decide();
        }
        Ok(())
    }
}

/// Returns whether a window ahead without an end is inside another window ahead. The bounds then
/// take time in proportion to the samples so far.
fn has_open_window_ahead(nodes: &[SubformulaNode]) -> bool {
    const AHEAD: [&str; 5] = ["always", "eventually", "until", "release", "unless"];
    let mut open = vec![(0, false)];
    while let Some((position, is_inside)) = open.pop() {
        let node = &nodes[position];
        let is_ahead = node.operator.is_some_and(|operator| AHEAD.contains(&operator));
        if is_ahead && is_inside && node.window.is_some_and(|(_, end)| end.is_none()) {
            return true;
        }
        open.extend(node.operands.iter().map(|operand| (*operand, is_inside || is_ahead)));
    }
    false
}

impl State {
    fn decide(&mut self) {
        self.answer.verdict = self.answer.bounds.verdict();
        if self.answer.verdict == Some(false) {
            let found = self.parts.iter().filter_map(|part| part.violation.clone());
            self.answer.violation = found.min_by_key(|violation| violation.sample);
        }
    }
}

impl Online {
    fn push(&mut self, sample: &[f64]) -> std::result::Result<(), MonitorError> {
        match self {
            Online::Cut(monitor) => monitor.push(sample),
            Online::Whole(monitor) => monitor.push(sample),
        }
    }

    fn needed_samples(&self, root: usize) -> usize {
        match self {
            Online::Cut(monitor) => monitor.needed_samples(root).0,
            Online::Whole(monitor) => monitor.needed_samples(root).0,
        }
    }

    fn bounds(&mut self, root: usize) -> Bounds {
        match self {
            Online::Cut(monitor) => monitor.bounds(root),
            Online::Whole(monitor) => monitor.bounds(root),
        }
    }

    fn decided(&self, root: usize) -> Option<(usize, f64)> {
        match self {
            Online::Cut(monitor) => monitor.decided(root),
            Online::Whole(monitor) => monitor.decided(root),
        }
    }

    fn finish(&mut self) -> std::result::Result<(), MonitorError> {
        match self {
            Online::Cut(monitor) => monitor.finish(),
            Online::Whole(monitor) => {
                monitor.finish();
                Ok(())
            }
        }
    }
}
