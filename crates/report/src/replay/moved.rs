//! Scenes of systems that are not part of this program: they say where their bodies are while they
//! simulate.

use std::fmt::Write;

use mishandle::MishandleError;
use mishandle::rollout::{Episode, RolloutError};
use mishandle::world::{Model, PictureModel};
use mishandle_text::xml_text;
use serde::Deserialize;

use super::scene::{Roles, SceneReader};

/// Numbers of a pose: position and quaternion.
const POSE: usize = 7;

/// A system that is not part of this program, whose bodies a replay shows.
pub trait Mover {
    /// Asks for the bodies of the next simulation.
    fn begin(&mut self);

    /// Returns the scene of the simulation, as JSON, and at each sample the poses of all bodies but
    /// the world: position (m) and quaternion of each.
    ///
    /// # Errors
    /// If the system did not note them.
    fn take(&mut self) -> Result<(String, Vec<Vec<f64>>), String>;
}

/// A scene as a [`Mover`] describes it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct MovedScene {
    /// Names, which may be empty. The first body is the world.
    bodies: Vec<String>,
    /// Bodies of the robot, the base first.
    robot: Vec<usize>,
    /// Whether the base moves about.
    is_mobile: bool,
    /// Bodies with a path.
    traced: Vec<usize>,
    shapes: Vec<MovedShape>,
    /// Vertices and triangles of each mesh.
    meshes: Vec<(Vec<f64>, Vec<u32>)>,
}

/// A shape, with the numbers that MJCF has for it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct MovedShape {
    is_site: bool,
    body: usize,
    kind: String,
    size: [f64; 3],
    position: [f64; 3],
    quaternion: [f64; 4],
    color: [f32; 4],
    group: i32,
    mesh: Option<usize>,
}

/// The scene of the first simulation of a mover, in which all are shown.
struct First {
    text: String,
    scene: MovedScene,
    picture: PictureModel,
    model: Model,
}

/// A system that is simulated again with the poses of its bodies.
pub struct MovedSystem<'a> {
    mover: &'a mut dyn Mover,
    first: Option<Box<First>>,
    /// Whether another simulation has another scene than the first one.
    pub changes: bool,
}

impl<'a> MovedSystem<'a> {
    pub fn new(mover: &'a mut dyn Mover) -> MovedSystem<'a> {
        MovedSystem { mover, first: None, changes: false }
    }

    /// Simulates by `work`. Returns the states of the episode in the model of
    /// [`reader`](Self::reader), too.
    ///
    /// # Errors
    /// If `work` fails, the system did not note its bodies, or MuJoCo rejects their shapes.
    pub fn simulate(
        &mut self,
        work: impl FnOnce() -> Result<Episode, MishandleError>,
    ) -> Result<(Episode, Vec<Vec<f64>>), MishandleError> {
        self.mover.begin();
        let episode = work();
        let taken = self.mover.take();
        let episode = episode?;
        let (text, poses) = taken.map_err(failed)?;
        // A scenario that cannot start has no poses.
        if poses.is_empty() {
            return Ok((episode, Vec::new()));
        }
        let first = match &mut self.first {
            Some(first) => first,
            None => self.first.insert(Box::new(First::new(text.clone())?)),
        };
        self.changes |= first.text != text;
        let states = poses.iter().map(|poses| first.state(poses)).collect::<Result<_, _>>()?;
        Ok((episode, states))
    }

    /// Returns the reader of the scene.
    ///
    /// # Errors
    /// If no simulation has started.
    pub fn reader(&self) -> Result<SceneReader, MishandleError> {
        let first = self.first.as_ref().ok_or_else(|| failed("the simulation has no sample".to_string()))?;
        let MovedScene { robot, is_mobile, traced, .. } = &first.scene;
        let body = |index: usize| first.model.body_at(index);
        let roles = Roles {
            root: body(robot.first().copied().unwrap_or_default()),
            is_mobile: *is_mobile,
            traced: traced.iter().map(|index| body(*index)).collect(),
        };
        SceneReader::with_roles(&first.picture, roles)
    }
}

impl First {
    fn new(text: String) -> Result<First, MishandleError> {
        let scene: MovedScene = serde_json::from_str(&text).map_err(|error| failed(error.to_string()))?;
        let shapes = scene.shapes.iter().map(|shape| &shape.body);
        if let Some(body) =
            shapes.chain(&scene.robot).chain(&scene.traced).find(|body| **body >= scene.bodies.len())
        {
            return Err(failed(format!("the scene has no body {body}")));
        }
        let picture = PictureModel::new(scene.document());
        let model = picture.compile()?;
        Ok(First { text, scene, picture, model })
    }

    /// Returns the state of the model with these poses: time, poses, and zeros for all that does
    /// not move them.
    fn state(&self, poses: &[f64]) -> Result<Vec<f64>, MishandleError> {
        if poses.len() != POSE * (self.scene.bodies.len() - 1) {
            return Err(failed("the number of bodies changed between two simulations".to_string()));
        }
        let mut state = vec![0.0; self.model.state_size()];
        state[1..=poses.len()].copy_from_slice(poses);
        Ok(state)
    }
}

impl MovedScene {
    /// Returns a model in which each body moves on its own: what a replay knows of models of this
    /// program, such as cameras and the look of shapes, is then known of this scene, too. Motors
    /// mark the robot.
    fn document(&self) -> String {
        let mut meshes = String::new();
        for (index, (vertices, triangles)) in self.meshes.iter().enumerate() {
            let (vertices, triangles) = (numbers(vertices), numbers(triangles));
            // A surface can be open; its mass is of no interest.
            let _ = write!(
                meshes,
                "<mesh name=\"m{index}\" inertia=\"shell\" vertex=\"{vertices}\" face=\"{triangles}\"/>"
            );
        }
        let shapes = |body: usize| -> String {
            self.shapes.iter().filter(|shape| shape.body == body).map(MovedShape::element).collect()
        };
        let body = |(index, name): (usize, &String)| {
            let name = if name.is_empty() { String::new() } else { format!(" name=\"{}\"", xml_text(name)) };
            let shapes = shapes(index);
            format!(
                "<body{name}><freejoint name=\"j{index}\"/><inertial pos=\"0 0 0\" mass=\"1\" \
                 diaginertia=\"1 1 1\"/>{shapes}</body>"
            )
        };
        let bodies: String = self.bodies.iter().enumerate().skip(1).map(body).collect();
        let motor = |body: &usize| format!("<motor joint=\"j{body}\"/>");
        let motors: String = self.robot.iter().map(motor).collect();
        let world = shapes(0);
        format!(
            "<mujoco><asset>{meshes}</asset><worldbody>{world}{bodies}</worldbody>\
             <actuator>{motors}</actuator></mujoco>"
        )
    }
}

impl MovedShape {
    fn element(&self) -> String {
        // A mesh that touches nothing needs no convex hull, which a flat one has not.
        let element = if self.is_site { "site" } else { "geom contype=\"0\" conaffinity=\"0\"" };
        let shape = match self.mesh {
            Some(mesh) => format!("mesh=\"m{mesh}\""),
            None => format!("size=\"{}\"", numbers(&self.size)),
        };
        let MovedShape { kind, group, position, quaternion, color, .. } = self;
        format!(
            "<{element} type=\"{}\" {shape} group=\"{group}\" pos=\"{}\" quat=\"{}\" rgba=\"{}\"/>",
            xml_text(kind),
            numbers(position),
            numbers(quaternion),
            numbers(color)
        )
    }
}

fn numbers<T: ToString>(values: &[T]) -> String {
    values.iter().map(T::to_string).collect::<Vec<_>>().join(" ")
}

fn failed(problem: String) -> MishandleError {
    RolloutError::System(problem).into()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    const SCENE: &str = r#"{"bodies": ["world", "a & b", ""], "robot": [2], "is_mobile": false, "traced": [2],
        "shapes": [
            {"is_site": false, "body": 0, "kind": "plane", "size": [1, 1, 1], "position": [0, 0, 0],
             "quaternion": [1, 0, 0, 0], "color": [1, 0, 0, 1], "group": 0, "mesh": null},
            {"is_site": false, "body": 2, "kind": "mesh", "size": [0, 0, 0], "position": [0, 0, 0.5],
             "quaternion": [1, 0, 0, 0], "color": [1, 0, 0, 1], "group": 0, "mesh": 0}],
        "meshes": [[[0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0], [0, 1, 3, 0, 3, 2]]]}"#;

    #[test]
    fn a_state_has_the_poses_of_the_bodies() {
        let first = First::new(SCENE.to_string()).unwrap();
        let poses = [1.0, 2.0, 3.0, 0.0, 1.0, 0.0, 0.0, -1.0, 0.5, 0.25, 0.6, 0.0, 0.8, 0.0];
        let mut world = first.model.world();
        world.set_state(&first.state(&poses).unwrap());
        world.refresh();
        let rows = world.rows();
        for (index, pose) in (1..).zip(poses.chunks(POSE)) {
            let body = first.model.body_at(index);
            assert_eq!([&rows.position(body)[..], &rows.quaternion(body)[..]].concat(), pose);
        }
        assert_eq!(first.model.body("a & b").unwrap().index(), 1);
        assert!(first.state(&poses[1..]).is_err());
    }

    #[test]
    fn a_scene_without_a_body_of_a_shape_is_an_error() {
        let text = SCENE.replace("\"body\": 2", "\"body\": 3");
        let message = First::new(text).map(drop).expect_err("no body 3").to_string();
        assert_eq!(message.matches("no body 3").count(), 1, "{message}");
    }
}
