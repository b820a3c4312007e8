//! Means and variances that follow a stream of rows, and the scaling that they give.

use crate::NetworkError;
use crate::adam::check_numbers;
use crate::scalar::Scalar;

/// Normalised numbers stay within ± this.
const CLIP: f64 = 5.0;
/// Added to a standard deviation before it divides.
const EPSILON: f64 = 1e-8;

/// Count, mean and sum of squared deviations of each column of some rows, in f64.
///
/// Moments of parts of a batch can be made on several threads and merged; merged in a fixed order they are the same bits.
#[derive(Debug, Clone, PartialEq)]
pub struct Moments {
    count: f64,
    mean: Vec<f64>,
    squares: Vec<f64>,
}

impl Moments {
    /// Moments of no row.
    pub fn new(columns: usize) -> Moments {
        Moments { count: 0.0, mean: vec![0.0; columns], squares: vec![0.0; columns] }
    }

    /// Moments of plain rows.
    ///
    /// ```text
    /// mean = Σ x / n,  squares = Σ (x − mean)²
    /// ```
    ///
    /// # Panics
    /// If `rows` is not a whole number of rows of `columns` numbers.
    pub fn of_rows<T: Scalar>(rows: &[T], columns: usize) -> Moments {
        let mut moments = Moments::new(columns);
        assert!(
            columns > 0 && rows.len().is_multiple_of(columns),
            "{} numbers, rows have {columns}",
            rows.len()
        );
        if rows.is_empty() {
            return moments;
        }
        moments.count = (rows.len() / columns) as f64;
        for row in rows.chunks_exact(columns) {
            for (sum, x) in moments.mean.iter_mut().zip(row) {
                *sum += x.to_f64();
            }
        }
        for sum in &mut moments.mean {
            *sum /= moments.count;
        }
        for row in rows.chunks_exact(columns) {
            for ((square, mean), x) in moments.squares.iter_mut().zip(&moments.mean).zip(row) {
                let deviation = x.to_f64() - mean;
                *square += deviation * deviation;
            }
        }
        moments
    }

    /// Takes in the rows of `other`.
    ///
    /// ```text
    /// δ = mean_b − mean_a,  n = n_a + n_b
    /// mean = mean_a + δ n_b / n,  squares = squares_a + squares_b + δ² n_a n_b / n
    /// ```
    ///
    /// # Panics
    /// If the numbers of columns differ.
    ///
    /// # Reference
    /// Chan, Golub and LeVeque, "Algorithms for Computing the Sample Variance", The American Statistician 37 (3), 1983.
    pub fn merge(&mut self, other: &Moments) {
        assert!(self.mean.len() == other.mean.len(), "{} columns and {}", self.mean.len(), other.mean.len());
        // Written so that a NaN count would not pass for an empty one.
        if other.count == 0.0 {
            return;
        }
        let count = self.count + other.count;
        let columns = self.mean.iter_mut().zip(&mut self.squares).zip(other.mean.iter().zip(&other.squares));
        for ((mean, squares), (other_mean, other_squares)) in columns {
            let delta = other_mean - *mean;
            *mean += delta * other.count / count;
            *squares += other_squares + delta * delta * self.count * other.count / count;
        }
        self.count = count;
    }

    /// Moments that go on where others were, to the bit.
    ///
    /// # Errors
    /// If the lengths differ, or a number is NaN or infinite, or a sum of squares or the count negative.
    pub fn resume(count: f64, mean: Vec<f64>, squares: Vec<f64>) -> Result<Moments, NetworkError> {
        check_statistics(&mean, &squares)?;
        check_numbers("count", &[count], "finite and at least 0", |count| count.is_finite() && count >= 0.0)?;
        Ok(Moments { count, mean, squares })
    }

    /// The same rows, with sums of squares n / (n − 1) times as large: their share of a merged variance is then their
    /// sample variance, as skrl's `RunningStandardScaler` has it.
    ///
    /// # Example
    /// ```
    /// use mishandle_network::Moments;
    /// let moments = Moments::of_rows(&[1.0, 3.0], 1).with_sample_variance();
    /// assert_eq!(moments.variance().next(), Some(2.0)); // (1 + 1) / (2 − 1)
    /// ```
    pub fn with_sample_variance(mut self) -> Moments {
        let factor = self.count / (self.count - 1.0);
        self.squares.iter_mut().for_each(|squares| *squares *= factor);
        self
    }

    /// How many rows.
    pub fn count(&self) -> f64 {
        self.count
    }

    /// The mean of each column.
    pub fn mean(&self) -> &[f64] {
        &self.mean
    }

    /// The sum of squared deviations of each column.
    pub fn squares(&self) -> &[f64] {
        &self.squares
    }

    /// The variance of each column, squares / n.
    pub fn variance(&self) -> impl ExactSizeIterator<Item = f64> {
        self.squares.iter().map(|squares| squares / self.count)
    }
}

/// A normaliser that learns its mean and variance from the rows it is shown.
///
/// It begins with mean 0 and variance 1 at the weight of one row, as skrl's does, so that it is usable before it has seen any. The
/// variance is Σ (x − mean)² / n with that row in it. (skrl merges each batch with Σ (x − mean)² / (n − 1) instead, so that its
/// result depends a little on how rows are batched; ours does not, up to rounding. For skrl's way, merge
/// [`Moments::with_sample_variance`].)
///
/// # Example
/// ```
/// use mishandle_network::RunningNormalizer;
/// let mut normalizer = RunningNormalizer::new(1);
/// normalizer.update(&[3.0_f32, 3.0, 3.0]); // with the row it began with: mean (0 + 9) / 4, variance 27/16 + 1/4
/// assert_eq!(normalizer.mean(), [2.25]);
/// assert_eq!(normalizer.variance(), [1.9375]);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct RunningNormalizer {
    moments: Moments,
}

impl RunningNormalizer {
    /// A normaliser of rows of `columns` numbers that has seen none.
    pub fn new(columns: usize) -> RunningNormalizer {
        RunningNormalizer {
            moments: Moments { count: 1.0, mean: vec![0.0; columns], squares: vec![1.0; columns] },
        }
    }

    /// A normaliser that goes on where another was.
    ///
    /// # Errors
    /// If the lengths differ, or a number is NaN or infinite, a variance negative, or the count not positive.
    pub fn resume(mean: Vec<f64>, variance: &[f64], count: f64) -> Result<RunningNormalizer, NetworkError> {
        check_statistics(&mean, variance)?;
        check_numbers("count", &[count], "finite and above 0", |count| count.is_finite() && count > 0.0)?;
        let squares = variance.iter().map(|variance| variance * count).collect();
        Ok(RunningNormalizer { moments: Moments { count, mean, squares } })
    }

    /// A normaliser that goes on from the [`moments`](RunningNormalizer::moments) of another, to the bit.
    ///
    /// # Errors
    /// If the moments are those of no row.
    pub fn from_moments(moments: Moments) -> Result<RunningNormalizer, NetworkError> {
        check_numbers("count", &[moments.count], "above 0", |count| count > 0.0)?;
        Ok(RunningNormalizer { moments })
    }

    /// What it has learned.
    pub fn moments(&self) -> &Moments {
        &self.moments
    }

    /// Learns from plain rows.
    ///
    /// # Panics
    /// If `rows` is not a whole number of rows.
    pub fn update<T: Scalar>(&mut self, rows: &[T]) {
        self.merge(&Moments::of_rows(rows, self.moments.mean.len()));
    }

    /// Learns from the moments of some rows.
    ///
    /// # Panics
    /// If the number of columns is another.
    pub fn merge(&mut self, rows: &Moments) {
        self.moments.merge(rows);
    }

    /// How many rows were seen, with the one it began with.
    pub fn count(&self) -> f64 {
        self.moments.count
    }

    /// The mean of each column.
    pub fn mean(&self) -> &[f64] {
        &self.moments.mean
    }

    /// The variance of each column.
    pub fn variance(&self) -> Vec<f64> {
        self.moments.variance().collect()
    }

    /// The scaling as it is now.
    pub fn freeze<T: Scalar>(&self) -> Normalizer<T> {
        Normalizer::with_statistics(&self.moments.mean, self.moments.variance())
    }
}

/// A scaling by a fixed mean and standard deviation.
///
/// ```text
/// normalize(x) = clamp((x − mean) / (√variance + 1e-8), −5, 5)
/// invert(y) = √variance · clamp(y, −5, 5) + mean
/// ```
///
/// Mean and standard deviation are rounded to `T` once, then the formula is computed in `T`. NaN stays NaN.
///
/// # Example
/// ```
/// use mishandle_network::Normalizer;
/// let normalizer = Normalizer::<f32>::new(&[10.0], &[4.0])?;
/// let mut rows = [12.0, 8.0, 1000.0];
/// normalizer.normalize(&mut rows);
/// assert_eq!(rows, [1.0, -1.0, 5.0]);
/// normalizer.invert(&mut rows);
/// assert_eq!(rows, [12.0, 8.0, 20.0]);
/// # Ok::<(), mishandle_network::NetworkError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Normalizer<T> {
    mean: Vec<T>,
    deviation: Vec<T>,
}

impl<T: Scalar> Normalizer<T> {
    /// The scaling for rows whose columns have these means and variances.
    ///
    /// # Errors
    /// If the lengths differ, or a number is NaN or infinite, or a variance negative.
    pub fn new(mean: &[f64], variance: &[f64]) -> Result<Normalizer<T>, NetworkError> {
        check_statistics(mean, variance)?;
        Ok(Normalizer::with_statistics(mean, variance.iter().copied()))
    }

    fn with_statistics(mean: &[f64], variance: impl Iterator<Item = f64>) -> Normalizer<T> {
        Normalizer {
            mean: mean.iter().map(|mean| T::from_f64(*mean)).collect(),
            deviation: variance.map(|variance| T::from_f64(variance.sqrt())).collect(),
        }
    }

    /// Normalises plain rows in place.
    ///
    /// # Panics
    /// If `rows` is not a whole number of rows.
    pub fn normalize(&self, rows: &mut [T]) {
        let epsilon = T::from_f64(EPSILON);
        self.for_each(rows, |x, mean, deviation| clamp((x - mean) / (deviation + epsilon)));
    }

    /// Undoes [`normalize`](Normalizer::normalize) in place, up to what the clamp cut off.
    ///
    /// # Panics
    /// If `rows` is not a whole number of rows.
    pub fn invert(&self, rows: &mut [T]) {
        self.for_each(rows, |y, mean, deviation| deviation * clamp(y) + mean);
    }

    fn for_each(&self, rows: &mut [T], f: impl Fn(T, T, T) -> T) {
        let columns = self.mean.len();
        assert!(
            columns > 0 && rows.len().is_multiple_of(columns),
            "{} numbers, rows have {columns}",
            rows.len()
        );
        for row in rows.chunks_exact_mut(columns) {
            for ((x, mean), deviation) in row.iter_mut().zip(&self.mean).zip(&self.deviation) {
                *x = f(*x, *mean, *deviation);
            }
        }
    }
}

fn clamp<T: Scalar>(x: T) -> T {
    let clip = T::from_f64(CLIP);
    if x > clip {
        clip
    } else if x < -clip {
        -clip
    } else {
        x
    }
}

fn check_statistics(mean: &[f64], variance: &[f64]) -> Result<(), NetworkError> {
    if mean.len() != variance.len() || mean.is_empty() {
        return Err(NetworkError::Length {
            what: "variance".to_string(),
            wanted: mean.len().max(1),
            found: variance.len(),
        });
    }
    check_numbers("mean", mean, "finite", f64::is_finite)?;
    check_numbers("variance", variance, "finite and at least 0", |v| v.is_finite() && v >= 0.0)
}
