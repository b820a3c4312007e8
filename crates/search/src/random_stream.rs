//! Random numbers that are a function of a key and a counter.

/// One block of Philox4x32 with ten rounds: four 32-bit words from a counter and a key.
///
/// Each round multiplies two words of the counter by fixed odd constants, keeps the low halves and mixes the high
/// halves with the other words and the key; the key grows by fixed increments (Weyl sequences) between rounds.
///
/// # Example
/// The first known-answer vector of the reference implementation:
/// ```
/// use mishandle_search::philox4x32;
/// assert_eq!(philox4x32([0; 4], [0; 2]), [0x6627e8d5, 0xe169c58d, 0xbc57ac4c, 0x9b00dbd8]);
/// ```
///
/// # Reference
/// Salmon, Moraes, Dror and Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC 2011.
pub fn philox4x32(counter: [u32; 4], key: [u32; 2]) -> [u32; 4] {
    const MULTIPLIERS: [u64; 2] = [0xD251_1F53, 0xCD9E_8D57];
    const INCREMENTS: [u32; 2] = [0x9E37_79B9, 0xBB67_AE85];
    let mut c = counter;
    let mut k = key;
    for _ in 0..10 {
        let a = MULTIPLIERS[0] * u64::from(c[0]);
        let b = MULTIPLIERS[1] * u64::from(c[2]);
        c = [(b >> 32) as u32 ^ c[1] ^ k[0], b as u32, (a >> 32) as u32 ^ c[3] ^ k[1], a as u32];
        k = [k[0].wrapping_add(INCREMENTS[0]), k[1].wrapping_add(INCREMENTS[1])];
    }
    c
}

/// A sequence of random numbers, determined by a seed and a stream number.
///
/// Two streams of one seed never share a block, so what one consumer draws never shifts another.
#[derive(Debug, Clone)]
pub struct RandomStream {
    key: [u32; 2],
    stream: u64,
    next_block: u64,
    spare: Option<u64>,
}

impl RandomStream {
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
        (self.bits() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
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

fn halves(bits: u64) -> [u32; 2] {
    [bits as u32, (bits >> 32) as u32]
}

fn joined(low: u32, high: u32) -> u64 {
    u64::from(low) | u64::from(high) << 32
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The known-answer vectors published with Random123 (`kat_vectors`, philox 4x32, 10 rounds).
    #[test]
    fn philox_gives_the_published_answers() {
        let ones = u32::MAX;
        let pi = [0x243f6a88, 0x85a308d3, 0x13198a2e, 0x03707344];
        let cases = [
            ([0; 4], [0; 2], [0x6627e8d5, 0xe169c58d, 0xbc57ac4c, 0x9b00dbd8]),
            ([ones; 4], [ones; 2], [0x408f276d, 0x41c83b0e, 0xa20bc7c6, 0x6d5451fd]),
            (pi, [0xa4093822, 0x299f31d0], [0xd16cfe09, 0x94fdcceb, 0x5001e420, 0x24126ea1]),
        ];
        for (counter, key, expected) in cases {
            assert_eq!(philox4x32(counter, key), expected, "counter {counter:x?}, key {key:x?}");
        }
    }

    #[test]
    fn streams_and_seeds_differ_and_repeat() {
        let first = |seed, stream| RandomStream::new(seed, stream).bits();
        assert_eq!(first(1, 2), first(1, 2));
        assert_ne!(first(1, 2), first(1, 3));
        assert_ne!(first(1, 2), first(2, 2));
    }

    /// Mean, variance and fourth moment of n draws, against 1/2 and 1/12, and 0, 1 and 3, within five standard errors.
    #[test]
    fn uniforms_and_normals_have_their_moments() {
        let n = 100_000;
        let mut stream = RandomStream::new(3, 0);
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
