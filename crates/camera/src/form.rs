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
                if p[2].abs() - half > across - radius {
                    [0.0, 0.0, outwards(p[2])]
                } else {
                    [p[0] / across, p[1] / across, 0.0]
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
    let a = (Lanes::all(-half) - o) * inverse;
    let b = (Lanes::all(half) - o) * inverse;
    (a.min(b), a.max(b))
}

/// Returns where rays enter a box. A ray that starts inside does not enter.
#[inline(always)]
pub(crate) fn enter_box(half: [f32; 3], o: Lanes3, d: Lanes3) -> Lanes {
    let [x, y, z] = [0, 1, 2].map(|i| slab(half[i], o[i], d[i]));
    let first = x.0.max(y.0).max(z.0);
    let last = x.1.min(y.1).min(z.1);
    let t = first.select_at_most(last, first, Lanes::MISS);
    Lanes::ZERO.select_less(t, t, Lanes::MISS)
}

/// Returns where rays meet the infinite cylinder around z: the middle, half the length inside, and
/// the square of the radius minus that of the distance from the axis.
#[inline(always)]
fn across(radius: f32, o: Lanes3, d: Lanes3) -> (Lanes, Lanes, Lanes) {
    let length2 = (d[0] * d[0] + d[1] * d[1]).max(Lanes::all(TINY));
    let middle = -(o[0] * d[0] + o[1] * d[1]) / length2;
    let x = o[0] + middle * d[0];
    let y = o[1] + middle * d[1];
    let rest = Lanes::all(radius * radius) - (x * x + y * y);
    (middle, (rest.max(Lanes::ZERO) / length2).sqrt(), rest)
}

/// Returns where rays enter a cylinder. A ray that starts inside does not enter.
#[inline(always)]
pub(crate) fn enter_cylinder(radius: f32, half: f32, o: Lanes3, d: Lanes3) -> Lanes {
    let (middle, inside, rest) = across(radius, o, d);
    let (z_first, z_last) = slab(half, o[2], d[2]);
    let first = (middle - inside).max(z_first);
    let last = (middle + inside).min(z_last);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::LANES;
    use mishandle_random::Sequence;

    /// Returns how far a point is inside a form, in some unit: a function whose zeros are the
    /// surface and whose gradient is opposite to the normal.
    fn inside(form: Form, p: [f64; 3]) -> f64 {
        let wide = |v: f32| f64::from(v);
        match form {
            Form::Sphere { radius } => wide(radius) - (p[0].powi(2) + p[1].powi(2) + p[2].powi(2)).sqrt(),
            Form::Box { half } => {
                [0, 1, 2].map(|i| wide(half[i]) - p[i].abs()).into_iter().fold(f64::INFINITY, f64::min)
            }
            Form::Capsule { radius, half } => {
                let z = p[2] - p[2].clamp(-wide(half), wide(half));
                wide(radius) - (p[0].powi(2) + p[1].powi(2) + z * z).sqrt()
            }
            Form::Cylinder { radius, half } => (wide(radius) - p[0].hypot(p[1])).min(wide(half) - p[2].abs()),
            Form::Ellipsoid { half } => {
                1.0 - [0, 1, 2].map(|i| (p[i] / wide(half[i])).powi(2)).iter().sum::<f64>()
            }
            Form::Plane { .. } | Form::Mesh(_) | Form::Cloth(_) => unreachable!("no inside"),
        }
    }

    fn enter(form: Form, o: Lanes3, d: Lanes3) -> Lanes {
        match form {
            Form::Sphere { radius } => enter_sphere(radius, o, d),
            Form::Box { half } => enter_box(half, o, d),
            Form::Capsule { radius, half } => enter_capsule(radius, half, o, d),
            Form::Cylinder { radius, half } => enter_cylinder(radius, half, o, d),
            Form::Ellipsoid { half } => enter_ellipsoid(half, o, d),
            Form::Plane { .. } | Form::Mesh(_) | Form::Cloth(_) => Lanes::MISS,
        }
    }

    const FORMS: [Form; 5] = [
        Form::Sphere { radius: 0.12 },
        Form::Box { half: [0.1, 0.2, 0.05] },
        Form::Capsule { radius: 0.06, half: 0.11 },
        Form::Cylinder { radius: 0.09, half: 0.07 },
        Form::Ellipsoid { half: [0.1, 0.16, 0.07] },
    ];

    #[test]
    fn rays_enter_where_they_first_come_inside_and_normals_are_gradients() {
        let mut numbers = Sequence::new(8, 0);
        for form in FORMS {
            let mut hits = 0;
            for _ in 0..500 {
                let mut random = |size: f32| size * (2.0 * numbers.uniform() as f32 - 1.0);
                let eye = [0, 1, 2].map(|_| random(1.0));
                let mut lanes = [Lanes::ZERO; 3];
                for lane in 0..LANES {
                    let target = [0, 1, 2].map(|_| random(0.15));
                    (0..3).for_each(|i| lanes[i].0[lane] = target[i] - eye[i]);
                }
                if inside(form, eye.map(f64::from)) > 0.0 {
                    continue;
                }
                let t = enter(form, eye.map(Lanes::all), lanes);
                for lane in 0..LANES {
                    let direction = lanes.map(|lanes| f64::from(lanes.0[lane]));
                    let at = |t: f64| [0, 1, 2].map(|i| f64::from(eye[i]) + t * direction[i]);
                    let end = if t.0[lane] < 4.0 { f64::from(t.0[lane]) } else { 4.0 };
                    // Nowhere before. A ray that grazes an edge may come inside by rounding.
                    let before = (1..400).map(|k| inside(form, at((end - 1e-4) * f64::from(k) / 400.0)));
                    assert!(before.fold(f64::NEG_INFINITY, f64::max) < 1e-5, "{form:?}");
                    if t.0[lane] == f32::INFINITY {
                        continue;
                    }
                    hits += 1;
                    let p = at(end);
                    assert!(inside(form, p).abs() < 2e-5, "{form:?}: {}", inside(form, p));
                    let gradient = [0, 1, 2].map(|i| {
                        let moved = |by: f64| {
                            let mut p = p;
                            p[i] += by;
                            inside(form, p)
                        };
                        moved(-1e-6) - moved(1e-6)
                    });
                    let length = gradient.iter().map(|v| v * v).sum::<f64>().sqrt();
                    let normal = form.normal(p.map(|v| v as f32));
                    let cosine: f64 = (0..3).map(|i| gradient[i] / length * f64::from(normal[i])).sum();
                    // At an edge the gradient is that of either side.
                    assert!(cosine > 0.9999 || is_edge(form, p), "{form:?} at {p:?}: {normal:?}");
                }
            }
            assert!(hits > 500, "{form:?}: {hits}");
        }
    }

    fn is_edge(form: Form, p: [f64; 3]) -> bool {
        match form {
            Form::Box { half } => {
                (0..3).filter(|i| (p[*i].abs() - f64::from(half[*i])).abs() < 1e-4).count() > 1
            }
            Form::Cylinder { radius, half } => {
                (p[0].hypot(p[1]) - f64::from(radius)).abs() < 1e-4
                    && (p[2].abs() - f64::from(half)).abs() < 1e-4
            }
            _ => false,
        }
    }

    #[test]
    fn a_ray_along_an_axis_enters_at_the_end() {
        let o = crate::lanes::same([0.02, 0.01, 0.5]);
        let d = crate::lanes::same([0.0, 0.0, -1.0]);
        let cap = 0.11 + (0.06_f32 * 0.06 - 0.0005).sqrt();
        for (form, top) in [(FORMS[1], 0.05), (FORMS[2], cap), (FORMS[3], 0.07)] {
            assert!((enter(form, o, d).0[0] - (0.5 - top)).abs() < 1e-6, "{form:?}");
            // A ray that starts inside does not enter.
            assert_eq!(enter(form, crate::lanes::same([0.02, 0.01, 0.0]), d).0[0], f32::INFINITY);
        }
        let plane = |z: f32| enter_plane([0.1, 0.1], crate::lanes::same([0.02, 0.01, z]), d).0[0];
        assert_eq!((plane(0.5), plane(-0.5)), (0.5, f32::INFINITY));
        let beside = enter_plane([0.1, 0.005], o, d).0[0];
        assert_eq!(beside, f32::INFINITY, "the plane ends before");
    }
}
