//! The scene and the cameras of a target under a scenario.

use std::sync::Arc;

use crate::{Ambient, Background, Camera, CameraError, Effects, Material, Poses, Scene};
use mishandle_rollout::{Scenario, Space};
use mishandle_world::{Body, Change, Model};

use crate::sight::axes::MOST_DISTRACTORS;
use crate::sight::cameras::Sight;
use crate::sight::corruption::CorruptImages;
use crate::sight::distractor::Distractor;
use crate::sight::factor::SightAxis;
use crate::sight::part::{Part, PartBodies};
use crate::sight::placing::Placing;

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
    pub(crate) corruption: CorruptImages,
    pub(crate) distractor_count: usize,
    pub(crate) distractors: [Distractor; MOST_DISTRACTORS],
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
        let mut scene = Scene::of_model(model)?;
        scene.lamps[0].direction = sight.lamp.map(|v| v as f32);
        scene.reflect();
        let parts = scene.shapes.iter().map(|shape| bodies.part(shape)).collect();
        Ok(View {
            scene,
            cameras,
            parts,
            axes: sight.axes.clone(),
            sizes: None,
            corruption: CorruptImages::NOMINAL,
            distractor_count: 0,
            distractors: std::array::from_fn(Distractor::nominal),
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
            corruption: CorruptImages::NOMINAL,
            distractor_count: 0,
            distractors: std::array::from_fn(Distractor::nominal),
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
        view.scene.reflect();
        view.scene.light_background(&self.scene);
        view.cameras.iter_mut().for_each(|camera| view.corruption.apply(camera));
        if view.distractor_count > 0 {
            // Where they stand does not depend on what else the scenario changes.
            let mut placing = Placing::new(&self.scene, &self.parts, &self.cameras[0], start);
            let asked = &view.distractors[..view.distractor_count];
            view.scene.shapes.extend(asked.iter().filter_map(|distractor| placing.put(distractor)));
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
}
