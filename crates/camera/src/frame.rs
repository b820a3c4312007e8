//! The first shape at each pixel.

use crate::form::{self, Form};
use crate::lanes::{LANES, Lanes, Lanes3, along, same};
use crate::mesh::Mesh;
use crate::scene::Shape;
use crate::vector::{Pose, scale};
use crate::view::{Rectangle, View};

/// The position of a shape at a pixel without one.
pub(crate) const NONE: u32 = u32::MAX;

/// A shape in the world.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Placed {
    /// The index of the shape in the scene.
    pub shape: u32,
    pub pose: Pose,
    pub form: Form,
    /// Center and half size of the box around the shape, in its frame.
    pub center: [f32; 3],
    pub half: [f32; 3],
    pub is_opaque: bool,
}

impl Placed {
    pub fn new(index: usize, shape: &Shape, body: &Pose, meshes: &Meshes<'_>) -> Placed {
        let is_cloth = matches!(shape.form, Form::Cloth(_));
        let (center, half) = match meshes.of(shape.form) {
            Some(mesh) => {
                let [low, high] = mesh.bounds();
                ([0, 1, 2].map(|i| 0.5 * (low[i] + high[i])), [0, 1, 2].map(|i| 0.5 * (high[i] - low[i])))
            }
            None => ([0.0; 3], shape.form.half()),
        };
        Placed {
            shape: index as u32,
            pose: if is_cloth { Pose::IDENTITY } else { body.of(&shape.pose) },
            form: shape.form,
            center,
            half,
            is_opaque: shape.material.opacity >= 1.0,
        }
    }

    /// Returns where rays in the frame of the shape enter it. They pass triangles before `least`,
    /// m.
    #[inline(always)]
    pub fn enter(&self, meshes: &Meshes<'_>, least: f32, o: Lanes3, d: Lanes3) -> Lanes {
        match self.form {
            Form::Plane { half } => form::enter_plane(half, o, d),
            Form::Sphere { radius } => form::enter_sphere(radius, o, d),
            Form::Box { half } => form::enter_box(half, o, d),
            Form::Capsule { radius, half } => form::enter_capsule(radius, half, o, d),
            Form::Cylinder { radius, half } => form::enter_cylinder(radius, half, o, d),
            Form::Ellipsoid { half } => form::enter_ellipsoid(half, o, d),
            Form::Mesh(_) | Form::Cloth(_) => meshes
                .of(self.form)
                .map_or(Lanes::MISS, |mesh| mesh.enter(o, d, least, Lanes::MISS, &mut [0; LANES])),
        }
    }
}

/// The meshes and cloths of a scene in a state.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Meshes<'a> {
    pub meshes: &'a [std::sync::Arc<Mesh>],
    pub cloths: &'a [Mesh],
}

impl Meshes<'_> {
    /// Returns the triangles of a form, if it is made of them.
    pub fn of(&self, form: Form) -> Option<&Mesh> {
        match form {
            Form::Mesh(index) => Some(&self.meshes[index]),
            Form::Cloth(index) => Some(&self.cloths[index]),
            _ => None,
        }
    }
}

/// The first shape at each pixel, in packets of eight pixels of a row.
#[derive(Debug, Default)]
pub(crate) struct Frame {
    /// Packets of a row.
    pub packets: usize,
    /// Distance along the axis of the camera, m.
    pub depth: Vec<Lanes>,
    /// Position of the shape in the list of placed shapes.
    pub shape: Vec<[u32; LANES]>,
    /// Triangle of a shape made of triangles.
    pub triangle: Vec<[u32; LANES]>,
}

impl Frame {
    /// Finds the first of the shapes that `is_drawn` selects.
    pub fn draw(
        &mut self,
        view: &View,
        placed: &[Placed],
        meshes: &Meshes<'_>,
        is_drawn: impl Fn(&Placed) -> bool,
    ) {
        self.packets = view.width.div_ceil(LANES);
        let count = self.packets * view.height;
        self.depth.clear();
        self.depth.resize(count, Lanes::MISS);
        self.shape.clear();
        self.shape.resize(count, [NONE; LANES]);
        self.triangle.resize(count, [0; LANES]);
        for (position, own) in placed.iter().enumerate().filter(|(_, own)| is_drawn(own)) {
            let Some(bounds) = view.bounds(&own.pose, own.center, own.half) else { continue };
            let position = position as u32;
            match own.form {
                Form::Plane { half } => {
                    self.draw_one(view, own, bounds, position, |o, d| form::enter_plane(half, o, d));
                }
                Form::Sphere { radius } => {
                    self.draw_one(view, own, bounds, position, |o, d| form::enter_sphere(radius, o, d));
                }
                Form::Box { half } => {
                    self.draw_one(view, own, bounds, position, |o, d| form::enter_box(half, o, d));
                }
                Form::Capsule { radius, half } => {
                    self.draw_one(view, own, bounds, position, |o, d| {
                        form::enter_capsule(radius, half, o, d)
                    });
                }
                Form::Cylinder { radius, half } => {
                    self.draw_one(view, own, bounds, position, |o, d| {
                        form::enter_cylinder(radius, half, o, d)
                    });
                }
                Form::Ellipsoid { half } => {
                    self.draw_one(view, own, bounds, position, |o, d| form::enter_ellipsoid(half, o, d));
                }
                Form::Mesh(_) | Form::Cloth(_) => {
                    if let Some(mesh) = meshes.of(own.form) {
                        self.draw_mesh(view, own, bounds, position, mesh);
                    }
                }
            }
        }
    }

    #[inline(always)]
    fn draw_one(
        &mut self,
        view: &View,
        own: &Placed,
        bounds: Rectangle,
        position: u32,
        enter: impl Fn(Lanes3, Lanes3) -> Lanes,
    ) {
        let rays = LocalRays::new(view, &own.pose);
        for row in bounds.rows[0]..=bounds.rows[1] {
            let start = rays.row(view.v(row));
            for packet in bounds.columns[0] / LANES..=bounds.columns[1] / LANES {
                let t = enter(rays.origin, along(start, view.u(packet), rays.right));
                let index = row * self.packets + packet;
                let depth = &mut self.depth[index];
                let shape = &mut self.shape[index];
                for i in 0..LANES {
                    shape[i] = if t.0[i] < depth.0[i] { position } else { shape[i] };
                }
                *depth = t.min(*depth);
            }
        }
    }

    fn draw_mesh(&mut self, view: &View, own: &Placed, bounds: Rectangle, position: u32, mesh: &Mesh) {
        let rays = LocalRays::new(view, &own.pose);
        for row in bounds.rows[0]..=bounds.rows[1] {
            let start = rays.row(view.v(row));
            for packet in bounds.columns[0] / LANES..=bounds.columns[1] / LANES {
                let index = row * self.packets + packet;
                let depth = &mut self.depth[index];
                let shape = &mut self.shape[index];
                let d = along(start, view.u(packet), rays.right);
                let t = mesh.enter(rays.origin, d, 0.0, *depth, &mut self.triangle[index]);
                for i in 0..LANES {
                    shape[i] = if t.0[i] < depth.0[i] { position } else { shape[i] };
                }
                *depth = t;
            }
        }
    }
}

/// The rays of a view in the frame of a shape.
pub(crate) struct LocalRays {
    pub origin: Lanes3,
    pub right: Lanes3,
    up: [f32; 3],
    forward: [f32; 3],
}

impl LocalRays {
    pub fn new(view: &View, pose: &Pose) -> LocalRays {
        LocalRays {
            origin: same(pose.local_point(view.eye)),
            right: same(pose.local_direction(view.right)),
            up: pose.local_direction(view.up),
            forward: pose.local_direction(view.forward),
        }
    }

    /// Returns the direction of the ray with slopes 0 to the right and `v` upwards.
    #[inline(always)]
    pub fn row(&self, v: f32) -> Lanes3 {
        same(crate::vector::add(self.forward, scale(self.up, v)))
    }
}
