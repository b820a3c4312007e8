//! Interaction of two axes: what they do together beyond the sum of their separate effects.

use crate::axis_rates::Count;
use crate::chi_squared_tail;

/// Steps of the fit of an additive table. The error falls geometrically.
const STEPS: usize = 200;

/// Fits with the precisions of the fit before.
const REWEIGHTED: usize = 3;

/// Counts of a table, row by row.
pub(crate) struct Cells<'a> {
    pub counts: &'a [Count],
    pub columns: usize,
}

/// Interaction of the two axes of a table.
pub(crate) struct Interaction {
    /// Fraction of the variance of success that no sum of a value for each row and one for each
    /// column explains, without what chance explains. Negative by chance only.
    pub share: f64,
    /// P-value of the test that the rates are such a sum.
    pub p_value: f64,
}

/// Measures and tests the interaction; `None` if the success is constant or too few cells have
/// simulations.
///
/// The rates are fitted by a sum of effects of rows and columns. For the share, the cells have the
/// weights of their simulations, so that it is the second-order Sobol index over the cells; what
/// the same cells explain by chance is subtracted, as in the analysis of variance. For the test,
/// they have the weights of their precision, because the variance of a rate depends on the rate. It
/// is that of the fitted rate with half a success and half a failure more, so that no cell seems
/// exact. The sum of the squared residuals then has a chi-squared distribution, if the effects add
/// up.
///
/// # References
/// - Sobol, "Sensitivity estimates for nonlinear mathematical models", 1993.
/// - Grizzle, Starmer and Koch, "Analysis of categorical data by linear models", Biometrics 25,
///   1969: weighted least squares for rates.
pub(crate) fn interaction(cells: &Cells<'_>) -> Option<Interaction> {
    let Cells { counts, columns } = *cells;
    let rows = counts.len() / columns;
    let total = Count::sum(counts);
    let p = total.successes as f64 / total.n as f64;
    let variance = p * (1.0 - p);
    let has = |mut cells: Box<dyn Iterator<Item = &Count> + '_>| cells.any(|count| count.n > 0);
    let used_rows = (0..rows).filter(|row| has(Box::new(counts[row * columns..][..columns].iter()))).count();
    let used_columns =
        (0..columns).filter(|column| has(Box::new(counts.iter().skip(*column).step_by(columns)))).count();
    let used = counts.iter().filter(|count| count.n > 0).count();
    let free = (used + 1).checked_sub(used_rows + used_columns).filter(|free| *free > 0)?;
    if total.n as usize <= used || variance == 0.0 {
        return None;
    }
    let rate = |count: &Count| count.successes as f64 / (count.n as f64).max(1.0);
    let simulations: Vec<f64> = counts.iter().map(|count| count.n as f64).collect();
    let within: f64 = counts.iter().map(|count| count.n as f64 * rate(count) * (1.0 - rate(count))).sum();
    let noise = within / (total.n as usize - used) as f64;
    let mut fitted = additive_fit(cells, &simulations, rate);
    let residual = squared_residuals(cells, &simulations, &fitted, rate);
    let share = (residual - free as f64 * noise) / (total.n as f64 * variance);
    let mut statistic = 0.0;
    for _ in 0..REWEIGHTED {
        let precision = |(count, fitted): (&Count, &f64)| {
            let n = count.n as f64;
            let smooth = ((n * fitted + 0.5) / (n + 1.0)).clamp(0.5 / (n + 1.0), (n + 0.5) / (n + 1.0));
            n / (smooth * (1.0 - smooth))
        };
        let precisions: Vec<f64> = counts.iter().zip(&fitted).map(precision).collect();
        fitted = additive_fit(cells, &precisions, rate);
        statistic = squared_residuals(cells, &precisions, &fitted, rate);
    }
    Some(Interaction { share, p_value: chi_squared_tail(statistic, free as u32) })
}

/// Returns the weighted sum of the squared residuals.
fn squared_residuals(
    cells: &Cells<'_>,
    weights: &[f64],
    fitted: &[f64],
    rate: impl Fn(&Count) -> f64,
) -> f64 {
    let residual =
        |((count, fitted), weight): ((&Count, &f64), &f64)| weight * (rate(count) - fitted).powi(2);
    cells.counts.iter().zip(fitted).zip(weights).map(residual).sum()
}

/// Returns the sum of an effect of the row and one of the column that is closest to the rates, for
/// each cell.
fn additive_fit(cells: &Cells<'_>, weights: &[f64], rate: impl Fn(&Count) -> f64) -> Vec<f64> {
    let Cells { counts, columns } = *cells;
    let rows = counts.len() / columns;
    let mut of_row = vec![0.0; rows];
    let mut of_column = vec![0.0; columns];
    let mean = |indices: &mut dyn Iterator<Item = usize>, other: &dyn Fn(usize) -> f64| {
        let mut sum = 0.0;
        let mut weight = 0.0;
        for index in indices {
            sum += weights[index] * (rate(&counts[index]) - other(index));
            weight += weights[index];
        }
        if weight > 0.0 { sum / weight } else { 0.0 }
    };
    for _ in 0..STEPS {
        let mut change = 0.0_f64;
        for (row, effect) in of_row.iter_mut().enumerate() {
            let found = mean(&mut (row * columns..(row + 1) * columns), &|index| of_column[index % columns]);
            change = change.max((found - *effect).abs());
            *effect = found;
        }
        for (column, effect) in of_column.iter_mut().enumerate() {
            *effect = mean(&mut (column..counts.len()).step_by(columns), &|index| of_row[index / columns]);
        }
        if change < 1e-12 {
            break;
        }
    }
    (0..counts.len()).map(|index| of_row[index / columns] + of_column[index % columns]).collect()
}
