use super::{Curve, CurveRow};

/// The share of the curve's environment steps that a smoothed return is taken over.
const SMOOTHED_SHARE: f64 = 0.05;

/// The share of the way from the first smoothed return to the final one that still counts as flat.
const FLAT_SHARE: f64 = 0.05;

/// A way from the first smoothed return to the last that is shorter than this share of the greatest return is none:
/// sums in another order differ by as much.
const ROUNDING_SHARE: f64 = 1e-12;

/// Why a training has no training time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum NoTrainingTime {
    /// The training wrote no curve.
    #[error("it is told from the curve, which --csv writes")]
    NoCurve,
    /// The first row is not of iteration 1.
    #[error("the curve does not begin with iteration 1")]
    NoBeginning,
    /// No row has a return.
    #[error("no episode has ended")]
    NoReturn,
    /// One row has a return.
    #[error("episodes have ended in one iteration only")]
    OneReturn,
    /// A return is NaN or infinite, or so great that their sums are.
    #[error("the returns are not finite")]
    NotFinite,
    /// The smoothed return ends where it began.
    #[error("the return is in the end what it was in the beginning")]
    Unchanged,
    /// Flat is the last row alone, which is near itself in any curve.
    #[error("the return was still changing in the end")]
    StillChanging,
}

impl Curve {
    /// Where the training time ends: the first row from which on the return is flat.
    ///
    /// ```text
    /// s_i = mean of mean_return over the rows whose environment steps differ from row i's by at most 2.5 % of the last's
    /// |s_j - s_last| <= 0.05 |s_last - s_first|   for every row j from there on
    /// ```
    ///
    /// Rows without a return are left out. The row has the training time in environment steps and in seconds;
    /// [`CurveRow::control_steps`] gives control steps of each environment. A row near the end says that the return
    /// hardly became flat.
    ///
    /// # Errors
    /// If the curve has none.
    pub fn training_time(&self) -> Result<&CurveRow, NoTrainingTime> {
        if self.rows.first().is_some_and(|row| row.iteration != 1) {
            return Err(NoTrainingTime::NoBeginning);
        }
        let (rows, returns): (Vec<&CurveRow>, Vec<f64>) =
            self.rows.iter().filter_map(|row| Some((row, row.mean_return?))).unzip();
        let smoothed = smoothed(&rows, &returns);
        let (first, last) = match smoothed[..] {
            [] => return Err(NoTrainingTime::NoReturn),
            [_] => return Err(NoTrainingTime::OneReturn),
            [first, .., last] => (first, last),
        };
        let greatest = smoothed.iter().map(|value| value.abs()).fold(0.0, f64::max);
        let way: f64 = (last - first).abs();
        if !way.is_finite() || smoothed.iter().any(|value| !value.is_finite()) {
            return Err(NoTrainingTime::NotFinite);
        }
        if way <= ROUNDING_SHARE * greatest {
            return Err(NoTrainingTime::Unchanged);
        }
        let is_flat = |value: &&f64| (**value - last).abs() <= FLAT_SHARE * way;
        let flat = smoothed.iter().rev().take_while(is_flat).count();
        if flat < 2 {
            return Err(NoTrainingTime::StillChanging);
        }
        Ok(rows[rows.len() - flat])
    }
}

/// Mean returns over windows of environment steps around each row.
fn smoothed(rows: &[&CurveRow], returns: &[f64]) -> Vec<f64> {
    let steps = |i: usize| rows[i].environment_steps;
    let reach = rows.last().map_or(0.0, |row| row.environment_steps as f64) * SMOOTHED_SHARE / 2.0;
    let (mut start, mut end) = (0, 0);
    (0..rows.len())
        .map(|i| {
            while ((steps(i) - steps(start)) as f64) > reach {
                start += 1;
            }
            while end < rows.len() && (steps(end).saturating_sub(steps(i)) as f64) <= reach {
                end += 1;
            }
            returns[start..end].iter().sum::<f64>() / (end - start) as f64
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use mishandle_training::Shares;

    /// A curve of iterations of 100 environment steps, one a second, with these returns.
    fn curve(returns: &[Option<f64>]) -> Curve {
        let row = |(mean_return, iteration): (&Option<f64>, u64)| CurveRow {
            iteration,
            environment_steps: 100 * iteration,
            wall_clock_secs: iteration as f64,
            mean_return: *mean_return,
            mean_episode_steps: None,
            terminated_rate: None,
            validation: None,
            kl: None,
            entropy: None,
            learning_rate: 0.0,
            shares: Shares::default(),
            reward_terms: vec![],
        };
        let rows = returns.iter().zip(1..).map(row).collect();
        Curve { reward_terms: vec![], rows, is_cut: false }
    }

    /// 40 rows, so that a window reaches 100 steps to both sides: three rows, two at the ends. From -100 the return
    /// rises by 10 an iteration, to 0 in the eleventh.
    fn rising() -> Vec<Option<f64>> {
        (1..=40).map(|i| Some((-100.0 + 10.0 * f64::from(i - 1)).min(0.0))).collect()
    }

    #[track_caller]
    fn check(returns: &[Option<f64>], expected: Result<u64, NoTrainingTime>) {
        let curve = curve(returns);
        assert_eq!(curve.training_time().map(|row| row.iteration), expected);
    }

    #[test]
    fn a_return_that_rises_to_zero_is_flat_where_the_last_twentieth_begins() {
        // From (-100 - 90) / 2 = -95 to 0: flat within 4.75. Row 10 has (-20 - 10 + 0) / 3 = -10, row 11 -10 / 3.
        check(&rising(), Ok(11));
        let curve = curve(&rising());
        let row = curve.training_time().unwrap();
        assert_eq!((row.environment_steps, row.control_steps(20), row.wall_clock_secs), (1100, 55, 11.0));
    }

    #[test]
    fn a_point_that_is_left_again_does_not_count() {
        let mut returns = rising();
        // Rows 29, 30 and 31 have -30 / 3 = -10.
        returns[29] = Some(-30.0);
        check(&returns, Ok(32));
        // -12 / 3 = -4 is within.
        returns[29] = Some(-12.0);
        check(&returns, Ok(11));
    }

    #[test]
    fn the_size_and_the_sign_of_returns_do_not_matter() {
        let scaled = |by: f64, shift: f64| -> Vec<Option<f64>> {
            rising().iter().map(|value| value.map(|value| by * value + shift)).collect()
        };
        check(&scaled(4.0, -1000.0), Ok(11));
        check(&scaled(0.25, 1000.0), Ok(11));
        check(&scaled(-1.0, 0.0), Ok(11));
    }

    #[test]
    fn rows_without_a_return_are_left_out() {
        let mut returns = rising();
        returns[..2].fill(None);
        // From (-80 - 70) / 2 = -75: flat within 3.75.
        check(&returns, Ok(11));
        returns[10] = None;
        // Row 10 has (-20 - 10) / 2, row 12 only zeros.
        check(&returns, Ok(12));
    }

    #[test]
    fn a_curve_that_comes_from_nowhere_or_goes_nowhere_has_no_training_time() {
        check(&[], Err(NoTrainingTime::NoReturn));
        check(&[None, None], Err(NoTrainingTime::NoReturn));
        check(&[None, Some(3.0)], Err(NoTrainingTime::OneReturn));
        // Sums of two and of three tenths are rounded differently.
        check(&[Some(0.1); 40], Err(NoTrainingTime::Unchanged));
        check(&[Some(0.0); 40], Err(NoTrainingTime::Unchanged));
        let mut returns = rising();
        returns.extend(rising().into_iter().rev());
        check(&returns, Err(NoTrainingTime::Unchanged));
        check(&[Some(1.0), Some(2.0), Some(3.0)], Err(NoTrainingTime::StillChanging));
        check(&[Some(1.0), Some(2.0), Some(2.0)], Ok(2));
    }

    #[test]
    fn a_return_that_is_not_finite_has_no_training_time() {
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
    fn a_straight_line_is_flat_at_its_end() {
        let line: Vec<_> = (1..=40).map(|i| Some(f64::from(i))).collect();
        // From 1.5 to 39.5: flat within 1.9, and row 38 has 38.
        check(&line, Ok(38));
    }

    #[test]
    fn a_curve_without_its_beginning_has_no_training_time() {
        let mut curve = curve(&rising());
        curve.rows.remove(0);
        assert_eq!(curve.training_time(), Err(NoTrainingTime::NoBeginning));
    }
}
