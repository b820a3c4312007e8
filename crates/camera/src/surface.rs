//! Points, normals and colors of what is visible.

use crate::frame::{Frame, Meshes, NONE, Placed};
use crate::lanes::{LANES, Lanes, Lanes3};
use crate::material::{Color, Material};
use crate::scene::{Background, Scene};
use crate::shadow::Shadows;
use crate::vector::{add, dot, scale, unit};
use crate::view::View;

/// The visible point of each pixel and its normal; a pixel without a shape has normal 0.
#[derive(Debug, Default)]
pub(crate) struct Surface {
    pub point: Vec<Lanes3>,
    pub normal: Vec<Lanes3>,
}

impl Surface {
    /// Computes points and normals.
    pub fn find(&mut self, view: &View, placed: &[Placed], meshes: &Meshes<'_>, frame: &Frame) {
        let count = frame.depth.len();
        self.point.resize(count, [Lanes::ZERO; 3]);
        self.normal.resize(count, [Lanes::ZERO; 3]);
        for row in 0..view.height {
            let v = view.v(row);
            for packet in 0..frame.packets {
                let index = row * frame.packets + packet;
                let u = view.u(packet);
                let point = &mut self.point[index];
                let normal = &mut self.normal[index];
                for lane in 0..LANES {
                    let shape = frame.shape[index][lane];
                    let (p, n) = if shape == NONE {
                        ([0.0; 3], [0.0; 3])
                    } else {
                        let direction = view.direction(u.0[lane], v);
                        let p = add(view.eye, scale(direction, frame.depth[index].0[lane]));
                        let triangle = frame.triangle[index][lane];
                        (p, normal_at(&placed[shape as usize], meshes, triangle, p, direction))
                    };
                    for i in 0..3 {
                        (point[i].0[lane], normal[i].0[lane]) = (p[i], n[i]);
                    }
                }
            }
        }
    }
}

/// Returns the normal of a shape at a point of its surface that a ray with this direction sees.
pub(crate) fn normal_at(
    own: &Placed,
    meshes: &Meshes<'_>,
    triangle: u32,
    p: [f32; 3],
    direction: [f32; 3],
) -> [f32; 3] {
    let at = own.pose.local_point(p);
    match meshes.of(own.form) {
        Some(mesh) => {
            let normal = own.pose.direction(mesh.normal(triangle, at));
            // Both sides of a triangle are visible.
            if dot(normal, direction) > 0.0 { scale(normal, -1.0) } else { normal }
        }
        None => own.pose.direction(own.form.normal(at)),
    }
}

/// The light of lamps on a surface, prepared for one image.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Light {
    direction: [f32; 3],
    color: Color,
}

impl Light {
    /// Returns the light of a lamp.
    pub fn new(direction: [f32; 3], color: Color, strength: f32) -> Light {
        Light { direction: unit(direction), color: scale(color, strength) }
    }

    /// Adds the light of this lamp that a point reflects to the eye: of the color of the material,
    /// and of that of the lamp.
    fn add_to(
        &self,
        material: &Material,
        normal: [f32; 3],
        to_eye: [f32; 3],
        lit: f32,
        sums: &mut [Color; 2],
    ) {
        let cosine = dot(normal, self.direction) * lit;
        if cosine <= 0.0 {
            return;
        }
        sums[0] = add(sums[0], scale(self.color, cosine));
        if material.specular > 0.0 {
            let half = unit(add(self.direction, to_eye));
            let highlight = material.specular * power(dot(normal, half).max(0.0), material.exponent) * lit;
            sums[1] = add(sums[1], scale(self.color, highlight));
        }
    }
}

/// Returns the color of a point that a ray with this direction sees. `lit` is the share of each
/// lamp that reaches it.
pub(crate) fn shade(
    scene: &Scene,
    lights: &[Light],
    own: &Placed,
    p: [f32; 3],
    normal: [f32; 3],
    direction: [f32; 3],
    lit: impl Fn(usize) -> f32,
) -> Color {
    let material = &scene.shapes[own.shape as usize].material;
    let color = material.color(own.pose.local_point(p));
    let to_eye = scale(direction, -1.0 / dot(direction, direction).sqrt());
    let up = 0.5 + 0.5 * normal[2];
    let ambient = &scene.ambient;
    let diffuse =
        [0, 1, 2].map(|i| ambient.below[i] + up * (ambient.above[i] - ambient.below[i]) + material.emission);
    let mut sums = [diffuse, [0.0; 3]];
    for (index, light) in lights.iter().enumerate() {
        light.add_to(material, normal, to_eye, lit(index), &mut sums);
    }
    [0, 1, 2].map(|i| color[i] * sums[0][i] + sums[1][i])
}

/// Computes the color of each pixel: that of its first opaque shape, or of the background.
#[allow(clippy::too_many_arguments)]
pub(crate) fn shade_all(
    scene: &Scene,
    lights: &[Light],
    view: &View,
    placed: &[Placed],
    frame: &Frame,
    surface: &Surface,
    shadows: &[Shadows],
    colors: &mut [Lanes3],
) {
    for row in 0..view.height {
        let v = view.v(row);
        for packet in 0..frame.packets {
            let index = row * frame.packets + packet;
            let u = view.u(packet);
            for lane in 0..LANES {
                let direction = view.direction(u.0[lane], v);
                let shape = frame.shape[index][lane];
                let color = if shape == NONE {
                    sky(&scene.background, direction)
                } else {
                    let at = |v: &Lanes3| [v[0].0[lane], v[1].0[lane], v[2].0[lane]];
                    let p = at(&surface.point[index]);
                    let normal = at(&surface.normal[index]);
                    let lit = |lamp: usize| shadows[lamp].lit[index].0[lane];
                    shade(scene, lights, &placed[shape as usize], p, normal, direction, lit)
                };
                for i in 0..3 {
                    colors[index][i].0[lane] = color[i];
                }
            }
        }
    }
}

/// Draws a shape that is not opaque over the colors behind it. No shadow falls on it.
#[allow(clippy::too_many_arguments)]
pub(crate) fn shade_over(
    scene: &Scene,
    lights: &[Light],
    view: &View,
    own: &Placed,
    meshes: &Meshes<'_>,
    frame: &Frame,
    colors: &mut [Lanes3],
) {
    let Some(bounds) = view.bounds(&own.pose, own.center, own.half) else { return };
    let opacity = scene.shapes[own.shape as usize].material.opacity;
    let rays = crate::frame::LocalRays::new(view, &own.pose);
    for row in bounds.rows[0]..=bounds.rows[1] {
        let v = view.v(row);
        let start = rays.row(view.v(row));
        for packet in bounds.columns[0] / LANES..=bounds.columns[1] / LANES {
            let index = row * frame.packets + packet;
            let u = view.u(packet);
            let d = crate::lanes::along(start, u, rays.right);
            let mut triangle = [0; LANES];
            let t = match meshes.of(own.form) {
                Some(mesh) => mesh.enter(rays.origin, d, 0.0, Lanes::MISS, &mut triangle),
                None => own.enter(meshes, 0.0, rays.origin, d),
            };
            for lane in 0..LANES {
                if t.0[lane] >= frame.depth[index].0[lane] {
                    continue;
                }
                let direction = view.direction(u.0[lane], v);
                let p = add(view.eye, scale(direction, t.0[lane]));
                let normal = normal_at(own, meshes, triangle[lane], p, direction);
                let color = shade(scene, lights, own, p, normal, direction, |_| 1.0);
                for i in 0..3 {
                    let behind = &mut colors[index][i].0[lane];
                    *behind = *behind + opacity * (color[i] - *behind);
                }
            }
        }
    }
}

/// Returns the color of the background in a direction.
fn sky(background: &Background, direction: [f32; 3]) -> Color {
    let up = (direction[2] / dot(direction, direction).sqrt()).max(0.0);
    let a = background.horizon;
    let b = background.above;
    [0, 1, 2].map(|i| a[i] + up * (b[i] - a[i]))
}

/// Returns a whole power.
fn power(mut base: f32, mut exponent: u32) -> f32 {
    let mut out = 1.0;
    while exponent > 0 {
        if exponent & 1 == 1 {
            out *= base;
        }
        base *= base;
        exponent >>= 1;
    }
    out
}
