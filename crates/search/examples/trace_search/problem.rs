//! Falsification problems of plants: `always[0:T](a <= A) -> always[0:t](b <= B)`, or the conclusion
//! alone.

use std::ops::{Range, RangeInclusive};

use mishandle_random::Sequence;
use mishandle_search::Composition::{Max, Min, Part};
use mishandle_search::{Coordinate, Observation, Parts, SearchSpace};

use crate::plants::{Plant, STEPS};

/// Random episodes that choose the limits of a problem.
const RANDOM: usize = 10_000;
/// Violations among them.
const VIOLATIONS: usize = 10;

/// A plant whose inputs are linear between knots, and limits of its signals.
pub struct Problem {
    plant: Plant,
    knots: usize,
    parameters: Vec<f64>,
    /// Last samples of the windows of a and b.
    ends: [usize; 2],
    /// The signals of the formula: both, or b only.
    signals: Range<usize>,
    pub limits: [f64; 2],
}

impl Problem {
    /// Draws parameters of the plant, and chooses limits such that about one of a thousand random
    /// episodes violates the formula. The windows of a and b end at these fractions of the episode.
    pub fn new(plant: Plant, ends: [f64; 2], knots: usize, has_premise: bool, seed: u64) -> Problem {
        let mut random = Sequence::new(seed, 77);
        let parameters = (0..4).map(|_| random.uniform()).collect();
        let ends = ends.map(|end| (end * STEPS as f64) as usize);
        let signals = usize::from(!has_premise)..2;
        let mut problem = Problem { plant, knots, parameters, ends, signals, limits: [0.0; 2] };
        let mut peaks: Vec<[f64; 2]> = (0..RANDOM)
            .map(|_| problem.peaks(&(0..knots).map(|_| random.uniform()).collect::<Vec<_>>()))
            .collect();
        peaks.sort_by(|x, y| x[1].total_cmp(&y[1]));
        if !has_premise {
            problem.limits[1] = peaks[RANDOM - 1 - VIOLATIONS][1];
            return problem;
        }
        problem.limits[1] = peaks[RANDOM * 17 / 20][1];
        let mut high: Vec<f64> = peaks[RANDOM * 17 / 20..].iter().map(|peak| peak[0]).collect();
        high.sort_by(f64::total_cmp);
        problem.limits[0] = high[VIOLATIONS];
        problem
    }

    fn trace(&self, u: &[f64]) -> Vec<[f64; 2]> {
        let own = self.knots / 2;
        let of = |input: usize, time: f64| {
            let x = time * (own - 1) as f64;
            let k = (x as usize).min(own - 2);
            let [low, high] = [0, 1].map(|i| u[input * own + k + i]);
            low + (high - low) * (x - k as f64)
        };
        (self.plant)(&|time| [of(0, time), of(1, time)], &self.parameters)
    }

    fn peaks(&self, u: &[f64]) -> [f64; 2] {
        let trace = self.trace(u);
        [0, 1].map(|k| trace[..=self.ends[k]].iter().map(|x| x[k]).fold(f64::NEG_INFINITY, f64::max))
    }

    fn windows(&self, k: usize, n: usize) -> Vec<RangeInclusive<usize>> {
        let samples = self.ends[k] + 1;
        (0..n).map(|w| w * samples / n..=(w + 1) * samples / n - 1).collect()
    }

    pub fn space(&self, variant: &Variant) -> SearchSpace {
        let own = self.knots / 2;
        // A knot acts after the knot before it.
        let begin = |k: usize| (k % own).saturating_sub(1) as f64 / (own - 1) as f64;
        let begins = (0..self.knots).map(|k| if variant.is_causal { begin(k) } else { 0.0 }).collect();
        let end = |w: RangeInclusive<usize>| *w.end() as f64 / STEPS as f64;
        let parts = match variant.observed {
            Observed::Robustness => None,
            Observed::OnePart => Some(Parts {
                ends: vec![1.0; 2],
                signals: vec![0, 1],
                composition: Max(vec![Part(0), Part(1)]),
            }),
            Observed::Windows(n) => Some(Parts {
                ends: self.signals.clone().flat_map(|k| self.windows(k, n)).map(end).collect(),
                signals: self.signals.clone().flat_map(|k| vec![k; n]).collect(),
                composition: match self.signals.start {
                    0 => Max(vec![Max((0..n).map(Part).collect()), Min((n..2 * n).map(Part).collect())]),
                    _ => Min((0..n).map(Part).collect()),
                },
            }),
        };
        SearchSpace { begins, parts, ..SearchSpace::from(&vec![Coordinate::Continuous; self.knots]) }
    }

    pub fn observation(&self, u: &[f64], variant: &Variant) -> Observation {
        let trace = self.trace(u);
        let peak = |k: usize, w: RangeInclusive<usize>| {
            trace[w].iter().map(|x| x[k]).fold(f64::NEG_INFINITY, f64::max)
        };
        let value = |(k, w)| {
            let above = peak(k, w) - self.limits[k];
            if k == 0 { above } else { -above * variant.scale }
        };
        let of_signal = |k: usize| value((k, 0..=self.ends[k]));
        let robustness = self.signals.clone().map(of_signal).fold(f64::NEG_INFINITY, f64::max);
        let parts = match variant.observed {
            Observed::Robustness => Vec::new(),
            Observed::OnePart => vec![robustness; 2],
            Observed::Windows(n) => {
                let windows = |k| self.windows(k, n).into_iter().map(move |w| (k, w));
                self.signals.clone().flat_map(windows).map(value).collect()
            }
        };
        Observation { robustness, parts }
    }
}

/// The observations of a search.
#[derive(Clone, Copy)]
pub struct Variant {
    pub name: &'static str,
    pub observed: Observed,
    is_causal: bool,
    /// Factor of the robustness of b.
    scale: f64,
}

#[derive(Clone, Copy, PartialEq)]
pub enum Observed {
    /// The robustness only.
    Robustness,
    /// The robustness as its only part, twice, because a search ignores a single part.
    OnePart,
    /// The extrema of a and b in this many windows.
    Windows(usize),
}

const fn variant(name: &'static str, observed: Observed, is_causal: bool, scale: f64) -> Variant {
    Variant { name, observed, is_causal, scale }
}

pub const VARIANTS: [Variant; 9] = [
    variant("today", Observed::Robustness, false, 1.0),
    variant("trace", Observed::Windows(4), true, 1.0),
    variant("windows", Observed::Windows(4), false, 1.0),
    variant("causal", Observed::Windows(1), true, 1.0),
    variant("leaves", Observed::Windows(1), false, 1.0),
    variant("whole", Observed::OnePart, false, 1.0),
    variant("today-1", Observed::Robustness, false, 1e-3),
    variant("whole-1", Observed::OnePart, false, 1e-3),
    variant("trace-1", Observed::Windows(4), true, 1e-3),
];
