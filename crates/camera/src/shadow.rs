//! Which points a lamp reaches.

use crate::form::Form;
use crate::frame::{Frame, Meshes, NONE, Placed};
use crate::lanes::{LANES, Lanes, Lanes3, dot, same};
use crate::scene::Lamp;
use crate::surface::Surface;
use crate::vector::{self, Pose, beside, scale, unit};

/// Distance within which a surface casts no shadow, m: shapes have common surfaces, which rounding
/// would turn into spots, and triangles do not shade their neighbors at once.
const CLOSE: f32 = 5e-4;

/// Rows of a tile of pixels. A tile has one packet of columns.
const TILE: usize = 8;

/// The share of each point that a lamp reaches, and the scratch space to find it.
#[derive(Debug, Default)]
pub(crate) struct Shadows {
    /// From 0, in shadow, to 1, for each packet.
    pub lit: Vec<Lanes>,
    sum: Vec<Lanes>,
    points: Vec<[f32; 2]>,
    casters: Vec<Caster>,
    candidates: Vec<u32>,
}

/// Bounds of points in a frame with the direction to the lamp as third axis, m.
#[derive(Clone, Copy, Debug)]
struct Bounds {
    low: [f32; 3],
    high: [f32; 3],
}

/// A shape that may cast a shadow.
#[derive(Clone, Copy, Debug)]
struct Caster {
    /// Position in the list of placed shapes.
    position: u32,
    bounds: Bounds,
    /// The direction to the lamp in the frame of the shape.
    direction: [f32; 3],
}

impl Shadows {
    /// Finds which share of a lamp reaches each point.
    pub fn find(
        &mut self,
        lamp: &Lamp,
        placed: &[Placed],
        meshes: &Meshes<'_>,
        frame: &Frame,
        surface: &Surface,
    ) {
        self.lit.clear();
        self.lit.resize(frame.depth.len(), Lanes::ZERO);
        let direction = unit(lamp.direction);
        let is_hard = lamp.radius <= 0.0 || !lamp.casts_shadows;
        crate::pattern::disk_points(if is_hard { 1 } else { lamp.shadow_rays }, &mut self.points);
        if let [_] = self.points[..] {
            self.find_from(direction, lamp.casts_shadows, placed, meshes, frame, surface);
            return;
        }
        self.sum.clear();
        self.sum.resize(frame.depth.len(), Lanes::ZERO);
        let [a, b] = beside(direction);
        for index in 0..self.points.len() {
            let [x, y] = self.points[index].map(|v| v * lamp.radius);
            let from = unit(vector::add(direction, vector::add(scale(a, x), scale(b, y))));
            self.find_from(from, true, placed, meshes, frame, surface);
            self.sum.iter_mut().zip(&self.lit).for_each(|(sum, lit)| *sum = *sum + *lit);
        }
        let share = Lanes::all(1.0 / self.points.len() as f32);
        self.lit.iter_mut().zip(&self.sum).for_each(|(lit, sum)| *lit = *sum * share);
    }

    /// Finds which points light from one direction reaches.
    fn find_from(
        &mut self,
        direction: [f32; 3],
        casts_shadows: bool,
        placed: &[Placed],
        meshes: &Meshes<'_>,
        frame: &Frame,
        surface: &Surface,
    ) {
        let toward = same(direction);
        for (index, lit) in self.lit.iter_mut().enumerate() {
            let cosine = dot(surface.normal[index], toward);
            // A point without a shape has no normal.
            *lit = Lanes::ZERO.select_less(cosine, Lanes::all(1.0), Lanes::ZERO);
        }
        if !casts_shadows {
            return;
        }
        let [a, b] = beside(direction);
        let axes = [a, b, direction];
        // Other states have more casters of a tile, and later images shall not allocate for them.
        self.casters.clear();
        self.casters.reserve(placed.len());
        self.candidates.clear();
        self.candidates.reserve(placed.len());
        for (position, own) in placed.iter().enumerate().filter(|(_, own)| own.is_opaque) {
            if let Some(caster) = Caster::new(position as u32, own, axes) {
                self.casters.push(caster);
            }
        }
        let rows = frame.depth.len() / frame.packets.max(1);
        for first in (0..rows).step_by(TILE) {
            for column in 0..frame.packets {
                self.find_tile(first..rows.min(first + TILE), column, axes, placed, meshes, frame, surface);
            }
        }
    }

    #[allow(clippy::too_many_arguments)]
    fn find_tile(
        &mut self,
        rows: std::ops::Range<usize>,
        column: usize,
        axes: [[f32; 3]; 3],
        placed: &[Placed],
        meshes: &Meshes<'_>,
        frame: &Frame,
        surface: &Surface,
    ) {
        let mut tile = Bounds::NOWHERE;
        let mut own = [Bounds::NOWHERE; TILE];
        for (bounds, row) in own.iter_mut().zip(rows.clone()) {
            let index = row * frame.packets + column;
            *bounds = Bounds::of(surface.point[index], self.lit[index], axes);
            tile.include(bounds);
        }
        self.candidates.clear();
        for (index, caster) in self.casters.iter().enumerate() {
            if caster.bounds.may_shade(&tile) {
                self.candidates.push(index as u32);
            }
        }
        for (bounds, row) in own.iter().zip(rows) {
            let index = row * frame.packets + column;
            for candidate in &self.candidates {
                if self.lit[index] == Lanes::ZERO {
                    break;
                }
                let caster = &self.casters[*candidate as usize];
                if !caster.bounds.may_shade(bounds) {
                    continue;
                }
                let shape = &placed[caster.position as usize];
                let o = local(&shape.pose, surface.point[index]);
                let t = shape.enter(meshes, CLOSE, o, same(caster.direction));
                // A convex shape does not shade itself.
                let itself = if shape.form.is_convex() { caster.position } else { NONE };
                let lit = &mut self.lit[index];
                let shapes = &frame.shape[index];
                for i in 0..LANES {
                    let is_blocked = CLOSE < t.0[i] && t.0[i] < f32::INFINITY && shapes[i] != itself;
                    lit.0[i] = if is_blocked { 0.0 } else { lit.0[i] };
                }
            }
        }
    }
}

/// Returns points of the world in the frame of a shape.
#[inline(always)]
fn local(pose: &Pose, p: Lanes3) -> Lanes3 {
    let from = [0, 1, 2].map(|i| p[i] - Lanes::all(pose.position[i]));
    pose.axes.map(|axis| dot(from, same(axis)))
}

impl Caster {
    fn new(position: u32, own: &Placed, axes: [[f32; 3]; 3]) -> Option<Caster> {
        let direction = own.pose.local_direction(axes[2]);
        if matches!(own.form, Form::Plane { .. }) && direction[2] >= 0.0 {
            // Light that leaves a plane does not enter it.
            return None;
        }
        let center = own.pose.point(own.center);
        let mut low = [0.0; 3];
        let mut high = [0.0; 3];
        for (i, axis) in axes.iter().enumerate() {
            let middle = vector::dot(center, *axis);
            let along = |k: usize| vector::dot(own.pose.axes[k], *axis).abs();
            let reach = match own.form {
                Form::Sphere { radius } => radius,
                Form::Capsule { radius, half } => radius + half * along(2),
                _ => (0..3).map(|k| along(k) * own.half[k]).sum(),
            };
            (low[i], high[i]) = (middle - reach - MARGIN, middle + reach + MARGIN);
        }
        Some(Caster { position, bounds: Bounds { low, high }, direction })
    }
}

/// Added to bounds for rounding, m.
const MARGIN: f32 = 1e-5;

impl Bounds {
    /// The bounds of no points.
    const NOWHERE: Bounds = Bounds { low: [f32::INFINITY; 3], high: [f32::NEG_INFINITY; 3] };

    /// Returns the bounds of the points that are lit so far.
    #[inline(always)]
    fn of(p: Lanes3, lit: Lanes, axes: [[f32; 3]; 3]) -> Bounds {
        let mut bounds = Bounds::NOWHERE;
        for (i, axis) in axes.iter().enumerate() {
            let along = dot(p, same(*axis));
            let low = Lanes::ZERO.select_less(lit, along, Lanes::MISS);
            let high = Lanes::ZERO.select_less(lit, along, -Lanes::MISS);
            (bounds.low[i], bounds.high[i]) = (low.least(), high.greatest());
        }
        bounds
    }

    fn include(&mut self, other: &Bounds) {
        for i in 0..3 {
            self.low[i] = self.low[i].min(other.low[i]);
            self.high[i] = self.high[i].max(other.high[i]);
        }
    }

    /// Returns whether something within these bounds may be between points and the lamp.
    #[inline(always)]
    fn may_shade(&self, points: &Bounds) -> bool {
        self.high[2] > points.low[2]
            && self.low[0] <= points.high[0]
            && self.high[0] >= points.low[0]
            && self.low[1] <= points.high[1]
            && self.high[1] >= points.low[1]
    }
}
