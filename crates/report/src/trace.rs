//! Charts of a failing simulation: signals over time with their thresholds and the violation.

use mishandle::inspect::{ExplainedSimulation, unit};
use mishandle::stl::{Clock, Formula, Monitor, Trace, is_violated};
use mishandle::store::RunHeader;

use crate::predicate_chart::{Curve, PredicateChart};

/// Largest number of charts of a simulation.
const MAX_CHARTS: usize = 4;

/// Returns charts of the decisive predicate and of the other predicates of the formula, as HTML,
/// all with the same time and the instant of the failure, and with the values of the nominal
/// simulation as a second line. The time ends with `samples`, which may be more than the trace has.
pub fn figures(
    header: &RunHeader,
    explained: &ExplainedSimulation,
    nominal: Option<&ExplainedSimulation>,
    samples: usize,
) -> Vec<String> {
    let explanation = &explained.explanation;
    let decisive = explanation.diagnosis.predicate.as_ref().map(|predicate| predicate.text.as_str());
    let others = explanation.predicates.iter().map(String::as_str);
    let mut texts: Vec<&str> = Vec::new();
    for text in decisive.into_iter().chain(others) {
        if !texts.contains(&text) {
            texts.push(text);
        }
    }
    let charts = texts.into_iter().take(MAX_CHARTS);
    charts
        .filter_map(|predicate| {
            predicate_figure(header, explained, nominal, samples, predicate, Some(predicate) == decisive)
        })
        .collect()
}

fn predicate_figure(
    header: &RunHeader,
    explained: &ExplainedSimulation,
    nominal: Option<&ExplainedSimulation>,
    samples: usize,
    predicate: &str,
    is_decisive: bool,
) -> Option<String> {
    let time = |sample: f64| sample * header.control_dt;
    let end = time(samples.max(explained.trace.len()).saturating_sub(1).max(1) as f64);
    let history = explained.explanation.history.as_ref().filter(|_| is_decisive);
    let violated = history
        .map_or(Vec::new(), |history| spans(&history.violated))
        .into_iter()
        .map(|(from, to)| [time(from as f64 - 0.5).max(0.0), time(to as f64 + 0.5).min(end)])
        .collect();
    let chart = PredicateChart {
        predicate,
        time: "time (s)",
        range: [0.0, end],
        window: history.map(|history| [history.window.0, history.window.1].map(|sample| time(sample as f64))),
        violated,
        decisive: explained.explanation.instant().map(|sample| time(sample as f64)),
        is_failure: nominal.is_some() || explained.recorded.robustness.is_some_and(is_violated),
        caption: &caption(is_decisive, nominal.is_some()),
    };
    let curve = |trace: &Trace, formula: &Formula| -> Option<Curve> {
        let clock = Clock::steps(header.control_dt);
        let mut monitor = Monitor::new(formula, trace.names(), clock).ok()?;
        let values = monitor.robustness_signal(trace).ok()?;
        Some(values.iter().enumerate().map(|(sample, value)| [time(sample as f64), *value]).collect())
    };
    let beside = |formula: &Formula| curve(&nominal?.trace, formula);
    chart.figure(|formula| curve(&explained.trace, formula), beside, |side| unit(header, side))
}

/// Explains the lines of a chart.
fn caption(is_decisive: bool, has_nominal: bool) -> String {
    let mut out = String::new();
    if has_nominal {
        out.push_str("Orange line: this simulation. Blue line: nominal. ");
    }
    out.push_str("Dashed: threshold. ");
    if is_decisive {
        out.push_str("Gray: time that the formula reads. Shaded: violated there. ");
    }
    out + "Vertical line: the instant."
}

/// Returns the first and last of each run of samples without a gap.
pub fn spans(samples: &[usize]) -> Vec<(usize, usize)> {
    let mut spans: Vec<(usize, usize)> = Vec::new();
    for sample in samples.iter().copied() {
        match spans.last_mut() {
            Some((_, end)) if *end + 1 == sample => *end = sample,
            _ => spans.push((sample, sample)),
        }
    }
    spans
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_without_a_gap_are_one_span() {
        assert_eq!(spans(&[1, 3, 4]), [(1, 1), (3, 4)]);
    }
}
