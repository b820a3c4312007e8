//! A formula in words, with its traps.

use std::collections::BTreeMap;

use mishandle_results::{FormulaDescription, FormulaHorizon, FormulaTrap, Number, Signal, TrapSeverity};
use mishandle_stl::{Clock, EvaluationTime, Formula, Monitor, TimeUnit, Trace};

use crate::error::Result;
use crate::traps;
use crate::tree::Tree;
use crate::units::unit_of;

/// Largest number of operators and operands of a formula that is put into words.
const MAX_WORDS: usize = 500;

/// Periods in which bounds with units are whole numbers of samples, s.
const TICKS: [f64; 4] = [1.0, 1e-3, 1e-6, 1e-9];

/// Known facts about the traces of a formula.
#[derive(Clone, Debug, Default)]
pub struct Context {
    /// The sampling period in seconds.
    pub period: Option<f64>,
    /// The unit of bounds without one; `None`: they count samples.
    pub unit: Option<TimeUnit>,
    /// Units by the names of signals.
    pub units: BTreeMap<String, String>,
    /// The number of samples of an episode or of the shortest log.
    pub samples: Option<usize>,
    /// The duration of an episode in seconds, if its number of samples is unknown.
    pub episode_secs: Option<f64>,
    /// Whether the formula is evaluated at every sample, as the safe condition of a target is, and
    /// not at the first one as a requirement.
    pub at_every_sample: bool,
    /// Traces that the formula is meant for, with their names.
    pub traces: Vec<(String, Trace)>,
}

impl Context {
    /// Returns how bounds count samples.
    pub fn clock(&self) -> Clock {
        match (self.period, self.unit) {
            (Some(period), Some(unit)) => Clock::rtamt(period, unit),
            (Some(period), None) => Clock::steps(period),
            (None, unit) => Context::clock_without_period(unit),
        }
    }

    fn clock_without_period(unit: Option<TimeUnit>) -> Clock {
        unit.map_or(Clock::unknown(), Clock::unknown_rtamt)
    }
}

/// Describes a formula: in words, its horizon, and its traps.
///
/// # Errors
/// If the text is not a formula, or the period of the context is not positive and finite.
pub fn describe(text: &str, context: &Context) -> Result<FormulaDescription> {
    describe_formula(&Formula::parse(text)?, context)
}

/// Describes a formula that was parsed.
///
/// # Errors
/// If the period of the context is not positive and finite.
pub fn describe_formula(formula: &Formula, context: &Context) -> Result<FormulaDescription> {
    let tree = Tree::new(formula);
    let unit = |name: &str| unit_of(name, &context.units).unwrap_or_default();
    let units: BTreeMap<&str, String> =
        formula.signals().into_iter().map(|name| (name, unit(name))).collect();
    let words = |clock: Clock| {
        formula.explain(&clock, EvaluationTime::Start, |name| units.get(name).map_or("", String::as_str))
    };
    let is_short = tree.nodes.len() <= MAX_WORDS;
    // A bound between two samples is a trap; its words are those of the text.
    let words = if is_short {
        words(context.clock()).or_else(|_| words(Context::clock_without_period(context.unit)))?
    } else {
        Vec::new()
    };
    let signals = formula.signals().into_iter();
    let mut traps: Vec<FormulaTrap> = traps::find(&tree, context);
    traps.sort_by_key(|trap| (trap.severity == TrapSeverity::Note, trap.line, trap.column));
    Ok(FormulaDescription {
        pattern: None,
        formula: formula.to_string(),
        parenthesized: formula.parenthesized(),
        symbols: formula.symbols().to_string(),
        words,
        signals: signals.map(|name| Signal { name: name.to_owned(), unit: unit(name) }).collect(),
        period: context.period.map(Number),
        horizon: horizon(formula, context),
        traps,
        examples: Vec::new(),
    })
}

/// The part of a trace that decides a formula at time 0.
pub(crate) struct Needed {
    /// Samples, if the period is known or no bound is a time.
    pub samples: Option<usize>,
    /// The time of the last one, s.
    pub secs: Option<f64>,
    /// Whether the formula depends on all samples up to the end.
    pub is_unbounded: bool,
}

/// Returns the samples that decide the formula; `None` if a bound is not a whole number of samples.
pub(crate) fn needed(formula: &Formula, context: &Context) -> Option<Needed> {
    let (samples, clock) = needed_on(formula, context)?;
    let names: Vec<String> = formula.signals().into_iter().map(str::to_owned).collect();
    let is_unbounded = Monitor::new(formula, &names, clock).ok()?.horizon().is_none();
    let has_samples = context.period.is_some() || !formula.needs_period(context.unit.is_some());
    let secs = clock.period_secs().filter(|_| context.period.is_some() || !has_samples);
    let secs = secs.map(|period| (samples - 1) as f64 * period);
    Some(Needed { samples: has_samples.then_some(samples), secs, is_unbounded })
}

/// Returns how many samples decide the formula, and a clock on which they do: that of the context,
/// or one in which all times are whole numbers of samples.
pub(crate) fn needed_on(formula: &Formula, context: &Context) -> Option<(usize, Clock)> {
    let names: Vec<String> = formula.signals().into_iter().map(str::to_owned).collect();
    let on = |clock: Clock| Some((Monitor::new(formula, &names, clock).ok()?.needed_samples(), clock));
    if context.period.is_some() || !formula.needs_period(context.unit.is_some()) {
        return on(context.clock());
    }
    let unit = context.unit.unwrap_or(TimeUnit::Seconds);
    let tree = Tree::new(formula);
    let counts_samples = tree.nodes.iter().flat_map(|node| node.interval.iter().flatten()).any(|bound| {
        context.unit.is_none() && bound.unit.is_none() && bound.value > 0.0 && bound.value.is_finite()
    });
    let has_steps =
        tree.nodes.iter().enumerate().any(|(node, _)| matches!(tree.operator(node), Some("next" | "s_next")));
    if counts_samples || has_steps {
        return None;
    }
    TICKS.iter().find_map(|tick| on(Clock::rtamt(*tick, unit)))
}

fn horizon(formula: &Formula, context: &Context) -> Option<FormulaHorizon> {
    match needed(formula, context) {
        Some(Needed { is_unbounded: true, .. }) => None,
        Some(Needed { samples, secs, .. }) => {
            Some(FormulaHorizon { samples: samples.map(|samples| samples as u64), seconds: secs.map(Number) })
        }
        // A bound that does not fit the samples, or samples and times without a period.
        None => Some(FormulaHorizon { samples: None, seconds: None }),
    }
}
