//! Checks expressions and makes programs of them.

use std::collections::HashMap;
use std::ops::Range;

use crate::expression::functions::{FUNCTIONS, Function, find};
use crate::expression::program::{Operation, Place, Program, Reader, step};
use crate::expression::{ExpressionError, Node, NodeKind};

/// Largest number of numbers of a program.
const MAX_MEMORY: usize = 1_000_000;

/// Largest number of definitions that use each other in a chain: each of them is compiled again
/// wherever an expression starts.
const MAX_CHAIN: usize = 100;

/// The size of a quantity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Size {
    /// A number.
    Number,
    /// A vector of this length.
    Vector(usize),
    /// A list whose length may change; only a reduction such as `max` can use it.
    List,
}

/// A quantity that a program reads.
#[derive(Clone, Debug, PartialEq)]
pub struct Reading<R> {
    /// The quantity.
    pub what: R,
    /// Its size.
    pub size: Size,
}

/// An argument of a function that reads a quantity.
#[derive(Clone, Debug, PartialEq)]
pub enum Argument {
    /// A name without quotation marks.
    Name(String),
    /// A quoted text.
    Text(String),
    /// Numbers that do not change.
    Numbers(Vec<f64>),
}

/// Meaning of a name.
#[derive(Clone, Debug, PartialEq)]
pub enum Meaning<R> {
    /// A number that does not change.
    Number(f64),
    /// A vector that does not change.
    Vector(Vec<f64>),
    /// A quantity.
    Reading(Reading<R>),
    /// Another expression, whose errors have its own spans.
    Definition(Node),
}

/// The names that expressions may use, besides the functions of the language.
pub trait Names<R> {
    /// Returns the meaning of a name, or an error without a position.
    ///
    /// # Errors
    /// If the name is unknown; the message may suggest others.
    fn name(&self, name: &str) -> Result<Meaning<R>, String>;

    /// Returns whether a function reads a quantity: then [`call`](Self::call) says which one.
    fn reads(&self, function: &str) -> bool;

    /// Returns the quantity that a call reads.
    ///
    /// # Errors
    /// If the arguments do not fit.
    fn call(&self, function: &str, arguments: &[Argument]) -> Result<Reading<R>, String>;

    /// Returns the expression that a call stands for, if the function is defined by others.
    ///
    /// # Errors
    /// If the number of arguments does not fit.
    fn definition(&self, _function: &str, _arguments: &[Node]) -> Result<Option<NodeKind>, String> {
        Ok(None)
    }

    /// Returns the names of all functions that read quantities, for messages.
    fn functions(&self) -> Vec<String>;
}

/// Returns name, arguments and meaning of each function of the language, without operators.
pub fn functions() -> impl Iterator<Item = (&'static str, &'static str, &'static str)> {
    FUNCTIONS
        .iter()
        .filter(|entry| !entry.arguments.is_empty())
        .map(|entry| (entry.name, entry.arguments, entry.meaning))
}

/// Makes a program of expressions.
///
/// # Example
/// ```
/// use mishandle_robots::expression::*;
///
/// /// A pendulum with the angle 0.5 rad.
/// struct Pendulum;
/// impl Names<&'static str> for Pendulum {
///     fn name(&self, name: &str) -> Result<Meaning<&'static str>, String> {
///         match name {
///             "length" => Ok(Meaning::Number(2.0)),
///             "angle" => Ok(Meaning::Reading(Reading { what: "angle", size: Size::Number })),
///             _ => Err(format!("unknown name `{name}`")),
///         }
///     }
///     fn reads(&self, _: &str) -> bool { false }
///     fn call(&self, _: &str, _: &[Argument]) -> Result<Reading<&'static str>, String> { Err(String::new()) }
///     fn functions(&self) -> Vec<String> { vec![] }
/// }
/// impl Reader<&'static str> for Pendulum {
///     fn read(&mut self, _: &&'static str, out: &mut [f64]) { out[0] = 0.5 }
///     fn list(&mut self, _: &&'static str, _: &mut dyn FnMut(f64)) {}
/// }
///
/// let mut compiler = Compiler::new();
/// let height = compiler.add(&parse("length * (1 - cos(angle))")?, &Pendulum)?;
/// let program = compiler.program();
/// let mut memory = program.memory();
/// program.run(&mut memory, &mut Pendulum);
/// assert_eq!(value(&memory, &height), [2.0 * (1.0 - 0.5f64.cos())]);
/// # Ok::<(), ExpressionError>(())
/// ```
pub struct Compiler<R> {
    program: Program<R>,
    /// Which numbers of the memory are constants.
    constant: Vec<bool>,
    /// Values of names and of quantities that were used before.
    names: HashMap<String, Place>,
    /// Names whose definitions are being compiled.
    open: Vec<String>,
}

impl<R: PartialEq> Default for Compiler<R> {
    fn default() -> Compiler<R> {
        Compiler::new()
    }
}

/// A checked part of an expression.
enum Part<R> {
    Value(Place),
    List(R),
}

impl<R: PartialEq> Compiler<R> {
    /// Makes a compiler of an empty program.
    pub fn new() -> Compiler<R> {
        let program = Program { steps: Vec::new(), memory: Vec::new() };
        Compiler { program, constant: Vec::new(), names: HashMap::new(), open: Vec::new() }
    }

    /// Adds an expression and returns the place of its value.
    ///
    /// # Errors
    /// If a name or a function is unknown, or the sizes of vectors do not fit.
    pub fn add(&mut self, node: &Node, names: &dyn Names<R>) -> Result<Place, ExpressionError> {
        match self.part(node, names)? {
            Part::Value(place) => Ok(place),
            Part::List(_) => {
                Err(error(node, "a list whose length may change needs a reduction such as `max` or `sum`"))
            }
        }
    }

    /// Returns the value of a place if it does not change.
    pub fn constant(&self, place: &Place) -> Option<&[f64]> {
        let is_constant = self.constant[place.range()].iter().all(|constant| *constant);
        is_constant.then(|| &self.program.memory[place.range()])
    }

    /// Returns the program of all added expressions.
    pub fn program(self) -> Program<R> {
        self.program
    }

    fn part(&mut self, node: &Node, names: &dyn Names<R>) -> Result<Part<R>, ExpressionError> {
        let place = match &node.kind {
            NodeKind::Number(value) => self.store(&[*value], None),
            NodeKind::Text(text) => {
                return Err(error(
                    node,
                    format!(
                        "the text '{text}' is not a number; only functions that read quantities take texts"
                    ),
                ));
            }
            NodeKind::Name(name) => return self.name(name, node, names),
            NodeKind::Call(name, arguments) if names.reads(name) => {
                let definition = names.definition(name, arguments).map_err(|message| error(node, message))?;
                if let Some(kind) = definition {
                    return self.part(&Node { kind, span: node.span.clone() }, names);
                }
                let arguments = arguments.iter().map(|argument| self.argument(argument, names));
                let arguments = arguments.collect::<Result<Vec<_>, _>>()?;
                let reading = names.call(name, &arguments).map_err(|message| error(node, message))?;
                return self.reading(reading, node);
            }
            NodeKind::Call(name, arguments) => self.call(name, arguments, node, names)?,
            NodeKind::List(parts) => self.list(parts, node, names)?,
            NodeKind::Index(vector, index) => {
                let place = self.vector(vector, names)?;
                let index = self.integer(index, place.size(), names)?;
                if index >= place.size() {
                    let message = format!("the index {index} is outside of the {} numbers", place.size());
                    return Err(error(node, message));
                }
                Place { start: place.start + index, length: None }
            }
            NodeKind::Slice(vector, first, end) => {
                let place = self.vector(vector, names)?;
                let size = place.size();
                let mut bound = |bound: &Option<Box<Node>>, default| match bound {
                    Some(node) => self.integer(node, size, names),
                    None => Ok(default),
                };
                let first = bound(first, 0)?;
                let end = bound(end, size)?;
                if first >= end || end > size {
                    let message =
                        format!("the range {first}:{end} is empty or outside of the {size} numbers");
                    return Err(error(node, message));
                }
                Place { start: place.start + first, length: Some(end - first) }
            }
        };
        if self.program.memory.len() > MAX_MEMORY {
            return Err(error(node, format!("the expressions have more than {MAX_MEMORY} numbers")));
        }
        Ok(Part::Value(place))
    }

    fn name(&mut self, name: &str, node: &Node, names: &dyn Names<R>) -> Result<Part<R>, ExpressionError> {
        if let Some(place) = self.names.get(name) {
            return Ok(Part::Value(place.clone()));
        }
        let meaning = names.name(name).map_err(|message| error(node, message))?;
        let place = match meaning {
            Meaning::Number(value) => self.store(&[value], None),
            Meaning::Vector(values) => self.store(&values, Some(values.len())),
            Meaning::Reading(reading) => return self.reading(reading, node),
            Meaning::Definition(definition) => {
                if self.open.iter().any(|open| open == name) {
                    return Err(error(node, format!("the definition of `{name}` uses itself")));
                }
                if self.open.len() >= MAX_CHAIN {
                    let message = format!("more than {MAX_CHAIN} definitions use each other in a chain");
                    return Err(error(node, message));
                }
                self.open.push(name.to_string());
                let place = self
                    .add(&definition, names)
                    .map_err(|error| error.in_definition(name, node.span.clone()));
                self.open.pop();
                place?
            }
        };
        self.names.insert(name.to_string(), place.clone());
        Ok(Part::Value(place))
    }

    fn argument(&mut self, node: &Node, names: &dyn Names<R>) -> Result<Argument, ExpressionError> {
        match &node.kind {
            NodeKind::Text(text) => Ok(Argument::Text(text.clone())),
            NodeKind::Name(name) => Ok(Argument::Name(name.clone())),
            _ => {
                let place = self.add(node, names)?;
                let values = self.constant(&place);
                let values =
                    values.ok_or_else(|| error(node, "this argument must not change during an episode"))?;
                Ok(Argument::Numbers(values.to_vec()))
            }
        }
    }

    fn reading(&mut self, reading: Reading<R>, node: &Node) -> Result<Part<R>, ExpressionError> {
        let length = match reading.size {
            Size::List => return Ok(Part::List(reading.what)),
            Size::Number => None,
            Size::Vector(length) => Some(length),
        };
        let known = self.program.steps.iter().find(|(operation, place)| {
            matches!(operation, Operation::Read(what) if *what == reading.what) && place.length == length
        });
        if let Some((_, place)) = known {
            return Ok(Part::Value(place.clone()));
        }
        if length == Some(0) {
            return Err(error(node, "this has no numbers"));
        }
        Ok(Part::Value(self.push(Operation::Read(reading.what), length)))
    }

    /// Returns the value of a vector.
    fn vector(&mut self, node: &Node, names: &dyn Names<R>) -> Result<Place, ExpressionError> {
        let place = self.add(node, names)?;
        if place.is_number() {
            return Err(error(node, "a number has no parts; an index needs a vector"));
        }
        Ok(place)
    }

    /// Returns an index, which must not change; a negative one counts from the end.
    fn integer(&mut self, node: &Node, size: usize, names: &dyn Names<R>) -> Result<usize, ExpressionError> {
        let place = self.add(node, names)?;
        let value = self.constant(&place).filter(|values| values.len() == 1).map(|values| values[0]);
        let value = value.ok_or_else(|| error(node, "an index must be a number that does not change"))?;
        let counted = if value < 0.0 { value + size as f64 } else { value };
        if counted.fract() != 0.0 || counted < 0.0 || counted > size as f64 {
            return Err(error(node, format!("{value} is not an index of {size} numbers")));
        }
        Ok(counted as usize)
    }

    fn list(
        &mut self,
        parts: &[(bool, Node)],
        node: &Node,
        names: &dyn Names<R>,
    ) -> Result<Place, ExpressionError> {
        let mut places = Vec::new();
        for (expands, part) in parts {
            let place = self.add(part, names)?;
            if !expands && !place.is_number() {
                let message = "a list holds numbers; write `*` before a vector to insert its numbers";
                return Err(error(part, message));
            }
            places.push(place);
        }
        let size = places.iter().map(Place::size).sum();
        if size == 0 {
            return Err(error(node, "a list needs at least one number"));
        }
        Ok(self.push(Operation::Join(places), Some(size)))
    }

    fn call(
        &mut self,
        name: &str,
        arguments: &[Node],
        node: &Node,
        names: &dyn Names<R>,
    ) -> Result<Place, ExpressionError> {
        let Some(function) = find(name, arguments.len()) else {
            let known: Vec<String> =
                functions().map(|(name, ..)| name.to_string()).chain(names.functions()).collect();
            return Err(error(
                node,
                format!("there is no function `{name}`; functions: {}", known.join(", ")),
            ));
        };
        if let (Function::Fold(fold), [argument]) = (function, arguments)
            && let Part::List(what) = self.part(argument, names)?
        {
            return Ok(self.push(Operation::List(what, fold), None));
        }
        let places =
            arguments.iter().map(|argument| self.add(argument, names)).collect::<Result<Vec<_>, _>>()?;
        let count = |expected: usize| match places.len() {
            found if found == expected => Ok(()),
            found => {
                let s = if expected == 1 { "" } else { "s" };
                Err(error(node, format!("`{name}` takes {expected} argument{s}, not {found}")))
            }
        };
        match function {
            Function::Map1(f) => {
                count(1)?;
                let length = places[0].length;
                Ok(self.push(Operation::Map1(f, places[0].clone()), length))
            }
            Function::Map2(f) => {
                count(2)?;
                let length = common(name, &places, node)?;
                Ok(self.push(Operation::Map2(f, [0, 1].map(|i| places[i].clone())), length))
            }
            Function::Map3(f) => {
                count(3)?;
                let length = common(name, &places, node)?;
                Ok(self.push(Operation::Map3(f, [0, 1, 2].map(|i| places[i].clone())), length))
            }
            Function::Fold(fold) => {
                count(1)?;
                Ok(self.push(Operation::Fold(fold, places[0].clone()), None))
            }
            Function::Dot => {
                count(2)?;
                if places[0].size() != places[1].size() {
                    return Err(sizes(name, &places, node));
                }
                Ok(self.push(Operation::Dot([0, 1].map(|i| places[i].clone())), None))
            }
            Function::Length => {
                count(1)?;
                Ok(self.store(&[places[0].size() as f64], None))
            }
            Function::Whole(expected, out, f) => {
                count(expected.len())?;
                let differs = |(place, size): (&Place, &usize)| place.size() != *size;
                if let Some(index) = places.iter().zip(expected).position(differs) {
                    let found = places[index].size();
                    let size = expected[index];
                    let plural = |count: usize| if count == 1 { "number" } else { "numbers" };
                    let message = format!(
                        "argument {} of `{name}` has {found} {}, but {size} {} {} needed",
                        index + 1,
                        plural(found),
                        plural(size),
                        if size == 1 { "is" } else { "are" }
                    );
                    return Err(error(&arguments[index], message));
                }
                Ok(self.push(Operation::Whole(f, places), Some(out)))
            }
        }
    }

    /// Adds a step, or computes it now if nothing in it changes.
    fn push(&mut self, operation: Operation<R>, length: Option<usize>) -> Place {
        let is_constant = |place: &Place| self.constant[place.range()].iter().all(|constant| *constant);
        let folds = match &operation {
            Operation::Read(_) | Operation::List(..) => false,
            Operation::Map1(_, place) | Operation::Fold(_, place) => is_constant(place),
            Operation::Map2(_, places) | Operation::Dot(places) => places.iter().all(is_constant),
            Operation::Map3(_, places) => places.iter().all(is_constant),
            Operation::Whole(_, places) | Operation::Join(places) => places.iter().all(is_constant),
        };
        let place = self.store(&vec![0.0; length.unwrap_or(1)], length);
        let Range { start, end } = place.range();
        if folds {
            let (before, out) = self.program.memory.split_at_mut(start);
            step(&operation, before, &mut out[..end - start], &mut Nothing);
        } else {
            self.constant[start..end].fill(false);
            self.program.steps.push((operation, place.clone()));
        }
        place
    }

    /// Stores constants.
    fn store(&mut self, values: &[f64], length: Option<usize>) -> Place {
        let start = self.program.memory.len();
        self.program.memory.extend_from_slice(values);
        self.constant.resize(start + values.len(), true);
        Place { start, length }
    }
}

/// Reads nothing: the reader of constant steps.
struct Nothing;

impl<R> Reader<R> for Nothing {
    fn read(&mut self, _what: &R, _out: &mut [f64]) {}
    fn list(&mut self, _what: &R, _each: &mut dyn FnMut(f64)) {}
}

/// Returns the length of the result of a function that is applied to each number.
fn common(name: &str, places: &[Place], node: &Node) -> Result<Option<usize>, ExpressionError> {
    let mut lengths = places.iter().filter_map(|place| place.length);
    let first = lengths.next();
    if lengths.all(|length| Some(length) == first) { Ok(first) } else { Err(sizes(name, places, node)) }
}

fn sizes(name: &str, places: &[Place], node: &Node) -> ExpressionError {
    let sizes: Vec<String> = places.iter().map(|place| place.size().to_string()).collect();
    error(
        node,
        format!("the arguments of `{name}` have {} numbers; they must have the same", sizes.join(" and ")),
    )
}

fn error(node: &Node, message: impl Into<String>) -> ExpressionError {
    ExpressionError::new(node.span.clone(), message)
}
