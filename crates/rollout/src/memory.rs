//! Saving and restoring what a disturbance remembers, as a list of numbers.
//!
//! One function visits the memory for both directions, so that they cannot differ.

/// Saves or restores numbers, one after the other.
pub(crate) trait Memory {
    /// Visits a count.
    fn count(&mut self, count: &mut usize);

    /// Visits numbers and their count.
    fn numbers(&mut self, numbers: &mut Vec<f64>);
}

/// Appends the visited numbers to a list.
impl Memory for Vec<f64> {
    fn count(&mut self, count: &mut usize) {
        self.push(*count as f64);
    }

    fn numbers(&mut self, numbers: &mut Vec<f64>) {
        self.push(numbers.len() as f64);
        self.extend_from_slice(numbers);
    }
}

/// Takes the visited numbers from a list. Numbers that the list lacks are 0.
pub(crate) struct Saved<'a>(pub &'a [f64]);

impl Memory for Saved<'_> {
    fn count(&mut self, count: &mut usize) {
        let (first, rest) = self.0.split_first().unwrap_or((&0.0, &[]));
        (*count, self.0) = (*first as usize, rest);
    }

    fn numbers(&mut self, numbers: &mut Vec<f64>) {
        let mut count = 0;
        self.count(&mut count);
        let (taken, rest) = self.0.split_at(count.min(self.0.len()));
        numbers.clear();
        numbers.extend_from_slice(taken);
        self.0 = rest;
    }
}
