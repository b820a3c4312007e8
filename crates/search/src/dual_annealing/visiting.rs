//! The visiting distribution of generalized simulated annealing: heavy-tailed jumps.

use mishandle_random::Sequence;

/// Longer jumps are replaced by a uniformly distributed fraction of this length.
const TAIL_LIMIT: f64 = 1e8;
/// Coordinates below this value are increased by it.
const MIN_COORDINATE: f64 = 1e-10;

/// The distorted Cauchy-Lorentz distribution of generalized simulated annealing, wrapped into
/// `[0,1]^d`.
///
/// With x and y standard normal and q in (1, 3) the visiting parameter, a jump at temperature T is
///
/// ```text
/// Δ = σ x / |y|^((q-1)/(3-q)),   σ = (F₄ / Γ(F₅))^((q-1)/(3-q))
/// F₄ = sqrt(π) T^(1/(q-1)) exp((4-q) ln(q-1)) / (exp((2-q) ln 2 / (q-1)) (3-q)),   F₅ = 1/(q-1) - 1/2
/// ```
///
/// # Reference
/// Tsallis and Stariolo, "Generalized simulated annealing", Physica A 233, 1996, p. 405.
#[derive(Debug, Clone)]
pub struct VisitingDistribution {
    visit: f64,
    /// F₄ at temperature 1.
    factor: f64,
    /// Γ(F₅).
    gamma: f64,
}

impl VisitingDistribution {
    /// Creates the distribution with the visiting parameter q = `visit`, which must be in (1, 3).
    pub fn new(visit: f64) -> Self {
        let numerator = std::f64::consts::PI.sqrt() * ((4.0 - visit) * (visit - 1.0).ln()).exp();
        let denominator = ((2.0 - visit) * std::f64::consts::LN_2 / (visit - 1.0)).exp() * (3.0 - visit);
        let gamma = gamma(1.0 / (visit - 1.0) - 0.5);
        Self { visit, factor: numerator / denominator, gamma }
    }

    /// Samples one jump at `temperature`, before the tails are limited.
    pub fn jump(&self, temperature: f64, stream: &mut Sequence) -> f64 {
        let power = (self.visit - 1.0) / (3.0 - self.visit);
        let factor = self.factor * (temperature.ln() / (self.visit - 1.0)).exp();
        let sigma = (power * (factor / self.gamma).ln()).exp();
        let (x, y) = stream.normal_pair();
        sigma * x / (power * y.abs().ln()).exp()
    }

    /// Samples the point visited from `u` at `temperature` in step `j` of a Markov chain of length
    /// 2d. All coordinates jump in the first d steps; only coordinate j - d jumps in the others.
    pub fn visit(&self, u: &[f64], j: usize, temperature: f64, stream: &mut Sequence) -> Vec<f64> {
        let mut visited = u.to_vec();
        if j < u.len() {
            let jumps: Vec<f64> = u.iter().map(|_| self.jump(temperature, stream)).collect();
            // One fraction for all long upward jumps and one for all long downward jumps.
            let up = stream.uniform();
            let down = stream.uniform();
            visited.iter_mut().zip(jumps).for_each(|(x, jump)| *x = wrapped(*x + limited(jump, up, down)));
        } else {
            let jump = self.jump(temperature, stream);
            let fraction = stream.uniform();
            let x = &mut visited[j - u.len()];
            *x = wrapped(*x + limited(jump, fraction, fraction));
        }
        visited
    }
}

fn limited(jump: f64, up: f64, down: f64) -> f64 {
    if jump > TAIL_LIMIT {
        TAIL_LIMIT * up
    } else if jump < -TAIL_LIMIT {
        -TAIL_LIMIT * down
    } else {
        jump
    }
}

/// Returns the coordinate modulo 1, at least [`MIN_COORDINATE`].
fn wrapped(x: f64) -> f64 {
    let inside = (x % 1.0 + 1.0) % 1.0;
    if inside < MIN_COORDINATE { inside + MIN_COORDINATE } else { inside }
}

/// Returns the gamma function of a positive number by the Lanczos approximation (g = 7, nine terms;
/// relative error below 1e-14).
fn gamma(x: f64) -> f64 {
    const TERMS: [f64; 8] = [
        676.520_368_121_885_1,
        -1_259.139_216_722_402_8,
        771.323_428_777_653_1,
        -176.615_029_162_140_6,
        12.507_343_278_686_905,
        -0.138_571_095_265_720_12,
        9.984_369_578_019_572e-6,
        1.505_632_735_149_311_6e-7,
    ];
    if x < 0.5 {
        return std::f64::consts::PI / ((std::f64::consts::PI * x).sin() * gamma(1.0 - x));
    }
    let z = x - 1.0;
    let terms = TERMS.iter().zip(1_u32..).map(|(term, k)| term / (z + f64::from(k)));
    let series = 0.999_999_999_999_809_9 + terms.sum::<f64>();
    let t = z + 7.5;
    std::f64::consts::TAU.sqrt() * t.powf(z + 0.5) * (-t).exp() * series
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Γ(n + 1) = n!, Γ(1/2) = sqrt(π), Γ(1/10) = 9.513507698668731836... (DLMF 5.4, and published
    /// tables).
    #[test]
    fn gamma_equals_published_values() {
        let known = [
            (1.0, 1.0),
            (5.0, 24.0),
            (11.0, 3_628_800.0),
            (0.5, 1.772_453_850_905_516),
            (0.1, 9.513_507_698_668_732),
        ];
        for (x, expected) in known {
            assert!((gamma(x) / expected - 1.0).abs() < 1e-13, "Γ({x}) = {}, not {expected}", gamma(x));
        }
    }

    #[test]
    fn wrapped_coordinates_are_in_the_open_unit_interval() {
        for (x, expected) in
            [(0.25, 0.25), (1.25, 0.25), (-0.25, 0.75), (-7.5, 0.5), (3.0, 1e-10), (0.0, 1e-10)]
        {
            assert_eq!(wrapped(x), expected, "{x}");
        }
        assert!(wrapped(-1e-17) < 1.0);
    }
}
