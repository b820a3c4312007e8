//! Functions without time, and functions for which models of parts are a bad idea.

use mishandle::random::Sequence;
use mishandle::search::Composition::{Max, Min, Part};
use mishandle::search::{Composition, Parts};

/// Values of the parts at a point, given random numbers.
type Values = fn(&[f64], &[f64]) -> Vec<f64>;

pub struct Function {
    pub name: &'static str,
    pub axes: usize,
    /// Whether the value is the greatest part, or else the least.
    is_max: bool,
    /// Whether the parts are windows of one signal.
    is_windows: bool,
    values: Values,
}

const fn function(name: &'static str, axes: usize, is_max: bool, values: Values) -> Function {
    Function { name, axes, is_max, is_windows: false, values }
}

/// The functions of the study `structure`, with random centers.
pub const FUNCTIONS: [Function; 8] = [
    function("ramps", 6, false, ramps),
    function("masked", 4, false, masked),
    function("flat", 8, false, masked_flat),
    function("balls", 6, false, balls),
    function("both-fail", 4, true, both_fail),
    function("min-max", 6, true, min_max),
    Function { is_windows: true, ..function("arrival", 4, true, arrival) },
    Function { is_windows: true, ..function("overlap", 4, true, overlap) },
];

impl Function {
    pub fn targets(&self, seed: u64) -> Vec<f64> {
        let mut random = Sequence::new(seed, 99);
        (0..32).map(|_| random.uniform()).collect()
    }

    pub fn parts(&self) -> Parts {
        let n = self.values(&vec![0.5; self.axes], &[0.5; 32]).len();
        let all: Vec<Composition> = (0..n).map(Part).collect();
        let signals = if self.is_windows { vec![0; n] } else { (0..n).collect() };
        Parts { ends: vec![1.0; n], signals, composition: if self.is_max { Max(all) } else { Min(all) } }
    }

    pub fn values(&self, u: &[f64], targets: &[f64]) -> Vec<f64> {
        (self.values)(u, targets)
    }
}

fn distance(x: &[f64], center: impl Fn(usize) -> f64) -> f64 {
    x.iter().enumerate().map(|(i, x)| (x - center(i)) * (x - center(i))).sum::<f64>().sqrt()
}

/// A number in [0.2, 0.8].
fn inner(t: f64) -> f64 {
    0.2 + 0.6 * t
}

/// Three conjuncts in units of 0.1, 1 and 100. The last one fails in a small octahedron.
fn ramps(x: &[f64], t: &[f64]) -> Vec<f64> {
    let far: f64 = (2..5).map(|i| (x[i] - inner(t[i])).abs()).sum();
    vec![0.1 * (1.05 - x[0]), 1.1 - x[1], 100.0 * (far - 0.13)]
}

/// A small margin that never fails hides a ball.
fn masked(x: &[f64], t: &[f64]) -> Vec<f64> {
    vec![0.02 + 0.002 * (5.0 * x[0] + 3.0 * x[1]).sin(), 5.0 * (distance(x, |i| inner(t[i])) - 0.2)]
}

/// A constant margin hides a slope in eight axes.
fn masked_flat(x: &[f64], t: &[f64]) -> Vec<f64> {
    let agreement: f64 = x.iter().zip(t).map(|(x, t)| (2.0 * x - 1.0) * (2.0 * t.round() - 1.0)).sum();
    vec![0.02, 0.5 - agreement / x.len() as f64]
}

/// A ball for each quarter of the time, with different centers, and a signal that never fails.
fn balls(x: &[f64], t: &[f64]) -> Vec<f64> {
    let ball = |k: usize| distance(x, |i| t[(6 * k + i) % 32]) - [0.18, 0.2, 0.32, 0.15][k];
    let other = |k: usize| 0.3 + 0.2 * (4.0 * x[k]).cos();
    (0..4).map(ball).chain((0..4).map(other)).collect()
}

/// Two conditions in different units that must both fail.
fn both_fail(x: &[f64], t: &[f64]) -> Vec<f64> {
    vec![30.0 * (0.93 - 0.5 * (x[0] + x[1])), 0.1 * ((x[2] - inner(t[2])).abs() - 0.05)]
}

/// One of two ramps of each coordinate must be low.
fn min_max(x: &[f64], t: &[f64]) -> Vec<f64> {
    let ramps = |(x, t): (&f64, &f64)| {
        let low = 0.3 + 0.3 * t;
        let high = 0.9 - 0.2 * t;
        (x - low).abs().min((x - high).abs()) - 0.09
    };
    x.iter().zip(t).map(ramps).collect()
}

/// Four windows of 10 samples of a signal that is high at one moment, whose time varies.
fn arrival(x: &[f64], t: &[f64]) -> Vec<f64> {
    let moment = (40.0 * (0.5 + 0.45 * (9.0 * x[0] + 4.0 * x[1] + 6.0 * t[5]).sin())).round();
    let height = distance(x, |i| inner(t[i])) - 0.2;
    windows(40, |time| height - 0.5 * (time as f64 - moment).abs())
}

/// Four windows of two conjuncts that each hold at some time.
fn overlap(x: &[f64], t: &[f64]) -> Vec<f64> {
    let end = 0.5 + 0.3 * distance(&x[..3], |i| inner(t[i]));
    let start = 0.56 - 0.2 * (x[3] - inner(t[3])).abs();
    windows(40, |time| {
        let time = time as f64 / 40.0;
        (end - time).min(time - start)
    })
}

/// Returns the greatest values in four windows.
fn windows(samples: usize, signal: impl Fn(usize) -> f64) -> Vec<f64> {
    let of = |w: usize| {
        let window = w * samples / 4..(w + 1) * samples / 4;
        window.map(&signal).fold(f64::NEG_INFINITY, f64::max)
    };
    (0..4).map(of).collect()
}
