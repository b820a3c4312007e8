//! The proposal distribution of importance sampling: a mixture of normal distributions and the
//! distribution itself.

use mishandle_random::{Seed, Sequence};

use crate::gaussian::Gaussian;
use crate::{Draw, Scenarios};

/// Share of the distribution itself.
pub(crate) const NOMINAL: f64 = 0.1;

/// Largest number of components.
const MOST_COMPONENTS: usize = 8;

/// Smallest share of a component, so that no region is forgotten.
const SMALLEST_SHARE: f64 = 0.02;

/// Steps of expectation maximization of a first fit.
const STEPS: usize = 20;

/// Largest number of points of a first fit.
const MOST_POINTS: usize = 800;

#[derive(Clone, Debug)]
struct Component {
    share: f64,
    gaussian: Gaussian,
}

/// A defensive mixture: with probability 0.1 a draw of the distribution itself, otherwise of one of
/// the components.
///
/// The weight of a draw, the density of the distribution divided by that of the mixture, is
/// therefore at most 10, whatever the components.
///
/// # Reference
/// Hesterberg, "Weighted average importance sampling and defensive mixture distributions",
/// Technometrics 37, 1995. Owen and Zhou, "Safe and effective importance sampling", JASA 95, 2000.
#[derive(Clone, Debug)]
pub(crate) struct Proposal {
    components: Vec<Component>,
}

impl Proposal {
    /// Fits a mixture to failing points. The number of components, from 1 to 8, is the one with the
    /// lowest Bayesian information criterion. Returns `None` without points.
    pub(crate) fn fit(points: &[Vec<f64>]) -> Option<Proposal> {
        let step = points.len().div_ceil(MOST_POINTS).max(1);
        let points: Vec<&[f64]> = points.iter().step_by(step).map(Vec::as_slice).collect();
        let weighted: Vec<(&[f64], f64)> = points.iter().map(|point| (*point, 1.0)).collect();
        let mut best: Option<(f64, Proposal)> = None;
        for k in 1..=MOST_COMPONENTS.min(points.len()) {
            let centers: Vec<&[f64]> = centers(&points, k).into_iter().map(|index| points[index]).collect();
            let Some(mut proposal) = Proposal::around(&points, &centers) else { continue };
            (0..STEPS).for_each(|_| proposal.update(&weighted));
            let criterion = proposal.criterion(&points);
            if best.as_ref().is_none_or(|(least, _)| criterion < *least) {
                best = Some((criterion, proposal));
            }
        }
        best.map(|(_, proposal)| proposal)
    }

    /// Makes a component of the points nearest to each center.
    fn around(points: &[&[f64]], centers: &[&[f64]]) -> Option<Proposal> {
        let nearest = |point: &[f64]| {
            let by_distance = |a: &usize, b: &usize| {
                squared_distance(point, centers[*a]).total_cmp(&squared_distance(point, centers[*b]))
            };
            (0..centers.len()).min_by(by_distance)
        };
        let nearest: Vec<Option<usize>> = points.iter().map(|point| nearest(point)).collect();
        let component = |center: usize| {
            let own = points.iter().zip(&nearest).filter(move |(_, nearest)| **nearest == Some(center));
            let gaussian = Gaussian::fit(own.map(|(point, _)| (*point, 1.0)))?;
            Some(Component { share: 1.0 / centers.len() as f64, gaussian })
        };
        let components = (0..centers.len()).map(component).collect::<Option<Vec<Component>>>()?;
        Some(Proposal { components })
    }

    /// Returns the Bayesian information criterion of the components, without the distribution
    /// itself.
    fn criterion(&self, points: &[&[f64]]) -> f64 {
        let log_density = |point: &&[f64]| -> f64 {
            let logs: Vec<f64> = self.log_terms(point);
            log_sum(&logs) - 0.5 * point.iter().map(|z| z * z).sum::<f64>()
        };
        let likelihood: f64 = points.iter().map(log_density).sum();
        let d = points.first().map_or(0, |point| point.len()) as f64;
        // Means and variances.
        let parameters = self.components.len() as f64 * (2.0 * d + 1.0);
        parameters * (points.len() as f64).ln() - 2.0 * likelihood
    }

    /// Returns for each component the logarithm of its share times its density, divided by that of
    /// the standard normal distribution.
    fn log_terms(&self, point: &[f64]) -> Vec<f64> {
        self.components
            .iter()
            .map(|component| component.share.ln() + component.gaussian.log_ratio(point))
            .collect()
    }

    /// Moves shares, means and covariances toward those of weighted failing points: a step of
    /// expectation maximization, which for draws of the mixture and their weights is a step of
    /// cross-entropy minimization. A component without points keeps its place.
    ///
    /// # Reference
    /// Cappé, Douc, Guillin, Marin and Robert, "Adaptive importance sampling in general mixture
    /// classes", Statistics and Computing 18, 2008.
    pub(crate) fn update(&mut self, points: &[(&[f64], f64)]) {
        let total: f64 = points.iter().map(|(_, weight)| weight).sum();
        if total <= 0.0 {
            return;
        }
        let responsibilities: Vec<Vec<f64>> = points
            .iter()
            .map(|(point, weight)| {
                let terms = self.log_terms(point);
                let sum = log_sum(&terms);
                terms.iter().map(|term| weight / total * (term - sum).exp()).collect()
            })
            .collect();
        for (k, component) in self.components.iter_mut().enumerate() {
            let own = || points.iter().zip(&responsibilities).map(|((point, _), row)| (*point, row[k]));
            component.share = own().map(|(_, weight)| weight).sum::<f64>().max(SMALLEST_SHARE);
            let effective = effective_size(own().map(|(_, weight)| weight));
            if effective >= 4.0
                && let Some(gaussian) = Gaussian::fit(own())
            {
                component.gaussian = gaussian;
            }
        }
        let sum: f64 = self.components.iter().map(|component| component.share).sum();
        self.components.iter_mut().for_each(|component| component.share /= sum);
    }

    /// Returns the number of components.
    pub(crate) fn components(&self) -> usize {
        self.components.len()
    }

    /// Draws from the mixture.
    pub(crate) fn draw(&self, scenarios: &Scenarios, random: &mut Sequence) -> Draw {
        if random.uniform() < NOMINAL {
            return scenarios.draw(random);
        }
        let mut left = random.uniform();
        let mut chosen = &self.components[0];
        for component in &self.components {
            chosen = component;
            if left < component.share {
                break;
            }
            left -= component.share;
        }
        Draw { latent: chosen.gaussian.draw(random), seed: Seed(random.bits()) }
    }

    /// Returns the weight of a draw: the density of the distribution divided by that of the
    /// mixture.
    pub(crate) fn weight(&self, point: &[f64]) -> f64 {
        1.0 / (NOMINAL + (1.0 - NOMINAL) * log_sum(&self.log_terms(point)).exp())
    }
}

/// Returns the number of equal weights with the same precision.
pub(crate) fn effective_size(weights: impl Iterator<Item = f64>) -> f64 {
    let (sum, squares) = weights.fold((0.0, 0.0), |(sum, squares), w| (sum + w, squares + w * w));
    if squares > 0.0 { sum * sum / squares } else { 0.0 }
}

/// Returns the indices of `k` points that are far apart: the first, and then always the one that is
/// farthest from the chosen ones.
pub(crate) fn centers(points: &[&[f64]], k: usize) -> Vec<usize> {
    let mut chosen = Vec::new();
    let mut distances = vec![f64::INFINITY; points.len()];
    while chosen.len() < k.min(points.len()) {
        let next = match chosen.last() {
            None => 0,
            Some(_) => (0..points.len()).max_by(|a, b| distances[*a].total_cmp(&distances[*b])).unwrap_or(0),
        };
        chosen.push(next);
        for (distance, point) in distances.iter_mut().zip(points) {
            *distance = distance.min(squared_distance(point, points[next]));
        }
    }
    chosen
}

fn squared_distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum()
}

/// Returns ln Σ exp(xᵢ).
pub(crate) fn log_sum(logs: &[f64]) -> f64 {
    let largest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if largest.is_infinite() {
        return largest;
    }
    largest + logs.iter().map(|log| (log - largest).exp()).sum::<f64>().ln()
}
