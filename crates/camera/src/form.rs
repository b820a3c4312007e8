//! The forms of shapes: where rays enter them, their normals and their bounds.

use crate::lanes::{Lanes, Lanes3, along, dot};

/// The form of a shape, in its own frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Form {
    /// The plane z = 0, which is visible from above.
    Plane {
        /// Half sizes along x and y, m; infinite if there is no end.
        half: [f32; 2],
    },
    /// A sphere.
    Sphere {
        /// Its radius, m.
        radius: f32,
    },
    /// A box.
    Box {
        /// Half sizes, m.
        half: [f32; 3],
    },
    /// A capsule along z.
    Capsule {
        /// Its radius, m.
        radius: f32,
        /// Half length of its axis, without the caps, m.
        half: f32,
    },
    /// A cylinder along z.
    Cylinder {
        /// Its radius, m.
        radius: f32,
        /// Half length, m.
        half: f32,
    },
    /// An ellipsoid.
    Ellipsoid {
        /// Half axes, m.
        half: [f32; 3],
    },
    /// The mesh of the scene with this index.
    Mesh(usize),
    /// The cloth of the scene with this index. Its vertices are in the frame of the world.
    Cloth(usize),
}

/// The least area, m², of a direction across an axis: a ray along the axis of a cylinder stays
/// where it is, and divides by this instead of 0.
const TINY: f32 = 1e-20;

impl Form {
    /// Returns whether the form is convex and has an inside, so that it casts no shadow on itself.
    pub(crate) fn is_convex(self) -> bool {
        !matches!(self, Form::Mesh(_) | Form::Cloth(_))
    }

    /// Returns half the size of the box around a convex form, m, in its own frame.
    pub(crate) fn half(self) -> [f32; 3] {
        match self {
            Form::Plane { half: [x, y] } => [x, y, 0.0],
            Form::Sphere { radius } => [radius; 3],
            Form::Box { half } | Form::Ellipsoid { half } => half,
            Form::Capsule { radius, half } => [radius, radius, half + radius],
            Form::Cylinder { radius, half } => [radius, radius, half],
            Form::Mesh(_) | Form::Cloth(_) => [0.0; 3],
        }
    }

    /// Returns the normal at a point of the surface of a convex form.
    pub(crate) fn normal(self, p: [f32; 3]) -> [f32; 3] {
        let outwards = |component: f32| if component < 0.0 { -1.0 } else { 1.0 };
        match self {
            Form::Plane { .. } | Form::Mesh(_) | Form::Cloth(_) => [0.0, 0.0, 1.0],
            Form::Sphere { radius } => p.map(|v| v / radius),
            Form::Box { half } => {
                let mut axis = 0;
                let beyond = |axis: usize| p[axis].abs() - half[axis];
                for other in 1..3 {
                    if beyond(other) > beyond(axis) {
                        axis = other;
                    }
                }
                let mut normal = [0.0; 3];
                normal[axis] = outwards(p[axis]);
                normal
            }
            Form::Capsule { radius, half } => {
                let center = if p[2] > half { half } else { p[2].max(-half) };
                [p[0] / radius, p[1] / radius, (p[2] - center) / radius]
            }
            Form::Cylinder { radius, half } => {
                let across = (p[0] * p[0] + p[1] * p[1]).sqrt();
                match p[2].abs() - half > across - radius {
                    true => [0.0, 0.0, outwards(p[2])],
                    false => [p[0] / across, p[1] / across, 0.0],
                }
            }
            Form::Ellipsoid { half } => {
                let gradient = [0, 1, 2].map(|i| p[i] / (half[i] * half[i]));
                crate::vector::unit(gradient)
            }
        }
    }
}

/// Returns where rays `o + t d` enter the plane z = 0 from above.
#[inline(always)]
pub(crate) fn enter_plane(half: [f32; 2], o: Lanes3, d: Lanes3) -> Lanes {
    let t = -o[2] / d[2];
    let [x, y, _] = along(o, t, d);
    let inside = |p: Lanes, half: f32, t: Lanes| p.abs().select_at_most(Lanes::all(half), t, Lanes::MISS);
    let t = inside(y, half[1], inside(x, half[0], t));
    let t = d[2].select_less(Lanes::ZERO, t, Lanes::MISS);
    Lanes::ZERO.select_less(o[2], t, Lanes::MISS)
}

/// Returns where rays enter a sphere. A ray that starts inside does not enter.
///
/// The nearest point of the ray to the center comes first, so that distant small spheres keep their
/// shape in single precision.
///
/// # Reference
/// Haines, Günther and Akenine-Möller, "Precision Improvements for Ray/Sphere Intersection", Ray
/// Tracing Gems, 2019.
#[inline(always)]
pub(crate) fn enter_sphere(radius: f32, o: Lanes3, d: Lanes3) -> Lanes {
    let length2 = dot(d, d);
    let middle = -dot(o, d) / length2;
    let p = along(o, middle, d);
    let rest = Lanes::all(radius * radius) - dot(p, p);
    let t = middle - (rest.max(Lanes::ZERO) / length2).sqrt();
    let t = rest.select_less(Lanes::ZERO, Lanes::MISS, t);
    Lanes::ZERO.select_less(t, t, Lanes::MISS)
}

/// Returns where rays enter an ellipsoid: a sphere in stretched space.
#[inline(always)]
pub(crate) fn enter_ellipsoid(half: [f32; 3], o: Lanes3, d: Lanes3) -> Lanes {
    let stretched = |v: Lanes3| [0, 1, 2].map(|i| v[i] * Lanes::all(1.0 / half[i]));
    enter_sphere(1.0, stretched(o), stretched(d))
}

/// Returns where rays enter and leave the slab |x| <= half.
#[inline(always)]
fn slab(half: f32, o: Lanes, d: Lanes) -> (Lanes, Lanes) {
    let inverse = Lanes::all(1.0) / d;
    let (a, b) = ((Lanes::all(-half) - o) * inverse, (Lanes::all(half) - o) * inverse);
    (a.min(b), a.max(b))
}

/// Returns where rays enter a box. A ray that starts inside does not enter.
#[inline(always)]
pub(crate) fn enter_box(half: [f32; 3], o: Lanes3, d: Lanes3) -> Lanes {
    let [x, y, z] = [0, 1, 2].map(|i| slab(half[i], o[i], d[i]));
    let (first, last) = (x.0.max(y.0).max(z.0), x.1.min(y.1).min(z.1));
    let t = first.select_at_most(last, first, Lanes::MISS);
    Lanes::ZERO.select_less(t, t, Lanes::MISS)
}

/// Returns where rays meet the infinite cylinder around z: the middle, half the length inside, and
/// the square of the radius minus that of the distance from the axis.
#[inline(always)]
fn across(radius: f32, o: Lanes3, d: Lanes3) -> (Lanes, Lanes, Lanes) {
    let length2 = (d[0] * d[0] + d[1] * d[1]).max(Lanes::all(TINY));
    let middle = -(o[0] * d[0] + o[1] * d[1]) / length2;
    let (x, y) = (o[0] + middle * d[0], o[1] + middle * d[1]);
    let rest = Lanes::all(radius * radius) - (x * x + y * y);
    (middle, (rest.max(Lanes::ZERO) / length2).sqrt(), rest)
}

/// Returns where rays enter a cylinder. A ray that starts inside does not enter.
#[inline(always)]
pub(crate) fn enter_cylinder(radius: f32, half: f32, o: Lanes3, d: Lanes3) -> Lanes {
    let (middle, inside, rest) = across(radius, o, d);
    let (z_first, z_last) = slab(half, o[2], d[2]);
    let (first, last) = ((middle - inside).max(z_first), (middle + inside).min(z_last));
    let t = first.select_at_most(last, first, Lanes::MISS);
    let t = rest.select_less(Lanes::ZERO, Lanes::MISS, t);
    Lanes::ZERO.select_less(t, t, Lanes::MISS)
}

/// Returns where rays enter a capsule. A ray that starts inside does not enter.
#[inline(always)]
pub(crate) fn enter_capsule(radius: f32, half: f32, o: Lanes3, d: Lanes3) -> Lanes {
    let (middle, inside, rest) = across(radius, o, d);
    let side = middle - inside;
    let z = o[2] + side * d[2];
    // A ray that is beyond an end of the axis where it enters the cylinder enters by this cap.
    let end = z.min(Lanes::all(half)).max(Lanes::all(-half));
    let cap = enter_sphere(radius, [o[0], o[1], o[2] - end], d);
    let side = Lanes::ZERO.select_less(side, side, Lanes::MISS);
    let t = z.abs().select_at_most(Lanes::all(half), side, cap);
    rest.select_less(Lanes::ZERO, Lanes::MISS, t)
}
