//! The compiler: a formula to state formulas and a list of instructions over numbered buffers.

use crate::clock::{Clock, Window};
use crate::error::MonitorError;
use crate::extremum;
use crate::formula::{Formula, Node};
use crate::name::split_name;
use crate::operator::Operator;
use crate::spelling::nearest;
use crate::state::{State, TILE};
use crate::subformula::Reach;
use crate::until;
use std::ops::Range;

/// An operand of a pointwise operator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Source {
    Constant(f64),
    /// A buffer of the monitor.
    Buffer(usize),
}

/// One operator applied to all samples.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Action {
    /// Evaluates a state formula, by its index.
    State(usize),
    /// A pointwise operator with an operand that is not a state formula. A unary one has its
    /// operand twice.
    Pointwise(Operator, [Source; 2]),
    /// A unary temporal operator.
    TemporalUnary(Operator, Window),
    /// A binary temporal operator, and the buffer of its left operand, whose values are lost.
    TemporalBinary(Operator, Window, usize),
}

/// An action and the buffer for its result. It is the buffer of an operand, which is replaced, so
/// that long traces take little memory.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Instruction {
    pub action: Action,
    pub buffer: usize,
    /// The samples that a trace must have around t to decide the result at t.
    pub reach: Reach,
    /// The number of samples at the end of a trace at which the operands are not decided, or not
    /// needed for a decided result. Without these samples, no window of an operand is cut.
    pub undecided: usize,
    /// The same for the left operand of `unless`, which can hold on later samples than those of
    /// `until`.
    pub held: usize,
}

/// A compiled formula; the last instruction computes its robustness.
#[derive(Clone, Debug)]
pub(crate) struct Program {
    pub instructions: Vec<Instruction>,
    /// The state formulas that are operands of other operators, or the whole formula.
    pub states: Vec<State>,
    /// The number of buffers that the instructions use.
    pub buffers: usize,
    /// The columns and names of the signals that the formula reads.
    pub columns: Vec<(usize, String)>,
    /// The samples around t that the value at t depends on.
    pub reach: Reach,
    /// The sub-formulas that are not part of a state formula, in the order in which their values
    /// are computed.
    pub subformulas: Vec<Subformula>,
}

/// The location of a sub-formula's values, and the time at which they are there, since buffers are
/// reused.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Subformula {
    pub values: Source,
    /// The values are valid after this number of instructions, until the next one.
    pub instructions: usize,
    /// The samples around t that a trace must have to decide the sub-formula at t.
    pub reach: Reach,
    /// The index in the list of sub-formulas.
    pub index: usize,
}

impl Program {
    /// Resolves signals to columns and intervals to samples, and assigns a buffer to every
    /// intermediate result.
    pub(crate) fn compile(
        formula: &Formula,
        names: &[String],
        clock: &Clock,
    ) -> Result<Program, MonitorError> {
        clock.check()?;
        let columns = columns(formula, names)?;
        let mut listed = vec![None; formula.nodes.len()];
        for (index, node) in formula.listed_nodes().into_iter().enumerate() {
            listed[node] = Some(index);
        }
        let mut compiler = Compiler {
            formula,
            columns: &columns,
            listed: &listed,
            is_bare: &formula.bare_numbers(),
            instructions: Vec::new(),
            states: Vec::new(),
            subformulas: Vec::new(),
            stack: Vec::new(),
            free: Vec::new(),
            buffers: 0,
        };
        for (node, kind) in formula.nodes.iter().enumerate() {
            match *kind {
                Node::Apply(operator, interval) => {
                    compiler.apply(node, operator, clock.window(operator.name(), interval)?);
                }
                _ => compiler.push(Values::State(node..node + 1), Reach::default()),
            }
        }
        let Operand { values, reach } = compiler.pop();
        compiler.materialize(values);
        let Compiler { instructions, states, subformulas, buffers, .. } = compiler;
        Ok(Program { instructions, states, buffers, columns, reach, subformulas })
    }

    /// Returns whether an unbounded window contains operands that read later samples. Their windows
    /// are cut at the end of every trace.
    pub(crate) fn cuts_operands(&self) -> bool {
        self.instructions.iter().any(|instruction| {
            let window = match instruction.action {
                Action::TemporalUnary(Operator::Always | Operator::Eventually, window)
                | Action::TemporalBinary(
                    Operator::Until | Operator::Release | Operator::Unless,
                    window,
                    ..,
                ) => window,
                _ => return false,
            };
            window.is_unbounded() && instruction.undecided.max(instruction.held) > 0
        })
    }

    /// Returns the number of scratch values that the instructions need for traces of `samples`
    /// samples.
    pub(crate) fn scratch_len(&self, samples: usize) -> usize {
        let needed = |instruction: &Instruction| match instruction.action {
            Action::State(_) => 0,
            Action::Pointwise(..) => TILE.min(samples),
            Action::TemporalUnary(Operator::Always | Operator::Eventually, window) => {
                extremum::ahead_scratch_len(window, samples)
            }
            Action::TemporalUnary(_, window) => extremum::behind_scratch_len(window, samples),
            Action::TemporalBinary(Operator::Unless, window, _) => {
                let held = Window { begin: 0, ..window };
                let ahead = extremum::ahead_scratch_len(held, samples);
                samples + ahead.max(until::scratch_len(window, samples))
            }
            Action::TemporalBinary(_, window, _) => until::scratch_len(window, samples),
        };
        self.instructions.iter().map(needed).max().unwrap_or(0)
    }

    /// Returns the buffer that contains the robustness after the last instruction.
    pub(crate) fn result(&self) -> usize {
        self.instructions.last().map_or(0, |instruction| instruction.buffer)
    }
}

/// Returns the columns and names of the signals that the formula reads.
pub(crate) fn columns(formula: &Formula, names: &[String]) -> Result<Vec<(usize, String)>, MonitorError> {
    if let Some(definition) = formula.defined.iter().find(|definition| names.contains(&definition.name)) {
        return Err(MonitorError::ShadowsSignal { name: definition.name.clone() });
    }
    if let Some((operator, letter)) =
        formula.letters().find(|(_, letter)| names.iter().any(|name| name == letter))
    {
        return Err(MonitorError::LetterIsSignal {
            letter: letter.to_owned(),
            operator: operator.name().to_owned(),
        });
    }
    formula.signals.iter().map(|name| column(name, &formula.signals, names)).collect()
}

/// Returns the column of one of the signals of a formula, with its name.
fn column(signal: &str, signals: &[String], names: &[String]) -> Result<(usize, String), MonitorError> {
    match names.iter().position(|name| name == signal) {
        Some(index) => Ok((index, signal.to_owned())),
        None => Err(MonitorError::UnknownSignal {
            signal: signal.to_owned(),
            known: names.to_vec(),
            nearest: split_name(signal, signals, names)
                .or_else(|| nearest(signal, names.iter().map(String::as_str)))
                .map(str::to_owned),
        }),
    }
}

/// The values of an operand.
#[derive(Clone, Debug)]
enum Values {
    /// Those of the state formula of these nodes, which is not compiled yet.
    State(Range<usize>),
    /// Those in a buffer.
    Buffer(usize),
}

/// An operand on the stack of the compiler.
struct Operand {
    values: Values,
    reach: Reach,
}

/// Translates postfix nodes to instructions with a stack of operands.
struct Compiler<'a> {
    formula: &'a Formula,
    columns: &'a [(usize, String)],
    /// The index of each node in the list of sub-formulas.
    listed: &'a [Option<usize>],
    is_bare: &'a [bool],
    instructions: Vec<Instruction>,
    states: Vec<State>,
    subformulas: Vec<Subformula>,
    stack: Vec<Operand>,
    free: Vec<usize>,
    buffers: usize,
}

impl Compiler<'_> {
    fn push(&mut self, values: Values, reach: Reach) {
        self.stack.push(Operand { values, reach });
    }

    fn pop(&mut self) -> Operand {
        // The parser guarantees the operands of every operator, so the stack is never empty here.
        let missing = Operand { values: Values::State(0..0), reach: Reach::default() };
        self.stack.pop().unwrap_or(missing)
    }

    fn apply(&mut self, node: usize, operator: Operator, window: Window) {
        let last = self.pop();
        let first = if operator.arity() == 2 { Some(self.pop()) } else { None };
        if !operator.is_temporal() {
            let begin = match (&first, &last.values) {
                (None, Values::State(nodes)) => Some(nodes.start),
                (Some(Operand { values: Values::State(first), .. }), Values::State(_)) => Some(first.start),
                _ => None,
            };
            if let Some(begin) = begin {
                return self.push(Values::State(begin..node + 1), Reach::default());
            }
        }
        let first_reach = first.as_ref().map_or(last.reach, |first| first.reach);
        let reach = Reach::of(operator, window, first_reach, last.reach);
        let undecided = undecided(operator, window, first_reach, last.reach, reach);
        let (action, buffer) = if operator.is_temporal() {
            let left = first.map(|first| self.materialize(first.values));
            let buffer = self.materialize(last.values);
            self.free.extend(left);
            match left {
                Some(left) => (Action::TemporalBinary(operator, window, left), buffer),
                None => (Action::TemporalUnary(operator, window), buffer),
            }
        } else {
            let left = first.map(|first| self.operand(first.values));
            let last = self.operand(last.values);
            let operands = [left.unwrap_or(last), last];
            let buffer = match operands {
                [Source::Buffer(left), Source::Buffer(last)] if left != last => {
                    self.free.push(last);
                    left
                }
                [Source::Buffer(buffer), _] | [_, Source::Buffer(buffer)] => buffer,
                // Not reached: operators of constants are state formulas.
                _ => self.allocate(),
            };
            (Action::Pointwise(operator, operands), buffer)
        };
        let held = if operator == Operator::Unless { first_reach.ahead } else { 0 };
        self.instructions.push(Instruction { action, buffer, reach, undecided, held });
        self.list(node, Source::Buffer(buffer), reach);
        self.push(Values::Buffer(buffer), reach);
    }

    /// Adds a node to the sub-formulas, if it is one.
    fn list(&mut self, node: usize, values: Source, reach: Reach) {
        let instructions = self.instructions.len();
        let listed = self.listed[node].map(|index| Subformula { values, instructions, reach, index });
        self.subformulas.extend(listed);
    }

    /// Returns an operand of a pointwise operator: a constant, or else a buffer.
    fn operand(&mut self, values: Values) -> Source {
        if let Values::State(nodes) = &values
            && let [Node::Constant(value)] = self.formula.nodes[nodes.clone()]
        {
            self.list(nodes.start, Source::Constant(value), Reach::default());
            return Source::Constant(value);
        }
        Source::Buffer(self.materialize(values))
    }

    /// Returns the buffer of an operand; a state formula is evaluated into one.
    fn materialize(&mut self, values: Values) -> usize {
        match values {
            Values::Buffer(buffer) => buffer,
            Values::State(nodes) => {
                let state = State::compile(self.formula, nodes, self.columns, self.listed, self.is_bare);
                let action = Action::State(self.states.len());
                self.states.push(state);
                let buffer = self.allocate();
                let reach = Reach::default();
                self.instructions.push(Instruction { action, buffer, reach, undecided: 0, held: 0 });
                buffer
            }
        }
    }

    /// Returns a free buffer: the one freed last, if any, since it is likely to be in the cache.
    fn allocate(&mut self) -> usize {
        self.free.pop().unwrap_or_else(|| {
            self.buffers += 1;
            self.buffers - 1
        })
    }
}

/// Returns [`Instruction::undecided`] of an operator with an operand of reach `first` and one of
/// reach `last` (the same for a unary operator), whose result has the reach `result`.
pub(crate) fn undecided(
    operator: Operator,
    window: Window,
    first: Reach,
    last: Reach,
    result: Reach,
) -> usize {
    match operator {
        Operator::Until | Operator::Release if window.end == 0 => last.ahead,
        // The left operand is not evaluated at the last sample.
        Operator::Until | Operator::Release | Operator::Unless => {
            last.ahead.max(first.ahead.saturating_sub(1))
        }
        Operator::Always | Operator::Eventually | Operator::Next | Operator::StrongNext => {
            first.ahead.max(last.ahead)
        }
        // These operators read no later samples of their operands.
        _ => result.ahead,
    }
}
