//! The scene and the cameras of a target under a scenario.

use std::sync::Arc;

use crate::{Ambient, Background, Camera, CameraError, Effects, Form, Material, Pose, Poses, Scene, Shape};
use mishandle_rollout::{Scenario, Space};
use mishandle_world::{Body, Change, Model};

use crate::sight::axes::{MOST_CLUTTER, SightAxis};
use crate::sight::cameras::Sight;
use crate::sight::part::{Part, PartBodies};
use crate::sight::set::Distractor;

/// Height up to which distractors stand on a box, m: on tables and blocks, not on a door.
const HIGHEST: f32 = 0.6;

/// The scene and the cameras of a target in a scenario.
#[derive(Clone, Debug)]
pub struct View {
    /// Shapes, lamps and background.
    pub scene: Scene,
    /// The cameras, in the order of those of the [`Sight`].
    pub cameras: Vec<Camera>,
    /// The part of each shape of the model; distractors follow them in the scene and have none.
    parts: Arc<[Part]>,
    axes: Arc<[SightAxis]>,
    sizes: Option<Arc<SizeAxes>>,
    pub(crate) clutter_count: usize,
    pub(crate) clutter: [Distractor; MOST_CLUTTER],
}

/// Axes of physics that change the sizes of bodies.
#[derive(Debug)]
struct SizeAxes {
    model: Model,
    /// Name of the axis, and the body whose size it scales.
    axes: Vec<(String, Body)>,
}

impl View {
    /// Makes the nominal view of a model by the cameras of a sight, in their order.
    ///
    /// # Errors
    /// If the model has too many shapes.
    pub fn new(
        sight: &Sight,
        model: &Model,
        cameras: Vec<Camera>,
        bodies: &PartBodies,
    ) -> Result<View, CameraError> {
        let scene = Scene::of_model(model)?;
        let parts = scene.shapes.iter().map(|shape| bodies.part(shape)).collect();
        Ok(View {
            scene,
            cameras,
            parts,
            axes: sight.axes.clone(),
            sizes: None,
            clutter_count: 0,
            clutter: std::array::from_fn(Distractor::nominal),
        })
    }

    /// Draws bodies in the sizes that axes of physics give them: name of the axis and the body of
    /// `model`, the one of this view, whose size it scales.
    #[must_use]
    pub fn with_sizes(self, model: &Model, axes: Vec<(String, Body)>) -> View {
        View { sizes: Some(Arc::new(SizeAxes { model: model.clone(), axes })), ..self }
    }

    /// Makes the view of cameras without a scene, for images of other renderers.
    pub(crate) fn without_scene(sight: &Sight, cameras: Vec<Camera>) -> View {
        let scene = Scene {
            shapes: Vec::new(),
            meshes: Vec::new(),
            cloths: Vec::new(),
            lamps: Vec::new(),
            ambient: Ambient::NOMINAL,
            background: Background::NOMINAL,
        };
        View {
            scene,
            cameras,
            parts: Arc::new([]),
            axes: sight.axes.clone(),
            sizes: None,
            clutter_count: 0,
            clutter: std::array::from_fn(Distractor::nominal),
        }
    }

    /// Returns the view under a scenario, whose simulation starts with bodies at `start`, where
    /// distractors find what they stand on. Axes that are not of sight change nothing.
    pub fn under(&self, space: &Space, scenario: &Scenario, start: &Poses) -> View {
        let mut view = self.clone();
        let value = |name: &str| scenario.get(space.axes().iter().position(|own| own.name == name)?);
        if let Some(SizeAxes { model, axes }) = self.sizes.as_deref() {
            let change = |(name, body): &(String, Body)| {
                let factor = value(name).filter(|factor| *factor != 1.0)?;
                Some(Change::Size(vec![*body], factor))
            };
            view.resize(model, &axes.iter().filter_map(change).collect::<Vec<_>>());
        }
        for SightAxis { axis, set, .. } in self.axes.iter() {
            let value = value(&axis.name);
            if let Some(value) = value.filter(|value| Some(*value) != axis.nominal) {
                set.apply(&mut view, value);
            }
        }
        for index in 0..view.clutter_count {
            view.put(index, start);
        }
        view
    }

    /// Gives the shapes the sizes that a model has after changes.
    fn resize(&mut self, model: &Model, changes: &[Change]) {
        if changes.is_empty() {
            return;
        }
        // The nominal model has a scene, and so has this one with as many shapes.
        let Ok(resized) = Scene::of_model(&model.changed(changes)) else { return };
        for (shape, resized) in self.scene.shapes.iter_mut().zip(resized.shapes) {
            (shape.form, shape.pose) = (resized.form, resized.pose);
        }
    }

    /// Returns the part of a shape of the scene; `None` for a distractor.
    pub fn part(&self, shape: usize) -> Option<Part> {
        self.parts.get(shape).copied()
    }

    /// Returns whether the scene has an object.
    pub fn has_object(&self) -> bool {
        self.parts.contains(&Part::Object)
    }

    /// Changes the materials of a part.
    pub(crate) fn materials(&mut self, part: Part, change: impl Fn(&mut Material)) {
        let shapes = self.scene.shapes.iter_mut().zip(self.parts.iter());
        shapes.filter(|(_, own)| **own == part).for_each(|(shape, _)| change(&mut shape.material));
    }

    /// Changes the effects of all cameras.
    pub(crate) fn effects(&mut self, change: impl Fn(&mut Effects)) {
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
