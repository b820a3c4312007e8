//! Statistics of a column over all frames, with which policies are normalized.

use serde_json::{Value, json};

/// Quantiles, with their names in LeRobot's file.
const QUANTILES: [(&str, f64); 5] = [("q01", 0.01), ("q10", 0.1), ("q50", 0.5), ("q90", 0.9), ("q99", 0.99)];

/// Names of the statistics, in the order of [`of_numbers`].
const NAMES: [&str; 9] = ["min", "max", "mean", "std", "q01", "q10", "q50", "q90", "q99"];

/// Returns the statistics of numbers. Numbers that are not finite do not count; without others, all
/// are 0.
///
/// The standard deviation is that of the population, and quantiles are interpolated linearly, as
/// `numpy.std` and `numpy.quantile` do.
fn of_numbers(values: impl Iterator<Item = f64>) -> [f64; 9] {
    let mut values: Vec<f64> = values.filter(|value| value.is_finite()).collect();
    values.sort_unstable_by(f64::total_cmp);
    let (Some(&low), Some(&high)) = (values.first(), values.last()) else { return [0.0; 9] };
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / n;
    let quantile = |(_, share): (&str, f64)| {
        let place = share * (n - 1.0);
        let below = values[place.floor() as usize];
        let above = values[place.ceil() as usize];
        below + (above - below) * place.fract()
    };
    let mut found = [low, high, mean, variance.sqrt(), 0.0, 0.0, 0.0, 0.0, 0.0];
    found[4..].copy_from_slice(&QUANTILES.map(quantile));
    found
}

/// The statistics of a column.
pub(crate) struct Statistics {
    /// Those of each number of a vector, or of each channel of an image.
    numbers: Vec<[f64; 9]>,
    count: usize,
    is_image: bool,
}

impl Statistics {
    /// Returns the statistics of a column of vectors of `size` numbers, frame by frame.
    pub(crate) fn of_vectors(values: &[f32], size: usize) -> Statistics {
        let number =
            |index: usize| of_numbers(values.iter().skip(index).step_by(size).map(|value| f64::from(*value)));
        let numbers = (0..size).map(number).collect();
        Statistics { numbers, count: values.len() / size, is_image: false }
    }

    /// Returns the statistics of a column of numbers.
    pub(crate) fn of_column(values: &[f64]) -> Statistics {
        let numbers = vec![of_numbers(values.iter().copied())];
        Statistics { numbers, count: values.len(), is_image: false }
    }

    /// Returns the number of frames.
    pub(crate) fn count(&self) -> usize {
        self.count
    }

    /// Returns each statistic with its name: one value per number or channel.
    pub(crate) fn values(&self) -> impl Iterator<Item = (&'static str, Vec<f64>)> {
        let values = |statistic: usize| self.numbers.iter().map(move |found| found[statistic]).collect();
        NAMES.iter().enumerate().map(move |(statistic, name)| (*name, values(statistic)))
    }

    /// Returns the statistics in the shape of LeRobot's file: channels of images are of the shape
    /// [3, 1, 1].
    pub(crate) fn document(&self) -> Value {
        let shaped = |values: Vec<f64>| -> Value {
            if self.is_image { values.iter().map(|value| json!([[value]])).collect() } else { json!(values) }
        };
        let statistics = self.values().map(|(name, values)| (name.to_string(), shaped(values)));
        Value::Object(statistics.chain([("count".to_string(), json!([self.count]))]).collect())
    }
}

/// How often each value of each channel occurs in the images of a column.
pub(crate) struct ImageCounts {
    images: usize,
    counts: [[u64; 256]; 3],
}

impl ImageCounts {
    pub(crate) const NONE: ImageCounts = ImageCounts { images: 0, counts: [[0; 256]; 3] };

    /// Counts the pixels of an RGB image.
    pub(crate) fn add(&mut self, pixels: &[u8]) {
        self.images += 1;
        for pixel in pixels.chunks_exact(3) {
            for (counts, value) in self.counts.iter_mut().zip(pixel) {
                counts[usize::from(*value)] += 1;
            }
        }
    }

    /// Adds the counts of other images.
    pub(crate) fn merge(&mut self, other: &ImageCounts) {
        self.images += other.images;
        for (counts, other) in self.counts.as_flattened_mut().iter_mut().zip(other.counts.as_flattened()) {
            *counts += other;
        }
    }

    /// Returns the statistics per channel, of values from 0 to 1.
    pub(crate) fn statistics(&self) -> Statistics {
        let numbers = self.counts.iter().map(of_counts).collect();
        Statistics { numbers, count: self.images, is_image: true }
    }
}

/// Returns the statistics of the values 0/255 to 255/255 that occur `counts` times.
fn of_counts(counts: &[u64; 256]) -> [f64; 9] {
    let n: u64 = counts.iter().sum();
    let occurring = || counts.iter().enumerate().filter(|(_, count)| **count > 0);
    let (Some((low, _)), Some((high, _))) = (occurring().next(), occurring().next_back()) else {
        return [0.0; 9];
    };
    let sum = |term: &dyn Fn(f64) -> f64| -> f64 {
        occurring().map(|(value, count)| term(value as f64) * *count as f64).sum::<f64>() / n as f64
    };
    let mean = sum(&|value| value);
    let variance = sum(&|value| (value - mean).powi(2));
    // The value of a place in the sorted list of all.
    let at = |place: f64| {
        let mut before = 0;
        let found = counts.iter().position(|count| {
            before += count;
            place < before as f64
        });
        found.unwrap_or(high) as f64
    };
    let quantile = |(_, share): (&str, f64)| {
        let place = share * (n - 1) as f64;
        let below = at(place.floor());
        let above = at(place.ceil());
        below + (above - below) * place.fract()
    };
    let mut found = [low as f64, high as f64, mean, variance.sqrt(), 0.0, 0.0, 0.0, 0.0, 0.0];
    found[4..].copy_from_slice(&QUANTILES.map(quantile));
    found.map(|value| value / 255.0)
}
