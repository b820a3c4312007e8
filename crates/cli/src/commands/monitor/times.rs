//! The sampling period of a log, from the times of its samples.
//!
//! Times in files are rounded: to a number of decimals, to a number of significant digits, or to 32
//! bits. Each of them stands for an interval, and times are even if one start and one period pass
//! through all intervals. The intervals must be short enough that no sample can be missing. Then
//! every bound within the log is the same number of samples for all periods that fit, or no whole
//! number. The simplest of these periods is taken: 1/30 s, not 0.033333335 s.

mod grid;
mod simplest;

use anyhow::{Result, anyhow, bail, ensure};
use grid::Grid;
use mishandle_text::{number_text, visible};
use simplest::simplest;

/// Largest deviation of a step from the mean step, as a fraction of it, that rounding need not
/// explain.
const JITTER: f64 = 1e-3;

/// Largest change of the mean step that makes it simpler, as a fraction of it.
const SIMPLIFIED: f64 = 2e-4;

/// Ratio of the shortest step and the largest error by rounding from which on a missing sample is
/// seen. Without one of three samples, times are off every grid by a quarter of the period. If they
/// have an error e, that needs more than 8 e, and the shortest step is at most 2 e longer.
const STEP_TO_ROUNDING: f64 = 10.0;

/// The column with the times of a log.
pub struct Times {
    column: String,
    samples: Vec<Time>,
    shortest: Step,
    longest: Step,
}

/// A time as it is written.
struct Time {
    secs: f64,
    /// The power of ten of its last digit.
    last_digit: i32,
}

/// Two consecutive times, and the line of the second one.
#[derive(Clone, Copy, Default)]
struct Step {
    from: f64,
    to: f64,
    line: u64,
}

impl Step {
    fn length(self) -> f64 {
        self.to - self.from
    }
}

impl Time {
    fn new(text: &str, secs: f64) -> Time {
        let (mantissa, exponent) = text.split_once(['e', 'E']).unwrap_or((text, "0"));
        let decimals = mantissa.split_once('.').map_or(0, |(_, decimals)| decimals.len());
        let exponent = exponent.parse::<i32>().unwrap_or(0);
        Time { secs, last_digit: exponent.saturating_sub_unsigned(decimals as u32) }
    }

    /// Returns the power of ten of the first digit; `None` for 0.
    fn first_digit(&self) -> Option<i32> {
        (self.secs != 0.0).then(|| self.secs.abs().log10().floor() as i32)
    }

    /// Returns whether this is a number of 32 bits, up to digits that the text leaves out.
    fn is_single(&self) -> bool {
        // A digit 5 that is left out is half a unit, up to errors of 64-bit numbers.
        let left_out = half_unit(self.last_digit) + f64::EPSILON * self.secs.abs();
        (self.secs - f64::from(self.secs as f32)).abs() <= left_out
    }
}

fn half_unit(last_digit: i32) -> f64 {
    0.5 * 10_f64.powi(last_digit)
}

impl Times {
    pub fn new(column: &str) -> Times {
        let (shortest, longest) = (Step::default(), Step::default());
        Times { column: visible(column), samples: Vec::new(), shortest, longest }
    }

    /// Appends the time of the sample in this line.
    pub fn push(&mut self, text: &str, secs: f64, line: u64) -> Result<()> {
        ensure!(
            secs.is_finite(),
            "line {line}: `{}` is {secs}; every time must be a finite number of seconds",
            self.column
        );
        if let Some(last) = self.samples.last() {
            let step = Step { from: last.secs, to: secs, line };
            let is_first = self.samples.len() == 1;
            if is_first || step.length() < self.shortest.length() {
                self.shortest = step;
            }
            if is_first || step.length() > self.longest.length() {
                self.longest = step;
            }
        }
        self.samples.push(Time::new(text, secs));
        Ok(())
    }

    /// Returns the sampling period in seconds: `flag`, or else that of the times. Without a flag,
    /// one sample has none.
    pub fn period(&self, flag: Option<f64>) -> Result<Option<f64>> {
        let [first, .., last] = self.samples.as_slice() else { return Ok(flag) };
        let Step { from, to, line } = self.shortest;
        ensure!(
            self.shortest.length() > 0.0,
            "column `{}` does not increase: it is {} and then {} in line {line}",
            self.column,
            number_text(from),
            number_text(to)
        );
        let mean = (last.secs - first.secs) / (self.samples.len() - 1) as f64;
        ensure!(
            mean.is_finite(),
            "column `{}` extends from {} to {}, too far",
            self.column,
            number_text(first.secs),
            number_text(last.secs)
        );
        let rounding = self.rounding();
        if let Some(flag) = flag
            && 4.0 * largest(&rounding) < flag
            && self.grid(flag, &rounding).fits()
        {
            return Ok(Some(flag));
        }
        let found = self.found(mean, &rounding).map_err(|error| match flag {
            Some(flag) => anyhow!("--period {} does not fit the times: {error}", number_text(flag)),
            None => error,
        })?;
        match flag {
            Some(flag) if (flag / found - 1.0).abs() > JITTER => bail!(
                "--period is {} s, but the mean step of column `{}` is {} s; leave out --period",
                number_text(flag),
                self.column,
                number_text(found)
            ),
            flag => Ok(flag.or(Some(found))),
        }
    }

    fn found(&self, mean: f64, rounding: &[f64]) -> Result<f64> {
        let is_fine = STEP_TO_ROUNDING * largest(rounding) < self.shortest.length();
        let rounded = is_fine.then(|| self.grid(mean, rounding).periods()).flatten();
        if let Some(exact) = self.exact_grid(mean).periods() {
            let low = rounded.map_or(exact.0, |(low, _)| low.max(mean * (1.0 - SIMPLIFIED)));
            let high = rounded.map_or(exact.1, |(_, high)| high.min(mean * (1.0 + SIMPLIFIED)));
            return Ok(simplest(low.min(exact.0), high.max(exact.1)));
        }
        if let Some((low, high)) = rounded {
            return Ok(simplest(low, high));
        }
        self.check_jitter(mean)?;
        // A clock that is nearly even. An integer rate is meant exactly if it shifts no sample by
        // half a step.
        let rate = (1.0 / mean).round();
        let limit = SIMPLIFIED.min(0.5 / self.samples.len() as f64);
        Ok(if (mean * rate - 1.0).abs() < limit { 1.0 / rate } else { mean })
    }

    fn check_jitter(&self, mean: f64) -> Result<()> {
        let deviation = |step: Step| (step.length() / mean - 1.0).abs();
        let is_longest = deviation(self.longest) > deviation(self.shortest);
        let step = if is_longest { self.longest } else { self.shortest };
        if deviation(step) <= JITTER {
            return Ok(());
        }
        let Step { from, to, line } = step;
        bail!(
            "samples must be evenly spaced; column `{}` steps from {} to {} in line {line}, its mean step is {}; resample \
             the log at even times, or if its times are rounded, pass --period",
            self.column,
            number_text(from),
            number_text(to),
            number_text(mean)
        )
    }

    /// Returns the largest error of each time by rounding. Zeros at the end of a time can have been
    /// left out, so other times tell how many digits were kept: the same number of decimals, or the
    /// same number of significant digits.
    fn rounding(&self) -> Vec<f64> {
        let decimals = self.samples.iter().map(|time| time.last_digit).min().unwrap_or(0);
        let digits = |time: &Time| Some(time.first_digit()?.saturating_sub(time.last_digit));
        let most = self.samples.iter().filter_map(digits).max().unwrap_or(0);
        let is_single = self.samples.iter().all(Time::is_single);
        let rounding = |time: &Time| {
            let significant = time.first_digit().map_or(decimals, |first| first.saturating_sub(most));
            let written = half_unit(time.last_digit.min(decimals.max(significant)));
            // A product of two numbers of 32 bits has two of their errors.
            let single = if is_single { f64::from(f32::EPSILON) * time.secs.abs() } else { 0.0 };
            written.max(single)
        };
        self.samples.iter().map(rounding).collect()
    }

    fn grid(&self, near: f64, rounding: &[f64]) -> Grid {
        let times = self.samples.iter().map(|time| time.secs);
        Grid::new(times.zip(rounding.iter().copied()), near)
    }

    fn exact_grid(&self, near: f64) -> Grid {
        Grid::new(self.samples.iter().map(|time| (time.secs, 0.0)), near)
    }
}

fn largest(values: &[f64]) -> f64 {
    values.iter().copied().fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn times(written: impl IntoIterator<Item = String>) -> Result<Times> {
        let mut times = Times::new("time");
        for (line, text) in (2..).zip(written) {
            times.push(&text, text.parse().unwrap(), line)?;
        }
        Ok(times)
    }

    fn period(written: impl IntoIterator<Item = String>) -> Result<f64> {
        Ok(times(written)?.period(None)?.unwrap())
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
        let text = format!("{time:.*}", usize::try_from(decimals).unwrap());
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
            let error = period(text.split(' ').map(str::to_owned)).unwrap_err().to_string();
            assert!(error.contains("evenly spaced") && error.contains("--period"), "{text}: {error}");
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
            assert_eq!(period(text.split(' ').map(str::to_owned)).unwrap(), expected, "{text}");
        }
    }

    #[test]
    fn a_clock_that_is_nearly_even_keeps_its_rate() {
        // 30.002 Hz for 600 s are 18001 steps, not 18000.
        let found = period((0..18_001).map(|sample| format!("{:.9}", f64::from(sample) / 30.002))).unwrap();
        assert!((found - 1.0 / 30.002).abs() < 1e-12, "{found}");
        // Small jitter around 30 Hz.
        let jitter = |sample: i32| f64::from(sample) / 30.0 + f64::from(sample % 5) * 2e-6;
        assert_eq!(period((0..300).map(|sample| format!("{:.9}", jitter(sample)))).unwrap(), 1.0 / 30.0);
    }

    #[test]
    fn a_given_period_must_fit_the_times() {
        let coarse = || times((0..300).map(|sample| format!("{:.2}", f64::from(sample) / 30.0))).unwrap();
        assert!(coarse().period(None).is_err());
        assert_eq!(coarse().period(Some(1.0 / 30.0)).unwrap(), Some(1.0 / 30.0));
        let error = coarse().period(Some(0.04)).unwrap_err().to_string();
        assert!(error.starts_with("--period 0.04 does not fit the times: samples must be evenly"), "{error}");
        let even = || times(["0", "0.5", "1"].map(str::to_owned)).unwrap();
        assert_eq!(even().period(Some(0.5)).unwrap(), Some(0.5));
        let error = even().period(Some(0.25)).unwrap_err().to_string();
        assert!(error.contains("--period is 0.25 s, but the mean step of column `time` is 0.5 s"), "{error}");
    }
}
