//! The beta distribution and its quantiles.

use crate::chi_squared::ln_gamma_of_half;

/// Steps after which the continued fraction has converged for any argument that matters.
const MAX_STEPS: usize = 10_000;

/// Bisections, each of which halves the error.
const BISECTIONS: usize = 200;

/// Returns the value below which a beta variable with the parameters first / 2 and second / 2 is
/// with this probability.
pub(crate) fn beta_quantile(probability: f64, first: u32, second: u32) -> f64 {
    let beta = Beta::new(first, second);
    let mut low = 0.0_f64;
    let mut high = 1.0_f64;
    for _ in 0..BISECTIONS {
        let middle = 0.5 * (low + high);
        if beta.below(middle) < probability {
            low = middle;
        } else {
            high = middle;
        }
    }
    low
}

/// The beta distribution with the parameters a and b.
pub(crate) struct Beta {
    a: f64,
    b: f64,
    /// Logarithm of the beta function of a and b.
    pub ln_beta: f64,
}

impl Beta {
    /// Makes the distribution with the parameters first / 2 and second / 2.
    pub(crate) fn new(first: u32, second: u32) -> Beta {
        Beta {
            a: f64::from(first) / 2.0,
            b: f64::from(second) / 2.0,
            ln_beta: ln_gamma_of_half(first) + ln_gamma_of_half(second) - ln_gamma_of_half(first + second),
        }
    }

    /// Returns the probability of a value below `x`: the regularized incomplete beta function
    /// I_x(a, b) (Abramowitz and Stegun, "Handbook of Mathematical Functions", 26.5.8).
    pub(crate) fn below(&self, x: f64) -> f64 {
        let &Beta { a, b, ln_beta } = self;
        if x <= 0.0 || x >= 1.0 {
            return x.clamp(0.0, 1.0);
        }
        // The fraction converges fast below the mean; above it, the complement is computed.
        if x > a / (a + b) {
            return 1.0 - Beta { a: b, b: a, ln_beta }.below(1.0 - x);
        }
        (a * x.ln() + b * (-x).ln_1p() - ln_beta).exp() / a * fraction(x, a, b)
    }
}

/// Returns 1 / (1 + d₁ / (1 + d₂ / (1 + …))), evaluated from the front by Lentz's method.
fn fraction(x: f64, a: f64, b: f64) -> f64 {
    let mut c = f64::MAX;
    let mut d = 1.0;
    let mut value = 1.0;
    for step in 1..MAX_STEPS {
        let m = (step / 2) as f64;
        let coefficient = match step % 2 {
            0 => m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m)),
            _ => -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0)),
        };
        d = 1.0 / (1.0 + coefficient * d);
        c = 1.0 + coefficient / c;
        value *= c * d;
        if (c * d - 1.0).abs() < f64::EPSILON {
            break;
        }
    }
    value
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the value that an F variable exceeds with probability `tail`: x / (1 - x) =
    /// first / second F has a beta distribution.
    fn f_upper_quantile(tail: f64, first: u32, second: u32) -> f64 {
        let x = beta_quantile(1.0 - tail, first, second);
        f64::from(second) / f64::from(first) * x / (1.0 - x)
    }

    #[test]
    fn quantiles_are_those_of_tables() {
        // Upper 2.5 % and 5 % points of tables in textbooks.
        for (tail, [first, second], value) in [
            (0.025, [1, 1], 647.79),
            (0.025, [2, 5], 8.434),
            (0.025, [5, 2], 39.298),
            (0.025, [10, 10], 3.717),
            (0.025, [20, 10], 3.419),
            (0.05, [5, 18], 2.773),
            (0.05, [120, 60], 1.467),
        ] {
            let found = f_upper_quantile(tail, first, second);
            assert!((found / value - 1.0).abs() < 3e-4, "{first} and {second}: {found}");
        }
    }

    #[test]
    fn two_and_two_degrees_of_freedom_have_a_closed_form() {
        // P(F > x) = 1 / (1 + x).
        for tail in [0.5, 0.025, 1e-6] {
            let exact = 1.0 / tail - 1.0;
            assert!((f_upper_quantile(tail, 2, 2) / exact - 1.0).abs() < 1e-9, "{tail}");
        }
    }
}
