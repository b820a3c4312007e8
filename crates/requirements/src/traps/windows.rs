//! Windows: without a sample, of one sample, between samples, without an end, and longer than the
//! episode.

use mishandle_stl::{SyntaxBound, SyntaxKind, SyntaxNode};
use mishandle_text::{number_text, plural, short_number};

use super::Found;
use crate::describe::{Context, needed};
use crate::tree::{Tree, is_ahead, seconds};

/// The relative distance from a whole number of samples that a monitor accepts.
const WHOLE: f64 = 1e-9;

/// The end of a window, in samples, up to which a window without a unit could be meant in seconds.
const FEW_SAMPLES: f64 = 10.0;

/// A period below which a window of few samples is shorter than most requirements, s.
const FAST: f64 = 0.05;

pub(super) fn find(tree: &Tree<'_>, context: &Context, found: &mut Found<'_>) {
    let mut fits = true;
    for (index, node) in tree.nodes.iter().enumerate() {
        if let Some([begin, end]) = node.interval {
            fits &= window(tree, context, index, [begin, end], found);
        }
    }
    open_ends(tree, found);
    if fits {
        horizon(tree, context, found);
    }
}

fn whole(samples: f64) -> Option<f64> {
    let whole = samples.round();
    ((samples - whole).abs() <= WHOLE * whole).then_some(whole)
}

/// Checks a window. Returns whether a monitor accepts it.
fn window(
    tree: &Tree<'_>,
    context: &Context,
    node: usize,
    [begin, end]: [SyntaxBound; 2],
    found: &mut Found<'_>,
) -> bool {
    let name = tree.operator(node).unwrap_or_default();
    if end.value == 0.0 {
        found.warn(
            "one-sample-window",
            node,
            format!("the window of `{name}` is one sample, the current one: `{name}` has no effect"),
            Some("a window with an end after 0, such as [0:2s], or no window at all".to_owned()),
        );
        return true;
    }
    let in_samples = |bound: SyntaxBound| match seconds(bound, context.unit) {
        Some(secs) if bound.value.is_finite() => context.period.map(|period| secs / period),
        _ => Some(bound.value),
    };
    let (Some(first), Some(last)) = (in_samples(begin), in_samples(end)) else { return true };
    let is_whole = |samples: f64| samples.is_infinite() || whole(samples).is_some();
    let counts = seconds(end, context.unit).is_none();
    let has_seconds = |node: &SyntaxNode<'_>| node.interval.is_some_and(|[_, end]| end.unit.is_some());
    if counts && end.value.is_finite() && tree.nodes.iter().any(has_seconds) {
        found.warn(
            "samples-not-seconds",
            node,
            "bounds without a unit count samples, and other windows of the formula have a unit".to_owned(),
            Some(format!("[{}s:{}s] for seconds", number_text(begin.value), number_text(end.value))),
        );
        return is_whole(first) && is_whole(last);
    }
    if is_whole(first) && is_whole(last) {
        let period = context.period.filter(|period| *period < FAST);
        if let Some(period) = period
            && counts
            && last > first
            && last <= FEW_SAMPLES
        {
            found.note(
                "samples-not-seconds",
                node,
                format!(
                    "bounds without a unit count samples: {} are {} s",
                    plural(last as u64, "sample"),
                    short_number(last * period)
                ),
                Some(format!("[{}s:{}s] for seconds", number_text(begin.value), number_text(end.value))),
            );
        }
        return true;
    }
    if counts {
        found.warn(
            "samples-not-seconds",
            node,
            format!(
                "bounds without a unit count samples, and {} is not a whole number",
                number_text(if is_whole(first) { end.value } else { begin.value })
            ),
            Some(format!("[{}s:{}s] for seconds", number_text(begin.value), number_text(end.value))),
        );
        return false;
    }
    let period = context.period.unwrap_or(f64::NAN);
    let [low, high] = [first.ceil(), last.floor()];
    let round = |samples: f64| number_text((samples * period * 1e9).round() / 1e9);
    if low > high {
        found.warn(
            "window-without-sample",
            node,
            format!("no sample is inside of the window: the samples are {} s apart", short_number(period)),
            Some(format!("[{}s:{}s], which contains two samples", round(first.floor()), round(last.ceil()))),
        );
    } else {
        found.warn(
            "bound-between-samples",
            node,
            format!(
                "the window is {} to {} samples of {} s; a monitor accepts whole numbers only",
                short_number(first),
                short_number(last),
                short_number(period)
            ),
            Some(format!("[{}s:{}s], the samples inside of it", round(low), round(high))),
        );
    }
    false
}

/// Finds `eventually` and `until` without an end, and windows that reach beyond the end of the
/// trace at the last samples.
fn open_ends(tree: &Tree<'_>, found: &mut Found<'_>) {
    let is_open_always = |node: usize| tree.operator(node) == Some("always") && tree.is_unbounded(node);
    let mut below = vec![false; tree.nodes.len()];
    let is_negated = tree.negated();
    for node in (0..tree.nodes.len()).rev() {
        let Some(parent) = tree.parents[node] else { continue };
        below[node] = below[parent] || is_open_always(parent);
    }
    for (index, node) in tree.nodes.iter().enumerate() {
        let SyntaxKind::Operator(name) = node.kind else { continue };
        let is_existential = matches!(name, "eventually" | "until");
        let is_open = tree.is_unbounded(index);
        if is_existential && is_open && !is_negated[index] {
            let target = tree.text(*node.operands.last().unwrap_or(&index));
            if below[index] {
                found.warn(
                    "unbounded-eventually",
                    index,
                    format!(
                        "`{name}` has no deadline: the end of the trace is the deadline, so {target} may come any time \
                         later, and a trace that ends before it violates the formula"
                    ),
                    Some(format!("a deadline, such as {name}[0:2s]")),
                );
            } else {
                found.warn(
                    "unbounded-eventually",
                    index,
                    format!(
                        "`{name}` has no deadline: the verdict depends on how long the trace is, and a longer one can \
                         satisfy what this one violates"
                    ),
                    Some(format!("a deadline, such as {name}[0:10s]")),
                );
            }
        }
    }
    if found.has_warning("window-beyond-the-end") {
        return;
    }
    // The outermost window comes after its operands.
    let is_cut = |node: &usize| below[*node] && is_bounded_ahead(tree, *node);
    if let Some(outermost) = (0..tree.nodes.len()).rev().find(is_cut) {
        beyond_the_end(tree, outermost, &is_negated, found);
    }
}

fn is_bounded_ahead(tree: &Tree<'_>, node: usize) -> bool {
    tree.operator(node).is_some_and(is_ahead) && !tree.is_unbounded(node)
}

/// Says what the end of a trace does to a window and to those inside of it.
fn beyond_the_end(tree: &Tree<'_>, outermost: usize, is_negated: &[bool], found: &mut Found<'_>) {
    let name = tree.operator(outermost).unwrap_or_default();
    let Some([_, end]) = tree.nodes[outermost].interval else { return };
    // Windows inside of others reach further.
    let mut reach = vec![0.0_f64; outermost + 1];
    let mut is_inside = vec![false; outermost + 1];
    is_inside[outermost] = true;
    for node in (0..outermost).rev() {
        is_inside[node] = tree.parents[node].is_some_and(|parent| parent <= outermost && is_inside[parent]);
    }
    let mut misses = false;
    let mut fails = false;
    for node in (0..=outermost).filter(|node| is_inside[*node]) {
        let inner = tree.nodes[node].operands.iter().map(|operand| reach[*operand]).fold(0.0, f64::max);
        let own = tree.nodes[node].interval.filter(|_| is_bounded_ahead(tree, node));
        // Another unit cannot be added without the sampling period.
        let own_end = own.filter(|[_, own]| own.unit == end.unit).map_or(0.0, |[_, own]| own.value);
        reach[node] = inner + own_end;
        if own.is_some() {
            let is_existential = matches!(tree.operator(node), Some("eventually" | "until"));
            *(if is_existential == is_negated[node] { &mut misses } else { &mut fails }) = true;
        }
    }
    let reach = reach[outermost];
    let length = match end.unit {
        Some(unit) => format!("{} {unit}", number_text(reach)),
        None => plural(reach as u64, "sample"),
    };
    let outcome = match (misses, fails) {
        (true, true) => "a verdict at the end may be wrong in either direction",
        (true, false) => "a violation after the end of the trace is not seen",
        (false, _) => {
            "a condition shortly before the end of the trace violates the formula if the response would come after it"
        }
    };
    found.note(
        "window-beyond-the-end",
        outermost,
        format!("in the last {length} of a trace, the window of `{name}` is cut at its end: {outcome}"),
        Some("the setting `log.strict-horizon`, which uses whole windows only".to_owned()),
    );
}

/// Compares the horizon with the length of the episode or of the log.
fn horizon(tree: &Tree<'_>, context: &Context, found: &mut Found<'_>) {
    history(tree, context, found);
    let Some(needed) = needed(tree.formula, context) else { return };
    let root = tree.nodes.len() - 1;
    let secs = |samples: usize| context.period.map(|period| samples.saturating_sub(1) as f64 * period);
    let episode = context.episode_secs.or_else(|| secs(context.samples?));
    let is_longer = match (needed.samples, context.samples, needed.secs, episode) {
        (Some(needed), Some(samples), ..) => needed > samples,
        // Up to the rounding of the number of samples.
        (_, _, Some(needed), Some(episode)) => needed > episode * (1.0 + WHOLE),
        _ => return,
    };
    if !is_longer {
        return;
    }
    let length = match (needed.secs, episode) {
        (Some(needed), Some(episode)) => {
            format!("{} s of a trace, and it has {} s", short_number(needed), short_number(episode))
        }
        _ => format!(
            "{} of a trace, and it has {}",
            plural(needed.samples.unwrap_or(0) as u64, "sample"),
            context.samples.unwrap_or(0)
        ),
    };
    found.warn(
        "horizon-beyond-episode",
        root,
        format!("the windows need {length}: they are cut at its end, and the verdict is one about a shorter window"),
        Some("shorter windows, or a longer episode".to_owned()),
    );
}

/// Compares windows over the past with the length of the episode or of the log.
fn history(tree: &Tree<'_>, context: &Context, found: &mut Found<'_>) {
    let secs = |samples: usize| context.period.map(|period| samples.saturating_sub(1) as f64 * period);
    let Some(episode) = context.episode_secs.or_else(|| secs(context.samples?)) else { return };
    for (index, node) in tree.nodes.iter().enumerate() {
        let Some([_, end]) = node.interval.filter(|[_, end]| end.value.is_finite()) else {
            continue;
        };
        let own = seconds(end, context.unit).or_else(|| Some(end.value * context.period?));
        let Some(own) = own.filter(|own| *own > episode * (1.0 + WHOLE)) else { continue };
        let Some(name @ ("historically" | "once" | "since")) = tree.operator(index) else {
            continue;
        };
        found.warn(
            "horizon-beyond-episode",
            index,
            format!(
                "the window of `{name}` is {} s of the past, and a trace has {} s: it is cut at the start of the trace at every \
                 sample",
                short_number(own),
                short_number(episode)
            ),
            Some("a shorter window, or a longer episode".to_owned()),
        );
    }
}
