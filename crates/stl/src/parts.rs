//! The parts of a robustness at time 0: numbers of which minima and maxima are made.

use crate::clock::{Clock, Window};
use crate::error::MonitorError;
use crate::extremum::{Extremum, Maximum, Minimum};
use crate::formula::{Formula, Node};
use crate::monitor::{Monitor, Samples, Windows};
use crate::operator::Operator;
use crate::pointwise::Values;
use crate::subformula::Reach;
use crate::trace::Trace;

/// The most time windows of one sub-formula.
const WINDOWS: usize = 4;
/// The deepest operator that is split.
const DEPTH: usize = 16;

/// A tree of minima and maxima.
#[derive(Clone, Debug, PartialEq)]
pub enum Composition {
    /// The part with this index.
    Part(usize),
    /// The least of some values.
    Min(Vec<Composition>),
    /// The greatest of some values.
    Max(Vec<Composition>),
}

/// How minima and maxima of parts compose the robustness of a formula at time 0.
///
/// The formula is split at `and`, `or`, `not` and `implies`, at the `always` and `eventually` above
/// them, and below such an operator at those that have the same extremum: `always(p and q)` is
/// `always p and always q`. What remains are sub-formulas over windows of time. Each window is
/// split into a few shorter ones, and a part is the extremum of the sub-formula over one of these.
///
/// # Example
/// ```
/// use mishandle_stl::Composition::{Max, Min, Part};
/// use mishandle_stl::{Clock, Formula};
///
/// let formula = Formula::parse("always[0:9](a <= 1) -> always[0:3](b >= 0)").unwrap();
/// // Four parts are two windows for each signal. The premise is negated, so it has maxima.
/// let decomposition = formula.decompose(&Clock::steps(0.1), 11, 4).unwrap();
/// let (a, b) = (Max(vec![Part(0), Part(1)]), Min(vec![Part(2), Part(3)]));
/// assert_eq!(*decomposition.composition(), Max(vec![a, b]));
/// assert_eq!(decomposition.ends().collect::<Vec<_>>(), [4, 9, 1, 3]);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Decomposition {
    parts: Vec<FormulaPart>,
    composition: Composition,
}

/// The extremum of a sub-formula over a range of samples.
#[derive(Clone, Copy, Debug, PartialEq)]
struct FormulaPart {
    leaf: usize,
    /// The index in the list of sub-formulas.
    subformula: usize,
    is_negated: bool,
    is_least: bool,
    first: usize,
    /// The last sample of the window, and that of the whole window of the sub-formula.
    last: usize,
    whole: Last,
    /// The last sample that the part depends on.
    end: usize,
}

/// The last sample of a window.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Last {
    At(usize),
    /// This many samples before the end of the trace.
    BeforeEnd(usize),
}

impl Last {
    fn later(self, samples: usize) -> Last {
        match self {
            Last::At(last) => Last::At(last.saturating_add(samples)),
            Last::BeforeEnd(before) => Last::BeforeEnd(before.saturating_sub(samples)),
        }
    }

    /// Returns the number of samples of a trace up to the last one.
    fn samples(self, trace: usize) -> usize {
        match self {
            Last::At(last) => trace.min(last.saturating_add(1)),
            Last::BeforeEnd(before) => trace.saturating_sub(before),
        }
    }
}

/// The operator over time around a sub-formula.
#[derive(Clone, Copy)]
struct Around {
    is_least: bool,
    first: usize,
    last: Last,
}

impl Around {
    /// Returns the window of an operator with the same extremum inside this one.
    fn inside(around: Option<Around>, is_least: bool, window: Window, operand: Reach) -> Around {
        let (first, last) = around.map_or((0, Last::At(0)), |around| (around.first, around.last));
        let last =
            if window.is_unbounded() { Last::BeforeEnd(operand.ahead) } else { last.later(window.end) };
        Around { is_least, first: first.saturating_add(window.begin), last }
    }
}

/// A sub-formula that is not split further.
struct Leaf {
    node: usize,
    is_negated: bool,
    around: Option<Around>,
}

/// The operands of a formula's tree.
struct Splitter<'a> {
    formula: &'a Formula,
    starts: Vec<usize>,
    windows: Vec<Window>,
    reaches: Vec<Reach>,
    leaves: Vec<Leaf>,
}

impl Splitter<'_> {
    /// Splits a node; the indices in the tree are those of leaves.
    fn split(&mut self, node: usize, is_negated: bool, around: Option<Around>, depth: usize) -> Composition {
        let last = node.saturating_sub(1);
        if let (Node::Apply(operator, _), true) = (self.formula.nodes[node], depth > 0) {
            let fits = |is_least: bool| around.is_none_or(|around| around.is_least == is_least);
            let is_least = matches!(operator, Operator::And | Operator::Always) != is_negated;
            match operator {
                Operator::Not => return self.split(last, !is_negated, around, depth - 1),
                Operator::And | Operator::Or | Operator::Implies if fits(is_least) => {
                    let first = self.starts[last] - 1;
                    let flips = operator == Operator::Implies;
                    let operands = vec![
                        self.split(first, is_negated != flips, around, depth - 1),
                        self.split(last, is_negated, around, depth - 1),
                    ];
                    return if is_least { Composition::Min(operands) } else { Composition::Max(operands) };
                }
                Operator::Always | Operator::Eventually if fits(is_least) => {
                    let window = self.windows[node];
                    let operand = self.reaches[last];
                    let around = Around::inside(around, is_least, window, operand);
                    return self.split(last, is_negated, Some(around), depth - 1);
                }
                _ => {}
            }
        }
        self.leaves.push(Leaf { node, is_negated, around });
        Composition::Part(self.leaves.len() - 1)
    }
}

impl Formula {
    /// Returns how at most `most` parts, or one per sub-formula if that is more, compose the
    /// robustness at time 0 on traces of at most `samples` samples.
    ///
    /// # Errors
    /// If the sampling period is not positive and finite, or an interval bound is not a whole
    /// number of samples.
    pub fn decompose(
        &self,
        clock: &Clock,
        samples: usize,
        most: usize,
    ) -> Result<Decomposition, MonitorError> {
        clock.check()?;
        let mut windows = Vec::new();
        let mut reaches = Vec::new();
        let mut operands = Vec::<Reach>::new();
        for node in &self.nodes {
            let mut window = Window { begin: 0, end: 0 };
            let mut reach = Reach::default();
            if let Node::Apply(operator, interval) = *node {
                let last = operands.pop().unwrap_or_default();
                let first = if operator.arity() == 2 { operands.pop().unwrap_or_default() } else { last };
                if operator.takes_interval() {
                    window = clock.window(operator.name(), interval)?;
                }
                reach = Reach::of(operator, window, first, last);
            }
            operands.push(reach);
            windows.push(window);
            reaches.push(reach);
        }
        let leaves = Vec::new();
        let mut splitter = Splitter { formula: self, starts: self.starts(), windows, reaches, leaves };
        let mut depth = DEPTH;
        let composition = loop {
            splitter.leaves.clear();
            let composition = splitter.split(self.nodes.len() - 1, false, None, depth);
            if depth == 0 || splitter.leaves.len() <= most {
                break composition;
            }
            depth -= 1;
        };
        let listed = self.listed_nodes();
        let per_leaf = (most / splitter.leaves.len()).clamp(1, WINDOWS);
        let mut decomposition = Decomposition { parts: Vec::new(), composition: Composition::Part(0) };
        let of_leaf: Vec<Composition> = splitter
            .leaves
            .iter()
            .enumerate()
            .map(|(index, leaf)| {
                let subformula = listed.iter().position(|node| *node == leaf.node).unwrap_or_default();
                decomposition.add(index, leaf, subformula, splitter.reaches[leaf.node], samples, per_leaf)
            })
            .collect();
        decomposition.composition = with_windows(composition, &of_leaf);
        Ok(decomposition)
    }
}

/// Replaces leaves by the trees of their windows.
fn with_windows(tree: Composition, of_leaf: &[Composition]) -> Composition {
    let all = |operands: Vec<Composition>| operands.into_iter().map(|x| with_windows(x, of_leaf)).collect();
    match tree {
        Composition::Part(leaf) => of_leaf[leaf].clone(),
        Composition::Min(operands) => Composition::Min(all(operands)),
        Composition::Max(operands) => Composition::Max(all(operands)),
    }
}

impl Decomposition {
    /// Returns how the parts compose the robustness.
    pub fn composition(&self) -> &Composition {
        &self.composition
    }

    /// Returns for each part the number of its sub-formula. Parts of one sub-formula are its
    /// extrema in several windows.
    pub fn leaves(&self) -> impl ExactSizeIterator<Item = usize> {
        self.parts.iter().map(|part| part.leaf)
    }

    /// Returns for each part the last sample that it depends on.
    pub fn ends(&self) -> impl ExactSizeIterator<Item = usize> {
        self.parts.iter().map(|part| part.end)
    }

    /// Adds the parts of a leaf: at most `windows`.
    fn add(
        &mut self,
        index: usize,
        leaf: &Leaf,
        subformula: usize,
        reach: Reach,
        samples: usize,
        windows: usize,
    ) -> Composition {
        let around = leaf.around.unwrap_or(Around { is_least: true, first: 0, last: Last::At(0) });
        let end = around.last.samples(samples).max(around.first + 1);
        let length = end - around.first;
        let windows = windows.min(length);
        let indices = (0..windows).map(|window| {
            let at = |window: usize| around.first + window * length / windows;
            let is_final = window + 1 == windows;
            let last = if is_final { usize::MAX } else { at(window + 1) - 1 };
            let reached =
                if reach.is_unbounded { samples } else { at(window + 1).saturating_add(reach.ahead) };
            self.parts.push(FormulaPart {
                leaf: index,
                subformula,
                is_negated: leaf.is_negated,
                is_least: around.is_least,
                first: at(window),
                last,
                whole: around.last,
                end: reached.min(samples).saturating_sub(1),
            });
            Composition::Part(self.parts.len() - 1)
        });
        let indices: Vec<Composition> = indices.collect();
        match (indices.as_slice(), around.is_least) {
            ([only], _) => only.clone(),
            (_, true) => Composition::Min(indices),
            (_, false) => Composition::Max(indices),
        }
    }
}

impl FormulaPart {
    /// Returns the value of no samples.
    fn neutral(&self) -> f64 {
        if self.is_least { Minimum::NEUTRAL } else { Maximum::NEUTRAL }
    }

    fn with(&self, value: f64, sample: f64) -> f64 {
        let sample = if self.is_negated { -sample } else { sample };
        if self.is_least { Minimum::pick(value, sample) } else { Maximum::pick(value, sample) }
    }
}

impl Monitor {
    /// Returns the parts of the robustness at time 0, in the order of the decomposition; `None` if
    /// the trace does not decide the formula there. It must be a decomposition of the formula of
    /// the monitor.
    ///
    /// They compose the first value of [`Monitor::decided_robustness_signal`]. A part whose window
    /// is after the end of the trace is +∞ as a minimum, −∞ as a maximum.
    ///
    /// # Errors
    /// As for [`Monitor::decided_robustness_signal`].
    ///
    /// # Example
    /// ```
    /// use std::sync::Arc;
    /// use mishandle_stl::{Clock, Formula, Monitor, Trace};
    ///
    /// let formula = Formula::parse("always[0:3](a <= 1)").unwrap();
    /// let names: Arc<[String]> = Arc::from(["a".to_owned()]);
    /// let mut monitor = Monitor::new(&formula, &names, Clock::steps(1.0)).unwrap();
    /// let mut trace = Trace::new(names);
    /// [0.0, 0.5, 0.25, 2.0].iter().for_each(|a| trace.push(&[*a]));
    /// let halves = formula.decompose(&Clock::steps(1.0), 4, 2).unwrap();
    /// assert_eq!(monitor.parts(&trace, &halves).unwrap(), Some(vec![0.5, -1.0]));
    /// ```
    pub fn parts(
        &mut self,
        trace: &Trace,
        decomposition: &Decomposition,
    ) -> Result<Option<Vec<f64>>, MonitorError> {
        let parts = &decomposition.parts;
        let mut values: Vec<f64> = parts.iter().map(FormulaPart::neutral).collect();
        let all = trace.len();
        let mut samples = Samples::Trace(trace, 0..all);
        self.run(&mut samples, Windows::Whole, |subformula, found, known| {
            for (part, value) in
                parts.iter().zip(&mut values).filter(|(part, _)| part.subformula == subformula)
            {
                let first = part.first.max(known.start);
                let end = part.whole.samples(all).min(part.last.saturating_add(1)).min(known.end).max(first);
                match found {
                    Values::Signal(signal) if first < end => {
                        let window = &signal[first - known.start..end - known.start];
                        *value = window.iter().fold(*value, |value, sample| part.with(value, *sample));
                    }
                    Values::Constant(constant) if first < end => *value = part.with(*value, constant),
                    _ => {}
                }
            }
        })?;
        Ok((self.decided_samples(all) > 0).then_some(values))
    }
}
