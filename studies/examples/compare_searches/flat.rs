//! Functions with few values: nothing shows the way to a violation.
//!
//! Four to ten percent of the inside violate, and no corner, but in `flat-extremes`.

use crate::problem::{Instance, Problem};

pub const PROBLEMS: [Problem; 7] = [
    Problem::new("flat-box", flat_box).with_axes(&[3, 6, 14, 30]),
    Problem::new("flat-ball", flat_ball).with_axes(&[3, 6, 14, 30]),
    Problem::new("flat-band", flat_band).with_axes(&[3, 6, 14, 30]),
    Problem::new("flat-xor", flat_xor).with_axes(&[3, 6, 14, 30]),
    Problem::new("flat-extremes", flat_extremes).with_axes(&[3, 4, 6, 14, 30]),
    Problem::new("two-levels", two_levels).with_axes(&[6, 14]),
    Problem::new("stairs", stairs).with_axes(&[6, 14]),
];

/// Returns the share of violations of an instance.
fn share(instance: &Instance) -> f64 {
    0.04 + 0.06 * instance.parameters[0]
}

/// Returns the k-th of the axes of an instance in random order.
fn axis(instance: &Instance, k: usize) -> usize {
    let mut order: Vec<usize> = (0..instance.target.len()).collect();
    order.sort_by(|i, j| instance.target[*i].total_cmp(&instance.target[*j]));
    order[k % order.len()]
}

fn half(is_violated: bool) -> f64 {
    if is_violated { -0.5 } else { 0.5 }
}

/// Intervals of equal length of one to three axes.
fn is_in_box(u: &[f64], instance: &Instance) -> bool {
    let n = 1 + (3.0 * instance.parameters[1]) as usize;
    let edge = share(instance).powf((n as f64).recip());
    (0..n).all(|k| {
        let low = 0.02 + (0.96 - edge) * instance.parameters[2 + k];
        (low..low + edge).contains(&u[axis(instance, k)])
    })
}

fn flat_box(u: &[f64], instance: &Instance) -> f64 {
    half(is_in_box(u, instance))
}

/// Returns the number below which a share p of the normal distribution is, to 0.005.
fn quantile(p: f64) -> f64 {
    let t = (-2.0 * p.ln()).sqrt();
    (2.307_53 + 0.270_61 * t) / (1.0 + 0.992_29 * t + 0.044_81 * t * t) - t
}

/// A ball around a point inside, with all axes, but not the center of the box. Its radius is that
/// of a normal sum.
fn flat_ball(u: &[f64], instance: &Instance) -> f64 {
    let mut squares = 0.0;
    let mut mean = 0.0;
    let mut variance = 0.0;
    for (x, t) in u.iter().zip(&instance.target) {
        let offset = 0.3 * (t - 0.5);
        squares += (x - 0.5 - offset) * (x - 0.5 - offset);
        mean += 1.0 / 12.0 + offset * offset;
        variance += 1.0 / 180.0 + offset * offset / 3.0;
    }
    let is_center = u.iter().all(|x| *x == 0.5);
    half(!is_center && squares < mean + quantile(share(instance)) * variance.sqrt())
}

fn is_inside(u: &[f64]) -> bool {
    u.iter().all(|x| *x > 0.0 && *x < 1.0)
}

/// A band across all axes, without the faces of the box.
fn flat_band(u: &[f64], instance: &Instance) -> f64 {
    let weight = |k: usize| instance.parameters[8 + k % 64] - 0.5;
    let sum: f64 = u.iter().enumerate().map(|(k, x)| weight(k) * (x - 0.5)).sum();
    let scale = (0..u.len()).map(|k| weight(k) * weight(k) / 12.0).sum::<f64>().sqrt();
    // Above the quantile, with a probability of half of the share on each side of it.
    let low = quantile(1.6 * share(instance));
    let high = quantile(0.6 * share(instance));
    half(is_inside(u) && (high..low).contains(&(sum / scale)))
}

/// Two axes with a certain difference, without the faces of the box.
fn flat_xor(u: &[f64], instance: &Instance) -> f64 {
    let a = u[axis(instance, 0)];
    let b = u[axis(instance, 1)];
    let difference = 0.1 + 0.2 * instance.parameters[1];
    half(is_inside(u) && (a - b - difference).abs() < 0.6 * share(instance))
}

/// The outer tenths of two or three axes.
fn flat_extremes(u: &[f64], instance: &Instance) -> f64 {
    let n = 2 + (2.0 * instance.parameters[1]) as usize;
    let is_extreme = |k: usize| {
        let x = u[axis(instance, k)];
        if instance.parameters[2 + k] < 0.5 { x <= 0.1 } else { x >= 0.9 }
    };
    half((0..n).all(is_extreme))
}

/// The box, and another value in half of the rest that says nothing of the violations.
fn two_levels(u: &[f64], instance: &Instance) -> f64 {
    let other = u[axis(instance, 4)] > instance.parameters[6];
    if is_in_box(u, instance) {
        -0.5
    } else if other {
        1.5
    } else {
        0.5
    }
}

/// Steps of 1 that lead down to a ball with all axes.
fn stairs(u: &[f64], instance: &Instance) -> f64 {
    let far = crate::smooth::distance(u, |i| 0.2 + 0.6 * instance.target[i]);
    (8.0 * (far - 0.8 * crate::smooth::radius(u.len()))).ceil() - 0.5
}
