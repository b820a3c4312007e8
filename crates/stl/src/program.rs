//! The compiler: a formula to a list of instructions over numbered buffers.

use crate::clock::{Clock, Window};
use crate::error::MonitorError;
use crate::formula::{Formula, Node};
use crate::operator::Operator;
use crate::spelling::nearest;
use crate::subformula::Reach;

/// The location of an operand's values.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Location {
    /// A signal of the trace.
    Column(usize),
    /// A buffer of the monitor.
    Buffer(usize),
}

/// An operand of a pointwise operator.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Source {
    Constant(f64),
    Location(Location),
}

/// One operator applied to all samples.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Action {
    /// Copies the operand.
    Load(Source),
    Map(Operator, Source),
    Zip(Operator, Source, Source),
    /// A unary temporal operator.
    TemporalUnary(Operator, Window, Location),
    /// A binary temporal operator.
    TemporalBinary(Operator, Window, Location, Location),
}

/// An action and the buffer for its result, which differs from the buffers of its operands.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Instruction {
    pub action: Action,
    pub out: usize,
}

/// A compiled formula; the last instruction computes its robustness.
#[derive(Clone, Debug)]
pub(crate) struct Program {
    pub instructions: Vec<Instruction>,
    /// The number of buffers that the instructions use.
    pub buffers: usize,
    /// The columns and names of the signals that the formula reads.
    pub columns: Vec<(usize, String)>,
    /// The number of samples after t that the value at t depends on; `None` if unbounded.
    pub horizon: Option<usize>,
    /// The sub-formulas in the order in which their values are computed.
    pub subformulas: Vec<Subformula>,
}

/// The location of a sub-formula's values, and the time at which they are there, since buffers are reused.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Subformula {
    pub values: Source,
    /// The values are valid after this number of instructions, until the next one.
    pub instructions: usize,
    /// The samples around t that a trace must have to cover the sub-formula at t.
    pub reach: Reach,
    /// The index in the list of sub-formulas.
    pub index: usize,
}

impl Program {
    /// Resolves signals to columns and intervals to samples, and assigns a buffer to every intermediate result.
    pub(crate) fn compile(
        formula: &Formula,
        names: &[String],
        clock: &Clock,
    ) -> Result<Program, MonitorError> {
        clock.check()?;
        if let Some(name) = formula.defined.iter().find(|name| names.contains(name)) {
            return Err(MonitorError::ShadowsSignal { name: name.clone() });
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
                    compiler.push_leaf(Source::Location(Location::Column(columns[signal as usize].0)));
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
        if !matches!(result, Source::Location(Location::Buffer(_))) {
            compiler.emit(Action::Load(result));
        }
        let Compiler { instructions, buffers, .. } = compiler;
        Ok(Program { instructions, buffers, columns, horizon, subformulas })
    }

    /// Returns the buffer that contains the robustness after the last instruction.
    pub(crate) fn result(&self) -> usize {
        self.instructions.last().map_or(0, |instruction| instruction.out)
    }
}

/// Returns the column of the signal, with its name.
fn column(signal: &str, names: &[String]) -> Result<(usize, String), MonitorError> {
    match names.iter().position(|name| name == signal) {
        Some(index) => Ok((index, signal.to_owned())),
        None => Err(MonitorError::UnknownSignal {
            signal: signal.to_owned(),
            known: names.to_vec(),
            nearest: nearest(signal, names.iter().map(String::as_str)).map(str::to_owned),
        }),
    }
}

/// An operand on the stack of the compiler.
#[derive(Clone, Copy)]
struct Operand {
    source: Source,
    horizon: Option<usize>,
    reach: Reach,
}

/// Translates postfix nodes to instructions with a stack of operands.
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
        // The parser guarantees the operands of every operator, so the stack is never empty here.
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
                let x = self.materialize(last.source);
                self.finish(Action::TemporalUnary(operator, window, x), &[Source::Location(x)], result);
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
            let (x, y) = (self.materialize(first.source), self.materialize(last.source));
            let used = [Source::Location(x), Source::Location(y)];
            self.finish(Action::TemporalBinary(operator, window, x, y), &used, result);
        } else {
            let used = [first.source, last.source];
            self.finish(Action::Zip(operator, first.source, last.source), &used, result);
        }
    }

    /// Returns the location of an operand; a constant is loaded into a buffer.
    fn materialize(&mut self, source: Source) -> Location {
        match source {
            Source::Location(place) => place,
            Source::Constant(_) => Location::Buffer(self.emit(Action::Load(source))),
        }
    }

    /// Emits an action, frees the buffers of its operands and pushes its result.
    fn finish(&mut self, action: Action, used: &[Source], result: impl FnOnce(Source) -> Operand) {
        let out = self.emit(action);
        for source in used {
            if let Source::Location(Location::Buffer(buffer)) = source {
                self.free.push(*buffer);
            }
        }
        self.stack.push(result(Source::Location(Location::Buffer(out))));
    }

    /// Emits an action into a free buffer: the one freed last, if any, since it is likely to be in the cache.
    fn emit(&mut self, action: Action) -> usize {
        let out = self.free.pop().unwrap_or_else(|| {
            self.buffers += 1;
            self.buffers - 1
        });
        self.instructions.push(Instruction { action, out });
        out
    }
}

/// Returns the horizon of an operator given the horizons of its operands; `None` is unbounded.
fn horizon(operator: Operator, window: Window, first: Option<usize>, last: Option<usize>) -> Option<usize> {
    let later = |horizon: Option<usize>, by: usize| match (horizon, by) {
        (None, _) | (_, usize::MAX) => None,
        (Some(horizon), by) => Some(horizon.saturating_add(by)),
    };
    let earlier = |horizon: Option<usize>, by: usize| horizon.map(|horizon| horizon.saturating_sub(by));
    let max_horizon = |a: Option<usize>, b: Option<usize>| Some(a?.max(b?));
    match operator {
        Operator::Always | Operator::Eventually => later(first, window.end),
        Operator::Historically | Operator::Once => earlier(first, window.begin),
        Operator::Next | Operator::StrongNext => later(first, 1),
        Operator::Previous | Operator::StrongPrevious => earlier(first, 1),
        // The left operand is not evaluated at the last sample of the window.
        Operator::Until | Operator::Release if window.end == 0 => last,
        Operator::Until | Operator::Release if window.end == usize::MAX => None,
        Operator::Until | Operator::Release => {
            max_horizon(later(first, window.end - 1), later(last, window.end))
        }
        Operator::Unless => max_horizon(later(first, window.end), later(last, window.end)),
        Operator::Since if window.end == 0 => last,
        Operator::Since => max_horizon(first, earlier(last, window.begin)),
        _ => max_horizon(first, last),
    }
}
