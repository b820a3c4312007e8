//! The rows of a topic in the order of their times, each of them once and with its missing values:
//! what [`Log::samples`](crate::Log::samples) does with whole columns, one row at a time.

use std::collections::VecDeque;

use mishandle_results::{Choice, Key, Remedy};
use mishandle_text::{number_text, visible};

use crate::cell::Row;
use crate::error::{Result, content, hold_or_drop, keep_one, undecided};
use crate::options::{Duplicates, Missing, Options, Sampling};
use crate::place::Counted;
use crate::samples::clock::Clock;

/// A row that counts.
#[derive(Clone, Debug)]
pub(super) struct Timed {
    /// In seconds since the origin of the topic; 0 without times.
    pub(super) secs: f64,
    pub(super) number: u64,
    /// NaN where a value is missing.
    pub(super) values: Vec<f64>,
}

/// A topic whose rows arrive.
#[derive(Debug)]
pub(super) struct Topic {
    /// The signals, by their index among those of the formulas.
    pub(super) signals: Vec<usize>,
    pub(super) names: Vec<String>,
    pub(super) counted: Counted,
    /// The name of the column with the times.
    pub(super) time: Option<String>,
    /// The instant of 0 s in attoseconds, if times are differences from it.
    pub(super) origin: Option<i128>,
    /// Seconds from the common origin to that of the topic.
    pub(super) shift: f64,
    /// Largest error of a time by rounding.
    pub(super) rounding: f64,
    /// The time of the latest row that arrived.
    pub(super) latest: f64,
    pub(super) has_ended: bool,
    /// Rows that can be in the wrong order, in the right one.
    unordered: VecDeque<Timed>,
    /// The time before which no row is taken any more.
    passed: f64,
    /// The row after which one with the same time can come.
    last: Option<Timed>,
    /// The time of the last row in order.
    ordered: f64,
    /// The last value of each signal.
    held: Vec<f64>,
    /// Number of values that were missing.
    pub(super) missing: usize,
    has_released: bool,
    /// Rows that are ready.
    pub(super) ready: VecDeque<Timed>,
    clock: Clock,
    /// The time that arrived last, and the number of times up to it that increase, each of which
    /// another row has.
    repeated: (f64, usize),
}

/// Number of rows in turn that repeat earlier times, from which on they are those of another run.
const REPEATED: usize = 3;

impl Topic {
    pub(super) fn new(
        signals: Vec<usize>,
        names: Vec<String>,
        counted: Counted,
        time: Option<String>,
    ) -> Topic {
        let held = vec![f64::NAN; signals.len()];
        Topic {
            signals,
            names,
            counted,
            time,
            origin: None,
            shift: 0.0,
            rounding: 0.0,
            latest: f64::NEG_INFINITY,
            has_ended: false,
            unordered: VecDeque::new(),
            passed: f64::NEG_INFINITY,
            last: None,
            ordered: f64::NEG_INFINITY,
            held,
            missing: 0,
            has_released: false,
            ready: VecDeque::new(),
            clock: Clock::default(),
            repeated: (f64::INFINITY, 0),
        }
    }

    /// Adds a row that arrived, at most the lateness after a later one of the topic.
    pub(super) fn add(&mut self, row: Row, options: &Options, lateness: Option<f64>) -> Result<()> {
        let Row { number, time, mut values, .. } = row;
        values.truncate(self.signals.len());
        let missing = values.iter().position(|value| value.is_nan());
        self.missing += values.iter().filter(|value| value.is_nan()).count();
        if let (Some(column), Missing::Error) = (missing, options.missing) {
            return Err(undecided(
                [hold_or_drop()],
                format!("{}: `{}` has no number", self.counted.text(number), visible(&self.names[column])),
            ));
        }
        if missing.is_some() && options.missing == Missing::Drop && options.sampling == Sampling::Even {
            return Ok(());
        }
        let Some(time) = time else {
            return self.push(Timed { secs: 0.0, number, values }, options);
        };
        if time.secs.is_nan() {
            return Ok(());
        }
        self.origin = self.origin.or(time.origin);
        self.rounding = time.rounding.max(f64::MIN_POSITIVE);
        let row = Timed { secs: time.secs, number, values };
        self.check_start(&row)?;
        if !options.sort {
            self.latest = self.latest.max(row.secs);
            return self.push(row, options);
        }
        let before = self.passed.max(self.latest - lateness.unwrap_or(f64::INFINITY));
        if row.secs < before {
            return Err(self.late(&row, before));
        }
        self.latest = self.latest.max(row.secs);
        let at = self.unordered.partition_point(|known| known.secs <= row.secs);
        self.unordered.insert(at, row);
        Ok(())
    }

    /// Checks that the clock does not start again: sorting would mix two runs, and keeping one row
    /// of each time would delete one. Rows that come too late by less than the lateness count as
    /// late, unless they repeat times.
    fn check_start(&mut self, row: &Timed) -> Result<()> {
        let time = row.secs;
        let has_time = self.unordered.binary_search_by(|known| known.secs.total_cmp(&time)).is_ok();
        let (last, repeated) = self.repeated;
        let before = if time > last { repeated } else { 0 };
        self.repeated = (time, if has_time && time < self.latest { before + 1 } else { 0 });
        let is_at_start = self.clock.add(time).is_some_and(|restart| restart.is_at_start);
        if is_at_start || self.repeated.1 >= REPEATED {
            return Err(starts_again(&format!("before {}", self.counted.text(row.number))));
        }
        Ok(())
    }

    /// Puts the rows before a time, since no other one of them is taken, into their order.
    pub(super) fn order(&mut self, before: f64, options: &Options) -> Result<()> {
        self.passed = self.passed.max(before);
        while self.unordered.front().is_some_and(|row| row.secs < before) {
            if let Some(row) = self.unordered.pop_front() {
                self.push(row, options)?;
            }
        }
        if self.last.as_ref().is_some_and(|last| last.secs < before) {
            self.release(options);
        }
        Ok(())
    }

    /// States that no row follows.
    pub(super) fn end(&mut self, options: &Options) -> Result<()> {
        if self.clock.end().is_some_and(|restart| restart.is_at_start) {
            return Err(starts_again("in the last row"));
        }
        self.order(f64::INFINITY, options)?;
        self.has_ended = true;
        Ok(())
    }

    /// Returns the time up to which no row can become ready, in seconds since the common origin.
    pub(super) fn clock(&self, options: &Options) -> f64 {
        if self.has_ended {
            return f64::INFINITY;
        }
        let arrived =
            if options.sort { (self.passed + self.shift).next_down() } else { self.latest + self.shift };
        let last = self.last.as_ref().map(|last| (last.secs + self.shift).next_down());
        arrived.min(last.unwrap_or(f64::INFINITY))
    }

    /// Returns whether no row counts.
    pub(super) fn is_empty(&self) -> bool {
        self.last.is_none() && self.ready.is_empty() && !self.has_released
    }

    /// Returns the number of rows that wait.
    pub(super) fn waiting(&self) -> usize {
        self.unordered.len() + self.ready.len()
    }

    /// Adds a row in the order of the times.
    fn push(&mut self, row: Timed, options: &Options) -> Result<()> {
        if self.time.is_none() {
            self.last = Some(row);
            self.release(options);
            return Ok(());
        }
        if row.secs < self.ordered {
            let sort = Remedy::Set(vec![(Key::LOG_SORT, Choice::On), (Key::LATENESS, Choice::SECONDS)]);
            let fact = self.not_increasing(&row);
            return Err(undecided(
                [sort.when("its rows come late")],
                format!("{fact}; if its clock starts again there, {ANOTHER}"),
            ));
        }
        if row.secs == self.ordered {
            match options.duplicates {
                Duplicates::Error => {
                    return Err(undecided([keep_one()], self.not_increasing(&row)));
                }
                Duplicates::First => {}
                // Another topic, or one that is sorted, has passed this time.
                Duplicates::Last if self.last.is_none() => return Err(self.late(&row, self.passed)),
                Duplicates::Last => self.last = Some(row),
            }
            return Ok(());
        }
        self.release(options);
        self.ordered = row.secs;
        self.last = Some(row);
        if options.duplicates != Duplicates::Last {
            self.release(options);
        }
        Ok(())
    }

    /// Makes the last row ready, since it counts.
    fn release(&mut self, options: &Options) {
        let Some(mut row) = self.last.take() else { return };
        for (value, held) in row.values.iter_mut().zip(&mut self.held) {
            if value.is_nan() && options.missing == Missing::Hold {
                *value = *held;
            }
            if !value.is_nan() {
                *held = *value;
            }
        }
        self.has_released = true;
        self.ready.push_back(row);
    }

    /// Returns an error about a signal that never had a value.
    pub(super) fn check_values(&self) -> Result<()> {
        match self.held.iter().position(|value| value.is_nan()) {
            Some(column) => {
                Err(content(format!("`{}` has no number in any row", visible(&self.names[column]))))
            }
            None => Ok(()),
        }
    }

    fn not_increasing(&self, row: &Timed) -> String {
        format!(
            "column `{}` does not increase: it is {} and then {} in {}",
            self.time.as_deref().unwrap_or_default(),
            number_text(self.ordered),
            number_text(row.secs),
            self.counted.text(row.number)
        )
    }

    /// Returns the error about a row that came too late.
    pub(super) fn late(&self, row: &Timed, before: f64) -> crate::LogError {
        undecided(
            [Remedy::set(Key::LATENESS, Choice::SECONDS)],
            format!(
                "{}: the row of {} s came when those up to {} s were taken, so the lateness must be longer; if the clock \
                 starts again there, {ANOTHER}",
                self.counted.text(row.number),
                number_text(row.secs),
                number_text(before)
            ),
        )
    }
}

/// The meaning of a clock that starts again.
const ANOTHER: &str = "another log follows, which must be followed by itself";

fn starts_again(place: &str) -> crate::LogError {
    content(format!("the times start again {place}: {ANOTHER}"))
}
