//! A formula compiled to a list of instructions over numbered buffers.

use crate::clock::{Clock, Window};
use crate::error::MonitorError;
use crate::formula::{Formula, Node};
use crate::operator::Operator;
use crate::spelling::nearest;

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
        let mut compiler = Compiler::default();
        for node in &formula.nodes {
            match *node {
                Node::Constant(value) => compiler.push(Source::Constant(value), Some(0)),
                Node::Signal(signal) => {
                    compiler.push(Source::Place(Place::Column(columns[signal as usize].0)), Some(0));
                }
                Node::Apply(operator, interval) => {
                    compiler.apply(operator, clock.window(operator.name(), interval)?);
                }
            }
        }
        let (result, horizon) = compiler.pop();
        if !matches!(result, Source::Place(Place::Buffer(_))) {
            compiler.emit(Action::Load(result));
        }
        Ok(Program { instructions: compiler.instructions, buffers: compiler.buffers, columns, horizon })
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

/// Runs through a formula as a stack machine would, with the place and the horizon of each operand on the stack.
#[derive(Default)]
struct Compiler {
    instructions: Vec<Instruction>,
    stack: Vec<(Source, Option<usize>)>,
    free: Vec<usize>,
    buffers: usize,
}

impl Compiler {
    fn push(&mut self, source: Source, horizon: Option<usize>) {
        self.stack.push((source, horizon));
    }

    fn pop(&mut self) -> (Source, Option<usize>) {
        // A formula holds as many operands as its operators take, so the stack is never empty here.
        self.stack.pop().unwrap_or((Source::Constant(f64::NAN), None))
    }

    fn apply(&mut self, operator: Operator, window: Window) {
        let (last, last_horizon) = self.pop();
        if operator.arity() == 1 {
            let horizon = horizon(operator, window, last_horizon, Some(0));
            if operator.is_temporal() {
                let last = self.materialise(last);
                self.finish(Action::Along(operator, window, last), &[Source::Place(last)], horizon);
            } else {
                self.finish(Action::Map(operator, last), &[last], horizon);
            }
            return;
        }
        let (first, first_horizon) = self.pop();
        let horizon = horizon(operator, window, first_horizon, last_horizon);
        if operator.is_temporal() {
            let (first, last) = (self.materialise(first), self.materialise(last));
            let used = [Source::Place(first), Source::Place(last)];
            self.finish(Action::Between(operator, window, first, last), &used, horizon);
        } else {
            self.finish(Action::Zip(operator, first, last), &[first, last], horizon);
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
    fn finish(&mut self, action: Action, used: &[Source], horizon: Option<usize>) {
        let out = self.emit(action);
        for source in used {
            if let Source::Place(Place::Buffer(buffer)) = source {
                self.free.push(*buffer);
            }
        }
        self.push(Source::Place(Place::Buffer(out)), horizon);
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
