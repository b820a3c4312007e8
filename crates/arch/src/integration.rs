//! Integration with fixed steps.

/// Takes a step of the classical Runge-Kutta method (order 4). `derivative` gets the share of the
/// full step, in \[0, 1\], at which it is evaluated: the step taken is `share` of `dt`.
pub(crate) fn runge_kutta<const N: usize>(
    state: &[f64; N],
    dt: f64,
    [begin, end]: [f64; 2],
    derivative: impl Fn(&[f64; N], f64) -> [f64; N],
) -> [f64; N] {
    let (h, middle) = (dt * (end - begin), 0.5 * (begin + end));
    let moved = |slope: &[f64; N], by: f64| std::array::from_fn(|i| state[i] + by * slope[i]);
    let first = derivative(state, begin);
    let second = derivative(&moved(&first, 0.5 * h), middle);
    let third = derivative(&moved(&second, 0.5 * h), middle);
    let fourth = derivative(&moved(&third, h), end);
    std::array::from_fn(|i| state[i] + h / 6.0 * (first[i] + 2.0 * (second[i] + third[i]) + fourth[i]))
}

/// Halvings until the place of an event in its step is known: to 5e-11 of a step.
const HALVINGS: usize = 34;

/// Returns the first share of the interval at which `happened`, which holds at its end and not at
/// its begin, holds.
pub(crate) fn event([mut before, mut after]: [f64; 2], happened: impl Fn(f64) -> bool) -> f64 {
    for _ in 0..HALVINGS {
        let middle = 0.5 * (before + after);
        if happened(middle) { after = middle } else { before = middle }
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
        assert!((event([0.25, 1.0], |share| share >= 0.7) - 0.7).abs() < 1e-10);
    }
}
