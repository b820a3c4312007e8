use mishandle_controllers::guard::ACTIVE;
use mishandle_results as results;
use mishandle_results::{Instant, PathStep, Predicate, Seed, SignalRow, SignalTable, Window};
use mishandle_stl::{DecisivePredicate, DecisiveSubformula, Formula, Trace, is_violated};
use mishandle_store::RunHeader;
use mishandle_text::{instant, plural};

use crate::inspect::{Conjunct, ExplainedSimulation, Explanation, PredicateHistory};
use crate::resolve::guard::recorded_guard;
use crate::run::{box_point, given, recorded_axes, recorded_scenario};

/// Says when a guard handed over on a trace and how long its fallback acted; `None` without a
/// guard. `name` names a sample.
fn guard_sentence(trace: &Trace, name: &impl Fn(usize) -> String) -> Option<String> {
    let active = trace.signal(ACTIVE)?;
    let steps = plural(active.len().saturating_sub(1), "control step");
    // A sample has the action of the control step before it.
    let Some(first) = active.iter().position(|active| *active > 0.0) else {
        return Some(format!("The guard never hands over in {steps}."));
    };
    let acting = active.iter().filter(|active| **active > 0.0).count();
    let at = name(first.saturating_sub(1));
    Some(format!("The guard hands over at {at}; its fallback acts in {acting} of {steps}."))
}

/// Numbers of evenly spaced samples in the table of signals, up to the decisive one and behind it.
const ROWS_BEFORE: usize = 8;
const ROWS_AFTER: usize = 3;

/// Largest number of signals in the table of signals.
const SIGNAL_COLUMNS: usize = 4;

impl ExplainedSimulation {
    /// Returns the explanation as a result. The header is that of its run, `run` the path of its
    /// file.
    pub fn result(&self, header: &RunHeader, run: Option<&str>) -> results::Explanation {
        let ExplainedSimulation { recorded, explanation, trace } = self;
        let robustness = explanation.diagnosis.robustness();
        let point = box_point(header, recorded.trial, &recorded.scenario);
        let unit = |name: &str| {
            let signal = header.signals.iter().find(|signal| signal.name == name);
            signal.map_or(String::new(), |signal| signal.unit.clone())
        };
        results::Explanation {
            run: run.map(str::to_string),
            target: header.target.name.clone(),
            guard: recorded_guard(header),
            trial: recorded.trial,
            simulation: recorded.number,
            scenario: recorded_scenario(&header.axes, &recorded.scenario),
            seed: Seed(recorded.seed),
            formula: header.formula.clone(),
            robustness: robustness.into(),
            violated: is_violated(robustness),
            reason: given(&recorded.reason),
            decision: explanation.result(
                &header.formula,
                trace,
                unit,
                |sample| sample as f64 * header.control_dt,
                |sample| instant(sample, header.control_dt),
            ),
            axes_at_nominal: None,
            point,
            space_axes: recorded_axes(&header.axes),
            control_dt: header.control_dt,
        }
    }
}

impl Explanation {
    /// Returns what decides `formula` on `trace` as a result. `unit` is that of a signal, `time`
    /// that of a sample in seconds, and `name` names a sample in a sentence.
    pub fn result(
        &self,
        formula: &str,
        trace: &Trace,
        unit: impl Fn(&str) -> String,
        time: impl Fn(usize) -> f64,
        name: impl Fn(usize) -> String,
    ) -> results::Decision {
        let Explanation { diagnosis, history, decided, conjuncts, .. } = self;
        let at = |sample: usize| Instant { sample: sample as u64, time: time(sample) };
        let window = |window: Option<(usize, usize)>| window.map(|(first, last)| [first as u64, last as u64]);
        let conjunct = |conjunct: &Conjunct| results::Conjunct {
            formula: conjunct.text.clone(),
            robustness: conjunct.robustness.into(),
            decided: conjunct.decided.map(at),
        };
        let step = |found: &DecisiveSubformula| PathStep {
            formula: found.text.clone(),
            operator: found.operator.map(str::to_string),
            at: at(found.sample),
            window: window(found.window),
            robustness: found.robustness.into(),
        };
        results::Decision {
            decided: decided.map(at),
            predicate: diagnosis.predicate.as_ref().map(|predicate| Predicate {
                formula: predicate.text.clone(),
                at: at(predicate.sample),
                comparison: predicate.comparison.to_string(),
                sides: predicate.sides.clone(),
                values: predicate.values.map(Into::into),
                robustness: predicate.robustness.into(),
                negated: predicate.is_negated,
            }),
            window: history.as_ref().map(violated_window),
            path: diagnosis.path.iter().map(step).collect(),
            conjuncts: conjuncts.iter().map(conjunct).collect(),
            sentences: self.sentences(&name).into_iter().chain(guard_sentence(trace, &name)).collect(),
            signals: diagnosis
                .predicate
                .as_ref()
                .map(|predicate| self.signal_table(formula, predicate, trace, unit)),
        }
    }

    /// Returns the formula's signals up to the decisive sample, at the instant that decides the
    /// formula, and at the end.
    fn signal_table(
        &self,
        formula: &str,
        predicate: &DecisivePredicate,
        trace: &Trace,
        unit: impl Fn(&str) -> String,
    ) -> SignalTable {
        let of = |text: &str| {
            Formula::parse(text).map(|formula| formula.signals().into_iter().map(str::to_string).collect())
        };
        let decisive: Vec<String> = of(&predicate.text).unwrap_or_default();
        let others: Vec<String> = of(formula).unwrap_or_default();
        let others = others.into_iter().filter(|name| !decisive.contains(name));
        let names = decisive.iter().cloned().chain(others).take(SIGNAL_COLUMNS);
        let columns: Vec<results::Signal> =
            names.map(|name| results::Signal { unit: unit(&name), name }).collect();
        let value = |signal: &results::Signal, sample: usize| {
            trace.signal(&signal.name).and_then(|values| values.get(sample)).map(|x| (*x).into())
        };
        let samples = shown_samples(predicate.sample, self.decided, trace.len());
        let rows = samples.into_iter().map(|sample| SignalRow {
            sample: sample as u64,
            values: columns.iter().map(|signal| value(signal, sample)).collect(),
        });
        SignalTable { rows: rows.collect(), columns }
    }
}

fn violated_window(history: &PredicateHistory) -> Window {
    Window {
        samples: [history.window.0 as u64, history.window.1 as u64],
        violated: history.violated.len() as u64,
        first_violated: history.violated.first().map(|first| *first as u64),
        last_violated: history.violated.last().map(|last| *last as u64),
    }
}

/// Returns the samples of the table: evenly spaced up to the decisive one and from there to the
/// end, and the instant that decides the formula.
fn shown_samples(decisive: usize, decided: Option<usize>, len: usize) -> Vec<usize> {
    let last = len.saturating_sub(1);
    let before = (0..ROWS_BEFORE).map(|i| decisive * i / (ROWS_BEFORE - 1));
    let after = (1..=ROWS_AFTER).map(|i| decisive + last.saturating_sub(decisive) * i / ROWS_AFTER);
    let mut samples: Vec<usize> = before.chain(after).chain(decided).collect();
    samples.sort_unstable();
    samples.dedup();
    samples
}
