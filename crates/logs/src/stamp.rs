//! Times in two columns: whole seconds, and the nano-, micro- or milliseconds after them, as in
//! messages of ROS and Protobuf and in the `timeval` of POSIX.

use mishandle_text::{number_text, visible};

use crate::cell::{Cell, RowTime, shown};
use crate::error::{Result, content};
use crate::place::Counted;
use crate::times::{FAR, Times, to_nanoseconds};

/// Words for the column with whole seconds.
const SECONDS: [&str; 5] = ["sec", "secs", "seconds", "s", "time"];

/// Words for the column with the rest, and the nanoseconds of its unit.
const RESTS: [(&[&str], i64); 3] = [
    (&["nanosec", "nanosecs", "nsec", "nsecs", "nanos", "nanoseconds", "ns"], 1),
    (&["microsec", "microsecs", "usec", "usecs", "micros", "microseconds", "us"], 1_000),
    (&["millisec", "millisecs", "msec", "msecs", "millis", "milliseconds", "ms"], 1_000_000),
];

/// Characters between the name of a field and that of its part.
const SEPARATORS: [char; 4] = ['/', '.', '_', ' '];

/// Nanoseconds per second.
const SECOND: i64 = 1_000_000_000;

/// The columns with the times of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct TimeColumns {
    /// The column with the times, or with their whole seconds.
    pub(crate) times: usize,
    /// The column with the rest of the times, and the nanoseconds of its unit.
    pub(crate) rest: Option<(usize, i64)>,
}

impl TimeColumns {
    pub(crate) fn has(self, column: usize) -> bool {
        self.times == column || self.rest.is_some_and(|(rest, _)| rest == column)
    }
}

/// Returns the columns of whole seconds and of the rest that a name means: one of both, or the
/// field that has both.
pub(crate) fn columns(names: &[String], name: &str) -> Option<TimeColumns> {
    let at = |name: String| names.iter().position(|known| *known == name);
    let pair = |field: &str| {
        let find = |words: &[&str]| words.iter().find_map(|word| at(format!("{field}{word}")));
        let rest = RESTS.iter().find_map(|(words, unit)| Some((find(words)?, *unit)));
        Some(TimeColumns { times: find(&SECONDS)?, rest: Some(rest?) })
    };
    let start = name.rfind(SEPARATORS).map_or(0, |separator| separator + 1);
    let (field, part) = name.split_at(start);
    if SECONDS.contains(&part) || RESTS.iter().any(|(words, _)| words.contains(&part)) {
        return pair(field);
    }
    let is_column = names.iter().any(|known| known == name);
    SEPARATORS.iter().filter(|_| !is_column).find_map(|separator| pair(&format!("{name}{separator}")))
}

/// Returns the places of the columns with whole seconds and with the rest that a name of times
/// means, and the nanoseconds of the unit of the rest; `None` if it means one column.
pub fn seconds_and_rest(names: &[String], name: &str) -> Option<(usize, usize, i64)> {
    let TimeColumns { times, rest } = columns(names, name)?;
    rest.map(|(rest, unit)| (times, rest, unit))
}

/// The nanoseconds of the rows after their whole seconds while they are read; `None` where a row
/// has none. The column may count microseconds or milliseconds.
#[derive(Clone, Debug)]
pub(crate) struct NanosecondColumn {
    name: String,
    /// Nanoseconds of a unit of the column.
    unit: i64,
    counted: Counted,
    /// Whether rows without a time are left out.
    drops: bool,
    values: Vec<Option<i64>>,
    /// The instant of 0 s in attoseconds of rows that are taken one by one.
    origin: Option<Option<i128>>,
}

impl NanosecondColumn {
    pub(crate) fn new(name: &str, unit: i64, drops: bool, counted: Counted) -> NanosecondColumn {
        NanosecondColumn { name: visible(name), unit, counted, drops, values: Vec::new(), origin: None }
    }

    pub(crate) fn push(&mut self, cell: Cell<'_>, at: u64) -> Result<()> {
        let value = match cell {
            Cell::Integer(value) => Some(value as f64),
            Cell::Number(value) => Some(value),
            Cell::Single(value) => Some(value.into()),
            Cell::Text(text) => text.parse().ok(),
            Cell::Missing | Cell::Time(..) => None,
        };
        let units = SECOND / self.unit;
        let is_rest = |value: &f64| (0.0..units as f64).contains(value) && value.fract() == 0.0;
        match value {
            Some(value) if is_rest(&value) => self.values.push(Some(value as i64 * self.unit)),
            Some(_) | None if !(self.drops && value.is_none_or(f64::is_nan)) => {
                return Err(content(format!(
                    "{}: `{}` is `{}`; what comes after whole seconds are integers from 0 to {}",
                    self.counted.text(at),
                    self.name,
                    shown(cell),
                    units - 1
                )));
            }
            _ => self.values.push(None),
        }
        Ok(())
    }

    /// Returns the times of rows with these whole seconds.
    pub(crate) fn after(self, seconds: &Times) -> Result<Times> {
        let mut found = Vec::with_capacity(self.values.len());
        for (row, nanoseconds) in self.values.iter().enumerate() {
            let whole =
                seconds.nanoseconds_at(row).map(|time| check_whole(time, seconds, row)).transpose()?;
            found.push(whole.zip(*nanoseconds).map(|(whole, rest)| whole + i128::from(rest)));
        }
        seconds.replaced(&found)
    }

    /// Returns the time of the last row, which has these whole seconds, and forgets it.
    pub(crate) fn take_after(&mut self, time: RowTime) -> RowTime {
        let rest = self.values.pop().flatten();
        let Some(rest) = rest.filter(|_| !time.secs.is_nan()) else {
            return RowTime { secs: f64::NAN, ..time };
        };
        let time = to_nanoseconds(time.secs, time.origin) + i128::from(rest);
        let is_far = time.unsigned_abs() as f64 / SECOND as f64 >= FAR;
        let origin = *self.origin.get_or_insert(is_far.then_some(time * i128::from(SECOND)));
        // Nanoseconds first, so that the quotient is the nearest number.
        let nanoseconds = time - origin.unwrap_or(0) / i128::from(SECOND);
        RowTime { secs: nanoseconds as f64 / SECOND as f64, origin, rounding: 0.5e-9 }
    }
}

/// Returns a time in nanoseconds if it is one of whole seconds.
fn check_whole(nanoseconds: i128, seconds: &Times, row: usize) -> Result<i128> {
    if nanoseconds % i128::from(SECOND) == 0 {
        return Ok(nanoseconds);
    }
    Err(content(format!(
        "{}: `{}` is {}; seconds with a rest in another column must be whole",
        seconds.places.text(row),
        seconds.column(),
        number_text(nanoseconds as f64 / SECOND as f64)
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_means_both_columns() {
        let names: Vec<String> =
            "x header/stamp/sec header/stamp/nanosec t.secs t.nsecs sec nanosec a_sec tv_sec tv_usec k.s k.ms"
                .split(' ')
                .map(String::from)
                .collect();
        let of = |times, rest, unit| Some(TimeColumns { times, rest: Some((rest, unit)) });
        let both = |times, rest| of(times, rest, 1);
        for (name, expected) in [
            ("header/stamp/sec", both(1, 2)),
            ("header/stamp/nanosec", both(1, 2)),
            ("header/stamp", both(1, 2)),
            ("t", both(3, 4)),
            ("t.secs", both(3, 4)),
            ("sec", both(5, 6)),
            ("tv_sec", of(8, 9, 1_000)),
            ("k", of(10, 11, 1_000_000)),
            ("x", None),
            ("a_sec", None),
            ("header", None),
        ] {
            assert_eq!(columns(&names, name), expected, "{name}");
        }
    }
}
