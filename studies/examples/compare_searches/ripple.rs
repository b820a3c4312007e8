//! Functions with a trend that leads to a region, and short-waved ripple that decides there.

use std::f64::consts::TAU;

use crate::problem::{Instance, Problem};
use crate::smooth::distance;

pub const PROBLEMS: [Problem; 5] = [
    Problem::new("ripple-wave", wave).with_axes(&[2, 3, 4, 5]),
    Problem::new("ripple-grid", grid).with_axes(&[2, 3, 4, 5]),
    Problem::new("ripple-cells", cells).with_axes(&[2, 3, 4, 5]),
    Problem::new("ripple-inside", inside).with_axes(&[2, 3, 4, 5]),
    Problem::new("ripple-edge", edge).with_axes(&[2, 3, 4, 5]),
];

/// The margin that the trend leaves at its lowest point, and the amplitude of the ripple.
const MARGIN: f64 = 0.1;
const AMPLITUDE: f64 = 0.115;

/// Returns the distance to a random face, at most 1.
fn far_from_face(u: &[f64], instance: &Instance) -> f64 {
    let k = (instance.parameters[0] * u.len() as f64) as usize;
    if instance.parameters[1] < 0.5 { u[k] } else { 1.0 - u[k] }
}

/// A plane wave in a random direction.
fn wave(u: &[f64], instance: &Instance) -> f64 {
    let p = &instance.parameters;
    let sum: f64 = u.iter().enumerate().map(|(k, x)| (p[8 + k] - 0.5) * x).sum();
    let length = (0..u.len()).map(|k| (p[8 + k] - 0.5) * (p[8 + k] - 0.5)).sum::<f64>().sqrt();
    let cycles = 10.0 + 10.0 * p[2];
    far_from_face(u, instance) + MARGIN + AMPLITUDE * (TAU * (cycles * sum / length + p[3])).sin()
}

/// The product of two waves along the first axes without that of the face, or one wave.
fn grid(u: &[f64], instance: &Instance) -> f64 {
    let p = &instance.parameters;
    let face = (p[0] * u.len() as f64) as usize;
    let others = u.iter().enumerate().filter(|(k, _)| *k != face).take(2);
    let ripple: f64 = others.map(|(k, x)| (TAU * ((8.0 + 8.0 * p[8 + k]) * x + p[16 + k])).sin()).product();
    far_from_face(u, instance) + MARGIN + AMPLITUDE * ripple
}

/// Returns a number in [-1, 1] that is random in each cell of a grid.
fn of_cell(u: &[f64], cells: f64, instance: &Instance) -> f64 {
    let mut hash = instance.parameters[4].to_bits();
    for x in u {
        hash = (hash ^ (x * cells).floor().to_bits()).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        hash ^= hash >> 29;
        hash = hash.wrapping_mul(0xBF58_476D_1CE4_E5B9);
        hash ^= hash >> 32;
    }
    (hash >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
}

/// A random number for each cell.
fn cells(u: &[f64], instance: &Instance) -> f64 {
    far_from_face(u, instance) + MARGIN + AMPLITUDE * of_cell(u, 60.0, instance)
}

/// A bowl with its lowest point inside; random numbers of cells.
fn inside(u: &[f64], instance: &Instance) -> f64 {
    distance(u, |i| 0.15 + 0.7 * instance.target[i]) + MARGIN + 1.3 * MARGIN * of_cell(u, 60.0, instance)
}

/// The distance to an edge of two faces, and waves of all axes.
fn edge(u: &[f64], instance: &Instance) -> f64 {
    let p = &instance.parameters;
    let far = distance(&u[..2], |i| instance.target[i].round());
    let waves: f64 =
        u.iter().enumerate().map(|(k, x)| (TAU * ((9.0 + 9.0 * p[8 + k]) * x + p[16 + k])).sin()).sum();
    far + MARGIN + 1.3 * MARGIN * waves / (u.len() as f64).sqrt()
}
