//! Scenes and cameras as rows of numbers, for kernels of other devices.
//!
//! The numbers are prepared as the renderer of this crate uses them, so that a kernel repeats its
//! arithmetic and no other. `python/mishandle/gpu/cameras/kernels.py` has such kernels, and the
//! names of the columns.

use mishandle_world::Model;

use crate::camera::{Camera, CameraError};
use crate::compression::{BRIGHTNESS, COLOR, COSINES, SIDE};
use crate::develop::blur_passes;
use crate::form::Form;
use crate::pattern::{disk_points, pixel_point};
use crate::scene::{Lamp, Scene, Shape};
use crate::vector::{Pose, add, beside, scale, unit};
use crate::view::View;

/// The most rays per pixel and the most shadow rays.
pub const MAX_RAYS: usize = 8;

/// The numbers of a scene and its cameras, row after row.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SightRow {
    /// A row for each shape; a row of zeros draws nothing.
    pub shapes: Vec<f32>,
    /// A row for each lamp.
    pub lamps: Vec<f32>,
    /// Ambient light and background.
    pub sky: Vec<f32>,
    /// A row for each camera.
    pub cameras: Vec<f32>,
}

impl SightRow {
    /// Numbers of a shape: kind, body, size, pose, pattern, two colors, scale, seed, opacity,
    /// specular, exponent, emission.
    pub const SHAPE: usize = 30;
    /// Numbers of a lamp: direction, color, shadow rays, whether it casts shadows, directions of
    /// shadow rays.
    pub const LAMP: usize = 8 + 3 * MAX_RAYS;
    /// Numbers of ambient light and background.
    pub const SKY: usize = 12;
    /// Numbers of a camera: body, pose, step, rays, shutter, vignette, patch with its color, passes
    /// and weight of the blur, factors of colors, squares of noises, dead rows, compression; then
    /// place on the lens, slopes of the first pixel and time ago of each ray.
    pub const CAMERA: usize = 34 + 5 * MAX_RAYS;

    /// Makes the row of a scene with `shapes` rows of shapes.
    ///
    /// # Errors
    /// If the scene has a mesh, or rays exceed [`MAX_RAYS`].
    ///
    /// # Panics
    /// If the scene has more shapes.
    pub fn new(scene: &Scene, cameras: &[&Camera], shapes: usize) -> Result<SightRow, CameraError> {
        let mut row = SightRow::default();
        for shape in &scene.shapes {
            row.add_shape(shape, scene)?;
        }
        assert!(scene.shapes.len() <= shapes, "a row for each shape");
        row.shapes.resize(shapes * SightRow::SHAPE, 0.0);
        for lamp in &scene.lamps {
            row.add_lamp(lamp)?;
        }
        let ambient = &scene.ambient;
        let background = &scene.background;
        let colors = [ambient.above, ambient.below, background.above, background.horizon];
        row.sky.extend(colors.as_flattened());
        for camera in cameras {
            row.add_camera(camera)?;
        }
        Ok(row)
    }

    fn add_shape(&mut self, shape: &Shape, scene: &Scene) -> Result<(), CameraError> {
        let material = &shape.material;
        let (kind, size) = match shape.form {
            _ if material.opacity <= 0.0 => (0.0, [0.0; 3]),
            Form::Plane { half: [x, y] } => (1.0, [x, y, 0.0]),
            Form::Sphere { radius } => (2.0, [radius, 0.0, 0.0]),
            Form::Box { half } => (3.0, half),
            Form::Capsule { radius, half } => (4.0, [radius, half, 0.0]),
            Form::Cylinder { radius, half } => (5.0, [radius, half, 0.0]),
            Form::Ellipsoid { half } => (6.0, half),
            Form::Cloth(index) => {
                let nodes = |cloth: &std::sync::Arc<crate::Mesh>| cloth.preorder().len();
                let first: usize = scene.cloths[..index].iter().map(nodes).sum();
                (7.0, [first as f32, (first + nodes(&scene.cloths[index])) as f32, 0.0])
            }
            Form::Mesh(_) => return Err(CameraError::OtherDevice("meshes")),
        };
        self.shapes.extend([kind, shape.body as f32]);
        self.shapes.extend(size);
        let is_cloth = matches!(shape.form, Form::Cloth(_));
        self.shapes.extend((if is_cloth { Pose::IDENTITY } else { shape.pose }).numbers());
        self.shapes.push(f32::from(material.pattern as u8));
        self.shapes.extend(material.colors.as_flattened());
        let rest = [
            material.scale,
            material.seed as f32,
            material.opacity,
            material.specular,
            material.exponent as f32,
            material.emission,
        ];
        self.shapes.extend(rest);
        Ok(())
    }

    fn add_lamp(&mut self, lamp: &Lamp) -> Result<(), CameraError> {
        let direction = unit(lamp.direction);
        let is_hard = lamp.radius <= 0.0 || !lamp.casts_shadows;
        let mut points = Vec::new();
        disk_points(if is_hard { 1 } else { lamp.shadow_rays }, &mut points);
        if points.len() > MAX_RAYS {
            return Err(CameraError::OtherDevice("more than 8 shadow rays"));
        }
        self.lamps.extend(direction);
        self.lamps.extend(scale(lamp.color, lamp.strength));
        let rays = if lamp.strength > 0.0 { points.len() } else { 0 };
        self.lamps.extend([rays as f32, f32::from(u8::from(lamp.casts_shadows))]);
        let [a, b] = beside(direction);
        points.resize(MAX_RAYS, [0.0; 2]);
        for point in points {
            let [x, y] = point.map(|v| v * lamp.radius);
            let from = unit(add(direction, add(scale(a, x), scale(b, y))));
            self.lamps.extend(if is_hard { direction } else { from });
        }
        Ok(())
    }

    fn add_camera(&mut self, camera: &Camera) -> Result<(), CameraError> {
        let optics = &camera.optics;
        let effects = &camera.effects;
        let size = camera.size;
        let samples = optics.samples.max(1);
        if samples as usize > MAX_RAYS {
            return Err(CameraError::OtherDevice("more than 8 rays per pixel"));
        }
        let view = |pixel, lens| View::new(camera, &Pose::IDENTITY, pixel, lens);
        self.cameras.push(camera.body as f32);
        self.cameras.extend(camera.pose.tilted(camera.tilt).numbers());
        self.cameras.extend([
            view([0.0; 2], [0.0; 2]).step,
            samples as f32,
            optics.shutter,
            effects.vignette,
        ]);
        let [columns, rows] = effects.patch.pixels(size);
        self.cameras.extend([columns.start, columns.end, rows.start, rows.end].map(|v| v as f32));
        self.cameras.extend(effects.patch.color);
        let (passes, weight) = blur_passes(effects.blur);
        self.cameras.extend([passes as f32, weight]);
        self.cameras.extend(effects.factors());
        self.cameras.extend([effects.read_noise, effects.shot_noise].map(|noise| noise * noise));
        let rows = effects.dead_rows.rows(size);
        self.cameras.extend([rows.start as f32, rows.end as f32, effects.compression]);
        let mut lens = Vec::new();
        disk_points(samples, &mut lens);
        lens.resize(MAX_RAYS, [0.0; 2]);
        for (sample, lens) in (0..).zip(lens) {
            let lens = lens.map(|v| v * optics.aperture);
            self.cameras.extend(lens);
            self.cameras.extend(view(pixel_point(sample, samples), lens).first);
            self.cameras.push(optics.shutter * (sample as f32 + 0.5) / samples as f32);
        }
        Ok(())
    }
}

impl Pose {
    /// Returns the position and the axes.
    pub fn numbers(&self) -> impl Iterator<Item = f32> + use<> {
        self.position.into_iter().chain(self.axes.into_iter().flatten())
    }
}

/// The triangles of the cloths of a scene, one cloth after the other.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ClothRows {
    /// The vertices of each triangle.
    pub triangles: Vec<[u32; 3]>,
    /// The nodes of the hierarchy, each before its children: its first triangle and the one after
    /// its last, the node after its descendants, and 1 for a leaf.
    pub nodes: Vec<[u32; 4]>,
    /// The body that each vertex moves with.
    pub bodies: Vec<u32>,
    /// The place of each vertex in the frame of its body, m.
    pub places: Vec<[f32; 3]>,
}

impl ClothRows {
    /// Makes the rows of a scene of a model.
    pub fn new(scene: &Scene, model: &Model) -> ClothRows {
        let mut rows = ClothRows::default();
        for (cloth, surface) in scene.cloths.iter().zip(model.surfaces()) {
            let [vertex, triangle, node] =
                [rows.places.len(), rows.triangles.len(), rows.nodes.len()].map(|count| count as u32);
            rows.triangles.extend(cloth.triangles().iter().map(|corners| corners.map(|own| own + vertex)));
            let moved =
                |[first, end, after, leaf]: [u32; 4]| [first + triangle, end + triangle, after + node, leaf];
            rows.nodes.extend(cloth.preorder().into_iter().map(moved));
            for (body, place) in surface.vertices {
                rows.bodies.push(body.index() as u32);
                rows.places.push(place.map(|v| v as f32));
            }
        }
        rows
    }
}

/// Returns the tables of the compression: cosines of coefficients, then steps of brightness and of
/// color.
pub fn compression_tables() -> [[[f32; SIDE]; SIDE]; 3] {
    let steps = |table: [[u8; SIDE]; SIDE]| table.map(|row| row.map(f32::from));
    [COSINES, steps(BRIGHTNESS), steps(COLOR)]
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::{Ambient, Background, Color, Material, Mesh, Size};

    const WHITE: Color = [1.0; 3];

    fn scene(form: Form) -> Scene {
        let vertices = || vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let shape =
            Shape { body: 2, pose: Pose::IDENTITY, form, material: Material::plain(WHITE), geom: None };
        Scene {
            shapes: vec![shape],
            meshes: vec![Arc::new(Mesh::new(vertices(), vec![[0, 1, 2]]))],
            cloths: vec![Arc::new(Mesh::smooth(vertices(), vec![[0, 1, 2], [0, 2, 1]]))],
            lamps: vec![Lamp::NOMINAL, Lamp::SECOND],
            ambient: Ambient::NOMINAL,
            background: Background::NOMINAL,
        }
    }

    #[test]
    fn rows_have_the_stated_lengths_and_meshes_have_none() {
        let size = Size::new(8, 8).unwrap();
        let camera = Camera::looking(size, 0, [[0.0, 0.0, 1.0], [0.0; 3], [0.0, 1.0, 0.0]], 1.0);
        let row = |form| SightRow::new(&scene(form), &[&camera, &camera], 4);
        let found = row(Form::Cloth(0)).unwrap();
        assert_eq!(found.shapes.len(), 4 * SightRow::SHAPE);
        assert_eq!(found.lamps.len(), 2 * SightRow::LAMP);
        assert_eq!(found.sky.len(), SightRow::SKY);
        assert_eq!(found.cameras.len(), 2 * SightRow::CAMERA);
        // The cloth has one node, and its frame is that of the world.
        assert_eq!(found.shapes[..5], [7.0, 2.0, 0.0, 1.0, 0.0]);
        assert_eq!(row(Form::Mesh(0)), Err(CameraError::OtherDevice("meshes")));
    }

    #[test]
    fn rows_of_a_lamp_with_too_many_rays_are_an_error() {
        let mut scene = scene(Form::Sphere { radius: 0.1 });
        scene.lamps[0] = Lamp { radius: 0.1, shadow_rays: 9, ..Lamp::NOMINAL };
        let error = SightRow::new(&scene, &[], 1).unwrap_err();
        assert_eq!(error.to_string(), "a GPU does not draw more than 8 shadow rays");
    }

    #[test]
    fn triangles_below_each_node_are_a_range() {
        let vertices: Vec<[f32; 3]> = (0..30).map(|i| [i as f32, (i % 3) as f32, (i % 7) as f32]).collect();
        let triangles: Vec<[u32; 3]> = (0..28).map(|i| [i, i + 1, i + 2]).collect();
        let mesh = Mesh::new(vertices, triangles);
        let nodes = mesh.preorder();
        assert_eq!(nodes[0], [0, 28, nodes.len() as u32, 0]);
        let leaves: Vec<_> = nodes.iter().filter(|node| node[3] == 1).collect();
        // Leaves come in the order of their triangles and leave none out.
        assert!(leaves.windows(2).all(|pair| pair[0][1] == pair[1][0]));
        assert_eq!((leaves[0][0], leaves[leaves.len() - 1][1]), (0, 28));
        assert!(nodes.iter().zip(1..).all(|(node, next)| node[2] >= next));
    }
}
