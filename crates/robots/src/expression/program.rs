use std::ops::Range;

use crate::expression::functions::{Fold, Folding};

/// Gives programs the values of what they read.
pub trait Reader<R> {
    /// Writes the numbers of a quantity.
    fn read(&mut self, what: &R, out: &mut [f64]);

    /// Calls `each` with the numbers of a list whose length may change.
    fn list(&mut self, what: &R, each: &mut dyn FnMut(f64));
}

/// The numbers of a value in the memory of a program.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Place {
    pub(crate) start: usize,
    /// `None`: a number, otherwise a vector of this length.
    pub(crate) length: Option<usize>,
}

impl Place {
    /// Returns the number of numbers.
    pub fn size(&self) -> usize {
        self.length.unwrap_or(1)
    }

    /// Returns whether it is a number and not a vector.
    pub fn is_number(&self) -> bool {
        self.length.is_none()
    }

    pub(crate) fn range(&self) -> Range<usize> {
        self.start..self.start + self.size()
    }
}

#[derive(Clone)]
pub(crate) enum Operation<R> {
    Read(R),
    /// Reduces a list whose length may change.
    List(R, Fold),
    Map1(fn(f64) -> f64, Place),
    Map2(fn(f64, f64) -> f64, [Place; 2]),
    Map3(fn(f64, f64, f64) -> f64, [Place; 3]),
    Fold(Fold, Place),
    Dot([Place; 2]),
    Whole(fn(&[&[f64]], &mut [f64]), Vec<Place>),
    Join(Vec<Place>),
}

/// Largest number of arguments of a function of whole vectors.
const MAX_WHOLE: usize = 4;

/// Expressions that are evaluated together. Its memory is a list of numbers: constants are there
/// from the start, the other values are written by [`run`](Self::run).
#[derive(Clone)]
pub struct Program<R> {
    pub(crate) steps: Vec<(Operation<R>, Place)>,
    pub(crate) memory: Vec<f64>,
}

impl<R> Program<R> {
    /// Makes the memory of one evaluator.
    pub fn memory(&self) -> Vec<f64> {
        self.memory.clone()
    }

    /// Returns what the program reads, in the order of its steps.
    pub fn reads(&self) -> impl Iterator<Item = &R> {
        self.steps.iter().filter_map(|(operation, _)| match operation {
            Operation::Read(what) | Operation::List(what, _) => Some(what),
            _ => None,
        })
    }

    /// Evaluates all expressions. Does not allocate.
    pub fn run(&self, memory: &mut [f64], reader: &mut dyn Reader<R>) {
        for (operation, place) in &self.steps {
            // A step reads only what is before its result.
            let (before, out) = memory.split_at_mut(place.start);
            step(operation, before, &mut out[..place.size()], reader);
        }
    }
}

/// Returns the numbers of a value.
pub fn value<'a>(memory: &'a [f64], place: &Place) -> &'a [f64] {
    &memory[place.range()]
}

pub(crate) fn step<R>(operation: &Operation<R>, before: &[f64], out: &mut [f64], reader: &mut dyn Reader<R>) {
    // A number is an argument for each number of a vector.
    let at = |place: &Place, i: usize| before[place.start + if place.is_number() { 0 } else { i }];
    match operation {
        Operation::Read(what) => reader.read(what, out),
        Operation::List(what, fold) => {
            let mut folding = fold.start();
            reader.list(what, &mut |number| folding.push(number));
            out[0] = folding.value();
        }
        Operation::Map1(f, a) => (0..out.len()).for_each(|i| out[i] = f(at(a, i))),
        Operation::Map2(f, [a, b]) => (0..out.len()).for_each(|i| out[i] = f(at(a, i), at(b, i))),
        Operation::Map3(f, [a, b, c]) => {
            (0..out.len()).for_each(|i| out[i] = f(at(a, i), at(b, i), at(c, i)));
        }
        Operation::Fold(fold, a) => {
            let mut folding: Folding = fold.start();
            before[a.range()].iter().for_each(|number| folding.push(*number));
            out[0] = folding.value();
        }
        Operation::Dot([a, b]) => out[0] = (0..a.size()).map(|i| at(a, i) * at(b, i)).sum(),
        Operation::Whole(f, arguments) => {
            let mut slices: [&[f64]; MAX_WHOLE] = [&[]; MAX_WHOLE];
            for (slice, argument) in slices.iter_mut().zip(arguments) {
                *slice = &before[argument.range()];
            }
            f(&slices[..arguments.len().min(MAX_WHOLE)], out);
        }
        Operation::Join(parts) => {
            let mut rest = out;
            for part in parts {
                let (own, others) = rest.split_at_mut(part.size());
                own.copy_from_slice(&before[part.range()]);
                rest = others;
            }
        }
    }
}
