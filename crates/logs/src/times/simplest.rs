//! The simplest period within bounds.

/// Returns the period from `low` to `high` with the fewest digits, in seconds or in samples per
/// second: 1/30 for 0.0333 to 0.0334, 0.075 for 0.0749 to 0.0751. If several periods have as few,
/// the one nearest to the middle.
pub fn simplest(low: f64, high: f64) -> f64 {
    let middle = 0.5 * (low + high);
    let (period, digits) = fewest_digits(low, high, i32::MIN).unwrap_or((middle, i32::MAX));
    // Below one sample per second, people set periods.
    let least = if high < 1.0 { i32::MIN } else { 0 };
    let rate = fewest_digits(1.0 / high, 1.0 / low, least).map(|(rate, digits)| (1.0 / rate, digits));
    match rate {
        Some((rate_period, rate_digits))
            if (rate_digits, (rate_period - middle).abs()) <= (digits, (period - middle).abs()) =>
        {
            rate_period
        }
        _ => period,
    }
}

/// Returns the number from `low` to `high` with the fewest significant digits, and how many they
/// are; the last one counts 10^`least` or more.
fn fewest_digits(low: f64, high: f64, least: i32) -> Option<(f64, i32)> {
    let first = high.log10().floor() as i32;
    let middle = 0.5 * (low + high);
    (least.max(first - 16)..=first).rev().find_map(|last| {
        let number = |units: f64| {
            if last < 0 { units / 10_f64.powi(-last) } else { units * 10_f64.powi(last) }
        };
        let units = middle / 10_f64.powi(last);
        let near = [units.round(), units.floor(), units.ceil()].map(number);
        let found = near.into_iter().find(|number| low <= *number && *number <= high)?;
        Some((found, first - last + 1))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_simplest_period_has_the_fewest_digits() {
        for (low, high, expected) in [
            (0.0333, 0.0334, 1.0 / 30.0),
            (0.0749, 0.0751, 0.075),
            (0.0164, 0.0169, 1.0 / 60.0),
            (0.009_99, 0.010_01, 0.01),
            (0.00833, 0.00834, 1.0 / 120.0),
            (0.1333, 0.1334, 1.0 / 7.5),
            (0.033_366_6, 0.033_366_8, 1.0 / 29.97),
            (0.25, 0.35, 0.3),
            (0.9, 1.1, 1.0),
            (1.4, 1.6, 1.5),
            (9.6, 10.4, 10.0),
            (33.2, 33.4, 33.3),
            (0.071_234_567_7, 0.071_234_567_9, 0.071_234_567_8),
            (0.3_f64.next_down(), 0.3_f64.next_up(), 0.3),
            (1e-6, 1.01e-6, 1e-6),
        ] {
            assert_eq!(simplest(low, high), expected, "{low} to {high}");
        }
    }
}
