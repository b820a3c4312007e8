//! The Sobol sequence in any dimension, plain or scrambled.

use mishandle_random::Sequence;

/// The direction numbers of Joe and Kuo: dimension, degree s, coefficients a, initial numbers m₁
/// ... mₛ in each row.
const DIRECTION_NUMBERS: &str = include_str!("new-joe-kuo-6.1024.txt");
/// Dimensions with direction numbers.
pub(crate) const MAX_DIMENSION: usize = 1024;
/// Random bits of a coordinate: all that a number below 1 with an exponent of 0 can have.
const BITS: usize = 53;

/// The Sobol sequence on `[0,1)^d` in Gray-code order: the first 2^m points are a (t, m, d)-net for
/// every m.
///
/// Point i is the exclusive or of one direction number per set bit of the Gray code i ⊕ ⌊i/2⌋, and
/// of a shift. The scramble is that of Matoušek: every direction number is multiplied by a random
/// lower triangular matrix over GF(2) with ones on the diagonal, and the shift is random. Both keep
/// the net property. SciPy's `qmc.Sobol` scrambles in the same way, with other random numbers;
/// without a scramble its points are the same bit for bit.
///
/// # Reference
/// Joe and Kuo, "Constructing Sobol sequences with better two-dimensional projections", SIAM J.
/// Sci. Comput. 30, 2008. Matoušek, "On the L2-discrepancy for anchored boxes", J. Complexity
/// 14, 1998.
#[derive(Debug, Clone)]
pub(crate) struct SobolSequence {
    axes: Vec<SobolAxis>,
}

#[derive(Debug, Clone)]
struct SobolAxis {
    /// Direction number k as a fraction of 2^53.
    directions: [u64; BITS],
    shift: u64,
}

impl SobolSequence {
    /// Creates the sequence in at most [`MAX_DIMENSION`] dimensions, scrambled with random numbers
    /// of `scramble`, if any.
    pub(crate) fn new(dimension: usize, mut scramble: Option<Sequence>) -> Self {
        let rows = DIRECTION_NUMBERS.lines().filter(|line| line.starts_with(|c: char| c.is_ascii_digit()));
        let first = SobolAxis { directions: std::array::from_fn(|k| 1 << (BITS - 1 - k)), shift: 0 };
        let mut axes: Vec<SobolAxis> =
            std::iter::once(first).chain(rows.map(SobolAxis::of_row)).take(dimension).collect();
        if let Some(random) = &mut scramble {
            axes.iter_mut().for_each(|axis| axis.scramble(random));
        }
        Self { axes }
    }

    /// Writes the coordinates of point number `i`, counted from 0, to `point`, which may have more
    /// coordinates.
    pub(crate) fn write(&self, i: u64, point: &mut [f64]) {
        let gray = i ^ (i >> 1);
        self.axes.iter().zip(point).for_each(|(axis, x)| *x = axis.at(gray));
    }
}

impl SobolAxis {
    /// Computes the direction numbers of a row of the table by the recurrence of its primitive
    /// polynomial.
    fn of_row(row: &str) -> Self {
        let mut numbers =
            row.split_ascii_whitespace().skip(1).filter_map(|number| number.parse::<u64>().ok());
        let degree = numbers.next().unwrap_or(1) as usize;
        let coefficients = numbers.next().unwrap_or(0);
        let mut directions = [0; BITS];
        for (k, (direction, m)) in directions.iter_mut().zip(numbers).enumerate() {
            *direction = m << (BITS - 1 - k);
        }
        for k in degree..BITS {
            let mut direction = directions[k - degree] ^ (directions[k - degree] >> degree);
            for l in 1..degree {
                if (coefficients >> (degree - 1 - l)) & 1 == 1 {
                    direction ^= directions[k - l];
                }
            }
            directions[k] = direction;
        }
        Self { directions, shift: 0 }
    }

    fn scramble(&mut self, random: &mut Sequence) {
        let plain = self.directions;
        self.directions = [0; BITS];
        for row in 0..BITS {
            // The bit itself, and a random choice of the more significant ones.
            let diagonal = 1u64 << (BITS - 1 - row);
            let above = ((1u64 << BITS) - 1) & !(2 * diagonal - 1);
            let mask = (random.bits() & above) | diagonal;
            for (scrambled, plain) in self.directions.iter_mut().zip(plain) {
                if (plain & mask).count_ones() % 2 == 1 {
                    *scrambled |= diagonal;
                }
            }
        }
        self.shift = random.bits() >> (64 - BITS);
    }

    fn at(&self, gray: u64) -> f64 {
        let mut bits = gray;
        let mut sum = self.shift;
        while bits != 0 {
            sum ^= self.directions[bits.trailing_zeros() as usize % BITS];
            bits &= bits - 1;
        }
        sum as f64 / (1u64 << BITS) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(dimension: usize, n: u64, seed: u64) -> Vec<Vec<f64>> {
        let sequence = SobolSequence::new(dimension, Some(Sequence::new(seed, 0)));
        let point = |i| {
            let mut u = vec![0.0; dimension];
            sequence.write(i, &mut u);
            u
        };
        (0..n).map(point).collect()
    }

    /// The first two dimensions are a (0, 2)-sequence (Sobol 1967): each box of 2^-a by 2^-b, a +
    /// b = m, has exactly one of the first 2^m points, scrambled or not.
    #[test]
    fn each_elementary_box_of_the_first_two_dimensions_has_one_point() {
        let m = 8;
        for seed in 0..3 {
            let points = points(2, 1 << m, seed);
            for a in 0..=m {
                let columns = f64::from(1 << a);
                let rows = f64::from(1 << (m - a));
                let mut boxes: Vec<[u32; 2]> =
                    points.iter().map(|u| [(u[0] * columns) as u32, (u[1] * rows) as u32]).collect();
                boxes.sort_unstable();
                boxes.dedup();
                assert_eq!(boxes.len(), 1 << m, "a = {a}, seed {seed}");
            }
        }
    }

    /// Every coordinate alone is a (0, 1)-sequence: one of the first 2^m points in each interval of
    /// length 2^-m.
    #[test]
    fn each_coordinate_is_stratified() {
        let points = points(MAX_DIMENSION, 128, 5);
        for axis in 0..MAX_DIMENSION {
            let mut intervals: Vec<u32> = points.iter().map(|u| (u[axis] * 128.0) as u32).collect();
            intervals.sort_unstable();
            assert!(intervals.iter().copied().eq(0..128), "coordinate {axis}");
        }
    }
}
