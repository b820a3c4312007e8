//! The values of a parameter, from the tightest to the loosest.

use mishandle_results::{MinedParameter, Number, Tightest};
use mishandle_stl::TimeUnit;

/// The values of a parameter in an order in which each one is looser than those before.
#[derive(Clone, Debug)]
pub(super) struct Axis {
    name: String,
    unit: Option<TimeUnit>,
    low: f64,
    high: f64,
    tightest: Tightest,
    /// The step of the values, all of which are its multiples; `None`: all numbers.
    step: Option<f64>,
    /// The index of the loosest value.
    pub last: u64,
}

/// Maps numbers to integers in the same order, next numbers to next integers.
fn ordered(value: f64) -> i64 {
    let bits = (value + 0.0).to_bits() as i64;
    if bits < 0 { i64::MIN - bits } else { bits }
}

fn number(ordered: i64) -> f64 {
    let bits = if ordered < 0 { i64::MIN - ordered } else { ordered };
    f64::from_bits(bits as u64) + 0.0
}

impl Axis {
    /// Creates the axis of a range with finite ends, `low <= high`.
    pub fn new(
        name: &str,
        unit: Option<TimeUnit>,
        [low, high]: [f64; 2],
        tightest: Tightest,
        step: Option<f64>,
    ) -> Axis {
        let last = match step {
            Some(step) => ((high / step).round() - (low / step).round()).max(0.0) as u64,
            None => ordered(high).abs_diff(ordered(low)),
        };
        Axis { name: name.to_owned(), unit, low, high, tightest, step, last }
    }

    /// Returns the value with this index.
    pub fn value(&self, index: u64) -> f64 {
        let from_low = match self.tightest {
            Tightest::Low => index,
            Tightest::High => self.last - index,
        };
        match self.step {
            Some(_) if from_low == 0 => self.low,
            Some(_) if from_low == self.last => self.high,
            Some(step) => {
                let value = ((self.low / step).round() + from_low as f64) * step;
                // The shortest text of a multiple of 0.1 has one decimal.
                let rounded = (value * 1e12).round() / 1e12;
                if (rounded - value).abs() <= 1e-12 * value.abs() { rounded } else { value }
            }
            None => number(ordered(self.low).wrapping_add_unsigned(from_low)),
        }
    }

    /// Returns the index of the tightest value that is at least as loose as this one.
    pub fn index(&self, value: f64) -> u64 {
        let mut tight = 0;
        let mut loose = self.last;
        let is_loose = |index: u64| match self.tightest {
            Tightest::Low => self.value(index) >= value,
            Tightest::High => self.value(index) <= value,
        };
        while tight < loose {
            let middle = tight + (loose - tight) / 2;
            if is_loose(middle) { loose = middle } else { tight = middle + 1 }
        }
        tight
    }

    pub fn result(&self) -> MinedParameter {
        MinedParameter {
            name: self.name.clone(),
            low: Number(self.low),
            high: Number(self.high),
            unit: self.unit.map(|unit| unit.symbol().to_owned()),
            tightest: self.tightest,
            resolution: self.step.map(Number),
        }
    }

    pub fn parameter(&self, value: f64) -> mishandle_stl::Parameter<'_> {
        mishandle_stl::Parameter { name: &self.name, value, unit: self.unit }
    }
}

/// Returns the first index from 0 to `last` at which `holds`, which is monotone, is true. It is not
/// called for `last`, where it must be true.
pub(super) fn first<E>(last: u64, mut holds: impl FnMut(u64) -> Result<bool, E>) -> Result<u64, E> {
    let mut low = 0;
    let mut high = last;
    while low < high {
        let middle = low + (high - low) / 2;
        if holds(middle)? { high = middle } else { low = middle + 1 }
    }
    Ok(low)
}
