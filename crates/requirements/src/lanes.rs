//! When a formula and its sub-formulas hold on a trace.

use std::sync::Arc;

use mishandle_results::{
    ExampleKind, FormulaExample, FormulaLane, FormulaValues, LaneSpan, LaneState, Number,
};
use mishandle_stl::{Clock, Formula, Monitor, Trace, is_violated};

use crate::error::Result;
use crate::pattern::Shown;

/// Largest number of sub-formulas that are drawn.
const MAX_LANES: usize = 40;

/// Evaluates a formula and its sub-formulas on a trace.
///
/// Windows are cut at the end of the trace, as [`Monitor::robustness`] does. Samples at which the
/// trace does not contain the whole windows of a sub-formula are `violated` if the cut ones violate
/// it, otherwise `undecided`.
///
/// # Errors
/// As for [`Monitor::new`] and [`Monitor::robustness_signal`].
pub fn draw(
    formula: &Formula,
    kind: ExampleKind,
    name: &str,
    trace: &Trace,
    clock: Clock,
) -> Result<FormulaExample> {
    let nodes = formula.subformula_nodes(&clock)?;
    let mut depths = vec![0; nodes.len()];
    for (position, node) in nodes.iter().enumerate() {
        node.operands.iter().for_each(|operand| depths[*operand] = depths[position] + 1);
    }
    let mut lanes = Vec::new();
    for (text, depth) in formula.subformulas().take(MAX_LANES).zip(depths) {
        let part = Formula::parse(&text)?;
        let mut monitor = Monitor::new(&part, trace.names(), clock)?;
        let decided = monitor.decided_samples(trace.len());
        let spans = spans(monitor.robustness_signal(trace)?, decided);
        lanes.push(FormulaLane { formula: text, depth, spans });
    }
    let robustness = Monitor::new(formula, trace.names(), clock)?.robustness(trace)?;
    Ok(FormulaExample {
        kind,
        name: name.to_owned(),
        robustness: Number(robustness),
        violated: is_violated(robustness),
        samples: trace.len() as u64,
        period: clock.period_secs().map(Number),
        values: None,
        lanes,
    })
}

/// Adds the values of these signals of the trace.
pub fn with_values(example: FormulaExample, trace: &Trace, signals: &[&str]) -> FormulaExample {
    let of = |name: &&str| {
        Some(FormulaValues { signal: (*name).to_owned(), values: trace.signal(name)?.to_vec() })
    };
    FormulaExample { values: Some(signals.iter().filter_map(of).collect()), ..example }
}

fn spans(values: &[f64], decided: usize) -> Vec<LaneSpan> {
    let mut spans: Vec<LaneSpan> = Vec::new();
    for (sample, value) in values.iter().enumerate() {
        let state = match (sample < decided, is_violated(*value)) {
            // Also with a cut window: a row must not hide what the verdict comes from.
            (_, true) => LaneState::Violated,
            (false, false) => LaneState::Undecided,
            (true, false) => LaneState::Holds,
        };
        match spans.last_mut() {
            Some(last) if last.state == state => last.last = sample as u64,
            _ => spans.push(LaneSpan { state, first: sample as u64, last: sample as u64 }),
        }
    }
    spans
}

/// Evaluates a formula on the two traces of a pattern, whose samples are 1 s apart.
pub(crate) fn draw_shown(formula: &Formula, shown: &Shown) -> Result<Vec<FormulaExample>> {
    let names: Arc<[String]> = shown.signals.iter().map(|name| (*name).to_owned()).collect();
    let traces = [("satisfied", shown.satisfies), ("violated", shown.violates)];
    let draw = |(name, columns): (&str, &[&[f64]])| {
        let columns = columns.iter().map(|values| values.to_vec()).collect();
        let trace = Trace::from_columns(Arc::clone(&names), columns);
        let example = draw(formula, ExampleKind::Pattern, name, &trace, Clock::steps(1.0))?;
        Ok(with_values(example, &trace, shown.signals))
    };
    traces.into_iter().map(draw).collect()
}
