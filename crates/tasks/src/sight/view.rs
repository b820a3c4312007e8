//! The scene and the cameras of a task under a scenario.

use std::sync::Arc;

use mishandle_camera::{Camera, CameraError, Effects, Form, Material, Pose, Poses, Scene, Shape, Size};
use mishandle_rollout::{Scenario, Space};
use mishandle_world::{Body, ElementKind, Model, PANDA, WorldError};

use super::axes::{MOST_CLUTTER, SightAxis, sight_axes};
use super::part::Part;
use super::set::Distractor;
use crate::cameras::CameraPlace;
use crate::definition::Task;
use crate::document::compose;

/// Height up to which distractors stand on a box, m: on tables and blocks, not on a door.
const HIGHEST: f32 = 0.6;

/// The scene and the cameras of a task in a scenario.
#[derive(Clone, Debug)]
pub struct View {
    /// Shapes, lamps and background.
    pub scene: Scene,
    /// The cameras, in the order of [`Task::cameras`].
    pub cameras: Vec<Camera>,
    /// The part of each shape of the model; distractors follow them in the scene and have none.
    parts: Arc<[Part]>,
    axes: Arc<[SightAxis]>,
    pub(super) clutter_count: usize,
    pub(super) clutter: [Distractor; MOST_CLUTTER],
}

impl View {
    /// Makes the nominal view of a task, with the model whose states it shows.
    ///
    /// # Errors
    /// If the scene does not compile.
    pub fn new(task: &dyn Task, size: Size) -> Result<(Model, View), WorldError> {
        let model = Model::from_xml(&compose(task)?)?;
        let too_many = |error: CameraError| WorldError::Model(error.to_string());
        let scene = Scene::of_model(&model).map_err(too_many)?;
        let cameras =
            task.cameras().iter().map(|place| camera(place, &model, size)).collect::<Result<_, _>>()?;
        let parts = parts(task, &model, &scene)?;
        let view = View {
            scene,
            cameras,
            parts,
            axes: sight_axes(task.definition()).into(),
            clutter_count: 0,
            clutter: std::array::from_fn(Distractor::nominal),
        };
        Ok((model, view))
    }

    /// Returns the view under a scenario, whose simulation starts with bodies at `start`, where
    /// distractors find what they stand on. Axes that are not of sight change nothing.
    pub fn under(&self, space: &Space, scenario: &Scenario, start: &Poses) -> View {
        let mut view = self.clone();
        for SightAxis { axis, set, .. } in self.axes.iter() {
            let place = space.axes().iter().position(|own| own.name == axis.name);
            let value = place.and_then(|place| scenario.get(place));
            if let Some(value) = value.filter(|value| Some(*value) != axis.nominal) {
                set.apply(&mut view, value);
            }
        }
        for index in 0..view.clutter_count {
            view.put(index, start);
        }
        view
    }

    /// Returns the part of a shape of the scene; `None` for a distractor.
    pub fn part(&self, shape: usize) -> Option<Part> {
        self.parts.get(shape).copied()
    }

    /// Changes the materials of a part.
    pub(super) fn materials(&mut self, part: Part, change: impl Fn(&mut Material)) {
        let shapes = self.scene.shapes.iter_mut().zip(self.parts.iter());
        shapes.filter(|(_, own)| **own == part).for_each(|(shape, _)| change(&mut shape.material));
    }

    /// Changes the effects of all cameras.
    pub(super) fn effects(&mut self, change: impl Fn(&mut Effects)) {
        self.cameras.iter_mut().for_each(|camera| change(&mut camera.effects));
    }

    /// Puts a distractor on what is at its place.
    fn put(&mut self, index: usize, start: &Poses) {
        let distractor = self.clutter[index];
        let (form, material) = distractor.look();
        let [x, y] = distractor.place;
        let position = [x, y, self.top(x, y, start) + distractor.size];
        let pose = Pose { position, ..Pose::IDENTITY };
        self.scene.shapes.push(Shape { body: 0, pose, form, material, geom: None });
    }

    /// Returns the height of the boxes at a point that are low enough to stand on, m; 0 is the
    /// ground.
    fn top(&self, x: f32, y: f32, start: &Poses) -> f32 {
        let height = |(shape, part): (&Shape, &Part)| match shape.form {
            Form::Box { half: [a, b, c] } if *part == Part::Support => {
                let Pose { position: [cx, cy, cz], .. } = start.bodies.get(shape.body)?.of(&shape.pose);
                let is_there = (x - cx).abs() <= a && (y - cy).abs() <= b && cz + c <= HIGHEST;
                is_there.then_some(cz + c)
            }
            _ => None,
        };
        self.scene.shapes.iter().zip(self.parts.iter()).filter_map(height).fold(0.0, f32::max)
    }
}

fn camera(place: &CameraPlace, model: &Model, size: Size) -> Result<Camera, WorldError> {
    let body = place.body.map_or(Ok(0), |name| model.body(name).map(Body::index))?;
    let points = [place.from, place.to, place.up].map(|point| point.map(|v| v as f32));
    Ok(Camera::looking(size, body, points, place.focal_length as f32))
}

/// Returns the part of each shape.
fn parts(task: &dyn Task, model: &Model, scene: &Scene) -> Result<Arc<[Part]>, WorldError> {
    let robot = Model::from_xml(PANDA)?;
    let robot = robot.names(ElementKind::Body);
    let is_robot: Vec<bool> =
        model.names(ElementKind::Body).iter().skip(1).map(|name| robot.contains(name)).collect();
    // A task without an object is about its target.
    let definition = task.definition();
    let object = definition.object.or(definition.variations.jump);
    let of_object = object.map_or_else(Vec::new, |name| match model.flex(name) {
        Ok(flex) => flex.bodies().map(Body::index).collect(),
        Err(_) => model.body(name).map_or_else(|_| Vec::new(), |body| vec![body.index()]),
    });
    let part = |shape: &Shape| match shape.form {
        Form::Plane { .. } => Part::Floor,
        _ if of_object.contains(&shape.body) => Part::Object,
        _ if shape.body > 0 && is_robot[shape.body - 1] => Part::Robot,
        _ => Part::Support,
    };
    Ok(scene.shapes.iter().map(part).collect())
}
