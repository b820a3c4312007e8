//! Rows of a batch that threads visit in groups: parts of its buffers, and what its worlds get
//! before the next step.

use crate::{WorldBatch, WorldError};

/// States and varying fields of some rows that the worlds have not got yet. Each group of rows has
/// its own, so that threads do not share one.
#[derive(Debug, Default)]
pub struct PendingRows {
    states: RowValues,
    fields: RowValues,
}

/// Numbers of some rows, one row after another.
#[derive(Debug, Default)]
struct RowValues {
    rows: Vec<usize>,
    values: Vec<f64>,
}

impl RowValues {
    /// Sets the numbers of a row.
    fn set(&mut self, row: usize, values: &[f64]) {
        match self.rows.iter().position(|known| *known == row) {
            Some(index) => self.values[index * values.len()..][..values.len()].copy_from_slice(values),
            None => {
                self.rows.push(row);
                self.values.extend_from_slice(values);
            }
        }
    }

    /// Moves the numbers of all rows out of `others`.
    fn append(&mut self, others: &mut RowValues) {
        self.rows.append(&mut others.rows);
        self.values.append(&mut others.values);
    }
}

impl PendingRows {
    /// Sets the state of a row.
    pub fn set_state(&mut self, row: usize, state: &[f64]) {
        self.states.set(row, state);
    }

    /// Sets the varying fields of the model of a row.
    pub fn set_fields(&mut self, row: usize, fields: &[f64]) {
        self.fields.set(row, fields);
    }

    /// Moves the states and fields of all groups to the worlds.
    ///
    /// # Errors
    /// If the batch fails as a whole.
    pub fn write(groups: &mut [PendingRows], worlds: &mut dyn WorldBatch) -> Result<(), WorldError> {
        let mut all = PendingRows::default();
        for pending in groups {
            all.states.append(&mut pending.states);
            all.fields.append(&mut pending.fields);
        }
        let PendingRows { states, fields } = all;
        let mut result = Ok(());
        if !fields.rows.is_empty() {
            result = worlds.write_fields(&fields.rows, &fields.values);
        }
        if !states.rows.is_empty() {
            result = result.and_then(|()| worlds.write_states(&states.rows, &states.values));
        }
        result
    }
}

/// Splits rows into groups of `length` numbers; the last one may be smaller, and groups are empty
/// if `length` is 0.
pub fn split_rows<T>(numbers: &mut [T], length: usize) -> impl Iterator<Item = &mut [T]> {
    let mut rest = numbers;
    std::iter::repeat_with(move || rest.split_off_mut(..length.min(rest.len())).unwrap_or_default())
}
