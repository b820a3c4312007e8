//! The model of a search: when to refit its hyperparameters, when to extend it.

use super::fit::{Data, LogParameters, fit, negative_log_posterior};
use super::history::History;
use super::regression::{GaussianProcess, Posterior};
use super::space::TypedSpace;
use super::transform::{Transform, rank_correlation};

/// The numbers of evaluations that a model uses at most, so that the time of a proposal is bounded.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Limits {
    /// For predictions, when the model is new.
    pub active: usize,
    /// For the hyperparameters.
    pub fitted: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Self { active: 384, fitted: 128 }
    }
}

/// The number of evaluations between two fits is this fraction of the evaluations so far, within
/// these bounds.
const GAP: f64 = 0.3;
const GAPS: (usize, usize) = (4, 64);
/// The share of the evaluations that residuals are taken of.
const LOW: f64 = 0.25;
/// Evaluations of the likelihood in the first and in later fits.
const FIRST_EFFORT: usize = 16;
const EFFORT: usize = 8;

/// A Gaussian process of the robustness of the evaluated points.
#[derive(Debug, Clone)]
pub(crate) struct Surrogate {
    space: TypedSpace,
    transform: Transform,
    parameters: LogParameters,
    is_first: bool,
    /// The indices of the modeled evaluations in the history, and how many evaluations it had
    /// dropped then.
    active: Vec<usize>,
    n_dropped: usize,
    /// The number of evaluations that triggers the next fit.
    next_fit: usize,
    limits: Limits,
    model: Option<GaussianProcess>,
    level: f64,
    rank_correlation: f64,
    ripple: f64,
}

impl Surrogate {
    /// Creates a model without evaluations.
    pub(crate) fn new(space: TypedSpace, transform: Transform) -> Self {
        Self {
            parameters: LogParameters::prior_means(space.dimension()),
            space,
            transform,
            is_first: true,
            active: Vec::new(),
            n_dropped: 0,
            next_fit: 0,
            limits: Limits::default(),
            model: None,
            level: 0.0,
            rank_correlation: 0.0,
            ripple: 0.0,
        }
    }

    /// Returns the model with other limits.
    pub(crate) fn with_limits(self, limits: Limits) -> Self {
        Self { limits, ..self }
    }

    /// Takes all evaluations of `history` into account. Refits hyperparameters if many are new.
    pub(crate) fn update(&mut self, history: &History) {
        if history.n_dropped() + history.len() >= self.next_fit || !self.extend(history) {
            self.rebuild(history);
        } else {
            self.condition(history);
        }
    }

    /// Returns the model; `None` before the first update, or if no factorization succeeded.
    pub(super) fn model(&self) -> Option<&GaussianProcess> {
        self.model.as_ref()
    }

    /// Returns the typed coordinates.
    pub(crate) fn space(&self) -> &TypedSpace {
        &self.space
    }

    /// Returns the lengths of the coordinates.
    pub(crate) fn lengths(&self) -> Vec<f64> {
        self.parameters.lengths()
    }

    /// Returns the target of a robustness of 0.
    pub(crate) fn level(&self) -> f64 {
        self.level
    }

    /// Returns for each point how far the predicted target is above that of a robustness of 0, and
    /// the standard deviation. `None` without a model.
    pub(crate) fn margins<'a>(
        &self,
        points: impl ExactSizeIterator<Item = &'a [f64]>,
    ) -> Option<Vec<(f64, f64)>> {
        let model = self.model.as_ref()?;
        let Posterior { means, variances, .. } = model.posterior(&model.scaled(&self.space.features(points)));
        Some(
            means
                .iter()
                .zip(variances)
                .map(|(mean, variance)| (mean - self.level, variance.sqrt()))
                .collect(),
        )
    }

    /// Returns the rank correlation of targets with the leave-one-out predictions of the last fit:
    /// about 0 if the model has learned nothing.
    pub(crate) fn rank_correlation(&self) -> f64 {
        self.rank_correlation
    }

    /// Returns the spread of the leave-one-out residuals of the last fit where predictions are low.
    pub(crate) fn ripple(&self) -> f64 {
        self.ripple
    }

    /// Adds the evaluations since the last update. Returns whether the model is still valid.
    fn extend(&mut self, history: &History) -> bool {
        let Some(model) = &mut self.model else { return false };
        if self.n_dropped != history.n_dropped() {
            return false;
        }
        let first = self.active.last().map_or(0, |i| i + 1);
        let new = &history.points()[first..];
        if new.is_empty() {
            return true;
        }
        self.active.extend(first..first + new.len());
        model.extend(&self.space.features(new.iter().map(Vec::as_slice)))
    }

    fn values(&self, history: &History) -> Vec<f64> {
        self.active.iter().map(|&i| history.values()[i]).collect()
    }

    fn condition(&mut self, history: &History) {
        let (targets, level) = self.transform.targets(&self.values(history), 0.0);
        self.level = level;
        if let Some(model) = &mut self.model {
            model.condition(&targets);
        }
    }

    /// Chooses the modeled evaluations, fits the hyperparameters and factors the correlation
    /// matrix.
    fn rebuild(&mut self, history: &History) {
        let n = history.n_dropped() + history.len();
        self.next_fit = n + ((GAP * n as f64) as usize).clamp(GAPS.0, GAPS.1);
        self.fit(history);
        let chosen = history.selection(self.limits.active);
        let features = self.space.features(chosen.iter().map(|&i| history.points()[i].as_slice()));
        self.active = chosen;
        self.n_dropped = history.n_dropped();
        self.model =
            GaussianProcess::new(&features, &self.parameters.correlation(self.space.coordinate_of()));
        self.condition(history);
        if let Some(model) = &self.model {
            let predictions = model.leave_one_out();
            let targets = model.targets().as_slice();
            self.rank_correlation = rank_correlation(&predictions, targets);
            self.ripple = residual_spread(&predictions, targets);
        }
    }

    fn fit(&mut self, history: &History) {
        let chosen = history.selection(self.limits.fitted);
        let features = self.space.features(chosen.iter().map(|&i| history.points()[i].as_slice()));
        let values: Vec<f64> = chosen.iter().map(|&i| history.values()[i]).collect();
        let (targets, _) = self.transform.targets(&values, 0.0);
        let dimension = self.space.dimension();
        let coordinate_of = self.space.coordinate_of();
        let data = Data { features: &features, coordinate_of, targets: &targets, dimension };
        // The posterior density may have several maxima: starting at the prior as well leaves a
        // poor one.
        let density = |parameters: &LogParameters| {
            negative_log_posterior(&data, parameters).map_or(f64::INFINITY, |(value, _)| value)
        };
        let prior = LogParameters::prior_means(dimension);
        let restart = self.is_first || density(&prior) < density(&self.parameters);
        let start = if restart { &prior } else { &self.parameters };
        self.parameters = fit(&data, start, if restart { FIRST_EFFORT } else { EFFORT });
        self.is_first = false;
    }
}

/// Returns the root mean square of the differences between targets and leave-one-out predictions at
/// the points with the lowest predictions.
fn residual_spread(predictions: &[f64], targets: &[f64]) -> f64 {
    let mut order: Vec<usize> = (0..targets.len()).collect();
    order.sort_by(|&i, &j| predictions[i].total_cmp(&predictions[j]));
    order.truncate((targets.len() as f64 * LOW).ceil() as usize);
    let squares: f64 =
        order.iter().map(|&i| (targets[i] - predictions[i]) * (targets[i] - predictions[i])).sum();
    (squares / order.len().max(1) as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The lowest two of eight predictions have the residuals 3 and -4.
    #[test]
    fn residuals_count_where_predictions_are_low() {
        let predictions = [5.0, 1.0, 7.0, 2.0, 6.0, 9.0, 8.0, 4.0];
        let targets = [50.0, 4.0, 70.0, -2.0, 60.0, 90.0, 80.0, 40.0];
        assert_eq!(residual_spread(&predictions, &targets), 12.5_f64.sqrt());
        assert_eq!(residual_spread(&[], &[]), 0.0);
    }
}
