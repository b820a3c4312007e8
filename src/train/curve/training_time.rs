use super::{Curve, CurveRow};

/// Width of the smoothing window as a fraction of the curve's environment steps.
const WINDOW_FRACTION: f64 = 0.05;

/// Tolerance around the final smoothed return, as a fraction of its change since the first one.
const TOLERANCE_FRACTION: f64 = 0.05;

/// Changes below this fraction of the largest return count as zero, because rounding causes such
/// differences.
const ROUNDING_FRACTION: f64 = 1e-12;

/// Reason why a curve has no training time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum NoTrainingTime {
    /// The training run wrote no curve.
    #[error("it needs a curve")]
    NoCurve,
    /// The first row is not iteration 1.
    #[error("the curve does not start with iteration 1")]
    MissingStart,
    /// No row has a return.
    #[error("no episode ended")]
    NoReturn,
    /// Only one row has a return.
    #[error("episodes ended in one iteration only")]
    OneReturn,
    /// A return or a sum of returns is NaN or infinite.
    #[error("the returns are not finite")]
    NotFinite,
    /// First and last smoothed return are equal.
    #[error("the return did not change")]
    Unchanged,
    /// Only the last row is within the tolerance.
    #[error("the return was still changing at the end")]
    StillChanging,
}

impl Curve {
    /// Returns the row of the training time: from this row on, the smoothed return stays near its
    /// final value.
    ///
    /// ```text
    /// s_i = mean of mean_return over the rows whose environment steps differ from row i's by at most 2.5 % of the last's
    /// |s_j - s_last| <= 0.05 |s_last - s_first|   for every row j from the returned row on
    /// ```
    ///
    /// Rows without a return are ignored. The returned row contains the training time in
    /// environment steps and in seconds; [`CurveRow::control_steps`] returns control steps per
    /// environment. A row near the end of the curve means that the return hardly converged.
    ///
    /// # Errors
    /// If the training time is undefined.
    pub fn training_time(&self) -> Result<&CurveRow, NoTrainingTime> {
        if self.rows.first().is_some_and(|row| row.iteration != 1) {
            return Err(NoTrainingTime::MissingStart);
        }
        let (rows, returns): (Vec<&CurveRow>, Vec<f64>) =
            self.rows.iter().filter_map(|row| Some((row, row.mean_return?))).unzip();
        let smoothed = smoothed(&rows, &returns);
        let (first, last) = match smoothed[..] {
            [] => return Err(NoTrainingTime::NoReturn),
            [_] => return Err(NoTrainingTime::OneReturn),
            [first, .., last] => (first, last),
        };
        let largest = smoothed.iter().map(|value| value.abs()).fold(0.0, f64::max);
        let change: f64 = (last - first).abs();
        if !change.is_finite() || smoothed.iter().any(|value| !value.is_finite()) {
            return Err(NoTrainingTime::NotFinite);
        }
        if change <= ROUNDING_FRACTION * largest {
            return Err(NoTrainingTime::Unchanged);
        }
        let is_converged = |value: &&f64| (**value - last).abs() <= TOLERANCE_FRACTION * change;
        let converged = smoothed.iter().rev().take_while(is_converged).count();
        if converged < 2 {
            return Err(NoTrainingTime::StillChanging);
        }
        Ok(rows[rows.len() - converged])
    }
}

/// Returns the mean return over a window of environment steps around each row.
fn smoothed(rows: &[&CurveRow], returns: &[f64]) -> Vec<f64> {
    let steps = |i: usize| rows[i].environment_steps;
    let radius = rows.last().map_or(0.0, |row| row.environment_steps as f64) * WINDOW_FRACTION / 2.0;
    let mut start = 0;
    let mut end = 0;
    (0..rows.len())
        .map(|i| {
            while ((steps(i) - steps(start)) as f64) > radius {
                start += 1;
            }
            while end < rows.len() && (steps(end).saturating_sub(steps(i)) as f64) <= radius {
                end += 1;
            }
            returns[start..end].iter().sum::<f64>() / (end - start) as f64
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use mishandle_training::TimeShares;

    /// Returns a curve with iterations of 100 environment steps and 1 s.
    fn curve(returns: &[Option<f64>]) -> Curve {
        let row = |(mean_return, iteration): (&Option<f64>, u64)| CurveRow {
            iteration,
            environment_steps: 100 * iteration,
            wall_clock_secs: iteration as f64,
            mean_return: *mean_return,
            mean_episode_steps: None,
            terminated_rate: None,
            scenario_share: None,
            validation: None,
            kl: None,
            entropy: None,
            learning_rate: 0.0,
            time_shares: TimeShares::default(),
            reward_terms: vec![],
        };
        let rows = returns.iter().zip(1..).map(row).collect();
        Curve { has_scenarios: false, has_curriculum: false, reward_terms: vec![], rows, is_truncated: false }
    }

    /// Returns 40 returns that rise from -100 by 10 per iteration to 0 in row 11. The window has a
    /// radius of 100 steps: three rows, two at the ends.
    fn rising() -> Vec<Option<f64>> {
        (1..=40).map(|i| Some((-100.0 + 10.0 * f64::from(i - 1)).min(0.0))).collect()
    }

    #[track_caller]
    fn check(returns: &[Option<f64>], expected: Result<u64, NoTrainingTime>) {
        let curve = curve(returns);
        assert_eq!(curve.training_time().map(|row| row.iteration), expected);
    }

    #[test]
    fn training_time_is_where_the_return_comes_within_five_percent() {
        // From (-100 - 90) / 2 = -95 to 0: tolerance 4.75. Row 10 has (-20 - 10 + 0) / 3 = -10, row
        // 11 -10 / 3.
        check(&rising(), Ok(11));
        let curve = curve(&rising());
        let row = curve.training_time().unwrap();
        assert_eq!((row.environment_steps, row.control_steps(20), row.wall_clock_secs), (1100, 55, 11.0));
    }

    #[test]
    fn leaving_the_tolerance_again_resets_the_training_time() {
        let mut returns = rising();
        // Rows 29, 30 and 31 have -30 / 3 = -10.
        returns[29] = Some(-30.0);
        check(&returns, Ok(32));
        // -12 / 3 = -4 is within the tolerance.
        returns[29] = Some(-12.0);
        check(&returns, Ok(11));
    }

    #[test]
    fn training_time_does_not_depend_on_scale_and_offset_of_returns() {
        let scaled = |by: f64, shift: f64| -> Vec<Option<f64>> {
            rising().iter().map(|value| value.map(|value| by * value + shift)).collect()
        };
        check(&scaled(4.0, -1000.0), Ok(11));
        check(&scaled(0.25, 1000.0), Ok(11));
        check(&scaled(-1.0, 0.0), Ok(11));
    }

    #[test]
    fn rows_without_a_return_are_ignored() {
        let mut returns = rising();
        returns[..2].fill(None);
        // From (-80 - 70) / 2 = -75: tolerance 3.75.
        check(&returns, Ok(11));
        returns[10] = None;
        // Row 10 has (-20 - 10) / 2, row 12 only zeros.
        check(&returns, Ok(12));
    }

    #[test]
    fn a_curve_without_change_has_no_training_time() {
        check(&[], Err(NoTrainingTime::NoReturn));
        check(&[None, None], Err(NoTrainingTime::NoReturn));
        check(&[None, Some(3.0)], Err(NoTrainingTime::OneReturn));
        // The means of two and of three tenths differ by rounding.
        check(&[Some(0.1); 40], Err(NoTrainingTime::Unchanged));
        check(&[Some(0.0); 40], Err(NoTrainingTime::Unchanged));
        let mut returns = rising();
        returns.extend(rising().into_iter().rev());
        check(&returns, Err(NoTrainingTime::Unchanged));
        check(&[Some(1.0), Some(2.0), Some(3.0)], Err(NoTrainingTime::StillChanging));
        check(&[Some(1.0), Some(2.0), Some(2.0)], Ok(2));
    }

    #[test]
    fn returns_that_are_not_finite_have_no_training_time() {
        for wrong in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX] {
            for at in [0, 20, 39] {
                let mut returns = rising();
                returns[at] = Some(wrong);
                if at + 1 < returns.len() {
                    returns[at + 1] = Some(wrong);
                }
                returns[38] = returns[39];
                check(&returns, Err(NoTrainingTime::NotFinite));
            }
        }
    }

    #[test]
    fn a_straight_line_converges_near_its_end() {
        let line: Vec<_> = (1..=40).map(|i| Some(f64::from(i))).collect();
        // From 1.5 to 39.5: tolerance 1.9, and row 38 has 38.
        check(&line, Ok(38));
    }

    #[test]
    fn a_curve_without_its_first_row_has_no_training_time() {
        let mut curve = curve(&rising());
        curve.rows.remove(0);
        assert_eq!(curve.training_time(), Err(NoTrainingTime::MissingStart));
    }
}
