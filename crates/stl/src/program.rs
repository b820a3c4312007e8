//! The compiler: a formula to a list of instructions over numbered buffers.

use crate::clock::{Clock, Window};
use crate::error::MonitorError;
use crate::extremum;
use crate::formula::{Formula, Node};
use crate::operator::Operator;
use crate::spelling::nearest;
use crate::subformula::Reach;
use crate::until;

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
    /// The samples that a trace must have around t to decide the result at t.
    pub reach: Reach,
    /// The number of samples at the end of a trace at which the operands are not decided, or not needed for a decided
    /// result. Without these samples, no window of an operand is cut.
    pub undecided: usize,
}

/// A compiled formula; the last instruction computes its robustness.
#[derive(Clone, Debug)]
pub(crate) struct Program {
    pub instructions: Vec<Instruction>,
    /// The number of buffers that the instructions use.
    pub buffers: usize,
    /// The columns and names of the signals that the formula reads.
    pub columns: Vec<(usize, String)>,
    /// The samples around t that the value at t depends on.
    pub reach: Reach,
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
        let Operand { source: result, reach } = compiler.pop();
        if !matches!(result, Source::Location(Location::Buffer(_))) {
            compiler.emit(Action::Load(result), reach, 0);
        }
        let Compiler { instructions, buffers, .. } = compiler;
        Ok(Program { instructions, buffers, columns, reach, subformulas })
    }

    /// Returns whether an unbounded window contains operands that read later samples. Their windows are cut at the end of
    /// every trace.
    pub(crate) fn cuts_operands(&self) -> bool {
        self.instructions.iter().any(|instruction| {
            let window = match instruction.action {
                Action::TemporalUnary(Operator::Always | Operator::Eventually, window, _)
                | Action::TemporalBinary(
                    Operator::Until | Operator::Release | Operator::Unless,
                    window,
                    ..,
                ) => window,
                _ => return false,
            };
            window.is_unbounded() && instruction.undecided > 0
        })
    }

    /// Returns the number of scratch values that the instructions need for traces of `samples` samples.
    pub(crate) fn scratch_len(&self, samples: usize) -> usize {
        let needed = |instruction: &Instruction| match instruction.action {
            Action::TemporalUnary(_, window, _) => extremum::scratch_len(window, samples),
            Action::TemporalBinary(..) => until::scratch_len(samples),
            _ => 0,
        };
        self.instructions.iter().map(needed).max().unwrap_or(0)
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
        self.stack.push(Operand { source, reach: Reach::default() });
    }

    fn pop(&mut self) -> Operand {
        // The parser guarantees the operands of every operator, so the stack is never empty here.
        let missing = Operand { source: Source::Constant(f64::NAN), reach: Reach::default() };
        self.stack.pop().unwrap_or(missing)
    }

    fn apply(&mut self, operator: Operator, window: Window) {
        let last = self.pop();
        let first = if operator.arity() == 1 { last } else { self.pop() };
        let reach = Reach::of(operator, window, first.reach, last.reach);
        let undecided = undecided(operator, window, first.reach, last.reach, reach);
        let (action, used) = match (operator.is_temporal(), operator.arity()) {
            (true, 1) => {
                let x = self.materialize(last.source);
                (Action::TemporalUnary(operator, window, x), [Source::Location(x), Source::Location(x)])
            }
            (true, _) => {
                let (x, y) = (self.materialize(first.source), self.materialize(last.source));
                (Action::TemporalBinary(operator, window, x, y), [Source::Location(x), Source::Location(y)])
            }
            (false, 1) => (Action::Map(operator, last.source), [last.source; 2]),
            (false, _) => (Action::Zip(operator, first.source, last.source), [first.source, last.source]),
        };
        let out = self.emit(action, reach, undecided);
        for source in &used[..operator.arity()] {
            if let Source::Location(Location::Buffer(buffer)) = source {
                self.free.push(*buffer);
            }
        }
        self.stack.push(Operand { source: Source::Location(Location::Buffer(out)), reach });
    }

    /// Returns the location of an operand; a constant is loaded into a buffer.
    fn materialize(&mut self, source: Source) -> Location {
        match source {
            Source::Location(place) => place,
            Source::Constant(_) => Location::Buffer(self.emit(Action::Load(source), Reach::default(), 0)),
        }
    }

    /// Emits an action into a free buffer: the one freed last, if any, since it is likely to be in the cache.
    fn emit(&mut self, action: Action, reach: Reach, undecided: usize) -> usize {
        let out = self.free.pop().unwrap_or_else(|| {
            self.buffers += 1;
            self.buffers - 1
        });
        self.instructions.push(Instruction { action, out, reach, undecided });
        out
    }
}

/// Returns [`Instruction::undecided`] of an operator with an operand of reach `first` and one of reach `last` (the same for
/// a unary operator), whose result has the reach `result`.
fn undecided(operator: Operator, window: Window, first: Reach, last: Reach, result: Reach) -> usize {
    match operator {
        Operator::Until | Operator::Release if window.end == 0 => last.ahead,
        // The left operand is not evaluated at the last sample.
        Operator::Until | Operator::Release => last.ahead.max(first.ahead.saturating_sub(1)),
        Operator::Always
        | Operator::Eventually
        | Operator::Unless
        | Operator::Next
        | Operator::StrongNext => first.ahead.max(last.ahead),
        // These operators read no later samples of their operands.
        _ => result.ahead,
    }
}
