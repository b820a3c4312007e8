//! Weights and learning rates of CMA-ES, as functions of the dimension and the population.

/// The strategy parameters of Table 1 in Hansen's tutorial, with its names.
#[derive(Debug, Clone)]
pub(super) struct Parameters {
    /// Recombination weights by rank. The first `mu` are positive and sum to 1; the others are
    /// negative or 0.
    pub(super) weights: Vec<f64>,
    pub(super) mu: usize,
    pub(super) mu_eff: f64,
    pub(super) c_sigma: f64,
    pub(super) d_sigma: f64,
    pub(super) c_c: f64,
    pub(super) c_1: f64,
    pub(super) c_mu: f64,
    /// The expected length of a standard normal vector, approximately.
    pub(super) chi: f64,
    /// Generations between two eigendecompositions.
    pub(super) eigen_interval: usize,
}

impl Parameters {
    /// Computes the parameters for `n` numbers and a population of at least 2.
    pub(super) fn new(n: usize, population: usize) -> Self {
        let dimension = n as f64;
        let lambda = population as f64;
        let raw: Vec<f64> = (1..=population).map(|i| ((lambda + 1.0) / 2.0).ln() - (i as f64).ln()).collect();
        let mu = population / 2;
        let (positive, negative) = raw.split_at(mu);
        let mu_eff = effective(positive);
        let mu_eff_negative = effective(negative);
        let c_1 = 2.0 / ((dimension + 1.3).powi(2) + mu_eff);
        let c_mu = (2.0 * (0.25 + mu_eff + 1.0 / mu_eff - 2.0) / ((dimension + 2.0).powi(2) + mu_eff))
            .min(1.0 - c_1);
        let limit = (1.0 + c_1 / c_mu)
            .min(1.0 + 2.0 * mu_eff_negative / (mu_eff + 2.0))
            .min((1.0 - c_1 - c_mu) / (dimension * c_mu));
        let sum = |weights: &[f64]| weights.iter().map(|w| w.abs()).sum::<f64>();
        let sum_positive = sum(positive);
        let sum_negative = sum(negative).max(f64::MIN_POSITIVE);
        let scaled = |w: &f64| if *w > 0.0 { w / sum_positive } else { w * limit / sum_negative };
        let c_sigma = (mu_eff + 2.0) / (dimension + mu_eff + 5.0);
        let d_sigma = 1.0 + 2.0 * (((mu_eff - 1.0) / (dimension + 1.0)).sqrt() - 1.0).max(0.0) + c_sigma;
        Self {
            weights: raw.iter().map(scaled).collect(),
            mu,
            mu_eff,
            c_sigma,
            d_sigma,
            c_c: (4.0 + mu_eff / dimension) / (dimension + 4.0 + 2.0 * mu_eff / dimension),
            c_1,
            c_mu,
            chi: dimension.sqrt() * (1.0 - 0.25 / dimension + 1.0 / (21.0 * dimension * dimension)),
            eigen_interval: ((1.0 / (10.0 * dimension * (c_1 + c_mu))) as usize).max(1),
        }
    }
}

/// Returns the variance-effective number of weights, (Σ w)² / Σ w².
fn effective(weights: &[f64]) -> f64 {
    let sum: f64 = weights.iter().sum();
    let squares: f64 = weights.iter().map(|w| w * w).sum();
    if squares > 0.0 { sum * sum / squares } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The conditions that the tutorial states for its weights: the positive ones sum to 1, the
    /// negative ones to -min(1 + c₁/cμ, 1 + 2 μ⁻/(μ + 2), (1 - c₁ - cμ)/(n cμ)), and μ_eff is about
    /// λ/4.
    #[test]
    fn weights_have_the_sums_of_the_tutorial() {
        for (n, population) in [(1, 4), (2, 6), (10, 10), (30, 14), (100, 17), (10, 320)] {
            let p = Parameters::new(n, population);
            let sum = |keep: fn(&&f64) -> bool| p.weights.iter().filter(keep).sum::<f64>();
            assert!((sum(|w| **w > 0.0) - 1.0).abs() < 1e-12, "{p:?}");
            assert!(p.weights.windows(2).all(|pair| pair[0] >= pair[1]) && p.weights[p.mu - 1] > 0.0);
            assert!((population as f64 * 0.2..population as f64 * 0.45).contains(&p.mu_eff), "{p:?}");
            let bound = (1.0 - p.c_1 - p.c_mu) / (n as f64 * p.c_mu);
            assert!(-sum(|w| **w < 0.0) <= bound + 1e-12 && p.c_1 + p.c_mu <= 1.0, "{p:?}");
        }
    }

    /// The default values of n = 10 and λ = 10, computed from the formulas of the tutorial with 16
    /// digits in Python.
    #[test]
    fn parameters_of_ten_dimensions() {
        let p = Parameters::new(10, 10);
        let close =
            |found: f64, expected: f64| assert!((found - expected).abs() < 1e-10, "{found} {expected}");
        close(p.mu_eff, 3.167299281411);
        close(p.c_1, 0.015283824525);
        close(p.c_mu, 0.02355177665);
        close(p.c_sigma, 0.284428587946);
        close(p.d_sigma, 1.284428587946);
        close(p.c_c, 0.294990383036);
        close(p.weights[0], 0.456272646903);
        close(p.weights[9], -0.549749917697);
    }
}
