//! The samples of an online monitor as a row of numbers.
//!
//! One function visits the memory for both directions, so that they cannot differ.

use super::stream::Cell;
use super::window::Function;
use std::collections::VecDeque;

/// Saves or restores numbers, one after the other.
pub(super) trait Row {
    /// Visits a number.
    fn number(&mut self, value: &mut f64);

    /// Visits a count.
    fn count(&mut self, count: &mut usize) {
        let mut number = *count as f64;
        self.number(&mut number);
        *count = number as usize;
    }

    /// Visits a function.
    fn function(&mut self, function: &mut Function) {
        self.number(&mut function.p);
        self.number(&mut function.q);
    }

    /// Visits the elements of a list and their number.
    fn list<T>(&mut self, list: &mut Vec<T>, empty: T, each: impl Fn(&mut Self, &mut T))
    where
        T: Clone,
        Self: Sized,
    {
        let mut len = list.len();
        self.count(&mut len);
        list.resize(len, empty);
        list.iter_mut().for_each(|element| each(self, element));
    }

    /// Visits the elements of a queue and their number.
    fn queue<T>(&mut self, queue: &mut VecDeque<T>, empty: T, each: impl Fn(&mut Self, &mut T))
    where
        T: Clone,
        Self: Sized,
    {
        let mut len = queue.len();
        self.count(&mut len);
        queue.resize(len, empty);
        queue.iter_mut().for_each(|element| each(self, element));
    }
}

/// Writes numbers to a row.
pub(super) struct Saving<'a>(pub &'a mut [f64]);

impl Row for Saving<'_> {
    fn number(&mut self, value: &mut f64) {
        if let Some((first, rest)) = std::mem::take(&mut self.0).split_first_mut() {
            *first = *value;
            self.0 = rest;
        }
    }
}

/// Reads the numbers of a row.
pub(super) struct Restoring<'a>(pub &'a [f64]);

impl Row for Restoring<'_> {
    fn number(&mut self, value: &mut f64) {
        if let Some((first, rest)) = self.0.split_first() {
            (*value, self.0) = (*first, rest);
        }
    }
}

/// Visits the number of samples of a monitor and what its nodes remember.
pub(super) fn visit(len: &mut usize, cells: &mut [Cell], row: &mut impl Row) {
    row.count(len);
    cells.iter_mut().for_each(|cell| cell.visit(row));
}
