//! Agreement of the model with scikit-learn, whose results `tests/golden/gaussian_process/make.py`
//! writes, and with finite differences.

use std::fs;
use std::path::Path;

use mishandle_random::Sequence;
use nalgebra::DMatrix;
use serde::Deserialize;

use super::fit::{Data, LogParameters, fit, negative_log_posterior};
use super::pathwise::posterior_samples;
use super::refine::bound_and_gradient;
use super::regression::{Correlation, GaussianProcess};

#[derive(Deserialize)]
struct Golden {
    cases: Vec<Case>,
}

#[derive(Deserialize)]
struct Case {
    points: Vec<Vec<f64>>,
    targets: Vec<f64>,
    lengths: Vec<f64>,
    variance: f64,
    noise: f64,
    mean: f64,
    queries: Vec<Vec<f64>>,
    posterior_means: Vec<f64>,
    posterior_deviations: Vec<f64>,
    log_likelihood: f64,
    leave_one_out: Vec<f64>,
}

impl Case {
    fn parameters(&self) -> Correlation {
        Correlation { lengths: self.lengths.clone(), noise: self.noise }
    }

    fn model(&self, n: usize) -> GaussianProcess {
        GaussianProcess::new(&columns(&self.points[..n]), &self.parameters()).expect("positive definite")
    }

    fn conditioned(&self) -> GaussianProcess {
        let mut model = self.model(self.points.len());
        model.condition_with(&self.targets, self.mean, self.variance);
        model
    }
}

fn cases() -> Vec<Case> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/gaussian_process/posterior.json");
    let text = fs::read_to_string(path).expect("the golden file");
    serde_json::from_str::<Golden>(&text).expect("its format").cases
}

fn columns(points: &[Vec<f64>]) -> DMatrix<f64> {
    DMatrix::from_fn(points[0].len(), points.len(), |k, i| points[i][k])
}

fn assert_close(found: &[f64], expected: &[f64], tolerance: f64) {
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(expected) {
        assert!((found - expected).abs() <= tolerance, "found {found}, expected {expected}");
    }
}

fn assert_posterior(model: &GaussianProcess, case: &Case) {
    let posterior = model.posterior(&model.scaled(&columns(&case.queries)));
    let deviations: Vec<f64> = posterior.variances.iter().map(|v| v.sqrt()).collect();
    assert_close(&posterior.means, &case.posterior_means, 1e-8);
    assert_close(&deviations, &case.posterior_deviations, 1e-7);
}

#[test]
fn posterior_and_likelihood_agree_with_scikit_learn() {
    for case in cases() {
        let model = case.conditioned();
        assert_posterior(&model, &case);
        assert_close(&[model.log_likelihood()], &[case.log_likelihood], 1e-6);
    }
}

#[test]
fn leave_one_out_means_agree_with_models_of_the_other_points() {
    for case in cases() {
        assert_close(&case.conditioned().leave_one_out(), &case.leave_one_out, 1e-7);
    }
}

/// Points that arrive in blocks give the same posterior as all at once.
#[test]
fn an_extended_model_agrees_with_scikit_learn() {
    for case in cases() {
        let n = case.points.len();
        let mut model = case.model(2);
        for (from, to) in [(2, 3), (3, n)] {
            assert!(model.extend(&columns(&case.points[from..to])), "positive definite");
        }
        model.condition_with(&case.targets, case.mean, case.variance);
        assert_posterior(&model, &case);
    }
}

/// Generalized least squares: the derivative of the log likelihood by the mean vanishes, so a
/// shifted mean is worse.
#[test]
fn estimated_mean_maximizes_the_likelihood() {
    for case in cases() {
        let mut model = case.model(case.points.len());
        model.condition(&case.targets);
        let mean = model.mean;
        let variance = model.variance;
        let mut likelihood_at = |mean| {
            model.condition_with(&case.targets, mean, variance);
            model.log_likelihood()
        };
        let at_mean = likelihood_at(mean);
        assert!(likelihood_at(mean - 1e-3) < at_mean && likelihood_at(mean + 1e-3) < at_mean);
    }
}

fn log_parameters(case: &Case) -> LogParameters {
    LogParameters(case.lengths.iter().chain([&case.noise]).map(|x| x.ln()).collect())
}

fn with_data<T>(case: &Case, body: impl FnOnce(&Data<'_>) -> T) -> T {
    let coordinate_of: Vec<usize> = (0..case.lengths.len()).collect();
    let features = columns(&case.points);
    body(&Data {
        features: &features,
        coordinate_of: &coordinate_of,
        targets: &case.targets,
        dimension: case.lengths.len(),
    })
}

#[test]
fn gradient_of_the_posterior_density_agrees_with_differences() {
    for case in cases() {
        with_data(&case, |data| {
            let at = log_parameters(&case);
            let value =
                |parameters: &LogParameters| negative_log_posterior(data, parameters).expect("definite").0;
            let (_, gradient) = negative_log_posterior(data, &at).expect("positive definite");
            for (k, g) in gradient.iter().enumerate() {
                let mut below = at.clone();
                let mut above = at.clone();
                below.0[k] -= 1e-5;
                above.0[k] += 1e-5;
                let difference = (value(&above) - value(&below)) / 2e-5;
                assert!(
                    (difference - g).abs() < 1e-4 * (1.0 + g.abs()),
                    "{k}: {g}, differences {difference}"
                );
            }
        });
    }
}

/// A fit ends where no parameter alone improves the density by more than the tolerance.
#[test]
fn fit_increases_the_posterior_density_to_a_maximum() {
    for case in cases() {
        with_data(&case, |data| {
            let density = |at: &LogParameters| -negative_log_posterior(data, at).expect("definite").0;
            let start = LogParameters::prior_means(data.dimension);
            let fitted = fit(data, &start, 100);
            assert!(density(&fitted) > density(&start));
            for k in 0..=data.dimension {
                for step in [-0.1, 0.1] {
                    let mut neighbor = fitted.clone();
                    neighbor.0[k] += step;
                    assert!(density(&neighbor) < density(&fitted) + 1e-3, "parameter {k} by {step}");
                }
            }
        });
    }
}

#[test]
fn gradient_of_the_lower_confidence_bound_agrees_with_differences() {
    for case in cases() {
        let model = case.conditioned();
        let query = columns(&case.queries[..1]);
        let (_, gradient) = bound_and_gradient(&model, &query, 1.7);
        for k in 0..query.nrows() {
            let at = |step: f64| {
                let mut moved = query.clone();
                moved[(k, 0)] += step;
                bound_and_gradient(&model, &moved, 1.7).0
            };
            let difference = (at(1e-5) - at(-1e-5)) / 2e-5;
            assert!((difference - gradient[k]).abs() < 1e-4 * (1.0 + difference.abs()), "{difference}");
        }
    }
}

/// Means and variances of many samples agree with the posterior. The tolerances are five standard
/// errors plus the error of the random features.
#[test]
fn samples_have_the_moments_of_the_posterior() {
    for case in &cases()[..3] {
        let model = case.conditioned();
        let queries = columns(&case.queries);
        let posterior = model.posterior(&model.scaled(&queries));
        let mut sums = vec![0.0; queries.ncols()];
        let mut squares = vec![0.0; queries.ncols()];
        let mut stream = Sequence::new(3, 0);
        let rounds = 100;
        let per_round = 20;
        for _ in 0..rounds {
            let samples = posterior_samples(&model, &queries, per_round, &mut stream);
            for (i, row) in samples.row_iter().enumerate() {
                sums[i] += row.sum();
                squares[i] += row.norm_squared();
            }
        }
        let n = f64::from(rounds) * per_round as f64;
        for i in 0..sums.len() {
            let mean = sums[i] / n;
            let variance = squares[i] / n - (sums[i] / n) * (sums[i] / n);
            let expected = posterior.variances[i];
            let scale = model.variance.sqrt();
            assert!(
                (mean - posterior.means[i]).abs() < 5.0 * (expected / n).sqrt() + 0.02 * scale,
                "{i}: {mean}"
            );
            assert!(
                (variance - expected).abs() < 0.25 * expected + 0.01 * model.variance,
                "{i}: {variance} {expected}"
            );
        }
    }
}
