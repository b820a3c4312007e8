//! Logs whose columns are in memory.

use crate::cell::{Cell, TimeColumn};
use crate::error::{Result, content};
use crate::log::{Column, Topic};
use crate::options::Options;
use crate::place::Counted;
use crate::times::Times;

/// Times in memory, one for each row.
#[derive(Clone, Copy, Debug)]
pub enum TimeValues<'a> {
    /// Numbers in the unit of the options; NaN where a row has none.
    Numbers(&'a [f64]),
    /// Integers in the unit of the options.
    Integers(&'a [i64]),
    /// Instants in nanoseconds; the least integer where a row has none, as in NumPy.
    Instants(&'a [i64]),
    /// Numbers, dates and durations as text.
    Texts(&'a [String]),
}

impl Times {
    /// Creates the times of rows as if a file had them in a column.
    ///
    /// # Errors
    /// If a row has no time, or the unit or zone is not stated where it must be.
    pub fn of_values(column: &str, values: TimeValues<'_>, options: &Options) -> Result<Times> {
        let mut times = TimeColumn::new(column, None, options, Counted::Rows);
        let mut number = 0;
        let mut push = |cell: Cell<'_>| {
            number += 1;
            times.push(cell, number)
        };
        match values {
            TimeValues::Numbers(values) => {
                values.iter().try_for_each(|value| push(Cell::Number(*value)))?;
            }
            TimeValues::Integers(values) => {
                values.iter().try_for_each(|value| push(Cell::Integer((*value).into())))?;
            }
            TimeValues::Instants(values) => values.iter().try_for_each(|value| match *value {
                i64::MIN => push(Cell::Missing),
                value => push(Cell::Time(i128::from(value) * 10_i128.pow(9), -9)),
            })?,
            TimeValues::Texts(values) => {
                values.iter().try_for_each(|value| push(Cell::Text(value.trim())))?;
            }
        }
        times.finish()
    }
}

impl Topic {
    /// Creates a topic from columns in memory. A value that is not finite is missing.
    ///
    /// # Errors
    /// If the columns and the times have different lengths.
    pub fn of_values(name: Option<String>, times: Option<Times>, mut columns: Vec<Column>) -> Result<Topic> {
        let rows = times.as_ref().map(|times| times.secs().len());
        let rows = rows.or(columns.first().map(|column| column.values.len())).unwrap_or(0);
        for column in &mut columns {
            if column.values.len() != rows {
                return Err(content(format!(
                    "`{}` has {} values, but the topic has {rows} rows",
                    mishandle_text::visible(&column.name),
                    column.values.len()
                )));
            }
            column.values.iter_mut().filter(|value| !value.is_finite()).for_each(|value| *value = f64::NAN);
        }
        Ok(Topic::new(name, times, columns))
    }
}
