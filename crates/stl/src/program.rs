//! A formula compiled to a list of instructions over numbered buffers.

use crate::clock::{Clock, Window};
use crate::error::MonitorError;
use crate::formula::{Formula, Node};
use crate::operator::Operator;
use crate::spelling::nearest;
use crate::subformula::Reach;

/// Where the values of an operand lie.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Place {
    /// A signal of the trace.
    Column(usize),
    /// A buffer of the monitor.
    Buffer(usize),
}

/// An operand of an operator that looks at one sample at a time.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Source {
    Constant(f64),
    Place(Place),
}

/// One operator applied to all samples.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Action {
    /// Copies the operand.
    Load(Source),
    Map(Operator, Source),
    Zip(Operator, Source, Source),
    /// A temporal operator of one operand.
    Along(Operator, Window, Place),
    /// A temporal operator of two operands.
    Between(Operator, Window, Place, Place),
}

/// An action and the buffer that its result fills, which is none of its operands'.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Instruction {
    pub action: Action,
    pub out: usize,
}

/// The instructions of a formula; the last one computes its robustness.
#[derive(Clone, Debug)]
pub(crate) struct Program {
    pub instructions: Vec<Instruction>,
    /// How many buffers the instructions name.
    pub buffers: usize,
    /// The signals read: their columns and names.
    pub columns: Vec<(usize, String)>,
    /// Samples past t that the value at t depends on.
    pub horizon: Option<usize>,
    /// The sub-formulas, in the order in which their values are computed.
    pub subformulas: Vec<Subformula>,
}

/// Where the values of a sub-formula are, and when: buffers are used again.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Subformula {
    pub values: Source,
    /// The values are there after this many instructions, and before the next one.
    pub instructions: usize,
    /// The samples that a trace must have around t to cover it.
    pub reach: Reach,
    /// Its index in the list of sub-formulas.
    pub index: usize,
}

impl Program {
    /// Resolves signals to columns and intervals to samples, and gives every intermediate result a buffer.
    pub(crate) fn compile(
        formula: &Formula,
        names: &[String],
        clock: &Clock,
    ) -> Result<Program, MonitorError> {
        clock.check()?;
        if let Some(name) = formula.defined.iter().find(|name| names.contains(name)) {
            return Err(MonitorError::HidesSignal { name: name.clone() });
        }
        let columns =
            formula.signals.iter().map(|name| column(name, names)).collect::<Result<Vec<_>, _>>()?;
        let mut indices = vec![None; formula.nodes.len()];
        for (index, node) in formula.listed_nodes().into_iter().enumerate() {
            indices[node] = Some(index);
        }
        let mut compiler = Compiler::default();
        let mut subformulas = Vec::new();
        for (node, index) in formula.nodes.iter().zip(indices) {
            match *node {
                Node::Constant(value) => compiler.push_leaf(Source::Constant(value)),
                Node::Signal(signal) => {
                    compiler.push_leaf(Source::Place(Place::Column(columns[signal as usize].0)));
                }
                Node::Apply(operator, interval) => {
                    compiler.apply(operator, clock.window(operator.name(), interval)?);
                }
            }
            if let (Some(index), Some(top)) = (index, compiler.stack.last()) {
                let instructions = compiler.instructions.len();
                subformulas.push(Subformula { values: top.source, instructions, reach: top.reach, index });
            }
        }
        let Operand { source: result, horizon, .. } = compiler.pop();
        if !matches!(result, Source::Place(Place::Buffer(_))) {
            compiler.emit(Action::Load(result));
        }
        let Compiler { instructions, buffers, .. } = compiler;
        Ok(Program { instructions, buffers, columns, horizon, subformulas })
    }

    /// The buffer that holds the robustness at the end.
    pub(crate) fn result(&self) -> usize {
        self.instructions.last().map_or(0, |instruction| instruction.out)
    }
}

/// The column of the signal `wanted`, with its name.
fn column(wanted: &str, names: &[String]) -> Result<(usize, String), MonitorError> {
    match names.iter().position(|name| name == wanted) {
        Some(index) => Ok((index, wanted.to_owned())),
        None => Err(MonitorError::UnknownSignal {
            wanted: wanted.to_owned(),
            known: names.to_vec(),
            nearest: nearest(wanted, names.iter().map(String::as_str)).map(str::to_owned),
        }),
    }
}

/// An operand that waits for its operator.
#[derive(Clone, Copy)]
struct Operand {
    source: Source,
    horizon: Option<usize>,
    reach: Reach,
}

/// Runs through a formula as a stack machine would.
#[derive(Default)]
struct Compiler {
    instructions: Vec<Instruction>,
    stack: Vec<Operand>,
    free: Vec<usize>,
    buffers: usize,
}

impl Compiler {
    fn push_leaf(&mut self, source: Source) {
        self.stack.push(Operand { source, horizon: Some(0), reach: Reach::default() });
    }

    fn pop(&mut self) -> Operand {
        // A formula holds as many operands as its operators take, so the stack is never empty here.
        let missing = Operand { source: Source::Constant(f64::NAN), horizon: None, reach: Reach::default() };
        self.stack.pop().unwrap_or(missing)
    }

    fn apply(&mut self, operator: Operator, window: Window) {
        let last = self.pop();
        if operator.arity() == 1 {
            let result = |source| Operand {
                source,
                horizon: horizon(operator, window, last.horizon, Some(0)),
                reach: Reach::of(operator, window, last.reach, last.reach),
            };
            if operator.is_temporal() {
                let x = self.materialise(last.source);
                self.finish(Action::Along(operator, window, x), &[Source::Place(x)], result);
            } else {
                self.finish(Action::Map(operator, last.source), &[last.source], result);
            }
            return;
        }
        let first = self.pop();
        let result = |source| Operand {
            source,
            horizon: horizon(operator, window, first.horizon, last.horizon),
            reach: Reach::of(operator, window, first.reach, last.reach),
        };
        if operator.is_temporal() {
            let (x, y) = (self.materialise(first.source), self.materialise(last.source));
            let used = [Source::Place(x), Source::Place(y)];
            self.finish(Action::Between(operator, window, x, y), &used, result);
        } else {
            let used = [first.source, last.source];
            self.finish(Action::Zip(operator, first.source, last.source), &used, result);
        }
    }

    /// The place of an operand; a constant gets a buffer of its own.
    fn materialise(&mut self, source: Source) -> Place {
        match source {
            Source::Place(place) => place,
            Source::Constant(_) => Place::Buffer(self.emit(Action::Load(source))),
        }
    }

    /// Emits an action, frees the buffers of its operands and pushes its result.
    fn finish(&mut self, action: Action, used: &[Source], result: impl FnOnce(Source) -> Operand) {
        let out = self.emit(action);
        for source in used {
            if let Source::Place(Place::Buffer(buffer)) = source {
                self.free.push(*buffer);
            }
        }
        self.stack.push(result(Source::Place(Place::Buffer(out))));
    }

    /// Emits an action into a free buffer, the one used last if there is any, since it is likely to be in the cache.
    fn emit(&mut self, action: Action) -> usize {
        let out = self.free.pop().unwrap_or_else(|| {
            self.buffers += 1;
            self.buffers - 1
        });
        self.instructions.push(Instruction { action, out });
        out
    }
}

/// Samples past t that an operator's value at t depends on, from those of its operands; `None` is all there are.
fn horizon(operator: Operator, window: Window, first: Option<usize>, last: Option<usize>) -> Option<usize> {
    let later = |horizon: Option<usize>, by: usize| match (horizon, by) {
        (None, _) | (_, usize::MAX) => None,
        (Some(horizon), by) => Some(horizon.saturating_add(by)),
    };
    let earlier = |horizon: Option<usize>, by: usize| horizon.map(|horizon| horizon.saturating_sub(by));
    let furthest = |a: Option<usize>, b: Option<usize>| Some(a?.max(b?));
    match operator {
        Operator::Always | Operator::Eventually => later(first, window.end),
        Operator::Historically | Operator::Once => earlier(first, window.begin),
        Operator::Next | Operator::StrongNext => later(first, 1),
        Operator::Previous | Operator::StrongPrevious => earlier(first, 1),
        // The operand on the left is not needed at the end of the window itself.
        Operator::Until | Operator::Release if window.end == 0 => last,
        Operator::Until | Operator::Release if window.end == usize::MAX => None,
        Operator::Until | Operator::Release => {
            furthest(later(first, window.end - 1), later(last, window.end))
        }
        Operator::Unless => furthest(later(first, window.end), later(last, window.end)),
        Operator::Since if window.end == 0 => last,
        Operator::Since => furthest(first, earlier(last, window.begin)),
        _ => furthest(first, last),
    }
}
