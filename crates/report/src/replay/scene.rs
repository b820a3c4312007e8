//! Shapes, meshes and camera of a scene, and where its bodies are in states.

use mishandle::MishandleError;
use mishandle::world::frame::{norm, sub};
use mishandle::world::{
    Body, CAMERAS, ElementKind, Geom, GeomKind, JointKind, Model, PictureModel, Size, Stage, Surface, World,
};
use serde_json::{Value, json};

use super::pack::Columns;
use super::simplify::{Mesh, simplified};

/// Grid of positions, m: half of it is the largest error.
pub const GRID: f64 = 0.000_05;

/// Grid of the numbers of quaternions, and of forces, N.
const TURN: f64 = 1.0 / 32767.0;
const FORCE: f64 = 0.01;

/// Largest number of triangles of a mesh, and of contacts at a sample, the strongest first.
const TRIANGLES: usize = 4000;
const CONTACTS: usize = 24;

/// Least force that is drawn, N.
const LEAST_FORCE: f64 = 0.2;

/// Largest number of objects with a path.
const OBJECTS: usize = 2;

/// Shapes farther from the robot than this, or larger, do not count for the size of the scene, m.
const FAR: f64 = 2.5;

/// A scene, and its model in the state that was read last.
pub struct SceneReader {
    world: World,
    stage: Stage,
    surfaces: Vec<Surface>,
    /// The bodies that the page knows: those with a shape.
    bodies: Vec<Body>,
    shapes: Vec<Geom>,
    /// Parts that bodies have, if the model does not say it.
    given: Option<Roles>,
}

/// Parts that bodies have in a scene.
#[derive(Clone)]
pub struct Roles {
    /// The base of the robot.
    pub root: Body,
    /// Whether the base moves about, so that the camera moves along.
    pub is_mobile: bool,
    /// Bodies with a path, the tool or the base first.
    pub traced: Vec<Body>,
}

impl SceneReader {
    /// Makes the reader of a scene.
    ///
    /// # Errors
    /// If MuJoCo rejects the document.
    pub fn new(picture: &PictureModel) -> Result<SceneReader, MishandleError> {
        let model = picture.compile()?;
        let size = Size::new(640, 480).unwrap_or_else(|| unreachable!("the sides are even"));
        let mut stage = Stage::new(&model, picture, size, CAMERAS[0])?;
        stage.mark_contacts();
        let sites = model.sites().into_iter();
        let drawn = |geom: &Geom| geom.is_drawn && geom.kind != GeomKind::Other;
        let shapes: Vec<Geom> =
            model.geoms().into_iter().chain(sites).filter(drawn).chain(stage.ground()).collect();
        let mut bodies: Vec<Body> = shapes.iter().map(|geom| geom.body).collect();
        bodies.push(model.body_at(0));
        bodies.push(model.followed_body());
        bodies.sort_unstable_by_key(|body| body.index());
        bodies.dedup();
        Ok(SceneReader {
            world: model.world(),
            stage,
            surfaces: model.surfaces(),
            bodies,
            shapes,
            given: None,
        })
    }

    /// Makes the reader of a scene whose bodies have these parts.
    ///
    /// # Errors
    /// If MuJoCo rejects the document.
    pub fn with_roles(picture: &PictureModel, roles: Roles) -> Result<SceneReader, MishandleError> {
        let mut reader = SceneReader::new(picture)?;
        let needed = roles.traced.iter().chain([&roles.root]).copied();
        reader.bodies.extend(needed);
        reader.bodies.sort_unstable_by_key(|body| body.index());
        reader.bodies.dedup();
        Ok(SceneReader { given: Some(roles), ..reader })
    }

    /// Returns the parts that bodies have: those given, or what joints and motors say.
    fn roles(&self) -> Roles {
        if let Some(roles) = &self.given {
            return roles.clone();
        }
        let model = self.model();
        let robot = model.robot_bodies();
        let root = robot.first().copied().unwrap_or_else(|| model.body_at(0));
        let free = |body: Body| {
            (0..model.joint_count())
                .any(|joint| model.joint_kind(joint) == JointKind::Free && model.body_of_joint(joint) == body)
        };
        let objects = self.bodies.iter().filter(|body| free(**body) && !robot.contains(body));
        let traced = std::iter::once(model.followed_body()).chain(objects.take(OBJECTS).copied());
        Roles { root, is_mobile: free(root), traced: traced.collect() }
    }

    fn model(&self) -> &Model {
        self.world.model()
    }

    fn place(&self, body: Body) -> usize {
        self.bodies.iter().position(|known| *known == body).unwrap_or(0)
    }

    /// Returns head and bytes of the scene, framed as its pictures are.
    pub fn data(&mut self, states: &[&[f64]]) -> (Value, Vec<u8>) {
        self.stage.frame(states.iter().copied());
        let Some(first) = states.first() else { return (json!({}), Vec::new()) };
        self.stage.show(first);
        self.world.set_state(first);
        self.world.refresh();
        let (center, reach) = self.extent();
        let view = self.stage.viewpoint();
        let model = self.model().clone();
        let names = model.names(ElementKind::Body);
        let name = |body: &Body| match names[body.index()].as_str() {
            "" => format!("body {}", body.index()),
            name => name.to_string(),
        };
        let mut floats: Vec<u8> = Vec::new();
        let mut indices: Vec<u8> = Vec::new();
        let mut meshes = Vec::new();
        let mut known: Vec<GeomKind> = Vec::new();
        let mut shapes = Vec::new();
        for geom in &self.shapes {
            let mesh = match geom.kind {
                GeomKind::Mesh(index) => Some(model.mesh(index)),
                GeomKind::HeightField(index) => Some(model.height_field(index)),
                _ => None,
            };
            let mesh = mesh.map(|mesh| {
                known.iter().position(|other| *other == geom.kind).unwrap_or_else(|| {
                    known.push(geom.kind);
                    meshes.push(appended(simplified(mesh, TRIANGLES), &mut floats, &mut indices));
                    known.len() - 1
                })
            });
            shapes.push(json!({
                "body": self.place(geom.body),
                "kind": kind(geom.kind),
                "size": geom.size,
                "position": geom.position,
                "quaternion": geom.quaternion,
                "color": geom.color,
                "mesh": mesh,
            }));
        }
        let flexes = model.names(ElementKind::Flex);
        let mut cloths = Vec::new();
        for (index, surface) in self.surfaces.iter().enumerate() {
            let triangles = [indices.len() / 4, 3 * surface.triangles.len()];
            indices.extend(surface.triangles.as_flattened().iter().flat_map(|corner| corner.to_le_bytes()));
            cloths.push(json!({
                "name": flexes.get(index).filter(|name| !name.is_empty()).map_or("cloth", String::as_str),
                "triangles": triangles,
                "vertices": surface.vertices.len(),
                "color": surface.color,
            }));
        }
        let Roles { root, is_mobile, traced } = self.roles();
        let head = json!({
            "grid": GRID,
            "bodies": self.bodies.iter().map(name).collect::<Vec<_>>(),
            "shapes": shapes,
            "meshes": meshes,
            "cloths": cloths,
            "floats": floats.len(),
            "view": { "eye": view.position, "axes": view.axes, "fovy": view.fovy_deg.to_radians() },
            "center": center,
            "reach": reach,
            "traced": traced.iter().map(|body| self.place(*body)).collect::<Vec<_>>(),
            "root": self.place(root),
            "isMobile": is_mobile,
        });
        floats.extend(indices);
        (head, floats)
    }

    /// Returns the center of what is near the robot, and how far it reaches from there, m.
    fn extent(&self) -> ([f64; 3], f64) {
        let rows = self.world.rows();
        let robot = self.model().robot_bodies();
        let base = robot.first().map_or([0.0; 3], |root| rows.position(*root));
        let mut low = [f64::INFINITY; 3];
        let mut high = [f64::NEG_INFINITY; 3];
        let mut grow = |point: [f64; 3], radius: f64| {
            for i in 0..3 {
                low[i] = low[i].min(point[i] - radius);
                high[i] = high[i].max(point[i] + radius);
            }
        };
        for geom in self.shapes.iter().filter(|geom| geom.kind != GeomKind::Plane) {
            let point = rows.position(geom.body);
            let radius = geom.size.into_iter().fold(0.0, f64::max);
            let distance = norm(sub(point, base));
            if robot.contains(&geom.body) || distance < FAR && radius < FAR {
                grow(point, radius.min(0.3));
            }
        }
        let vertices =
            |surface: &Surface| (0..surface.vertices.len()).map(|v| surface.vertex(&self.world, v)).collect();
        let cloths: Vec<[f64; 3]> =
            self.surfaces.iter().flat_map(|surface| -> Vec<[f64; 3]> { vertices(surface) }).collect();
        cloths.into_iter().for_each(|point| grow(point, 0.0));
        if low[0] > high[0] {
            return (base, 1.0);
        }
        let half = [0, 1, 2].map(|i| 0.5 * (high[i] - low[i]));
        ([0, 1, 2].map(|i| 0.5 * (high[i] + low[i])), norm(half).max(0.1))
    }

    /// Returns the poses of the bodies, the vertices of cloths and the contacts in these states.
    pub fn motion(&mut self, states: &[Vec<f64>]) -> Columns {
        let mut poses: Vec<Vec<[f64; 7]>> = vec![Vec::new(); self.bodies.len()];
        let mut vertices: Vec<Vec<Vec<[f64; 3]>>> =
            self.surfaces.iter().map(|surface| vec![Vec::new(); surface.vertices.len()]).collect();
        let mut counts = Vec::new();
        let mut contacts: Vec<[f64; 6]> = Vec::new();
        for state in states {
            self.world.set_state(state);
            self.world.refresh();
            let rows = self.world.rows();
            for (column, body) in poses.iter_mut().zip(&self.bodies) {
                let [x, y, z] = rows.position(*body);
                let mut turn = rows.quaternion(*body);
                // Both signs are the same orientation; the one near the last is a small difference.
                let before = column
                    .last()
                    .map_or([1.0, 0.0, 0.0, 0.0], |pose: &[f64; 7]| [pose[3], pose[4], pose[5], pose[6]]);
                if (0..4).map(|i| before[i] * turn[i]).sum::<f64>() < 0.0 {
                    turn = turn.map(|v| -v);
                }
                column.push([x, y, z, turn[0], turn[1], turn[2], turn[3]]);
            }
            for (columns, surface) in vertices.iter_mut().zip(&self.surfaces) {
                for (vertex, column) in columns.iter_mut().enumerate() {
                    column.push(surface.vertex(&self.world, vertex));
                }
            }
            self.stage.show(state);
            let found = self.stage.contacts().filter(|[_, force]| norm(*force) >= LEAST_FORCE).take(CONTACTS);
            let before = contacts.len();
            contacts.extend(found.map(|[[x, y, z], [fx, fy, fz]]| [x, y, z, fx, fy, fz]));
            counts.push((contacts.len() - before) as f64);
        }
        let mut columns = Columns::default();
        for column in &poses {
            for i in 0..7 {
                columns.push(column.iter().map(|pose| pose[i]), if i < 3 { GRID } else { TURN });
            }
        }
        for column in vertices.iter().flatten() {
            (0..3).for_each(|i| columns.push(column.iter().map(|vertex| vertex[i]), GRID));
        }
        columns.push(counts, 1.0);
        for i in 0..6 {
            columns.push(contacts.iter().map(|contact| contact[i]), if i < 3 { GRID } else { FORCE });
        }
        columns
    }
}

fn kind(kind: GeomKind) -> &'static str {
    match kind {
        GeomKind::Plane => "plane",
        GeomKind::Sphere => "sphere",
        GeomKind::Capsule => "capsule",
        GeomKind::Ellipsoid => "ellipsoid",
        GeomKind::Cylinder => "cylinder",
        GeomKind::Box => "box",
        GeomKind::Mesh(_) | GeomKind::HeightField(_) | GeomKind::Other => "mesh",
    }
}

/// Appends a mesh; returns the first number and the number of numbers of its vertices and its
/// corners.
fn appended(mesh: Mesh, floats: &mut Vec<u8>, indices: &mut Vec<u8>) -> Value {
    let (vertices, triangles) = mesh;
    let first = [floats.len() / 4, indices.len() / 4];
    floats.extend(vertices.as_flattened().iter().flat_map(|v| v.to_le_bytes()));
    indices.extend(triangles.as_flattened().iter().flat_map(|v| v.to_le_bytes()));
    json!({ "vertices": [first[0], 3 * vertices.len()], "triangles": [first[1], 3 * triangles.len()] })
}
