//! Random permutations of large ranges without memory.

use mishandle_random::Sequence;

const ROUNDS: usize = 6;

/// A random permutation of 0, ..., n - 1, computed entry by entry in constant memory.
///
/// It is a Feistel network on the smallest even number of bits that holds n - 1. An output of n or
/// more is permuted again until it is below n, which takes less than four attempts on average.
///
/// # Reference
/// Black and Rogaway, "Ciphers with arbitrary finite domains", CT-RSA 2002.
#[derive(Debug, Clone)]
pub(crate) struct Permutation {
    n: u64,
    half_bits: u32,
    keys: [u64; ROUNDS],
}

impl Permutation {
    /// Creates a permutation of 0, ..., n - 1 with keys from `random`; `n` is at least 1.
    pub(crate) fn new(n: u64, random: &mut Sequence) -> Self {
        let bits = u64::BITS - n.saturating_sub(1).leading_zeros();
        Self { n, half_bits: bits.div_ceil(2).max(1), keys: std::array::from_fn(|_| random.bits()) }
    }

    /// Returns n.
    pub(crate) fn len(&self) -> u64 {
        self.n
    }

    /// Returns entry `i`, which is below n.
    pub(crate) fn at(&self, i: u64) -> u64 {
        self.walk(i, |x| {
            let (left, right) = self.halves(x);
            let (left, right) =
                self.keys.iter().fold((left, right), |(l, r), key| (r, l ^ self.mix(r, *key)));
            self.joined(left, right)
        })
    }

    /// Returns the index of the entry `x`.
    pub(crate) fn index_of(&self, x: u64) -> u64 {
        self.walk(x, |x| {
            let (left, right) = self.halves(x);
            let undo = |(l, r), key: &u64| (r ^ self.mix(l, *key), l);
            let (left, right) = self.keys.iter().rev().fold((left, right), undo);
            self.joined(left, right)
        })
    }

    fn walk(&self, start: u64, step: impl Fn(u64) -> u64) -> u64 {
        let mut x = step(start % self.n);
        while x >= self.n {
            x = step(x);
        }
        x
    }

    fn halves(&self, x: u64) -> (u64, u64) {
        (x >> self.half_bits, x & self.mask())
    }

    fn joined(&self, left: u64, right: u64) -> u64 {
        (left << self.half_bits) | right
    }

    fn mask(&self) -> u64 {
        (1 << self.half_bits) - 1
    }

    /// Returns the round function: the finalizer of SplitMix64, cut to half of the bits.
    fn mix(&self, half: u64, key: u64) -> u64 {
        let x = half.wrapping_add(key);
        let x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        (x ^ (x >> 31)) & self.mask()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_number_occurs_once_and_is_found_again() {
        for n in [1, 2, 3, 5, 16, 80, 1000, 65_537] {
            let permutation = Permutation::new(n, &mut Sequence::new(n, 0));
            let mut found: Vec<u64> = (0..n).map(|i| permutation.at(i)).collect();
            assert!((0..n).all(|i| permutation.index_of(found[i as usize]) == i), "n = {n}");
            found.sort_unstable();
            assert!(found.into_iter().eq(0..n), "n = {n}");
        }
        let large = Permutation::new(1 << 62, &mut Sequence::new(1, 0));
        assert!((0..1000).all(|i| large.at(i) < 1 << 62 && large.index_of(large.at(i)) == i));
    }

    /// Over many keys, the first entry of a permutation of 8 numbers is uniform: counts within five
    /// standard errors.
    #[test]
    fn the_first_entry_is_uniform() {
        let n = 8;
        let keys = 8000;
        let mut counts = [0.0; 8];
        for seed in 0..keys {
            counts[Permutation::new(n, &mut Sequence::new(seed, 0)).at(0) as usize] += 1.0;
        }
        for count in counts {
            let expected: f64 = keys as f64 / n as f64;
            assert!((f64::abs(count - expected)) < 5.0 * expected.sqrt(), "{counts:?}");
        }
    }
}
