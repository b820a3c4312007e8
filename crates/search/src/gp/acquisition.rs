//! The choice of the next points among candidates.

use std::ops::Range;

use super::candidates::{Candidates, Region};
use super::elementary::normal_tail;
use super::history::History;
use super::kernel::{ScaledPoints, correlation};
use super::pathwise::posterior_samples;
use super::refine::refined;
use super::regression::Posterior;
use super::surrogate::Surrogate;
use mishandle_random::Sequence;

/// Candidates are as good as the best one with respect to ripple if a violation is at least this
/// fraction as probable.
const GOOD: f64 = 0.25;

/// A batch of candidates under construction. The variance shrinks around each chosen candidate as
/// if its value were known; the mean does not change.
///
/// # Reference
/// Desautels, Krause and Burdick, "Parallelizing exploration-exploitation tradeoffs in Gaussian
/// process bandit optimization", JMLR 15, 2014.
pub(crate) struct Batch {
    scaled: ScaledPoints,
    posterior: Posterior,
    variance: f64,
    noise: f64,
    /// For each chosen candidate, its posterior covariance with all others over its standard
    /// deviation.
    columns: Vec<Vec<f64>>,
    taken: Vec<bool>,
}

impl Batch {
    /// Computes the posterior of all candidates. `None` without a model.
    pub(crate) fn new(surrogate: &Surrogate, candidates: &Candidates) -> Option<Self> {
        let model = surrogate.model()?;
        let scaled = model.scaled(&surrogate.space().features(candidates.points()));
        let posterior = model.posterior(&scaled);
        let taken = vec![false; candidates.len()];
        let variance = model.variance;
        let noise = model.noise;
        Some(Self { scaled, posterior, variance, noise, columns: Vec::new(), taken })
    }

    /// Chooses the candidate among `range` with the lowest mean minus `kappa` standard deviations.
    /// `None` if all are taken.
    pub(crate) fn choose(&mut self, range: Range<usize>, kappa: f64) -> Option<usize> {
        let chosen = self.lowest(range, kappa)?;
        self.take(chosen);
        Some(chosen)
    }

    fn lowest(&self, range: Range<usize>, kappa: f64) -> Option<usize> {
        let bound = |i: usize| self.posterior.means[i] - kappa * self.posterior.variances[i].sqrt();
        let free = range.filter(|&i| !self.taken[i]);
        free.min_by(|&i, &j| bound(i).total_cmp(&bound(j)))
    }

    /// Moves the candidate among `range` with the lowest mean minus `kappa` standard deviations to
    /// the nearest local minimizer in `region`, unless that is in `history`.
    pub(crate) fn refine(
        &mut self,
        surrogate: &Surrogate,
        candidates: &mut Candidates,
        history: &History,
        range: Range<usize>,
        region: &Region,
        kappa: f64,
    ) {
        let (Some(model), Some(start)) = (surrogate.model(), self.lowest(range, kappa)) else {
            return;
        };
        let Some(point) = refined(surrogate, candidates.point(start), region, kappa) else {
            return;
        };
        if history.contains(&point) {
            return;
        }
        candidates.replace(start, &point);
        let scaled = model.scaled(&surrogate.space().features(std::iter::once(point.as_slice())));
        let moved = model.posterior(&scaled);
        self.scaled.rows.row_mut(start).copy_from(&scaled.rows.row(0));
        self.scaled.squared_norms[start] = scaled.squared_norms[0];
        self.posterior.means[start] = moved.means[0];
        self.posterior.variances[start] = moved.variances[0];
        self.posterior.whitened.column_mut(start).copy_from(&moved.whitened.column(0));
    }

    /// Chooses a candidate that is likely to be below `level` because of ripple with the standard
    /// deviation `ripple`. `None` if all are taken.
    ///
    /// Ripple that is shorter than the distances between points has independent values at them, but
    /// about the same value near an evaluated point. So this is a random one of the better half of
    /// the good candidates: the half that is farther from evaluated points.
    pub(crate) fn choose_by_ripple(
        &mut self,
        candidates: &Candidates,
        history: &History,
        level: f64,
        ripple: f64,
        stream: &mut Sequence,
    ) -> Option<usize> {
        let probability = |i: usize| {
            let deviation = (self.posterior.variances[i] + ripple * ripple).sqrt().max(f64::MIN_POSITIVE);
            normal_tail((self.posterior.means[i] - level) / deviation)
        };
        let free = (0..self.taken.len()).filter(|&i| !self.taken[i]);
        let free: Vec<(usize, f64)> = free.map(|i| (i, probability(i))).collect();
        let largest = free.iter().map(|(_, p)| *p).fold(0.0, f64::max);
        let good = free.iter().filter(|(_, p)| *p >= GOOD * largest);
        let mut far: Vec<(usize, f64)> =
            good.map(|&(i, _)| (i, history.squared_distance(candidates.point(i)))).collect();
        far.sort_by(|a, b| b.1.total_cmp(&a.1));
        far.truncate(far.len().div_ceil(2));
        let (chosen, _) = *far.get(stream.below(far.len().max(1) as u64) as usize)?;
        self.take(chosen);
        Some(chosen)
    }

    /// Returns how many standard deviations the mean of a candidate is above `level`: the least
    /// number of all candidates. The variances are those of the model and of `ripple`.
    pub(crate) fn distance(&self, level: f64, ripple: f64) -> f64 {
        let Posterior { means, variances, .. } = &self.posterior;
        let deviation = |v: &f64| (v + ripple * ripple).sqrt().max(f64::MIN_POSITIVE);
        let distances = means.iter().zip(variances).map(|(m, v)| (m - level) / deviation(v));
        distances.fold(f64::INFINITY, f64::min)
    }

    /// Shrinks the variances around candidate `j`.
    fn take(&mut self, j: usize) {
        self.taken[j] = true;
        let deviation = (self.posterior.variances[j] + self.variance * self.noise).sqrt();
        let whitened = &self.posterior.whitened;
        let rows = &self.scaled.rows;
        let norms = &self.scaled.squared_norms;
        let products = rows * rows.row(j).transpose();
        let explained = whitened.tr_mul(&whitened.column(j));
        let mut column: Vec<f64> = (0..self.taken.len())
            .map(|i| {
                let squared = (norms[i] + norms[j] - 2.0 * products[i]).max(0.0);
                self.variance * (correlation(squared) - explained[i])
            })
            .collect();
        for earlier in &self.columns {
            let factor = earlier[j];
            column.iter_mut().zip(earlier).for_each(|(c, e)| *c -= factor * e);
        }
        for (c, variance) in column.iter_mut().zip(&mut self.posterior.variances) {
            *c /= deviation;
            *variance = (*variance - *c * *c).max(0.0);
        }
        self.columns.push(column);
    }
}

/// Returns, for each of `n` samples of the posterior, the candidate with its lowest value; each
/// candidate at most once.
pub(crate) fn thompson(
    surrogate: &Surrogate,
    candidates: &Candidates,
    n: usize,
    stream: &mut Sequence,
) -> Vec<usize> {
    let Some(model) = surrogate.model() else { return Vec::new() };
    let features = surrogate.space().features(candidates.points());
    let samples = posterior_samples(model, &features, n, stream);
    let mut chosen: Vec<usize> = Vec::with_capacity(n);
    for sample in samples.column_iter() {
        let free = (0..candidates.len()).filter(|i| !chosen.contains(i));
        chosen.extend(free.min_by(|&i, &j| sample[i].total_cmp(&sample[j])));
    }
    chosen
}
