//! Integration with fixed steps.

/// Takes a step of the classical Runge-Kutta method (order 4). `derivative` gets the share of the
/// full step, in \[0, 1\], at which it is evaluated: the step taken is `share` of `dt`.
pub(crate) fn runge_kutta<const N: usize>(
    state: &[f64; N],
    dt: f64,
    [begin, end]: [f64; 2],
    derivative: impl Fn(&[f64; N], f64) -> [f64; N],
) -> [f64; N] {
    let h = dt * (end - begin);
    let middle = 0.5 * (begin + end);
    let moved = |slope: &[f64; N], by: f64| std::array::from_fn(|i| state[i] + by * slope[i]);
    let first = derivative(state, begin);
    let second = derivative(&moved(&first, 0.5 * h), middle);
    let third = derivative(&moved(&second, 0.5 * h), middle);
    let fourth = derivative(&moved(&third, h), end);
    std::array::from_fn(|i| state[i] + h / 6.0 * (first[i] + 2.0 * (second[i] + third[i]) + fourth[i]))
}

/// Evaluations until an event is taken where it was last seen to have happened.
const EVALUATIONS: usize = 60;

/// Returns a share of the interval at which `excess`, negative at its begin, has become positive or
/// 0, and is at most `tolerance`. Uses the Illinois variant of regula falsi (Dowell and Jarratt,
/// BIT 11, 1971), which converges faster than linearly.
pub(crate) fn event([mut before, mut after]: [f64; 2], tolerance: f64, excess: impl Fn(f64) -> f64) -> f64 {
    let mut low = excess(before);
    let mut high = excess(after);
    let mut reached = high;
    let mut last = None;
    for _ in 0..EVALUATIONS {
        if reached <= tolerance {
            break;
        }
        let between = after - high * (after - before) / (high - low);
        let value = excess(between);
        let is_after = value >= 0.0;
        // An end that stays twice counts half, so that the other one moves.
        let weight = if last == Some(is_after) { 0.5 } else { 1.0 };
        if is_after {
            (after, high, reached, low) = (between, value, value, weight * low);
        } else {
            (before, low, high) = (between, value, weight * high);
        }
        last = Some(is_after);
    }
    after
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_error_of_an_oscillator_falls_with_the_fourth_power_of_the_step() {
        // x'' = -x from (1, 0) is cos t.
        let error = |steps: usize| {
            let mut state = [1.0, 0.0];
            let dt = 1.0 / steps as f64;
            for _ in 0..steps {
                state = runge_kutta(&state, dt, [0.0, 1.0], |[x, v], _| [*v, -x]);
            }
            (state[0] - 1.0_f64.cos()).abs()
        };
        let ratio = error(10) / error(20);
        assert!((14.0..18.0).contains(&ratio), "{ratio}");
    }

    #[test]
    fn parts_of_a_step_see_their_own_time() {
        // x' = 3 (2 + share)² over dt = 1 is (2 + share)³; polynomials up to degree 3 are exact.
        let derivative = |_: &[f64; 1], share: f64| [3.0 * (2.0 + share).powi(2)];
        let half = runge_kutta(&[8.0], 1.0, [0.0, 0.5], derivative);
        let whole = runge_kutta(&half, 1.0, [0.5, 1.0], derivative);
        assert!((half[0] - 15.625).abs() < 1e-12 && (whole[0] - 27.0).abs() < 1e-12);
    }

    #[test]
    fn an_event_is_found_where_it_happens() {
        for power in [1, 3, 9] {
            let excess = |share: f64| share.powi(power) - 0.7_f64.powi(power);
            let found = event([0.25, 1.0], 1e-10, excess);
            assert!((0.0..=1e-10).contains(&excess(found)) && (found - 0.7).abs() < 1e-7, "{power}: {found}");
        }
    }
}
