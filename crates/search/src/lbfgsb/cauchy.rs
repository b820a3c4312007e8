//! The generalised Cauchy point: the first local minimum of the model along the projected gradient path.

use std::cmp::Ordering;

use super::dense::dot;
use super::memory::Memory;

/// The Cauchy point and what the subspace step needs of it.
#[derive(Debug, Clone)]
pub(super) struct CauchyPoint {
    pub(super) x: Vec<f64>,
    /// Wᵀ(x_cauchy - x).
    pub(super) c: Vec<f64>,
    /// The coordinates that are free to move there, ascending.
    pub(super) free: Vec<usize>,
}

/// Walks from `x` along -`g`, bent at the faces of `[0,1]^d`, to the first minimum of the quadratic model.
///
/// The model's slope f' and curvature f'' along each straight piece follow from those of the piece before; at each
/// face met, one coordinate stops.
///
/// # Reference
/// Byrd, Lu, Nocedal and Zhu 1995, algorithm CP.
pub(super) fn cauchy_point(x: &[f64], g: &[f64], memory: &Memory) -> CauchyPoint {
    let mut path = Path::new(x, g, memory);
    path.walk();
    let free = (0..x.len()).filter(|&i| !path.held[i]).collect();
    CauchyPoint { x: path.point, c: path.c, free }
}

struct Path<'a> {
    x: &'a [f64],
    memory: &'a Memory,
    point: Vec<f64>,
    direction: Vec<f64>,
    /// Whether a coordinate stays at its face.
    held: Vec<bool>,
    /// Where the path meets faces: (distance along the path, coordinate), nearest first.
    breaks: Vec<(f64, usize)>,
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
            held: vec![false; x.len()],
            breaks: Vec::with_capacity(x.len()),
            p: vec![0.0; pairs],
            c: vec![0.0; pairs],
            slope: 0.0,
        };
        for (i, g) in g.iter().enumerate() {
            path.add_coordinate(i, -g);
        }
        path.breaks.sort_by(|a, b| a.0.partial_cmp(&b.0).unwrap_or(Ordering::Equal));
        path
    }

    fn add_coordinate(&mut self, i: usize, descent: f64) {
        let (below, above) = (self.x[i], 1.0 - self.x[i]);
        self.held[i] = if below <= 0.0 { descent <= 0.0 } else { above <= 0.0 && descent >= 0.0 };
        if self.held[i] || descent == 0.0 {
            return;
        }
        self.direction[i] = descent;
        self.slope -= descent * descent;
        let row = self.memory.row(i);
        self.p.iter_mut().zip(row).for_each(|(p, w)| *p += w * descent);
        if descent < 0.0 {
            self.breaks.push((below / -descent, i));
        } else if descent > 0.0 {
            self.breaks.push((above / descent, i));
        }
    }

    fn walk(&mut self) {
        let theta = self.memory.theta;
        let mut curvature = -theta * self.slope;
        let least_curvature = f64::EPSILON * curvature;
        curvature -= dot(&self.memory.middle(&self.p), &self.p);
        let mut to_minimum = -self.slope / curvature;
        let mut travelled = 0.0;
        let breaks = std::mem::take(&mut self.breaks);
        for (n_met, &(distance, i)) in breaks.iter().enumerate() {
            let length = distance - travelled;
            if to_minimum < length {
                break;
            }
            travelled = distance;
            let along = self.stop_at_face(i);
            let moved = self.point[i] - self.x[i];
            self.slope += length * curvature + along * along - theta * along * moved;
            curvature -= theta * along * along;
            self.c.iter_mut().zip(&self.p).for_each(|(c, p)| *c += length * p);
            let row = self.memory.row(i);
            let middle = self.memory.middle(&row);
            self.slope += along * dot(&self.c, &middle);
            curvature += 2.0 * along * dot(&self.p, &middle) - along * along * dot(&row, &middle);
            self.p.iter_mut().zip(&row).for_each(|(p, w)| *p -= along * w);
            curvature = least_curvature.max(curvature);
            let is_last = n_met + 1 == breaks.len();
            to_minimum = if is_last { 0.0 } else { -self.slope / curvature };
        }
        // A minimum behind the last corner means the corner itself.
        let rest = if to_minimum <= 0.0 { 0.0 } else { to_minimum };
        travelled += rest;
        self.point.iter_mut().zip(&self.direction).for_each(|(x, d)| *x += travelled * d);
        self.c.iter_mut().zip(&self.p).for_each(|(c, p)| *c += rest * p);
    }

    /// Leaves coordinate `i` at the face it has met, and gives the direction it had.
    fn stop_at_face(&mut self, i: usize) -> f64 {
        let along = std::mem::take(&mut self.direction[i]);
        self.point[i] = if along > 0.0 { 1.0 } else { 0.0 };
        self.held[i] = true;
        along
    }
}
