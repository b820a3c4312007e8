//! Drawing from a list with replacement, fast enough to do it a thousand times for a long list.

/// A list to draw from: Walker's alias table over its different values.
///
/// The values of a metric are few even where the simulations are many, so the table stays in the nearest cache. Each of
/// its cells is a value and, above a threshold, another one; the thresholds are exact up to 2⁻⁶⁴.
///
/// Walker, "An efficient method for generating discrete random variables with general distributions", ACM TOMS 3, 1977.
pub(crate) struct Resample {
    cells: Vec<Cell>,
}

#[derive(Clone, Copy)]
struct Cell {
    /// A draw below it, of all 2⁶⁴, gives `value`.
    threshold: u64,
    value: f64,
    other: f64,
}

impl Resample {
    /// The table of a list in ascending order; it does not hold 2⁶³ values.
    pub(crate) fn new(sorted: &[f64]) -> Resample {
        let distinct: Vec<(f64, u64)> =
            sorted.chunk_by(|a, b| a == b).map(|same| (same[0], same.len() as u64)).collect();
        let (capacity, m) = (sorted.len() as u128, distinct.len() as u128);
        // Each value's count times the number of cells, each cell holding as much as the list is long: what overflows
        // one cell fills up another.
        let mut left: Vec<u128> = distinct.iter().map(|(_, count)| u128::from(*count) * m).collect();
        let mut cells: Vec<Cell> =
            distinct.iter().map(|&(value, _)| Cell { threshold: u64::MAX, value, other: value }).collect();
        let (mut small, mut large): (Vec<usize>, Vec<usize>) =
            (0..cells.len()).partition(|&i| left[i] < capacity);
        while let (Some(poor), Some(&rich)) = (small.pop(), large.last()) {
            // Below 2⁶⁴, since a poor cell is not full.
            cells[poor].threshold = ((left[poor] << 64) / capacity) as u64;
            cells[poor].other = cells[rich].value;
            left[rich] -= capacity - left[poor];
            if left[rich] < capacity {
                large.pop();
                small.push(rich);
            }
        }
        Resample { cells }
    }

    /// A value of the list, each place in it as likely as any other.
    pub(crate) fn draw(&self, draws: &mut Draws) -> f64 {
        // The product's high half is a uniform cell, its low half a uniform place in that cell.
        let product = u128::from(draws.bits()) * self.cells.len() as u128;
        let cell = &self.cells[(product >> 64) as usize];
        if (product as u64) < cell.threshold { cell.value } else { cell.other }
    }
}

/// The SplitMix64 generator: a draw costs next to nothing.
///
/// Steele, Lea and Flood, "Fast splittable pseudorandom number generators", OOPSLA 2014.
pub(crate) struct Draws(pub(crate) u64);

impl Draws {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn splitmix_gives_the_published_sequence() {
        // The first outputs for seed 1234567 in the reference implementation's test.
        let mut draws = Draws(1_234_567);
        let expected = [6_457_827_717_110_365_317, 3_203_168_211_198_807_973, 9_817_491_932_198_370_423];
        assert_eq!([draws.bits(), draws.bits(), draws.bits()], expected);
    }

    /// The probability of each different value, read off the table.
    fn probabilities(sorted: &[f64]) -> Vec<(f64, f64)> {
        let table = Resample::new(sorted);
        let mut distinct = sorted.to_vec();
        distinct.dedup();
        let of = |wanted: f64| {
            let cell = |cell: &Cell| {
                let below = cell.threshold as f64 / 2.0_f64.powi(64);
                below * f64::from(u8::from(cell.value == wanted))
                    + (1.0 - below) * f64::from(u8::from(cell.other == wanted))
            };
            table.cells.iter().map(cell).sum::<f64>() / table.cells.len() as f64
        };
        distinct.into_iter().map(|value| (value, of(value))).collect()
    }

    #[test]
    fn a_value_is_as_likely_as_it_is_frequent() {
        let lists: [&[f64]; 5] = [
            &[1.0],
            &[0.0, 0.0, 0.0, 1.0],
            &[1.0, 2.0, 2.0, 3.0, 3.0, 3.0, 4.0, 4.0, 4.0, 4.0],
            &[1.0, 2.0, 3.0, 4.0, 5.0],
            &[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.75, 1.0, 1.0],
        ];
        for list in lists {
            for (value, probability) in probabilities(list) {
                let share = list.iter().filter(|other| **other == value).count() as f64 / list.len() as f64;
                assert!(
                    (probability - share).abs() < 1e-15,
                    "{value} in {list:?}: {probability}, not {share}"
                );
            }
        }
    }
}
