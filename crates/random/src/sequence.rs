use crate::philox::{halves, joined, philox4x32, unit};

/// A sequence of random numbers, determined by a seed and a stream number.
///
/// Two streams of one seed never share a block of the generator, so they are independent.
#[derive(Debug, Clone)]
pub struct Sequence {
    key: [u32; 2],
    stream: u64,
    next_block: u64,
    spare: Option<u64>,
}

impl Sequence {
    /// Creates stream number `stream` of `seed`, at its start.
    pub fn new(seed: u64, stream: u64) -> Self {
        Self { key: halves(seed), stream, next_block: 0, spare: None }
    }

    /// Returns the next 64 random bits.
    pub fn bits(&mut self) -> u64 {
        if let Some(bits) = self.spare.take() {
            return bits;
        }
        let [low, high] = halves(self.next_block);
        let [s_low, s_high] = halves(self.stream);
        let word = philox4x32([low, high, s_low, s_high], self.key);
        self.next_block += 1;
        self.spare = Some(joined(word[2], word[3]));
        joined(word[0], word[1])
    }

    /// Returns the next uniform random number in [0, 1), a multiple of 2^-53.
    pub fn uniform(&mut self) -> f64 {
        unit(self.bits())
    }

    /// Returns the next random integer in [0, n): the high half of the product of 64 random bits
    /// and `n`.
    ///
    /// The probabilities of two integers differ by at most 2^-64. Returns 0 if `n` is 0.
    pub fn below(&mut self, n: u64) -> u64 {
        ((u128::from(self.bits()) * u128::from(n)) >> 64) as u64
    }

    /// Returns two independent standard normal numbers by the Box-Muller transform.
    ///
    /// ```text
    /// r = sqrt(-2 ln u₁),  (r cos 2πu₂, r sin 2πu₂)
    /// ```
    /// with u₁ in (0, 1), so that the pair is never (0, 0).
    pub fn normal_pair(&mut self) -> (f64, f64) {
        let inside = ((self.bits() >> 11) as f64 + 0.5) * (1.0 / (1u64 << 53) as f64);
        let radius = (-2.0 * inside.ln()).sqrt();
        let (sin, cos) = (std::f64::consts::TAU * self.uniform()).sin_cos();
        (radius * cos, radius * sin)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sequence_is_determined_by_seed_and_stream() {
        let first = |seed, stream| Sequence::new(seed, stream).bits();
        assert_eq!(first(1, 2), first(1, 2));
        assert_ne!(first(1, 2), first(1, 3));
        assert_ne!(first(1, 2), first(2, 2));
    }

    /// Compares mean, variance and fourth moment of n samples with 1/2 and 1/12, and 0, 1 and 3:
    /// within five standard errors.
    #[test]
    fn uniform_and_normal_samples_have_the_expected_moments() {
        let n = 100_000;
        let mut stream = Sequence::new(3, 0);
        let uniform: Vec<f64> = (0..n).map(|_| stream.uniform()).collect();
        assert!(uniform.iter().all(|u| (0.0..1.0).contains(u)));
        let normal: Vec<f64> = (0..n / 2).flat_map(|_| <[f64; 2]>::from(stream.normal_pair())).collect();
        let moment = |x: &[f64], center: f64, power: i32| {
            x.iter().map(|v| (v - center).powi(power)).sum::<f64>() / x.len() as f64
        };
        let standard_error = |variance: f64| (variance / f64::from(n)).sqrt();
        let check = |got: f64, expected: f64, variance: f64| {
            assert!((got - expected).abs() < 5.0 * standard_error(variance), "{got} for {expected}");
        };
        check(moment(&uniform, 0.0, 1), 0.5, 1.0 / 12.0);
        check(moment(&uniform, 0.5, 2), 1.0 / 12.0, 1.0 / 80.0 - 1.0 / 144.0);
        check(moment(&normal, 0.0, 1), 0.0, 1.0);
        check(moment(&normal, 0.0, 2), 1.0, 2.0);
        check(moment(&normal, 0.0, 4), 3.0, 96.0);
    }
}
