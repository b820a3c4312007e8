//! The times of a log's rows, and the sampling period that they show.
//!
//! Times in files are rounded: to a number of decimals, to a number of significant digits, or to 32
//! bits. Each of them stands for an interval, and times are even if one start and one period pass
//! through all intervals. The intervals must be short enough that no sample can be missing. Then
//! every bound within the log is the same number of samples for all periods that fit, or no whole
//! number. The simplest of these periods is taken: 1/30 s, not 0.033333335 s.

mod grid;
mod simplest;

use grid::Grid;
use mishandle_results::{Key, Remedy};
use mishandle_text::{number_text, visible};
use simplest::simplest;

use crate::cell::RowTime;
use crate::error::{LogError, Result, content, dense, resample, state_period, undecided};
use crate::place::{Counted, Places};

/// Largest deviation of a step from the mean step, as a fraction of it, that rounding need not
/// explain.
const JITTER: f64 = 1e-3;

/// Largest change of the mean step that makes it simpler, as a fraction of it.
const SIMPLIFIED: f64 = 2e-4;

/// Ratio of the shortest step and the largest error by rounding from which on a missing sample is
/// seen. Without one of three samples, times are off every grid by a quarter of the period. If they
/// have an error e, that needs more than 8 e, and the shortest step is at most 2 e longer.
const STEP_TO_ROUNDING: f64 = 10.0;

/// Seconds from which on exact times are kept as differences from the first one: a 64-bit number
/// of this size has steps of 2 ns.
pub(crate) const FAR: f64 = 1e7;

/// Step from which on times look like ms, us or ns rather than s.
const LONG_STEP: f64 = 10.0;

/// Numbers from here on with steps below 50 µs look like days: MATLAB counts them from the year 0,
/// spreadsheets from 1900.
const LATE: f64 = 2e4;
const DAY_STEP: f64 = 5e-5;

/// Returns the unit that a step of times in s looks like if it is too long for a robot.
pub(crate) fn looks_like_a_part(step: f64) -> Option<&'static str> {
    (step >= LONG_STEP).then_some("ms, us or ns")
}

fn looks_like_days(is_late: bool, step: f64) -> Option<&'static str> {
    (is_late && step < DAY_STEP).then_some("days")
}

/// Least number of significant digits to which a program rounds times, one of the next lower power
/// of ten included: MATLAB writes five.
const LEAST_DIGITS: i32 = 4;

/// Attoseconds per second.
const ATTO: f64 = 1e18;

/// The times of the rows of a topic, in seconds.
#[derive(Clone, Debug)]
pub struct Times {
    column: String,
    /// The instant of 0 s in attoseconds, in the scale of the file: exact times are kept as
    /// differences from the first one. `None` if the seconds are those of the file.
    origin: Option<i128>,
    secs: Vec<f64>,
    /// The power of ten of the last digit of each time.
    last_digits: Vec<i16>,
    /// The least power of ten of a last digit among the times that were removed.
    finest: i16,
    /// Largest error of every time besides that of its last digit.
    noise: f64,
    pub(crate) places: Places,
}

/// Two consecutive times, and the row of the second one.
#[derive(Clone, Copy, Default)]
struct Step {
    from: f64,
    to: f64,
    row: usize,
}

impl Step {
    fn length(self) -> f64 {
        self.to - self.from
    }
}

/// A time as it is written.
#[derive(Clone, Copy)]
struct Time {
    secs: f64,
    /// The power of ten of its last digit.
    last_digit: i32,
}

impl Time {
    /// Returns the power of ten of the first digit; `None` for 0.
    fn first_digit(self) -> Option<i32> {
        (self.secs != 0.0).then(|| self.secs.abs().log10().floor() as i32)
    }

    /// Returns whether this is a number of 32 bits, up to digits that the text leaves out.
    fn is_single(self) -> bool {
        // A digit 5 that is left out is half a unit, up to errors of 64-bit numbers.
        let left_out = half_unit(self.last_digit) + f64::EPSILON * self.secs.abs();
        (self.secs - f64::from(self.secs as f32)).abs() <= left_out
    }
}

fn half_unit(last_digit: i32) -> f64 {
    0.5 * 10_f64.powi(last_digit)
}

/// Returns the power of ten of the last digit of a number as it is written.
pub(crate) fn last_digit(text: &str) -> i32 {
    let (mantissa, exponent) = text.split_once(['e', 'E']).unwrap_or((text, "0"));
    let decimals = mantissa.split_once('.').map_or(0, |(_, decimals)| decimals.len());
    exponent.parse::<i32>().unwrap_or(0).saturating_sub_unsigned(decimals as u32)
}

impl Times {
    pub(crate) fn new(column: &str, counted: Counted) -> Times {
        Times {
            column: visible(column),
            origin: None,
            secs: Vec::new(),
            last_digits: Vec::new(),
            finest: i16::MAX,
            noise: 0.0,
            places: Places::new(counted),
        }
    }

    /// Creates the times of rows from integer nanoseconds, as if a file had them as decimals
    /// without zeros at the end. Times far from 0 stay exact.
    pub fn nanoseconds(column: &str, times: &[i64]) -> Times {
        let first = times.first().copied().unwrap_or(0);
        let origin = (first.unsigned_abs() as f64 / 1e9 >= FAR).then_some(i128::from(first));
        let secs = |time: &i64| (i128::from(*time) - origin.unwrap_or(0)) as f64 / 1e9;
        // Zeros at the end of a number are digits that nobody measured.
        let last_digit = |time: &i64| {
            let zeros = (1..=9).take_while(|digits| time % 10_i64.pow(*digits) == 0).count();
            zeros as i16 - 9
        };
        Times {
            column: visible(column),
            origin: origin.map(|origin| origin * 10_i128.pow(9)),
            secs: times.iter().map(secs).collect(),
            last_digits: times.iter().map(last_digit).collect(),
            finest: i16::MAX,
            noise: 0.0,
            places: Places::rows(times.len()),
        }
    }

    /// Returns the times in integer nanoseconds, in the scale of the file.
    ///
    /// # Errors
    /// If a row has no time, or one that does not fit 64 bits.
    pub fn to_nanoseconds(&self) -> Result<Vec<i64>> {
        let of_row = |row: usize| {
            let time = self.nanoseconds_at(row).and_then(|time| i64::try_from(time).ok());
            time.ok_or_else(|| {
                content(format!(
                    "{}: `{}` has no time that fits 64 bits in ns",
                    self.places.text(row),
                    self.column
                ))
            })
        };
        (0..self.secs.len()).map(of_row).collect()
    }

    /// Returns the median step of times without a unit and the unit that it looks like, if that is
    /// not seconds. Pauses and clocks that start again do not change a median.
    pub(crate) fn other_unit(&self) -> Option<(f64, &'static str)> {
        let steps = self.secs.windows(2).map(|pair| (pair[1] - pair[0]).abs());
        let mut steps: Vec<f64> = steps.filter(|step| *step > 0.0).collect();
        let middle = steps.len().checked_sub(1)? / 2;
        let step = *steps.select_nth_unstable_by(middle, f64::total_cmp).1;
        let is_late = self.secs.iter().find(|secs| !secs.is_nan()).is_some_and(|first| first.abs() >= LATE);
        looks_like_days(is_late, step).or(looks_like_a_part(step)).map(|unit| (step, unit))
    }

    /// Returns the time of a row in nanoseconds, in the scale of the file; `None` if it is missing.
    pub(crate) fn nanoseconds_at(&self, row: usize) -> Option<i128> {
        let secs = self.secs[row];
        (!secs.is_nan()).then(|| to_nanoseconds(secs, self.origin))
    }

    /// Returns times of the same rows and the same column in nanoseconds.
    ///
    /// # Errors
    /// If one does not fit 64 bits.
    pub(crate) fn replaced(&self, nanoseconds: &[Option<i128>]) -> Result<Times> {
        // A missing time must not become the origin.
        let first = nanoseconds.iter().flatten().next().copied().unwrap_or(0);
        let integer = |(row, time): (usize, &Option<i128>)| {
            i64::try_from(time.unwrap_or(first)).map_err(|_| {
                let place = self.places.text(row);
                content(format!("{place}: `{}` has no time that fits 64 bits in ns", self.column))
            })
        };
        let integers = nanoseconds.iter().enumerate().map(integer).collect::<Result<Vec<i64>>>()?;
        let mut times = Times { places: self.places.clone(), ..Times::nanoseconds(&self.column, &integers) };
        for (secs, _) in times.secs.iter_mut().zip(nanoseconds).filter(|(_, time)| time.is_none()) {
            *secs = f64::NAN;
        }
        Ok(times)
    }

    /// Sets the instant that all times are differences from. There must be no time yet.
    pub(crate) fn set_origin(&mut self, origin: i128, noise: f64) {
        self.origin = Some(origin);
        self.noise = noise;
    }

    /// Returns the instant of 0 s in attoseconds, if the times are differences from one.
    pub(crate) fn origin(&self) -> Option<i128> {
        self.origin
    }

    /// Makes the times differences from an earlier instant.
    pub(crate) fn shift_to(&mut self, origin: i128) {
        let by = (self.origin.unwrap_or(0) - origin) as f64 / ATTO;
        if by != 0.0 {
            self.secs.iter_mut().for_each(|secs| *secs += by);
        }
        self.origin = Some(origin);
    }

    /// Appends an exact time: attoseconds in the scale of the file.
    pub(crate) fn push_exact(&mut self, attoseconds: i128, last_digit: i32, number: u64) {
        let secs = attoseconds.saturating_sub(self.origin.unwrap_or(0)) as f64 / ATTO;
        self.push(secs, last_digit, number);
    }

    /// Appends a time that is not exact, in seconds of the file.
    pub(crate) fn push_secs(&mut self, secs: f64, last_digit: i32, number: u64) {
        let origin = self.origin.map_or(0.0, |origin| origin as f64 / ATTO);
        self.push(secs - origin, last_digit, number);
    }

    /// Appends a row without a time.
    pub(crate) fn push_missing(&mut self, number: u64) {
        self.push(f64::NAN, 0, number);
    }

    fn push(&mut self, secs: f64, last_digit: i32, number: u64) {
        self.secs.push(secs);
        self.last_digits.push(last_digit.clamp(i16::MIN.into(), i16::MAX.into()) as i16);
        self.places.push(number);
    }

    /// Removes the last time. What the digits of the times say is kept.
    pub(crate) fn pop(&mut self) -> Option<RowTime> {
        let secs = self.secs.pop()?;
        let last_digit = self.last_digits.pop()?;
        self.places = Places::new(Counted::Lines);
        if !secs.is_nan() {
            self.finest = self.finest.min(last_digit);
        }
        let rounding = half_unit(self.finest.into()).max(self.noise);
        Some(RowTime { secs, origin: self.origin, rounding })
    }

    /// Returns the times in seconds.
    pub fn secs(&self) -> &[f64] {
        &self.secs
    }

    /// Returns the times in seconds without the rest.
    pub(crate) fn into_secs(self) -> Vec<f64> {
        self.secs
    }

    /// Returns the name of the column.
    pub(crate) fn column(&self) -> &str {
        &self.column
    }

    /// Returns the times of these rows, in their order.
    pub(crate) fn of(&self, rows: &[usize]) -> Times {
        Times {
            column: self.column.clone(),
            origin: self.origin,
            secs: rows.iter().map(|row| self.secs[*row]).collect(),
            last_digits: rows.iter().map(|row| self.last_digits[*row]).collect(),
            finest: self.finest,
            noise: self.noise,
            places: self.places.of(rows),
        }
    }

    /// Returns the time of a row for a message.
    pub(crate) fn text(&self, row: usize) -> String {
        match self.origin {
            Some(origin) => {
                exact_text(to_nanoseconds(self.secs[row], Some(origin)).saturating_mul(10_i128.pow(9)))
            }
            None => number_text(self.secs[row]),
        }
    }

    fn times(&self) -> impl ExactSizeIterator<Item = Time> + Clone {
        let digits = self.last_digits.iter();
        self.secs.iter().zip(digits).map(|(secs, digit)| Time { secs: *secs, last_digit: (*digit).into() })
    }

    /// Returns the shortest and the longest step.
    fn extreme_steps(&self) -> (Step, Step) {
        let steps = self.secs.windows(2).enumerate();
        let mut steps = steps.map(|(row, pair)| Step { from: pair[0], to: pair[1], row: row + 1 });
        let first = steps.next().unwrap_or_default();
        steps.fold((first, first), |(shortest, longest), step| {
            (
                if step.length() < shortest.length() { step } else { shortest },
                if step.length() > longest.length() { step } else { longest },
            )
        })
    }

    /// Returns the sampling period in seconds: the given one, or else the period of the times,
    /// which must increase. One sample has no period of its own.
    ///
    /// # Errors
    /// If the times are not evenly spaced, or do not fit the given period.
    pub fn period(&self, given: Option<f64>) -> Result<Option<f64>> {
        let [first, .., last] = self.secs.as_slice() else { return Ok(given) };
        let (shortest, longest) = self.extreme_steps();
        let mean = (last - first) / (self.secs.len() - 1) as f64;
        if !mean.is_finite() {
            return Err(content(format!(
                "column `{}` extends from {} to {}, too far",
                self.column,
                number_text(*first),
                number_text(*last)
            )));
        }
        let rounding: Vec<f64> = self.rounding().collect();
        if let Some(given) = given
            && 4.0 * largest(&rounding) < given
            && self.grid(given, &rounding).fits()
        {
            return Ok(Some(given));
        }
        let found = self.found(mean, &rounding, shortest, longest).map_err(|error| match (given, error) {
            (Some(period), LogError::Undecided { fact, remedies }) => LogError::Undecided {
                fact: format!("the period {} s does not fit the times: {fact}", number_text(period)),
                remedies,
            },
            (_, error) => error,
        })?;
        match given {
            Some(given) if (given / found - 1.0).abs() > JITTER => Err(undecided(
                [Remedy::Unset(Key::LOG_PERIOD), resample()],
                format!(
                    "the period is {} s, but the mean step of column `{}` is {} s",
                    number_text(given),
                    self.column,
                    number_text(found)
                ),
            )),
            given => Ok(given.or(Some(found))),
        }
    }

    fn found(&self, mean: f64, rounding: &[f64], shortest: Step, longest: Step) -> Result<f64> {
        let is_fine = STEP_TO_ROUNDING * largest(rounding) < shortest.length();
        let rounded = is_fine.then(|| self.grid(mean, rounding).periods()).flatten();
        if let Some(exact) = self.exact_grid(mean).periods() {
            let low = rounded.map_or(exact.0, |(low, _)| low.max(mean * (1.0 - SIMPLIFIED)));
            let high = rounded.map_or(exact.1, |(_, high)| high.min(mean * (1.0 + SIMPLIFIED)));
            return Ok(simplest(low.min(exact.0), high.max(exact.1)));
        }
        if let Some((low, high)) = rounded {
            return Ok(simplest(low, high));
        }
        self.check_jitter(mean, shortest, longest)?;
        // A clock that is nearly even. An integer rate is meant exactly if it shifts no sample by
        // half a step.
        let rate = (1.0 / mean).round();
        let limit = SIMPLIFIED.min(0.5 / self.secs.len() as f64);
        Ok(if (mean * rate - 1.0).abs() < limit { 1.0 / rate } else { mean })
    }

    fn check_jitter(&self, mean: f64, shortest: Step, longest: Step) -> Result<()> {
        let deviation = |step: Step| (step.length() / mean - 1.0).abs();
        let is_longest = deviation(longest) > deviation(shortest);
        let step = if is_longest { longest } else { shortest };
        if deviation(step) <= JITTER {
            return Ok(());
        }
        Err(undecided(
            [resample(), dense(), state_period().when("its times are rounded")],
            format!(
                "samples must be evenly spaced; column `{}` steps from {} to {} in {}, its mean step is {}",
                self.column,
                self.text(step.row - 1),
                self.text(step.row),
                self.places.text(step.row),
                number_text(mean)
            ),
        ))
    }

    /// Returns the largest error of each time by rounding. Zeros at the end of a time can have been
    /// left out, so other times tell how many digits were kept: the same number of decimals, or the
    /// same number of significant digits.
    pub(crate) fn rounding(&self) -> impl Iterator<Item = f64> {
        let decimals = self.times().map(|time| time.last_digit).min().unwrap_or(0);
        let digits = |time: Time| Some(time.first_digit()?.saturating_sub(time.last_digit));
        let most = self.times().filter_map(digits).max().unwrap_or(0).max(LEAST_DIGITS);
        let is_single = self.origin.is_none()
            && self.times().all(Time::is_single)
            && self.secs.iter().any(|secs| secs.fract() != 0.0);
        let rounding = move |time: Time| {
            let significant = time.first_digit().map_or(decimals, |first| first.saturating_sub(most));
            let written = half_unit(time.last_digit.min(decimals.max(significant)));
            // A product of two numbers of 32 bits has two of their errors.
            let single = if is_single { f64::from(f32::EPSILON) * time.secs.abs() } else { 0.0 };
            written.max(single).max(self.noise)
        };
        self.times().map(rounding)
    }

    fn grid(&self, near: f64, rounding: &[f64]) -> Grid {
        Grid::new(self.secs.iter().copied().zip(rounding.iter().copied()), near)
    }

    fn exact_grid(&self, near: f64) -> Grid {
        let noise = self.noise;
        Grid::new(self.secs.iter().map(move |secs| (*secs, noise)), near)
    }
}

/// Returns a time in integer nanoseconds; half a nanosecond is rounded up. `origin` is the instant
/// of 0 s in attoseconds, `None` for 0. A product with 1e18 is exact up to 53 bits only, so it is
/// never compared with an integer before it is rounded.
pub(crate) fn to_nanoseconds(secs: f64, origin: Option<i128>) -> i128 {
    let exact = origin.unwrap_or(0).saturating_add((secs * ATTO) as i128);
    exact.saturating_add(500_000_000).div_euclid(10_i128.pow(9))
}

fn largest(values: &[f64]) -> f64 {
    values.iter().copied().fold(0.0, f64::max)
}

/// Formats attoseconds as seconds with all their digits.
fn exact_text(attoseconds: i128) -> String {
    let sign = if attoseconds < 0 { "-" } else { "" };
    let unit = 10_u128.pow(18);
    let whole = attoseconds.unsigned_abs() / unit;
    let rest = attoseconds.unsigned_abs() % unit;
    let fraction = format!("{:09}", rest / 10_u128.pow(9));
    let fraction = fraction.trim_end_matches('0');
    if fraction.is_empty() { format!("{sign}{whole}") } else { format!("{sign}{whole}.{fraction}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn times(written: impl IntoIterator<Item = String>) -> Times {
        let mut times = Times::new("time", Counted::Lines);
        for (line, text) in (2..).zip(written) {
            times.push_secs(text.parse().expect("a number"), last_digit(&text), line);
        }
        times
    }

    fn period(written: impl IntoIterator<Item = String>) -> Result<f64> {
        Ok(times(written).period(None)?.expect("a period"))
    }

    type Write = fn(f64) -> String;

    /// The ways to write times, and the largest error of each below 1000 s.
    const WAYS: [(Write, f64); 8] = [
        (|time| format!("{time:.3}"), 5e-4),
        (|time| ((time * 1e4).round() / 1e4).to_string(), 5e-5),
        (|time| format!("{time:.6e}"), 5e-5),
        (significant, 5e-4),
        (|time| (time as f32).to_string(), 3.1e-5),
        (|time| format!("{:.9}", time as f32), 3.1e-5),
        (|time| f64::from(time as f32).to_string(), 3.1e-5),
        (|time| time.to_string(), 0.0),
    ];

    /// Six significant digits without zeros at the end, as C++ and `%g` write numbers.
    fn significant(time: f64) -> String {
        let decimals = 5 - time.max(1e-4).log10().floor() as i32;
        let text = format!("{time:.*}", usize::try_from(decimals).expect("fits"));
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    }

    #[test]
    fn rounded_times_have_the_period_of_the_times_before() {
        let rates = [1.0, 3.0, 7.5, 10.0, 24.0, 29.97, 30.0, 50.0, 60.0, 90.0, 100.0];
        for (rate, (write, _)) in rates.into_iter().flat_map(|rate| WAYS.map(|way| (rate, way))) {
            for (samples, first) in [(2000, 0), (2000, 17), (9000, 0)] {
                let period_secs = 1.0 / rate;
                let written = (0..samples).map(|sample| write(f64::from(first + sample) / rate));
                let found =
                    period(written).unwrap_or_else(|error| panic!("{rate} {}: {error}", write(1.0 / 3.0)));
                assert_eq!(found, period_secs, "{rate} {}", write(1.0 / 3.0));
            }
        }
    }

    #[test]
    fn a_missing_sample_is_an_error_however_times_are_written() {
        for (rate, (write, _)) in
            [3.0, 10.0, 30.0, 60.0, 100.0].into_iter().flat_map(|rate| WAYS.map(|way| (rate, way)))
        {
            for samples in [2, 3, 4, 5, 10, 1000] {
                for missing in [1, 2, samples / 2, samples - 1] {
                    let number = |sample: i32| if sample < missing { sample } else { sample + 1 };
                    let written: Vec<String> =
                        (0..samples).map(|sample| write(f64::from(number(sample)) / rate)).collect();
                    let is_even =
                        (1..samples).all(|sample| number(sample) - number(sample - 1) == 1) || samples < 3;
                    let found = period(written.clone());
                    assert_eq!(found.is_ok(), is_even, "{written:?}: {found:?}");
                }
            }
        }
    }

    #[test]
    fn jitter_of_more_than_the_rounding_is_an_error() {
        for (write, error) in WAYS {
            for jitter in [0.004, 0.001_5] {
                if jitter < 2.5 * error {
                    continue;
                }
                let shifted =
                    |sample: i32| f64::from(sample) / 30.0 + if sample % 7 == 3 { jitter } else { 0.0 };
                let found = period((0..500).map(|sample| write(shifted(sample))));
                assert!(found.is_err(), "{}: {found:?}", write(shifted(3)));
            }
        }
        for text in
            ["0.00 0.10 0.21 0.30", "0.000 0.101 0.200 0.301 0.400", "0 10 21 30", "0 0.2 0.5", "0 1 3"]
        {
            let error = period(text.split(' ').map(str::to_owned)).expect_err("no period").to_string();
            assert!(error.contains("evenly spaced"), "{text}: {error}");
        }
    }

    #[test]
    fn short_logs_keep_the_period_that_is_written() {
        for (text, expected) in [
            ("0 0.1 0.2", 0.1),
            ("0 0.12 0.24", 0.12),
            ("0 0.015 0.03", 0.015),
            ("0 0.5", 0.5),
            ("0 0.0333333351", 1.0 / 30.0),
            ("0 0.03333", 1.0 / 30.0),
            ("5 7 9", 2.0),
            ("0.0712345678 0.1424691356 0.2137037034", 0.071_234_567_8),
            ("-0.5 0 0.5", 0.5),
            ("1e-3 2e-3 3e-3", 0.001),
        ] {
            assert_eq!(period(text.split(' ').map(str::to_owned)).expect("fits"), expected, "{text}");
        }
    }

    #[test]
    fn a_clock_that_is_nearly_even_keeps_its_rate() {
        // 30.002 Hz for 600 s are 18001 steps, not 18000.
        let found =
            period((0..18_001).map(|sample| format!("{:.9}", f64::from(sample) / 30.002))).expect("fits");
        assert!((found - 1.0 / 30.002).abs() < 1e-12, "{found}");
        // Small jitter around 30 Hz.
        let jitter = |sample: i32| f64::from(sample) / 30.0 + f64::from(sample % 5) * 2e-6;
        assert_eq!(
            period((0..300).map(|sample| format!("{:.9}", jitter(sample)))).expect("fits"),
            1.0 / 30.0
        );
    }

    #[test]
    fn a_given_period_must_fit_the_times() {
        let coarse = || times((0..300).map(|sample| format!("{:.2}", f64::from(sample) / 30.0)));
        assert!(coarse().period(None).is_err());
        assert_eq!(coarse().period(Some(1.0 / 30.0)).expect("fits"), Some(1.0 / 30.0));
        let error = coarse().period(Some(0.04)).expect_err("no period").to_string();
        assert!(
            error.starts_with("the period 0.04 s does not fit the times: samples must be evenly"),
            "{error}"
        );
        let even = || times(["0", "0.5", "1"].map(str::to_owned));
        assert_eq!(even().period(Some(0.5)).expect("fits"), Some(0.5));
        let error = even().period(Some(0.25)).expect_err("no period").to_string();
        assert!(
            error.contains("the period is 0.25 s, but the mean step of column `time` is 0.5 s"),
            "{error}"
        );
    }
}
