//! Windows over a stream in amortized constant time per sample: the extrema of monotone deques, and
//! compositions of the functions of `until` and `since` in two stacks.
//!
//! # Reference
//! Lemire, "Streaming Maximum-Minimum Filter Using No More than Three Comparisons per Element",
//! Nordic Journal of Computing 13, 2006.

use super::preallocated;
use super::row::Row;
use crate::extremum::{Extremum, Maximum, Minimum};
use std::collections::VecDeque;

/// The minimum or the maximum, chosen at run time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Pick {
    Least,
    Greatest,
}

impl Pick {
    #[inline(always)]
    pub fn of(self, a: f64, b: f64) -> f64 {
        match self {
            Pick::Least => Minimum::pick(a, b),
            Pick::Greatest => Maximum::pick(a, b),
        }
    }

    /// Returns the extremum of some values.
    pub fn all(self, values: &[f64]) -> f64 {
        match self {
            Pick::Least => all::<Minimum>(values),
            Pick::Greatest => all::<Maximum>(values),
        }
    }

    /// Returns the extremum of an empty set.
    #[inline(always)]
    pub fn neutral(self) -> f64 {
        match self {
            Pick::Least => Minimum::NEUTRAL,
            Pick::Greatest => Maximum::NEUTRAL,
        }
    }

    #[inline(always)]
    pub fn dual(self) -> Pick {
        match self {
            Pick::Least => Pick::Greatest,
            Pick::Greatest => Pick::Least,
        }
    }
}

/// Returns the extremum of some values, in several lanes that do not wait for each other.
fn all<E: Extremum>(values: &[f64]) -> f64 {
    let (lanes, rest) = values.as_chunks::<8>();
    let mut best = [E::NEUTRAL; 8];
    for lane in lanes {
        for (best, value) in best.iter_mut().zip(lane) {
            *best = E::pick(*best, *value);
        }
    }
    best.iter().chain(rest).fold(E::NEUTRAL, |best, value| E::pick(best, *value))
}

/// The suffix extrema of the last samples of a stream.
#[derive(Clone, Debug)]
pub(super) struct Extrema {
    pick: Pick,
    /// Samples with the extremum from there on, earlier ones first.
    suffixes: VecDeque<(usize, f64)>,
}

impl Extrema {
    pub fn new(pick: Pick, length: usize) -> Extrema {
        Extrema { pick, suffixes: VecDeque::with_capacity(preallocated(length)) }
    }

    pub fn push(&mut self, sample: usize, value: f64) {
        while let Some((_, last)) = self.suffixes.back()
            && self.pick.of(value, *last).to_bits() == value.to_bits()
        {
            self.suffixes.pop_back();
        }
        self.suffixes.push_back((sample, value));
    }

    /// Removes the samples before `begin`.
    pub fn drop_before(&mut self, begin: usize) {
        while self.suffixes.front().is_some_and(|(sample, _)| *sample < begin) {
            self.suffixes.pop_front();
        }
    }

    /// Returns the extremum of all samples.
    pub fn all(&self) -> f64 {
        self.suffixes.front().map_or(self.pick.neutral(), |(_, value)| *value)
    }

    /// Returns the extremum of the samples from `begin` on.
    pub fn from(&self, begin: usize) -> f64 {
        let index = self.suffixes.partition_point(|(sample, _)| *sample < begin);
        self.suffixes.get(index).map_or(self.pick.neutral(), |(_, value)| *value)
    }

    /// Appends the extremum of the samples from each of these samples on, which must not decrease.
    pub fn extend_from(&self, begins: impl Iterator<Item = usize>, values: &mut Vec<f64>) {
        let mut index = None;
        values.extend(begins.map(|begin| {
            let found = index.get_or_insert_with(|| self.suffixes.partition_point(|(at, _)| *at < begin));
            while self.suffixes.get(*found).is_some_and(|(sample, _)| *sample < begin) {
                *found += 1;
            }
            self.suffixes.get(*found).map_or(self.pick.neutral(), |(_, value)| *value)
        }));
    }

    pub fn clear(&mut self) {
        self.suffixes.clear();
    }

    /// Saves or restores the samples.
    pub fn visit(&mut self, row: &mut impl Row) {
        row.queue(&mut self.suffixes, (0, 0.0), |row, (sample, value)| {
            row.count(sample);
            row.number(value);
        });
    }
}

/// A function `v -> pick(q, dual(p, v))`; see [`until`](crate::until).
#[derive(Clone, Copy, Debug)]
pub(super) struct Function {
    pub p: f64,
    pub q: f64,
}

impl Function {
    pub fn identity(pick: Pick) -> Function {
        Function { p: pick.dual().neutral(), q: pick.neutral() }
    }

    #[inline(always)]
    pub fn apply(self, pick: Pick, value: f64) -> f64 {
        pick.of(self.q, pick.dual().of(self.p, value))
    }

    /// Returns `v -> self(inner(v))`.
    #[inline(always)]
    pub fn after(self, pick: Pick, inner: Function) -> Function {
        Function { p: pick.dual().of(self.p, inner.p), q: self.apply(pick, inner.q) }
    }
}

/// The composition of the functions of the last samples. That of the first sample is the outermost
/// one, or with `is_reversed` the innermost one.
#[derive(Clone, Debug)]
pub(super) struct Composition {
    pick: Pick,
    is_reversed: bool,
    /// Compositions of the first part of the window from each of its samples on, last sample first.
    front: Vec<Function>,
    /// The functions of the other samples.
    back: Vec<Function>,
    /// Their composition.
    back_all: Function,
}

impl Composition {
    pub fn new(pick: Pick, is_reversed: bool, length: usize) -> Composition {
        let stack = || Vec::with_capacity(preallocated(length));
        let back_all = Function::identity(pick);
        Composition { pick, is_reversed, front: stack(), back: stack(), back_all }
    }

    fn compose(&self, first: Function, last: Function) -> Function {
        if self.is_reversed { last.after(self.pick, first) } else { first.after(self.pick, last) }
    }

    pub fn push(&mut self, function: Function) {
        self.back_all = self.compose(self.back_all, function);
        self.back.push(function);
    }

    /// Removes the first sample.
    pub fn pop(&mut self) {
        if self.front.is_empty() {
            let mut all = Function::identity(self.pick);
            while let Some(function) = self.back.pop() {
                all = self.compose(function, all);
                self.front.push(all);
            }
            self.back_all = Function::identity(self.pick);
        }
        self.front.pop();
    }

    pub fn len(&self) -> usize {
        self.front.len() + self.back.len()
    }

    pub fn apply(&self, value: f64) -> f64 {
        let front = self.front.last().copied().unwrap_or(Function::identity(self.pick));
        self.compose(front, self.back_all).apply(self.pick, value)
    }

    pub fn clear(&mut self) {
        self.front.clear();
        self.back.clear();
        self.back_all = Function::identity(self.pick);
    }

    /// Saves or restores the samples.
    pub fn visit(&mut self, row: &mut impl Row) {
        let identity = Function::identity(self.pick);
        row.list(&mut self.front, identity, Row::function);
        row.list(&mut self.back, identity, Row::function);
        row.function(&mut self.back_all);
    }
}
