//! Twelve functions with slopes, steps and basins.

use mishandle::search::functions;

use crate::problem::{Instance, Problem};

pub const PROBLEMS: [Problem; 12] = [
    Problem::new("corner", corner),
    Problem::new("inside", inside),
    Problem::new("face", face),
    Problem::new("rough", rough),
    Problem::new("needle", needle),
    Problem::new("min-max", min_max),
    Problem::new("signs", signs),
    Problem::new("plateau", plateau),
    Problem::new("cliff", cliff),
    Problem::new("two-basins", two_basins),
    Problem::new("separable", separable),
    Problem::new("one-corner", one_corner),
];

/// Returns the distance between two points, divided by the diagonal of the box.
pub fn distance(u: &[f64], center: impl Fn(usize) -> f64) -> f64 {
    let squares = u.iter().enumerate().map(|(i, x)| (x - center(i)) * (x - center(i)));
    (squares.sum::<f64>() / u.len() as f64).sqrt()
}

/// Returns 0.1 in 2 dimensions and 0.2 in 30.
pub fn radius(d: usize) -> f64 {
    0.1 + 0.1 * (d as f64 / 2.0).ln() / 15f64.ln()
}

fn corner(u: &[f64], instance: &Instance) -> f64 {
    let t = &instance.target;
    distance(u, |i| t[i].round()) - radius(u.len())
}

fn inside(u: &[f64], instance: &Instance) -> f64 {
    let t = &instance.target;
    distance(u, |i| 0.1 + 0.8 * t[i]) - radius(u.len())
}

fn face(u: &[f64], instance: &Instance) -> f64 {
    let t = &instance.target;
    distance(u, |i| if i < 2 { t[i].round() } else { 0.1 + 0.8 * t[i] }) - radius(u.len())
}

fn rough(u: &[f64], instance: &Instance) -> f64 {
    let t = &instance.target;
    let moved: Vec<f64> = u.iter().zip(t).map(|(x, t)| x - t + 0.6).collect();
    functions::rastrigin(&moved) / u.len() as f64 - 2.0
}

fn needle(u: &[f64], instance: &Instance) -> f64 {
    let t = &instance.target;
    let far = distance(u, |i| 0.1 + 0.8 * t[i]);
    if far < radius(u.len()) { -1.0 } else { 2.0 - far }
}

fn min_max(u: &[f64], _: &Instance) -> f64 {
    functions::min_max(u)
}

fn signs(u: &[f64], instance: &Instance) -> f64 {
    let t = &instance.target;
    let agreement: f64 = u.iter().zip(t).map(|(x, t)| (2.0 * t.round() - 1.0) * (2.0 * x - 1.0)).sum();
    0.55 - agreement / u.len() as f64
}

fn plateau(u: &[f64], instance: &Instance) -> f64 {
    let t = &instance.target;
    (distance(u, |i| 0.1 + 0.8 * t[i]) - 0.6 * radius(u.len())).min(0.1)
}

fn cliff(u: &[f64], instance: &Instance) -> f64 {
    let t = &instance.target;
    let largest = u.iter().zip(t).map(|(x, t)| (x - 0.1 - 0.8 * t).abs()).fold(0.0, f64::max);
    if largest < 0.3 * radius(u.len()) { -0.5 } else { 0.3 + largest }
}

fn two_basins(u: &[f64], instance: &Instance) -> f64 {
    let t = &instance.target;
    let place = |i: usize| 0.1 + 0.8 * t[i];
    let wide = distance(u, |i| (place(i) + 0.5) % 1.0);
    (0.05 + 0.5 * wide).min(2.0 * (distance(u, place) - 0.6 * radius(u.len())))
}

fn separable(u: &[f64], instance: &Instance) -> f64 {
    let t = &instance.target;
    let term = |(x, t): (&f64, &f64)| {
        let far = (x - t).abs();
        2.0 * far + 0.5 * (1.0 - (8.0 * std::f64::consts::PI * (x - t)).cos())
    };
    u.iter().zip(t).map(term).sum::<f64>() / u.len() as f64 - 0.25
}

fn one_corner(u: &[f64], instance: &Instance) -> f64 {
    let t = &instance.target;
    let is_near = u.iter().zip(t).all(|(x, t)| (x - t.round()).abs() < 0.15);
    if is_near { -1.0 } else { 0.5 + 0.1 * (u[0] - t[0]).abs() }
}
