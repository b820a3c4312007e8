//! The generalized Cauchy point: the first local minimizer of the model along the projected
//! gradient path.

use std::cmp::Ordering;

use super::dense::dot;
use super::memory::Memory;

/// The Cauchy point and the data for the subspace minimization.
#[derive(Debug, Clone)]
pub(super) struct CauchyPoint {
    pub(super) x: Vec<f64>,
    /// Wᵀ(x_cauchy - x).
    pub(super) c: Vec<f64>,
    /// The coordinates that are free there, in ascending order.
    pub(super) free: Vec<usize>,
}

/// Follows the path from `x` along -`g`, projected on `[0,1]^d`, to the first local minimizer of
/// the quadratic model.
///
/// The model's slope f' and curvature f'' along each segment are updated from those of the previous
/// segment. At each breakpoint one coordinate reaches its bound and becomes fixed.
///
/// # Reference
/// Byrd, Lu, Nocedal and Zhu 1995, algorithm CP.
pub(super) fn cauchy_point(x: &[f64], g: &[f64], memory: &Memory) -> CauchyPoint {
    let mut path = Path::new(x, g, memory);
    path.walk();
    let free = (0..x.len()).filter(|&i| !path.is_fixed[i]).collect();
    CauchyPoint { x: path.point, c: path.c, free }
}

struct Path<'a> {
    x: &'a [f64],
    memory: &'a Memory,
    point: Vec<f64>,
    direction: Vec<f64>,
    /// Whether a coordinate is fixed at its bound.
    is_fixed: Vec<bool>,
    /// The breakpoints: (distance along the path, coordinate), nearest first.
    breakpoints: Vec<(f64, usize)>,
    /// Wᵀ direction and Wᵀ(point - x).
    p: Vec<f64>,
    c: Vec<f64>,
    slope: f64,
}

impl<'a> Path<'a> {
    fn new(x: &'a [f64], g: &[f64], memory: &'a Memory) -> Self {
        let pairs = 2 * memory.len();
        let mut path = Self {
            x,
            memory,
            point: x.to_vec(),
            direction: vec![0.0; x.len()],
            is_fixed: vec![false; x.len()],
            breakpoints: Vec::with_capacity(x.len()),
            p: vec![0.0; pairs],
            c: vec![0.0; pairs],
            slope: 0.0,
        };
        for (i, g) in g.iter().enumerate() {
            path.add_coordinate(i, -g);
        }
        path.breakpoints.sort_by(|a, b| a.0.partial_cmp(&b.0).unwrap_or(Ordering::Equal));
        path
    }

    fn add_coordinate(&mut self, i: usize, descent: f64) {
        let below = self.x[i];
        let above = 1.0 - self.x[i];
        self.is_fixed[i] = if below <= 0.0 { descent <= 0.0 } else { above <= 0.0 && descent >= 0.0 };
        if self.is_fixed[i] || descent == 0.0 {
            return;
        }
        self.direction[i] = descent;
        self.slope -= descent * descent;
        let row = self.memory.row(i);
        self.p.iter_mut().zip(row).for_each(|(p, w)| *p += w * descent);
        if descent < 0.0 {
            self.breakpoints.push((below / -descent, i));
        } else if descent > 0.0 {
            self.breakpoints.push((above / descent, i));
        }
    }

    fn walk(&mut self) {
        let theta = self.memory.theta;
        let mut curvature = -theta * self.slope;
        let min_curvature = f64::EPSILON * curvature;
        curvature -= dot(&self.memory.middle(&self.p), &self.p);
        let mut to_minimum = -self.slope / curvature;
        let mut traveled = 0.0;
        let breakpoints = std::mem::take(&mut self.breakpoints);
        for (n_passed, &(distance, i)) in breakpoints.iter().enumerate() {
            let length = distance - traveled;
            if to_minimum < length {
                break;
            }
            traveled = distance;
            let along = self.fix_at_bound(i);
            let moved = self.point[i] - self.x[i];
            self.slope += length * curvature + along * along - theta * along * moved;
            curvature -= theta * along * along;
            self.c.iter_mut().zip(&self.p).for_each(|(c, p)| *c += length * p);
            let row = self.memory.row(i);
            let middle = self.memory.middle(&row);
            self.slope += along * dot(&self.c, &middle);
            curvature += 2.0 * along * dot(&self.p, &middle) - along * along * dot(&row, &middle);
            self.p.iter_mut().zip(&row).for_each(|(p, w)| *p -= along * w);
            curvature = min_curvature.max(curvature);
            let is_last = n_passed + 1 == breakpoints.len();
            to_minimum = if is_last { 0.0 } else { -self.slope / curvature };
        }
        // A negative distance means that the minimizer is the last breakpoint.
        let rest = if to_minimum <= 0.0 { 0.0 } else { to_minimum };
        traveled += rest;
        self.point.iter_mut().zip(&self.direction).for_each(|(x, d)| *x += traveled * d);
        self.c.iter_mut().zip(&self.p).for_each(|(c, p)| *c += rest * p);
    }

    /// Fixes coordinate `i` at the bound that it has reached, and returns its previous direction.
    fn fix_at_bound(&mut self, i: usize) -> f64 {
        let along = std::mem::take(&mut self.direction[i]);
        self.point[i] = if along > 0.0 { 1.0 } else { 0.0 };
        self.is_fixed[i] = true;
        along
    }
}
