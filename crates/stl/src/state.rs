//! State formulas: formulas whose value at a sample depends on that sample only. They are evaluated
//! tile by tile, so that intermediate results take no memory in proportion to the trace and stay in
//! the L1 cache.

use crate::formula::{Formula, Node};
use crate::operator::Operator;
use crate::pointwise::{self, Undefined, Values};
use crate::trace::Trace;
use std::ops::Range;

/// The number of samples of a tile.
pub(crate) const TILE: usize = 1024;

/// Splits `samples` samples into tiles.
pub(crate) fn tiles(samples: usize) -> impl Iterator<Item = Range<usize>> {
    (0..samples).step_by(TILE).map(move |begin| begin..samples.min(begin + TILE))
}

/// An operand.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Source {
    Constant(f64),
    /// A signal of the trace.
    Column(usize),
    /// A buffer for one tile.
    Buffer(usize),
}

/// A pointwise operator, its operands (the same twice for a unary one), and the buffer for its
/// result, which differs from those of its operands.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Step {
    operator: Operator,
    operands: [Source; 2],
    out: usize,
}

/// A sub-formula in the list of [`Formula::subformulas`].
#[derive(Clone, Copy, Debug, PartialEq)]
struct Listed {
    source: Source,
    /// The values are valid after this number of steps.
    steps: usize,
    /// The index in the list.
    index: usize,
}

/// A compiled state formula.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct State {
    steps: Vec<Step>,
    result: Source,
    listed: Vec<Listed>,
}

/// The buffers of a tile.
#[derive(Clone, Debug, Default)]
pub(crate) struct Buffers(Vec<Vec<f64>>);

impl Buffers {
    /// Returns enough buffers for each of these formulas.
    pub(crate) fn of(states: &[State]) -> Buffers {
        let needed = states.iter().flat_map(|state| &state.steps).map(|step| step.out + 1).max();
        Buffers(vec![vec![0.0; TILE]; needed.unwrap_or(0)])
    }
}

impl State {
    /// Compiles the sub-formula of these nodes. `columns` has the column of each signal, `listed`
    /// the index of each node in the list of sub-formulas, and `is_bare` which nodes are [bare
    /// numbers](Formula::bare_numbers).
    pub(crate) fn compile(
        formula: &Formula,
        nodes: Range<usize>,
        columns: &[(usize, String)],
        listed: &[Option<usize>],
        is_bare: &[bool],
    ) -> State {
        let mut state = State { steps: Vec::new(), result: Source::Constant(f64::NAN), listed: Vec::new() };
        let mut stack = Vec::new();
        let mut free = Vec::new();
        let mut buffers = 0;
        for node in nodes {
            let mut source = match formula.nodes[node] {
                Node::Constant(value) => Source::Constant(value),
                Node::Signal(signal) => Source::Column(columns[signal as usize].0),
                Node::Apply(operator, _) => {
                    let operands: Vec<Source> = stack.split_off(stack.len() - operator.arity());
                    let out = free.pop().unwrap_or(buffers);
                    buffers = buffers.max(out + 1);
                    free.extend(operands.iter().filter_map(|operand| match operand {
                        Source::Buffer(buffer) => Some(*buffer),
                        _ => None,
                    }));
                    let operands = [operands[0], operands[operands.len() - 1]];
                    state.steps.push(Step { operator, operands, out });
                    Source::Buffer(out)
                }
            };
            if is_bare[node] {
                // The robustness of `x` is that of `x >= 0`, in which the sign of a zero is the
                // verdict.
                let operands = [source, Source::Constant(0.0)];
                let out = free.pop().unwrap_or(buffers);
                buffers = buffers.max(out + 1);
                if let Source::Buffer(buffer) = source {
                    free.push(buffer);
                }
                state.steps.push(Step { operator: Operator::GreaterOrEqual, operands, out });
                source = Source::Buffer(out);
            }
            if let Some(index) = listed[node] {
                state.listed.push(Listed { source, steps: state.steps.len(), index });
            }
            state.result = source;
            stack.push(source);
        }
        state
    }

    /// Evaluates the formula at the samples `tile` of the trace, and calls `visit` with the index
    /// and the values of each sub-formula.
    ///
    /// # Errors
    /// If arithmetic has no value at a sample.
    pub(crate) fn evaluate(
        &self,
        trace: &Trace,
        tile: Range<usize>,
        buffers: &mut Buffers,
        out: &mut [f64],
        mut visit: impl FnMut(usize, Values<'_>),
    ) -> Result<(), Undefined> {
        let operands = Operands { trace, tile };
        let mut listed = self.listed.as_slice();
        for (done, step) in self.steps.iter().enumerate() {
            while let Some((first, rest)) = listed.split_first().filter(|(first, _)| first.steps == done) {
                visit(first.index, operands.values(first.source, buffers));
                listed = rest;
            }
            // Moved out, so that the other buffers can be read while this one is written.
            let mut values = std::mem::take(&mut buffers.0[step.out]);
            let is_last = done + 1 == self.steps.len();
            let to = if is_last { &mut *out } else { &mut values[..out.len()] };
            let [x, y] = step.operands.map(|source| operands.values(source, buffers));
            let result = pointwise::apply(step.operator, x, y, to);
            buffers.0[step.out] = values;
            result.map_err(|undefined| undefined.after(operands.tile.start))?;
        }
        if self.steps.is_empty() {
            match operands.values(self.result, buffers) {
                Values::Constant(value) => out.fill(value),
                Values::Signal(values) => out.copy_from_slice(values),
            }
        }
        // The last step wrote its result to `out`, and only the whole formula is listed after it.
        listed.iter().for_each(|listed| visit(listed.index, Values::Signal(out)));
        Ok(())
    }
}

/// The samples that a step reads.
struct Operands<'a> {
    trace: &'a Trace,
    tile: Range<usize>,
}

impl Operands<'_> {
    fn values<'a>(&'a self, source: Source, buffers: &'a Buffers) -> Values<'a> {
        match source {
            Source::Constant(value) => Values::Constant(value),
            Source::Column(column) => Values::Signal(&self.trace.column(column)[self.tile.clone()]),
            Source::Buffer(buffer) => Values::Signal(&buffers.0[buffer][..self.tile.len()]),
        }
    }
}
