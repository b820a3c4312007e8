//! Formulas that a sample or window outside of the trace decides.

use std::sync::Arc;

use mishandle_stl::{Formula, Monitor, Trace, is_satisfied};

use super::Found;
use crate::describe::{Context, needed_on};
use crate::tree::{Tree, is_comparison, is_temporal, looks_ahead};

/// Traces longer than this are not tried, samples.
const MAX_SAMPLES: usize = 5_000;

/// Values of the signals that are tried.
const LEVELS: [f64; 3] = [1.0, -7.5, 30.0];

pub(super) fn find(tree: &Tree<'_>, context: &Context, found: &mut Found<'_>) {
    // What is read otherwise than meant comes first: as it is meant, other parts are left.
    if found.has_warning("precedence") || found.has_warning_at(tree.nodes.len() - 1) {
        return;
    }
    match Decided::of(tree.formula, context) {
        Some(decided) => decided.report(tree, found),
        None => neighbors(tree, context, found),
    }
}

/// A formula with the same infinite robustness on every trace, whatever its signals are.
struct Decided {
    is_satisfied: bool,
    /// The sub-formula that is infinite, and whether that is at the first samples of a trace.
    text: String,
    is_first: bool,
}

impl Decided {
    /// Tries traces of several values and of two lengths: an infinite robustness comes from a place
    /// outside of the trace, and then from it alone.
    fn of(formula: &Formula, context: &Context) -> Option<Decided> {
        let (samples, clock) = needed_on(formula, context)?;
        let names: Arc<[String]> = formula.signals().into_iter().map(str::to_owned).collect();
        let mut decided: Option<Decided> = None;
        for samples in [samples + 1, samples + 8] {
            if samples > MAX_SAMPLES || names.is_empty() {
                return None;
            }
            for level in LEVELS {
                let trace = constant(&names, level, samples);
                let diagnosis = formula.diagnose(&trace, &clock).ok()?;
                let robustness = Some(diagnosis.robustness()).filter(|value| value.is_infinite())?;
                let last = diagnosis.path.last()?;
                let is_satisfied = is_satisfied(robustness);
                if decided.as_ref().is_some_and(|known| known.is_satisfied != is_satisfied) {
                    return None;
                }
                let is_first = last.sample < samples - last.sample;
                decided = Some(Decided { is_satisfied, text: last.text.clone(), is_first });
            }
        }
        decided
    }

    fn report(&self, tree: &Tree<'_>, found: &mut Found<'_>) {
        let node = (0..tree.nodes.len()).rev().find(|node| tree.text(*node) == self.text);
        let node = node.unwrap_or(tree.nodes.len() - 1);
        let verb = if self.is_satisfied { "satisfies" } else { "violates" };
        let decides = format!("every trace {verb} the formula, whatever the values of its signals are");
        let name = tree.operator(node).unwrap_or_default();
        if tree.nodes[node].interval.is_some() {
            let instead = if looks_ahead(name) {
                "a window that begins at 0, or the setting `log.strict-horizon`, which uses whole windows only".to_owned()
            } else {
                let window = tree.window(node);
                let begin = window.trim_start_matches('[').split([':', ',']).next().unwrap_or_default();
                format!("a window from the first sample on that has a past, such as always[{begin}:inf](...)")
            };
            let end = if self.is_first { "first" } else { "last" };
            let why = format!("at the {end} sample of a trace, the window of `{name}` is empty: {decides}");
            return found.warn("window-beyond-the-end", node, why, Some(instead));
        }
        let Some(neighbor) =
            (0..=node).rev().find(|inner| is_neighbor(tree, *inner) && is_in(tree, *inner, node))
        else {
            return;
        };
        let name = tree.operator(neighbor).unwrap_or_default();
        let (place, instead) = if self.is_first {
            ("before the first", later(tree, node))
        } else {
            ("after the last", not_at_the_last())
        };
        let why = format!("`{name}` has no sample {place} one, and is infinite there: {decides}");
        found.warn("no-neighbor", neighbor, why, Some(instead));
    }
}

/// Advises a window from the first sample on that has all neighbors before it.
fn later(tree: &Tree<'_>, node: usize) -> String {
    let mut before = vec![0; node + 1];
    for inner in 0..=node {
        let nested = tree.nodes[inner].operands.iter().map(|operand| before[*operand]).max();
        let is_one = matches!(tree.operator(inner), Some("prev" | "s_prev"));
        before[inner] = nested.unwrap_or(0) + usize::from(is_one);
    }
    let mut around = node;
    while let Some(parent) = tree.parents[around].filter(|_| tree.operator(around) != Some("always")) {
        around = parent;
    }
    let what = match tree.nodes[around].operands[..] {
        [operand] if tree.operator(around) == Some("always") => tree.text(operand),
        _ => tree.text(node),
    };
    format!("a window from a later sample on, such as always[{}:inf]({what})", before[node])
}

fn not_at_the_last() -> String {
    "`prev` in a window from the second sample on, or the setting `log.strict-horizon`".to_owned()
}

fn is_neighbor(tree: &Tree<'_>, node: usize) -> bool {
    matches!(tree.operator(node), Some("prev" | "s_prev" | "next" | "s_next"))
}

/// Returns whether a node is a part of another one, or the same.
fn is_in(tree: &Tree<'_>, mut node: usize, whole: usize) -> bool {
    while node < whole {
        let Some(parent) = tree.parents[node] else { return false };
        node = parent;
    }
    node == whole
}

/// Returns a trace in which no signal changes.
fn constant(names: &Arc<[String]>, level: f64, samples: usize) -> Trace {
    let column = |signal: usize| vec![level + signal as f64; samples];
    Trace::from_columns(Arc::clone(names), (0..names.len()).map(column).collect())
}

/// Finds neighbors outside of the trace that make a comparison or a truth value as the formula does
/// not want it, where it is evaluated at the first or the last sample.
fn neighbors(tree: &Tree<'_>, context: &Context, found: &mut Found<'_>) {
    let is_number = tree.inside_numbers();
    let is_negated = tree.negated();
    let ends = Ends::new(tree);
    let mut is_reported = vec![false; tree.nodes.len()];
    for node in (0..tree.nodes.len()).filter(|node| is_neighbor(tree, *node)) {
        let name = tree.operator(node).unwrap_or_default();
        let mut decided = node;
        while let Some(parent) = tree.parents[decided].filter(|_| is_number[decided]) {
            decided = parent;
        }
        let is_first = name.ends_with("prev");
        let is_reached = if is_first { ends.first[decided] } else { ends.last[decided] };
        if !is_reached || std::mem::replace(&mut is_reported[decided], true) {
            continue;
        }
        let text = tree.text(decided);
        let place = if is_first { "before the first" } else { "after the last" };
        let instead = if is_first { later(tree, decided) } else { not_at_the_last() };
        if is_number[node] {
            let fails = if is_negated[decided] { f64::INFINITY } else { f64::NEG_INFINITY };
            let is_compared = tree.operator(decided).is_some_and(is_comparison);
            if !is_compared || infinite_value(tree, context, decided, is_first) != Some(fails) {
                continue;
            }
            let why = format!(
                "`{name}` has no sample {place} one, and is infinite there: this decides `{text}`, whatever the values of \
                 the signals are"
            );
            let add = if is_first { Found::warn } else { Found::note };
            add(found, "no-neighbor", node, why, Some(instead));
        } else if is_negated[node] != name.starts_with("s_") {
            let holds = if is_negated[node] { "holds" } else { "fails" };
            let why =
                format!("`{name}` has no sample {place} one, and {holds} there, whatever its operand is");
            found.note("no-neighbor", node, why, Some(instead));
        }
    }
}

/// Returns the value of a comparison at the first or last sample, if it is the same infinity on
/// several traces.
fn infinite_value(tree: &Tree<'_>, context: &Context, comparison: usize, is_first: bool) -> Option<f64> {
    let formula = tree.formula.at_node(comparison);
    let names: Arc<[String]> = formula.signals().into_iter().map(str::to_owned).collect();
    let mut monitor = Monitor::new(&formula, &names, context.clock()).ok()?;
    let mut value = |level: f64| {
        let values = monitor.robustness_signal(&constant(&names, level, 3)).ok()?;
        let value = if is_first { values.first() } else { values.last() };
        value.copied().filter(|value| value.is_infinite())
    };
    let found = value(LEVELS[0])?;
    LEVELS.into_iter().all(|level| value(level) == Some(found)).then_some(found)
}

/// Whether each node is evaluated at the first and at the last sample of each trace, under
/// operators that require all samples.
struct Ends {
    first: Vec<bool>,
    last: Vec<bool>,
}

impl Ends {
    fn new(tree: &Tree<'_>) -> Ends {
        let is_negated = tree.negated();
        let mut first = vec![true; tree.nodes.len()];
        let mut last = vec![false; tree.nodes.len()];
        for node in (0..tree.nodes.len()).rev() {
            let Some(parent) = tree.parents[node] else { continue };
            let name = tree.operator(parent).unwrap_or_default();
            let begins_now = tree.nodes[parent].interval.is_none_or(|[begin, _]| begin.value == 0.0);
            let requires_all = if is_negated[parent] {
                matches!(name, "eventually" | "once")
            } else {
                matches!(name, "always" | "historically")
            };
            (first[node], last[node]) = match name {
                "always" | "eventually" if requires_all => {
                    (first[parent] && begins_now, tree.is_unbounded(parent))
                }
                "historically" | "once" if requires_all => {
                    (first[parent] && begins_now, last[parent] && begins_now)
                }
                _ if is_temporal(name) || matches!(name, "iff" | "xor") => (false, false),
                _ => (first[parent], last[parent]),
            };
        }
        Ends { first, last }
    }
}
