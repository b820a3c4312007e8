//! Running normalizers: arithmetic, merging, edge cases.

use crate::reference::Random;
use mishandle_network::{Moments, Normalizer, RunningNormalizer};

#[track_caller]
fn close(found: &[f64], expected: &[f64]) {
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(expected) {
        assert!(
            (found - expected).abs() < 1e-12 * expected.abs().max(1.0),
            "found {found}, expected {expected}"
        );
    }
}

#[test]
fn moments_equal_values_computed_by_hand() {
    // Columns 1, 2, 6 and 10, 10, 40: means 3 and 20, squares 4 + 1 + 9 and 100 + 100 + 400.
    let moments = Moments::of_rows(&[1.0, 10.0, 2.0, 10.0, 6.0, 40.0], 2);
    assert_eq!(moments.count(), 3.0);
    close(moments.mean(), &[3.0, 20.0]);
    close(&moments.variance().collect::<Vec<_>>(), &[14.0 / 3.0, 200.0]);
}

#[test]
fn merged_moments_equal_the_moments_of_all_rows() {
    let mut random = Random(1);
    let rows: Vec<f64> =
        random.normals::<f64>(3 * 500).iter().enumerate().map(|(i, x)| x + i as f64 * 0.01).collect();
    let whole = Moments::of_rows(&rows, 3);
    for cuts in [&[0, 250, 500][..], &[0, 1, 500], &[0, 0, 7, 130, 499, 500]] {
        let mut merged = Moments::new(3);
        for cut in cuts.windows(2) {
            merged.merge(&Moments::of_rows(&rows[cut[0] * 3..cut[1] * 3], 3));
        }
        assert_eq!(merged.count(), 500.0);
        close(merged.mean(), whole.mean());
        close(&merged.variance().collect::<Vec<_>>(), &whole.variance().collect::<Vec<_>>());
    }
}

#[test]
fn two_updates_equal_one_update_with_all_rows() {
    let mut random = Random(2);
    let rows: Vec<f32> = random.normals(4 * 100);
    let mut once = RunningNormalizer::new(4);
    let mut twice = RunningNormalizer::new(4);
    once.update(&rows);
    twice.update(&rows[..4 * 30]);
    twice.update(&rows[4 * 30..]);
    close(twice.mean(), once.mean());
    close(&twice.variance(), &once.variance());
    assert_eq!(once.count(), 101.0);
}

#[test]
fn a_large_mean_does_not_cancel_small_deviations() {
    // Deviations of 1 around one million: Σ x² − n mean² would lose half of the digits.
    let rows: Vec<f64> = (0..1000).map(|i| 1e6 + f64::from(i % 2) * 2.0).collect();
    let mut moments = Moments::new(1);
    for part in rows.chunks(10) {
        moments.merge(&Moments::of_rows(part, 1));
    }
    close(moments.mean(), &[1e6 + 1.0]);
    close(&moments.variance().collect::<Vec<_>>(), &[1.0]);
}

#[test]
fn normalized_rows_have_mean_zero_and_variance_one() {
    let mut random = Random(3);
    let mut rows: Vec<f32> = random.normals::<f32>(2 * 20_000).iter().map(|x| 7.0 + 0.1 * x).collect();
    let mut normalizer = RunningNormalizer::new(2);
    normalizer.update(&rows);
    normalizer.freeze::<f32>().normalize(&mut rows);
    let moments = Moments::of_rows(&rows, 2);
    for (mean, variance) in moments.mean().iter().zip(moments.variance()) {
        // The initial row is 70 standard deviations away and has the weight 1/20001: variance 1 +
        // 70² / 20001.
        assert!(mean.abs() < 5e-3, "{mean}");
        assert!((variance - 1.0 / (1.0 + 5000.0 / 20_001.0)).abs() < 0.01, "{variance}");
    }
}

#[test]
fn a_new_normalizer_only_clips() {
    let mut rows = [0.5_f64, -4.0, 50.0, f64::NEG_INFINITY];
    RunningNormalizer::new(2).freeze().normalize(&mut rows);
    close(&rows, &[0.5 / (1.0 + 1e-8), -4.0 / (1.0 + 1e-8), 5.0, -5.0]);
}

#[test]
fn a_constant_column_stays_finite_and_nan_stays_nan() {
    let normalizer = Normalizer::<f32>::new(&[2.0], &[0.0]).expect("valid");
    let mut rows = [2.0, 2.1, f32::NAN];
    normalizer.normalize(&mut rows);
    assert_eq!(rows[..2], [0.0, 5.0]);
    assert!(rows[2].is_nan());
}

#[test]
fn a_restored_normalizer_continues_like_the_original() {
    let mut random = Random(4);
    let rows: Vec<f64> = random.normals(3 * 50);
    let mut normalizer = RunningNormalizer::new(3);
    normalizer.update(&rows);
    let mean = normalizer.mean().to_vec();
    let variance = normalizer.variance();
    let mut resumed = RunningNormalizer::resume(mean, &variance, normalizer.count()).expect("valid");
    for one in [&mut normalizer, &mut resumed] {
        one.update(&rows[..30]);
    }
    close(resumed.mean(), normalizer.mean());
    close(&resumed.variance(), &normalizer.variance());
}

#[test]
fn invalid_statistics_are_errors() {
    let message = |mean: &[f64], variance: &[f64]| {
        Normalizer::<f32>::new(mean, variance).expect_err("invalid").to_string()
    };
    assert_eq!(message(&[0.0, 0.0], &[1.0]), "`variance` has 1 numbers; expected 2");
    assert_eq!(message(&[f64::NAN], &[1.0]), "number 0 of `mean` is NaN; it must be finite");
    assert_eq!(message(&[0.0], &[-1.0]), "number 0 of `variance` is -1; it must be finite and at least 0");
    assert!(RunningNormalizer::resume(vec![0.0], &[1.0], 0.0).is_err());
    assert!(RunningNormalizer::resume(vec![0.0], &[1.0], f64::NAN).is_err());
}

#[test]
fn noise_on_a_constant_input_explodes_without_a_floor_and_not_with_one() {
    // A million rows of the constant 0.7; with the initial row of mean 0 and variance 1, the
    // variance is (1 + 0.7²) / 10⁶, the standard deviation 0.0012.
    let trained = |floor: f64| {
        let mut normalizer = RunningNormalizer::new(1).with_floor(floor);
        let rows = Moments::of_rows(&[0.7_f64; 1000], 1);
        (0..1000).for_each(|_| normalizer.merge(&rows));
        normalizer.freeze::<f64>()
    };
    let noisy = |floor: f64| {
        let mut seen = [0.7, 0.71, 0.69];
        trained(floor).normalize(&mut seen);
        seen
    };
    let [still, up, down] = noisy(0.0);
    assert!(still.abs() < 1e-3 && up == 5.0 && down == -5.0, "clipped: {up}, {down}");
    let [still, up, down] = noisy(0.02);
    assert!(still.abs() < 1e-3 && (up - 0.5).abs() < 1e-3 && (down + 0.5).abs() < 1e-3, "0.01 / 0.02");
}

#[test]
fn a_floor_below_all_deviations_changes_no_bit_and_survives_a_restoration() {
    let rows: Vec<f32> = (0..300).map(|i| (0.37 * i as f32).sin() * (1 + i % 3) as f32).collect();
    let mut plain = RunningNormalizer::new(3);
    plain.update(&rows);
    // The columns have standard deviations of 0.7, 1.4 and 2.1.
    let mut floored = RunningNormalizer::new(3).with_floor(1.0);
    floored.update(&rows);
    let expected = plain.variance();
    let found = floored.variance();
    assert_eq!([found[1], found[2]].map(f64::to_bits), [expected[1], expected[2]].map(f64::to_bits));
    assert_eq!((found[0], floored.moments()), (1.0, plain.moments()));
    let mut restored = RunningNormalizer::new(3).with_floor(1.0);
    restored.restore(floored.moments().clone()).unwrap();
    assert_eq!(restored, floored);
}
