//! Scenes, cameras and poses of a model.

use std::sync::Arc;

use mishandle_world::{CameraMount, Geom, GeomKind, Model, Surface, World};

use crate::camera::{Camera, CameraError, Effects, Optics, Size};
use crate::form::Form;
use crate::material::Material;
use crate::mesh::Mesh;
use crate::scene::{Ambient, Background, Lamp, NO_SHAPE, Poses, Scene, Shape};
use crate::vector::Pose;

/// MuJoCo's exponent of the sharpest highlights.
const EXPONENT: f32 = 128.0;

/// Part of MuJoCo's highlights that the nominal lamp has.
const HIGHLIGHT: f32 = 0.2;

impl Scene {
    /// Makes the scene of a model under nominal light: the shapes that pictures show, in plain
    /// colors. Textures are not drawn.
    ///
    /// # Errors
    /// If the model has too many shapes.
    pub fn of_model(model: &Model) -> Result<Scene, CameraError> {
        let mut scene = Scene {
            shapes: Vec::new(),
            meshes: Vec::new(),
            cloths: Vec::new(),
            lamps: vec![Lamp::NOMINAL, Lamp::SECOND],
            ambient: Ambient::NOMINAL,
            background: Background::NOMINAL,
        };
        // The shape of the model that each mesh of the scene has.
        let mut known: Vec<GeomKind> = Vec::new();
        for (index, geom) in model.geoms().iter().enumerate().filter(|(_, geom)| geom.is_drawn) {
            let form = match geom.kind {
                GeomKind::Mesh(index) | GeomKind::HeightField(index) => {
                    let place = known.iter().position(|kind| *kind == geom.kind);
                    Some(Form::Mesh(place.unwrap_or_else(|| {
                        let (vertices, triangles) = match geom.kind {
                            GeomKind::HeightField(_) => model.height_field(index),
                            _ => model.mesh(index),
                        };
                        scene.meshes.push(Arc::new(Mesh::new(vertices, triangles)));
                        known.push(geom.kind);
                        known.len() - 1
                    })))
                }
                _ => Form::of_geom(geom),
            };
            scene.shapes.extend(form.map(|form| Shape { geom: Some(index), ..Shape::of_geom(geom, form) }));
        }
        for surface in model.surfaces() {
            let vertices = surface.vertices.iter().map(|(_, local)| local.map(|v| v as f32)).collect();
            scene.cloths.push(Arc::new(Mesh::smooth(vertices, surface.triangles)));
            let [red, green, blue, opacity] = surface.color;
            scene.shapes.push(Shape {
                body: surface.vertices.first().map_or(0, |(body, _)| body.index()),
                pose: Pose::IDENTITY,
                form: Form::Cloth(scene.cloths.len() - 1),
                material: Material { opacity, ..Material::plain([red, green, blue]) },
                geom: None,
            });
        }
        scene.reflect();
        if scene.shapes.len() < usize::from(NO_SHAPE) {
            Ok(scene)
        } else {
            Err(CameraError::Shapes(scene.shapes.len()))
        }
    }
}

impl Form {
    /// Returns the form of a geom without a mesh, if cameras draw it.
    pub fn of_geom(geom: &Geom) -> Option<Form> {
        let [a, b, c] = geom.size.map(|v| v as f32);
        match geom.kind {
            // A plane has no end in contacts, whatever size it has for MuJoCo's pictures.
            GeomKind::Plane => Some(Form::Plane { half: [f32::INFINITY; 2] }),
            GeomKind::Sphere => Some(Form::Sphere { radius: a }),
            GeomKind::Capsule => Some(Form::Capsule { radius: a, half: b }),
            GeomKind::Ellipsoid => Some(Form::Ellipsoid { half: [a, b, c] }),
            GeomKind::Cylinder => Some(Form::Cylinder { radius: a, half: b }),
            GeomKind::Box => Some(Form::Box { half: [a, b, c] }),
            GeomKind::Mesh(_) | GeomKind::HeightField(_) | GeomKind::Other => None,
        }
    }
}

impl Shape {
    /// Returns a shape of this form in place and color of a geom or a site.
    pub fn of_geom(geom: &Geom, form: Form) -> Shape {
        let [red, green, blue, opacity] = geom.color;
        let material = Material {
            opacity,
            specular: HIGHLIGHT * geom.specular,
            exponent: (EXPONENT * geom.shininess) as u32,
            emission: geom.emission,
            ..Material::plain([red, green, blue])
        };
        let pose = Pose::new(geom.position, geom.quaternion);
        Shape { body: geom.body.index(), pose, form, material, geom: None }
    }
}

/// Returns the focal length, image heights, of a vertical field of view.
pub fn focal_length(fovy_deg: f64) -> f32 {
    // This is computed once, from a model's degrees, and never from the number of an axis.
    (0.5 / (0.5 * fovy_deg).to_radians().tan()) as f32
}

impl Camera {
    /// Makes a nominal camera where a model has one.
    pub fn of_model(mount: &CameraMount, size: Size) -> Camera {
        Camera {
            size,
            body: mount.body.index(),
            pose: Pose::new(mount.position, mount.quaternion),
            tilt: [0.0; 3],
            focal_length: focal_length(mount.fovy_deg),
            optics: Optics::NOMINAL,
            effects: Effects::NOMINAL,
        }
    }
}

/// Reads poses of states.
#[derive(Debug)]
pub struct PoseReader {
    world: World,
    surfaces: Vec<Surface>,
}

impl PoseReader {
    /// Makes a reader of states of a model.
    pub fn new(model: &Model) -> PoseReader {
        PoseReader { world: model.world(), surfaces: model.surfaces() }
    }

    /// Sets the poses to those of a state: a row of an environment, of which MuJoCo's state is the
    /// first part.
    ///
    /// # Panics
    /// If the state is shorter than [`Model::state_size`].
    pub fn read(&mut self, state: &[f64], poses: &mut Poses) {
        self.world.set_state(state);
        self.world.refresh();
        poses.of_world(&self.world, &self.surfaces);
    }
}

impl Poses {
    fn of_world(&mut self, world: &World, surfaces: &[Surface]) {
        let model = world.model();
        let rows = world.rows();
        self.bodies.clear();
        for index in 0..model.count(mishandle_world::ElementKind::Body) {
            let body = model.body_at(index);
            self.bodies.push(Pose::new(rows.position(body), rows.quaternion(body)));
        }
        self.cloths.resize(surfaces.len(), Vec::new());
        for (cloth, surface) in self.cloths.iter_mut().zip(surfaces) {
            cloth.clear();
            let vertices = 0..surface.vertices.len();
            cloth.extend(vertices.map(|vertex| surface.vertex(world, vertex).map(|v| v as f32)));
        }
    }
}
