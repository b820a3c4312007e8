//! Running mean and variance of observations, and the normalization with them.

use crate::NetworkError;
use crate::adam::check_numbers;
use crate::scalar::Scalar;

/// Normalized numbers are clipped to ± this value.
const CLIP: f64 = 5.0;
/// Added to the standard deviation in the denominator.
const EPSILON: f64 = 1e-8;

/// The number of rows, and the mean and sum of squared deviations of each column, in f64.
///
/// Moments of parts of a batch can be computed on several threads and merged. The bits depend on
/// the order of merging.
#[derive(Debug, Clone, PartialEq)]
pub struct Moments {
    count: f64,
    mean: Vec<f64>,
    squares: Vec<f64>,
}

impl Moments {
    /// Creates the moments of an empty set of rows.
    pub fn new(columns: usize) -> Moments {
        Moments { count: 0.0, mean: vec![0.0; columns], squares: vec![0.0; columns] }
    }

    /// Computes the moments of a row-major matrix.
    ///
    /// ```text
    /// mean = Σ x / n,  squares = Σ (x − mean)²
    /// ```
    ///
    /// # Panics
    /// If the length of `rows` is not a multiple of `columns`, or `columns` is 0.
    pub fn of_rows<T: Scalar>(rows: &[T], columns: usize) -> Moments {
        let mut moments = Moments::new(columns);
        assert!(
            columns > 0 && rows.len().is_multiple_of(columns),
            "expected a multiple of {columns} numbers, found {}",
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

    /// Adds the rows of `other`.
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
    /// Chan, Golub and LeVeque, "Algorithms for Computing the Sample Variance", The American
    /// Statistician 37 (3), 1983.
    pub fn merge(&mut self, other: &Moments) {
        assert!(
            self.mean.len() == other.mean.len(),
            "expected {} columns, found {}",
            self.mean.len(),
            other.mean.len()
        );
        // A NaN count does not count as empty.
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

    /// Restores moments bit for bit from count, mean and sum of squared deviations.
    ///
    /// # Errors
    /// If the lengths differ, a number is NaN or infinite, or a sum of squares or the count is
    /// negative.
    pub fn resume(count: f64, mean: Vec<f64>, squares: Vec<f64>) -> Result<Moments, NetworkError> {
        check_statistics(&mean, &squares)?;
        check_numbers("count", &[count], "finite and at least 0", |count| count.is_finite() && count >= 0.0)?;
        Ok(Moments { count, mean, squares })
    }

    /// Multiplies the sums of squares by n / (n − 1), so that the rows contribute their sample
    /// variance to a merged variance, as in skrl's `RunningStandardScaler`.
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

    /// Returns the number of rows.
    pub fn count(&self) -> f64 {
        self.count
    }

    /// Returns the mean of each column.
    pub fn mean(&self) -> &[f64] {
        &self.mean
    }

    /// Returns the sum of squared deviations of each column.
    pub fn squares(&self) -> &[f64] {
        &self.squares
    }

    /// Returns the variance of each column: the sum of squared deviations divided by n.
    pub fn variance(&self) -> impl ExactSizeIterator<Item = f64> {
        self.squares.iter().map(|squares| squares / self.count)
    }
}

/// A normalizer with running mean and variance.
///
/// Like skrl's, it starts with mean 0 and variance 1 with the weight of one row, so it is usable
/// before the first update. The variance is Σ (x − mean)² / n, including that row. skrl merges each
/// batch with Σ (x − mean)² / (n − 1) instead, so its result depends slightly on the batch sizes;
/// ours does not, up to rounding. For skrl's result, merge [`Moments::with_sample_variance`].
///
/// # Example
/// ```
/// use mishandle_network::RunningNormalizer;
/// let mut normalizer = RunningNormalizer::new(1);
/// normalizer.update(&[3.0_f32, 3.0, 3.0]); // with the initial row: mean (0 + 9) / 4, variance 27/16 + 1/4
/// assert_eq!(normalizer.mean(), [2.25]);
/// assert_eq!(normalizer.variance(), [1.9375]);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct RunningNormalizer {
    moments: Moments,
    /// Smallest variance of a column.
    floor: f64,
}

impl RunningNormalizer {
    /// Creates a normalizer of rows with `columns` numbers.
    pub fn new(columns: usize) -> RunningNormalizer {
        RunningNormalizer {
            moments: Moments { count: 1.0, mean: vec![0.0; columns], squares: vec![1.0; columns] },
            floor: 0.0,
        }
    }

    /// Restores a normalizer from mean, variance and count.
    ///
    /// # Errors
    /// If the lengths differ, a number is NaN or infinite, a variance is negative, or the count is
    /// not positive.
    pub fn resume(mean: Vec<f64>, variance: &[f64], count: f64) -> Result<RunningNormalizer, NetworkError> {
        check_statistics(&mean, variance)?;
        check_numbers("count", &[count], "finite and above 0", |count| count.is_finite() && count > 0.0)?;
        let squares = variance.iter().map(|variance| variance * count).collect();
        Ok(RunningNormalizer { moments: Moments { count, mean, squares }, floor: 0.0 })
    }

    /// Restores a normalizer bit for bit from its [`moments`](RunningNormalizer::moments).
    ///
    /// # Errors
    /// If the count of the moments is not positive.
    pub fn from_moments(moments: Moments) -> Result<RunningNormalizer, NetworkError> {
        check_numbers("count", &[moments.count], "above 0", |count| count > 0.0)?;
        Ok(RunningNormalizer { moments, floor: 0.0 })
    }

    /// Sets the smallest standard deviation of a column. Without it, a column that was constant so
    /// far makes any later change huge.
    ///
    /// # Example
    /// ```
    /// use mishandle_network::RunningNormalizer;
    /// let mut normalizer = RunningNormalizer::new(1).with_floor(0.5);
    /// assert_eq!(normalizer.variance(), [1.0]);
    /// normalizer.update(&[0.0_f32; 99]); // variance 1 / 100
    /// assert_eq!(normalizer.variance(), [0.25]);
    /// ```
    #[must_use]
    pub fn with_floor(self, std: f64) -> RunningNormalizer {
        RunningNormalizer { floor: std * std, ..self }
    }

    /// Replaces the moments and keeps the floor.
    ///
    /// # Errors
    /// If the count of the moments is not positive.
    pub fn restore(&mut self, moments: Moments) -> Result<(), NetworkError> {
        *self = RunningNormalizer { floor: self.floor, ..RunningNormalizer::from_moments(moments)? };
        Ok(())
    }

    /// Returns the accumulated moments.
    pub fn moments(&self) -> &Moments {
        &self.moments
    }

    /// Updates mean and variance with the rows of a row-major matrix.
    ///
    /// # Panics
    /// If the length of `rows` is not a multiple of the number of columns.
    pub fn update<T: Scalar>(&mut self, rows: &[T]) {
        self.merge(&Moments::of_rows(rows, self.moments.mean.len()));
    }

    /// Updates mean and variance with the moments of some rows.
    ///
    /// # Panics
    /// If the number of columns differs.
    pub fn merge(&mut self, rows: &Moments) {
        self.moments.merge(rows);
    }

    /// Returns the number of rows, including the initial one.
    pub fn count(&self) -> f64 {
        self.moments.count
    }

    /// Returns the mean of each column.
    pub fn mean(&self) -> &[f64] {
        &self.moments.mean
    }

    /// Returns the variance of each column, at least the floor.
    pub fn variance(&self) -> Vec<f64> {
        // NaN remains, which the training loop reports.
        let at_least = |variance: f64| if variance < self.floor { self.floor } else { variance };
        self.moments.variance().map(at_least).collect()
    }

    /// Returns a normalizer with the current mean and variance.
    pub fn freeze<T: Scalar>(&self) -> Normalizer<T> {
        Normalizer::with_statistics(&self.moments.mean, self.variance().into_iter())
    }
}

/// A normalizer with fixed mean and standard deviation.
///
/// ```text
/// normalize(x) = clamp((x − mean) / (√variance + 1e-8), −5, 5)
/// ```
///
/// Mean and standard deviation are rounded to `T` once, then the formula is computed in `T`. NaN
/// stays NaN.
///
/// # Example
/// ```
/// use mishandle_network::Normalizer;
/// let normalizer = Normalizer::<f32>::new(&[10.0], &[4.0])?;
/// let mut rows = [12.0, 8.0, 1000.0];
/// normalizer.normalize(&mut rows);
/// assert_eq!(rows, [1.0, -1.0, 5.0]);
/// # Ok::<(), mishandle_network::NetworkError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Normalizer<T> {
    mean: Vec<T>,
    std: Vec<T>,
    /// Largest absolute value of each normalized column.
    clip: Vec<T>,
}

impl<T: Scalar> Normalizer<T> {
    /// Creates a normalizer for columns with these means and variances.
    ///
    /// # Errors
    /// If the lengths differ, a number is NaN or infinite, or a variance is negative.
    pub fn new(mean: &[f64], variance: &[f64]) -> Result<Normalizer<T>, NetworkError> {
        check_statistics(mean, variance)?;
        Ok(Normalizer::with_statistics(mean, variance.iter().copied()))
    }

    fn with_statistics(mean: &[f64], variance: impl Iterator<Item = f64>) -> Normalizer<T> {
        Normalizer {
            mean: mean.iter().map(|mean| T::from_f64(*mean)).collect(),
            std: variance.map(|variance| T::from_f64(variance.sqrt())).collect(),
            clip: vec![T::from_f64(CLIP); mean.len()],
        }
    }

    /// Changes the largest absolute value of a normalized number from 5 to `clip` in all columns;
    /// infinity clips nothing.
    #[must_use]
    pub fn with_clip(mut self, clip: f64) -> Normalizer<T> {
        self.clip.fill(T::from_f64(clip));
        self
    }

    /// Normalizes the rows of a row-major matrix in place.
    ///
    /// # Panics
    /// If the length of `rows` is not a multiple of the number of columns.
    pub fn normalize(&self, rows: &mut [T]) {
        let epsilon = T::from_f64(EPSILON);
        let columns = self.mean.len();
        assert!(
            columns > 0 && rows.len().is_multiple_of(columns),
            "expected a multiple of {columns} numbers, found {}",
            rows.len()
        );
        for row in rows.chunks_exact_mut(columns) {
            for (((x, mean), std), clip) in row.iter_mut().zip(&self.mean).zip(&self.std).zip(&self.clip) {
                *x = clamp((*x - *mean) / (*std + epsilon), *clip);
            }
        }
    }
}

impl Normalizer<f32> {
    /// Returns a normalizer of longer rows, in which `times` groups of columns follow those of this
    /// normalizer: the same columns again, then `plain` columns that are not changed.
    ///
    /// # Example
    /// ```
    /// use mishandle_network::Normalizer;
    /// let normalizer = Normalizer::new(&[10.0], &[4.0])?.repeated(2, 1);
    /// let mut row = [12.0, 8.0, 7.0, 1000.0, -7.0];
    /// normalizer.normalize(&mut row);
    /// assert_eq!(row, [1.0, -1.0, 7.0, 5.0, -7.0]);
    /// # Ok::<(), mishandle_network::NetworkError>(())
    /// ```
    #[must_use]
    pub fn repeated(mut self, times: usize, plain: usize) -> Normalizer<f32> {
        let columns = self.mean.len();
        // The standard deviation 1 changes nothing: 1 + 1e-8 is 1 in f32.
        for _ in 0..times {
            for (numbers, unchanged) in
                [(&mut self.mean, 0.0), (&mut self.std, 1.0), (&mut self.clip, f32::INFINITY)]
            {
                numbers.extend_from_within(..columns);
                numbers.extend(std::iter::repeat_n(unchanged, plain));
            }
        }
        self
    }
}

fn clamp<T: Scalar>(x: T, clip: T) -> T {
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
            expected: mean.len().max(1),
            found: variance.len(),
        });
    }
    check_numbers("mean", mean, "finite", f64::is_finite)?;
    check_numbers("variance", variance, "finite and at least 0", |v| v.is_finite() && v >= 0.0)
}
