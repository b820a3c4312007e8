use crate::philox::{halves, joined, philox4x32, unit};

/// A sequence of random numbers, determined by a seed and a stream number.
///
/// Two streams of one seed never share a block, so what one consumer draws never shifts another.
#[derive(Debug, Clone)]
pub struct Sequence {
    key: [u32; 2],
    stream: u64,
    next_block: u64,
    spare: Option<u64>,
}

impl Sequence {
    /// The stream numbered `stream` of `seed`, at its beginning.
    pub fn new(seed: u64, stream: u64) -> Self {
        Self { key: halves(seed), stream, next_block: 0, spare: None }
    }

    /// The next 64 random bits.
    pub fn bits(&mut self) -> u64 {
        if let Some(bits) = self.spare.take() {
            return bits;
        }
        let ([low, high], [s_low, s_high]) = (halves(self.next_block), halves(self.stream));
        let word = philox4x32([low, high, s_low, s_high], self.key);
        self.next_block += 1;
        self.spare = Some(joined(word[2], word[3]));
        joined(word[0], word[1])
    }

    /// The next uniform number in [0, 1): a multiple of 2^-53.
    pub fn uniform(&mut self) -> f64 {
        unit(self.bits())
    }

    /// The next whole number in [0, n): the high half of 64 random bits times `n`.
    ///
    /// A number is at most n / 2^64 more likely than another. The result is 0 if `n` is 0.
    pub fn below(&mut self, n: u64) -> u64 {
        ((u128::from(self.bits()) * u128::from(n)) >> 64) as u64
    }

    /// Two independent standard normal numbers, by the method of Box and Muller.
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
    fn streams_and_seeds_differ_and_repeat() {
        let first = |seed, stream| Sequence::new(seed, stream).bits();
        assert_eq!(first(1, 2), first(1, 2));
        assert_ne!(first(1, 2), first(1, 3));
        assert_ne!(first(1, 2), first(2, 2));
    }

    /// Mean, variance and fourth moment of n draws, against 1/2 and 1/12, and 0, 1 and 3, within five standard errors.
    #[test]
    fn uniforms_and_normals_have_their_moments() {
        let n = 100_000;
        let mut stream = Sequence::new(3, 0);
        let uniform: Vec<f64> = (0..n).map(|_| stream.uniform()).collect();
        assert!(uniform.iter().all(|u| (0.0..1.0).contains(u)));
        let normal: Vec<f64> = (0..n / 2).flat_map(|_| <[f64; 2]>::from(stream.normal_pair())).collect();
        let moment = |x: &[f64], centre: f64, power: i32| {
            x.iter().map(|v| (v - centre).powi(power)).sum::<f64>() / x.len() as f64
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
